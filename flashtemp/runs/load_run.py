"""Read a finished run back from its result folder, with everything needed to draw it."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, describe_exception
from flashtemp.model import case as cases
from flashtemp.physics import safe_hdf5
from flashtemp.runs.job import is_result
from flashtemp.runs.results import vtk
from flashtemp.runs.results.checkpoint import CHECKPOINT_FILE, load_checkpoint
from flashtemp.solver.run import Run

PROFILE_VARIABLES = ("T_block", "T_spot", "T_road", "T_wake", "pressure", "worn")
TIME_VARIABLES = ("time", "repetition", "slid", "tilt", "friction")
REVERSED_VARIABLES = ("direction", "T_ahead")  # only in runs with backward sliding


def open_run(folder: Path, trust: bool = False) -> tuple[cases.Case, Run]:
    """The case and the Run of a result folder, without frames if no fields were saved.  Raises BadInput.

    Fields are read from fields.vtkhdf, or from the checkpoint of a folder without it.  `trust` runs effect files of
    the case even if another user may have written them.
    """
    if not is_result(folder):
        raise BadInput(f"{folder}: not a result of flashtemp run; give a folder with run.nc and summary.json")
    case = cases.load_case(folder, trust=trust)
    try:
        run = _read_profiles(folder, case)
        frames, field = _read_fields(folder, run)
    except BadInput as fault:
        raise BadInput(
            *(line if line.startswith(str(folder)) else f"{folder}: {line}" for line in fault.lines)
        ) from fault
    except (OSError, KeyError, ValueError, IndexError, TypeError, AttributeError, RecursionError) as fault:
        raise BadInput(
            f"{folder}: run.nc or its fields are damaged ({describe_exception(fault)}); run the case again"
        ) from fault
    return case, replace(run, frames=frames, field=field)


def _read_profiles(folder: Path, case: cases.Case) -> Run:
    import xarray as xr

    safe_hdf5.check_hdf5_file(folder / "run.nc", lambda name: False, lambda *about: None)  # no links into other files
    with warnings.catch_warnings(action="ignore"), xr.open_dataset(folder / "run.nc", engine="h5netcdf") as file:
        ds = file.load()
    scene, mesh = case.scene, case.scene.mesh
    if ds.x.shape != mesh.x_block.shape or not np.allclose(ds.x, mesh.x_block, rtol=1e-9):
        raise BadInput(f"{folder}: run.nc has another mesh than case.toml gives now; run the case again")
    profiles: dict[str, Any] = {name: ds[name].values for name in (*PROFILE_VARIABLES, *TIME_VARIABLES)}
    profiles |= {name: ds[name].values for name in REVERSED_VARIABLES if name in ds}
    energy = {str(n).removeprefix("energy_"): ds[n].values for n in ds.data_vars if str(n).startswith("energy_")}
    maps = {str(n).removesuffix("_map"): ds[n].values for n in ds.data_vars if str(n).endswith("_map")}
    run = Run(
        title=ds.attrs["title"],
        mesh=mesh,
        **profiles,
        sliding=ds.sliding.values.astype(bool),
        energy=energy,
        frames=np.zeros(0, dtype=int),
        field=np.zeros((0, mesh.n_cells)),
        ambient_degC=float(ds.attrs["ambient_degC"]),
        width=scene.width,
        conductivity=(scene.block_property("conductivity"), scene.road.conductivity),
        case_text=(folder / "case.toml").read_text(encoding="utf-8"),
        maps=maps,
    )
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return replace(run, statistics={k: v for k, v in summary.items() if k not in run.summary})


def _read_fields(folder: Path, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the frames in the times of the run, and temperatures (frames, cells) in degC."""
    if (folder / "fields.vtkhdf").is_file():
        saved = vtk.open_fields(folder)
        field = np.zeros((len(saved.times), run.mesh.n_cells), dtype=np.float32)
        for k, t in enumerate(saved.times):
            for name, body in vtk.body_grids(run).items():
                field[k][body.cells.ravel()] = saved.T(name, t)
        return np.searchsorted(run.time, saved.times), field
    if (folder / CHECKPOINT_FILE).is_file():
        state = load_checkpoint(folder)
        return np.array(state.records["frames"]), state.frames.stack_rows()["cells"]
    return run.frames, run.field
