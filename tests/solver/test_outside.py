"""The solver held to a program that shares neither mesh nor closure nor integrator with it.

It is tests/reference/sliding.py: modes in the block, memory in the road.  Rises are in K, everything else is SI.
"""

from __future__ import annotations

import numpy as np
import pytest
from reference.sliding import SlidingPair, simulate_sliding

from flashtemp import load
from flashtemp.solver.time_integration import integrate_schedule

L, P = 0.025, 1.5e5
BARE = {  # what the other program leaves out, and a mesh whose own error stays small
    "ambient.convection": 0.0, "contact.flash_factor": 0.0, "friction.volumetric_share": 0.0, "friction.mu": 1.0,
    "numerics.mesh": 1.4, "output.fields": 2,
}  # fmt: skip


def tilted(a):
    return {"effects": ["pressure_tilt"], "pressure_tilt.a": a}, lambda x: 1 + a * (1 - 2 * x / L)


def peaked(B, length):
    mean = length / L * (1 - np.exp(-L / length))
    given = {"effects": ["edge_pressure"], "edge_pressure.B": B, "edge_pressure.length": length}
    return given, lambda x: 1 + B * (np.exp(-x / length) - mean)


def check_face(tmp_path, given, shape, speeds, bound, other=None, exponent=0.0):
    """The face of the block at the end of `speeds` [(m/s, m), ...], relative to its largest rise, from 1 mm on."""
    (tmp_path / "case.toml").write_text("")
    t, rows = 0.0, []
    for v, s in speeds:
        rows += [(t, v), (t + s / v, v)]
        t += s / v + 1e-6
    np.savetxt(tmp_path / "speed.csv", rows, delimiter=",", fmt="%.9g")
    speed, distance = speeds[0][0] if len(speeds) == 1 else "speed.csv", sum(s for _, s in speeds)
    given = given | {"schedule.speed": speed, "schedule.distance": distance, "contact.spot_exponent": exponent}
    made = load(tmp_path / "case.toml", BARE | given)
    run = integrate_schedule(made.scene, made.settings)
    other = other or SlidingPair()
    rise, _ = simulate_sliding(other, speeds, P * shape(other.x), fraction=0.2 * shape(other.x) ** exponent)
    error = np.interp(other.x, run.x, run.T_block[run.last_sliding_index] - 20.0) - rise
    worst = np.abs(error[other.x > 1e-3]).max() / rise.max()
    print(f"largest difference {100 * worst:.3f} % of {rise.max():.2f} K")
    assert worst < bound


@pytest.mark.parametrize(
    ("given", "shape"),
    [
        pytest.param({}, np.ones_like, id="even"),
        pytest.param(*tilted(0.6), id="leading edge pressed"),
        pytest.param(*tilted(-0.6), id="trailing edge pressed"),
        pytest.param(*peaked(6.0, 0.004), id="peak of chosen_peak"),
        pytest.param(*peaked(2.5, 0.0025), id="sharp peak"),
    ],
)
@pytest.mark.sample("leading edge pressed")
def test_lanes_widen_by_the_heat_that_they_received(tmp_path, given, shape):
    check_face(tmp_path, given, shape, [(0.1, 0.5)], 2.5e-3)


@pytest.mark.parametrize("exponent", [0.5, 1.0])
@pytest.mark.parametrize(
    ("given", "shape"),
    [
        pytest.param(*tilted(0.5), id="lanes end"),
        pytest.param(*tilted(-0.5), id="lanes begin"),
        pytest.param(*peaked(2.5, 0.0025), id="peak"),
    ],
)
@pytest.mark.sample("lanes begin-1.0", "peak-0.5")
def test_lanes_begin_and_end_where_the_contact_fraction_varies(tmp_path, given, shape, exponent):
    check_face(tmp_path, given, shape, [(0.1, 0.5)], 2.5e-3, exponent=exponent)


@pytest.mark.parametrize("speeds", [[(0.1, 0.3), (0.5, 0.01)], [(0.5, 0.5), (0.1, 0.006)]], ids=["faster", "slower"])
@pytest.mark.sample("faster")
def test_lanes_widen_after_a_step_of_the_speed(tmp_path, speeds):
    """Road that lies half under the old speed and half under the new one."""
    check_face(tmp_path, *tilted(-0.6), speeds, 2.5e-3, SlidingPair(columns=200))


@pytest.mark.parametrize("speed", [1.0, 30.0, 300.0])
@pytest.mark.sample("30.0")
def test_the_default_mesh_follows_the_speed(tmp_path, speed):
    """The layers that are heated grow thinner with speed; the mesh that nobody asked for still resolves them."""
    given = {"numerics.mesh": 1.0, "limits.temperature": 2000.0}
    check_face(tmp_path, given, np.ones_like, [(speed, 0.5)], 5e-3, SlidingPair(degree=200))
