"""Side force of a tyre: closed form, brush, controls, the command (V24, claim C28)."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from flashtemp.__main__ import main
from flashtemp.model.schema import COMMAND_TABLES
from flashtemp.physics.friction import cold_hot_law, tread_block, tyre
from flashtemp.physics.friction.flash_temperature import ContactSpots, FrictionBranch
from flashtemp.physics.friction.persson import PerssonTheory
from flashtemp.physics.friction.rheology import READY_RUBBERS as RUBBERS
from flashtemp.physics.friction.roughness_spectrum import READY_ROADS as ROADS
from flashtemp.physics.material import LIBRARY
from flashtemp.runs.studies import rolling
from flashtemp.viz.theory import tyre as picture

CASE = Path(__file__).parents[2] / "cases" / "tyre"
THEORY, RUBBER, P = PerssonTheory(RUBBERS["A"], ROADS["asphalt A"]), LIBRARY["tread_rubber"], 3e5
TYRE = tyre.Tyre(speed=27.0, width=0.14, pressure=P)
LOADS, ANGLES = [3000.0, 5000.0, 7000.0], COMMAND_TABLES["tyre"]["angles"].value


def branch(speeds, mu):
    return FrictionBranch(speeds, mu, 0 * mu, 0 * mu)


@pytest.fixture(scope="module")
def synthetic():
    """The test set of V24, with the speeds of 2 and 5 degrees among its nodes."""
    v = np.unique(np.append(np.geomspace(1e-3, 30.0, 20001), TYRE.lateral_speed([2.0, 5.0])))
    lg = np.log10(v)
    cold, hot = 0.4 + 0.9 * np.exp(-0.08 * (lg - 1) ** 2), 0.3 + 0.7 * np.exp(-0.12 * (lg + 1) ** 2)
    return cold_hot_law.ColdHotLaw(branch(v, cold), branch(v, hot), 2e-3)


class OfThree(ContactSpots):
    """The reference figures for 10 mm were computed with the contact fraction of spots of 3 mm."""

    def contact_fraction(self, theory, v, T0, p):
        return float(theory.contact_fraction(2 * np.pi / 3e-3, v, T0, p))


@pytest.fixture(scope="module")
def corner():
    """Set A at 20 or 80 degC and D, cornering with bristles of stiffness k; computed once each."""
    known = {}

    def one(T, D, k=1.5e8, spots=OfThree):
        if (T, D, k, spots) not in known:
            law = cold_hot_law.derive_law(
                THEORY, RUBBER, spots(D), T + 273.15, P, 2 * float(TYRE.lateral_speed(15.0)), stated_ratio=0.2
            )
            known[T, D, k, spots] = tyre.compute_cornering(TYRE, law, LOADS, ANGLES, k, 0.1, T + 273.15, steepest=15.0)
        return known[T, D, k, spots]

    return one


def values(found, model):
    return [p.value for p in found.peaks[model, "law"]]


def test_footprint_carries_the_load():
    for load in LOADS:
        length, width = TYRE.footprint_lines(load)
        assert length @ width * P == pytest.approx(load, rel=1e-12)
        assert width.sum() == pytest.approx(TYRE.width, rel=1e-12)
    np.testing.assert_allclose(TYRE.footprint_length(LOADS), [0.0909, 0.1516, 0.2122], atol=5e-5)


def test_rigid_bristles_in_closed_form(synthetic):
    """V24, to all its digits."""
    wanted = [[1.09245475, 1.04770664, 1.01982285], [0.98093362, 0.93573176, 0.91431235]]
    np.testing.assert_allclose(tyre.rigid_side_force(TYRE, synthetic, LOADS, [2.0, 5.0]).T, wanted, atol=1e-8)
    best = [tyre.rigid_force_peak(TYRE, synthetic, load, ANGLES) for load in LOADS]
    np.testing.assert_allclose([b.value for b in best], [1.12285699, 1.10100380, 1.08706725], atol=1e-8)
    np.testing.assert_allclose([b.at for b in best], [0.9294, 0.7117, 0.6019], atol=1e-4)
    assert not any(b.is_at_edge for b in best)


def test_brush_with_constant_friction_in_closed_form():
    """Coulomb brush: every line sticks over x_s = mu p/(k_t tan a) and slides behind it."""
    mu, k, flat = 0.6, 1.5e8, np.array([1e-5, 100.0])
    law = cold_hot_law.ColdHotLaw(branch(flat, np.full(2, mu)), branch(flat, np.full(2, mu)), 2e-3)
    angles = np.array([0.2, 0.6, 1.5, 6.0])
    found, _ = tyre.brush_side_force(TYRE, law, LOADS, angles, k, 1e-4)
    for row, load in zip(found, LOADS, strict=True):
        for got, angle in zip(row, angles, strict=True):
            slope = k * np.tan(np.radians(angle))
            stick = mu * P / slope

            def line(y, slope=slope, stick=stick, load=load):
                length = TYRE.footprint_length(load) * np.sqrt(1 - (2 * y / TYRE.width) ** 2)
                front = min(length, stick)
                return 0.5 * slope * front**2 + mu * P * (length - front)

            edge = 0.5 * TYRE.width
            kink = edge * np.sqrt(max(0.0, 1 - (stick / TYRE.footprint_length(load)) ** 2))
            force = 2 * sum(quad(line, a, b)[0] for a, b in ((0.0, kink), (kink, edge)))
            assert got == pytest.approx(force / load, rel=1e-3)


@pytest.mark.parametrize(
    ("T", "D", "maxima", "angles"),
    [
        (20.0, 0.01, [0.4746, 0.4471, 0.4288], [0.89, 0.63, 0.50]),
        (20.0, 0.003, [0.4400, 0.4159, 0.4014], None),
        (80.0, 0.01, [0.1517, 0.1457, 0.1431], [15.0, 15.0, 15.0]),
    ],
)
@pytest.mark.sample("80.0-0.01-maxima2-angles2")
def test_rigid_maxima_of_set_a(corner, T, D, maxima, angles):
    found = corner(T, D)
    np.testing.assert_allclose(values(found, "rigid"), maxima, rtol=2e-3)
    if angles:
        np.testing.assert_allclose([p.at for p in found.peaks["rigid", "law"]], angles, rtol=0.04)
    assert np.all(np.diff(values(found, "rigid")) < 0)  # C28 (a)


@pytest.mark.parametrize(
    ("D", "k", "maxima"),
    [
        (0.01, 1.5e8, [0.379, 0.364, 0.354]),
        (0.01, 6e8, [0.436, 0.413, 0.396]),
        (0.003, 1.5e8, [0.3534, 0.3529, 0.3529]),
    ],
)
@pytest.mark.long
def test_brush_maxima_of_set_a(corner, D, k, maxima):
    """The reference, from a coarser integration, within 4 %, and how far its maximum falls within 2 points."""
    found = corner(20.0, D, k)
    print(found.peaks["brush", "law"])
    np.testing.assert_allclose(values(found, "brush"), maxima, rtol=0.042)
    assert found.peak_fall("brush") == pytest.approx(1 - maxima[-1] / maxima[0], abs=0.02)


def test_controls_do_not_fall(corner):
    """C28 (c): cold .651 -> .665 rises, in the reference."""
    found = corner(20.0, 0.01)
    assert all(map(found.has_flat_controls, tyre.TYRE_MODELS))
    for control in tyre.CONTROL_LAWS:
        assert found._control_fall("rigid", control) == pytest.approx(0.0, abs=1e-12)
        assert found._control_fall("brush", control) < 0
    assert [corner(80.0, 0.01).has_flat_controls(model) for model in tyre.TYRE_MODELS] == [None, None]
    cold = [p.value for p in corner(20.0, 0.01).peaks["brush", "cold"]]
    assert (cold[0], cold[-1]) == pytest.approx((0.651, 0.665), abs=0.003)


@pytest.mark.long
def test_small_spots_show_nothing_through_a_brush(corner):
    assert abs(corner(20.0, 0.003).peak_fall("brush")) < 0.01 < corner(20.0, 0.003).peak_fall("rigid")


@pytest.mark.long
def test_inertia_fakes_a_fall_and_is_refused(tmp_path, capsys):
    """The trap of C28: bristles of 5 kg/m2 let even the cold control fall."""
    law = cold_hot_law.derive_law(THEORY, RUBBER, ContactSpots(0.01, 0.2), 293.15, P, 15.0)
    heavy = tyre.compute_cornering(TYRE, law, LOADS, ANGLES, 1.5e8, 5.0, 293.15)
    print({c: [p.value for p in heavy.peaks["brush", c]] for c in tyre.COMPARED_LAWS})
    assert heavy.ringing_ratio > tread_block.MAX_RINGING_RATIO
    assert heavy.has_flat_controls("rigid")
    assert heavy._control_fall("brush", "cold") > tyre.MIN_FORCE_FALL
    out = tmp_path / "found"
    assert main(["tyre", str(CASE), "tyre.mass=5", "--out", str(out)]) == 2
    assert "tyre.mass: 5 kg/m2: the bristle oscillates with a period of 0.34" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.long
def test_command_and_case(tmp_path, capsys):
    """C28 (b): at 20 degC the maximum falls by 3 to 15 % from 3000 to 7000 N; at 80 degC rubber A has none up to 45 deg.

    There the angles were led on, and what load does is not read at the last of them.
    """
    out = tmp_path / "found"
    assert main(["tyre", str(CASE), "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {f.name for f in out.iterdir()} == {"case.toml", "tyre.json", "tyre.csv", "tyre.png"}
    assert json.loads((out / "tyre.json").read_text()) == told
    assert told["controls_hold"] is None
    assert "carcass" in told["not_modelled"]
    assert "flows into the road" not in told["not_modelled"]
    assert told["no_maximum_up_to_deg"] == {"rigid": 45.0, "brush": 45.0}
    assert told["angles_deg"][-1] == 45.0
    assert set(told["fall"].values()) == {None}
    table = np.genfromtxt(out / "tyre.csv", delimiter=",", names=True)
    [highest] = [m for m in told["maxima"] if (m["model"], m["law"], m["load_N"]) == ("brush", "law", 3000.0)]
    assert highest["at_edge"] is True
    assert table["brush_law"][table["load_N"] == 3000].max() == pytest.approx(highest["mu"], rel=1e-6)
    warm = tmp_path / "warm"
    assert main(["tyre", str(out), "ambient.temperature=20", "--out", str(warm)]) == 0
    said = capsys.readouterr().out
    for model in tyre.TYRE_MODELS:
        assert f"  {model}: no control falls with load" in said
    assert "no maximum" not in said
    assert "not modelled: the carcass" in said
    told = json.loads((warm / "tyre.json").read_text())
    assert told["controls_hold"] is True
    assert told["no_maximum_up_to_deg"] == {"rigid": None, "brush": None}
    assert all(0.03 < told["fall"][model] < 0.15 for model in tyre.TYRE_MODELS)


@pytest.mark.long
def test_no_maximum_is_told_in_one_sentence(tmp_path, capsys):
    """As the issue has it: a load effect is never read at an edge; the road takes heat or not."""
    given = ["tyre.angles=[5, 15]", "tyre.road_heat=false", "tyre.memory=0.2"]
    assert main(["tyre", str(CASE), *given, "--out", str(tmp_path / "found")]) == 0
    said = capsys.readouterr().out
    for model in tyre.TYRE_MODELS:
        assert f"  {model}: side force has no maximum up to 45 deg, so its load dependence is unknown" in said
    assert not any(line.rstrip().endswith("%") for line in said.splitlines())
    assert "heat that flows into the road or is released by the adhesive part" in said


@pytest.mark.long
def test_angles_are_led_on_to_both_sides(synthetic):
    """V24's maxima lie between 0.6 and 0.93 degrees: found from above and from below alike, within 1e-4."""
    for angles in ([0.05, 0.2], [2.0, 9.0], ANGLES):
        found = tyre.compute_cornering(TYRE, synthetic, LOADS, angles, 1.5e8, 0.1, 293.15)
        tops = found.peaks["rigid", "law"]
        np.testing.assert_allclose([p.value for p in tops], [1.12285699, 1.10100380, 1.08706725], rtol=1e-4)
        assert found.rising_up_to_deg("rigid") is None
        assert found.has_peak_fall("rigid")
    kept = tyre.compute_cornering(TYRE, synthetic, LOADS, [0.05, 0.2], 1.5e8, 0.1, 293.15, steepest=0.2)
    assert kept.rising_up_to_deg("rigid") == 0.2
    assert kept.peak_fall("rigid") is None
    assert not kept.has_peak_fall("rigid")


