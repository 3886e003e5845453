"""Mesh of a rectangular block on a road that moves past below it, in 2D (x, z) or in 3D with cells across."""

from __future__ import annotations

import numpy as np

from flashtemp.meshes.grading import geometric, layered, two_sided
from flashtemp.meshes.mesh import Mesh


def build(
    length: float,
    height: float,
    depth: float,
    cells: tuple[int, int, int] = (56, 34, 30),
    first_x: float = 2e-5,
    last_x: float = 1e-4,
    first_block: float = 4e-6,
    first_road: float = 3e-6,
    upstream: float = 0.0,
    downstream: float = 0.0,
    refine: float | tuple[float, float, float] = 1,
    behind: float = 1.35,
    above: float = 0.0,
    width: float = 0.05,
    across: int = 1,
    first_y: float | None = None,
    refine_y: float = 1,
    both: bool = False,
    even: bool = False,
    layers: tuple[tuple[float, int | None], ...] = (),
) -> Mesh:
    """Mesh of a block of `length` x `height` on a road of `depth`; all lengths in m.

    - `cells`: numbers of cells along the block, up the block and down the road.
    - `first_x`, `first_block`, `first_road`: cell sizes at the leading edge and on both sides of the interface;
      `last_x`: at the trailing edge.
    - `upstream`, `downstream`: length of the road before and behind the block; its cells grow by the factor `behind`.
    - `above`: additional cells, spread evenly up the block.
    - `refine`: factor on the numbers of cells, one for all directions or one each for along, up and down.
    - `across`: cells over the `width`, with the size `first_y` at both walls and refined by `refine_y` unless 1.
    - `both`: either edge may lead, so the mesh is its own mirror image.
    - `even`: lines of one length, at least half as many before the block as under it.
    - `layers`: (thickness, cells) of each layer from the face upwards, together `height`; cells may be None for as many
      as the grading of the block puts there.

    >>> print(build(0.025, 0.007, 0.01, cells=(10, 8, 6)))
    Mesh 140 cells in 10 depth lines
      block 10 x 8, first cell 4 um
      road  10 x 6, first cell 3 um
    """
    along, up, down = cells
    finer_x, finer_up, finer_down = np.broadcast_to(refine, 3).tolist()
    if even:
        x, first, last = _even(length, max(4, round(along * finer_x)), upstream, downstream)
    else:
        x, first, last = _graded(length, first_x, last_x, along, finer_x, upstream, downstream, behind, both)
    z, joints = geometric(height, first_block, up, finer_up, above), ()
    if layers:
        z, joints = layered(layers, first_block, up, finer_up, above)
    return Mesh(
        x=x,
        depth=geometric(depth, first_road, down, finer_down),
        height=z,
        first=first,
        last=last,
        y=_across(width, across, first_y, refine_y),
        joints=joints,
    )


def _across(width: float, cells: int, first: float | None, refine: float) -> np.ndarray:
    """Edges (m) across, from the centre line: even, or graded towards both side walls."""
    if cells == 1:
        return np.array([-0.5 * width, 0.5 * width])
    if first is None or cells < 4:
        first = width
    return two_sided(width, first, first, cells, refine) - 0.5 * width


def _graded(
    length: float,
    first_x: float,
    last_x: float,
    along: int,
    finer: float,
    upstream: float,
    downstream: float,
    behind: float,
    both: bool,
) -> tuple[np.ndarray, int, int]:
    """Edges (m) of lines that are graded towards both edges of the block, and the first and last line of the block."""
    if both:
        last_x = first_x = min(first_x, last_x)
        upstream = downstream = max(upstream, downstream)
    x = two_sided(length, first_x, last_x, along, finer)
    if both:
        x = 0.5 * (x + (length - x[::-1]))
    first = 0
    if upstream > 0:
        n = _cells_for(downstream, last_x, behind) if both else _cells_for(upstream, 4 * first_x, 1.9)
        before = -geometric(upstream, first_x, n, finer)[::-1]
        first = len(before) - 1
        x = np.concatenate([before[:-1], x])
    last = len(x) - 1
    if downstream > 0:
        n = _cells_for(downstream, last_x, behind)
        x = np.concatenate([x, length + geometric(downstream, last_x, n, finer)[1:]])
    return x, first, last


def _even(length: float, cells: int, upstream: float, downstream: float) -> tuple[np.ndarray, int, int]:
    """Edges (m) of lines of one length, and the first and last line of the block.

    Half the block's lines lie before it, so that road in its own frame can be shifted by that much at a time.
    """
    dx = length / cells
    first = max(cells // 2 + 1, round(upstream / dx))
    last = first + cells
    return dx * (np.arange(last + max(1, round(downstream / dx)) + 1) - first), first, last


def _cells_for(length: float, first: float, growth: float) -> int:
    """Number of cells of a geometric series with the given growth factor, at least two."""
    return max(2, round(np.log1p(length * (growth - 1) / first) / np.log(growth)))
