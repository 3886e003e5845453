"""Pairs of effects: every one runs or is refused in one line, conserves heat, and nothing gets too cold."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from flashtemp.errors import BadInput
from flashtemp.model.case import load_case
from flashtemp.physics.effect import catalogue
from flashtemp.solver.time_integration import integrate_schedule

ROOT = Path(__file__).parents[2]
UNIFORM = ROOT / "cases" / "uniform_pressure"
SMALL = {
    "numerics.cells": [12, 7, 9], "block.height": 0.003, "schedule.distance": 0.02, "schedule.wait": 0.5,
    "schedule.repetitions": 2, "output.profiles": 6, "output.fields": 3, "contact.gap_coefficient": 20.0,
}  # fmt: skip
STRONG = {  # values at which the block lifts off in part, or a law is far from linear
    "edge_pressure": {"B": 6.8, "length": 0.008},
    "pressure_tilt": {"a": 0.9},
    "pressure_roll": {"a": -0.8},
    "pressure_crown": {"c": 0.9},
    "friction_moment": {"arm": 0.01},
    "persson_friction": {"spots": "theory", "in_depth": False},
    "thermal_expansion": {"coefficient": 5e-4},
    "wear": {"rate": 1e-9, "temperature": 0.05},
    "capacity_slope": {"block": 0.004, "road": -0.002},
    "conductivity_slope": {"block": -0.003, "road": 0.004},
    "friction_softening": {"b": 0.02},
    "ambient_drift": {"rate": 0.5},
}
COLD_K = 0.02  # twenty times the integrator's absolute tolerance, for what its steps add up to
WAYS = {  # exponent of the contact fraction, block lifted while it waits, cells across
    "n=0": (0.0, False, 1), "n=1": (1.0, True, 1), "n=1 in 3D": (1.0, False, 3),
}  # fmt: skip
NAMES = sorted(name for name, effect in catalogue().items() if not effect.base)
SAMPLE = [  # of every kind: pressure with friction, heat, contact, wear; 0/0 where theory and block lift off together
    ("persson_friction", "sheared_block"), ("sheared_block", "thermal_expansion"), ("edge_pressure", "friction_moment"),
    ("edge_pressure", "track_memory"), ("internal_heat", "pressure_roll"), ("air_gap", "wear"),
]  # fmt: skip


def values(effects, way: str) -> dict:
    exponent, lifted, across = WAYS[way]
    given = SMALL | {"effects": list(effects), "contact.spot_exponent": exponent, "schedule.lifted": lifted}
    given["numerics.across"] = across
    return given | {f"{name}.{key}": v for name in effects for key, v in STRONG.get(name, {}).items()}


def hold_to_physics(given: dict) -> str:
    """Run a case and assert what every result must be; 'refused' where the case is bad input in one line."""
    try:
        case = load_case(UNIFORM, given)
        run = integrate_schedule(case.scene, case.settings, case.title)
    except BadInput as fault:
        return "refused" if all("\n" not in line and len(line) < 600 for line in fault.lines) else f"{fault.lines}"
    for name in ("T_block", "T_spot", "T_road", "T_wake", "pressure", "worn", "field"):
        assert np.isfinite(getattr(run, name)).all(), name
    assert np.isfinite(run.friction[run.sliding & (run.time > 0.0)]).all()
    assert run.energy_imbalance < 1e-9
    if not cooled(given["effects"]):
        low = min(float(np.min(getattr(run, name))) for name in ("T_block", "T_spot", "T_road", "T_wake", "field"))
        assert low > run.ambient_degC - COLD_K, f"{low:.3f} degC"
    return "ran"


def cooled(effects) -> bool:
    """Whether an effect brings something colder than the start: then colder is no fault."""
    return bool({"ambient_drift", "holder_sink", "evaporation", "driven_faces", "heated_face"} & set(effects))


@pytest.mark.parametrize("effects", SAMPLE, ids="-".join)
def test_a_pair_of_effects_runs_conserves_heat_and_cools_nothing_below_everything_around(effects):
    assert hold_to_physics(values(effects, "n=1")) == "ran"


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("first", NAMES)
def test_all_pairs_of_effects(first, way):
    faults = []
    for pair in combinations(NAMES, 2):
        if pair[0] == first:
            try:
                ended = hold_to_physics(values(pair, way))
                faults += [] if ended in ("ran", "refused") else [(pair, ended)]
            except Exception as fault:  # all of them are wanted at once
                faults.append((pair, repr(fault)[:300]))
    assert not faults


LIFTS_OFF = {
    "contact.spot_exponent": 1.0, "contact.pressure": 361501.0, "schedule.speed": 0.093453, "schedule.distance": 0.2,
    "effects": ["edge_pressure"], "edge_pressure.B": 6.82103, "edge_pressure.length": 0.00808,
}  # fmt: skip


def test_where_the_block_lifts_off_no_lane_is_colder_than_everything_around():
    """An error of the road's columns is not multiplied by the share of the width that was last in contact."""
    assert hold_to_physics(LIFTS_OFF | {"output.profiles": 20}) == "ran"
