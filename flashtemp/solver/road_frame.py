"""The road in its own frame, for resolved spots (theory.md, section 1.3): columns of road pass the block as a whole.

The state stores the columns of road at fixed places during a `leg`.  In the block's frame they lie `k` lines further
downstream, plus a fraction `s` of a line.  So nothing is advected from cell to cell, and no heat is smeared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flashtemp.meshes.mesh import Mesh

MAX_SPACING_DIFFERENCE = 1e-6  # largest relative difference of the line lengths of an even mesh
RIM_MEAN_RATIO = 0.5  # of eq. (7c) in the block: mean over the passage of a rim that crosses a cell squarely
LEG_END_RATIO = 1e-9  # of a leg: closer to its end than this a leg counts as complete


class RoadOverlap(NamedTuple):
    """The road under each column of the block: cells `own` and, with the fraction `share` of the contact, `other`.

    All are (columns,).  `other` is None where the road's columns lie on the block's lines; otherwise these cells are
    `shift` columns further on.
    """

    own: np.ndarray
    other: np.ndarray | None = None
    share: Any = None
    shift: int = 0

    def column_values(self, T) -> np.ndarray:
        """Mean (columns,) of values of cells over the road that touches each column of the block."""
        values: np.ndarray = T[self.own]
        return values if self.other is None else values + self.share * (T[self.other] - values)

    def heat_parts(self, heat) -> list[tuple[np.ndarray, np.ndarray]]:
        """(cells, heat) by which `heat` (columns,) is divided among road cells: the weights of `column_values`.

        The same weights in both directions conserve heat.
        """
        if self.other is None:
            return [(self.own, heat)]
        return [(self.own, (1.0 - self.share) * heat), (self.other, self.share * heat)]

    def add_heat(self, heat, q) -> None:
        """Add `heat` (columns,) to the cells q of the road."""
        for cells, part in self.heat_parts(heat):
            q[cells] += part


@dataclass(frozen=True)
class RoadFrame:
    """A mesh with lines of length `dx` (m), of which `leg_lines` pass before the road is shifted back on the mesh."""

    mesh: Mesh
    dx: float
    leg_lines: int

    @classmethod
    def from_scene(cls, scene, laws) -> RoadFrame | None:
        """The frame of a scene with resolved spots.

        None for an uneven mesh, without road in front of and behind the block, or if sliding reverses.
        """
        mesh, now = scene.mesh, scene.law_context(scene.schedule.phases[0], 0.0)
        dx = np.diff(mesh.x)
        if not laws("contact.resolved", 0.0, None, now) > 0 or np.ptp(dx) > MAX_SPACING_DIFFERENCE * dx.mean():
            return None
        if mesh.first < 2 or mesh.last == mesh.n_lines or len(scene.schedule.directions) > 1:
            return None
        return cls(mesh, float(dx.mean()), mesh.first - 1)

    # --- where the road is ---------------------------------------------------------------------
    def split_phase(self, schedule, phase) -> list[tuple[int, Any]]:
        """(number of the leg, phase cut to that leg) for all legs of a phase; legs count from the first start."""
        way = self.leg_lines * self.dx
        if not phase.sliding:
            return [(max(math.ceil((phase.slid_before + schedule.distance) / way - LEG_END_RATIO) - 1, 0), phase)]
        begin, end = (phase.slid_before + schedule.slid_distance(phase, t) for t in (phase.begin, phase.end))
        # a phase that ends at the end of a leg, but for rounding, belongs to that leg and not to the next
        first, last = math.floor(begin / way + LEG_END_RATIO), math.ceil(end / way - LEG_END_RATIO)
        inner = [
            phase.start + float(schedule.speed.time_at_integral(j * way - phase.slid_before))
            for j in range(first + 1, last)
        ]
        cuts = [phase.begin, *inner, phase.end]
        return [(first + i, replace(phase, begin=cuts[i], end=cuts[i + 1])) for i in range(len(cuts) - 1)]

    def line_offset(self, passed: float) -> tuple[int, float]:
        """Number of lines that have passed after `passed` m, and the remaining fraction of a line, -0.5 to 0.5."""
        whole = round(passed / self.dx)
        return whole, passed / self.dx - whole

    def shifted_lines(self, passed: float, leg: int) -> int:
        """Number k of lines by which the road lies further downstream than it is stored."""
        return min(max(self.line_offset(passed)[0] - leg * self.leg_lines, 0), self.leg_lines)

    def strip_edges(self, passed: float) -> np.ndarray:
        """Edges (2 lines + 1,) m of strips: each line under the block is divided where a column of road ends."""
        mesh, s = self.mesh, self.line_offset(passed)[1]
        x = mesh.x[mesh.first : mesh.last + 1]
        inner = (x[:-1] if s >= 0 else x[1:]) + s * self.dx
        return np.append(np.stack([x[:-1], inner], axis=1).ravel(), x[-1])

    def column_edges(self, passed: float) -> np.ndarray:
        """Edges (m) of the columns of road under the block, and of one more before it and behind it."""
        return self.mesh.x[self.mesh.first - 1 : self.mesh.last + 2] + self.line_offset(passed)[1] * self.dx

    def rim_resistance(self, under: RoadOverlap, bare: np.ndarray, passed: np.ndarray, road) -> np.ndarray:
        """R of eq. (7c) (columns,) m2 K/W: how much hotter a spot is than the cell of `road` that it covers in part.

        `bare` (columns of road between `column_edges`, planes) is the uncovered fraction 1 - f, and `passed` (columns,)
        s the contact time.  Early on the heat stays where it entered (resistance theta), later it spreads sideways by a
        cell (dx/2k); the two act in parallel.
        """
        ny = self.mesh.n_across
        free = bare[1:-1].ravel()
        neighbour = (bare[:-2] if under.shift < 0 else bare[2:]).ravel()
        cell = np.minimum(self.dx, np.diff(self.mesh.y)) if ny > 1 else np.full(1, self.dx)
        early = 2.0 * np.sqrt(passed / np.pi) / road.effusivity
        late = np.tile(cell, len(free) // ny) / (2.0 * road.conductivity)
        rim: np.ndarray = (free + under.share * (neighbour - free)) * early * late / (early + late)
        return rim

    def partial_cover_resistance(self, cover: np.ndarray, speed: float, rubber) -> np.ndarray:
        """Resistance (columns,) m2 K/W by which spots are hotter than the cells of `rubber` that they `cover` in part.

        It is half of eq. (7c) for the rubber, because the rim of a spot passes over a cell within about dx/v.
        """
        theta = 2.0 * np.sqrt(self.dx / max(speed, 1e-300) / np.pi) / rubber.effusivity
        late = self.dx / (2.0 * rubber.conductivity)
        resistance: np.ndarray = RIM_MEAN_RATIO * np.clip(1.0 - cover, 0.0, 1.0) * theta * late / (theta + late)
        return resistance

    def find_overlap(self, passed: float, own: np.ndarray, covered) -> RoadOverlap:
        """The overlap of block and road columns, for areas `covered` (2 lines, planes) between the `strip_edges`."""
        mesh, before = self.mesh, self.line_offset(passed)[1] >= 0
        neighbour, total = covered[0 if before else 1 :: 2].ravel(), (covered[::2] + covered[1::2]).ravel()
        lines = np.arange(mesh.first, mesh.last) + (-1 if before else 1)
        other = mesh.everywhere(mesh.road[lines, -1]).ravel()
        share = neighbour / np.where(total > 0, total, 1.0)
        return RoadOverlap(own, other, share, -mesh.n_across if before else mesh.n_across)

    # --- from the stored state to the block's frame and back ------------------------------------
    def to_block_frame(self, y: np.ndarray, k: int, fresh) -> np.ndarray:
        """A state or rate in the block's frame: road shifted by k lines, `fresh` (n_road n_across,) road in front."""
        if k == 0:
            return y
        mesh, out = self.mesh, y.astype(np.result_type(y, fresh))
        old, new = (mesh.planes(a[: mesh.n_cells]) for a in (y, out))
        new[mesh.road[k:]] = old[mesh.road[: mesh.n_lines - k]]
        new[mesh.road[:k]] = np.reshape(fresh, (mesh.n_road, -1)) if np.ndim(fresh) else fresh
        return out

    def to_memory_frame(self, y: np.ndarray, k: int, out: np.ndarray, gone) -> np.ndarray:
        """Write y of the block's frame to `out` as it is stored; the reverse of `to_block_frame`.

        Road that has left the window gets the values `gone`.  Returns the road (k, n_road, n_across) that has entered,
        for which there is no place in the stored state.
        """
        mesh = self.mesh
        out[:] = y
        cells, moved = mesh.planes(y[: mesh.n_cells]), mesh.planes(out[: mesh.n_cells])
        if k:
            moved[mesh.road[: mesh.n_lines - k]] = cells[mesh.road[k:]]
            moved[mesh.road[mesh.n_lines - k :]] = gone if np.ndim(gone) == 0 else mesh.planes(gone)[mesh.road[-k:]]
        front: np.ndarray = cells[mesh.road[:k]]
        return front

    def interpolate_to_mesh(self, T: np.ndarray, passed: float) -> np.ndarray:
        """Rises T (cells,) with the road's interpolated between its columns to the line centres of the mesh."""
        mesh, s = self.mesh, self.line_offset(passed)[1]
        out = T.copy()
        road, cells = mesh.planes(T)[mesh.road], mesh.planes(out)
        here, there = (slice(1, None), slice(None, -1)) if s >= 0 else (slice(None, -1), slice(1, None))
        cells[mesh.road[here]] += abs(s) * (road[there] - road[here])
        return out
