"""What CONTRIBUTING.md tells a newcomer is there: paths, make targets, commands, hooks, and the folders of the tests."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
QUOTED = re.findall(r"`([^`\n]+)`", TEXT)
INSTALLED = ".venv/bin/"  # is made by the Makefile
TARGETS = set(re.findall(r"^([a-z]+):.*## ", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))


def paths() -> list[str]:
    """Quoted words that name a file or folder of the project, as glob patterns."""
    found = [w for q in QUOTED for w in q.split() if "/" in w or re.search(r"\.(md|toml|py|yaml)$", w)]
    found = [w for w in found if not w.startswith(INSTALLED) and "=" not in w]
    return sorted({re.sub(r"NAME|MAKER", "*", w) for w in found})


@pytest.mark.parametrize("path", paths())
def test_path_exists(path):
    assert list(ROOT.glob(path.rstrip("/")))


def test_there_are_paths():
    assert {"docs/how_to/effects.md", "cases/*/expected.toml", "viz/run/*.py", "CHANGELOG.md"} <= set(paths())


@pytest.mark.parametrize("target", sorted(set(re.findall(r"(?:`|^ +|=1 )make ([a-z]+)", TEXT, re.M))))
def test_make_target_is_there(target):
    assert target in TARGETS


def test_every_target_that_a_contributor_needs_is_told():
    assert {"test", "coverage", "lint", "help"} <= set(re.findall(r"make ([a-z]+)", TEXT))


def test_commands_of_flashtemp_are_there():
    told = sorted(set(re.findall(r"`flashtemp ([a-z]+)", TEXT)))
    assert told
    for command in told:
        done = subprocess.run([sys.executable, "-m", "flashtemp", command, "--help"], capture_output=True, text=True)
        assert done.returncode == 0, command


def test_every_test_file_stands_in_a_folder_of_the_table():
    told = re.findall(r"^\| `tests/(\w+)` \|", TEXT, re.M)
    assert sorted(told) == sorted({f.parent.name for f in (ROOT / "tests").rglob("test_*.py")})
    assert all(f.parent.parent == ROOT / "tests" for f in (ROOT / "tests").rglob("test_*.py"))


def test_what_is_named_inside_files_is_there():
    """Names that the steps tell to look for."""
    for file, names in {
        "flashtemp/camera/importing/formats/tiff.py": ("MAGIC", "def read(file: CameraFile) -> Iterator[RawFrames]"),
        "flashtemp/camera/importing/formats/camera_file.py": ("class CameraFile", "def read_all"),
        "viz/__init__.py": ("PICTURE", "ANIMATION", "applies"), "viz/theme.py": ("def styled",), "tests/camera/test_formats.py": ("KINDS",),
        "tests/conftest.py": ("def lab",), "tests/model/test_cases.py": ("FLASHTEMP_FULL",), "CHANGELOG.md": ("Unreleased",),
    }.items():  # fmt: skip
        text = (ROOT / file).read_text(encoding="utf-8")
        assert [n for n in names if n not in text] == [], file


def test_hooks_and_continuous_integration_run_what_lint_runs():
    """The same three programs by hand, with every commit and on the server; nothing is fetched for the hooks."""
    makefile, hooks, ci = ((ROOT / f).read_text() for f in ("Makefile", ".pre-commit-config.yaml", ".ci/run"))
    lint = re.search(r"^lint:.*\n((?:\t.*\n)+)", makefile, re.M)[1]
    for program in ("ruff check", "ruff format", "mypy flashtemp"):
        assert f"{INSTALLED}{program}" in lint
        assert f"entry: {INSTALLED}{program}" in hooks
    assert re.findall(r"repo: (\S+)", hooks) == ["local"]
    assert {"language: system", "language: pygrep"} == set(re.findall(r"language: \w+", hooks))
    assert re.findall(r"^make (?:--\S+ )*([^#\n]+?) *(?:#.*)?$", ci, re.M) == [
        ".venv/.ready .venv/.docs",
        "lint docs",
        "test",
        "bench-smoke",
    ]
