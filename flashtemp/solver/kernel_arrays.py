"""What the compiled loops are given: arrays bundled by what they belong to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class DepthLines(NamedTuple):
    """The depth lines of one plane (`mesh.Mesh`) and what never changes on them.

    The block stands on lines from `first` on.  `capacity` rho c V (n_plane,) J/(m K) per metre across, `upwind_weight`
    second-order upwind weights (lines,), `g_in` (m,) conductance of the entering road to the first line, `weight`
    (n_plane,) with which a cell's heat counts: the lanes' share of the width in the road; `share` (planes,) of it.
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
    """Conductances `gx`, `gz` W/(m K) (`kernels_2d.face_conductances`), `advection` rho c v dz (m,), `capacity_ratio` dh/dT."""

    gx: np.ndarray
    gz: np.ndarray
    advection: np.ndarray
    capacity_ratio: np.ndarray


class LineFactors(NamedTuple):
    """Of P, each (n_plane,): 1/pivot, elimination factors, couplings one and two lines upstream and one downstream."""

    inv: np.ndarray
    mul: np.ndarray
    low: np.ndarray
    low2: np.ndarray
    high: np.ndarray


class InterfaceCoupling(NamedTuple):
    """The interface in P, each (lines under the block,) or (lines under the block, planes).

    `up` d(road heat)/d(block T), `down` d(block heat)/d(road T) in W/(m K), `under`, `over` 1/pivot of road and block.
    """

    up: np.ndarray
    down: np.ndarray
    under: np.ndarray
    over: np.ndarray


class LateralConductances(NamedTuple):
    """What conducts between the cells of many planes.

    While conductivity is constant all planes share the conductances `gx`, `gz` (as in `TransportCoefficients`) and `gy` = k dx dz
    (n_plane,), and `factor` has one dimension; else `factor` k/k_reference is (n_plane, planes), and the half-cell
    resistances `half_x`, `half_z` count, and `gap` of contacts with the cell above.
    `before`, `after` (planes,) 1/(distance dy) to the neighbours in y, 0 at the side walls; `dy` (planes,) m.
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
