"""Fields for ParaView: write and read one temporal VTKHDF file with block, road and contact."""

from __future__ import annotations

import errno
import shutil
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from flashtemp.display import DisplayMixin
from flashtemp.errors import BadInput, RenamedAttribute, suggest_name
from flashtemp.physics import safe_hdf5
from flashtemp.solver.run import Run

LINE, QUAD, HEXAHEDRON = 3, 9, 12  # VTK cell types
UNIT_BY_SUFFIX = {"degC": "degC", "Pa": "Pa", "m": "m", "m2": "W/m2"}  # by the suffix of a name
MAX_MEMORY_FILE_BYTES = 2e8  # larger files are not built in memory


@dataclass(frozen=True)
class BodyGrid:
    """Block or road as a tensor grid: edges `x`, `y`, `z` in m, `cells` (nx, ny, nz) with indices into the field.

    `conductivity` in W/mK; `layers` are slices of the cells along z.  In 2D `y` has one entry and ny = 1.
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    cells: np.ndarray
    conductivity: Any
    layers: tuple[slice, ...] = (slice(None),)

    def heat_flux(self, T: np.ndarray) -> np.ndarray:
        """Conductive heat flux -k grad T (cells, 3) in W/m2 of cell temperatures T (nx, ny, nz), layer by layer."""
        out = np.zeros((*T.shape, 3), dtype=np.float32)
        for axis, edges in enumerate((self.x, self.y, self.z)):
            if T.shape[axis] > 1:
                centre = 0.5 * (edges[1:] + edges[:-1])
                for part in self.layers if axis == 2 else (slice(None),):
                    at = (..., part) if axis == 2 else (...,)
                    out[(*at, axis)] = np.gradient(T[at], centre[part], axis=axis)
                out[..., axis] *= -self.conductivity
        return out.reshape(-1, 3)


def body_grids(run: Run) -> dict[str, BodyGrid]:
    """The grids of block and road of a run, by name."""
    mesh, y = run.mesh, run.mesh.y if run.mesh.n_across > 1 else np.zeros(1)
    x_block = mesh.x[mesh.first : mesh.last + 1]
    parts = {
        "block": (x_block, mesh.height, mesh.block, run.conductivity[0]),
        "road": (mesh.x, -mesh.depth[::-1], mesh.road, run.conductivity[1]),
    }
    layers = {"block": tuple(mesh.layers)} if mesh.joints else {}
    return {
        name: BodyGrid(x, y, z, np.swapaxes(mesh.everywhere(c), 1, 2), k, layers.get(name, (slice(None),)))
        for name, (x, z, c, k) in parts.items()
    }


def contact_fields(run: Run, frame: int) -> dict[str, np.ndarray]:
    """Fields on the contact, {name with unit: (cells,)}: temperatures, pressure, wear depth."""
    names = {"T_block": "degC", "T_spot": "degC", "T_road": "degC", "pressure": "Pa", "worn": "m"}
    if run.maps:
        return {f"{name}_{unit}": run.maps[name][frame].ravel() for name, unit in names.items()}
    return {f"{name}_{unit}": getattr(run, name)[run.frames[frame]] for name, unit in names.items()}


def _unstructured_grid(*edges: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Points (n, 3) in m, corners (cells, ...) and VTK type of a tensor grid of x, y, z, cells ordered (x, y, z).

    An axis with one edge has no extent: cells are then hexahedra, quads or lines.
    """
    points = np.stack(np.meshgrid(*edges, indexing="ij"), axis=-1).reshape(-1, 3)
    shape = [len(e) for e in edges]
    step = [shape[1] * shape[2], shape[2], 1]
    index = np.meshgrid(*(np.arange(max(n - 1, 1)) for n in shape), indexing="ij")
    first = np.sum([i * s for i, s in zip(index, step, strict=True)], axis=0).ravel()
    u, *rest = (s for s, n in zip(step, shape, strict=True) if n > 1)
    corners = [0, u]
    for v in rest:  # around each face, then the opposite face
        corners = [*corners, u + v, v] if len(corners) == 2 else [*corners, *(c + v for c in corners)]
    return points, first[:, None] + np.array(corners), {2: LINE, 4: QUAD, 8: HEXAHEDRON}[len(corners)]


