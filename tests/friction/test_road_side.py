"""Memory kernels with a road that takes heat and adhesive friction that releases it (theory 1.6, V6, V7, V23)."""

from __future__ import annotations

import doctest

import numpy as np
import pytest
from scipy.special import erfcx

from flashtemp.physics.friction import flash_temperature, road_side
from flashtemp.physics.friction.adhesive_shear import AdhesiveShear
from flashtemp.physics.friction.flash_temperature import (
    ContactSpots,
    SlidingHistory,
    compute_heating_path,
    solve_hot_branch,
)
from flashtemp.physics.friction.persson import PerssonTheory
from flashtemp.physics.friction.rheology import READY_RUBBERS as RUBBERS
from flashtemp.physics.friction.road_side import RoadSide
from flashtemp.physics.friction.roughness_spectrum import READY_ROADS as ROADS
from flashtemp.physics.material import LIBRARY, Material

RUBBER, STONE = LIBRARY["tread_rubber"], LIBRARY["asphalt"]
THEORY = PerssonTheory(RUBBERS["A"], ROADS["asphalt A"])
STICKY = PerssonTheory(RUBBERS["A"], ROADS["asphalt A"], shear=AdhesiveShear(4e6))
T0, P = 293.15, 3e5


@pytest.mark.parametrize("module", [road_side, flash_temperature], ids=lambda m: m.__name__)
def test_examples(module):
    tried = doctest.testmod(module)
    assert tried.attempted > 0
    assert tried.failed == 0


@pytest.mark.parametrize(
    ("diameter", "factors"),
    [(1e-3, [0.643900, 0.831310, 0.880001]), (3e-3, [0.873593, 0.943175, 0.959793]), (1e-2, [0.961854, 0.982933, 0.987931])],
)  # fmt: skip
def test_edges_of_a_disc_lose_heat(diameter, factors):
    """V23: over a half-space that is heated everywhere, after 25 mm at 0.1, 0.5 and 1 m/s."""
    t = 0.025 / np.array([0.1, 0.5, 1.0])
    np.testing.assert_allclose(
        RoadSide(STONE).mean_rise(t, diameter) / (2 * np.sqrt(t / np.pi) / STONE.effusivity), factors, atol=2e-6
    )


def test_a_disc_heated_for_ever_is_as_warm_as_it_gets():
    """Steady mean of a disc on a half-space under an even flux: 8 a/(3 pi k)."""
    steady = 8 * 1.5e-3 / (3 * np.pi * STONE.conductivity)
    assert float(RoadSide(STONE).mean_rise(1e8, 3e-3)) == pytest.approx(steady, rel=2e-4)
    assert float(RoadSide(STONE).mean_rise(0.0, 3e-3)) == 0.0


class Steady:
    """A spot so wide that nothing leaves it, with even heats: the two half-spaces of V6 and V7."""

    def __init__(self, heat, released, alpha=np.inf, steps=200, t=0.01):
        self.slide = SlidingHistory(THEORY, RUBBER, ContactSpots(1e3, 1.0, RoadSide(STONE, alpha)), T0, P, steps)
        at = t * (np.arange(steps + 1) / steps) ** 2
        self.slide.time[:], self.slide.slid[:] = at, 0.0
        for n in range(1, steps + 1):
            self.slide.heat[n - 1] = heat
            self.slide.spread_heat[n - 1] = self.slide.heat_memory.spread_heat(heat)
            self.T, self.surface = flash_temperature._MemoryWeights(self.slide, n)(released)
        self.taken = self.slide.road_flux[-1]


def at_depth(m):
    """5e4 W/m2 of the wavenumber of the theory nearest to m/2, and its decay rate 2q."""
    i = int(np.argmin(np.abs(np.log(2 * THEORY.q / m))))
    heat = np.zeros(len(THEORY.q))
    heat[i] = 5e4
    return heat, 2 * THEORY.q[i]


