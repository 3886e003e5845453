"""Which process makes friction depend on the load: the attribution, its words, its command."""

from __future__ import annotations

import csv
import itertools
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flashtemp.__main__ import main
from flashtemp.model.build import find_theory
from flashtemp.model.case import load_case
from flashtemp.physics.friction import friction_table
from flashtemp.runs.studies.load_dependence import (
    HEATING,
    PROCESS_NAMES,
    LoadDependence,
    attribute_load_dependence,
    compute_case_friction,
    list_subsets,
)
from flashtemp.solver.time_integration import integrate_schedule
from flashtemp.viz.studies import load_dependence as picture

CASE = Path(__file__).parents[2] / "cases" / "mu_of_p"
COARSE = {
    "numerics.mesh": 0.3,
    "numerics.rtol": 1e-3,
    "schedule.distance": 1.0,
    "output.profiles": 2,
    "output.fields": 2,
}


@pytest.fixture(scope="module", autouse=True)
def coarse_tables():
    """Tables of friction that take a sixth of the time: these tests are about who changes what, not about digits."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(friction_table, "TEMPERATURE_NODES", 16)
        yield


@pytest.fixture(scope="module")
def found() -> LoadDependence:
    return attribute_load_dependence(load_case(CASE, COARSE), (1e5, 3e5), (0.1, 1.0), workers=1)


@pytest.mark.long
def test_nothing_on_nothing_depends(found):
    """All five off: friction knows neither load nor heat (exact in the limit of small contact, but for the table)."""
    np.testing.assert_allclose(found.none[:, 0], found.none[:, 1], rtol=3e-4)  # the table's error


@pytest.mark.long
def test_without_heat_the_load_hardly_matters(found):
    """C23: saturation alone bends mu by less than 0.5 %."""
    assert np.all(np.abs(found.change(found.alone["saturation"])) < 5e-3)


@pytest.mark.long
def test_heating_makes_friction_fall_the_more_the_faster(found):
    """C23; without heat the same theory gives no fall."""
    change = found.change(found.alone[HEATING])
    assert np.all(change < 0)
    assert change[1] < 2 * change[0]
    assert found.leading_process == HEATING
    assert np.all(found.change(found.other) < change)  # fixed spots: more heat per spot under load


@pytest.mark.long
def test_adhesion_and_skewness_enlarge_the_contact(found):
    scene, acting = find_theory(load_case(CASE, COARSE))
    bare = replace(acting.p.theory, enlarged=())
    one = [replace(bare, enlarged=(part,)) for part in acting.p.theory.enlarged]
    assert len(one) == 2
    assert all(t(0.1, 293.15, 1e5).area > bare(0.1, 293.15, 1e5).area for t in one)
    skewed = next(t for t in one if t.enlarged[0].viscous < 0)
    assert skewed(0.1, 293.15, 1e5).viscous < bare(0.1, 293.15, 1e5).viscous  # C5


def made(found, value, acting=PROCESS_NAMES) -> LoadDependence:
    """An attribution of one speed and two loads; value(some) is the change of ln mu by some processes."""
    every = {some: np.exp(np.array([[0.0, value(some)]])) for some in list_subsets(PROCESS_NAMES)}
    return LoadDependence("made", found.pressure, np.array([1.0]), acting, {}, every, np.ones((1, 2)), "fixed")


@pytest.mark.long
def test_shares_add_up_where_processes_do_not_meet(found):
    """Two processes whose changes multiply: shares are their own changes, and their sum is the whole."""
    own = {"softening": np.log(1.1), HEATING: np.log(0.8)}
    both = made(found, lambda some: sum(own.get(n, 0.0) for n in some))
    shares = both.shapley_shares()
    assert shares["softening"] == pytest.approx(np.log(1.1))
    assert shares[HEATING] == pytest.approx(np.log(0.8))
    assert both.leading_process == HEATING
    assert sum(s[:, 0] for s in both.stepwise_shares().values()) == pytest.approx(np.log(0.88))
    assert max(abs(m[0]) for m in both.interactions().values()) < 1e-14
    assert "only together" not in str(both)


@pytest.mark.long
def test_what_two_do_only_together_is_shared_by_them_and_told_apart(found):
    """Softening alone changes nothing with load, but heat meets it: half of that is its share, and it is said."""

    def value(some):
        return -0.2 * (HEATING in some) + 0.04 * (HEATING in some and "softening" in some)

    one = made(found, value)
    assert one.lone_changes()["softening"] == pytest.approx(0.0, abs=1e-14)
    assert one.shapley_shares()["softening"] == pytest.approx(0.02)
    assert one.shapley_shares()[HEATING] == pytest.approx(-0.18)
    assert one.interactions()["softening", HEATING] == pytest.approx(0.04)
    assert "softening +2.0 % (alone +0.0 %)" in str(one)
    assert "only together: softening with heating +4.1 %" in str(one)


@settings(deadline=None, max_examples=20)
@given(st.lists(st.floats(-1.0, 1.0), min_size=31, max_size=31))
def test_shares_are_the_mean_over_all_orders(values):
    """Shapley's value by its own definition: what a process adds, over the 120 orders; the sum is the whole."""
    value = dict(zip(list_subsets(PROCESS_NAMES), [0.0, *values], strict=True))
    shares = made(SimpleNamespace(pressure=np.array([1e5, 3e5])), value.__getitem__).shapley_shares()
    orders = list(itertools.permutations(PROCESS_NAMES))
    for n in PROCESS_NAMES:
        added = 0.0
        for order in orders:
            before = tuple(m for m in PROCESS_NAMES if m in order[: order.index(n)])
            with_it = tuple(m for m in PROCESS_NAMES if m in before or m == n)
            added += value[with_it] - value[before]
        assert shares[n] == pytest.approx(added / len(orders), abs=1e-12)
    assert sum(shares.values()) == pytest.approx(value[PROCESS_NAMES], abs=1e-12)


