"""The long attack on the model: random legal cases, every key within its bounds, run to their end.

A try is clean when the case is refused in one line, fails for a reason of the physics, or ends with a result that is
finite, conserves heat and is nowhere colder than everything that cools.
"""

from __future__ import annotations

import math
import random
import sys
import traceback
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np

from flashtemp.errors import BadInput, SolverFailure
from flashtemp.model.case import load_case
from flashtemp.model.schema import CASE_TABLES, declared_params
from flashtemp.physics.effect import Param, catalogue
from flashtemp.solver import sanity_checks
from flashtemp.solver.time_integration import integrate_schedule

SMALL = {
    "numerics.cells": [10, 7, 8], "schedule.distance": 0.02, "output.profiles": 6, "output.fields": 2,
    "block.height": 0.003,
}  # fmt: skip
PHYSICAL = (  # failures that tell of the physics, not of the program
    "is above limits.temperature",
    "is worn through to its holder",
    "tips the block over its edge",
    "no spot is under the block",
    "heat capacity fell to zero",
    "has no consistent spot temperature",  # friction that rises with temperature faster than heat leaves: a runaway
)
COLD = 0.02, 0.001  # K, and of the largest rise
FIXED = {"output", "limits", "numerics"}
TRIES = 480


def random_number(rng: random.Random, param: Param, wide: float = 0.2) -> float:
    """A number within the bounds of a parameter: mostly near its default, sometimes anywhere, sometimes a bound."""
    low, high = max(param.low, -1e9), min(param.high, 1e9)
    value = param.value if isinstance(param.value, (int, float)) and not isinstance(param.value, bool) else None
    where = rng.random()
    if value and where > wide:
        number = value * 10.0 ** rng.uniform(-0.7, 0.7) * (rng.choice((1, -1)) if low < 0 or param.signed else 1)
    elif where < 0.05:
        number = rng.choice((low, high))
    elif low > 0 or (low == 0 and high > 100):
        number = math.exp(rng.uniform(math.log(max(low, 1e-6 * high)), math.log(high)))
    else:
        number = rng.uniform(low, high)
    number = min(max(number, low), high)
    return number if param.find_fault(number) is None else (value if value is not None else 0.5 * (low + high))


def random_value(rng: random.Random, param: Param) -> object:
    """A legal value of a parameter, None where only files, names or tables would do."""
    if "number" in param.kinds or "amount" in param.kinds:
        return random_number(rng, param)
    if "flag" in param.kinds:
        return rng.random() < 0.5
    if "whole" in param.kinds:
        return rng.randint(int(param.low), int(min(param.high, 3)))
    return None


def random_keys(rng: random.Random, effects: list[str]) -> dict[str, object]:
    """Some keys of the case's tables and of the chosen effects, with random legal values."""
    given: dict[str, object] = {}
    for table in (*(t for t in CASE_TABLES if t not in FIXED), *effects):
        for key, param in declared_params(table).items():
            if rng.random() < (0.6 if table in effects else 0.12):
                value = random_value(rng, param)
                if value is not None:
                    given[f"{table}.{key}"] = value
    return given


def random_case(rng: random.Random) -> dict[str, object]:
    """Overrides of a small legal case: one to three effects, schedule, geometry and loads at random."""
    names = [name for name, effect in catalogue().items() if not effect.base]
    effects = rng.sample(names, rng.choice((0, 1, 2, 2, 3)))
    given = SMALL | random_keys(rng, effects) | {"effects": effects}
    given["contact.spot_exponent"] = rng.choice((0.0, 1.0, rng.random()))
    length = given.get("block.length", 0.025)
    given["schedule.distance"] = rng.choice((0.3, 1.0, 2.0)) * length
    given["schedule.repetitions"] = rng.choice((1, 1, 2))
    given["schedule.wait"] = rng.choice((0.0, 0.5, 20.0))
    given["schedule.turn"] = rng.choice((0, 0, 1))
    if given.get("schedule.alone") is not None:
        given["schedule.alone"] = rng.choice((0.1, 5.0))
    if "numerics.across" not in given and rng.random() < 0.1:
        given["numerics.across"] = 3
    if "persson_friction" in effects and rng.random() < 0.5:
        given["persson_friction.spots"] = "theory"
    return given


def coldness(case) -> tuple[object, float]:
    """The run of a case, and by how many K any temperature fell below everything that cools, more than is allowed."""
    worst = [-math.inf]

    def watch(system, t, T, **bounds):
        low, high = float(T.min()), float(T.max())
        if low < 0.0:
            below = system.coldest_rise(t) - low
            worst[0] = max(worst[0], below - COLD[0] - COLD[1] * max(high, 0.0))
        return checked(system, t, T, **bounds)

    checked = sanity_checks.check_temperatures
    with mock.patch.object(sanity_checks, "check", watch):
        run = integrate_schedule(case.scene, case.settings, case.title)
    return run, worst[0]


def outcome(folder: Path, given: dict[str, object]) -> tuple[str, str]:
    """How a case ends in a word, and what is wrong with that."""
    try:
        case = load_case(folder, given)
    except BadInput as fault:
        bad = [line for line in fault.lines if len(line) > 600 or "\n" in line]
        return "refused", f"not in one line: {bad[0][:80]}" if bad else ""
    except Exception as fault:
        return "traceback", "".join(traceback.format_exception(fault)[-2:])
    try:
        run, colder = coldness(case)
    except BadInput as fault:
        return "refused", f"while running: {fault}" if len(str(fault)) > 600 else ""
    except SolverFailure as fault:
        physical = any(reason in str(fault) for reason in PHYSICAL) and "nan" not in str(fault)
        return "failed", "" if physical else str(fault)
    except Exception as fault:
        return "traceback", f"{type(fault).__name__}: {fault} {traceback.extract_tb(fault.__traceback__)[-1]}"
    return "ran", judge(run, colder, case.scene.schedule.alone)


def judge(run, colder: float, alone: bool) -> str:
    """What is wrong with a result."""
    names = ("T_block", "T_spot", "T_road", "T_wake", "pressure", "worn", "field")
    broken = [name for name in names if not np.isfinite(getattr(run, name)).all()]
    if not alone and not np.isfinite(run.friction[run.sliding & (run.time > 0)]).all():
        broken.append("friction")
    if broken:
        return f"no number: {', '.join(broken)}"
    if colder > 0.0:
        return f"{colder:.3g} K colder than everything that cools"
    return ""


def random_cases(row, seed: int, share: float) -> None:
    """Random legal cases, each from its own seed."""
    folder = Path(__file__).parents[2] / "cases" / "uniform_pressure"
    for number in range(round(TRIES * share)):
        given = random_case(random.Random(f"{seed}-{number}"))
        ended, fault = outcome(folder, given)
        row.count(ended, fault and f"case {number}: {fault}\n    {given}")


CLASSES = {"random legal cases": random_cases}

if __name__ == "__main__":  # a few of them, by number: SEED NUMBER...
    row = SimpleNamespace(count=lambda ended, fault: print(ended, fault))
    for number in sys.argv[2:]:
        given = random_case(random.Random(f"{sys.argv[1]}-{number}"))
        print(number, given, *outcome(Path(__file__).parents[2] / "cases" / "uniform_pressure", given))
