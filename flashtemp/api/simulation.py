"""Check a case, simulate it with its pictures, and view the temperature field in 3D."""

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
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.run import Run

Watch = Callable[[IntegrationState, float], Any]


def check(case: str | Path | Case, overrides: Overrides | None = None) -> Case:
    """Check that a case can run: values, numerics, mesh and effects; returns the case.  Raises BadInput."""
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
    """Integrate the heat balance of a case in time; with `out`, write a result folder with pictures.

    `watch(state, end)` is called at every time step; `pvd` adds a series for older ParaView.  Raises BadInput, also
    when `out` exists, SolverFailure, and UserInterrupt after Ctrl-C with a checkpoint in `out`.partial.
    """
    loaded, folder = resolve_case(case, overrides), None if out is None else Path(out)
    with _open_painter(watch, say, folder is not None and loaded["output.pictures"]) as (watch_steps, draw):
        return job.simulate(loaded, folder, overwrite, pvd, watch_steps, say, draw)


def resume(
    folder: str | Path, *, pvd: bool = False, watch: Watch | None = None, say: Say = ignore_message, trust: bool = False
) -> Run:
    """Continue an interrupted run from its checkpoint; `trust` as in `load`.

    Raises BadInput, UserInterrupt, SolverFailure.
    """
    with _open_painter(watch, say) as (watch_steps, draw):
        return job.resume(Path(folder), pvd, watch_steps, say, draw, trust)


def find_resumed_folder(folder: str | Path) -> Path:
    """The result folder that an interrupted run will be written to.  Raises BadInput where there is no such run."""
    return job.find_interrupted_run(Path(folder))[1]


def find_working_folder(folder: str | Path) -> Path:
    """The folder in which an interrupted run keeps its case and its checkpoint.  Raises BadInput."""
    return job.find_interrupted_run(Path(folder))[0]


@contextmanager
def _open_painter(watch: Watch | None, say: Say, wanted: bool = True) -> Iterator[tuple[Watch, job.DrawPictures]]:
    """Yield the hook for time steps and the function that draws the pictures at the end.

    For a long run the painter starts its drawing processes during the time integration.
    """
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
    """The result of `view`: the `time` (s), the `screenshot` file if any, and whether VTK drew it."""

    screenshot: Path | None
    time: float
    vtk: bool

    def as_dict(self) -> dict[str, Any]:
        """File, time and drawing method as plain data."""
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
    """Show the temperature of block and road of a result folder in 3D, in a window or as a .png file.

    `time` in s, the last saved one when not given.  Raises BadInput.
    """
    fields = folder if isinstance(folder, RunFields) else open_fields(folder)
    t = float(fields.times[-1]) if time is None else time
    if not fields.times[0] <= t <= fields.times[-1]:
        raise BadInput(f"--time: {t:g} s; give a time from {fields.times[0]:g} to {fields.times[-1]:g} s")
    if screenshot is None:
        return _show_window(fields, t)
    file = Path(screenshot)
    if file.suffix != ".png" or not file.absolute().parent.is_dir():
        raise BadInput(f"--screenshot: {file}; give a .png file in a folder that exists")
    return _save_screenshot(fields, t, file, say)


def _show_window(fields: RunFields, t: float) -> ViewResult:
    from flashtemp.viz.run import vtk_window

    if not vtk_window.has_screen():
        raise BadInput("view: no screen is available; draw into a file with --screenshot FILE.png")
    from flashtemp.viz.run import view_3d

    view_3d.open_window(fields, t)
    return ViewResult(None, t, True)


def _save_screenshot(fields: RunFields, t: float, file: Path, say: Say) -> ViewResult:
    from flashtemp.viz.run import vtk_window

    has_vtk = vtk_window.prepare_off_screen()
    from flashtemp.viz.run import view_3d

    if has_vtk:
        view_3d.save_screenshot(fields, t, file)
    else:
        from flashtemp.viz import theme

        say(f"drawn without VTK, which cannot open a window here; install {vtk_window.MISSING_LIBRARIES}")
        theme.save_figure(view_3d.draw_without_vtk(fields, t), file)
    return ViewResult(file, t, has_vtk)
