"""Skewed roads: moments, surfaces, what touches when only tops do, C5 of the theory's checklist."""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
import pytest
from scipy.special import ndtri

from flashtemp.errors import BadInput
from flashtemp.model.build import find_theory
from flashtemp.model.case import load_case
from flashtemp.physics.friction import friction_table, rheology, roughness_spectrum, skewness, theory_inputs
from flashtemp.physics.friction.adhesive_shear import AdhesiveShear
from flashtemp.physics.friction.persson import AreaEnlargement, PerssonTheory

ROAD = roughness_spectrum.READY_ROADS["asphalt A"]
SMALL = {"grid": 96, "seeds": (0, 1, 2, 3)}
LOADS = np.geomspace(1e-3, 0.3, 6)


@pytest.fixture(scope="module")
def ratio():
    return skewness.solve_area_ratio(0.6, LOADS, **SMALL)


@pytest.mark.parametrize(
    ("f", "known"), [(0.838166, -0.21), (0.8, -0.264479), (0.6, -0.581885), (0.5, -0.7595), (1, 0)]
)
def test_skewness_and_its_inverse(f, known):
    assert skewness.skewness_of_scale(f) == pytest.approx(known, abs=1e-6)
    assert skewness.scale_of_skewness(skewness.skewness_of_scale(f)) == pytest.approx(f, abs=1e-9)


def test_moments_of_many_heights():
    """Quantiles of a Gaussian, tops lowered: its skewness, and rms height and slope of the reference roads."""
    h = ndtri((np.arange(10**6) + 0.5) / 10**6)
    lowered = np.where(h > 0, 0.6 * h, h)
    d = lowered - lowered.mean()
    assert np.mean(d**3) / np.mean(d**2) ** 1.5 == pytest.approx(skewness.skewness_of_scale(0.6), abs=1e-3)
    assert skewness.REFERENCE_SCALES["height"](0.6) == pytest.approx(d.std(), rel=1e-4)
    h, side = skewness.gaussian_heights(ROAD, 256, 0)
    slope = [np.std(np.diff(x, axis=0)) for x in (np.where(h > 0, 0.6 * h, h), h)]
    assert skewness.REFERENCE_SCALES["slope"](0.6) == pytest.approx(slope[0] / slope[1], rel=0.02)


def test_the_gaussian_road_has_the_spectrum_asked_for():
    made = [skewness.gaussian_heights(ROAD, 128, seed) for seed in range(6)]
    side = made[0][1]
    assert side == pytest.approx(4 * np.pi / ROAD.q0)
    kept = roughness_spectrum.RoughnessSpectrum(ROAD.law, ROAD.q0, 2 * np.pi * 128 / (4 * side))
    assert np.sqrt(np.mean([np.var(h) for h, _ in made])) == pytest.approx(kept.rms_height, rel=0.05)
    gradient = [2 * np.mean((np.gradient(h, side / 128, axis=0)[1:-1]) ** 2) for h, _ in made]
    assert np.sqrt(np.mean(gradient)) == pytest.approx(kept.rms_slope(), rel=0.15)  # differences see short waves less
    assert all(abs(h.mean()) < 1e-12 for h, _ in made)
    np.testing.assert_array_equal(made[0][0], skewness.gaussian_heights(ROAD, 128, 0)[0])


def test_while_only_tops_touch_the_road_is_a_flatter_gaussian_one():
    """Heights f times as large at f times the pressure: the same points touch."""
    p, one = np.array([2e-3, 1e-2]), {"grid": 64, "seeds": (0, 1)}
    np.testing.assert_array_equal(skewness.solve_areas(0.6, 0.6 * p, **one), skewness.solve_areas(1.0, p, **one))
    all_flatter = skewness.solve_areas(0.6, [0.12], scale_below=0.6, **one)
    np.testing.assert_array_equal(all_flatter, skewness.solve_areas(1.0, [0.2], **one))
    assert np.all(skewness.solve_areas(0.6, [0.12], **one) < 0.97 * all_flatter)  # valleys keep their depth


