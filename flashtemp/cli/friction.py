"""Commands on friction by theory: friction, over speed and temperature; loads, why it depends on the load."""

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
    """Friction over speed and temperature from a master curve and a power spectrum, and what a slope tester reaches.

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
        The area in contact over nominal pressure instead: A/A0 against p/E, and where it saturates.
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
    """Which process makes friction depend on the load: saturation, softening, skewness, adhesion or heating.

    Each is simulated alone, and with all others but it; curves, shares by load and speed, and a picture.

    Parameters
    ----------
    case
        A case folder or a .toml file whose effects compute friction by theory.
    overrides
        Keys of the case to change, as table.key=value.
    pressures
        Nominal contact pressures, Pa, rising.
    speeds
        Sliding speeds, m/s.
    skewness_cutoff
        Shortest wave that skewness flattens, m; 0 all waves, persson_friction.skewness_cutoff when not given.
    out
        Result folder; results/CASE-loads when not given.
    workers
        Processes that share the runs; as many as there are cores when not given.
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
    """Rising positive numbers between commas."""
    from flashtemp.runs.studies.load_dependence import refuse_values

    try:
        values = tuple(float(v) for v in text.split(","))
    except ValueError as fault:
        raise BadInput(f"{option}: {text}; give numbers between commas") from fault
    refuse_values(option, values, fewest, text)
    return values
