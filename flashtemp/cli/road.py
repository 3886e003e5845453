"""The commands on the road: spots, from a topography to a contact map; spectrum, from heights to C(q)."""

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
    """Which macroasperity regions of a road touch: a contact map for resolved_spots.contact_map.

    Parameters
    ----------
    file
        Height map of an instrument, or a text matrix of heights in m with blanks between (any format of
        SurfaceTopography); x, the columns of a matrix, along the direction of sliding.
    out
        The contact map, a .npz file.
    cutoff
        Shortest wavelength of the road that counts, m: the magnification of the macroasperities.
    pressure
        Nominal contact pressure, Pa.
    modulus
        Contact modulus E/(1 - nu^2) of the rubber, Pa.
    synthetic
        A self-affine road instead of a file, of this length, width, pixel, hurst exponent, rms height and rolloff (m).
    length
        Of the road along x, m: 0.05 where it is synthetic; of a file only where that does not state it, with its width.
    width
        Of the road across, m: 0.02 where it is synthetic.
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
    """The power spectrum C(q) of a measured road, for persson_friction.spectrum, and a picture of it.

    Parameters
    ----------
    file
        Height map of an instrument (any format of SurfaceTopography), or a profile.
    out
        The spectrum, a new .csv file (q in 1/m, C in m^4); the picture stands beside it as .png.
    profile
        The file is one line: columns of distance and height.  A file whose header states the units of both needs
        no --profile.
    highpass
        Longest wavelength that counts, m; all that fit twice into the measurement if none is given.
    pixel
        The file holds nothing but heights in m (.npy or text, one row per line) at this distance, m.
    """
    from flashtemp.api import friction

    found = friction.spectrum(file, profile=profile, highpass=highpass, pixel=pixel, out=out)
    for note in found.notes:
        print_message(note)
    picture = str(out.with_suffix(".png"))
    text = f"{found}\n  persson_friction.spectrum: {out}\n  picture: {picture}"
    print_result(found.as_dict() | {"out": str(out), "picture": picture}, json, text)
    return EXIT_DONE