def write_vtkhdf(run: Run, path: Path) -> None:
    """Write fields of a run as temporal VTKHDF (MultiBlock of UnstructuredGrid, format 2.1).

    Block and road have the cell data `T_degC` and `q_W_m2` and meet at z = 0, where the cells of `contact_fields` lie
    under the block (lines in 2D).  Lengths in m, time in s.  The group "flashtemp" contains the case text and the
    statistics.  Frames are written one by one.  Raises OSError where the disk is full.
    """
    times = run.time[run.frames]
    size = run.mesh.n_cells * (16 * len(times) + 120)
    if size > MAX_MEMORY_FILE_BYTES and shutil.disk_usage(path.parent).free < 1.05 * size:
        raise OSError(errno.ENOSPC, f"{path.name} needs {size / 1e9:.1f} GB")
    with h5py.File(path, "w") if size > MAX_MEMORY_FILE_BYTES else open_memory_file(path) as file:
        root = file.create_group("VTKHDF", track_order=True)
        _set_type(root, "MultiBlockDataSet")
        solids = body_grids(run)
        for name, body in solids.items():
            data = _create_leaf(
                root, name, *_unstructured_grid(body.x, body.y, body.z), times, {"T_degC": (), "q_W_m2": (3,)}
            )
            for i in range(len(times)):
                T = run.field[i][body.cells]
                data(i, {"T_degC": T.ravel(), "q_W_m2": body.heat_flux(T)})
        block = solids["block"]
        data = _create_leaf(
            root,
            "contact",
            *_unstructured_grid(block.x, block.y, np.zeros(1)),
            times,
            dict.fromkeys(contact_fields(run, 0), ()),
        )
        for i in range(len(times)):
            data(i, contact_fields(run, i))
        steps = root.create_group("Steps")  # VTK 9.7 shows only the first time without it; 9.4 cannot read it
        steps.attrs["NSteps"] = np.int64(len(times))
        steps["Values"] = times.astype(float)
        assembly = root.create_group("Assembly", track_order=True)
        for name in (*solids, "contact"):
            assembly[name] = h5py.SoftLink(f"/VTKHDF/{name}")
        about = file.create_group("flashtemp")
        about.attrs["title"] = run.title
        about.attrs["case"] = run.case_text
        about.attrs["slides_back"] = run.direction is not None
        for key, value in run.statistics.items():
            about.attrs[key] = value if isinstance(value, (int, float)) else str(value)


def _create_leaf(root, name: str, points, cells, kind: int, times: np.ndarray, data: dict[str, tuple]):
    """An unstructured grid of cells of one kind, with room for cell data {name: shape of a value} at every time.

    Returns write(frame, {name: (cells, ...)}).
    """
    leaf = root.create_group(name)
    _set_type(leaf, "UnstructuredGrid")
    n, corners = cells.shape
    leaf["Points"] = points
    leaf["Connectivity"] = cells.ravel().astype(np.int64)
    leaf["Offsets"] = np.arange(0, corners * n + 1, corners, dtype=np.int64)
    leaf["Types"] = np.full(n, kind, dtype=np.uint8)
    leaf["NumberOfPoints"] = np.array([len(points)], dtype=np.int64)
    leaf["NumberOfCells"] = np.array([n], dtype=np.int64)
    leaf["NumberOfConnectivityIds"] = np.array([corners * n], dtype=np.int64)
    for key, shape in data.items():
        leaf.create_dataset(f"CellData/{key}", (len(times) * n, *shape), np.float32)
        leaf[f"CellData/{key}"].attrs["units"] = UNIT_BY_SUFFIX[key.rsplit("_", 1)[1]]
    _write_steps(leaf, times, n, list(data))

    def write_frame(frame: int, values: dict[str, np.ndarray]) -> None:
        for key, array in values.items():
            leaf[f"CellData/{key}"][frame * n : (frame + 1) * n] = array

    return write_frame


@contextmanager
def open_memory_file(path: Path):
    """Yield an HDF5 file in memory and write it at the end, so that a full disk raises OSError and corrupts nothing."""
    name = path.with_name(f".{path.name}.image")  # never written, but HDF5 requires a name
    with h5py.File(name, "w", driver="core", backing_store=False) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    path.write_bytes(image)


def _set_type(group, kind: str) -> None:
    group.attrs["Version"] = np.array([2, 1], dtype=np.int64)
    group.attrs.create("Type", kind.encode("ascii"), dtype=h5py.string_dtype("ascii", len(kind)))


def _write_steps(leaf, times: np.ndarray, cells: int, names: list[str]) -> None:
    """Time steps of a leaf whose mesh never changes, with the cell data of these names."""
    steps = leaf.create_group("Steps")
    n = len(times)
    steps.attrs["NSteps"] = np.int64(n)
    steps["Values"] = times.astype(float)
    zero = np.zeros(n, dtype=np.int64)
    for name in ("PartOffsets", "PointOffsets"):
        steps[name] = zero
    steps["NumberOfParts"] = zero + 1
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        steps[name] = zero[:, None]
    offsets = steps.create_group("CellDataOffsets")
    for name in names:
        offsets[name] = np.arange(n, dtype=np.int64) * cells