@pytest.mark.long
def test_a_fall_is_explained_where_there_is_one(tmp_path, capsys):
    """Soft bristles hardly slide: their side force rises with load, that of rigid ones falls."""
    soft = ["tyre.stiffness=1e5", "tyre.mass=1e-6", "tyre.angles=[5, 10, 15]", "ambient.temperature=20"]
    assert main(["tyre", str(CASE), *soft, "--out", str(tmp_path / "soft")]) == 0
    said = capsys.readouterr().out
    assert "  rigid: no control falls with load" in said
    assert "brush: no control" not in said


@pytest.mark.long
def test_one_load_and_falling_side_force(tmp_path, capsys):
    """With one load nothing can fall; at 20 degC the maximum lies below 2 degrees, and angles are led on to it."""
    out = tmp_path / "found"
    given = ["tyre.loads=[5000]", "ambient.temperature=20", "tyre.angles=[2, 4, 8]"]
    assert main(["tyre", str(CASE), *given, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "no control falls" not in said
    assert "already falling" not in said
    assert "+ still rising at the last slip angle" in said
    [law, cold, hot] = [line for line in said.splitlines() if line.startswith("    rigid")]
    assert " deg " in law
    assert "at 8 deg+" in cold
    assert "at 8 deg+" in hot
    told = json.loads((out / "tyre.json").read_text())["maxima"]
    assert [m["at_last"] for m in told if m["model"] == "rigid"] == [False, True, True]
    [best] = [m for m in told if (m["model"], m["law"]) == ("rigid", "law")]
    assert 1.2 < best["angle_deg"] < 2.0


def test_a_control_that_falls_is_told(corner):
    """Without a maximum inside at the angles of the law's maxima."""
    found = corner(20.0, 0.01)
    assert not any("control" in said for said in rolling._control_remarks(found))
    curves = found.curves | {("brush", "cold"): found.curves["brush", "cold"] * np.array([[1.0], [0.9], [0.8]])}
    edge = tuple(p._replace(last=True) for p in found.peaks["brush", "cold"])
    said = rolling._control_remarks(replace(found, curves=curves, peaks=found.peaks | {("brush", "cold"): edge}))[-1]
    assert said.startswith("brush: a control without flash temperature falls with load as well")


@pytest.mark.long
def test_hardly_any_friction_is_drawn(tmp_path, capsys):
    """At -100 degC all of the brush's curve is in the picture, and no control is blamed."""
    given = ["ambient.temperature=-100", "tyre.angles=[1, 5, 15]"]
    assert main(["tyre", str(CASE), *given, "--out", str(tmp_path / "found")]) == 0
    printed = capsys.readouterr()
    assert "a control without" not in printed.out
    assert printed.err == ""


@pytest.mark.long
def test_one_slip_angle_is_drawn(tmp_path, capsys):
    out = tmp_path / "found"
    assert main(["tyre", str(CASE), "tyre.angles=[1]", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "* at the only one of tyre.angles" in said
    assert "still rising" not in said
    assert (out / "tyre.png").exists()


def test_picture_holds_both_models(corner):
    """The brush may reach higher than rigid bristles do, and the axes are shared."""
    found = corner(20.0, 0.01)
    higher = {key: (3.0 if key[0] == "brush" else 1.0) * values for key, values in found.curves.items()}
    top = max(values.max() for values in higher.values())
    for ax in picture.draw(replace(found, curves=higher), "x").axes[:2]:
        assert top < ax.get_ylim()[1] < 1.2 * top
        assert ax.get_ylim()[0] == 0.0


def test_where_nothing_has_a_maximum_no_axes_are_made_up(corner):
    found = corner(20.0, 0.01)
    edges = {key: [p._replace(last=True) for p in some] for key, some in found.peaks.items()}
    fig = picture.draw(replace(found, peaks=edges), "x")
    assert len(fig.axes) == 2
    assert "No side force has a maximum up to" in fig.get_supxlabel()


@pytest.mark.parametrize("given", ["tyre.speed=1e-6", "tyre.stiffness=1"])
def test_bounds_of_speed_and_stiffness(tmp_path, capsys, given):
    assert main(["tyre", str(CASE), given, "--out", str(tmp_path / "found")]) == 2
    told = capsys.readouterr().err
    assert f"{given.split('=')[0]} (command line): " in told
    assert "give a number >= " in told


@pytest.mark.long
def test_the_usual_contact_fraction_decides(corner):
    """With P(2 pi/10 mm) = 0.5 the flash is spread so thin that the brush's maximum falls by 1 % only: case.toml says so."""
    assert float(THEORY.contact_fraction(2 * np.pi / 0.01, 1.0, 293.15, P)) == pytest.approx(0.53, abs=0.01)
    assert 0.0 < corner(20.0, 0.01, spots=ContactSpots).peak_fall("brush") < 0.03
