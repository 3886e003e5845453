"""Other operating systems, by taking away here what they lack: Windows has no fcntl, no alarm; macOS no fallocate."""

from __future__ import annotations

import ast
import fcntl
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from flashtemp.cli import interrupts
from flashtemp.errors import BadInput
from flashtemp.runs.results import processes, result_folder

ROOT = Path(__file__).parents[2]
CASE = """title = "Z\u00fcrich \u8eca"
[schedule]
distance = 0.02
[numerics]
mesh = 0.2
[output]
pictures = false
vtk = false
"""
WINDOWS = """
import concurrent.futures.process, multiprocessing.context, mmap, os, random, signal, subprocess, sys, tempfile, types
locked = []
sys.modules |= dict.fromkeys(("fcntl", "resource", "pwd", "grp", "termios"))
sys.modules["msvcrt"] = types.SimpleNamespace(LK_LOCK=1, LK_NBLCK=2, locking=lambda *given: locked.append(given))
for place, names in {
    os: ("fork", "geteuid", "getuid", "posix_fallocate", "killpg", "statvfs", "sched_getaffinity"),
    signal: ("SIGALRM", "SIGKILL", "SIGHUP", "setitimer", "ITIMER_REAL", "pthread_sigmask", "SIG_BLOCK", "SIG_SETMASK"),
    mmap: ("MADV_DONTNEED",),
}.items():
    for name in names:
        if hasattr(place, name):
            delattr(place, name)
from flashtemp.__main__ import main
code = main()
assert locked, "nothing was locked"
sys.exit(code)
"""


def _wait(seconds: float) -> None:
    """In small steps: a signal that comes by another thread ends no longer sleep."""
    for _ in range(int(100 * seconds)):
        time.sleep(0.01)


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """A run where all that is taken away, on a terminal that knows ASCII alone: its folder, and what it said."""
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "case.toml").write_text(CASE, encoding="utf-8")
    words = [sys.executable, "-c", WINDOWS, "run", str(folder / "case.toml"), "--out", str(folder / "out")]
    env = os.environ | {"PYTHONIOENCODING": "ascii"}
    return folder, subprocess.run(words, capture_output=True, text=True, env=env)


def test_a_run_asks_for_nothing_that_windows_or_macos_lack(elsewhere):
    folder, seen = elsewhere
    assert seen.returncode == 0, seen.stderr
    assert sorted(p.name for p in folder.iterdir()) == ["case.toml", "out"]
    assert (folder / "out" / "run.nc").is_file()


def test_two_runs_keep_out_of_each_others_folder_without_fcntl(tmp_path, monkeypatch):
    """The lock lies elsewhere: Windows renames no folder in which a file is open."""

    def locking(file, mode, size):
        fcntl.flock(file, fcntl.LOCK_EX | (0 if mode == 1 else fcntl.LOCK_NB))

    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(LK_LOCK=1, LK_NBLCK=2, locking=locking))
    lock = result_folder.lock_folder(tmp_path)
    assert not Path(os.readlink(f"/proc/self/fd/{lock}")).is_relative_to(tmp_path)
    with pytest.raises(BadInput, match="another run is writing"):
        result_folder.lock_folder(tmp_path)
    os.close(lock)
    os.close(result_folder.lock_folder(tmp_path))


def test_a_second_run_in_a_locked_folder_is_refused(tmp_path):
    lock = result_folder.lock_folder(tmp_path)
    with pytest.raises(BadInput, match="another run is writing"):
        result_folder.lock_folder(tmp_path)
    os.close(lock)


def test_a_signal_that_has_to_wait_comes_again_without_an_alarm(monkeypatch):
    monkeypatch.setattr(interrupts, "ALARM", None)
    monkeypatch.delattr(signal, "setitimer")
    loading = SimpleNamespace(f_code=SimpleNamespace(co_filename="<frozen importlib._bootstrap>"), f_back=None)
    with interrupts.answer_interrupts() as state:
        state.handle_signal(signal.SIGINT, loading)
        with pytest.raises(KeyboardInterrupt):
            _wait(5.0)


def test_the_page_stops_a_command_by_what_the_system_has(monkeypatch):
    sent = []
    monkeypatch.setattr(os, "kill", lambda *given: sent.append(given))
    processes.interrupt_process(7)
    monkeypatch.setattr(signal, "CTRL_BREAK_EVENT", 1, raising=False)
    processes.interrupt_process(7)
    assert sent == [(7, signal.SIGINT), (7, 1)]


def test_letters_that_a_terminal_has_not_are_escaped(elsewhere):
    assert r"Z\xfcrich \u8eca" in elsewhere[1].stdout


def test_the_version_is_told_where_git_is_the_only_program(tmp_path):
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("no checkout of git")
    command = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools_scm"][
        "git_describe_command"
    ]
    (tmp_path / command[0]).symlink_to(git)
    seen = subprocess.run(command, cwd=ROOT, env={"PATH": str(tmp_path)}, capture_output=True, text=True)
    assert seen.stdout.startswith("v"), seen.stderr


FILES = [p for folder in ("flashtemp", "meshes", "viz") for p in sorted((ROOT / folder).rglob("*.py"))]


def test_every_text_file_is_read_and_written_in_utf_8():
    """Windows takes its code page where nothing is said."""
    bare = []
    for file in FILES:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            said = {k.arg for k in node.keywords}
            modes = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
            binary = any(set(m) <= set("rwab+x") and "b" in m for m in modes)
            opens = (name in ("read_text", "write_text") and isinstance(node.func, ast.Attribute)) or (
                name == "open" and not binary and (modes and set(modes[-1]) <= set("rwa+x"))
            )
            if opens and "encoding" not in said and None not in said:
                bare.append(f"{file.relative_to(ROOT)}:{node.lineno}")
    assert bare == []
