"""A command given in a folder of strangers' files runs none of them, and obeys no settings that lie there."""

from __future__ import annotations

import importlib.util
import json
import os
import pickle
import re
import subprocess
import sys
import textwrap
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from flashtemp.lab.jobs import JobList
from flashtemp.physics import local_settings, permissions
from flashtemp.physics.just_in_time import CACHE_FOLDER, is_cache_private, njit
from flashtemp.runs.results import current_folder
from flashtemp.runs.results.current_folder import (
    list_search_path,
    make_python_command,
    make_safe_environment,
    safe_child_environment,
)
from flashtemp.runs.results.worker_pool import open_worker_pool

ROOT = Path(__file__).parents[2]
SNARED = "snared"  # the file that a stranger's program leaves beside the folder
NAMES = sorted(
    {n for n in sys.stdlib_module_names if not n.startswith("_")}
    | {n.split(".")[0] for n in packages_distributions() if n.split(".")[0].isidentifier()}
    | {"sitecustomize", "usercustomize", "yaml", "cuda", "flashtemp"}
)
GROUPS = ("flashtemp.effects", "matplotlib.backend", "numba_extensions", "xarray.backends", "pyvista.accessors")
CASE = """
[block]
height = 0.005
[road]
depth = 0.01
[schedule]
distance = 0.02
[numerics]
cells = [10, 8, 8]
"""


def lay_traps(folder: Path) -> Path:
    """Modules under every name that may be imported, entry points, and settings; each leaves its name when it runs."""
    note = folder.parent / SNARED
    program = (
        f"import os\nos.write(os.open({str(note)!r}, os.O_WRONLY | os.O_CREAT | os.O_APPEND), __name__.encode())\n"
    )
    folder.mkdir(parents=True)
    for name in (*NAMES, "stranger"):
        (folder / f"{name}.py").write_text(program)
    (folder / "x-1.0.dist-info").mkdir()
    (folder / "x-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: x\nVersion: 1.0\n")
    points = "".join(f"[{group}]\nfan = stranger\n" for group in GROUPS)
    (folder / "x-1.0.dist-info" / "entry_points.txt").write_text(points)
    (folder / "matplotlibrc").write_text("figure.facecolor: red\nbackend: module://stranger\n")
    (folder / ".numba_config.yaml").write_text("cache_dir: stored\n")
    (folder / "checkpoint").write_text("no file of ours")
    (folder / "fields.vtkhdf").write_text("no file of ours")
    (folder / "case").mkdir()
    (folder / "case" / "case.toml").write_text(CASE)
    (folder / "image.csv").write_text("\n".join(";".join(f"{20 + i + j},5" for j in range(12)) for i in range(10)))
    return note


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("strangers") / "folder"
    lay_traps(place)
    return place


def snared(folder: Path) -> str:
    note = folder.parent / SNARED
    return note.read_text() if note.exists() else ""


AUDITED = """
import os, sys

FOLDER = os.path.realpath(os.getcwd())
NAMED = ("case", "image.csv", "out")  # what the commands name, and what lies in or begins like it
found = set()

def note(event, args):
    if event in ("open", "os.listdir", "os.scandir") and args and isinstance(args[0], (str, bytes, os.PathLike)):
        path = os.path.normpath(os.path.join(FOLDER, os.fsdecode(args[0])))
        if path.startswith(FOLDER + os.sep) and not path[len(FOLDER) + 1 :].startswith(NAMED):
            found.add(path)
    elif event == "import" and args[1] and args[1].startswith(FOLDER):
        found.add(args[1])

sys.addaudithook(note)
from flashtemp.__main__ import main

codes = []
for line in sys.argv[1:]:
    sys.argv = ["flashtemp", *line.split()]
    codes.append(main())
import json, matplotlib, numba
told = {"codes": codes, "found": sorted(found), "red": matplotlib.rcParams["figure.facecolor"], "cache": numba.config.CACHE_DIR}
os.write(2, ("TOLD " + json.dumps(told)).encode())
"""


