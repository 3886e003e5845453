"""Arguments of the compiled loops, grouped in named tuples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class DepthLines(NamedTuple):
    """The depth lines of one plane (`mesh.Mesh`) and their constant coefficients.

    The block covers lines from `first` on.  `capacity` rho c V (n_plane,) J/(m K) per metre across; `upwind_weight`
    (lines,) of the second-order upwind scheme; `g_in` (m,) conductance W/(m K) from the entering road to the first
    line; `weight` (n_plane,) of a cell in the heat balance: 1 in the block, the lanes' fraction of the width in the
    road; `share` (planes,) fraction of the width that each plane stands for.
    """

    start: np.ndarray
    m: int  # road cells of every line
    first: int
    capacity: np.ndarray
    upwind_weight: np.ndarray
    g_in: np.ndarray
    weight: np.ndarray
    share: np.ndarray


class TransportCoefficients(NamedTuple):
    """Conductances `gx`, `gz` W/(m K) of `kernels_2d.face_conductances`, and coefficients of the moving road.

    `advection` rho c v dz (m,) W/(m K); `capacity_ratio` dh/dT (n_plane,).
    """

    gx: np.ndarray
    gz: np.ndarray
    advection: np.ndarray
    capacity_ratio: np.ndarray


class LineFactors(NamedTuple):
    """Factors of the preconditioner P, each (n_plane,).

    `inv` 1/pivot and `mul` elimination factors along a line; `low`, `low2` couplings to the first and second line
    upstream, `high` to the line downstream.
    """

    inv: np.ndarray
    mul: np.ndarray
    low: np.ndarray
    low2: np.ndarray
    high: np.ndarray


class InterfaceCoupling(NamedTuple):
    """The interface in P; arrays are (lines under the block,) in 2D and (lines under the block, planes) in 3D.

    `up` d(road heat)/d(block T), `down` d(block heat)/d(road T) in W/(m K), `under`, `over` 1/pivot of road and block.
    """

    up: np.ndarray
    down: np.ndarray
    under: np.ndarray
    over: np.ndarray


class LateralConductances(NamedTuple):
    """Conductances between the cells of many planes.

    While conductivity is constant, all planes have the conductances `gx`, `gz` (as in `TransportCoefficients`) and `gy`
    = k dx dz (n_plane,), and `factor` has one dimension.  Otherwise `factor` k/k_reference is (n_plane, planes), and
    conductances follow from the half-cell resistances `half_x`, `half_z` and the resistance `gap` of a joint with the
    cell above.  `before`, `after` (planes,) are 1/(distance dy) to the neighbours in y, 0 at the side walls; `dy`
    (planes,) m.
    """

    gx: np.ndarray
    gz: np.ndarray
    gy: np.ndarray
    half_x: np.ndarray
    half_z: np.ndarray
    gap: np.ndarray
    factor: np.ndarray
    dy: np.ndarray
    before: np.ndarray
    after: np.ndarray
