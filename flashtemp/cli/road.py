"""Commands for road surfaces: spots, the contact map of a topography, and spectrum, its power spectrum C(q)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from flashtemp.cli.terminal import EXIT_DONE, Json, Switch, print_message, print_result
from flashtemp.errors import BadInput


def spots(
    file: Path | None = None,
    /,
    *,
    out: Path,
    cutoff: float,
    pressure: float = 1.5e5,
    modulus: float = 1.33e7,
    synthetic: Annotated[bool, Switch] = False,
    length: float | None = None,
    width: float | None = None,
    pixel: float = 1e-4,
    hurst: float = 0.85,
    rms: float = 3e-4,
    rolloff: float = 5e-3,
    seed: int = 1,
    json: Json = False,
) -> int:
    """Compute which macroasperity regions of a road touch: a contact map for resolved_spots.contact_map.

    Parameters
    ----------
    file
        Height map of an instrument (any format of SurfaceTopography), or a text matrix of heights in m separated by
        blanks; x, along the columns of the matrix, is the direction of sliding.
    out
        Contact map to write, a .npz file.
    cutoff
        Shortest wavelength of the road to include, m; it sets the magnification of the macroasperities.
    pressure
        Nominal contact pressure, Pa.
    modulus
        Contact modulus E/(1 - nu^2) of the rubber, Pa.
    synthetic
        Generate a self-affine road instead of reading a file.
    length
        Length of the road along x, m; 0.05 if synthetic.  For a file only where it does not state its size.
    width
        Width of the road, m; 0.02 if synthetic.  For a file only where it does not state its size.
    pixel
        Pixel size of the synthetic road, m.
    hurst
        Hurst exponent of the synthetic road.
    rms
        Root mean square height of the synthetic road, m.
    rolloff
        Roll-off wavelength of the synthetic road, m.
    seed
        Seed of the synthetic road.
    """
    from flashtemp.api import friction

    if (file is None) != synthetic:
        raise BadInput("spots: give one FILE of heights, or --synthetic")
    found = friction.spots(
        file, cutoff=cutoff, pressure=pressure, modulus=modulus, length=length, width=width, pixel=pixel, hurst=hurst,
        rms=rms, rolloff=rolloff, seed=seed, out=out,
    )  # fmt: skip
    print_result(found.as_dict() | {"out": str(out)}, json, f"{found}\n  resolved_spots.contact_map: {out}")
    return EXIT_DONE


def spectrum(
    file: Path,
    /,
    *,
    out: Path,
    profile: Annotated[bool, Switch] = False,
    highpass: float | None = None,
    pixel: float | None = None,
    json: Json = False,
) -> int:
    """Compute the power spectrum C(q) of a measured road for persson_friction.spectrum, with a picture.

    Parameters
    ----------
    file
        Height map of an instrument (any format of SurfaceTopography), or a line profile.
    out
        Spectrum to write, a new .csv file (q in 1/m, C in m^4); the picture is the .png file of the same name.
    profile
        The file is a line profile with columns of distance and height; not needed where a header states both units.
    highpass
        Longest wavelength to include, m; half the length of the measurement when not given.
    pixel
        Pixel size in m of a file that contains only heights in m (.npy or text, one row per line).
    """
    from flashtemp.api import friction

    found = friction.spectrum(file, profile=profile, highpass=highpass, pixel=pixel, out=out)
    for note in found.notes:
        print_message(note)
    picture = str(out.with_suffix(".png"))
    text = f"{found}\n  persson_friction.spectrum: {out}\n  picture: {picture}"
    print_result(found.as_dict() | {"out": str(out), "picture": picture}, json, text)
    return EXIT_DONE
