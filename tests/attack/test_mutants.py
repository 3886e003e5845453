"""The tests are tested: programs with one fault each (`mutants.toml`), and the test that must notice it."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MUTANTS = tomllib.loads((Path(__file__).parent / "mutants.toml").read_text(encoding="utf-8"))["mutant"]
KEPT = shutil.ignore_patterns(".*", "results", "build", "*.egg-info", "pictures", "benchmarks")


def each():
    return [pytest.param(m, id=m["name"].replace(" ", "-")) for m in MUTANTS]


@pytest.mark.parametrize("mutant", each())
def test_a_mutant_is_of_the_program_as_it_is(mutant):
    assert (ROOT / mutant["file"]).read_text(encoding="utf-8").count(mutant["old"]) == 1
    assert mutant["new"] != mutant["old"]
    assert (ROOT / shlex.split(mutant["tests"])[0]).is_file()


def test_there_are_enough():
    assert len(MUTANTS) >= 40
    assert len({m["name"] for m in MUTANTS}) == len(MUTANTS)


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """The project as it is installed: meshes and viz inside the package, what is compiled already with it."""
    root = tmp_path_factory.mktemp("mutants") / "project"
    shutil.copytree(ROOT, root, ignore=KEPT)
    for inner in ("meshes", "viz"):
        shutil.copytree(root / inner, root / "flashtemp" / inner)
    return root


def ended(root: Path, tests: str) -> subprocess.CompletedProcess[str]:
    """The tests, asked of the copy."""
    words = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", "", *shlex.split(tests)]
    path = os.pathsep.join([str(root), str(root / "tests")])
    return subprocess.run(words, cwd=root, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True)


@pytest.mark.long
@pytest.mark.parametrize("mutant", each())
def test_a_mutant_is_noticed(copy, mutant, record_property):
    file, source = copy / mutant["file"], (ROOT / mutant["file"]).read_text(encoding="utf-8")
    file.write_text(source.replace(mutant["old"], mutant["new"]), encoding="utf-8")
    try:
        done = ended(copy, mutant["tests"])
    finally:
        shutil.copy2(ROOT / mutant["file"], file)
    assert done.returncode == 1, done.stdout[-2000:] + done.stderr[-2000:]  # 1: tests ran, and some failed
    record_property("mutants noticed", mutant["name"])


@pytest.mark.long
def test_the_copy_without_a_fault_passes(copy):
    for tests in sorted({m["tests"] for m in MUTANTS}):
        done = ended(copy, tests)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
