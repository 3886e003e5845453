"""The result of a run: temperatures over position and time, energies, and the files they are written to."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import RenamedAttribute
from flashtemp.meshes.mesh import Mesh
from flashtemp.physics.interpolation import line_through_means


@dataclass(frozen=True, repr=False)
class Run(DisplayMixin):
    """Result of `integrate_schedule`: temperatures in degC, times in s, lengths in m, energies in J per metre.

    `time` (n,), `repetition` (n,), `slid` (n,) m since the first start, `sliding` (n,) bool;
    `T_block`, `T_spot`, `T_road`, `pressure` (n, lines under the block); `T_wake` (n, lines behind it) road
    surface averaged across y, over lanes and gaps; `friction` (n,) load
    weighted; `worn` (n, lines) worn depth in m; `tilt` (n,) of the holder in rad, leading edge down;
    `energy` {ledger entry: (n,)}; `frames` indices into `time` with cell temperatures
    `field` (frames, cells), road cells as lane means; `conductivity` W/(m K) of block, (n_block,) where it has layers,
    and road.
    In 3D profiles are means across y, and `maps` {name: (frames, lines, planes)} resolve them.
    x, `mesh` and `tilt` refer to the block whichever way it slides.  If it slides back at all, `direction` (n,) is 1 or
    -1, and `T_wake` behind it and `T_ahead` (n, lines before it) count from the edge that leads.
    """

    title: str
    mesh: Mesh
    time: np.ndarray
    repetition: np.ndarray
    slid: np.ndarray
    sliding: np.ndarray
    T_block: np.ndarray
    T_spot: np.ndarray
    T_road: np.ndarray
    T_wake: np.ndarray
    pressure: np.ndarray
    friction: np.ndarray
    worn: np.ndarray
    tilt: np.ndarray
    energy: dict[str, np.ndarray]
    frames: np.ndarray
    field: np.ndarray
    ambient_degC: float
    width: float
    conductivity: tuple[Any, float] = (0.25, 1.0)
    statistics: dict = dataclasses.field(default_factory=dict)
    case_text: str = ""
    maps: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    direction: np.ndarray | None = None
    T_ahead: np.ndarray | None = None

    @property
    def x(self) -> np.ndarray:
        """Line centres under the block, m from the edge that leads in forward sliding."""
        return self.mesh.x_block

    @property
    def x_wake(self) -> np.ndarray:
        """Line centres behind the block, m from the leading edge."""
        return self._leading_edge_mesh.x_centre[self._leading_edge_mesh.last :]

    @property
    def x_ahead(self) -> np.ndarray:
        """Line centres before the block, m from the leading edge: negative."""
        return self._leading_edge_mesh.x_centre[: self._leading_edge_mesh.first]

    @property
    def _leading_edge_mesh(self) -> Mesh:
        """The mesh with x from the leading edge; a mesh for both directions is its own mirror image."""
        return self.mesh if self.direction is None or np.any(self.direction > 0) else self.mesh.mirrored()

    def leading_line_index(self, k: int) -> int:
        """Index of the leading line under the block at time number k: 0, or -1 while it slides back."""
        return 0 if self.direction is None or self.direction[k] > 0 else -1

    def section(self, frame: int, plane: int | None = None) -> np.ndarray:
        """Temperatures (n_plane,) degC of a frame in one plane (x, z), by default the middle of the width."""
        cells, n = self.mesh.planes(self.field[frame]), self.mesh.n_across
        return cells[:, (n - 1) // 2 : n // 2 + 1].mean(axis=1) if plane is None else cells[:, plane]

    @cached_property
    def last_sliding_index(self) -> int:
        """Index of the end of the last repetition of sliding."""
        return int(np.flatnonzero(self.sliding)[-1])

    def at_x(self, values: np.ndarray, x: float) -> float:
        """Value of a profile (lines,) at x (m), constant beyond the centres of the outermost cells."""
        return float(np.interp(x, self.x, values))

    def at_mean(self, values: np.ndarray) -> float:
        """Mean over the block's length of a profile (lines,)."""
        return float(values @ self.mesh.dx_block / self.mesh.dx_block.sum())

    @cached_property
    def worn_volume(self) -> float:
        """Rubber worn off during the run, m3."""
        return float((self.worn[-1] - self.worn[0]) @ self.mesh.dx_block) * self.width

    @cached_property
    def friction_per_repetition(self) -> list[float]:
        """Load-weighted friction averaged over the slid distance of every repetition."""
        out = []
        for r in np.unique(self.repetition[self.sliding]):
            on = self.sliding & (self.repetition == r) & np.isfinite(self.friction)
            if not on.any():  # no friction was recorded in this repetition
                continue
            s, mu = self.slid[on], self.friction[on]
            span = s[-1] - s[0]
            out.append(float(np.trapezoid(mu, s) / span) if span > 0 else float(mu[-1]))
        return out

    @cached_property
    def budget(self) -> dict[str, float]:
        """Friction heat and where it went, J per metre across: block, road, holder, air."""
        e = {k: v[-1] for k, v in self.energy.items()}
        return {
            "friction": e["friction"],
            "block": e["block"],
            "road": e["into_road"],
            "holder": 0.0 - e.get("holder", 0.0),
            "air": 0.0 - e.get("air", 0.0),
        }

    @cached_property
    def _heat_defects(self) -> tuple[float, float, float]:
        """Heat missing in the block, in block and road together, and all heat that moved (J per metre).

        For both together the heat across the interface cancels, so the second number is free of its integration error.
        """
        e = {k: v[-1] for k, v in self.energy.items()}
        losses = sum(v for k, v in e.items() if k not in NON_LOSS_ENTRIES)
        both = e["friction"] + losses - e["block"] - e["share"] * (e["lanes"] + e["lane_out"] - e["lane_air"])
        block = e["friction"] - e["into_road"] + losses - e["block"]
        return block, both, max(1e-300, *(abs(v) for k, v in e.items() if k != "share"))

    @cached_property
    def energy_imbalance(self) -> float:
        """Heat created or lost in block and road together, relative to all heat that moved."""
        _, both, moved = self._heat_defects
        return float(abs(both) / moved)

    @cached_property
    def partition_error(self) -> float:
        """Error of the split of heat between block and road, relative to all heat that moved; it falls with rtol."""
        block, _, moved = self._heat_defects
        return float(abs(block) / moved)

    @cached_property
    def summary(self) -> dict:
        """The numbers of `summary.json`."""
        T, lead = (
            self.T_block[self.last_sliding_index] - self.ambient_degC,
            self.leading_line_index(self.last_sliding_index),
        )
        return {
            "title": self.title,
            "T_max_degC": float(max(np.nanmax(self.T_spot), np.nanmax(self.T_block))),
            "rise_leading_K": float(T[lead]),
            "rise_middle_K": self.at_x(T, 0.5 * self.mesh.x[self.mesh.last]),
            "rise_trailing_K": float(T[-1 - lead]),
            "friction_per_repetition": self.friction_per_repetition,
            "energy_imbalance": self.energy_imbalance,
            "partition_error": self.partition_error,
            "energy_J": {k: v * self.width for k, v in self.budget.items()},
            "worn_mean_m": self.at_mean(self.worn[-1]),
            "worn_leading_m": float(self.worn[-1][lead]),
            "worn_volume_m3": self.worn_volume,
            "cells": self.mesh.n_cells,
            **self.statistics,
        }

    @cached_property
    def worn_profile(self) -> np.ndarray:
        """Rows (x in m, worn depth in m at the end) of a polyline with the same mean in every column."""
        mesh = self.mesh
        return np.column_stack(line_through_means(mesh.x[mesh.first : mesh.last + 1], self.worn[-1]))

    def dataset(self):
        """The xarray Dataset of `run.nc`."""
        import xarray as xr

        along = ("time", "x")
        data = {
            "T_block": (along, self.T_block, {"units": "degC", "long_name": "block surface, averaged across y"}),
            "T_spot": (along, self.T_spot, {"units": "degC", "long_name": "in the macroasperity contact regions"}),
            "T_road": (along, self.T_road, {"units": "degC", "long_name": "road surface in the lanes"}),
            "T_wake": (
                ("time", "x_wake"),
                self.T_wake,
                {"units": "degC", "long_name": "road surface behind, averaged across y"},
            ),
            "pressure": (along, self.pressure, {"units": "Pa", "long_name": "nominal contact pressure"}),
            "worn": (along, self.worn, {"units": "m", "long_name": "worn depth of the block"}),
            "tilt": ("time", self.tilt, {"units": "rad", "long_name": "turn of the holder, leading edge down"}),
            "repetition": ("time", self.repetition, {"units": "1", "long_name": "repetition, 1-based"}),
            "slid": ("time", self.slid, {"units": "m", "long_name": "distance slid since the first start"}),
            "sliding": ("time", self.sliding.astype(np.int8), {"units": "1", "long_name": "1 while sliding"}),
            "friction": ("time", self.friction, {"units": "1", "long_name": "load-weighted friction coefficient"}),
        }
        places = {"T_wake": "x_wake", "T_ahead": "x_ahead"}
        if self.T_ahead is not None:
            before = {"units": "degC", "long_name": "road surface before the block, averaged across y"}
            data["T_ahead"] = (("time", "x_ahead"), self.T_ahead, before)
            which = {"units": "1", "long_name": "1 forward, -1 back: the edge at the largest x leads"}
            data["direction"] = ("time", self.direction.astype(np.int8), which)
        wide = ("T_block", "T_spot", "T_road", "T_wake", "T_ahead", "pressure", "worn")
        about = {name: data[name][2] for name in wide if name in data}
        about["cover"] = {"units": "1", "long_name": "covered by macroasperity contact regions"}
        for name, values in self.maps.items():
            place = places.get(name, "x")
            words = about[name] | {"long_name": about[name]["long_name"].removesuffix(", averaged across y")}
            data[f"{name}_map"] = (("time_map", place, "y"), values, words)
        for name, values in self.energy.items():
            unit = "1" if name == "share" else "J/m"
            data[f"energy_{name}"] = ("time", values, {"units": unit, "long_name": f"ledger: {name}"})
        across = {
            "time_map": ("time_map", self.time[self.frames], {"units": "s", "long_name": "time of the maps"}),
            "y": ("y", self.mesh.y_centre, {"units": "m", "long_name": "distance from the centre line"}),
        }
        ahead = {}
        if self.T_ahead is not None:
            ahead["x_ahead"] = ("x_ahead", self.x_ahead, {"units": "m", "long_name": "place before the block, < 0"})
        return xr.Dataset(
            data,
            coords=(across if self.maps else {})
            | {
                "time": ("time", self.time, {"units": "s", "long_name": "time since the first start of sliding"}),
                "x": ("x", self.x, {"units": "m", "long_name": "distance from the leading edge"}),
                "x_wake": ("x_wake", self.x_wake, {"units": "m", "long_name": "place behind the block"}),
            }
            | ahead,
            attrs={"title": self.title, "ambient_degC": self.ambient_degC, "Conventions": "CF-1.11"},
        )

    def save(self, folder: Path) -> None:
        """Write `run.nc`, `summary.json`, `profiles.csv` and, for a worn block, `worn.csv` to an existing folder."""
        ds = self.dataset()
        ds["time"].encoding["dtype"] = "float64"
        # built in memory and written at once: a full disk raises OSError, where the HDF5 library may fail otherwise
        (folder / "run.nc").write_bytes(bytes(ds.to_netcdf(engine="h5netcdf")))
        (folder / "summary.json").write_text(json.dumps(self.summary, indent=2) + "\n", encoding="utf-8")
        profile_header = "x_m,T_block_degC,T_spot_degC,T_road_degC,pressure_Pa,worn_m"
        k = self.last_sliding_index
        along = (self.T_block, self.T_spot, self.T_road, self.pressure, self.worn)
        table = np.column_stack([self.x, *(values[k] for values in along)])
        tables = {"profiles.csv": (profile_header, table)}
        if self.worn[-1].any():
            tables["worn.csv"] = ("x_m,worn_m", self.worn_profile)
        for name, (head, table) in tables.items():
            np.savetxt(folder / name, table, delimiter=",", header=head, comments="", fmt="%.8g")

    def __str__(self) -> str:
        s = self.summary
        remarks = "".join(f"\n  {remark}" for remark in s.get("remarks", ()))
        return (
            f"Run '{self.title}'\n"
            f"  rise at the block's surface: leading {s['rise_leading_K']:.2f} K, middle {s['rise_middle_K']:.2f} K,"
            f" trailing {s['rise_trailing_K']:.2f} K; hottest spot {s['T_max_degC']:.1f} degC\n"
            f"  heat: {100 * s['energy_J']['road'] / max(s['energy_J']['friction'], 1e-300):.1f} % into the road;"
            f" energy imbalance {s['energy_imbalance']:.1e}\n"
            f"  {s['cells']} cells, {s.get('steps', 0)} steps, {s.get('wall_s', 0.0):.2f} s{remarks}"
        )

    def to_table(self) -> DisplayTable:
        s = self.summary
        rows = [
            ("rise at the leading edge", s["rise_leading_K"], "K"),
            ("rise in the middle", s["rise_middle_K"], "K"),
            ("rise at the trailing edge", s["rise_trailing_K"], "K"),
            ("hottest spot", s["T_max_degC"], "degC"),
            ("friction, last repetition", (s["friction_per_repetition"] or [float("nan")])[-1], "1"),
            ("mean worn depth", s["worn_mean_m"], "m"),
            ("energy imbalance", s["energy_imbalance"], "1"),
            ("cells", s["cells"], ""),
        ]
        heat = DisplayTable("Where the heat went", [(name, value, "J") for name, value in s["energy_J"].items()])
        each = [(n, mu) for n, mu in enumerate(s["friction_per_repetition"], 1)]
        friction = DisplayTable("Friction", each, ("repetition", "mu"))
        return DisplayTable(f"Run '{self.title}'", rows, notes=s.get("remarks", ()), parts=[heat, friction])

    last = RenamedAttribute("last_sliding_index")
    leads = RenamedAttribute("leading_line_index")


NON_LOSS_ENTRIES = {"friction", "into_road", "lane_out", "lane_air", "block", "lanes", "share"}
