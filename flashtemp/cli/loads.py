"""The command on the load: which process makes friction depend on it."""

from __future__ import annotations

import json as text
from pathlib import Path

from flashtemp.cli.terminal import DONE, Json, counter, emit, finite
from flashtemp.errors import BadInput
from flashtemp.runs.folders import free_name, whole


def loads(
    case: str,
    /,
    *overrides: str,
    pressures: str = "5e4,1e5,2e5,3e5",
    speeds: str = "0.1,0.5,1.0",
    out: Path | None = None,
    workers: int | None = None,
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
    out
        Result folder; results/CASE-loads when not given.
    workers
        Processes that share the runs; as many as there are cores when not given.
    """
    from flashtemp.model.case import load
    from flashtemp.runs.load_dependence import attribute
    from flashtemp.viz import loads as picture

    loaded = load(case, list(overrides))
    p, v = _numbers("--pressures", pressures, 2), _numbers("--speeds", speeds, 1)
    folder = out or free_name(Path("results") / f"{loaded.name}-loads")
    with whole(folder) as work, counter(loaded.name) as watch:
        found = attribute(loaded, p, v, workers, watch)
        (work / "case.toml").write_text(loaded.toml(loaded.copy_files(work)), encoding="utf-8")
        (work / "loads.json").write_text(text.dumps(finite(found.as_dict()), indent=2) + "\n", encoding="utf-8")
        found.save(work / "loads.csv")
        picture.draw(found).savefig(work / "loads.png")
    emit(found.as_dict() | {"out": str(folder)}, json, f"{found}\n  results in {folder}/")
    return DONE


def _numbers(option: str, given: str, fewest: int) -> tuple[float, ...]:
    """Rising positive numbers between commas."""
    try:
        values = tuple(float(v) for v in given.split(","))
    except ValueError as fault:
        raise BadInput(f"{option}: {given}; give numbers between commas") from fault
    if (
        len(values) < fewest
        or not all(0 < a < 1e9 for a in values)
        or any(b <= a for a, b in zip(values[:-1], values[1:], strict=True))
    ):
        raise BadInput(f"{option}: {given}; give at least {fewest} rising numbers > 0, between commas")
    return values
