"""The laboratory of tests/reference agrees with what flashtemp computes where nothing is hidden, and shows what is.

It shares no solver, no closure and no camera arithmetic with flashtemp, so that what both say is so.
"""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import reference
from reference import laboratory
from reference.camera import band_radiance
from reference.laboratory import MeasurementErrors, MeasurementProgramme
from reference.sliding import SlidingBlock, SlidingPair
from reference.wall import ALONG, WallDeficit
from scipy.special import erfc, erfcx

from flashtemp.comparison import campaign
from flashtemp.comparison.compare import compare

EXACT = MeasurementErrors(size=0.0, pattern=(0.0, 0.0))
CALM = MeasurementProgramme(mesh=1.0, netd=1e-6)
SHORT = MeasurementProgramme(0.3, wait=2.0, columns=60, mesh=1.2, netd=1e-6, conditions=((1.5e5, 0.3),))


def test_reference_programs_import_nothing_of_flashtemp():
    for file in Path(reference.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(n.split(".")[0] == "flashtemp" for n in names), f"{file.name}: {names}"


def test_the_block_takes_an_even_flux_like_a_half_space():
    """Carslaw & Jaeger 2.9: 2 q/k sqrt(Dt) ierfc(z/2 sqrt(Dt))."""
    pair = SlidingPair(columns=8)
    s = SlidingBlock(pair, 0.2)
    at = s._modal_decay(0.01, 0.0)
    for _ in range(500):
        s.amplitude = (
            s.amplitude * at["decayed"] + (at["early"] + at["late"]) * (s.forward @ np.full(8, 1000.0))[:, None]
        )
    z, root = np.array([0.0, 3e-4, 1e-3, 2e-3]), np.sqrt(4.0 * pair.k / pair.rc * 5.0)
    exact = 1000.0 / pair.k * (root / np.sqrt(np.pi) * np.exp(-((z / root) ** 2)) - z * erfc(z / root))
    np.testing.assert_allclose(s.section_rise(pair.x[:1], z)[:, 0], exact, atol=1e-4 * exact[0])


def test_the_wall_of_a_wide_block_is_cooled_like_a_half_space():
    """Carslaw & Jaeger 2.7: 1 - exp(h2Dt/k2) erfc(h sqrt(Dt)/k), for 10 s; then a film that is stronger draws more."""
    pair, section, (rest, slide) = SlidingPair(width=0.084), SlidingBlock(SlidingPair(columns=ALONG), 0.2), (9.0, 33.0)
    wall, D = WallDeficit(pair, np.zeros(ALONG), 0.0, 30.0), pair.k / pair.rc
    even = np.zeros((pair.columns, pair.degree))
    even[0] = section.modal.sum(axis=0)
    before, later = np.linspace(0.0, 10.0, 200)[1:], np.geomspace(0.01, 1.0, 60)
    lacks = [wall.advance(t, rest, 0.0, False, even, 0.0)[80, 16] for t in before]
    np.testing.assert_allclose(lacks, 1.0 - erfcx(rest / pair.k * np.sqrt(D * before)), atol=1e-3)
    more = [wall.advance(10.0 + t, slide, 0.0, True, even, 0.0)[80, 16] - lacks[-1] for t in later]
    exact = (1.0 - lacks[-1]) * (1.0 - erfcx((slide - rest) / pair.k * np.sqrt(D * later)))
    np.testing.assert_allclose(more[20:], exact[20:], atol=2e-3)


def check_agrees(folder, hidden, test, share, known=""):
    """Recordings of a laboratory without errors against flashtemp: rms below a `share` of the largest rise."""
    laboratory.write_campaign(folder, hidden, 1, EXACT, test)
    believed = (folder / "case.toml").read_text()
    (folder / "case.toml").write_text(f"effects = {list(hidden)}\n{believed}\n{known}".replace("'", '"'))
    found = compare(campaign.load(folder))
    for s in found.recordings:
        rise = np.nanmax(s.predicted) - laboratory.AIR_DEGC
        print(f"{s.view.file}: {s.rmse_K / rise:.2%} rms of {rise:.1f} K")
        assert s.rmse_K < share * rise, str(found)
    return found


@pytest.mark.long
def test_nothing_hidden_compares_within_a_thousandth_at_one_condition(tmp_path):
    check_agrees(tmp_path, {}, SHORT, 1e-3)


@pytest.mark.parametrize(("strength", "repetitions"), [pytest.param(1.0, 2, marks=pytest.mark.long), (0.4, 3)])
def test_road_that_comes_round_shows_what_it_brought_wherever_it_is(tmp_path, strength, repetitions):
    """In the wake too, and from the first road of a repetition on, which lay around the block when that began; of what
    every earlier pass left the same share is met, however often it has come round."""
    test = replace(SHORT, repetitions=repetitions)
    check_agrees(tmp_path, {"track_memory": strength}, test, 1e-3, f"[track_memory]\nstrength = {strength}\n")


@pytest.mark.long
def test_nothing_hidden_compares_within_a_thousandth(tmp_path):
    check_agrees(tmp_path, {}, CALM, 1e-3)


EFFECTS = {
    "pressure_tilt": ("a", 0.2), "edge_pressure": ("B", 1.0), "friction_softening": ("b", 0.006),
    "conductivity_slope": ("block", 0.005), "ambient_drift": ("rate", 0.01), "conductance_speed": ("resistance", 2e-5),
    "interface_resistance": ("resistance", 2e-5), "third_body": ("growth", 2e-5), "track_memory": ("strength", 1.0),
    "side_cooling": ("gain", 60.0), "time_lag": ("lag", -0.1),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_in_both_compares_as_nothing_hidden_does(tmp_path, effect):
    """What is hidden in the reference program is the effect of that name, told the same size."""
    key, size = EFFECTS[effect]
    check_agrees(tmp_path, {effect: size}, CALM, 1e-3, f"[{effect}]\n{key} = {size}\n")


@pytest.mark.long
def test_walls_of_a_rubber_that_conducts_more_where_it_is_warm_agree(tmp_path):
    """0.13 % without Kirchhoff's transformation: 25 W/m2K for a minute, and 25 % more conductivity at the contact."""
    test = replace(CALM, distance=1.5, repetitions=3, convection=25.0, wait=8.0)
    check_agrees(tmp_path, {"conductivity_slope": 0.015}, test, 1e-3, "[conductivity_slope]\nblock = 0.015\n")


@pytest.mark.parametrize("lag", [pytest.param(0.0, marks=pytest.mark.long), 0.5])
def test_thermocouples_compare_as_images_do(tmp_path, lag):
    """In a block of another size and kind on another road, four beads, at once and late."""
    pair = SlidingPair(length=0.032, height=0.009, k=0.33, rc=1.7e6, road_k=1.8, road_rc=1.9e6, diameter=2e-3)
    beads = ((0.2, 0.15), (0.8, 0.15), (0.5, 0.4), (0.9, 0.7))
    test = replace(SHORT, pair=pair, fraction=0.3, mu=0.8, sensors=beads, lag=lag, wait=4.0, mesh=1.0)
    found = check_agrees(tmp_path, {}, test, 2e-3)
    assert len(found.recordings) == 3


# --- mistakes of the set-up -----------------------------------------------------------------------------
def test_a_mistaken_setup_is_the_test_that_a_corrected_case_describes(tmp_path):
    """Load, speed, density and length as they really were, put in place of what is stated: nothing is left."""
    [(pressure, speed)], pair = SHORT.conditions, SHORT.pair
    wrong = {"load": 1.1, "speed": 1.05, "density": 1.06, "length": 0.025 * pair.length}
    laboratory.write_campaign(tmp_path, {}, 1, EXACT, SHORT, views=("sidewall",), setup_errors=wrong)
    stated = max(s.rmse_K for s in compare(campaign.load(tmp_path)).recordings)
    actual = replace(pair, rc=1.06 * pair.rc, length=1.025 * pair.length)
    (tmp_path / "case.toml").write_text(laboratory.stated_case(replace(SHORT, pair=actual)))
    text = (tmp_path / "campaign.toml").read_text()
    for key, old, new in (("contact.pressure", pressure, 1.1 * pressure), ("schedule.speed", speed, 1.05 * speed)):
        assert f'"{key}" = {old}' in text
        text = text.replace(f'"{key}" = {old}', f'"{key}" = {new}')
    (tmp_path / "campaign.toml").write_text(text)
    for s in compare(campaign.load(tmp_path)).recordings:
        agreed = 1e-3 * (np.nanmax(s.predicted) - laboratory.AIR_DEGC)
        assert s.rmse_K < agreed
        assert stated > 3.0 * agreed


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Recordings (file: temperature, time) of two short conditions under a mistake of the set-up."""
    test = replace(SHORT, distance=0.1, repetitions=1, netd=0.0, conditions=((1.5e5, 0.3), (0.75e5, 0.3)))

    def make(**errors):
        import xarray as xr

        folder = tmp_path_factory.mktemp("recordings")
        laboratory.write_campaign(folder, {}, 1, EXACT, test, setup_errors=errors)
        read = {f.name: xr.load_dataset(f) for f in sorted(folder.glob("*.nc"))}
        return {name: (ds.temperature.values, ds.time.values) for name, ds in read.items()}

    return make, make()


WALLS = ("condition1_sidewall.nc", "condition2_sidewall.nc")


@pytest.mark.parametrize("chosen", [None, WALLS[1:], ("condition1_wake.nc",)])
def test_a_clock_and_an_emissivity_are_wrong_in_the_recordings_that_are_chosen(recordings, chosen):
    make, plain = recordings
    found = make(clock=0.1, emissivity=0.1, recordings=chosen)
    for name, (T, time) in found.items():
        wrong = name in (chosen or WALLS)
        np.testing.assert_allclose(time - plain[name][1], 0.1 * wrong, atol=1e-12)
        excess, usual = (band_radiance(t) - band_radiance(laboratory.AIR_DEGC) for t in (T, plain[name][0]))
        warm = usual > 1e-3 * usual.max()  # Kirchhoff: a surface that emits less shows less of its own light
        np.testing.assert_allclose(excess[warm], (0.85 / 0.95 if wrong else 1.0) * usual[warm], rtol=1e-6)


def test_images_are_mirrored_or_scaled_one_by_one(recordings):
    make, plain = recordings
    for name, (T, _) in make(mirrored=True, recordings=WALLS[:1]).items():
        usual = plain[name][0]
        np.testing.assert_allclose(T, usual[..., ::-1] if name == WALLS[0] else usual, atol=1e-9)
    for name, (T, _) in make(larger=0.03, recordings=WALLS[:1]).items():
        assert np.array_equal(T, plain[name][0]) == (name != WALLS[0])


def test_two_recordings_bear_the_name_of_each_other(recordings):
    make, plain = recordings
    names = {**dict.fromkeys(plain), WALLS[0]: WALLS[1], WALLS[1]: WALLS[0]}
    for name, (T, _) in make(exchanged=WALLS).items():
        np.testing.assert_array_equal(T, plain[names[name] or name][0])
