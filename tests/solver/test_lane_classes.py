"""Lanes of different age and load under the same place, held to classes of lanes that each keep their own history.

They are those of tests/reference/lane_classes.py.  Errors are shares of the largest rise, from 1 mm on.
"""

from __future__ import annotations

import numpy as np
import pytest
from reference.lane_classes import SlidingPair, simulate_sliding

from flashtemp import load
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.system import PhaseSystem
from flashtemp.solver.time_integration import integrate_schedule

L, P = 0.025, 1.5e5
BARE = {  # what the classes leave out, and a mesh whose own error stays small
    "ambient.convection": 0.0, "friction.volumetric_share": 0.0, "friction.mu": 1.0, "numerics.mesh": 1.4,
    "output.fields": 2, "schedule.speed": 0.1, "schedule.distance": 0.25,
}  # fmt: skip


def peaked(B, length=4e-3):
    mean = length / L * (1 - np.exp(-L / length))
    given = {"effects": ["edge_pressure"], "edge_pressure.B": B, "edge_pressure.length": length}
    return given, lambda x: 1 + B * (np.exp(-x / length) - mean)


def tilted(a):
    return {"effects": ["pressure_tilt"], "pressure_tilt.a": a}, lambda x: 1 + a * (1 - 2 * x / L)


def made(folder, given):
    (folder / "case.toml").write_text("")
    return load(folder / "case.toml", BARE | given)


@pytest.mark.parametrize(
    ("given", "shape", "exponent", "other", "bound"),
    [
        pytest.param({}, np.ones_like, 0.0, {}, (0.002, 0.002), id="even"),
        pytest.param(*tilted(-0.7), 1.0, {}, (0.004, 0.004), id="lanes begin"),
        pytest.param(*peaked(4.0), 0.5, {}, (0.004, 0.004), id="B = 4, n = 0.5"),
        pytest.param(*peaked(4.0), 1.0, {}, (0.006, 0.005), id="B = 4, n = 1"),
        pytest.param(*peaked(6.0), 0.5, {}, (0.004, 0.004), id="B = 6, n = 0.5"),
        pytest.param(*peaked(6.0), 1.0, {}, (0.007, 0.007), id="B = 6, n = 1"),
        pytest.param(*peaked(6.0), 1.0, {"schedule.speed": 1.0}, (0.012, 0.012), id="B = 6 at 1 m/s"),
        pytest.param(*peaked(6.0), 1.0, {"schedule.distance": 0.04}, (0.008, 0.012), id="B = 6 after 40 mm"),
        pytest.param(*peaked(6.0), 1.0, {"contact.flash_factor": 0.0}, (0.009, 0.009), id="B = 6 without flash"),
    ],
)
@pytest.mark.sample("even", "B = 6, n = 1")
def test_lanes_in_contact_are_as_warm_as_their_classes(tmp_path, given, shape, exponent, other, bound):
    """Block's face, and rubber in the spots."""
    given = BARE | given | {"contact.spot_exponent": exponent} | other
    case = made(tmp_path, given)
    run = integrate_schedule(case.scene, case.settings)
    s = SlidingPair()
    fraction = np.minimum(0.2 * shape(s.x) ** exponent, 1.0)
    flash = "contact.flash_factor" not in other
    found = simulate_sliding(
        s, given["schedule.speed"], given["schedule.distance"], P * shape(s.x), fraction, flash=flash
    )
    for name, rise, most in zip(("T_block", "T_spot"), found, bound, strict=True):
        error = np.abs(np.interp(s.x, run.x, getattr(run, name)[run.last_sliding_index] - 20.0) - rise)
        worst = error[s.x > 1e-3].max() / rise.max()
        print(f"{name}: largest difference {100 * worst:.3f} % of {rise.max():.2f} K")
        assert worst < most


def test_slopes_know_how_lanes_follow_what_the_block_leaves_them(tmp_path, monkeypatch):
    """Products of the linearised system are differences of the rate, also where the heat of lanes upstream changes."""
    given, _ = peaked(6.0)
    case = made(tmp_path, given | {"contact.spot_exponent": 1.0, "numerics.mesh": 0.5, "schedule.distance": 0.04})
    seen, rate = {}, PhaseSystem.rate

    def watched(system, t, y, out):
        seen.update(system=system, t=t, y=y.copy())
        rate(system, t, y, out)

    monkeypatch.setattr(PhaseSystem, "rate", watched)
    integrate_schedule(case.scene, case.settings)
    system, t, y = seen["system"], seen["t"], seen["y"]
    b: HeatBalance = system.b
    v = np.zeros(b.size)
    v[: b.n] = np.random.default_rng(3).standard_normal(b.n)
    ends = np.empty((2, b.size))
    for out, step in zip(ends, (1e-5, -1e-5), strict=True):
        rate(system, t, y + step * v, out)
    product = np.empty(b.size)
    system.linearise(t, y, 1e-3).apply_jacobian(v, product)
    slope = (ends[0] - ends[1]) / 2e-5
    for cells in (b.cell_road, b.cell_block, b.ledger_index["into_road"]):
        np.testing.assert_allclose(product[cells], slope[cells], atol=1e-7 * np.abs(slope[cells]).max())
