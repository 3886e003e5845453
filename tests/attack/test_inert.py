"""Effects that cannot act in the case at hand are named, and no other."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from flashtemp.__main__ import main
from flashtemp.model.case import load_case
from flashtemp.physics.effect import catalogue
from flashtemp.runs.checks import inactive_effects

CASES = Path(__file__).parents[2] / "cases"
NEEDS_MORE = {
    "pressure_profile": {"pressure_profile.profile": [[0.0, 1.0], [0.025, 2.0]]},
    "driven_faces": {"driven_faces.face": [[0.0, 20.0], [10.0, 60.0]]},
}


def remarks(effect: str, **more) -> list[str]:
    given = {"effects": [effect], "numerics.mesh": "coarse"} | NEEDS_MORE.get(effect, {}) | more
    return inactive_effects.describe_inactive_effects(load_case(CASES / "uniform_pressure", given))


DEAR = ("persson_friction", "friction_moment", "resolved_spots")  # tests of their own see them act with every change


@pytest.mark.parametrize(
    "effect",
    [pytest.param(n, marks=pytest.mark.long if n in DEAR else ()) for n, e in catalogue().items() if not e.base],
)
def test_an_effect_acts_and_switched_off_does_not(effect):
    kind, p = catalogue()[effect], catalogue()[effect].params()
    on = remarks(effect, **{"schedule.repetitions": 2, "schedule.wait": 1.0, "numerics.across": 4})
    seen = list(kind().see(SimpleNamespace(**{k: v.value for k, v in p.items()})))
    assert on == ([f"{effect} acts on what a camera shows, not on this run"] if seen else [])
    if off := {f"{effect}.{k}": v.off for k, v in p.items() if v.off is not None}:
        [said] = remarks(effect, **off)
        assert said.startswith(effect)
        assert seen or "switches it off" in said


@pytest.mark.parametrize(("effect", "says"), [("pressure_roll", "needs 3D"), ("track_memory", "comes round")])
def test_what_cannot_act_in_this_case_says_why(effect, says):
    [said] = remarks(effect)
    assert says in said


def test_every_ready_case_needs_all_its_effects():
    for folder in CASES.iterdir():
        if (folder / "case.toml").is_file() and "persson_friction" not in (folder / "case.toml").read_text():
            assert inactive_effects.describe_inactive_effects(load_case(folder)) == [], folder.name


def test_check_and_summary_tell(tmp_path, capsys):
    words = [str(CASES / "uniform_pressure"), "effects=pressure_roll", "numerics.mesh=coarse", "schedule.distance=0.05"]
    assert main(["check", *words, "--json"]) == 0
    [said] = json.loads(capsys.readouterr().out)["remarks"]
    assert main(["run", *words, "output.pictures=false", "output.vtk=false", "--out", str(tmp_path / "out")]) == 0
    assert said in capsys.readouterr().out
    assert said in json.loads((tmp_path / "out" / "summary.json").read_text())["remarks"]
