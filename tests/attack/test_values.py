"""Wrong values of every key: a case either loads or says in one line each what is wrong; nothing else ever comes out."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from flashtemp.errors import BadInput
from flashtemp.model.case import load_case
from flashtemp.model.schema import CASE_TABLES, COMMAND_TABLES
from flashtemp.physics.effect import catalogue

WRONG = (
    0, -1, 1, 0.5, -0.5, 7, 1e308, -1e308, 5e-324, 1e-30, 1e30, float("nan"), float("inf"), -float("inf"), 10**400, -(10**400),
    True, False, "", "x", "inf", "nan", "1e3", "0,1", "..", "/", "a\x00b", "\x1b[31m", "x" * 5000, "case.toml", "true",
    [], [0], [[]], [1, "a"], [[1, 2], [3]], [[0, 1], [1, float("nan")]], [1e400, 2], [[10**400, 1], [2, 3]], {}, {"a": 1},
    {"value": 1}, {"contact_size": -1, "contact_share": 2}, [True, False], ["x", "y"], [None], (1, 2), None,
)  # fmt: skip
SEED, QUICK = 1, 75


def attacks() -> list[tuple[str, str, object]]:
    """(effect or "", key, wrong value), every one."""
    tables = {t: (("",), keys) for t, keys in (CASE_TABLES | COMMAND_TABLES).items()}
    keys = [("", f"{t}.{k}") for t, (_, declared) in tables.items() for k in declared]
    keys += [("", "title"), ("", "free"), ("", "effects"), ("", "candidates"), ("", "materials.tread_rubber.density")]
    for name, effect in catalogue().items():
        listed = "" if effect.base else name
        keys += [(listed, f"{effect.section if effect.base else name}.{k}") for k in effect.params()]
    return [(effect, key, value) for effect, key in keys for value in WRONG]


def outcome(folder, effect: str, key: str, value: object) -> str:
    """How a case with one wrong value ends, in a word; a fault that nobody is told about raises."""
    given = {key: value} | ({"effects": [effect]} if effect and key != "effects" else {})
    try:
        load_case(folder, given)
    except BadInput as fault:
        good = all(line and len(line) < 600 and "\n" not in line for line in fault.lines)
        return "told" if good else f"not one line: {fault.lines}"[:300]
    return "taken"


def attack(folder, tried) -> Counter:
    """Every outcome with how often it came."""
    found, wrong = Counter(), []
    for effect, key, value in tried:
        try:
            ended = outcome(folder, effect, key, value)
        except Exception as fault:
            ended = repr(fault)[:300]
        found[ended] += 1
        if ended not in ("told", "taken"):
            wrong.append((key, repr(value)[:60], ended))
    assert not wrong, f"{len(wrong)} of {len(tried)}: {wrong[:20]}"
    return found


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "case.toml").write_text('title = "attacked"\n', encoding="utf-8")
    return tmp_path


def test_some_wrong_values(folder):
    found = attack(folder, random.Random(SEED).sample(attacks(), QUICK))
    assert found["told"] > QUICK / 2
    assert found["taken"] > 0  # about one in seventeen
