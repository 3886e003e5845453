"""Attraction: diffusion of stress against closed forms, Griffith's crack, C6 of the theory's checklist."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erf, ndtr

from flashtemp.errors import BadInput
from flashtemp.physics.friction import adhesion, rheology, roughness_spectrum
from flashtemp.physics.friction.persson import PerssonTheory

q = np.geomspace(1.0, 1e4, 120)
LOADS = np.array([5e4, 1e5, 2e5, 6e5])  # Pa
COLD = 1e-3, 293.15


def elastic(E: float, road: str | roughness_spectrum.RoughnessSpectrum = "asphalt A", **more) -> PerssonTheory:
    """A road and rubber without loss."""
    rubber = rheology.Rubber(rheology.ColeCole(E, E, 0.5, 1e-8), rheology.WLF(7.718, 116.6, 293.15))
    return PerssonTheory(rubber, roughness_spectrum.READY_ROADS[road] if isinstance(road, str) else road, **more)


def factors(theory, work, **more):
    return np.array(adhesion.adhesion_enlargement(theory, *COLD, work, LOADS, **more).factor)


def test_without_tension_the_area_is_the_error_function():
    G = np.array([1e-3, 1e-1, 1e-5])[:, None] * q**2
    found = adhesion.area_with_tension(q, G, 0.0)
    exact = erf(0.5 / np.sqrt(G))
    np.testing.assert_allclose(found, exact, atol=3e-5)
    np.testing.assert_allclose(found, exact, rtol=5e-4)


@pytest.mark.parametrize(("rate", "first"), [(0.0, 2.0), (0.3, 0.0), (0.3, 1.0), (0.01, 0.1), (3.0, 0.5), (1e-3, 5.0)])
def test_a_wall_that_recedes_evenly(rate, first):
    """Tension first + rate G: survivors of a drifting diffusion in front of an absorbing wall, by images."""
    G = 1e-3 * q**1.5
    s, reach = 1.0 + first, np.sqrt(2.0 * G)
    exact = ndtr((s + rate * G) / reach) - np.exp(-rate * s) * ndtr((-s + rate * G) / reach)
    np.testing.assert_allclose(adhesion.area_with_tension(q, G, first + rate * G), exact, atol=3e-5)


def test_the_tension_that_parts_a_contact_is_griffiths():
    """A penny crack of radius pi/q before a rigid body releases, per area that it grows by, the work of adhesion."""
    E, w, wave = 1.3e7, 0.05, 1e5
    stress, radius = adhesion.detachment_stress(wave, w, E), np.pi / wave

    def energy(a):  # of a crack with the opening (4/(pi E*)) sigma sqrt(a^2 - r^2) in one half-space
        return 0.5 * stress * quad(lambda r: 4 / np.pi * stress / E * np.sqrt(a * a - r * r) * 2 * np.pi * r, 0, a)[0]

    step = 1e-2 * radius
    released = (energy(radius + step) - energy(radius - step)) / (4 * np.pi * radius * step)
    assert released == pytest.approx(w, rel=1e-4)


def test_hardly_any_work_changes_hardly_anything():
    theory = elastic(1e7)
    np.testing.assert_array_equal(factors(theory, 0.0), 1.0)
    for stored in (True, False):
        np.testing.assert_allclose(factors(theory, 1e-7, stored=stored), 1.0, atol=1e-3)


def test_area_stays_linear_in_pressure_with_a_larger_slope():
    """C6: asphalt, 0.05 J/m^2.  Without the stored energy the road sticks a little: an upper bound."""
    theory = elastic(1e7)
    bare = theory(*COLD, LOADS).area
    slope = np.polyfit(LOADS, bare, 1)[0]
    held = factors(theory, 0.05)
    found, intercept = np.polyfit(LOADS, held * bare, 1)
    assert 1.005 < found / slope < 1.05
    assert 0.0 <= intercept < 1e-4
    np.testing.assert_allclose(held, held.mean(), rtol=1e-3)
    free = factors(theory, 0.05, stored=False)
    assert np.all(free > held)
    assert np.all(np.diff(free) < 0)
    assert np.polyfit(LOADS, free * bare, 1)[1] > 5e-4


@pytest.mark.long
def test_more_work_softer_rubber_and_a_smoother_road_take_more_hold():
    def factor(theory, work=0.05, v=1e-3):
        return adhesion.adhesion_enlargement(theory, v, 293.15, work, [1.5e5]).factor[0]

    base = factor(elastic(1e7))
    assert 1.0 < base < min(factor(elastic(1e7), 0.2), factor(elastic(3e6)), factor(elastic(1e7, "concrete B")))
    viscous = PerssonTheory(
        rheology.READY_RUBBERS["A"], roughness_spectrum.READY_ROADS["asphalt A"]
    )  # stiff at the frequencies of sliding
    assert factor(viscous, v=1e-3) > factor(viscous, v=1.0) > 1.0


def test_energy_of_the_shorter_waves_is_won_back():
    """Full contact: w_eff = w - (pi E*/2) int_q^q1 q^2 C dq, C ~ q^-3.8."""
    road = roughness_spectrum.self_affine_spectrum(1e-6, 1e3, 0.9, 250.0, 1e-2)
    theory, E, w = elastic(1e6, road), 1e6 / 0.75, 0.05
    waves = np.geomspace(2e3, road.q1, 400)
    left = adhesion._effective_work(theory, waves, np.ones((1, 400)), w, E)[0]
    stored = np.pi * E / 2 * road(1e3) * 1e3**3.8 * (waves**-0.8 - road.q1**-0.8) / 0.8
    assert stored[0] > 1e-3 * w
    np.testing.assert_allclose(w - left, stored, rtol=2e-3, atol=1e-9)


def test_enlarged_is_what_a_theory_takes():
    theory = elastic(1e7, "concrete B")
    part = adhesion.adhesion_enlargement(theory, *COLD, 0.05, LOADS)
    assert part.viscous == 1.0
    both = elastic(1e7, "concrete B", enlarged=(part,))
    np.testing.assert_allclose(both(*COLD, LOADS).area, np.array(part.factor) * theory(*COLD, LOADS).area)
    assert adhesion.adhesion_enlargement(both, *COLD, 0.05, LOADS) == part  # what enlarges already does not count


def test_a_modulus_at_rest_is_needed():
    rubber = rheology.Rubber(rheology.ColeCole(0.0, 1e9, 0.5, 1e-8), rheology.WLF(7.718, 116.6, 293.15))
    with pytest.raises(BadInput, match="modulus: 0"):
        adhesion.adhesion_enlargement(
            PerssonTheory(rubber, roughness_spectrum.READY_ROADS["asphalt A"]), *COLD, 0.05, LOADS
        )


@pytest.mark.parametrize(
    ("theory", "work", "p", "says"),
    [
        (
            elastic(1e6, roughness_spectrum.self_affine_spectrum(3e-6, 3e3, 0.8, 250.0, 0.05)),
            0.05,
            LOADS,
            "without load",
        ),
        (elastic(1e7), -0.05, LOADS, "work of adhesion >= 0"),
        (elastic(1e7), 0.05, LOADS[::-1], "increasing pressures"),
        (elastic(1e7), 0.05, [0.0, 1e5], "increasing pressures"),
    ],
)
def test_bad_wishes(theory, work, p, says):
    with pytest.raises(BadInput, match=says) as fault:
        adhesion.adhesion_enlargement(theory, *COLD, work, p)
    assert "\n" not in str(fault.value)
