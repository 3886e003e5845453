"""Run a case and write its result folder (run.nc, summary.json, VTK): complete or absent, and resumable."""

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
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.run import Run
from flashtemp.solver.time_integration import integrate_schedule

CHECKPOINT_PERIOD_S = 30.0  # s of wall time between checkpoints; the first is saved at once
# draw pictures of a run into a folder, animated or not; returns {missing file: reason}
DrawPictures = Callable[[Run, Path, bool], dict[str, str]]


def simulate(
    case: cases.Case,
    out: Path | None = None,
    overwrite: bool = False,
    pvd: bool = False,
    watch: Callable[[IntegrationState, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
    draw: DrawPictures = lambda run, folder, animated: {},
) -> Run:
    """Integrate a case in time and, with `out`, write a complete result folder.

    `watch(state, end)` is called at every step, `draw` makes the pictures.  Raises BadInput when `out` exists,
    SolverFailure, and IncompleteResult where pictures are missing.  UserInterrupt after Ctrl-C and SystemFailure on a
    full disk leave a checkpoint in a folder next to `out`.
    """
    if out is None:
        return integrate_schedule(case.scene, case.settings, case.title, None, _make_step_hook(None, case.scene, watch))
    out = Path(out)
    _refuse_overwrite(out, overwrite)
    marker = OwnerMarker(out.name, "run", CHECKPOINT_FILE, f"flashtemp run --resume {out}", overwrite)
    with reserve_folder(out, marker, overwrite=overwrite) as work:
        try:
            (work / "case.toml").write_text(case.toml(case.copy_files(work)), encoding="utf-8")
            state = IntegrationState(frames=FieldStore(work / FRAMES_FILE))
            return _run_job(case, state, work, out, overwrite, pvd, watch, say, draw)
        except (UserInterrupt, SystemFailure, IncompleteResult):
            raise
        except KeyboardInterrupt:
            if (work / CHECKPOINT_FILE).is_file():
                raise UserInterrupt(work, marker.resume) from None
            shutil.rmtree(work, ignore_errors=True)
            raise
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise


def _refuse_overwrite(out: Path, overwrite: bool) -> None:
    """Raise BadInput unless `out` does not exist, or is an earlier result that may be replaced."""
    if not os.path.lexists(out):
        return
    if not overwrite:
        raise BadInput(f"--out: {out} exists; choose another folder or add --overwrite")
    if out.is_symlink():
        raise BadInput(f"--out: {out} is a link and will not be overwritten; give the folder itself")
    if not is_result(out):
        raise BadInput(f"--out: {out} is not a result of flashtemp and will not be overwritten; choose another folder")


def is_result(folder: Path) -> bool:
    """Whether `folder` is the result folder of a finished run."""
    return not folder.is_symlink() and all((folder / name).is_file() for name in ("summary.json", "run.nc"))


def resume(
    folder: Path,
    pvd: bool = False,
    watch: Callable[[IntegrationState, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
    draw: DrawPictures = lambda run, folder, animated: {},
    trust: bool = False,
) -> Run:
    """Continue an interrupted run from its checkpoint; CVODE starts again at order 1.

    `trust` runs effect files of the case even if another user may have written them.  Raises like `simulate`.
    """
    work, out = find_interrupted_run(Path(folder))
    lock = lock_folder(work)
    try:
        marker = read_marker(work)
        overwrite = marker is not None and marker.overwrite
        if os.path.lexists(out):
            _refuse_overwrite(out, overwrite)
        state = load_checkpoint(work)
        case = cases.load_case(work, trust=trust)
        return _run_job(case, state, work, out, overwrite, pvd, watch, say, draw)
    finally:
        os.close(lock)


def find_interrupted_run(folder: Path) -> tuple[Path, Path]:
    """The working folder and the result folder of an interrupted run, from the path of either.  Raises BadInput."""
    if folder.name in ("", ".."):  # '.' has no name of its own
        folder = folder.resolve()
    if not folder.name:
        raise BadInput(f"--resume: {folder}: not the folder of a run; give the folder of an interrupted run")
    name, cut, _ = folder.name.rpartition(".partial")
    if cut and (folder / CHECKPOINT_FILE).is_file():
        return folder, folder.with_name(name)
    default = folder.with_name(f"{folder.name}.partial")
    found = list_resumable_folders(folder, "run") or ([default] if (default / CHECKPOINT_FILE).is_file() else [])
    if len(found) == 1:
        return found[0], folder
    if found:
        raise BadInput(f"--resume: {folder}: several interrupted runs: {', '.join(map(str, found))}; give one of them")
    places = ", ".join(map(str, list_working_folders(folder))) or default
    if (folder / "run.nc").exists():
        raise BadInput(f"--resume: {folder}: the run is complete; draw missing pictures with: flashtemp draw {folder}")
    raise BadInput(f"--resume: {folder}: no {CHECKPOINT_FILE} in {places}; give the folder of an interrupted run")


def _run_job(case, state, work, out, overwrite, pvd, watch, say, draw) -> Run:
    """Integrate from `state` to the end, save, draw, and rename the working folder to `out`."""
    with stop_on_signal() as stopped:
        run = _integrate_and_save(case, state, work, out, pvd, watch, say, stopped)
    missing = {}
    if case["output.pictures"] and not stopped.is_set():
        try:
            missing = draw(run, work, case["output.animation"])
        except KeyboardInterrupt:
            stopped.set()
    with stop_on_signal():
        published = _publish_result(
            work, out, overwrite, () if missing or stopped.is_set() else (CHECKPOINT_FILE, FRAMES_FILE)
        )
    if stopped.is_set():
        raise UserInterrupt(published, f"flashtemp draw {published}", "the result without its pictures")
    if missing:
        remedy = f"draw again with: flashtemp draw {published}"
        raise IncompleteResult(f"{describe_missing_files(published, missing)}; {remedy}", run)
    check_published_name(out, published, run)
    return run


def _integrate_and_save(case, state, work, out, pvd, watch, say, stop_event) -> Run:
    """Integrate from `state` to the end and save; an error leaves a checkpoint wherever possible."""
    scene, resume_command = case.scene, f"flashtemp run --resume {out}"
    try:
        run = integrate_schedule(
            scene, case.settings, case.title, state, _make_step_hook(work, scene, watch, stop_event)
        )
        save_checkpoint(work, state)
        return _save_result(run, case, work, pvd, say)
    except KeyboardInterrupt:
        if full := _keep_checkpoint(work, state):
            raise SystemFailure(full, work, resume_command) from None
        raise UserInterrupt(work, resume_command) from None
    except OSError as fault:
        _keep_checkpoint(work, state)
        if not (work / CHECKPOINT_FILE).is_file():
            raise
        raise SystemFailure(fault, work, resume_command) from fault
    except EnergyBalanceError as fault:
        _save_result(replace(fault.run, statistics=fault.run.statistics | {"failed": str(fault)}), case, work, pvd, say)
        published = publish_folder(
            work, out.with_name(f"{out.name}.failed"), False, (CHECKPOINT_FILE, FRAMES_FILE, RESERVE_FILE)
        )
        raise EnergyBalanceError(f"{fault}; the result is in {published}", fault.run) from fault
    except FlashtempError:
        raise
    except Exception as fault:
        if state.phase < len(scene.schedule.phases):
            raise
        # the time integration is complete, and its checkpoint is saved
        raise SystemFailure(fault, work, resume_command) from fault


def describe_missing_files(folder: Path, missing: dict[str, str]) -> str:
    """The missing files of a folder in one line, each reason once.

    >>> describe_missing_files(Path("out"), {"map.png": "no room", "field.png": "no room"})
    'missing in out: map.png, field.png (no room)'
    """
    why = {reason: ", ".join(n for n, other in missing.items() if other == reason) for reason in missing.values()}
    return f"missing in {folder}: " + "; ".join(f"{names} ({reason})" for reason, names in why.items())


def _keep_checkpoint(work: Path, state: IntegrationState) -> OSError | None:
    """Save a checkpoint if the run has begun; returns the error of a full disk, or None."""
    try:
        if state.y is not None:
            save_checkpoint(work, state)
    except OSError as fault:  # the previous checkpoint stays valid
        return fault
    return None


def _publish_result(work: Path, out: Path, overwrite: bool, drop: tuple[str, ...]) -> Path:
    """Rename the working folder to `out` and then remove the files `drop`; returns the final path."""
    try:
        return publish_folder(work, out, overwrite and is_result(out), (*drop, RESERVE_FILE))
    except OSError as fault:
        raise SystemFailure(fault, work, f"flashtemp run --resume {out}") from fault


def _save_result(run: Run, case, work: Path, pvd: bool, say: Callable[[str], None]) -> Run:
    """Add remarks and provenance to the run and write it into its folder, without the pictures."""
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
    """The function called at every step: reports progress, saves checkpoints, and returns True to stop."""
    end, last = scene.schedule.end_time, float("-inf")

    def step_hook(progress: IntegrationState) -> bool:
        nonlocal last
        if watch is not None:
            watch(progress, end)
        if work is not None and time.monotonic() - last > CHECKPOINT_PERIOD_S:
            save_checkpoint(work, progress)
            last = time.monotonic()
        return stop_event is not None and stop_event.is_set()

    return step_hook