@pytest.mark.long
def test_tops_lowered_touch_more_and_bend_the_area_sooner(ratio):
    """C5: R from 1/f to 1; A/p falls faster than on the Gaussian road."""
    assert ratio(1e-4) == pytest.approx(1 / 0.6, rel=0.01)
    assert 1.0 < ratio(0.3) < 1.1
    assert np.all(np.diff(ratio(np.geomspace(1e-4, 1.0, 50))) < 0)
    skewed, plain = ratio.areas / LOADS
    assert skewed[4] / skewed[1] < 0.85 * plain[4] / plain[1]


@pytest.mark.long
def test_the_fit_follows_what_was_solved(ratio):
    assert ratio.each.shape == (4, 6)
    np.testing.assert_allclose(ratio(LOADS), ratio.each.mean(axis=0), rtol=0.05)
    assert np.all(ratio.spread < 0.06)
    assert np.all(ratio.spread >= 0.999 * ratio.each.std(axis=0) / ratio(LOADS))  # scatter and misfit


@pytest.mark.long
def test_against_a_gaussian_road_of_the_same_slope_less_is_gained(ratio):
    p = LOADS[1:5]
    same = skewness.solve_area_ratio(0.6, p, against="slope", **SMALL)
    g = np.sqrt(0.68)
    assert same(1e-4) == pytest.approx(g / 0.6, rel=0.01)
    assert np.all(same(p) < ratio(p))
    np.testing.assert_allclose(same(p), same.each.mean(axis=0), rtol=0.05)


@pytest.mark.long
def test_friction_of_a_skewed_road():
    """Viscoelastic friction falls with what the adhesive part gains."""
    p = np.array([5e4, 1.5e5, 3e5])
    part = skewness.skewness_enlargement(0.8, 1.3e7, p, grid=64, seeds=(0, 1, 2))
    assert part.pressure == tuple(p)
    assert part(p[0]) == pytest.approx(1.25, rel=0.03)
    plain, worn = (
        PerssonTheory(rheology.READY_RUBBERS["A"], ROAD, shear=AdhesiveShear(4e6), enlarged=e)(0.1, 293.15, p)
        for e in ((), (part,))
    )
    np.testing.assert_allclose(worn.viscous / plain.viscous, 1 / np.array(part.factor))
    np.testing.assert_allclose(worn.adhesive / plain.adhesive, part.factor)
    assert np.all(worn.mu < plain.mu)


class Lowered:
    """C(q) of a road, multiplied by f^2 at wavenumbers below q (1/m)."""

    reach = (0.0, np.inf)

    def __init__(self, f: float, q: float):
        self.f, self.q = f, q
        self.bend_wavenumbers = (*ROAD.law.bend_wavenumbers, q)

    def __call__(self, q):
        return ROAD.law(q) * np.where(np.asarray(q) < self.q, self.f**2, 1.0)


def tops(f: float, cutoff: float) -> AreaEnlargement:
    """R = 1/f: only tops touch."""
    return AreaEnlargement((1e3, 1e7), (1 / f, 1 / f), -1.0, cutoff)


F, WARM, P = 0.838166, 293.15, 1.5e5


