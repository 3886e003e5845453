"""VTK for ParaView: one temporal VTKHDF file with block, road and contact, and the reader that goes with it."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from flashtemp.errors import BadInput, nearest
from flashtemp.run import Run

LINE, QUAD = 3, 9  # VTK cell types
UNITS = {"degC": "degC", "Pa": "Pa", "m": "m", "m2": "W/m2"}  # by the end of a name


def bodies(run: Run) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray, float]]:
    """Block and road: x edges, z edges (m), cell indices (nx, nz) from low to high z, conductivity."""
    mesh = run.mesh
    x_block = mesh.x[mesh.first : mesh.last + 1]
    k = run.conductivity
    return {
        "block": (x_block, mesh.height, mesh.block, k[0]),
        "road": (mesh.x, -mesh.depth[::-1], mesh.road, k[1]),
    }


def heat_flux(T: np.ndarray, x: np.ndarray, z: np.ndarray, k: float) -> np.ndarray:
    """Conductive heat flux -k grad T (cells, 3) in W/m2 of cell temperatures T (nx, nz)."""
    centre = [0.5 * (e[1:] + e[:-1]) for e in (x, z)]
    gx, gz = (np.gradient(T, c, axis=a) if len(c) > 1 else np.zeros_like(T) for a, c in enumerate(centre))
    return -k * np.stack([gx, np.zeros_like(gx), gz], axis=-1).reshape(-1, 3)


def contact(run: Run) -> dict[str, np.ndarray]:
    """What ParaView plots along the contact, {name with unit: (frames, lines)}: temperatures, pressure, worn depth."""
    along = {
        "T_block_degC": run.T_block, "T_spot_degC": run.T_spot, "T_road_degC": run.T_road,
        "pressure_Pa": run.pressure, "worn_m": run.worn,
    }  # fmt: skip
    return {name: values[run.frames] for name, values in along.items()}


def _grid(x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) in m and quads (cells, 4) of a tensor grid, cells ordered (x, z)."""
    X, Z = np.meshgrid(x, z, indexing="ij")
    points = np.stack([X, np.zeros_like(X), Z], axis=-1).reshape(-1, 3)
    i, k = np.meshgrid(np.arange(len(x) - 1), np.arange(len(z) - 1), indexing="ij")
    a = (i * len(z) + k).ravel()
    return points, np.stack([a, a + len(z), a + len(z) + 1, a + 1], axis=-1)


