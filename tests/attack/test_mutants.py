"""Programs with one fault each (`mutants.toml`), for `make attack` to see that a test notices: each is still possible."""

from __future__ import annotations

import shlex
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MUTANTS = tomllib.loads((Path(__file__).parent / "mutants.toml").read_text(encoding="utf-8"))["mutant"]


@pytest.mark.parametrize("mutant", MUTANTS, ids=[m["name"].replace(" ", "-") for m in MUTANTS])
def test_a_mutant_is_of_the_program_as_it_is(mutant):
    assert (ROOT / mutant["file"]).read_text(encoding="utf-8").count(mutant["old"]) == 1
    assert mutant["new"] != mutant["old"]
    assert (ROOT / shlex.split(mutant["tests"])[0]).is_file()


def test_there_are_enough():
    assert len(MUTANTS) >= 40
    assert len({m["name"] for m in MUTANTS}) == len(MUTANTS)
