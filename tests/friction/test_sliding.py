"""Sliding contact of viscoelastic rubber, resolved: closed forms, another program, skewed roads (claim C5)."""

from __future__ import annotations

import doctest
from dataclasses import replace

import numpy as np
import pytest
from friction import skewed_friction
from scipy.optimize import nnls

from flashtemp.physics.friction import sliding_contact
from flashtemp.physics.friction.persson import PerssonTheory
from flashtemp.physics.friction.rheology import READY_RUBBERS as RUBBERS
from flashtemp.physics.friction.rheology import PronySeries
from flashtemp.physics.friction.skewness import gaussian_heights
from flashtemp.physics.friction.sliding_contact import solve_sliding_contact

A, T = RUBBERS["A"], 293.15
LONG = 1e-3  # m, wavelength of the single wave


def modulus(omega):
    return A(omega, T) / (1 - A.poisson**2)


def wave(points, height):
    return height * np.cos(2 * np.pi * np.arange(points) / points)[:, None]


def elastic(E):
    return lambda omega: np.full(np.shape(omega), E)


def test_examples():
    tried = doctest.testmod(sliding_contact)
    assert tried.attempted > 0
    assert tried.failed == 0


@pytest.mark.parametrize("share", [0.1, 0.3, 0.7])
def test_an_elastic_wave_is_westergaards(share):
    """p0 = p* sin^2(pi b/l), p* = pi E* h/l; pressure 2 p0 cos(x) sqrt(sin^2 b - sin^2 x)/sin^2 b; no friction."""
    E, h, n = 1e6, 1e-5, 1024
    full = np.pi * E * h / LONG
    found = solve_sliding_contact(wave(n, h), (LONG, LONG), elastic(E), 1.0, share * full)
    half = np.arcsin(np.sqrt(share))
    assert found.area == pytest.approx(2 * half / np.pi, abs=2.5 / n)
    x = np.pi * (np.arange(n) / n - (np.arange(n) > n // 2))
    exact = 2 * share * full * np.cos(x) * np.sqrt(np.maximum(np.sin(half) ** 2 - np.sin(x) ** 2, 0)) / share
    np.testing.assert_allclose(found.pressure[:, 0], exact, atol=0.06 * full)
    assert np.abs(found.pressure[:, 0] - exact).mean() < 1e-3 * full
    assert abs(found.mu) < 1e-8


def test_elastic_discs_are_those_of_hertz():
    """A lattice of paraboloids far apart: contact radius (3 F R/(4 E*))^(1/3), greatest pressure 3F/(2 pi a^2)."""
    n, side, R, E = 256, 1.0, 2.0, 1e6
    x = side * (np.arange(n) / n - 0.5)
    heights = -(x[:, None] ** 2 + x**2) / (2 * R)
    force = 4 / 3 * E * 0.08**3 / R
    found = solve_sliding_contact(heights, (side, side), elastic(E), 1.0, force / side**2)
    assert np.sqrt(found.area * side**2 / np.pi) == pytest.approx(0.08, rel=0.02)
    assert found.pressure.max() == pytest.approx(3 * force / (2 * np.pi * 0.08**2), rel=0.02)


@pytest.mark.parametrize("speed", [1e-3, 0.1, 10.0])
def test_full_contact_is_linear(speed):
    """u = h: mu p0 = (q h)^2 Im E*(q v)/4, exactly."""
    q, h, p = 2 * np.pi / LONG, 2e-6, 5e7
    found = solve_sliding_contact(wave(64, h), (LONG, LONG), modulus, speed, p)
    assert found.area == 1.0
    assert found.mu == pytest.approx((q * h) ** 2 * modulus(q * speed).imag / (4 * p), rel=1e-6)
    assert found.friction_by_loss == pytest.approx(found.mu, rel=1e-6)


@pytest.mark.parametrize("p", [1e4, 1e5, 3e5])
def test_friction_is_the_energy_lost(p):
    """Work of the pressure on the road's slope against the loss of every wave; their difference falls with the grid."""
    apart = []
    for n in (128, 512, 2048):
        found = solve_sliding_contact(wave(n, 2e-5), (LONG, LONG), modulus, 1.0, p)
        assert found.mu > 0
        assert found.pressure.mean() == pytest.approx(p, rel=1e-9)
        assert found.pressure.min() >= 0
        assert found.gap.min() >= 0
        assert np.all(found.gap[found.pressure > 0] == 0)
        apart.append(abs(found.friction_by_loss / found.mu - 1))
    print(apart)
    assert apart[-1] < 2e-3
    assert apart[-1] < apart[0]


class Marching:
    """The same contact in time: one Maxwell arm beside a spring, marched in the rubber's frame with dense matrices.

    No complex modulus, no steady state assumed, and non-negative least squares for the contact.
    """

    def __init__(self, E0, E1, tau, points=32):
        self.E0, self.E1, self.tau, self.n = E0, E1, tau, points
        k = np.fft.fftfreq(points, 1 / points)
        q = 2 * np.pi * np.abs(k) / LONG
        wave = np.exp(2j * np.pi * np.outer(np.arange(points), k) / points) / np.sqrt(points)
        q[0] = 1.0
        self.stiff = 0.5 * q
        self.wave = wave
        self.free = np.where(np.arange(points) == 0, 0.0, 1.0)

    def friction(self, height, speed, p0, periods=4, steps=256):
        """Mean over the last period of <p dh/dx>/p0."""
        dt, n = LONG / speed / steps, self.n
        r = dt / (2 * self.tau)
        now = self.E0 + self.E1 / (1 + r)
        soft = (self.wave * (self.free / (self.stiff * now))) @ self.wave.conj().T
        soft = soft.real + 1e-3 * soft.real.max()  # a stiff spring for the mean: g0 is free, the load is not
        root = np.linalg.cholesky(soft + 1e-12 * soft.max() * np.eye(n)).T
        heavy = 1e4 * root.max()
        x, u, s, out = LONG * np.arange(n) / n, np.zeros(n), np.zeros(n), []
        for step in range(periods * steps):
            at = 2 * np.pi * (x + speed * dt * step) / LONG
            h, slope = height * np.cos(at), -2 * np.pi / LONG * height * np.sin(at)
            kept = (s * (1 - r) - self.E1 * u) / (1 + r)  # E u + s of the last step that this one inherits
            shift = -kept / now
            want = np.linalg.solve(root.T, h - shift)
            p, _ = nnls(np.vstack([root, heavy * np.ones(n)]), np.append(want, heavy * n * p0))
            new = self.strain(p, now) + shift
            s, u = kept + self.E1 / (1 + r) * new, new
            if step >= (periods - 1) * steps:
                out.append(p @ slope / n / p0)
        return float(np.mean(out))

    def strain(self, p, now):
        """Displacement by a pressure at the modulus of one step, mean zero."""
        return ((self.wave * (self.free / (self.stiff * now))) @ (self.wave.conj().T @ p)).real


@pytest.mark.parametrize("p", [4e4, 2e5])
def test_another_program_marches_to_the_same_friction(p):
    """A standard linear solid, its loss peak where the wave is passed: time stepping against the steady solve."""
    E0, E1, speed, h = 1e7, 5e7, 0.5, 2e-5
    tau = LONG / (2 * np.pi * speed)
    exact = PronySeries(E0, (E1,), (tau,))
    found = solve_sliding_contact(wave(256, h), (LONG, LONG), exact, speed, p)
    marched = Marching(E0, E1, tau).friction(h, speed, p)
    print(found.mu, found.area, marched)
    assert marched == pytest.approx(found.mu, rel=0.03)
    assert found.area < 0.5


def test_turning_the_way_round_turns_friction_round():
    """Sliding over the mirrored road is sliding back over the road: the same friction, and none without loss."""
    heights, side = gaussian_heights(skewed_friction.READY_ROADS["asphalt A"], 32, 3)
    there, back = (solve_sliding_contact(h, (side, side), modulus, 1.0, 1e5) for h in (heights, heights[::-1]))
    assert there.mu != pytest.approx(back.mu, rel=1e-6)
    assert abs(solve_sliding_contact(heights, (side, side), elastic(1e7), 1.0, 1e5).friction_by_loss) < 1e-9


@pytest.fixture(scope="module")
def worn():
    """f = 0.6 (skewness -0.58) at 1 m/s, 1 to 30 % in contact, two seeds."""
    return skewed_friction.compare_roads(0.6, A, 1.0, T, [1e5, 1e6], grid=64, seeds=(0, 1))


def test_flattened_tops_lower_friction_as_they_are_lowered(worn):
    """C5: mu_visc of the worn road is f times that of the plain one, within 8 % on this grid (4 % on finer ones).

    The argument of skewness.py, mu ~ 1/R, holds where only tops touch and not beyond.
    """
    ratio = worn.mean_ratio("mu", "worn", "plain")
    print(ratio, worn.mean_ratio("area", "worn", "plain"), worn.friction_area_product)
    np.testing.assert_allclose(ratio, 0.6, rtol=0.08)
    assert worn.friction_area_product[0] == pytest.approx(1.0, abs=0.08)
    assert worn.friction_area_product[1] < 0.93


def test_the_twin_with_the_same_spectrum_rubs_more(worn):
    """Turned over, the same road has tops as the plain one: more friction, less area, though C(q) is the same."""
    assert np.all(worn.mean_ratio("mu", "worn", "turned") < 0.75)
    assert np.all(worn.mean_ratio("area", "worn", "turned") > 1.15)
    np.testing.assert_allclose(worn.mean_ratio("mu", "turned", "plain"), 1.0, atol=0.1)


def test_tops_of_long_waves_are_flattened_alone():
    """Two waves of one period and an eighth: the long one's tops are lowered, the short one stays."""
    n, side = 64, 1.0
    x = np.arange(n) / n
    long, short = np.cos(2 * np.pi * x)[:, None] + np.zeros(n), 0.5 * np.cos(16 * np.pi * x)[:, None] + np.zeros(n)
    found = skewed_friction.flatten_tops(long + short, side, 0.6, 0.3)
    np.testing.assert_allclose(found, np.where(long > 0, 0.6, 1.0) * long + short, atol=1e-12)
    both = long + short
    np.testing.assert_array_equal(
        skewed_friction.flatten_tops(both, side, 0.6, 0.0), np.where(both > 0, 0.6, 1.0) * both
    )


@pytest.mark.long
def test_wear_of_long_waves_costs_at_most_their_share_of_friction():
    """f = 0.6 on waves above 8 mm of a road down to 3.1 mm, 1 m/s: friction falls by (1 - f) of what those waves
    carry at most, for the shorter ones keep theirs; worn on all waves it falls by about 1 - f."""
    road, shortest, cutoff, p = skewed_friction.READY_ROADS["asphalt A"], 2 * 2 * np.pi / 250.0 * 4 / 64, 8e-3, 3e5
    assert road.q0 == 250.0
    carried = PerssonTheory(A, replace(road, q1=2 * np.pi / shortest))(1.0, T, p)
    long = carried.q < 2 * np.pi / cutoff
    share = float((carried.density * carried.weight)[long].sum() / carried.viscous)
    some, every = (
        skewed_friction.compare_roads(0.6, A, 1.0, T, [p], grid=64, seeds=(0, 1, 2), cutoff=c).mean_ratio(
            "mu", "worn", "plain"
        )
        for c in (cutoff, 0.0)
    )
    print(some, every, share)
    assert 0.0 < 1.0 - some[0] < 0.4 * share < 0.3
    assert every[0] < 0.7


def test_a_plain_road_is_not_worn():
    found = skewed_friction.compare_roads(1.0, A, 0.1, T, 3e5, grid=32, seeds=(0,))
    assert found.mean_ratio("mu", "worn", "plain") == 1.0
    assert found.friction_area_product == 1.0
