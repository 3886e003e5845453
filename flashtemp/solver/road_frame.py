"""The road in its own frame where spots are resolved: its columns keep their heat and pass under the block whole.

In memory the columns of road stay where they are for a `leg` of way; seen from the block they lie `k` lines further
downstream, and a part `s` of a cell.  So no heat is carried from cell to cell, and none is smeared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flashtemp.meshes.mesh import Mesh

MAX_SPACING_DIFFERENCE = 1e-6  # relative difference of cell lengths that rounding may leave
RIM_MEAN_RATIO = 0.5  # mean over the passage of a rim that crosses a cell squarely; aslant it is more
LEG_END_RATIO = 1e-9  # of a leg: closer to its end a leg counts as complete


class RoadOverlap(NamedTuple):
    """The road under each column of the block: cells `own`, and beside them `other` with a `share` of the contact.

    All (columns,).  `other` is None where the road lies on the block's lines; those are `shift` columns further on.
    """

    own: np.ndarray
    other: np.ndarray | None = None
    share: Any = None
    shift: int = 0

    def column_values(self, T) -> np.ndarray:
        """What the block's columns see of values of cells, over what touches."""
        here: np.ndarray = T[self.own]
        return here if self.other is None else here + self.share * (T[self.other] - here)

    def heat_parts(self, heat) -> list[tuple[np.ndarray, np.ndarray]]:
        """(cells, heat) of what the columns give to the road, in the shares in which they see it."""
        if self.other is None:
            return [(self.own, heat)]
        return [(self.own, (1.0 - self.share) * heat), (self.other, self.share * heat)]

    def add_heat(self, heat, q) -> None:
        """Add `heat` (columns,) to the cells q of the road."""
        for cells, part in self.heat_parts(heat):
            q[cells] += part