@pytest.mark.parametrize("alpha", [np.inf, 1e4])
def test_heat_of_the_contact_parts_like_that_of_two_half_spaces(alpha):
    """V6: the share of the road is e_S/(e_R + e_S) at once without resistance, later with it."""
    q, t = 1e5, 0.01
    found = Steady(np.zeros(len(THEORY.q)), q, alpha, t=t)
    eR, eS = RUBBER.effusivity, STONE.effusivity
    if np.isinf(alpha):
        share, T = eS / (eR + eS), 2 * q * np.sqrt(t / np.pi) / (eR + eS)
    else:
        eta = alpha * (1 / eR + 1 / eS)
        y = eta * np.sqrt(t)
        share = eS / (eR + eS) * (1 - erfcx(y))
        T = q * alpha / (eR * eS * eta**2) * (2 * y / np.sqrt(np.pi) - 1 + erfcx(y)) + share * q / alpha
    assert found.taken / q == pytest.approx(share, rel=3e-3)
    assert found.surface - T0 == pytest.approx(T, rel=1e-3)
    # what a wavenumber feels lies between rest and surface, and the shortest waves feel the surface
    assert np.all(np.diff(found.T) > 0)
    assert found.T[-1] - T0 == pytest.approx(T, rel=0.02)


@pytest.mark.parametrize("alpha", [np.inf, 2e4])
@pytest.mark.parametrize("m", [2e4, 2e5])
def test_heat_from_the_depth_reaches_the_road_late(alpha, m):
    """V7: 5e4 W/m2 in the contact and as much in the rubber, decaying as exp(-m z), after 10 ms."""
    t = 0.01
    heat, m = at_depth(m)
    found = Steady(heat, 5e4, alpha, t=t)
    eR, eS, s = RUBBER.effusivity, STONE.effusivity, np.sqrt(t)
    b = m * np.sqrt(RUBBER.diffusivity)
    if np.isinf(alpha):
        J = eS / (eR + eS) * 5e4 * (2 - erfcx(b * s))
    else:
        eta = alpha * (1 / eR + 1 / eS)
        far, near = (1 - erfcx(b * s)) / b, (1 - erfcx(eta * s)) / eta
        J = alpha / eR * 5e4 * (near + b / (eta - b) * (far - near))
    assert found.taken == pytest.approx(J, rel=3e-3)


def test_a_road_that_takes_nothing_changes_nothing():
    """Viscoelastic friction over a road of hardly any effusivity: as without one."""
    air = RoadSide(Material(1e-9, 1e-3, 1e-3))
    bare, over = (
        compute_heating_path(THEORY, RUBBER, ContactSpots(0.01, 0.2, road), 1.0, T0, P, 60) for road in (None, air)
    )
    np.testing.assert_allclose(over.mu, bare.mu, rtol=1e-6)
    np.testing.assert_allclose(over.T, bare.T, rtol=1e-6)


def test_a_road_cools_and_adhesive_heat_warms():
    """The hot branch at 1 m/s, 20 degC: over asphalt it is a fifth higher, viscoelastic heat alone; adhesive heat warms."""
    highest = {}
    for name, theory, road in (
        ("bare", THEORY, None), ("asphalt", THEORY, RoadSide(STONE)), ("granite", THEORY, RoadSide(LIBRARY["granite"])),
        ("adhesive", STICKY, RoadSide(STONE)),
    ):  # fmt: skip
        found, T = solve_hot_branch(theory, RUBBER, ContactSpots(0.01, 0.2, road), 1.0, T0, P)
        highest[name] = (float(found.viscous), T.max() - T0)
    print(highest)
    bare, asphalt, granite, adhesive = highest.values()
    assert bare[1] > adhesive[1] > asphalt[1] > granite[1]
    assert bare[0] < adhesive[0] < asphalt[0] < granite[0]
    assert 1.15 < asphalt[0] / bare[0] < 1.25


def test_few_steps_are_enough_for_the_hot_branch():
    spots = ContactSpots(0.01, 0.2, RoadSide(STONE))
    for v in (0.1, 3.0):
        quick = solve_hot_branch(STICKY, RUBBER, spots, v, T0, P)[0].mu
        assert float(quick) == pytest.approx(
            compute_heating_path(STICKY, RUBBER, spots, v, T0, P, 240).mu[-1], rel=1e-3
        )


def test_heat_of_a_slide_goes_somewhere():
    """What a wide spot releases is in rubber and road: the sum of both fluxes is the heat of the contact at every step."""
    slide = SlidingHistory(STICKY, RUBBER, ContactSpots(0.01, 0.2, RoadSide(STONE)), T0, P, 30)
    for _ in range(30):
        slide.step(1e-4, 1.0)
    released = slide.rubber_flux + slide.road_flux
    print(released, slide.road_flux / released)
    last = P * 1.0 / 0.2 * float(slide.evaluate_theory(1.0).adhesive)
    assert released[-1] == pytest.approx(last, rel=0.02)
    assert np.all(
        slide.road_flux / released > slide.spots.road_heat_fraction(RUBBER)
    )  # heat from the depth flows there as well
    assert slide.surface > T0 + 5
