"""Commands for friction theory: friction over speed and temperature, and loads, the causes of load dependence."""

from __future__ import annotations

from pathlib import Path

from flashtemp.cli.terminal import EXIT_DONE, Json, Trust, print_result, progress_counter, result_folder
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
    found = api.friction(loaded, slowest=slowest, fastest=fastest, out=folder)
    print_result(found.as_dict() | {"out": str(folder)}, json, f"{found}\n  results in {folder}/")
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
        found = api.loads(
            loaded, pressures=p, speeds=v, skewness_cutoff=skewness_cutoff, out=folder, workers=workers, watch=watch
        )
    print_result(found.as_dict() | {"out": str(folder)}, json, f"{found}\n  results in {folder}/")
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