@pytest.mark.long
def test_what_the_case_does_not_have_never_leads(found):
    """Softening by a typical value would change more than heating does: said, but not the answer."""
    one = made(
        found,
        lambda some: np.log(1.5) * ("softening" in some) + np.log(0.9) * (HEATING in some),
        ("saturation", HEATING),
    )
    one.values.update(softening=0.4, skewness=0.8, adhesion=0.05)
    assert one.leading_process == HEATING
    assert one.shapley_shares()["softening"] == pytest.approx(np.log(1.5))
    assert "Not in the case: if filled rubber softens with strain (payne_rest = 0.4), +50.0 %" in str(one)


@pytest.mark.long
def test_nothing_is_an_answer(found):
    flat = made(found, lambda some: 0.0)
    assert flat.leading_process is None
    assert "Friction depends on the load by less than" in str(flat)


PLAIN = COARSE | {"schedule.speed": 1.0, "schedule.distance": 0.3}


@pytest.fixture
def plain(tmp_path):
    """A case of rubber that is not filled, on a Gaussian road."""
    (tmp_path / "case.toml").write_text('effects = ["persson_friction"]\n')
    return tmp_path


@pytest.mark.long
def test_the_command_tells_of_the_case_itself(plain, capsys):
    """What is written is about that case: runs of it give the same friction."""
    out, words = plain / "out", [f"{k}={v}" for k, v in PLAIN.items()]
    args = ["loads", str(plain), *words, "--pressures", "1e5,3e5", "--speeds", "1", "--workers", "1", "--out", str(out)]
    assert main([*args, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told["ln_shares"]) == set(PROCESS_NAMES)
    runs = [load_case(plain, PLAIN | {"contact.pressure": p}) for p in (1e5, 3e5)]
    np.testing.assert_allclose(
        told["mu"]["every"][0], [integrate_schedule(c.scene, c.settings).friction[-1] for c in runs], rtol=1e-12
    )
    assert sorted(p.name for p in out.iterdir()) == ["case.toml", "loads.csv", "loads.json", "loads.png"]
    assert main(["loads", str(out), "--pressures", "1e5,2e5", "--speeds", "1", "--out", str(out)]) == 2  # exists


def test_all_laws_of_friction_count_with_heat_and_without():
    """A weight and a second law on friction: what nothing heats is what the balance's own laws give."""
    plain = {"persson_friction.flattened": 1.0, "persson_friction.work_of_adhesion": 0.0}
    theory = find_theory(load_case(CASE, plain))[1].p.theory
    given = plain | {"persson_friction.weight": 0.5, "friction.mu": 0.9, "ambient.temperature": 60.0}
    case = load_case(CASE, COARSE | given | {"effects": ["persson_friction", "friction_softening"]})
    mu = compute_case_friction(case, cold=True)
    expected = 0.9 * (0.5 + 0.5 * float(theory(0.5, 333.15, 1.5e5).mu)) * np.exp(-0.006 * 40)
    assert mu == pytest.approx(expected, rel=5e-3)  # the table stands for the theory


@pytest.mark.long  # test_skew.py has the theory
def test_the_cutoff_of_skewness_is_an_input(tmp_path, capsys):
    """The option and the key are one; skewness of all waves changes friction more than that of the long ones."""
    mu = {}
    words = ["--pressures", "1e5,3e5", "--speeds", "1", "--workers", "1", "--json"]
    given = [f"{k}={v}" for k, v in (COARSE | {"schedule.distance": 0.2}).items()]
    for name, more in {"default": [], "all": ["--skewness-cutoff", "0"]}.items():
        out = tmp_path / name
        key = ["persson_friction.payne_rest=1", "persson_friction.work_of_adhesion=0"]
        assert main(["loads", str(CASE), *given, *key, *words, *more, "--out", str(out)]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["skewness_cutoff_m"] == {"default": 1e-3, "all": 0.0}[name]
        assert load_case(out)["persson_friction.skewness_cutoff"] == told["skewness_cutoff_m"]
        mu[name] = told["mu"]["alone"]["skewness"][0][0] / told["mu"]["none"][0][0]
    assert mu["default"] == pytest.approx(1.0, abs=0.01)
    assert mu["all"] < 0.9


def test_a_negative_cutoff_of_skewness_is_refused(tmp_path, capsys):
    even = "persson_friction.flattened=1"  # no skewness to compute before the refusal
    assert main(["loads", str(CASE), even, "--skewness-cutoff", "-1", "--out", str(tmp_path / "no")]) == 2
    told = capsys.readouterr().err.strip()
    assert "persson_friction.skewness_cutoff" in told
    assert len(told.splitlines()) == 1


@pytest.mark.long
def test_the_command_with_every_process(tmp_path, capsys):
    out = tmp_path / "out"
    given = [f"{k}={v}" for k, v in COARSE.items()]
    args = ["loads", str(CASE), *given, "--pressures", "5e4,3e5", "--speeds", "1", "--workers", "1", "--out", str(out)]
    assert main([*args, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told["ln_shares"]) == set(PROCESS_NAMES)
    assert told["leading"] == max(PROCESS_NAMES, key=lambda n: abs(told["ln_shares"][n][0]))
    assert told["values"]["softening"] == 0.4
    assert [s["over"] for s in told["signs"]] == ["T", "p"]
    assert "persson_friction.shear_stress" in {f["key"] for f in told["signs"][0]["flips"]}
    with (out / "loads.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(r["pressure_Pa"]) for r in rows] == [5e4, 3e5]
    assert float(rows[1]["mu_case"]) == pytest.approx(told["mu"]["every"][0][1], abs=1e-6)


@pytest.mark.parametrize(
    ("args", "says"),
    [
        ((str(CASE.parent / "uniform_pressure"),), "effects"),
        ((str(CASE), "--pressures", "3e5,1e5"), "--pressures: 3e5,1e5; give at least 2 ascending"),
        ((str(CASE), "--speeds", "fast"), "--speeds: fast; give numbers"),
    ],
)
def test_bad_input(args, says, capsys, tmp_path):
    assert main(["loads", *args, "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err.strip()
    assert says in told
    assert len(told.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_picture_of_one_speed_and_many(found):
    one = replace(found, speed=found.speed[:1], mu={n: v[:1] for n, v in found.mu.items()}, other=found.other[:1])
    assert len(picture.draw(one).subfigs[0].axes) == 1
    assert len(picture.draw(found).subfigs[0].axes) == 2
