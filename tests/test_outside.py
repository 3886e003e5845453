"""The solver held to a program that shares neither mesh nor closure nor integrator with it.

Here the block is a sum of cosines of x and z, each integrated exactly over a step.  The road has no mesh at all: every
stretch of it remembers what it received since it came under the block, and what a lane keeps of that after a time tau
is eq. (15b) in its own words, Bessel functions.  Rises are in K, everything else is SI.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import lu_factor, lu_solve
from scipy.special import i0e, i1e

from flashtemp import load
from flashtemp.solver.march import march

L, P = 0.025, 1.5e5
BARE = {  # what the other program leaves out, and a mesh whose own error stays small
    "ambient.convection": 0.0, "contact.flash_factor": 0.0, "friction.volumetric_share": 0.0, "friction.mu": 1.0,
    "numerics.mesh": 1.4, "output.fields": 2,
}  # fmt: skip


@dataclass(frozen=True)
class Block:
    """A block of length and height on a road, in perfect contact; no air, no holder, no flash."""

    length: float = 0.025
    height: float = 0.007
    k: float = 0.25
    rc: float = 1200.0 * 1700.0
    road_k: float = 1.0
    road_rc: float = 2300.0 * 950.0
    diameter: float = 3e-3
    columns: int = 100
    modes: int = 300

    @property
    def x(self):
        return (np.arange(self.columns) + 0.5) * self.length / self.columns

    def kept(self, tau, floor):
        """What a lane keeps of its heat after tau, never less than its share of the road."""
        X = (self.diameter / 2) ** 2 / (2 * self.road_k / self.road_rc * tau)
        return np.maximum(1.0 - i0e(X) - i1e(X), floor)

    def memory(self, young, old, floor, widening):
        """What a flux that is linear between these ages does to the surface: shares of its young and its old end."""
        nodes, weights = np.polynomial.legendre.leggauss(8)
        a, b = np.sqrt(young)[:, None], np.sqrt(old)[:, None]
        root = 0.5 * (a + b) + 0.5 * (b - a) * nodes
        part = (b - a) * weights / np.sqrt(np.pi * self.road_k * self.road_rc)
        if widening:
            part = part * self.kept(root * root, floor)
        late = (root * root - a * a) / (b * b - a * a)
        return (part * (1.0 - late)).sum(axis=1), (part * late).sum(axis=1)

    def slide(self, speeds, pressure, mu=1.0, fraction=0.2, widening=True):
        """Slide as `speeds` [(m/s, m), ...] say under `pressure` (columns,) Pa; at the end face and heat into the road.

        Rises (columns,) in K and W/m2 of spot area.  The road passes one column a step.  Where the contact `fraction`
        (columns,) varies, the lanes in contact at one place were in contact at another on the lesser of both fractions.
        """
        n, dx = self.columns, self.length / self.columns
        fraction = np.broadcast_to(fraction, n)
        floor, common = fraction.mean(), np.minimum(fraction[:, None], fraction) / fraction[:, None]
        m, z = np.arange(n), np.arange(self.modes)
        cosines = np.cos(np.pi * np.outer(self.x, m) / self.length)
        forward = np.where(m > 0, 2.0, 1.0)[:, None] * cosines.T / n
        along = (np.pi * m / self.length)[:, None] ** 2
        decay = self.k / self.rc * (along + (np.pi * z / self.height) ** 2)
        far = np.arange(self.modes, 40 * self.modes)  # these modes follow the flux at once
        at_once = 2.0 / (self.k * self.height) * (1.0 / (along + (np.pi * far / self.height) ** 2)).sum(axis=1)
        at_once += 2.0 * self.height / (self.k * np.pi**2 * far[-1])
        a, stretches, fluxes = np.zeros((n, self.modes)), [], [np.zeros(n)]
        for v, distance in speeds:
            dt = dx / v
            held = np.exp(-decay * dt)
            moved = np.where(decay > 0, (1.0 - held) / np.where(decay > 0, decay, 1.0), dt)
            moved *= np.where(z > 0, 2.0, 1.0) / (self.rc * self.height)
            response = cosines @ ((moved.sum(axis=1) + at_once)[:, None] * forward * fraction)
            q = mu * pressure * v / fraction
            for step in range(round(distance / dx)):
                stretches = [dt, *stretches[: n - 1]]
                if step <= n:  # lags settle once the speed has lasted for a length of the block
                    ages = np.concatenate([[0.0], np.cumsum(stretches)])
                    w0, w1 = self.memory(ages[:-1], ages[1:], floor, widening)
                    enter = 0.5 * np.array([*stretches, stretches[-1]])
                    first = sum(self.memory(ages, ages + enter, floor, widening))
                    own = np.full(n, w0[0])
                    own[0] = first[0]
                    lu = lu_factor(response + np.diag(own))
                past = np.zeros(n)
                for j in range(1, min(len(fluxes), n - 1) + 1):
                    flux = fluxes[-j][: n - j] * common.diagonal(-j)
                    past[j:] += w1[j - 1] * flux
                    past[j] += first[j] * flux[0]
                    if j < len(w0):
                        past[j + 1 :] += w0[j] * flux[1:]
                a *= held
                face = cosines @ a.sum(axis=1)
                J = lu_solve(lu, own * q + past - face)  # face + response J = past + own (q - J)
                a += moved * (forward @ (fraction * J))[:, None]
                fluxes = [*fluxes[-n:], q - J]
        return face + response @ J, q - J


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
    run = march(made.scene, made.settings)
    other = other or Block()
    rise, _ = other.slide(speeds, P * shape(other.x), fraction=0.2 * shape(other.x) ** exponent)
    error = np.interp(other.x, run.x, run.T_block[run.last] - 20.0) - rise
    worst = np.abs(error[other.x > 1e-3]).max() / rise.max()
    print(f"largest difference {100 * worst:.3f} % of {rise.max():.2f} K")
    assert worst < bound


@pytest.mark.parametrize(
    ("given", "shape"),
    [
        pytest.param({}, np.ones_like, id="even"),
        pytest.param(*tilted(0.6), id="leading edge pressed"),
        pytest.param(*tilted(-0.6), id="trailing edge pressed"),
        pytest.param(*peaked(6.0, 0.004), id="peak of run_in"),
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
    check_face(tmp_path, given, shape, [(0.1, 0.5)], 7e-3, exponent=exponent)


@pytest.mark.parametrize("speeds", [[(0.1, 0.3), (0.5, 0.01)], [(0.5, 0.5), (0.1, 0.006)]], ids=["faster", "slower"])
@pytest.mark.sample("faster")
def test_lanes_widen_after_a_step_of_the_speed(tmp_path, speeds):
    """Road that lies half under the old speed and half under the new one."""
    check_face(tmp_path, *tilted(-0.6), speeds, 2.5e-3, Block(columns=200))


@pytest.mark.parametrize("speed", [1.0, 30.0, 300.0])
@pytest.mark.sample("30.0")
def test_the_default_mesh_follows_the_speed(tmp_path, speed):
    """The layers that are heated grow thinner with speed; the mesh that nobody asked for still resolves them."""
    given = {"numerics.mesh": 1.0, "limits.temperature": 2000.0}
    check_face(tmp_path, given, np.ones_like, [(speed, 0.5)], 5e-3, Block(modes=2000))
