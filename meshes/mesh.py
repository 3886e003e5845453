"""The mesh: finite volumes of road and block, ordered by depth lines (theory.md, section 8).

A depth line runs from deep in the road up to its surface and, under the block, on through the interface to the holder.
Cells of a line are contiguous in memory, so a line solve is one pass; lines are ordered in the direction in which the
road moves, so a sweep follows the road.  All planes (x, z) across y have the same cells: cell c of plane j has the
number c n_across + j.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np


def centres(edges: np.ndarray) -> np.ndarray:
    """Cell centres (n,) of cell edges (n+1,), m.

    >>> centres(np.array([0.0, 1.0, 3.0])).tolist()
    [0.5, 2.0]
    """
    return 0.5 * (edges[1:] + edges[:-1])


@dataclass(frozen=True)
class Mesh:
    """Cells of road and block on a tensor grid, packed line by line.

    `x` (n_lines+1,) are the edges of the lines in m, increasing downstream, with the leading edge at 0; `depth`
    (n_road+1,) the edges of road cells in m below the surface; `height` (n_block+1,) those of block cells above it.
    The block covers lines `first` to `last` - 1.  `y` (n_across+1,) are edges in m across from the centre line, two in
    2D.  `joints` are the block cells of a line, counted from the face, with which another layer begins.  Arrays of one
    plane (`line`, `level`, `block`, `road`, ...) have n_plane cells.  Areas and volumes are per metre of the block's
    width: summed across y they are those of a 2D mesh.

    >>> from flashtemp.meshes import block_on_road
    >>> m = block_on_road.build(length=0.025, height=0.007, depth=0.01, cells=(8, 6, 5))
    >>> round(float(m.volume[m.block].sum()), 9) == round(0.025 * 0.007, 9)
    True
    """

    x: np.ndarray
    depth: np.ndarray
    height: np.ndarray
    first: int
    last: int
    y: np.ndarray = field(default_factory=lambda: np.array([-0.025, 0.025]))
    joints: tuple[int, ...] = ()

    @property
    def n_lines(self) -> int:
        return len(self.x) - 1

    @property
    def n_road(self) -> int:
        """Road cells of every line."""
        return len(self.depth) - 1

    @property
    def n_block(self) -> int:
        """Block cells of a line under the block."""
        return len(self.height) - 1

    @property
    def layers(self) -> list[slice]:
        """Block cells of a line by layer, from the face upwards; one slice for a block of one material."""
        ends = (0, *self.joints, self.n_block)
        return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]

    @cached_property
    def start(self) -> np.ndarray:
        """Index (n_lines+1,) of the first, deepest cell of every line."""
        sizes = np.full(self.n_lines, self.n_road)
        sizes[self.first : self.last] += self.n_block
        return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)

    @property
    def n_across(self) -> int:
        """Planes across the direction of sliding, 1 in 2D."""
        return len(self.y) - 1

    @property
    def n_plane(self) -> int:
        """Cells of one plane."""
        return int(self.start[-1])

    @property
    def n_cells(self) -> int:
        return self.n_plane * self.n_across

    @cached_property
    def share(self) -> np.ndarray:
        """Fraction (n_across,) of the block's width that each plane stands for."""
        return np.diff(self.y) / (self.y[-1] - self.y[0])

    @cached_property
    def line(self) -> np.ndarray:
        """Line number (n_plane,) of every cell of a plane."""
        return np.repeat(np.arange(self.n_lines), np.diff(self.start))

    @cached_property
    def level(self) -> np.ndarray:
        """Level (n_plane,) in the line: 0 for the deepest road cell, n_road for the cell at the block's face."""
        return np.arange(self.n_plane) - self.start[self.line]

    @cached_property
    def block(self) -> np.ndarray:
        """Cell indices of the block, shape (block lines, n_block), from the face upwards."""
        return self.start[self.first : self.last, None] + self.n_road + np.arange(self.n_block)

    @cached_property
    def road(self) -> np.ndarray:
        """Cell indices of the road, shape (n_lines, n_road), from the deepest upwards."""
        return self.start[:-1, None] + np.arange(self.n_road)

    @cached_property
    def thickness(self) -> np.ndarray:
        """Cell height dz (n_plane,) in m."""
        line = np.concatenate([np.diff(self.depth)[::-1], np.diff(self.height)])
        return line[self.level]

    @cached_property
    def width(self) -> np.ndarray:
        """Cell length dx (n_plane,) along the direction of sliding in m."""
        return np.diff(self.x)[self.line]

    @cached_property
    def volume(self) -> np.ndarray:
        """Cell volume per metre across the block (n_plane,) in m2."""
        return self.width * self.thickness

    @cached_property
    def x_centre(self) -> np.ndarray:
        """Line centres (n_lines,) in m."""
        return centres(self.x)

    @cached_property
    def z_centre(self) -> np.ndarray:
        """Cell centre (n_plane,) in m above the interface, negative in the road."""
        return np.concatenate([-centres(self.depth)[::-1], centres(self.height)])[self.level]

    @cached_property
    def x_block(self) -> np.ndarray:
        """Centres of the lines under the block, m from the leading edge."""
        return self.x_centre[self.first : self.last]

    @cached_property
    def dx_block(self) -> np.ndarray:
        """Lengths of the lines under the block, m."""
        return np.diff(self.x)[self.first : self.last]

    # --- mirror image, for the other direction of sliding ------------------------------------------
    def mirrored(self) -> Mesh:
        """The same cells with x counted from the block's other edge; `mirror` maps the cells."""
        n, ends = self.n_lines, self.x[self.first] + self.x[self.last]
        return replace(self, x=ends - self.x[::-1], first=n - self.last, last=n - self.first)

    @cached_property
    def mirror(self) -> np.ndarray:
        """Numbers (n_plane,) in this mesh of the cells of the mirrored mesh, in the order of the latter."""
        sizes = np.diff(self.start)[::-1]
        return (
            np.repeat(self.start[:-1][::-1], sizes)
            + np.arange(self.n_plane)
            - np.repeat(np.concatenate([[0], np.cumsum(sizes)[:-1]]), sizes)
        )

    # --- all planes ---------------------------------------------------------------------------
    def everywhere(self, cells: np.ndarray) -> np.ndarray:
        """Numbers (..., n_across) in all planes of the cells (...,) of one plane."""
        return np.asarray(cells)[..., None] * self.n_across + np.arange(self.n_across)

    def planes(self, values: np.ndarray) -> np.ndarray:
        """View (n_plane, n_across) of values (n_cells,)."""
        return values.reshape(self.n_plane, self.n_across)

    def across(self, columns: np.ndarray) -> np.ndarray:
        """Mean across y (..., lines) of values (..., columns) under the block, or on all lines."""
        return columns.reshape(*columns.shape[:-1], -1, self.n_across) @ self.share

    @cached_property
    def y_centre(self) -> np.ndarray:
        """Centres of the planes (n_across,) in m from the centre line."""
        return centres(self.y)

    @cached_property
    def column_x(self) -> np.ndarray:
        """x (columns,) in m from the leading edge of the columns under the block: line by line, then across."""
        return np.repeat(self.x_block, self.n_across)

    @cached_property
    def column_y(self) -> np.ndarray:
        """y (columns,) in m from the centre line of the columns under the block."""
        return np.tile(self.y_centre, self.last - self.first)

    @cached_property
    def column_area(self) -> np.ndarray:
        """Area (columns,) in m of the columns under the block, per metre of its width."""
        return np.outer(self.dx_block, self.share).ravel()

    @cached_property
    def patches(self) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Named boundary patches: cells, face areas per metre across (m), half cell widths (m).

        In 2D "block.sides" are both side walls, and every cell of the section has a part of them: a fin.
        """
        top, under = self.block[:, -1], self.block[:, 0]
        free = np.r_[0 : self.first, self.last : self.n_lines]
        surface = self.road[:, -1]
        walls = {"block.leading": self.block[0], "block.trailing": self.block[-1]}
        out = {k: (c, self.thickness[c], 0.5 * self.width[c]) for k, c in walls.items()}
        flats = {
            "block.holder": top,
            "block.face": under,
            "road.free": surface[free],
            "road.under": surface[self.first : self.last],
        }
        out |= {k: (c, self.width[c], 0.5 * self.thickness[c]) for k, c in flats.items()}
        n = self.n_across
        out = {
            k: (self.everywhere(c).ravel(), np.outer(area, self.share).ravel(), np.repeat(half, n))
            for k, (c, area, half) in out.items()
        }
        return out | {"block.sides": self._sides(self.block), "road.sides": self._sides(self.road)}

    def _sides(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The two side walls, as a patch, of `cells` of one plane."""
        cells, n = cells.ravel(), self.n_across
        area = self.volume[cells] / (self.y[-1] - self.y[0])
        if n == 1:
            return cells, 2.0 * area, 0.0 * area
        half = 0.5 * np.diff(self.y)[[0, -1]]
        return (
            np.concatenate([cells * n, cells * n + n - 1]),
            np.concatenate([area, area]),
            np.repeat(half, len(cells)),
        )

    def place(self, cell) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, y, z in m of the centres of cells by their number."""
        plane, j = np.divmod(cell, self.n_across)
        return self.x_centre[self.line[plane]], self.y_centre[j], self.z_centre[plane]

    def __str__(self) -> str:
        planes = f" x {self.n_across} planes" if self.n_across > 1 else ""
        return (
            f"Mesh {self.n_cells} cells in {self.n_lines} depth lines{planes}\n"
            f"  block {self.last - self.first} x {self.n_block}, first cell {self.height[1] * 1e6:.3g} um\n"
            f"  road  {self.n_lines} x {self.n_road}, first cell {self.depth[1] * 1e6:.3g} um"
        )
