"""Which process makes friction depend on the load: the attribution, its words, its command."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.case import load
from flashtemp.loads import HEATING, NAMES, Loads, attribute
from flashtemp.theories import theory_of
from flashtemp.viz import loads as picture

CASE = Path(__file__).parents[1] / "cases" / "mu_of_p"
COARSE = {
    "numerics.mesh": 0.3,
    "numerics.rtol": 1e-3,
    "schedule.distance": 1.0,
    "output.profiles": 2,
    "output.fields": 2,
}


@pytest.fixture(scope="module")
def found() -> Loads:
    return attribute(load(CASE, COARSE), (1e5, 3e5), (0.1, 1.0), workers=1)


def test_nothing_on_nothing_depends(found):
    """All five off: friction knows neither load nor heat (exact in the limit of small contact)."""
    np.testing.assert_allclose(found.none[:, 0], found.none[:, 1], rtol=1e-12)


def test_without_heat_the_load_hardly_matters(found):
    """C23: saturation alone bends mu by less than 0.5 %."""
    assert np.all(np.abs(found.change(found.alone["saturation"])) < 5e-3)


def test_heating_makes_friction_fall_the_more_the_faster(found):
    """C23; without heat the same theory gives no fall."""
    change = found.change(found.alone[HEATING])
    assert np.all(change < 0)
    assert change[1] < 2 * change[0]
    assert found.leading == HEATING
    assert np.all(found.change(found.other) < change)  # fixed spots: more heat per spot under load


def test_adhesion_and_skewness_enlarge_the_contact(found):
    scene, acting = theory_of(load(CASE, COARSE))
    bare = replace(acting.p.theory, enlarged=())
    one = [replace(bare, enlarged=(part,)) for part in acting.p.theory.enlarged]
    assert len(one) == 2
    assert all(t(0.1, 293.15, 1e5).area > bare(0.1, 293.15, 1e5).area for t in one)
    skewed = next(t for t in one if t.enlarged[0].viscous < 0)
    assert skewed(0.1, 293.15, 1e5).viscous < bare(0.1, 293.15, 1e5).viscous  # C5


def test_shares_add_up_where_processes_do_not_meet(found):
    """Two processes whose changes multiply: shares are their own changes, and their sum is the whole."""
    shape = (1, 2)
    own = {n: np.array([[1.0, f]]) for n, f in zip(NAMES, (1.0, 1.1, 1.0, 1.0, 0.8), strict=True)}
    every = np.array([[1.0, 1.1 * 0.8]])
    made = Loads(
        "made", found.pressure, np.array([1.0]), np.ones(shape), every, own, {n: every / own[n] for n in NAMES},
        every, "fixed",
    )  # fmt: skip
    shares = made.shares()
    assert shares["softening"] == pytest.approx(np.log(1.1))
    assert shares[HEATING] == pytest.approx(np.log(0.8))
    assert sum(s[0] for s in shares.values()) == pytest.approx(np.log(0.88))
    assert made.leading == HEATING
    assert sum(s[:, 0] for s in made.local().values()) == pytest.approx(np.log(0.88))


def test_nothing_is_an_answer():
    flat = np.full((1, 2), 0.7)
    same = dict.fromkeys(NAMES, flat)
    made = Loads("flat", np.array([1e5, 2e5]), np.array([1.0]), flat, flat, same, same, flat, "fixed")
    assert made.leading is None
    assert "Nothing makes friction depend on the load" in str(made)


def test_command(tmp_path, capsys):
    out = tmp_path / "out"
    given = [f"{k}={v}" for k, v in COARSE.items()]
    args = ["loads", str(CASE), *given, "--pressures", "1e5,2e5", "--speeds", "1", "--workers", "1", "--out", str(out)]
    assert main([*args, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["leading"] == HEATING
    assert set(told["shares"]) == set(NAMES)
    assert sorted(p.name for p in out.iterdir()) == ["case.toml", "loads.csv", "loads.json", "loads.png"]
    with (out / "loads.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(r["pressure_Pa"]) for r in rows] == [1e5, 2e5]
    assert float(rows[1]["mu_all"]) == pytest.approx(told["mu"]["every"][0][1], abs=1e-6)
    assert main(["loads", str(out), "--pressures", "1e5,2e5", "--speeds", "1", "--out", str(out)]) == 2  # exists


@pytest.mark.parametrize(
    ("args", "says"),
    [
        ((str(CASE.parent / "uniform_pressure"),), "effects"),
        ((str(CASE), "--pressures", "3e5,1e5"), "--pressures: 3e5,1e5; give at least 2 rising"),
        ((str(CASE), "--speeds", "fast"), "--speeds: fast; give numbers"),
    ],
)
def test_bad_input(args, says, capsys, tmp_path):
    assert main(["loads", *args, "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err.strip()
    assert says in told
    assert len(told.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_picture_of_one_speed_and_many(found):
    one = replace(
        found, speed=found.speed[:1], none=found.none[:1], every=found.every[:1], other=found.other[:1],
        alone={n: v[:1] for n, v in found.alone.items()}, without={n: v[:1] for n, v in found.without.items()},
    )  # fmt: skip
    assert len(picture.draw(one).subfigs[0].axes) == 1
    assert len(picture.draw(found).subfigs[0].axes) == 2
