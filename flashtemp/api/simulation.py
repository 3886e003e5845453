"""Simulate a case, with its pictures; look at it in space; check it beforehand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flashtemp.api.inputs import Overrides, Say, ignore_message, resolve_case
from flashtemp.display import DisplayMixin
from flashtemp.errors import BadInput
from flashtemp.model.case import Case
from flashtemp.runs import job
from flashtemp.runs.results import vtk
from flashtemp.runs.results.vtk import RunFields
from flashtemp.solver.march_state import MarchState
from flashtemp.solver.run import Run

Watch = Callable[[MarchState, float], Any]


def check(case: str | Path | Case, overrides: Overrides | None = None) -> Case:
    """A case with everything that a run needs of it tried: numerics, mesh and effects.  Raises BadInput."""
    return resolve_case(case, overrides)


def simulate(
    case: str | Path | Case,
    overrides: Overrides | None = None,
    *,
    out: str | Path | None = None,
    overwrite: bool = False,
    pvd: bool = False,
    watch: Watch | None = None,
    say: Say = ignore_message,
) -> Run:
    """March a case and, with `out`, leave a whole result folder with pictures there.

    `watch(progress, end)` is told about every step; `pvd` adds a series for older ParaView.  Raises BadInput, also
    when `out` exists, Interrupted after Ctrl-C with a checkpoint in `out`.partial, SolverFailure.
    """
    given, folder = resolve_case(case, overrides), None if out is None else Path(out)
    with _open_painter(watch, say, folder is not None and given["output.pictures"]) as (told, draw):
        return job.simulate(given, folder, overwrite, pvd, told, say, draw)


def resume(
    folder: str | Path, *, pvd: bool = False, watch: Watch | None = None, say: Say = ignore_message, trust: bool = False
) -> Run:
    """Go on with an interrupted run from its checkpoint; `trust` as in `load`.

    Raises BadInput, Interrupted, SolverFailure.
    """
    with _open_painter(watch, say) as (told, draw):
        return job.resume(Path(folder), pvd, told, say, draw, trust)


def find_resumed_folder(folder: str | Path) -> Path:
    """The result folder that an interrupted run will become.  Raises BadInput where there is none."""
    return job.find_interrupted_run(Path(folder))[1]


@contextmanager
def _open_painter(watch: Watch | None, say: Say, wanted: bool = True) -> Iterator[tuple[Watch, job.DrawPictures]]:
    """What is told of the march, and what draws the pictures after it, by two processes where the march takes time."""
    from flashtemp.viz.drawing_process import PictureDrawer

    with PictureDrawer(wanted) as painter:

        def draw_pictures(run: Run, folder: Path, animated: bool) -> dict[str, str]:
            say("drawing pictures")
            return dict(painter.draw_pictures(run, folder, animated))

        yield painter.wrap_watch(watch), draw_pictures


def open_fields(folder: str | Path) -> RunFields:
    """The temperature fields of a result folder, over time.  Raises BadInput."""
    return vtk.open_fields(folder)


@dataclass(frozen=True, repr=False)
class ViewResult(DisplayMixin):
    """What `view` has shown: a moment in s, in a `screenshot` or a window, by VTK or without it."""

    screenshot: Path | None
    time: float
    vtk: bool

    def as_dict(self) -> dict[str, Any]:
        """For --json."""
        return {"screenshot": str(self.screenshot), "time": self.time, "vtk": self.vtk}

    def __str__(self) -> str:
        return str(self.screenshot or "closed")


def view(
    folder: str | Path | RunFields,
    *,
    screenshot: str | Path | None = None,
    time: float | None = None,
    say: Say = ignore_message,
) -> ViewResult:
    """Block and road of a result folder in space, in a window or drawn into a .png file.

    `time` in s, the last kept one when not given.  Raises BadInput.
    """
    fields = folder if isinstance(folder, RunFields) else open_fields(folder)
    t = float(fields.times[-1]) if time is None else time
    if not fields.times[0] <= t <= fields.times[-1]:
        raise BadInput(f"--time: {t:g} s; give a moment from {fields.times[0]:g} to {fields.times[-1]:g} s")
    if screenshot is None:
        return _show_window(fields, t)
    file = Path(screenshot)
    if file.suffix != ".png" or not file.absolute().parent.is_dir():
        raise BadInput(f"--screenshot: {file}; give a .png file in a folder that exists")
    return _save_screenshot(fields, t, file, say)


def _show_window(fields: RunFields, t: float) -> ViewResult:
    from flashtemp.viz.run import vtk_window

    if not vtk_window.has_screen():
        raise BadInput("view: there is no screen here; draw into a file with --screenshot FILE.png")
    from flashtemp.viz.run import view_3d

    view_3d.open_window(fields, t)
    return ViewResult(None, t, True)


def _save_screenshot(fields: RunFields, t: float, file: Path, say: Say) -> ViewResult:
    from flashtemp.viz.run import vtk_window

    able = vtk_window.prepare_off_screen()
    from flashtemp.viz.run import view_3d

    if able:
        view_3d.save_screenshot(fields, t, file)
    else:
        from flashtemp.viz import theme

        say(f"drawn without VTK, which finds no window here: install {vtk_window.MISSING_LIBRARIES}")
        theme.save_figure(view_3d.draw_without_vtk(fields, t), file)
    return ViewResult(file, t, able)
