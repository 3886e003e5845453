"""Commands for rubber friction: friction theory, load dependence, road surfaces, tread blocks and tyres."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from flashtemp.cli.terminal import (
    EXIT_DONE,
    Json,
    Switch,
    Trust,
    print_message,
    print_result,
    progress_counter,
    result_folder,
)
from flashtemp.errors import BadInput


def friction(
    case: str,
    /,
    *overrides: str,
    out: Path | None = None,
    slowest: float = 1e-6,
    fastest: float = 10.0,
    area: bool = False,
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Compute friction over speed and temperature from a master curve and a power spectrum.

    The result also states the part of the curve that a slope tester reaches.

    Parameters
    ----------
    case
        A case folder or a .toml file with the effect persson_friction.
    overrides
        Keys of the case to change, as table.key=value.
    out
        Result folder; results/CASE-friction when not given.
    slowest
        Lowest sliding speed, m/s.
    fastest
        Highest sliding speed, m/s.
    area
        Compute the contact area over nominal pressure instead: A/A0 against p/E, and where it saturates.
    """
    from flashtemp.api import friction as api
    from flashtemp.api import inputs

    loaded = inputs.load(case, list(overrides), trust=trust)
    if area:
        folder = result_folder(out, f"{loaded.name}-area")
        study = api.compute_contact_area(loaded, out=folder)
        print_result(study.as_dict() | {"out": str(folder)}, json, f"{study}\n  results in {folder}/")
        return EXIT_DONE
    folder = result_folder(out, f"{loaded.name}-friction")
    result = api.friction(loaded, slowest=slowest, fastest=fastest, out=folder)
    print_result(result.as_dict() | {"out": str(folder)}, json, f"{result}\n  results in {folder}/")
    return EXIT_DONE


def loads(
    case: str,
    /,
    *overrides: str,
    pressures: str = "5e4,1e5,2e5,3e5",
    speeds: str = "0.1,0.5,1.0",
    skewness_cutoff: float | None = None,
    out: Path | None = None,
    workers: int | None = None,
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Find which process makes friction depend on load: saturation, softening, skewness, adhesion or heating.

    Each process is simulated alone, and all processes without it.  The result is curves, the fraction of each process
    by load and speed, and a picture.

    Parameters
    ----------
    case
        A case folder or a .toml file whose effects compute friction by theory.
    overrides
        Keys of the case to change, as table.key=value.
    pressures
        Nominal contact pressures, Pa, in ascending order.
    speeds
        Sliding speeds, m/s.
    skewness_cutoff
        Shortest wavelength that skewness flattens, m; 0 for all, persson_friction.skewness_cutoff when not given.
    out
        Result folder; results/CASE-loads when not given.
    workers
        Number of processes; one per core when not given.
    """
    from flashtemp.api import friction as api
    from flashtemp.api import inputs

    loaded = inputs.load(case, list(overrides), trust=trust)
    p, v = _parse_numbers("--pressures", pressures, 2), _parse_numbers("--speeds", speeds, 1)
    folder = result_folder(out, f"{loaded.name}-loads")
    with progress_counter(loaded.name) as watch:
        result = api.loads(
            loaded, pressures=p, speeds=v, skewness_cutoff=skewness_cutoff, out=folder, workers=workers, watch=watch
        )
    print_result(result.as_dict() | {"out": str(folder)}, json, f"{result}\n  results in {folder}/")
    return EXIT_DONE


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
        blanks, whose rows run along the direction of sliding.
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
    result = friction.spots(
        file, cutoff=cutoff, pressure=pressure, modulus=modulus, length=length, width=width, pixel=pixel, hurst=hurst,
        rms=rms, rolloff=rolloff, seed=seed, out=out,
    )  # fmt: skip
    print_result(result.as_dict() | {"out": str(out)}, json, f"{result}\n  resolved_spots.contact_map: {out}")
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

    result = friction.spectrum(file, profile=profile, highpass=highpass, pixel=pixel, out=out)
    for note in result.notes:
        print_message(note)
    picture = str(out.with_suffix(".png"))
    text = f"{result}\n  persson_friction.spectrum: {out}\n  picture: {picture}"
    print_result(result.as_dict() | {"out": str(out), "picture": picture}, json, text)
    return EXIT_DONE


def tread(case: str, /, *overrides: str, out: Path | None = None, trust: Trust = False, json: Json = False) -> int:
    """Compute the friction of one tread block along its footprint, from the cold to the hot branch, at several slips.

    Parameters
    ----------
    case
        A case folder or a .toml file; its table [tread] describes the block and the footprint.
    overrides
        Keys of the case to change, as table.key=value.
    out
        Result folder; results/CASE-tread when not given.
    """
    from flashtemp.api import friction, inputs

    loaded = inputs.load(case, list(overrides), trust=trust)
    folder = result_folder(out, f"{loaded.name}-tread")
    with progress_counter(loaded.name) as watch:
        result = friction.tread(loaded, out=folder, watch=watch)
    print_result(result.as_dict() | {"out": str(folder)}, json, f"{result}\n  results in {folder}/")
    return EXIT_DONE


def tyre(case: str, /, *overrides: str, out: Path | None = None, trust: Trust = False, json: Json = False) -> int:
    """Compute the side force of a tyre over slip angle at several loads, with the cold-hot law and its controls.

    Parameters
    ----------
    case
        A case folder or a .toml file; its table [tyre] describes the footprint and the bristles.
    overrides
        Keys of the case to change, as table.key=value.
    out
        Result folder; results/CASE-tyre when not given.
    """
    from flashtemp.api import friction, inputs

    loaded = inputs.load(case, list(overrides), trust=trust)
    folder = result_folder(out, f"{loaded.name}-tyre")
    with progress_counter(loaded.name) as watch:
        result = friction.tyre(loaded, out=folder, watch=watch)
    print_result(result.as_dict() | {"out": str(folder)}, json, f"{result}\n  results in {folder}/")
    return EXIT_DONE


def _parse_numbers(option: str, text: str, fewest: int) -> tuple[float, ...]:
    """Positive numbers in ascending order, separated by commas.  Raises BadInput."""
    from flashtemp.runs.studies.load_dependence import refuse_values

    try:
        values = tuple(float(v) for v in text.split(","))
    except ValueError as fault:
        raise BadInput(f"{option}: {text}; give numbers separated by commas") from fault
    refuse_values(option, values, fewest, text)
    return values
