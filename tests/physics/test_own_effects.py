"""Effects of a user's own: a file beside the case or an installed package, and whose file may run."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import pickle
import re
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.cli import commands as command_line
from flashtemp.errors import BadInput, UserInterrupt
from flashtemp.model.case import load_case
from flashtemp.physics import user_effects
from flashtemp.physics.effect import catalogue
from flashtemp.runs import job
from flashtemp.runs.studies import sweep
from flashtemp.solver.time_integration import integrate_schedule

DUST = '''"""Abrasion dust lubricates the contact: friction falls with the distance slid."""

from __future__ import annotations

from flashtemp.physics import Effect, Factor, Param


class Dust(Effect):
    """Friction falls linearly with the slid distance of a repetition."""

    cause = "abrasion dust gathers in the contact"
    source = "own measurement"
    tells = ("friction falls along the track, whatever the temperature",)

    rate = Param(2.0, "1/m", "relative fall of friction per metre", low=0.0, high=4.0, off=0.0)

    def heat(self, scene, p):
        """Multiplies mu."""
        yield Factor("friction.mu", lambda T, now, p: 1.0 - p.rate * now.slid)
'''
SMALL = """effects = {effects}
[schedule]
distance = 0.1
[numerics]
cells = [10, 8, 8]
[output]
pictures = false
vtk = false
"""
MARK = "\nfrom pathlib import Path\nPath(__file__).with_name('ran').touch()\n"


def written(folder: Path, text: str = DUST, effects: str = '["./dust.py"]', more: str = "", file: str = "dust.py"):
    """A case folder with one effect file."""
    folder.mkdir(exist_ok=True)
    (folder / file).write_text(text)
    (folder / "case.toml").write_text(SMALL.format(effects=effects) + more)
    return folder


@pytest.fixture
def case(tmp_path):
    return written(tmp_path / "case")


@pytest.fixture
def stranger(monkeypatch):
    """Whoever runs this is another user than the one who owns the files."""
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)


def line_of(capsys, argv, code: int = 2) -> str:
    assert main([str(a) for a in argv]) == code
    out, err = capsys.readouterr()
    assert out == ""
    [line] = err.splitlines()
    return line


# --- what a file can do ------------------------------------------------------------------------------
def test_the_stem_names_effect_and_table(case):
    loaded = load_case(case, {"dust.rate": 1.0})
    assert loaded.effects == ("dust",)
    assert loaded["dust.rate"] == 1.0
    assert loaded.scene.acting[-1].name == "dust"
    run = integrate_schedule(loaded.scene, loaded.settings)
    sliding = run.friction[run.sliding]
    np.testing.assert_allclose(sliding, 1.0 - run.slid[run.sliding], rtol=1e-12)


def test_off_is_the_base_bit_for_bit(case):
    off, base = load_case(case, {"dust.rate": 0.0}), load_case(case, {"effects": []})
    runs = [integrate_schedule(c.scene, c.settings) for c in (off, base)]
    assert np.array_equal(runs[0].field, runs[1].field)


def test_tables_of_the_file_rest_when_effects_are_chosen_on_the_command_line(tmp_path):
    folder = written(tmp_path / "case", more="[dust]\nrate = 0.5\n")
    assert load_case(folder, ["effects="]).effects == ()
    assert load_case(folder, ["effects=wear,./dust.py"]).effects == ("wear", "dust")
    with pytest.raises(BadInput, match=r"dust.rat \(.*\): unknown key; did you mean 'dust.rate'"):
        load_case(folder, {"dust.rat": 1.0})
    with pytest.raises(BadInput, match=r"dust.rate .*9.*<= 4"):
        load_case(folder, {"dust.rate": 9.0})


def test_changed_values_know_the_file(case):
    bare = load_case(case, {"effects": [], "candidates": ["./dust.py"]})
    assert bare.candidates == ("dust",)
    again = bare.with_values({"effects": ["dust"], "dust.rate": 0.5})
    assert again.known_effects["dust"] is load_case(case).known_effects["dust"]
    assert again["dust.rate"] == 0.5
    assert "dust" not in catalogue()


def test_a_result_runs_again_as_it_was(case, tmp_path):
    first = job.simulate(load_case(case), tmp_path / "one")
    told = json.loads((tmp_path / "one" / "summary.json").read_text())["own_effects"]
    digest = hashlib.sha256(DUST.encode()).hexdigest()
    assert told == {"dust": {"file": "inputs/dust.py", "sha256": digest}}
    assert (tmp_path / "one" / "inputs" / "dust.py").read_text() == DUST
    (case / "dust.py").unlink()
    second = job.simulate(load_case(tmp_path / "one"), tmp_path / "two")
    assert np.array_equal(first.field, second.field)
    assert (tmp_path / "two" / "case.toml").read_text() == (tmp_path / "one" / "case.toml").read_text()


def test_a_bare_case_names_no_own_effects(case, tmp_path):
    job.simulate(load_case(case, {"effects": []}), tmp_path / "out")
    assert "own_effects" not in json.loads((tmp_path / "out" / "summary.json").read_text())


def test_another_process_runs_what_was_read(case):
    """Neither the file nor the decision to run it is looked at again."""
    asked = sweep.plan_sweep(case, {"dust.rate": (0.0, 1.0)})
    (case / "dust.py").unlink()
    found = sweep.run_sweep(asked, None, workers=2)
    assert not found.failed
    assert np.ptp(found.dataset.friction.values) > 0.01


def test_a_case_travels_without_its_scene(case):
    loaded = load_case(case)
    state = pickle.dumps(loaded)
    assert len(state) < 20000
    again = pickle.loads(state)
    assert again == loaded
    assert again.known_effects["dust"] is loaded.known_effects["dust"]
    assert str(again) == str(loaded)


def test_listed_and_shown(case, capsys):
    assert main(["effects", str(case / "dust.py"), "--json"]) == 0
    [told] = json.loads(capsys.readouterr().out)
    assert told["name"] == "dust"
    assert told["parameters"][0]["key"] == "dust.rate"


# --- files that cannot be used -----------------------------------------------------------------------
FAULTS = {
    "two effects": ({"text": DUST + "\n\nclass More(Effect):\n    pass\n"}, r"dust.py:22: contains 2 effects", "file of its own"),
    "no effect": ({"text": "x = 1\n"}, r"dust.py:1: contains no effect", "derived from Effect"),
    "does not import": ({"text": "\nimport nonsense\n"}, r"dust.py:2: does not run.*nonsense", "import from"),
    "does not run": ({"text": "\n\n1 / 0\n"}, r"dust.py:3: does not run: ZeroDivisionError", "repair"),
    "ends the program": ({"text": "raise SystemExit\n"}, r"dust.py:1: does not run: SystemExit", "repair"),
    "syntax": ({"text": "x = = 1\n"}, r"dust.py:1: invalid syntax", "repair"),
    "not text": ({"text": DUST, "file": "dust.py", "effects": '["./other.py"]'}, r"case.toml:1: effects: './other.py'", "give"),
    "always": ({"text": DUST.replace("    rate", "    base = True\n    rate")}, "dust.py: base = True", "leave it out"),
    "bounds that none meets": ({"text": DUST.replace("high=4.0", "high=-1.0")}, r"dust.py:15: does not run: ValueError: no number is >= 0 and <= -1", "repair"),
    "name of the catalogue": ({"file": "wear.py", "effects": '["./wear.py"]'}, "wear.py: the catalogue has", "another name"),
    "name of a table": ({"file": "block.py", "effects": '["./block.py"]'}, "'block' is a key of every case", "another name"),
    "name that is none": ({"file": "My-dust.py", "effects": '["./My-dust.py"]'}, "My-dust.py: the file names the effect", "lower-case"),
    "unknown quantity": (
        {"text": DUST.replace("friction.mu", "friction.my")},
        r"case.toml:1: effects: effect 'dust' \(.*dust.py:19\): Factor\(\"friction.my\"\)",
        "did you mean 'friction.mu'",
    ),
    "fails on the scene": (
        {"text": DUST.replace("yield Factor", "scene.nothing\n        yield Factor")},
        r"effect 'dust' \(.*dust.py:19\): heat\(\) fails: AttributeError",
        "repair",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_fault_is_told_with_file_line_and_remedy(name, tmp_path, capsys):
    given, said, remedy = FAULTS[name]
    line = line_of(capsys, ["check", written(tmp_path / "case", **given)])
    assert re.search(said, line), line
    assert remedy in line


def test_a_law_that_fails_on_the_way_is_told_with_its_line(tmp_path, capsys):
    """It holds at the start and breaks after 5 cm: one line, exit code 1, nothing half-written."""
    text = DUST.replace("1.0 - p.rate * now.slid)", "1.0 if now.slid < 0.05 else {}[now.slid])")
    line = line_of(capsys, ["run", str(written(tmp_path, text)), "--out", str(tmp_path / "out")], 1)
    assert "effect 'dust'" in line
    assert f"dust.py:{text[: text.index('{}[')].count(chr(10)) + 1})" in line
    assert "KeyError" in line
    assert "after t = " in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("law", ["lambda T, now: 1.0", "lambda T, now, p: [1.0, 2.0]", 'lambda T, now, p: "x"'])
def test_a_law_that_cannot_be_asked_or_answers_no_number_is_told_with_its_line(tmp_path, capsys, law):
    text = DUST.replace("lambda T, now, p: 1.0 - p.rate * now.slid", law)
    line = line_of(capsys, ["run", str(written(tmp_path, text)), "--out", str(tmp_path / "out")], 1)
    assert f"effect 'dust' ({tmp_path / 'dust.py'}:{text[: text.index(law)].count(chr(10)) + 1}): its law fails" in line
    assert "TypeError" in line


def test_a_law_that_gives_no_number_is_named(tmp_path, capsys):
    text = DUST.replace("1.0 - p.rate * now.slid)", 'float("nan"))')
    line = line_of(capsys, ["run", str(written(tmp_path, text)), "--out", str(tmp_path / "out")], 1)
    assert "effect dust returns no number" in line


def test_a_film_that_holds_the_section_is_refused_in_2d_alone(tmp_path, capsys):
    law = DUST.replace("Effect, Factor, Param", "Effect, Heat, Param").replace(
        'Factor("friction.mu", lambda T, now, p: 1.0 - p.rate * now.slid)',
        'Heat.film("block.sides", lambda now, p: 0.0 if now.speed else float("inf"))',  # while it waits
    )
    case = written(tmp_path, law)
    words = ["run", str(case), "schedule.repetitions=2", "schedule.wait=1", "--out"]
    assert main([*words, str(tmp_path / "flat")]) == 2
    said = "its film on block.sides is inf, which would fix the temperature of the whole section in 2D"
    assert said in capsys.readouterr().err
    assert not (tmp_path / "flat").exists()
    assert main([*words, str(tmp_path / "wide"), "numerics.across=4"]) == 0


def test_two_files_of_one_name(tmp_path, capsys):
    folder = written(tmp_path / "case", effects='["./dust.py", "more/dust.py"]')
    (folder / "more").mkdir()
    (folder / "more" / "dust.py").write_text(DUST)
    line = line_of(capsys, ["check", folder])
    assert "'./dust.py'" in line
    assert "'more/dust.py'" in line
    assert "another name" in line


def test_a_file_of_the_catalogue_with_two_effects_is_an_error(monkeypatch):
    from flashtemp.physics import effect
    from flashtemp.physics.effects import wear

    more = type("More", (effect.Effect,), {"__module__": wear.__name__})
    monkeypatch.setattr(wear, "More", more, raising=False)
    effect.catalogue.cache_clear()
    try:
        with pytest.raises(
            BadInput, match=r"wear.py:\d+: contains 2 effects, Wear and More; give each a file of its own"
        ):
            effect.catalogue()
    finally:
        monkeypatch.undo()
        effect.catalogue.cache_clear()


# --- whose file may run ------------------------------------------------------------------------------
LOADING = ("run", "check", "sweep", "converge", "wait", "twin", "friction", "loads", "tread", "tyre")
ON_CAMPAIGNS = ("compare", "discover", "plan")
ARGUMENTS = {
    "sweep": ["dust.rate=0,1"],
    "wait": ["--below", "50"],
    "twin": ["--hide", "wear", "--seed", "1", "--out", "twin"],
}


@pytest.mark.parametrize("command", LOADING)
def test_a_file_of_somebody_else_does_not_run(command, tmp_path, capsys, stranger, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = written(tmp_path / "case", DUST + MARK)
    line = line_of(capsys, [command, folder, *ARGUMENTS.get(command, [])])
    assert line.startswith(f"{folder}/case.toml:1: effects: {folder}/dust.py would run as a program")
    assert "belongs to another user" in line
    assert "--trust" in line
    assert "folder of your own" in line
    assert not (folder / "ran").exists()


@pytest.mark.parametrize("command", ON_CAMPAIGNS)
def test_a_campaign_does_not_run_it_either(command, tmp_path, capsys, stranger):
    folder = written(tmp_path / "case", DUST + MARK)
    (folder / "mu.csv").write_text("time_s,mu\n0,1\n1,1\n")
    (folder / "campaign.toml").write_text('[[force]]\nfile = "mu.csv"\nwith = { "friction.mu" = 0.9 }\n')
    line = line_of(capsys, [command, folder])
    assert "dust.py would run as a program" in line
    assert "--trust" in line
    assert not (folder / "ran").exists()


@pytest.mark.parametrize("command", [*LOADING, *ON_CAMPAIGNS])
def test_every_command_that_loads_takes_trust(command):
    found = {c.__name__: c for c in command_line.COMMAND_FUNCTIONS}[command]
    assert inspect.signature(found).parameters["trust"].default is False


def test_trust_lets_it_run(tmp_path, capsys, stranger):
    folder = written(tmp_path / "case", DUST + MARK)
    assert main(["check", str(folder), "--trust"]) == 0
    assert (folder / "ran").exists()
    assert load_case(folder, trust=True).with_values({"dust.rate": 1.0})["dust.rate"] == 1.0


def test_trust_is_for_the_folder_too(tmp_path, capsys):
    """What lies elsewhere, or where everybody may write, runs by the user's word only."""
    folder = written(tmp_path / "case", effects='["../far.py"]')
    (tmp_path / "far.py").write_text(DUST + MARK)
    assert "lies outside the folder of the case" in line_of(capsys, ["check", folder])
    (folder / "dust.py").unlink()
    (folder / "dust.py").symlink_to(tmp_path / "far.py")
    (folder / "case.toml").write_text(SMALL.format(effects='["./dust.py"]'))
    assert "lies outside the folder of the case" in line_of(capsys, ["check", folder])
    assert not (tmp_path / "ran").exists()
    for path in (".", "case.toml", "own.py"):
        (folder / "own.py").write_text(DUST)
        (folder / "case.toml").write_text(SMALL.format(effects='["own.py"]'))
        assert main(["check", str(folder)]) == 0
        capsys.readouterr()
        mode = (folder / path).stat().st_mode
        (folder / path).chmod(mode | 0o002)
        assert "everybody may write" in line_of(capsys, ["check", folder])
        (folder / path).chmod(mode)


