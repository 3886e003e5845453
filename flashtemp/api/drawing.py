"""Draw the pictures of a finished run or sweep again."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flashtemp.api.inputs import Say, ignore_message
from flashtemp.display import DisplayMixin
from flashtemp.errors import BadInput, IncompleteResult, describe_exception
from flashtemp.runs.job import describe_missing_files
from flashtemp.runs.load_run import open_run
from flashtemp.runs.results import vtk
from flashtemp.solver.run import Run

PICTURE_FORMATS = ("png", "svg", "pdf")
NO_FIELDS_REASON = "the run kept no fields, because output.vtk = false"


@dataclass(frozen=True, repr=False)
class PlotResult(DisplayMixin):
    """The result of `draw`: the `files` drawn in the result `folder`."""

    folder: Path
    files: tuple[Path, ...]

    def as_dict(self) -> dict[str, Any]:
        """Folder and file names as plain data."""
        return {"out": str(self.folder), "files": [str(f.relative_to(self.folder)) for f in self.files]}

    def __str__(self) -> str:
        return f"drawn in {self.folder}/: {', '.join(str(f.relative_to(self.folder)) for f in self.files)}"


def draw(
    folder: str | Path,
    *,
    format: str | Sequence[str] = "png",
    pvd: bool = False,
    trust: bool = False,
    say: Say = ignore_message,
) -> PlotResult:
    """Draw the pictures of a finished run or sweep again into its folder, as png, svg or pdf (several: "png,svg").

    `pvd` adds a series for older ParaView; `trust` as in `load`.  Raises BadInput, and IncompleteResult where a
    picture cannot be drawn.
    """
    path, kinds = Path(folder), _parse_formats(format)
    if (path / "sweep.nc").is_file():
        made, missing = _draw_sweep(path, kinds)
    else:
        case, run = open_run(path, trust)
        made, missing = _draw_run(run, path, kinds, case["output.animation"], pvd, say)
    result = PlotResult(path, tuple(made))
    if missing:
        raise IncompleteResult(describe_missing_files(path, missing), result)
    return result


def _parse_formats(format: str | Sequence[str]) -> list[str]:
    kinds = [k.strip().lower() for k in (format.split(",") if isinstance(format, str) else format)]
    for kind in kinds or [""]:
        if kind not in PICTURE_FORMATS:
            raise BadInput(f"--format: {kind!r}; give one or more of {', '.join(PICTURE_FORMATS)}")
    return kinds


def _draw_run(
    run: Run, folder: Path, kinds: list[str], animated: bool, pvd: bool, say: Say
) -> tuple[list[Path], dict[str, str]]:
    series = [_write_pvd(run, folder)] if pvd else []
    from flashtemp import viz

    say("drawing pictures")
    made, missing = viz.draw_each(run, folder, kinds, animated and "png" in kinds)
    if not len(run.frames):
        from flashtemp.viz.run import field

        missing |= {f"{field.PICTURE}.{kind}": NO_FIELDS_REASON for kind in kinds}
    return [*made, *series], missing


def _write_pvd(run: Run, folder: Path) -> Path:
    """Write the .pvd series for older ParaView; a failure leaves no folder behind."""
    target = folder / "pvd"
    if os.path.lexists(target):
        raise BadInput(f"--pvd: {target} exists; remove it to write it again")
    if not len(run.frames):
        raise BadInput(f"--pvd: {folder}: {NO_FIELDS_REASON}; run the case with output.vtk = true")
    fresh = folder / f".{secrets.token_hex(8)}"
    try:
        vtk.write_pvd(run, fresh)
        fresh.rename(target)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
    return target


def _draw_sweep(folder: Path, kinds: list[str]) -> tuple[list[Path], dict[str, str]]:
    import xarray as xr

    try:
        from flashtemp.viz import theme
        from flashtemp.viz.studies import sweep

        figure = sweep.draw(xr.load_dataset(folder / "sweep.nc", engine="h5netcdf"))
        return [theme.save_figure(figure, folder / f"sweep.{kind}") for kind in kinds], {}
    except Exception as fault:
        return [], {f"sweep.{kind}": describe_exception(fault) for kind in kinds}
