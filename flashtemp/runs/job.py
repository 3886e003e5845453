"""One job from case to result folder (run.nc, summary.json, VTK): whole or absent, resumable, re-runnable."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from flashtemp.errors import BadInput, Interrupted
from flashtemp.model import case as cases
from flashtemp.runs import inert, vtk
from flashtemp.runs.checkpoint import CHECKPOINT, FRAMES, load, save
from flashtemp.runs.folders import partial, stoppable
from flashtemp.solver.field_store import Frames
from flashtemp.solver.march import march
from flashtemp.solver.progress import Progress
from flashtemp.solver.run import Run

LOCK = ".lock"
EVERY = 30.0  # s of wall time between checkpoints
Draw = Callable[[Run, Path, bool, Callable[[str], None]], None]  # pictures of a run into a folder, animated or not


def simulate(
    case: cases.Case,
    out: Path | None = None,
    overwrite: bool = False,
    pvd: bool = False,
    watch: Callable[[Progress, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
    draw: Draw = lambda run, folder, animated, say: None,
) -> Run:
    """March a case and, with `out`, leave a whole result folder there.

    `watch(progress, end)` is told about every step, `draw` makes the pictures.  Raises BadInput when `out` exists,
    Interrupted after Ctrl-C with a checkpoint in `out`.partial, SolverFailure.
    """
    scene, numerics = case.scene, case.settings
    if out is None:
        return march(scene, numerics, case.title, None, _watcher(None, scene, watch))
    out = Path(out)
    _may_write(out, overwrite)
    work = partial(out)
    with _hold(work):
        if (work / CHECKPOINT).exists() and not overwrite:
            hint = f"go on with 'flashtemp run --resume {out}' or --overwrite"
            raise BadInput(f"--out: {work} holds an interrupted run; {hint}")
        _clear(work)
        try:
            (work / "case.toml").write_text(case.toml(case.copy_files(work)), encoding="utf-8")
            return _carry_out(case, scene, numerics, None, work, out, pvd, watch, say, draw)
        except Interrupted:
            raise
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise


def _may_write(out: Path, overwrite: bool) -> None:
    """BadInput unless `out` is free, or an earlier result that may be replaced."""
    if out.exists():
        if not overwrite:
            raise BadInput(f"--out: {out} exists; choose another folder or add --overwrite")
        if not (out / "summary.json").is_file() or not (out / "run.nc").is_file():
            raise BadInput(f"--out: {out} is no result of flashtemp and will not be overwritten; choose another folder")
    try:
        partial(out).mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise BadInput(f"--out: {out}: {fault.strerror}; choose a folder that can be written") from fault


@contextmanager
def _hold(work: Path):
    """Keep other runs out of a folder that is being written."""
    import fcntl

    with (work / LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as fault:
            raise BadInput(f"--out: another run is writing {work}; wait for it or choose another folder") from fault
        yield


def _clear(work: Path) -> None:
    """Remove what an earlier run left half-written."""
    for path in work.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name != LOCK:
            path.unlink()


def resume(
    folder: Path,
    pvd: bool = False,
    watch: Callable[[Progress, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
    draw: Draw = lambda run, folder, animated, say: None,
    trust: bool = False,
) -> Run:
    """Go on with an interrupted run from its checkpoint; CVODE starts again at order 1.

    `trust` lets effect files of the case run whose ever they are.
    """
    folder = Path(folder)
    out = folder.with_name(folder.name.removesuffix(".partial"))
    work = partial(out)
    if not (work / CHECKPOINT).is_file():
        what = "it is already whole" if (out / "run.nc").exists() else f"no {CHECKPOINT} in {work}"
        raise BadInput(f"--resume: {folder}: {what}; give the folder of an interrupted run")
    with _hold(work):
        case = cases.load(work, trust=trust)
        scene, state = case.scene, load(work)
        return _carry_out(case, scene, case.settings, state, work, out, pvd, watch, say, draw)


def _carry_out(case, scene, numerics, state, work, out, pvd, watch, say, draw) -> Run:
    with stoppable() as stopped:
        state = state or Progress(frames=Frames(work / FRAMES))
        box: dict[str, Progress] = {}
        try:
            run = march(scene, numerics, case.title, state, _watcher(work, scene, watch, stopped, box))
        except KeyboardInterrupt:
            save(work, box["progress"])
            raise Interrupted(work, f"flashtemp run --resume {out}") from None
        text = (work / "case.toml").read_text(encoding="utf-8")
        remarks = [remark for a in scene.acting for remark in a.effect.remarks(scene, a.p, run)] + inert.remarks(case)
        about = {"versions": versions(numerics.binding)} | ({"remarks": remarks} if remarks else {})
        if own := case.own_effects():
            about["own_effects"] = own
        run = replace(run, case_text=text, statistics=run.statistics | about)
        for a in scene.acting:
            a.effect.leave(scene, a.p, work)
        run.save(work)
        if case["output.vtk"]:
            say("writing fields.vtkhdf")
            vtk.write(run, work / "fields.vtkhdf")
        if pvd:
            vtk.write_pvd(run, work / "pvd")
        if case["output.pictures"]:
            draw(run, work, case["output.animation"], say)
        for name in (CHECKPOINT, FRAMES):  # fields that the run still shows stay open until it is gone
            (work / name).unlink(missing_ok=True)
        old = out.with_name(out.name + ".old")
        if out.exists():
            out.rename(old)
        (work / LOCK).unlink()
        work.rename(out)
        shutil.rmtree(old, ignore_errors=True)
    return run


def _watcher(work, scene, watch, stopped=None, box=None):
    """Per-step hook: progress to the caller, checkpoints to disk, stop on request."""
    end, last = scene.schedule.end, time.monotonic()

    def hook(progress: Progress) -> bool:
        nonlocal last
        if box is not None:
            box["progress"] = progress
        if watch is not None:
            watch(progress, end)
        if work is not None and time.monotonic() - last > EVERY:
            save(work, progress)
            last = time.monotonic()
        return stopped is not None and stopped.is_set()

    return hook


def versions(binding: str) -> dict[str, str]:
    """Versions of everything that had a hand in the result."""
    import platform
    from importlib.metadata import version

    package = {"scikits-odes": "scikits-odes-sundials", "scikit-sundae": "scikit-sundae"}[binding]
    names = ("flashtemp", "numpy", "scipy", "numba", package)
    return {"python": platform.python_version(), **{n: version(n) for n in names}}