def _chain(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) in m and lines (cells, 2) along x at z = 0."""
    first = np.arange(len(x) - 1)
    return np.stack([x, 0 * x, 0 * x], axis=-1), np.stack([first, first + 1], axis=-1)


def write(run: Run, path: Path) -> None:
    """Write fields of a run as temporal VTKHDF (MultiBlock of UnstructuredGrid, format 2.1).

    Block and road, with cell data `T_degC` and `q_W_m2`, share one interface at z = 0; there lie the
    line cells of `contact` under the block.  Lengths in m, time in s.  Case text and statistics travel
    in the group "flashtemp" beside the data.
    """
    times = run.time[run.frames]
    with in_memory(path) as file:
        root = file.create_group("VTKHDF", track_order=True)
        _mark(root, "MultiBlockDataSet")
        for name, (x, z, cells, k) in bodies(run).items():
            T = run.field[:, cells]
            q = np.stack([heat_flux(f, x, z, k) for f in T])
            _leaf(root, name, *_grid(x, z), QUAD, times, {"T_degC": T.reshape(len(times), -1), "q_W_m2": q})
        under = run.mesh.x[run.mesh.first : run.mesh.last + 1]
        _leaf(root, "contact", *_chain(under), LINE, times, contact(run))
        steps = root.create_group("Steps")  # VTK 9.7 offers only the first time without it, 9.4 stumbles over it
        steps.attrs["NSteps"] = np.int64(len(times))
        steps["Values"] = times.astype(float)
        assembly = root.create_group("Assembly", track_order=True)
        for name in (*bodies(run), "contact"):
            assembly[name] = h5py.SoftLink(f"/VTKHDF/{name}")
        about = file.create_group("flashtemp")
        about.attrs["title"] = run.title
        about.attrs["case"] = run.case_text
        for key, value in run.statistics.items():
            about.attrs[key] = value if isinstance(value, (int, float)) else str(value)


def _leaf(root, name: str, points, cells, kind: int, times: np.ndarray, data: dict[str, np.ndarray]) -> None:
    """An unstructured grid of cells of one kind with cell data (times, cells, ...) at every time."""
    leaf = root.create_group(name)
    _mark(leaf, "UnstructuredGrid")
    n, corners = cells.shape
    leaf["Points"] = points
    leaf["Connectivity"] = cells.ravel().astype(np.int64)
    leaf["Offsets"] = np.arange(0, corners * n + 1, corners, dtype=np.int64)
    leaf["Types"] = np.full(n, kind, dtype=np.uint8)
    leaf["NumberOfPoints"] = np.array([len(points)], dtype=np.int64)
    leaf["NumberOfCells"] = np.array([n], dtype=np.int64)
    leaf["NumberOfConnectivityIds"] = np.array([corners * n], dtype=np.int64)
    for key, values in data.items():
        leaf[f"CellData/{key}"] = values.reshape(len(times) * n, *values.shape[2:]).astype(np.float32)
        leaf[f"CellData/{key}"].attrs["units"] = UNITS[key.rsplit("_", 1)[1]]
    _steps(leaf, times, n, list(data))


@contextmanager
def in_memory(path: Path):
    """An HDF5 file built in memory and written in one go: a full disk raises OSError, nothing worse."""
    with h5py.File(path.name, "w", driver="core", backing_store=False) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    path.write_bytes(image)


def _mark(group, kind: str) -> None:
    group.attrs["Version"] = np.array([2, 1], dtype=np.int64)
    group.attrs.create("Type", kind.encode("ascii"), dtype=h5py.string_dtype("ascii", len(kind)))


def _steps(leaf, times: np.ndarray, cells: int, names: list[str]) -> None:
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
    entries = []
    for i, t in enumerate(run.time[run.frames]):
        for part, (name, grid) in enumerate(_parts(run, i).items()):
            file = folder / f"{name}_{i:04d}.{'vtp' if name == 'contact' else 'vtr'}"
            grid.save(file)
            entries.append(f'    <DataSet timestep="{t:.9g}" part="{part}" name="{name}" file="{file.name}"/>')
    body = "\n".join(entries)
    path = folder / "fields.pvd"
    path.write_text(
        f'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n{body}\n'
        "  </Collection>\n</VTKFile>\n"
    )
    return path


def _parts(run: Run, frame: int) -> dict:
    """pyvista grids of block and road and the lines of the contact at a frame."""
    import pyvista as pv

    out = {}
    for name, (x, z, cells, _) in bodies(run).items():
        out[name] = pv.RectilinearGrid(x, np.zeros(1), z)
        out[name].cell_data["T_degC"] = run.field[frame][cells].T.ravel()
    points, lines = _chain(run.mesh.x[run.mesh.first : run.mesh.last + 1])
    out["contact"] = pv.PolyData(points, lines=np.insert(lines, 0, 2, axis=1).ravel())
    for key, values in contact(run).items():
        out["contact"].cell_data[key] = values[frame]
    return out


@dataclass(frozen=True)
class Fields:
    """Fields of a finished run: `times` (n,) in s, and the grids at any of them."""

    path: Path
    times: np.ndarray

    def at(self, t: float):
        """pyvista MultiBlock with "block", "road" and "contact" at the kept time nearest to t."""
        import pyvista as pv

        reader = pv.get_reader(self.path).reader
        reader.SetStep(self._nearest(t))
        reader.Update()
        return pv.wrap(reader.GetOutputDataObject(0))

    def T(self, body: str, t: float) -> np.ndarray:
        """Cell temperatures (cells,) in degC of "block" or "road" at the kept time nearest to t."""
        return self.cells(body, "T_degC", t)

    def cells(self, body: str, name: str, t: float) -> np.ndarray:
        """Cell data of a body at the kept time nearest to t, as "pressure_Pa" of "contact"; BadInput when unknown."""
        k = self._nearest(t)
        with h5py.File(self.path) as file:
            leaf = file["VTKHDF"].get(body)
            data = leaf.get("CellData") if leaf is not None else None
            if data is None or name not in data:
                known = [f"{b} {n}" for b, g in file["VTKHDF"].items() if "CellData" in g for n in g["CellData"]]
                raise BadInput(f"{self.path}: no {name} of '{body}'{nearest(f'{body} {name}', known)}")
            n = int(leaf["NumberOfCells"][0])
            return data[name][k * n : (k + 1) * n]

    def _nearest(self, t: float) -> int:
        return int(np.argmin(np.abs(self.times - t)))


def open_fields(path) -> Fields:
    """Open the fields.vtkhdf of a result folder (or the file itself); BadInput when there is none."""
    path = Path(path)
    file = path / "fields.vtkhdf" if path.is_dir() else path
    if not file.is_file():
        raise BadInput(f"{path}: no fields.vtkhdf there; give the folder of a finished run with output.vtk = true")
    with h5py.File(file) as handle:
        times = handle["VTKHDF/block/Steps/Values"][:]
    return Fields(file, times)
