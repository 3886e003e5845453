"""What effects may name is one table: a typo is refused, the engine asks for nothing else, the docs are made from it."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

import flashtemp.physics
from flashtemp.errors import BadInput
from flashtemp.meshes import block_on_road
from flashtemp.model.scene import ActiveEffect
from flashtemp.physics import Deposit, Effect, Factor, Heat, Term, catalogue, contribution_check
from flashtemp.physics.quantities import CAMERA_QUANTITIES, QUANTITIES, SITES

ROOT = Path(__file__).parents[2]
HERE = f"{Path(__file__).name}:"


def one(T, now, p):
    return 1.0


class Stated(Effect):
    """Contributions that a test states."""

    def __init__(self, *parts):
        self.parts = parts

    def heat(self, scene, p):
        yield from self.parts

    def see(self, p):
        yield from self.parts


@pytest.mark.parametrize(
    ("part", "said", "remedy"),
    [
        (Factor("friction.my", one), 'Factor("friction.my")', "did you mean 'friction.mu'?"),
        (Term("contact.presure", one), 'Term("contact.presure")', "did you mean 'contact.pressure'?"),
        (Term("camera.lag", one), 'Term("camera.lag")', "yield it from see()"),
        (Heat.film("block.leeding", one), 'Heat.film("block.leeding")', "did you mean 'block.leading'?"),
        (Heat.patch("road.fre", one), 'Heat.patch("road.fre")', "did you mean 'road.free'?"),
        (Heat.patch("block", one), "no such patch", "block."),
        (Heat.zone("blok", one), 'Heat.zone("blok")', "did you mean 'block'?"),
        (Heat.zone("road.free", one), "no such zone", "road"),
        (Heat("flim", "block.face", one), "'flim'", "Heat.film"),
        (Deposit(-0.1, 1e-4), "-0.1", "from 0 to 1"),
        (Deposit(0.1, 0.0), "0.0", "> 0 in m"),
        (Deposit(float("nan"), 1e-4), "nan", "from 0 to 1"),
        (one, "heat() yields", "Heat, Term, Factor or Deposit"),
    ],
    ids=lambda v: v if isinstance(v, str) else type(v).__name__,  # a law's address would differ between processes
)
def test_typo_on_the_balance_is_refused(part, said, remedy):
    with pytest.raises(BadInput) as fault:
        ActiveEffect("fan", Stated(part), SimpleNamespace()).contributions(None)
    [line] = fault.value.lines
    assert line.startswith("effects: effect 'fan'")
    assert said in line
    assert remedy in line
    if hasattr(part, "law"):
        assert f"{HERE}{one.__code__.co_firstlineno}" in line


@pytest.mark.parametrize(
    ("part", "said", "remedy"),
    [
        (Term("camera.gain", one), 'Term("camera.gain")', "known are|did you mean"),
        (Term("camera.blurr", one), 'Term("camera.blurr")', "did you mean 'camera.blur'"),
        (Term("friction.mu", one), 'Term("friction.mu")', r"yield it from heat\(\)"),
        (Factor("camera.blur", one), "Factor", "yield a Term"),
    ],
    ids=lambda v: v if isinstance(v, str) else type(v).__name__,  # a law's address would differ between processes
)
def test_typo_on_the_camera_is_refused(part, said, remedy):
    with pytest.raises(BadInput) as fault:
        contribution_check.check_camera_contributions("fan", Stated(part), None)
    [line] = fault.value.lines
    assert said in line
    assert re.search(remedy, line)


def test_a_method_that_fails_is_told_with_its_line():
    class Broken(Effect):
        def heat(self, scene, p):
            yield Heat.film("block.leading", lambda now, p: p.h)
            yield Heat.film("block.leading", p.nothing)

    with pytest.raises(BadInput, match=rf"effect 'fan' \(.*{HERE}\d+\): heat\(\) fails: AttributeError.*repair"):
        ActiveEffect("fan", Broken(), SimpleNamespace()).contributions(None)


def test_the_catalogue_loads_with_a_typo_refused(tmp_path, monkeypatch):
    """A wrong name in a file is told when a case is loaded, with the case's own line."""
    from flashtemp.model.case import load_case

    (tmp_path / "case.toml").write_text('\neffects = ["stick_slip"]\n')
    assert load_case(tmp_path).effects == ("stick_slip",)
    monkeypatch.setattr(catalogue()["stick_slip"], "heat", lambda self, scene, p: iter([Factor("friction.my", one)]))
    with pytest.raises(BadInput, match=r"case.toml:2: effects: effect 'stick_slip' \(.*friction.my.*'friction.mu'"):
        load_case(tmp_path)


def test_sites_are_those_of_the_mesh():
    patches = set(block_on_road.build(0.025, 0.007, 0.01, cells=(10, 8, 6)).patches)
    assert {s.name for s in SITES.values() if not s.zone} == patches


def test_the_engine_asks_for_what_is_in_the_table():
    """Every quantity named in the engine is in the table, every one of the table is asked for, with the base told."""
    text = "".join(f.read_text() for d in ("model", "solver") for f in (ROOT / "flashtemp" / d).glob("*.py"))
    asked = re.findall(r'(?:laws|law|laws_mean)\((?:[\w.]+, )?f?"([a-z_]+\.[a-z_{}]+)"(?:,[^)]*?\b(\d\.\d)\b)?', text)
    whole = [(name, base) for name, base in asked if "{" not in name]
    assert {name for name, _ in whole} <= set(QUANTITIES)
    assert len(whole) >= 15
    numbers = [(base, QUANTITIES[name].base) for name, base in whole if base and QUANTITIES[name].base in ("0", "1")]
    assert len(numbers) >= 10
    assert all(float(base) == float(told) for base, told in numbers)
    words = set(re.findall(r"[a-z_]+", text))
    assert all(set(name.split(".")) <= words for name in QUANTITIES)
    seen = (ROOT / "flashtemp" / "camera" / "prediction" / "observation.py").read_text()
    assert all(re.search(rf'camera\("{name[7:]}"|self\("{name[7:]}"|shift_', seen) for name in CAMERA_QUANTITIES)


def test_every_quantity_is_told():
    for quantity in (*QUANTITIES.values(), *CAMERA_QUANTITIES.values()):
        assert quantity.unit
        assert quantity.base
        assert quantity.about


def test_reference_lists_every_quantity_and_site(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    import reference_pages

    page = reference_pages.quantities()
    for name in (*QUANTITIES, *CAMERA_QUANTITIES, *SITES):
        assert page.count(f"| `{name}` |") == 1


def test_face_for_effect_writers():
    for name in flashtemp.physics.__all__:
        assert getattr(flashtemp.physics, name) is not None
    assert {"Effect", "Param", "Heat", "Factor", "Term", "Deposit", "Curve", "Surface", "KELVIN", "catalogue"} == set(
        flashtemp.physics.__all__
    )