def run_audited(folder: Path, *commands: str) -> dict:
    """Give commands in the folder, one after the other in one process; what was opened there that they do not name."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", AUDITED, *commands], cwd=folder, capture_output=True, text=True, timeout=900
    )
    assert "TOLD " in done.stderr, done.stderr
    said, _, told = done.stderr.rpartition("TOLD ")
    return json.loads(told) | {"said": said}


def assert_untouched(folder: Path, told: dict) -> None:
    assert told["codes"] == [0] * len(told["codes"]), told["said"]
    assert told["found"] == []
    assert snared(folder) == ""
    assert told["red"] == "white"
    assert told["cache"] == ""
    assert not (folder / "stored").exists()
    assert (folder / "checkpoint").read_text() == "no file of ours"


def test_commands_open_nothing_in_their_folder_but_what_they_name(folder):
    """Also in the workers of a sweep and in the resource tracker."""
    sweep = "sweep case friction.mu=0.5,0.6 --workers 2 --out out-sweep"  # which draws its picture with matplotlib
    told = run_audited(folder, "run case output.pictures=false --out out-run", sweep)
    assert_untouched(folder, told)


@pytest.mark.long
def test_commands_on_campaigns_open_nothing_else_either(folder):
    told = run_audited(
        folder,
        "run case --out out-drawn",
        "draw out-drawn",
        "report out-drawn --pdf",
        "twin case --hide none --seed 1 --conditions 2 --views profile --out out-campaign",
        "compare out-campaign --out out-compare",
        "import image.csv --look --out out-drawn/look.png",
        "discover out-campaign --out out-discover --workers 2",
        "view out-drawn --screenshot out-drawn/view.png",
    )
    assert_untouched(folder, told)


def test_a_job_of_the_page_runs_nothing_from_its_folder(folder):
    job = JobList(folder).start(["effects", "friction"])
    assert job.process.wait(60) == 0, job.log_lines()
    assert snared(folder) == ""


@pytest.mark.parametrize("paths", [":", "lib:", ".", ":/nowhere"])
def test_a_python_that_we_start_imports_nothing_from_where_it_stands(folder, paths, monkeypatch):
    """Whatever PYTHONPATH says: an empty or relative entry would mean the folder of each process."""
    monkeypatch.setenv("PYTHONPATH", paths.replace(":", os.pathsep))
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", ["", ".", str(folder), *sys.path])
    asked = "import json, socket, flashtemp.errors\nfrom importlib.metadata import entry_points\n"
    command, env = make_python_command("-c", f"{asked}print(len(entry_points(name='fan')))")
    if paths != ":":  # one process is enough for all
        assert not any(p in ("", ".", "lib", str(folder)) for p in env["PYTHONPATH"].split(os.pathsep))
        return
    done = subprocess.run(command, env=env, cwd=folder, capture_output=True, text=True)
    assert done.stdout == "0\n", done.stderr
    assert snared(folder) == ""


@pytest.mark.parametrize(
    ("entry", "named", "stays"),
    [("", "", False), (".", "", False), ("lib", "lib", False), ("HERE", "", False), ("HERE", "HERE", True),
     ("HERE/", "", False), ("ELSEWHERE", "", True)],
)  # fmt: skip
def test_the_current_folder_is_searched_only_where_pythonpath_names_it_in_full(
    entry, named, stays, tmp_path, monkeypatch
):
    here, elsewhere = tmp_path / "here", tmp_path / "elsewhere"
    here.mkdir()
    monkeypatch.chdir(here)
    entry, named = (t.replace("HERE", str(here)).replace("ELSEW" + str(here), str(elsewhere)) for t in (entry, named))
    entry = str(elsewhere) if "ELSEW" in entry else entry
    monkeypatch.setenv("PYTHONPATH", named)
    monkeypatch.setattr(sys, "path", [entry])
    assert list_search_path() == ([entry] if stays else [])
    assert make_safe_environment()["PYTHONPATH"] == (named if stays and named else "")


def test_a_checkout_that_is_not_installed_is_found_where_it_stands(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "path", [str(ROOT)])
    assert list_search_path() == [str(ROOT)]


def test_a_folder_that_was_removed_is_no_fault(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "getcwd", lambda: os.stat(tmp_path / "gone"))
    assert str(Path(os.__file__).parent) in list_search_path()


def test_the_environment_is_put_back_after_a_pool(monkeypatch):
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    monkeypatch.setenv("PYTHONPATH", "")
    before = dict(os.environ)
    with safe_child_environment():
        assert os.environ["PYTHONSAFEPATH"] == "1"
    assert dict(os.environ) == before


def test_workers_of_a_program_in_python_begin_with_a_safe_path(folder, monkeypatch):
    """A notebook searches its folder; the workers of its sweeps begin without it and then follow the notebook."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PYTHONPATH", os.pathsep)
    with open_worker_pool(eval, 2) as run:
        assert run(["__import__('sys').flags.safe_path"] * 2) == [True, True]
        assert run(["__import__('os').path.exists('matplotlibrc')"]) == [False]
    assert snared(folder) == ""


ONE_PLACE = {
    r"\[\s*sys\.executable": ["current_folder.py"],
    r"^\s*(from|import) (multiprocessing|concurrent\.futures)\b.*(Process|get_context)": ["worker_pool.py"],
    r"^\s*(from|import) numba": ["just_in_time.py"],
}


@pytest.mark.parametrize("what", ONE_PLACE)
def test_python_processes_and_compiled_loops_begin_in_one_place(what):
    files = [*(ROOT / "flashtemp").rglob("*.py"), *(ROOT / "viz").rglob("*.py")]
    assert {f.name for f in files if re.search(what, f.read_text(encoding="utf-8"), re.MULTILINE)} == {*ONE_PLACE[what]}


