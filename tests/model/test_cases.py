"""Every folder of cases/ loads, runs, conserves energy and does what its expected.toml claims.

The format of expected.toml is described in cases/README.md.  FLASHTEMP_FULL=1 runs the cases without
their `short` overrides.
"""

from __future__ import annotations

import itertools
import os
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

from flashtemp.model.case import assemble_case, load_case
from flashtemp.model.case_file import KeyLocations
from flashtemp.solver.time_integration import integrate_schedule

CASES = Path(__file__).parents[2] / "cases"
FOLDERS = sorted(file.parent for file in CASES.glob("*/case.toml"))
RUNS: dict[tuple[str, str], object] = {}

READING = {"quantity", "at", "slid", "repetition", "across", "with"}
CONDITIONS = {"between", "reference", "trend", "flat_within", "peak_between", "exponent_between"}
KEYS = READING | CONDITIONS | {"claim", "says", "over", "within", "sweep", "each", "minus", "per", "long"}

PROFILES = {
    "rise_block": lambda run: run.T_block - run.ambient_degC,
    "rise_spot": lambda run: run.T_spot - run.ambient_degC,
    "rise_road": lambda run: run.T_road - run.ambient_degC,
    "T_block": lambda run: run.T_block,
    "jump": lambda run: run.T_spot - run.T_road,
    "pressure": lambda run: run.pressure,
    "worn": lambda run: run.worn,
}


def expectations(folder):
    """The `short` overrides and the checks of a case."""
    file = folder / "expected.toml"
    table = tomllib.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    short = {} if os.environ.get("FLASHTEMP_FULL") else table.get("short", {})
    return short, table.get("check", [])


def misprints(check):
    """Keys of a check that are missing or mean nothing."""
    known = {"minus": READING, "per": READING}
    out = [f"unknown key {k}" for k in check.keys() - KEYS]
    out += [f"unknown key {other}.{k}" for other in known for k in check.get(other, {}).keys() - known[other]]
    out += [f"{k} is missing" for k in {"claim", "says", "quantity"} - check.keys()]
    if not check.keys() & CONDITIONS:
        out.append("no condition")
    return out


def all_checks():
    """All checks of all cases, as test parameters."""
    out = []
    for folder in FOLDERS:
        short, checks = expectations(folder)
        out += [
            pytest.param(
                folder,
                short,
                check,
                id=f"{folder.name}-{number}-{check.get('claim')}",
                marks=[pytest.mark.long] if check.get("long") else [],
            )
            for number, check in enumerate(checks, 1)
        ]
    return out


def run_of(folder, overrides):
    """The run of a case, computed once for every effective case."""
    case = load_case(folder, overrides)
    key = (folder.name, case.toml())
    if key not in RUNS:
        run = RUNS[key] = integrate_schedule(case.scene, case.settings, case.title)
        assert run.energy_imbalance < 1e-6, f"{folder.name} {overrides}: energy {run.energy_imbalance:.1e}"
    return RUNS[key]


# --- reading a number or a series from a run ------------------------------------------------------
def smooth(x, y, at):
    """y(at) by a monotone cubic along the first axis; held outside."""
    return PchipInterpolator(x, y)(np.clip(at, x[0], x[-1]))


def rows(run, repetition):
    """Records of sliding in one repetition (default: the last)."""
    repetition = run.repetition[run.last_sliding_index] if repetition is None else repetition
    return np.flatnonzero(run.sliding & (run.repetition == repetition))


def in_time(run, values, slid, repetition):
    """Values at a slid distance (m since the repetition began) or at the end of a repetition."""
    if np.ndim(repetition):
        return np.array([in_time(run, values, slid, r) for r in repetition])
    on = rows(run, repetition)
    if slid is None:
        return values[on[-1]]
    return smooth(run.slid[on] - run.slid[on[0]], values[on], slid)


def along(run, profile, at):
    """A profile (lines,) at x/L, its mean or its maximum."""
    if at == "mean":
        return profile @ run.mesh.dx_block / run.mesh.dx_block.sum()
    return profile.max() if at == "max" else smooth(places(run), profile, at)


def line(run, name, across):
    """A profile (lines,) at the end, at y/W from the centre line."""
    assert np.argmin(np.abs(run.frames - run.last_sliding_index)) == len(run.frames) - 1
    T = CubicSpline(run.mesh.y_centre, run.maps["T_block"][-1].astype(float), axis=1)(across * run.width)
    return {"rise_block": T - run.ambient_degC}[name]


def places(run):
    """x/L of the lines under the block."""
    return run.x / run.mesh.x[run.mesh.last]


def back(run):
    """Mean rise (K) of the cells at the holder, at the end."""
    mesh = run.mesh
    top = [mesh.start[line + 1] - 1 for line in range(mesh.first, mesh.last)]
    return run.field[-1][top] @ mesh.dx_block / mesh.dx_block.sum() - run.ambient_degC


def read(run, reading):
    """One reading: its axis (None for a single number) and its values."""
    name, at, slid, repetition = (reading.get(k) for k in ("quantity", "at", "slid", "repetition"))
    axis = next((v for v in (at, slid, repetition) if isinstance(v, list)), None)
    if "across" in reading:
        return axis, along(run, line(run, name, reading["across"]), at)
    if name in PROFILES:
        values = in_time(run, PROFILES[name](run), slid, repetition)
        if at is None:
            return places(run), values
        return axis, np.apply_along_axis(lambda profile: along(run, profile, at), -1, values)
    if name == "friction":
        return axis, in_time(run, run.friction, slid, repetition)
    if name == "friction_mean":
        wanted = len(run.friction_per_repetition) if repetition is None else repetition
        return axis, np.array(run.friction_per_repetition)[np.array(wanted) - 1]
    if name == "rise_back":
        return axis, back(run)
    raise ValueError(f"no quantity '{name}'; known: {', '.join([*PROFILES, 'friction', 'friction_mean', 'rise_back'])}")