@dataclass(frozen=True)
class RoadFrame:
    """Lines of `dx` (m) on a mesh, of which `leg_lines` pass before the road is put back on the mesh."""

    mesh: Mesh
    dx: float
    leg_lines: int

    @classmethod
    def from_scene(cls, scene, laws) -> RoadFrame | None:
        """That of a scene with resolved spots; None where lines are not even, none lies in front, or sliding turns."""
        mesh, now = scene.mesh, scene.law_context(scene.schedule.phases[0], 0.0)
        dx = np.diff(mesh.x)
        if not laws("contact.resolved", 0.0, None, now) > 0 or np.ptp(dx) > MAX_SPACING_DIFFERENCE * dx.mean():
            return None
        if mesh.first < 2 or mesh.last == mesh.n_lines or len(scene.schedule.directions) > 1:
            return None
        return cls(mesh, float(dx.mean()), mesh.first - 1)

    # --- where the road is ---------------------------------------------------------------------
    def split_phase(self, schedule, phase) -> list[tuple[int, Any]]:
        """(number of the leg, phase cut to it) of a phase: legs are counted from the first start."""
        way = self.leg_lines * self.dx
        if not phase.sliding:
            return [(max(math.ceil((phase.slid_before + schedule.distance) / way - LEG_END_RATIO) - 1, 0), phase)]
        begin, end = (phase.slid_before + schedule.slid_distance(phase, t) for t in (phase.begin, phase.end))
        first, last = math.floor(begin / way + LEG_END_RATIO), math.ceil(end / way - LEG_END_RATIO)
        inner = [
            phase.start + float(schedule.speed.time_at_integral(j * way - phase.slid_before))
            for j in range(first + 1, last)
        ]
        cuts = [phase.begin, *inner, phase.end]
        return [(first + i, replace(phase, begin=cuts[i], end=cuts[i + 1])) for i in range(len(cuts) - 1)]

    def line_offset(self, passed: float) -> tuple[int, float]:
        """Lines by which the road has passed after `passed` m, and the rest of a line, -0.5 to 0.5."""
        whole = round(passed / self.dx)
        return whole, passed / self.dx - whole

    def shifted_lines(self, passed: float, leg: int) -> int:
        """By how many lines the road lies further downstream than in memory."""
        return min(max(self.line_offset(passed)[0] - leg * self.leg_lines, 0), self.leg_lines)

    def strip_edges(self, passed: float) -> np.ndarray:
        """Edges (2 columns + 1,) m that divide each line under the block where a column of road ends."""
        mesh, s = self.mesh, self.line_offset(passed)[1]
        x = mesh.x[mesh.first : mesh.last + 1]
        inner = (x[:-1] if s >= 0 else x[1:]) + s * self.dx
        return np.append(np.stack([x[:-1], inner], axis=1).ravel(), x[-1])

    def column_edges(self, passed: float) -> np.ndarray:
        """Edges m of the columns of road under the block, and of one more before and behind it."""
        return self.mesh.x[self.mesh.first - 1 : self.mesh.last + 2] + self.line_offset(passed)[1] * self.dx

    def rim_resistance(self, under: RoadOverlap, bare: np.ndarray, passed: np.ndarray, road) -> np.ndarray:
        """By how much (columns,) m2 K/W a spot is hotter than cells of `road` of which a share `bare` is left free.

        `bare` (columns of road between `column_edges`, planes).  After a time `passed` (columns,) s the heat is still where it
        came in, later it has gone sideways by a cell: resistances side by side (theory.md, eq. (7c)).
        """
        ny = self.mesh.n_across
        free = bare[1:-1].ravel()
        beside = (bare[:-2] if under.shift < 0 else bare[2:]).ravel()
        cell = np.minimum(self.dx, np.diff(self.mesh.y)) if ny > 1 else np.full(1, self.dx)
        early = 2.0 * np.sqrt(passed / np.pi) / road.effusivity
        late = np.tile(cell, len(free) // ny) / (2.0 * road.conductivity)
        rim: np.ndarray = (free + under.share * (beside - free)) * early * late / (early + late)
        return rim

    def partial_cover_resistance(self, cover: np.ndarray, speed: float, rubber) -> np.ndarray:
        """By how much (columns,) m2 K/W spots are hotter than cells of `rubber` that they only `cover` in part.

        The rim of a spot comes over the cell, and goes, within about dx/v (theory.md, eq. (7c)).
        """
        theta = 2.0 * np.sqrt(self.dx / max(speed, 1e-300) / np.pi) / rubber.effusivity
        late = self.dx / (2.0 * rubber.conductivity)
        resistance: np.ndarray = RIM_MEAN_RATIO * np.clip(1.0 - cover, 0.0, 1.0) * theta * late / (theta + late)
        return resistance

    def find_overlap(self, passed: float, own: np.ndarray, covered) -> RoadOverlap:
        """What touches on which road, for areas `covered` (2 columns per plane, ...) on the `strip_edges`."""
        mesh, before = self.mesh, self.line_offset(passed)[1] >= 0
        beside, all_ = covered[0 if before else 1 :: 2].ravel(), (covered[::2] + covered[1::2]).ravel()
        lines = np.arange(mesh.first, mesh.last) + (-1 if before else 1)
        other = mesh.everywhere(mesh.road[lines, -1]).ravel()
        share = beside / np.where(all_ > 0, all_, 1.0)
        return RoadOverlap(own, other, share, -mesh.n_across if before else mesh.n_across)

    # --- from memory to the block and back -----------------------------------------------------
    def to_block_frame(self, y: np.ndarray, k: int, fresh) -> np.ndarray:
        """A state or rate as it lies under the block, moved on by k lines behind `fresh` (n_road n_across,) road."""
        if k == 0:
            return y
        mesh, out = self.mesh, y.astype(np.result_type(y, fresh))
        old, new = (mesh.planes(a[: mesh.n_cells]) for a in (y, out))
        new[mesh.road[k:]] = old[mesh.road[: mesh.n_lines - k]]
        new[mesh.road[:k]] = np.reshape(fresh, (mesh.n_road, -1)) if np.ndim(fresh) else fresh
        return out

    def to_memory_frame(self, y: np.ndarray, k: int, out: np.ndarray, gone) -> np.ndarray:
        """`out` = y as it lies in memory, where road that has gone has `gone`; what y has in front is returned.

        That is (k, n_road, n_across).
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
        """Rises of cells (cells,) at the centres of the mesh, between columns of road that lie beside them."""
        mesh, s = self.mesh, self.line_offset(passed)[1]
        out = T.copy()
        road, cells = mesh.planes(T)[mesh.road], mesh.planes(out)
        here, beside = (slice(1, None), slice(None, -1)) if s >= 0 else (slice(None, -1), slice(1, None))
        cells[mesh.road[here]] += abs(s) * (road[beside] - road[here])
        return out