def write_pvd(run: Run, folder: Path) -> Path:
    """Write a .pvd collection of block, road and contact for ParaView on VTK older than 9.5."""
    folder.mkdir(parents=True, exist_ok=True)
    entries, solids = [], body_grids(run)
    for i, t in enumerate(run.time[run.frames]):
        for part, (name, grid) in enumerate(_pyvista_parts(run, solids, i).items()):
            file = folder / f"{name}_{i:04d}.{'vtp' if name == 'contact' else 'vtr'}"
            grid.save(file)
            entries.append(f'    <DataSet timestep="{t:.9g}" part="{part}" name="{name}" file="{file.name}"/>')
    body = "\n".join(entries)
    path = folder / "fields.pvd"
    path.write_text(
        f'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n{body}\n'
        "  </Collection>\n</VTKFile>\n",
        encoding="utf-8",
    )
    return path


def _pyvista_parts(run: Run, solids: dict[str, BodyGrid], frame: int) -> dict:
    """pyvista grids of block and road and the lines of the contact at a frame."""
    import pyvista as pv

    out = {}
    for name, body in solids.items():
        out[name] = pv.RectilinearGrid(body.x, body.y, body.z)
        out[name].cell_data["T_degC"] = run.field[frame][body.cells].T.ravel()
    block = solids["block"]
    points, corners, kind = _unstructured_grid(block.x, block.y, np.zeros(1))
    cells = np.insert(corners, 0, corners.shape[1], axis=1).ravel()
    out["contact"] = pv.PolyData(points, lines=cells) if kind == LINE else pv.PolyData(points, faces=cells)
    for key, values in contact_fields(run, frame).items():
        out["contact"].cell_data[key] = values
    return out


@dataclass(frozen=True, repr=False)
class RunFields(DisplayMixin):
    """Fields of a finished run at the saved `times` (n,) in s."""

    path: Path
    times: np.ndarray

    def grids_at(self, t: float):
        """pyvista MultiBlock with "block", "road" and "contact" at the saved time nearest to t (s)."""
        import pyvista as pv

        reader = pv.get_reader(self.path).reader
        reader.SetStep(self._nearest_frame(t))
        reader.Update()
        return pv.wrap(reader.GetOutputDataObject(0))

    def T(self, body: str, t: float) -> np.ndarray:
        """Cell temperatures (cells,) in degC of "block" or "road" at the saved time nearest to t (s)."""
        return self.cells(body, "T_degC", t)

    def cells(self, body: str, name: str, t: float) -> np.ndarray:
        """Cell data of a body, such as "pressure_Pa" of "contact", at the saved time nearest to t (s); or BadInput."""
        k = self._nearest_frame(t)
        with h5py.File(self.path) as file:
            leaf = file["VTKHDF"].get(body)
            data = leaf.get("CellData") if leaf is not None else None
            if data is None or name not in data:
                known = [f"{b} {n}" for b, g in file["VTKHDF"].items() if "CellData" in g for n in g["CellData"]]
                raise BadInput(f"{self.path}: no {name} of '{body}'{suggest_name(f'{body} {name}', known)}")
            n = int(leaf["NumberOfCells"][0])
            return data[name][k * n : (k + 1) * n]

    def tensor(self, body: str, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Edges x, y, z (m; one y in 2D) of "block" or "road", T (nx, ny, nz) degC at the saved time next to t (s)."""
        with h5py.File(self.path) as file:
            x, y, z = (np.unique(axis) for axis in file["VTKHDF"][body]["Points"][:].T)
        return x, y, z, self.T(body, t).reshape([max(len(e) - 1, 1) for e in (x, y, z)])

    @property
    def case(self) -> str:
        """The case that was run, as TOML."""
        with h5py.File(self.path) as file:
            return str(file["flashtemp"].attrs["case"])

    @property
    def title(self) -> str:
        """The title of the run."""
        with h5py.File(self.path) as file:
            return str(file["flashtemp"].attrs["title"])

    @property
    def slides_back(self) -> bool:
        """Whether the block slides back at any time, so that x = 0 is not always the leading edge."""
        with h5py.File(self.path) as file:
            return bool(file["flashtemp"].attrs.get("slides_back", False))

    def __str__(self) -> str:
        first, last = self.times[0], self.times[-1]
        return f"Fields of '{self.title}'\n  {len(self.times)} times from {first:g} to {last:g} s\n  in {self.path}"

    def _nearest_frame(self, t: float) -> int:
        return int(np.argmin(np.abs(self.times - t)))

    at = RenamedAttribute("grids_at")


def open_fields(path) -> RunFields:
    """Open the fields.vtkhdf of a result folder, or the file itself.  Raises BadInput when there is none."""
    path = Path(path)
    file = path / "fields.vtkhdf" if path.is_dir() else path
    if not file.is_file():
        raise BadInput(f"{path}: no fields.vtkhdf there; give the folder of a finished run with output.vtk = true")
    try:
        with h5py.File(file) as handle:
            safe_hdf5.list_datasets(handle)  # raises for links into other files and for data that lie there
            times = handle["VTKHDF/block/Steps/Values"][:]
    except (OSError, KeyError) as fault:
        raise BadInput(f"{file}: not a field file of flashtemp; give the folder of a finished run") from fault
    return RunFields(file, times)