def value(folder, check, overrides):
    """(reading - minus) / (per - minus) with its axis."""

    def one(changes):
        reading = check | changes | {"with": overrides | changes.get("with", {})}
        return read(run_of(folder, reading["with"]), reading)

    axis, values = one({})
    zero = one(check["minus"])[1] if "minus" in check else 0.0
    unit = one(check["per"])[1] - zero if "per" in check else 1.0
    return axis, (values - zero) / unit


def series(folder, check, overrides):
    """Axis and values of a check: along the block, in time, over repetitions or over a sweep."""
    overrides = overrides | check.get("with", {})
    if "sweep" in check:
        [(key, steps)] = check["sweep"].items()
        values = [value(folder, check, overrides | {key: step})[1] for step in steps]
        axis = steps
    else:
        axis, values = value(folder, check, overrides)
    values = np.atleast_1d(np.array(values, dtype=float))
    axis = np.arange(len(values)) if axis is None or any(isinstance(a, str) for a in axis) else np.array(axis)
    assert values.shape == axis.shape, f"one series at a time, not {values.shape}"
    if "over" in check:
        keep = (axis >= check["over"][0]) & (axis <= check["over"][1])
        axis, values = axis[keep], values[keep]
    return axis, values


# --- conditions -----------------------------------------------------------------------------------
def exponent(axis, values):
    """Slope of values against axis in a log-log plot."""
    return float(np.polyfit(np.log(axis), np.log(values), 1)[0])


def half_range(values):
    """Half the range over its middle: 0.15 means constant within 15 %."""
    return float(np.ptp(values) / abs(values.max() + values.min()))


def within(low_high, got):
    return bool(low_high[0] <= got <= low_high[1])


def faults(check, axis, values):
    """What a series does not fulfil, one line per condition."""
    got = {
        "between": lambda c: (all(within(c, v) for v in values), f"{values.min():.6g} .. {values.max():.6g}"),
        "reference": lambda c: (np.abs(values - c).max() <= check["within"], f"{np.abs(values - c).max():.4g} away"),
        "trend": lambda c: (np.all({"rising": 1, "falling": -1}[c] * np.diff(values) > 0), f"{values}"),
        "flat_within": lambda c: (half_range(values) <= c, f"{half_range(values):.4g}"),
        "peak_between": lambda c: (within(c, axis[values.argmax()]), f"{axis[values.argmax()]:.4g}"),
        "exponent_between": lambda c: (within(c, exponent(axis, values)), f"{exponent(axis, values):.5g}"),
    }
    out = [] if np.all(np.isfinite(values)) else ["not finite"]
    for name in sorted(CONDITIONS & check.keys()):
        good, measured = got[name](check[name])
        print(f"  {name} {check[name]}: {measured}")
        if not good:
            out.append(f"{name} {check[name]}: got {measured}")
    return out


# --- tests ----------------------------------------------------------------------------------------
@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f.name)
@pytest.mark.sample("[!m]*")  # its claims load mu_of_p without the skewness of its road, which takes longest
def test_case_is_valid_and_says_what_to_expect(folder):
    case = load_case(folder)
    again = assemble_case(tomllib.loads(case.toml()), {}, KeyLocations("effective case"), folder, folder.name)
    assert again.toml() == case.toml()
    short, checks = expectations(folder)
    assert load_case(folder, short)
    assert checks, "no expectations: add an expected.toml with at least one [[check]]"
    assert not [(check.get("says"), wrong) for check in checks if (wrong := misprints(check))]


@pytest.mark.parametrize(("folder", "short", "check"), all_checks())
def test_claim_holds(folder, short, check):
    each = check.get("each", {})
    for combination in itertools.product(*each.values()):
        chosen = dict(zip(each, combination, strict=True))
        axis, values = series(folder, check, short | chosen)
        print(f"{check['claim']}: {check['says']} {chosen or ''}")
        wrong = faults(check, axis, values)
        assert not wrong, f"{check['says']} {chosen or ''} {wrong}"


@pytest.mark.parametrize(
    ("condition", "good", "bad"),
    [
        ({"between": [1.0, 3.0]}, [1.0, 2.0, 3.0], [1.0, 2.0, 3.1]),
        ({"reference": [1.0, 2.0, 3.0], "within": 0.1}, [1.0, 2.0, 2.95], [1.0, 2.0, 3.2]),
        ({"trend": "rising"}, [1.0, 2.0, 3.0], [1.0, 2.0, 2.0]),
        ({"trend": "falling"}, [3.0, 2.0, 1.0], [1.0, 2.0, 3.0]),
        ({"flat_within": 0.15}, [1.0, 1.2, 1.1], [1.0, 1.4, 1.1]),
        ({"peak_between": [1.5, 2.5]}, [1.0, 3.0, 2.0], [1.0, 2.0, 3.0]),
        ({"exponent_between": [1.9, 2.1]}, [1.0, 4.0, 9.0], [1.0, 2.0, 3.0]),
    ],
    ids=lambda c: next(iter(c)) if isinstance(c, dict) else "",
)
def test_every_condition_can_fail(condition, good, bad):
    axis = np.array([1.0, 2.0, 3.0])
    assert not faults(condition, axis, np.array(good))
    assert faults(condition, axis, np.array(bad))
    assert faults(condition, axis, np.full(3, np.nan))