def test_an_interrupted_run_is_resumed_by_the_same_rule(case, tmp_path, monkeypatch):
    def stop(progress, end):
        if progress.t > 0.3 * end:
            raise KeyboardInterrupt

    with pytest.raises(UserInterrupt):
        job.simulate(load_case(case), tmp_path / "out", watch=stop)
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(BadInput, match="--trust"):
        job.resume(tmp_path / "out")
    assert main(["run", "--resume", str(tmp_path / "out"), "--trust"]) == 0
    assert (tmp_path / "out" / "run.nc").is_file()


# --- effects of installed packages -------------------------------------------------------------------
@pytest.fixture
def package(tmp_path, monkeypatch):
    """A module that can be imported, and entry points that name what is in it."""
    (tmp_path / "dusty.py").write_text(DUST)
    (tmp_path / "empty.py").write_text("nothing = 1\n")
    monkeypatch.syspath_prepend(tmp_path)

    def declare(**points):
        found = [EntryPoint(name, value, user_effects.ENTRY_POINT_GROUP) for name, value in points.items()]
        monkeypatch.setattr(
            user_effects, "entry_points", lambda group: found if group == user_effects.ENTRY_POINT_GROUP else []
        )
        user_effects.find_installed_effects.cache_clear()

    yield declare
    user_effects.find_installed_effects.cache_clear()
    sys.modules.pop("dusty", None)
    sys.modules.pop("empty", None)


