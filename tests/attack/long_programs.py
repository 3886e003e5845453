"""The long attack on the program itself: every wrong value of every key, and faults put into it for the tests to notice."""

from __future__ import annotations

import os
import random
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import test_mutants
import test_values

ROOT = Path(__file__).parents[2]
LEFT_OUT = shutil.ignore_patterns(".*", "*.egg-info", "__pycache__")
LEFT_OUT_AT_THE_TOP = {"results", "build"}


def ignored_names(folder: str, names: list[str]) -> set[str]:
    """Names in a folder of the project that a copy of it does without."""
    return LEFT_OUT(folder, names) | (LEFT_OUT_AT_THE_TOP & set(names) if Path(folder) == ROOT else set())


def some(all_: list, seed: int, share: float) -> list:
    """A share of a list, drawn at random; all of it at 1."""
    return all_ if share >= 1.0 else random.Random(seed).sample(all_, max(1, round(share * len(all_))))


def values(row, seed: int, share: float) -> None:
    """A case with one wrong value either loads or says in one line each what is wrong."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "case.toml").write_text('title = "attacked"\n', encoding="utf-8")
        for effect, key, value in some(test_values.attacks(), seed, share):
            try:
                ended = test_values.outcome(Path(folder), effect, key, value)
            except Exception as fault:
                ended = repr(fault)
            row.count(ended[:40], "" if ended in ("told", "taken") else f"{key} = {value!r:.60}: {ended[:200]}")


def mutants(row, seed: int, share: float) -> None:
    """A program with one fault fails the test that is there to notice it; without one it passes them all."""
    with tempfile.TemporaryDirectory() as folder:
        copy = _copied(Path(folder) / "project")
        for mutant in some(test_mutants.MUTANTS, seed, share):
            file, source = copy / mutant["file"], (ROOT / mutant["file"]).read_text(encoding="utf-8")
            sound = _ended(copy, mutant["tests"])
            file.write_text(source.replace(mutant["old"], mutant["new"]), encoding="utf-8")
            ended = _ended(copy, mutant["tests"])
            shutil.copy2(ROOT / mutant["file"], file)
            noticed = (sound, ended) == (0, 1)  # 1: tests ran, and some failed
            row.count("noticed" if noticed else "survived", "" if noticed else f"{mutant['name']}: {sound}, {ended}")


def _copied(root: Path) -> Path:
    """The project as it is installed: meshes and viz inside the package, what is compiled already with it."""
    shutil.copytree(ROOT, root, ignore=ignored_names)
    for inner in ("meshes", "viz"):
        shutil.copytree(root / inner, root / "flashtemp" / inner)
    return root


def _ended(root: Path, tests: str) -> int:
    """Exit code of tests asked of a copy."""
    words = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", "", *shlex.split(tests)]
    path = os.pathsep.join([str(root), str(root / "tests")])
    return subprocess.run(words, cwd=root, env=os.environ | {"PYTHONPATH": path}, capture_output=True).returncode


CLASSES = {"wrong values of keys": values, "mutants of the program": mutants}
