"""One job from case to result folder (run.nc, summary.json, VTK): whole or absent, resumable, re-runnable."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from flashtemp.errors import AuditFailure, BadInput, FlashtempError, Halted, Incomplete, Interrupted
from flashtemp.model import case as cases
from flashtemp.runs import inert, mesh_error, steadiness, vtk
from flashtemp.runs.checkpoint import CHECKPOINT, FRAMES, RESERVE, load, save
from flashtemp.runs.folders import Owner, check_place, claim, hold, left_behind, owner, partials, place, stoppable
from flashtemp.runs.provenance import commit, versions
from flashtemp.solver import limits
from flashtemp.solver.field_store import Frames
from flashtemp.solver.march import march
from flashtemp.solver.progress import Progress
from flashtemp.solver.run import Run

EVERY = 30.0  # s of wall time between checkpoints; the first is left at once
# pictures of a run into a folder, animated or not; returns {what is missing: why}
Draw = Callable[[Run, Path, bool], dict[str, str]]


def simulate(
    case: cases.Case,
    out: Path | None = None,
    overwrite: bool = False,
    pvd: bool = False,
    watch: Callable[[Progress, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
    draw: Draw = lambda run, folder, animated: {},
) -> Run:
    """March a case and, with `out`, leave a whole result folder there.

    `watch(progress, end)` is told about every step, `draw` makes the pictures.  Raises BadInput when `out` exists,
    Interrupted after Ctrl-C and Halted by a full disk with a checkpoint in a folder beside `out`, Incomplete where
    pictures are missing, SolverFailure.
    """
    if out is None:
        return march(case.scene, case.settings, case.title, None, _watcher(None, case.scene, watch))
    out = Path(out)
    _may_write(out, overwrite)
    mine = Owner(out.name, "run", CHECKPOINT, f"flashtemp run --resume {out}", overwrite)
    with claim(out, mine, overwrite=overwrite) as work:
        try:
            (work / "case.toml").write_text(case.toml(case.copy_files(work)), encoding="utf-8")
            state = Progress(frames=Frames(work / FRAMES))
            return _carry_out(case, state, work, out, overwrite, pvd, watch, say, draw)
        except (Interrupted, Halted, Incomplete):
            raise
        except KeyboardInterrupt:
            if (work / CHECKPOINT).is_file():
                raise Interrupted(work, mine.resume) from None
            shutil.rmtree(work, ignore_errors=True)
            raise
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise


def _may_write(out: Path, overwrite: bool) -> None:
    """BadInput unless `out` is free, or an earlier result that may be replaced."""
    if not os.path.lexists(out):
        return
    if not overwrite:
        raise BadInput(f"--out: {out} exists; choose another folder or add --overwrite")
    if out.is_symlink():
        raise BadInput(f"--out: {out} is a link and will not be overwritten; give the folder itself")
    if not is_result(out):
        raise BadInput(f"--out: {out} is no result of flashtemp and will not be overwritten; choose another folder")


def is_result(folder: Path) -> bool:
    """Whether that is the folder of a finished run."""
    return not folder.is_symlink() and all((folder / name).is_file() for name in ("summary.json", "run.nc"))


def resume(
    folder: Path,
    pvd: bool = False,
    watch: Callable[[Progress, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
    draw: Draw = lambda run, folder, animated: {},
    trust: bool = False,
) -> Run:
    """Go on with an interrupted run from its checkpoint; CVODE starts again at order 1.

    `trust` lets effect files of the case run whose ever they are.
    """
    work, out = interrupted(Path(folder))
    lock = hold(work)
    try:
        told = owner(work)
        overwrite = told is not None and told.overwrite
        if os.path.lexists(out):
            _may_write(out, overwrite)
        state = load(work)
        case = cases.load(work, trust=trust)
        return _carry_out(case, state, work, out, overwrite, pvd, watch, say, draw)
    finally:
        os.close(lock)


def interrupted(folder: Path) -> tuple[Path, Path]:
    """The working folder of an interrupted run and the result that it is to become, from the name of either."""
    if folder.name in ("", ".."):  # '.' has no name of its own
        folder = folder.resolve()
    if not folder.name:
        raise BadInput(f"--resume: {folder}: no folder of a run; give the folder of an interrupted run")
    name, cut, _ = folder.name.rpartition(".partial")
    if cut and (folder / CHECKPOINT).is_file():
        return folder, folder.with_name(name)
    known = folder.with_name(f"{folder.name}.partial")
    left = left_behind(folder, "run") or ([known] if (known / CHECKPOINT).is_file() else [])
    if len(left) == 1:
        return left[0], folder
    if left:
        raise BadInput(f"--resume: {folder}: several runs wait: {', '.join(map(str, left))}; give one of them")
    places = ", ".join(map(str, partials(folder))) or known
    if (folder / "run.nc").exists():
        raise BadInput(
            f"--resume: {folder}: it is already whole; missing pictures are drawn by flashtemp draw {folder}"
        )
    raise BadInput(f"--resume: {folder}: no {CHECKPOINT} in {places}; give the folder of an interrupted run")


def _carry_out(case, state, work, out, overwrite, pvd, watch, say, draw) -> Run:
    """March from `state` to the end, save, draw, and give the folder its name."""
    with stoppable() as stopped:
        run = _marched(case, state, work, out, pvd, watch, say, stopped)
    missing = {}
    if case["output.pictures"] and not stopped.is_set():
        try:
            missing = draw(run, work, case["output.animation"])
        except KeyboardInterrupt:
            stopped.set()
    with stoppable():
        lies = _finish(work, out, overwrite, () if missing or stopped.is_set() else (CHECKPOINT, FRAMES))
    if stopped.is_set():
        raise Interrupted(lies, f"flashtemp draw {lies}", "the result without its pictures")
    if missing:
        raise Incomplete(f"{absent(lies, missing)}; draw again with: flashtemp draw {lies}", run)
    check_place(out, lies, run)
    return run


def _marched(case, state, work, out, pvd, watch, say, stopped) -> Run:
    """March from `state` to the end and save; what goes wrong leaves all that can be kept."""
    scene, again = case.scene, f"flashtemp run --resume {out}"
    try:
        run = march(scene, case.settings, case.title, state, _watcher(work, scene, watch, stopped))
        save(work, state)
        return _saved(run, case, work, pvd, say)
    except KeyboardInterrupt:
        if full := _kept(work, state):
            raise Halted(full, work, again) from None
        raise Interrupted(work, again) from None
    except OSError as fault:
        _kept(work, state)
        if not (work / CHECKPOINT).is_file():
            raise
        raise Halted(fault, work, again) from fault
    except AuditFailure as fault:
        _saved(replace(fault.run, statistics=fault.run.statistics | {"failed": str(fault)}), case, work, pvd, say)
        lies = place(work, out.with_name(f"{out.name}.failed"), False, (CHECKPOINT, FRAMES, RESERVE))
        raise AuditFailure(f"{fault}; what came out lies in {lies}", fault.run) from fault
    except FlashtempError:
        raise
    except Exception as fault:
        if state.phase < len(scene.schedule.phases):
            raise
        raise Halted(fault, work, again) from fault  # the march is the result


def absent(folder: Path, missing: dict[str, str]) -> str:
    """What is missing in a folder and why, in one line: each reason once.

    >>> absent(Path("out"), {"map.png": "no room", "field.png": "no room"})
    'missing in out: map.png, field.png (no room)'
    """
    why = {reason: ", ".join(n for n, other in missing.items() if other == reason) for reason in missing.values()}
    return f"missing in {folder}: " + "; ".join(f"{names} ({reason})" for reason, names in why.items())


def _kept(work: Path, state: Progress) -> OSError | None:
    """Leave a checkpoint, where there is room for one and something to keep; what stood in the way."""
    try:
        if state.y is not None:
            save(work, state)
    except OSError as fault:  # the last one stays
        return fault
    return None


def _finish(work: Path, out: Path, overwrite: bool, drop: tuple[str, ...]) -> Path:
    """Give the folder its name; without a checkpoint once it has it."""
    try:
        return place(work, out, overwrite and is_result(out), (*drop, RESERVE))
    except OSError as fault:
        raise Halted(fault, work, f"flashtemp run --resume {out}") from fault


def _saved(run: Run, case, work: Path, pvd: bool, say: Callable[[str], None]) -> Run:
    """The run with all that is told about it, written into its folder but for the pictures."""
    scene = case.scene
    text = (work / "case.toml").read_text(encoding="utf-8")
    remarks = [remark for a in scene.acting for remark in a.effect.remarks(scene, a.p, run)]
    remarks += limits.remarks(run) + inert.remarks(case) + steadiness.remarks(scene, run) + mesh_error.remarks(case)
    about = {"versions": versions(case.settings.binding), "commit": commit()} | (
        {"remarks": remarks} if remarks else {}
    )
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
    return run


def _watcher(work, scene, watch, stopped=None):
    """Per-step hook: progress to the caller, checkpoints to disk, stop on request."""
    end, last = scene.schedule.end, float("-inf")

    def hook(progress: Progress) -> bool:
        nonlocal last
        if watch is not None:
            watch(progress, end)
        if work is not None and time.monotonic() - last > EVERY:
            save(work, progress)
            last = time.monotonic()
        return stopped is not None and stopped.is_set()

    return hook