@pytest.mark.parametrize("value", ["dusty", "dusty:Dust"])
def test_an_installed_package_adds_its_effect(package, tmp_path, capsys, value):
    package(dust=value)
    (tmp_path / "case.toml").write_text(SMALL.format(effects='["dust"]') + "[dust]\nrate = 1.0\n")
    loaded = load_case(tmp_path)
    assert loaded.scene.acting[-1].name == "dust"
    assert loaded.own == ()
    assert main(["effects", "dust"]) == 0
    assert "abrasion dust gathers" in capsys.readouterr().out
    assert main(["effects"]) == 0
    assert "\ndust: abrasion dust" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ({"wear": "dusty:Dust"}, r"dusty:Dust takes the name 'wear' of .*the catalogue of flashtemp"),
        ({"dust": "nowhere:Dust"}, "nowhere:Dust does not load.*repair or remove"),
        ({"dust": "empty"}, "empty.py:1: contains no effect"),
        ({"dust": "empty:nothing"}, "empty:nothing is not an effect; name a subclass of Effect"),
        ({"Dust-1": "dusty"}, "'Dust-1' of dusty: use lower-case letters"),
    ],
    ids=str,
)
def test_a_package_that_cannot_be_used_is_told(package, case, points, said):
    package(**points)
    with pytest.raises(BadInput, match=said):
        load_case(case)


def test_file_and_package_of_one_name(package, case):
    package(dust="dusty")
    with pytest.raises(
        BadInput, match="dust.py: an installed package has an effect 'dust'; give the file another name"
    ):
        load_case(case)
