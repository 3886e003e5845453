"""How friction shears a block held by its top, and where it presses then: plane strain by finite elements."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
ALONG, UP, TALL = 40, 12, 60  # elements along, least and most up the block: the edge value stays within 2 %
GAUSS = (-1 / np.sqrt(3.0), 1 / np.sqrt(3.0))


@lru_cache(maxsize=64)
def pressure_by_friction(slenderness: float, poisson: float) -> tuple[Array, Array]:
    """Places x/L from the leading edge and d(p/p_mean)/dmu there, for a block of height over length `slenderness`.

    The road pushes the face back with mu p and keeps it flat; the top is held.  The change is odd about the middle
    and carries no load; tall blocks give 3 H/L (1 - 2x/L) by beam theory.

    >>> x, change = pressure_by_friction(3.0, 0.49)
    >>> round(float(np.trapezoid(change * (0.5 - x), x)) / (3.0 / 2), 2)  # its moment over that of a beam, V H/2
    0.99
    """
    from scipy.sparse.linalg import splu

    up = min(max(UP, round(ALONG * slenderness)), TALL)
    K = _stiffness(ALONG, up, 1.0 / ALONG, slenderness / up, poisson)
    free = 2 * (ALONG + 1) * up  # rows of nodes from the face up; the top row is held
    face = 2 * np.arange(ALONG + 1)
    loads = np.zeros((free, 2 * (ALONG + 1)))
    loads[np.arange(2 * (ALONG + 1)), np.arange(2 * (ALONG + 1))] = 1.0
    moved = splu(K[:free, :free].tocsc()).solve(loads)[: 2 * (ALONG + 1)]
    lift, turn = moved[face + 1][:, face + 1], moved[face + 1][:, face]  # up: by forces up, by forces along
    share = np.full(ALONG + 1, 1.0 / ALONG)
    share[[0, -1]] *= 0.5
    flat = np.linalg.solve(lift, np.ones(ALONG + 1))
    force = -np.linalg.solve(lift, turn @ share)
    force -= force.sum() / flat.sum() * flat
    change = force / share
    return np.linspace(0.0, 1.0, ALONG + 1), 0.5 * (change - change[::-1])


def _stiffness(nx: int, nz: int, dx: float, dz: float, poisson: float) -> Any:
    """Stiffness of even bilinear elements over shear modulus, their volume change taken in the middle (no locking)."""
    from scipy.sparse import coo_array

    shear = np.diag([2.0, 2.0, 1.0]) - np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0])  # without change of area
    bulk = np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0]) * (1.0 + 2.0 * poisson / (1.0 - 2.0 * poisson))
    own = 4.0 * _part(_strain(0.0, 0.0, dx, dz), bulk)
    own = own + sum(_part(_strain(a, b, dx, dz), shear) for a in GAUSS for b in GAUSS)
    own *= 0.25 * dx * dz
    i, j = np.meshgrid(np.arange(nx), np.arange(nz), indexing="ij")
    corner = (j * (nx + 1) + i).ravel()
    nodes = np.stack([corner, corner + 1, corner + nx + 2, corner + nx + 1], axis=1)
    dofs = (2 * nodes[:, :, None] + np.arange(2)).reshape(len(nodes), 8)
    rows, columns = np.repeat(dofs, 8, axis=1).ravel(), np.tile(dofs, (1, 8)).ravel()
    size = 2 * (nx + 1) * (nz + 1)
    return coo_array((np.tile(own.ravel(), len(nodes)), (rows, columns)), shape=(size, size)).tocsr()


def _part(B: Array, D: Array) -> Array:
    product: Array = B.T @ D @ B
    return product


def _strain(a: float, b: float, dx: float, dz: float) -> Array:
    """Strains (3, 8) xx, zz, xz by moves of the corners at (a, b) in -1..1."""
    along = np.array([-(1 - b), 1 - b, 1 + b, -(1 + b)]) / (2 * dx)
    up = np.array([-(1 - a), -(1 + a), 1 + a, 1 - a]) / (2 * dz)
    B = np.zeros((3, 8))
    B[0, ::2], B[1, 1::2] = along, up
    B[2, ::2], B[2, 1::2] = up, along
    return B
