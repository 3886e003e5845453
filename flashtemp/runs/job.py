"""One job from case to result folder (run.nc, summary.json, VTK): whole or absent, resumable, re-runnable."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from flashtemp.errors import (
    BadInput,
    EnergyBalanceError,
    FlashtempError,
    IncompleteResult,
    SystemFailure,
    UserInterrupt,
)
from flashtemp.model import case as cases
from flashtemp.runs.checks import inactive_effects, mesh_error, stick_slip_stability
from flashtemp.runs.results import vtk
from flashtemp.runs.results.checkpoint import (
    CHECKPOINT_FILE,
    FRAMES_FILE,
    RESERVE_FILE,
    load_checkpoint,
    save_checkpoint,
)
from flashtemp.runs.results.provenance import package_versions, source_commit
from flashtemp.runs.results.result_folder import (
    OwnerMarker,
    check_published_name,
    list_resumable_folders,
    list_working_folders,
    lock_folder,
    publish_folder,
    read_marker,
    reserve_folder,
    stop_on_signal,
)
from flashtemp.solver import sanity_checks
from flashtemp.solver.field_store import FieldStore
from flashtemp.solver.march import march
from flashtemp.solver.march_state import MarchState
from flashtemp.solver.run import Run

CHECKPOINT_PERIOD_S = 30.0  # s of wall time between checkpoints; the first is left at once
# pictures of a run into a folder, animated or not; returns {what is missing: why}
DrawPictures = Callable[[Run, Path, bool], dict[str, str]]


def simulate(
    case: cases.Case,
    out: Path | None = None,
    overwrite: bool = False,
    pvd: bool = False,
    watch: Callable[[MarchState, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
    draw: DrawPictures = lambda run, folder, animated: {},
) -> Run:
    """March a case and, with `out`, leave a whole result folder there.

    `watch(progress, end)` is told about every step, `draw` makes the pictures.  Raises BadInput when `out` exists,
    Interrupted after Ctrl-C and Halted by a full disk with a checkpoint in a folder beside `out`, Incomplete where
    pictures are missing, SolverFailure.
    """
    if out is None:
        return march(case.scene, case.settings, case.title, None, _make_step_hook(None, case.scene, watch))
    out = Path(out)
    _refuse_overwrite(out, overwrite)
    mine = OwnerMarker(out.name, "run", CHECKPOINT_FILE, f"flashtemp run --resume {out}", overwrite)
    with reserve_folder(out, mine, overwrite=overwrite) as work:
        try:
            (work / "case.toml").write_text(case.toml(case.copy_files(work)), encoding="utf-8")
            state = MarchState(frames=FieldStore(work / FRAMES_FILE))
            return _run_job(case, state, work, out, overwrite, pvd, watch, say, draw)
        except (UserInterrupt, SystemFailure, IncompleteResult):
            raise
        except KeyboardInterrupt:
            if (work / CHECKPOINT_FILE).is_file():
                raise UserInterrupt(work, mine.resume) from None
            shutil.rmtree(work, ignore_errors=True)
            raise
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise


def _refuse_overwrite(out: Path, overwrite: bool) -> None:
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
    watch: Callable[[MarchState, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
    draw: DrawPictures = lambda run, folder, animated: {},
    trust: bool = False,
) -> Run:
    """Go on with an interrupted run from its checkpoint; CVODE starts again at order 1.

    `trust` lets effect files of the case run whose ever they are.
    """
    work, out = find_interrupted_run(Path(folder))
    lock = lock_folder(work)
    try:
        told = read_marker(work)
        overwrite = told is not None and told.overwrite
        if os.path.lexists(out):
            _refuse_overwrite(out, overwrite)
        state = load_checkpoint(work)
        case = cases.load_case(work, trust=trust)
        return _run_job(case, state, work, out, overwrite, pvd, watch, say, draw)
    finally:
        os.close(lock)


def find_interrupted_run(folder: Path) -> tuple[Path, Path]:
    """The working folder of an interrupted run and the result that it is to become, from the name of either."""
    if folder.name in ("", ".."):  # '.' has no name of its own
        folder = folder.resolve()
    if not folder.name:
        raise BadInput(f"--resume: {folder}: no folder of a run; give the folder of an interrupted run")
    name, cut, _ = folder.name.rpartition(".partial")
    if cut and (folder / CHECKPOINT_FILE).is_file():
        return folder, folder.with_name(name)
    known = folder.with_name(f"{folder.name}.partial")
    left = list_resumable_folders(folder, "run") or ([known] if (known / CHECKPOINT_FILE).is_file() else [])
    if len(left) == 1:
        return left[0], folder
    if left:
        raise BadInput(f"--resume: {folder}: several runs wait: {', '.join(map(str, left))}; give one of them")
    places = ", ".join(map(str, list_working_folders(folder))) or known
    if (folder / "run.nc").exists():
        raise BadInput(
            f"--resume: {folder}: it is already whole; missing pictures are drawn by flashtemp draw {folder}"
        )
    raise BadInput(f"--resume: {folder}: no {CHECKPOINT_FILE} in {places}; give the folder of an interrupted run")


def _run_job(case, state, work, out, overwrite, pvd, watch, say, draw) -> Run:
    """March from `state` to the end, save, draw, and give the folder its name."""
    with stop_on_signal() as stopped:
        run = _march_and_save(case, state, work, out, pvd, watch, say, stopped)
    missing = {}
    if case["output.pictures"] and not stopped.is_set():
        try:
            missing = draw(run, work, case["output.animation"])
        except KeyboardInterrupt:
            stopped.set()
    with stop_on_signal():
        lies = _publish_result(
            work, out, overwrite, () if missing or stopped.is_set() else (CHECKPOINT_FILE, FRAMES_FILE)
        )
    if stopped.is_set():
        raise UserInterrupt(lies, f"flashtemp draw {lies}", "the result without its pictures")
    if missing:
        raise IncompleteResult(f"{describe_missing_files(lies, missing)}; draw again with: flashtemp draw {lies}", run)
    check_published_name(out, lies, run)
    return run


def _march_and_save(case, state, work, out, pvd, watch, say, stop_event) -> Run:
    """March from `state` to the end and save; what goes wrong leaves all that can be kept."""
    scene, again = case.scene, f"flashtemp run --resume {out}"
    try:
        run = march(scene, case.settings, case.title, state, _make_step_hook(work, scene, watch, stop_event))
        save_checkpoint(work, state)
        return _save_result(run, case, work, pvd, say)
    except KeyboardInterrupt:
        if full := _keep_checkpoint(work, state):
            raise SystemFailure(full, work, again) from None
        raise UserInterrupt(work, again) from None
    except OSError as fault:
        _keep_checkpoint(work, state)
        if not (work / CHECKPOINT_FILE).is_file():
            raise
        raise SystemFailure(fault, work, again) from fault
    except EnergyBalanceError as fault:
        _save_result(replace(fault.run, statistics=fault.run.statistics | {"failed": str(fault)}), case, work, pvd, say)
        lies = publish_folder(
            work, out.with_name(f"{out.name}.failed"), False, (CHECKPOINT_FILE, FRAMES_FILE, RESERVE_FILE)
        )
        raise EnergyBalanceError(f"{fault}; what came out lies in {lies}", fault.run) from fault
    except FlashtempError:
        raise
    except Exception as fault:
        if state.phase < len(scene.schedule.phases):
            raise
        raise SystemFailure(fault, work, again) from fault  # the march is the result


def describe_missing_files(folder: Path, missing: dict[str, str]) -> str:
    """What is missing in a folder and why, in one line: each reason once.

    >>> describe_missing_files(Path("out"), {"map.png": "no room", "field.png": "no room"})
    'missing in out: map.png, field.png (no room)'
    """
    why = {reason: ", ".join(n for n, other in missing.items() if other == reason) for reason in missing.values()}
    return f"missing in {folder}: " + "; ".join(f"{names} ({reason})" for reason, names in why.items())


def _keep_checkpoint(work: Path, state: MarchState) -> OSError | None:
    """Leave a checkpoint, where there is room for one and something to keep; what stood in the way."""
    try:
        if state.y is not None:
            save_checkpoint(work, state)
    except OSError as fault:  # the last one stays
        return fault
    return None


def _publish_result(work: Path, out: Path, overwrite: bool, drop: tuple[str, ...]) -> Path:
    """Give the folder its name; without a checkpoint once it has it."""
    try:
        return publish_folder(work, out, overwrite and is_result(out), (*drop, RESERVE_FILE))
    except OSError as fault:
        raise SystemFailure(fault, work, f"flashtemp run --resume {out}") from fault


def _save_result(run: Run, case, work: Path, pvd: bool, say: Callable[[str], None]) -> Run:
    """The run with all that is told about it, written into its folder but for the pictures."""
    scene = case.scene
    text = (work / "case.toml").read_text(encoding="utf-8")
    remarks = [remark for a in scene.acting for remark in a.effect.remarks(scene, a.p, run)]
    remarks += (
        sanity_checks.overheating_remarks(run)
        + inactive_effects.describe_inactive_effects(case)
        + stick_slip_stability.warn_of_stick_slip(scene, run)
        + mesh_error.warn_of_coarse_mesh(case)
    )
    about = {"versions": package_versions(case.settings.binding), "commit": source_commit()} | (
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
        vtk.write_vtkhdf(run, work / "fields.vtkhdf")
    if pvd:
        vtk.write_pvd(run, work / "pvd")
    return run


def _make_step_hook(work, scene, watch, stop_event=None):
    """Per-step hook: progress to the caller, checkpoints to disk, stop on request."""
    end, last = scene.schedule.end_time, float("-inf")

    def step_hook(progress: MarchState) -> bool:
        nonlocal last
        if watch is not None:
            watch(progress, end)
        if work is not None and time.monotonic() - last > CHECKPOINT_PERIOD_S:
            save_checkpoint(work, progress)
            last = time.monotonic()
        return stop_event is not None and stop_event.is_set()

    return step_hook