@pytest.mark.parametrize("cutoff", [1e-5, 1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("saturation", [True, False])
def test_skewness_above_a_cutoff_is_a_spectrum_lowered_there(cutoff, saturation):
    """Small contact: heights f times as large on long waves only, C -> f^2 C below 2 pi/cutoff."""
    plain = PerssonTheory(rheology.READY_RUBBERS["A"], ROAD, shear=AdhesiveShear(4e6), saturation=saturation)
    low = roughness_spectrum.RoughnessSpectrum(Lowered(F, 2 * np.pi / cutoff), ROAD.q0, ROAD.q1)
    known = PerssonTheory(plain.rubber, low, shear=plain.shear, saturation=saturation)(0.1, WARM, P)
    found = PerssonTheory(plain.rubber, ROAD, shear=plain.shear, saturation=saturation, enlarged=(tops(F, cutoff),))
    found = found(0.1, WARM, P)
    tolerance = 5e-4 if saturation else 1e-8  # the longest waves touch in a tenth and more: erf against its tangent
    assert found.viscous == pytest.approx(float(known.viscous), rel=tolerance)
    assert found.area == pytest.approx(float(known.area), rel=tolerance)
    np.testing.assert_allclose(np.interp(1e5, found.q, found.P), np.interp(1e5, known.q, known.P), rtol=1e-3)


def test_skewness_of_all_waves_of_some_and_of_none():
    """-16 % of the viscoelastic friction on all waves, below 1 % on those above 1 mm (the paper's caveat), 0 on none."""
    plain = PerssonTheory(rheology.READY_RUBBERS["A"], ROAD)
    for speed in (0.1, 1.0):
        before = plain(speed, WARM, P)

        def change(cutoff, speed=speed, before=before):
            part = (tops(F, cutoff),)
            after = PerssonTheory(plain.rubber, ROAD, enlarged=part)(speed, WARM, P)
            return float(after.viscous / before.viscous) - 1, float(after.area / before.area) - 1

        assert change(0.0) == pytest.approx((F - 1, 1 / F - 1), rel=1e-3)
        assert change(1e-7) == change(0.0)  # shorter than the shortest wave
        assert abs(change(1e-3)[0]) < 0.01
        assert 0 < change(1e-3)[1] < 2e-3
        assert change(0.1) == (0.0, 0.0)  # longer than the longest


def test_waves_that_the_road_does_not_have_are_not_skewed(tmp_path, monkeypatch):
    monkeypatch.setattr(friction_table, "TEMPERATURE_NODES", 4)  # of a table that nothing here reads

    @cache
    def solve_coarsely(f, modulus, road):
        pressures = tuple(theory_inputs.ENLARGEMENT_PRESSURES_PA.tolist())
        return skewness.skewness_enlargement(f, modulus, pressures, 48, (0, 1), road)

    monkeypatch.setattr(theory_inputs, "_cached_skewness", solve_coarsely)
    (tmp_path / "case.toml").write_text('effects = ["persson_friction"]\n')

    @cache
    def theory(**given):
        case = load_case(tmp_path, {f"persson_friction.{k}": v for k, v in ({"flattened": F} | given).items()})
        return find_theory(case)[1].p.theory

    assert theory(skewness_cutoff=0.1).enlarged == ()
    [default], [every] = theory().enlarged, theory(skewness_cutoff=0.0).enlarged
    assert (default.cutoff, every.cutoff) == (1e-3, 0.0)
    both = [theory(skewness_cutoff=c)(0.1, WARM, P) for c in (1e-3, 0.0)]
    plain = theory(flattened=1.0)(0.1, WARM, P)
    assert abs(both[0].viscous / plain.viscous - 1) < 0.01
    assert both[1].viscous / plain.viscous < 0.87
    # the macroasperity regions of 3 mm are made of skewed waves: they grow as before
    wave = 2 * np.pi / 3e-3
    grown = theory().contact_fraction(wave, 0.1, WARM, P) / theory(flattened=1.0).contact_fraction(wave, 0.1, WARM, P)
    assert 1.1 < grown < 1 / F


@pytest.mark.parametrize(
    ("wish", "says"),
    [
        (lambda: skewness.scale_of_skewness(0.1), "skewness: 0.1"),
        (lambda: skewness.scale_of_skewness(-1.7), "-1.64"),
        (lambda: skewness.solve_areas(0.0, [0.01]), "0 < f <= 1"),
        (lambda: skewness.solve_areas(0.5, [0.01, -1.0]), "pressures over modulus > 0"),
        (lambda: skewness.solve_areas(0.5, [0.01], grid=16), "at least 32 points"),
        (lambda: skewness.solve_area_ratio(0.5, [0.01], against="rms"), "unscaled, slope, height"),
        (lambda: skewness.skewness_enlargement(0.5, 1e7, [2e5, 1e5]), "in Pa, increasing"),
    ],
)
def test_bad_wishes(wish, says):
    with pytest.raises(BadInput, match=says) as fault:
        wish()
    assert "\n" not in str(fault.value)


def test_without_the_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    with pytest.raises(BadInput, match=r"pip install 'flashtemp\[topography\]'"):
        skewness.solve_areas(0.5, [0.01])