def test_what_the_resource_tracker_says_of_killed_processes_stays_off_the_terminal():
    """Its process outlives a parent that is killed, and would list semaphores as leaked in the middle of a prompt."""
    begun = textwrap.dedent("""
        import os, signal
        from flashtemp.runs.results import worker_pool
        from multiprocessing.resource_tracker import _resource_tracker

        with worker_pool.open_worker_pool(abs, 2) as run:
            run([-1, -2])
            print(_resource_tracker._pid, flush=True)
            os.kill(os.getpid(), signal.SIGKILL)
    """)
    command, env = make_python_command("-c", begun)
    env.pop("PYTHONWARNINGS")
    done = subprocess.run(command, env=env, capture_output=True, text=True)  # ends when the tracker has, with its pipes
    assert done.returncode == -9
    assert int(done.stdout) > 0
    assert done.stderr == ""


# --- the cache of compiled loops ---------------------------------------------------------------------
class Evil:
    """What runs when it is read by pickle."""

    def __init__(self, note: Path):
        self.note = note

    def __reduce__(self):
        return (Path.touch, (self.note,))


@pytest.fixture
def stored(tmp_path, monkeypatch):
    """A private cache folder of a function, and a way to compile that function anew."""
    file, folder = tmp_path / "loops.py", tmp_path / "cache"
    file.write_text("def twice(x):\n    return 2 * x\n")
    folder.mkdir(mode=0o700)
    monkeypatch.setenv(CACHE_FOLDER, str(folder))

    def compiled():
        is_cache_private.cache_clear()
        spec = importlib.util.spec_from_file_location("loops", file)
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "loops", module)
        spec.loader.exec_module(module)
        return njit(cache=True)(module.twice)

    assert compiled()(2) == 4
    yield folder, compiled
    is_cache_private.cache_clear()


def test_a_private_cache_is_used(stored):
    folder, compiled = stored
    again = compiled()
    assert again(3) == 6
    assert sum(again.stats.cache_hits.values()) == 1
    assert Path(again.stats.cache_path).is_relative_to(folder)


LOOSE = {
    "everybody may write the folder": lambda folder, inner: folder.chmod(0o777),
    "everybody may write a folder in it": lambda folder, inner: inner.chmod(0o777),
    "sticky, as /tmp": lambda folder, inner: inner.chmod(0o1777),
    "everybody may write an index": lambda folder, inner: next(inner.glob("*.nbi")).chmod(0o666),
}


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="Windows keeps users' folders apart by itself")
@pytest.mark.parametrize("how", LOOSE)
def test_a_prepared_index_in_a_cache_that_others_may_write_is_not_read(how, stored, tmp_path):
    folder, compiled = stored
    index = next(folder.rglob("*.nbi"))
    LOOSE[how](folder, index.parent)
    index.write_bytes(pickle.dumps(Evil(tmp_path / "ran")))
    again = compiled()
    assert again(3) == 6
    assert again.stats.cache_path is None
    assert not (tmp_path / "ran").exists()


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="Windows keeps users' folders apart by itself")
def test_a_cache_of_somebody_else_is_not_read(stored, monkeypatch):
    _, compiled = stored
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    monkeypatch.setattr(permissions, "ROOT_USER", None)  # who runs this test may be root
    assert compiled().stats.cache_path is None


def test_a_cache_folder_named_by_a_relative_path_is_not_used(stored, monkeypatch, tmp_path):
    """It would lie in the folder that the command stands in."""
    folder, compiled = stored
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(CACHE_FOLDER, folder.name)
    path = compiled().stats.cache_path
    assert path is None or not Path(path).is_relative_to(folder)
    assert not is_cache_private(folder.name)


def test_loops_are_compiled_where_no_cache_folder_can_be_written(stored, monkeypatch):
    import numba

    def none(*args, **given):
        if given.get("cache"):
            raise RuntimeError("cannot cache function 'twice': no locator available for file 'loops.py'")
        return plain(*args, **given)

    plain = numba.njit
    monkeypatch.setattr(numba, "njit", none)
    assert stored[1]()(3) == 6


def test_settings_of_the_folder_are_not_there_only_while_asked(tmp_path, monkeypatch):
    """A user's own program goes on as it was: only our commands and their processes ignore the files for good."""
    monkeypatch.chdir(tmp_path)
    for name in local_settings.LOCAL_SETTINGS_FILES:
        (tmp_path / name).write_text("")
    exists = os.path.exists
    with local_settings.without_local_settings():
        assert not any(os.path.exists(name) for name in local_settings.LOCAL_SETTINGS_FILES)
        assert os.path.exists(tmp_path / "matplotlibrc")
        with local_settings.without_local_settings():
            assert not os.path.exists("matplotlibrc")
        assert not os.path.exists("matplotlibrc")
    assert os.path.exists is exists
    assert os.path.exists("matplotlibrc")


def test_the_program_lies_where_it_is_looked_for():
    assert (Path(current_folder.PROGRAM_FOLDER) / "flashtemp" / "runs" / "results" / "current_folder.py").is_file()
