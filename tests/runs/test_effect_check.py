"""`flashtemp effects --check FILE`: whatever breaks one rule of the catalogue is told, with its line and its remedy."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import flashtemp
from flashtemp.__main__ import main
from flashtemp.errors import BadInput
from flashtemp.physics.user_effects import read_effect
from flashtemp.runs.checks.effect_check import heat_balance_checks, run_checks
from flashtemp.runs.checks.effect_check.fixtures import EffectUnderTest, SceneCache
from flashtemp.runs.checks.effect_check.run_checks import run_all_checks
from flashtemp.runs.checks.effect_check.source_checks import find_unit_fault

DOCS = Path(__file__).parents[2] / "docs" / "how_to" / "effects.md"
SOUND = '''"""Friction falls as the contact warms.

>>> from types import SimpleNamespace as N
>>> [law] = Own().heat(None, None)
>>> law.law(310.0, N(ambient=300.0), N(b=0.01))
0.9
"""

import numpy as np

from flashtemp.physics import Effect, Factor, Heat, Param, Term


class Own(Effect):
    """Linear fall of friction with the rise in the spots."""

    cause = "friction falls with temperature"
    source = "own measurement"
    tells = ("friction falls within a repetition",)

    b = Param(0.005, "1/K", "relative fall per kelvin", low=0.0, high=0.01, off=0.0)

    def heat(self, scene, p):
        yield Factor("friction.mu", lambda T, now, p: 1.0 - p.b * (T - now.ambient))
'''
LAW = '        yield Factor("friction.mu", lambda T, now, p: 1.0 - p.b * (T - now.ambient))\n'
RISE = "(T - now.ambient)"
BROKEN = {  # what is written instead, where it is told, and in which words
    "abs": (RISE, "abs(T - now.ambient)", "derivatives", r"own.py:24: abs\(\) has no complex deriv.*sqrt\(x\*x \+ tiny\)"),
    "real": (RISE, "np.real(T - now.ambient)", "derivatives", r"own.py:24: real\(\) has no .*condition of where only"),
    "interp": (RISE, "np.interp(T, [0.0, 9e2], [0.0, 9.0])", "laws", r"own.py:24: interp\(\) .*Curve\(xs, ys\)\(x\)"),
    "max": (RISE, "max(T - now.ambient, 0.0)", "laws", r"own.py:24: max\(\) .*where\(real\(x\) > bound, x, bound\)"),
    "if": (RISE, "(T if T > 300.0 else 300.0)", "laws", r"own.py:24: `if`.*where\(real\(x\) > 0, a, b\)"),
    "math": ("p.b * (T", "__import__('math').exp(-p.b) * (T", "off", r"own.py:24: .* with all parameters off; it must then be"),
    "parameter": ("- p.b *", "- p.bb *", "laws", r"own.py:24: p has no 'bb'"),
    "moment": ("now.ambient))\n", "now.ambeint))\n", "laws", r"own.py:24: now has no 'ambeint'"),
    "quantity": ('"friction.mu"', '"friction.my"', "loads", r"own.py:24.*friction.my.*did you mean 'friction.mu'"),
    "patch": (LAW, '        yield Heat.film("block.hodler", lambda now, p: p.b)\n', "loads", "did you mean 'block.holder'"),
    "film": (LAW, '        yield Heat.film("block.holder", lambda T, now, p: p.b)\n', "laws", r"own.py:24: .*coefficient\(now, p\)"),
    "cooling": (LAW, '        yield Heat.film("block.holder", lambda now, p: -p.b)\n', "laws", r"own.py:24: .* give >= 0"),
    "mean": (RISE, "(T.mean() - now.ambient)", "pointwise", r"own.py:24: .*its own point only: no mean, max or sum"),
    "random": (RISE, "np.random.default_rng().normal(T)", "laws", r"own.py:24: "),
    "memory": (RISE, "(lambda s: s.append(0) or len(s))(self.__dict__.setdefault('s', [])) * 1e-6 * T", "repeatable", "own.py:24: .*keeps nothing"),
    "rest": (RISE, "(now.speed / 0.1) ** -0.5", "ends", r"own.py:24: divides by zero where the speed is 0; .*max\(now.speed, 1e-4\)"),
    "pressure": (RISE, "(now.local_pressure / 1e5) ** -0.5", "ends", "own.py:24: .*local pressure is 0; .*where"),
    "range": ("1.0 - p.b * (T", "1.0 - (p.b / (p.b - 0.01)) * 1e-9 * (T", "ends", r"own.py:24: divides by zero where b = 0.01; .*open_low"),
    "off": ("off=0.0)", "off=0.001)", "off", r"own.py:24: Factor\(\"friction.mu\"\) is 0.9.* it must then be exactly 1"),
    "no off": (", off=0.0)", ")", "parameters", "no parameter can switch the effect off"),
    "nothing": ("p.b * (T", "0.0 * p.b * (T", "acts", "changes nothing in the small case.*look for a typo"),
    "source": ('    source = "own measurement"\n', "", "words", r"own.py:14: no source; add source = "),
    "tells": ('("friction falls within a repetition",)', '"friction falls"', "words", "tells is 'friction falls'; .*tuple"),
    "unit": ('"1/K"', '"1/°C"', "parameters", r"own.py:21: b: unit '1/°C'; write degC"),
    "no unit": ('"1/K"', '""', "parameters", r"own.py:21: b: no unit; give one"),
    "bounds": ("high=0.01", "high=0.001", "parameters", r"own.py:21: b: its default 0.005 is out of bounds; .*<= 0.001"),
    "about": ('"relative fall per kelvin"', '""', "parameters", "own.py:21: b: not explained"),
    "unused": ("    def heat", '    c = Param(1.0, "1", "a number", low=0.0, high=2.0)\n\n    def heat', "parameters", "own.py:23: c is in no law"),
    "example": ("\n0.9\n", "\n0.8\n", "example", "own.py:5: .* gives 0.9, the example says 0.8"),
    "no example": (">>> ", "", "example", "own.py:1: no example"),
    "import": ("import numpy as np\n", "import numpy as np\nimport pytest\n", "imports", "own.py:10: imports pytest; .*numpy"),
}  # fmt: skip

ALONE = {
    look.__name__.removeprefix("check_"): lambda trial, bench, look=look: look(trial) for look in run_checks.FILE_CHECKS
}  # spares the runs
ALONE |= {
    "off": run_checks.check_off,
    "acts": lambda trial, bench: heat_balance_checks.check_default_change(bench, trial),
}


@pytest.fixture(scope="module")
def bench():
    return SceneCache()


@pytest.fixture
def look(tmp_path, bench):
    """Findings on a text as own.py, by name."""

    def at(text: str, values=(), only: str = ""):
        file = tmp_path / "own.py"
        file.write_text(text, encoding="utf-8")
        trial = EffectUnderTest("own", read_effect(file), dict(values))
        if only not in ALONE:
            return {f.name: f for f in run_all_checks(trial, bench)}
        return {only: ALONE[only](trial, bench)}

    return at


def test_a_sound_effect_passes(look):
    found = look(SOUND)
    assert [f for f in found.values() if not f.ok] == []
    assert {"example", "derivatives", "off", "jacobian", "energy", "acts"} <= set(found)


@pytest.mark.parametrize("rule", BROKEN)
def test_a_broken_rule_is_told(look, rule):
    right, wrong, name, says = BROKEN[rule]
    assert right in SOUND
    found = look(SOUND.replace(right, wrong), only=name)  # of its own check where that needs no runs
    assert name in found, list(found)
    assert not found[name].ok
    assert re.search(says, found[name].says), found[name].says
    assert "Traceback" not in found[name].says


def test_values_show_what_acts_only_beyond_the_small_case(look):
    late = SOUND.replace(RISE, "np.where(np.real(T) > p.b * 2e5, 1.0, 0.0)").replace("high=0.01", "high=0.5")
    late = late.replace("310.0, N(ambient=300.0), N(b=0.01)", "310.0, N(), N(b=0.0)").replace(
        "0.9\n", "np.float64(1.0)\n"
    )
    assert not look(late, only="acts")["acts"].ok
    assert look(late, {"own.b": 0.00147}, only="acts")["acts"].ok


def test_camera_effect(look):
    text = SOUND.replace(LAW, '        yield Term("camera.offset", lambda T, now, p: p.b * now.repetition)\n')
    text = text.replace("def heat(self, scene, p)", "def see(self, p)").replace(
        "Own().heat(None, None)", "Own().see(None)"
    )
    text = text.replace("310.0, N(ambient=300.0), N(b=0.01)", "None, N(repetition=2), N(b=0.45)")
    assert all(f.ok for f in look(text).values())
    assert "camera.offset" in look(text.replace("p.b * now", "1.0 + p.b * now"))["off"].says
    assert "typo" in look(text.replace("p.b * now", "0.0 * p.b * now"))["acts"].says
    assert "did you mean 'camera.offset'" in look(text.replace("camera.offset", "camera.ofset"))["loads"].says


@pytest.mark.long
def test_the_example_of_the_docs_passes(tmp_path, capsys):
    text = next(b for b in re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.S) if "class Dust" in b)
    (tmp_path / "dust.py").write_text(text)
    assert main(["effects", "--check", str(tmp_path / "dust.py")]) == 0
    told = capsys.readouterr()
    assert told.out.endswith("all checks pass\n")
    shown = DOCS.read_text().split("flashtemp effects --check dust.py", 1)[1].split("```")[0]
    for line in shown.strip().splitlines()[1:]:  # what the docs show is what is said
        assert re.sub(r"[\d.]+(e-\d+)?", "#", line) in re.sub(r"[\d.]+(e-\d+)?", "#", told.out), line


def test_exit_code_and_table(tmp_path, capsys):
    file = tmp_path / "own.py"
    file.write_text(SOUND.replace('"friction.mu"', '"friction.my"'))
    assert main(["effects", "--check", str(file), "--json"]) == 2
    told = capsys.readouterr()
    table = json.loads(told.out)
    assert (table["effect"], table["ok"], told.err) == ("own", False, "")
    assert [f["name"] for f in table["findings"] if not f["ok"]] == ["loads"]
    assert all(set(f) == {"name", "ok", "says"} and f["says"] for f in table["findings"])
    assert main(["effects", str(file)]) == 0
    assert capsys.readouterr().out.startswith("own: friction falls with temperature\n    own.b = 0.005 1/K")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (SOUND + SOUND[SOUND.index("\nclass") :].replace("Own", "Other"), "contains 2 effects.*a file of its own"),
        ("x = 1\n", "contains no effect"),
        ("from flashtemp import nosuch\n", "own.py:1: does not run"),
        ("def law(:\n", "own.py:1: "),
    ],
)
def test_a_file_without_one_effect(tmp_path, text, says):
    file = tmp_path / "own.py"
    file.write_text(text)
    checked = flashtemp.check_effect(file)
    assert [f.name for f in checked.findings] == ["file"]
    assert not checked.ok
    assert re.search(says, str(checked)), str(checked)
    assert "FAILS" in checked._repr_html_()


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (["--check"], "give a FILE.py"),
        (["--check", "nosuch.py"], "nosuch.py: no such file"),
        (["--check", "wera"], "did you mean 'wear'"),
        (["wear", "friction.mu=1"], "goes with --check"),
    ],
)
def test_what_cannot_be_checked(capsys, asked, says):
    assert main(["effects", *asked]) == 2
    assert says in capsys.readouterr().err


def test_values_that_cannot_be(tmp_path):
    file = tmp_path / "own.py"
    file.write_text(SOUND)
    said = str(flashtemp.check_effect(file, {"own.b": 7.0}))
    assert re.search(r"FAILS  loads .*own.b.* 7.0; give a number >= 0 and <= 0.01", said), said
    with pytest.raises(BadInput, match="not an override"):
        flashtemp.check_effect(file, ["own.b"])


@pytest.mark.parametrize(
    "unit", ["1", "m2/N", "W/m2K/(m/s)^0.8", "rad/(N m)", "rad/s, Pa, Pa", "J/kgK", "mm", "1/(K s)"]
)
def test_units(unit):
    assert find_unit_fault(unit) is None


@pytest.mark.parametrize("unit", ["C", "%", "watts", "W/m²K", "m/sec", "°C"])
def test_units_that_nobody_else_writes(unit):
    assert "write" in find_unit_fault(unit)
