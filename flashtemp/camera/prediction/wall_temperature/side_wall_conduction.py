"""Heat conduction in the corner between the block's face and its side wall, which a 2D run does not resolve.

T is the rise above the air, y the depth behind the wall, z the height above the face, and x runs along the block.
Equations have their numbers in docs/explanation/theory.md.  Far from the wall, eqs. (8) and (9) hold for the section,
the plane (x, z) of the 2D run; near it, air cools the wall:

    rho c dT/dt = k (d2T/dy2 + d2T/dz2) + k_x d2T/dx2                                          (27)
    k dT/dy = h T at y = 0        (h heat-transfer coefficient of the wall)                    (28)
    -k dT/dz = q(x, t) - H T at z = 0        (H conductance of the contact, q even across y)   (29)

T is a sum of products of slab modes: mode i across the width satisfies (28), mode j over the height satisfies (29).
Their product decays as exp(-(lambda_i + mu_j) dt), without error in time.  Conduction along x follows as a separate
step (operator splitting), because H varies along x.

The flux q is constant in a step.  It is chosen so that a block without cooled side wall reaches the face temperature of
the 2D run.  The corner then uses the same q, so it differs from the 2D run only by the cooling of the wall.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from flashtemp.camera.prediction.pixel_sampling import MatrixCache
from flashtemp.physics.arrays import Array
from flashtemp.physics.material import Material

LATERAL_MODES, VERTICAL_MODES = 10, 14  # across the block and up the block
FAR_DIFFUSION_LENGTHS = 6.0  # multiples of sqrt(D t), beyond which heat does not penetrate
MIN_RATE_PER_S = 1e-9  # 1/s, for modes that do not decay: keeps quotients by the rate finite


@lru_cache
def _orthonormal_basis(count: int) -> tuple[Array, Array]:
    """Coefficients of orthonormal polynomials in sqrt(z), 0 <= z <= 1, and the matrix of -d2/dz2 between them."""
    nodes, weights = legendre.leggauss(2 * count)
    weights, stretch = 0.5 * weights, nodes + 1.0  # z = u^2 with u = (node + 1)/2, so that dz = stretch du
    values = legendre.legvander(nodes, count - 1)
    slopes = 2.0 * legendre.legval(nodes, legendre.legder(np.eye(count))).T
    to_orthonormal = np.linalg.inv(np.linalg.cholesky((values.T * (weights * stretch)) @ values))
    return to_orthonormal, to_orthonormal @ ((slopes.T * (weights / stretch)) @ slopes) @ to_orthonormal.T


@dataclass(frozen=True)
class SlabModes:
    """Heat conduction in a slab of `depth` (m), insulated at its back, in `count` functions orthonormal over the depth.

    They are Legendre polynomials in the root of the depth: temperature varies most near the face.
    """

    depth: float
    count: int

    def evaluate_at(self, z: Array) -> Array:
        """Values (z, count) of the functions at depths z (m)."""
        values = legendre.legvander(2.0 * np.sqrt(np.asarray(z) / self.depth) - 1.0, self.count - 1)
        functions: Array = values @ _orthonormal_basis(self.count)[0].T / np.sqrt(self.depth)
        return functions

    @cached_property
    def face_values(self) -> Array:
        """Values (count,) of the functions at the face."""
        return self.evaluate_at(np.zeros(1))[0]

    @cached_property
    def depth_integrals(self) -> Array:
        """Integrals (count,) over the depth: the components of a uniform temperature, which is the first function."""
        return np.sqrt(self.depth) * np.eye(self.count)[0]

    def decay_modes(self, diffusivity: float, face_biot_per_m: Array) -> tuple[Array, Array]:
        """Decay rates (..., count) in 1/s and modes (..., count, count) of a slab whose face loses heat.

        `face_biot_per_m` (...) 1/m is h/k in eq. (28) or H/k in eq. (29).  In weak form the loss adds h/k f_i(0) f_j(0)
        to the matrix of -d2/dz2, so that one basis serves every coefficient.
        """
        at_face = np.outer(self.face_values, self.face_values)
        stiff = (
            _orthonormal_basis(self.count)[1] / self.depth**2 + np.asarray(face_biot_per_m)[..., None, None] * at_face
        )
        rates, vectors = np.linalg.eigh(diffusivity * stiff)
        return np.maximum(rates, MIN_RATE_PER_S), vectors


@dataclass(frozen=True)
class WallCornerModel:
    """A block of `width` and `height` (m) and its boundary conditions in n - 1 steps between `times` (n,) in s.

    `edges` (x + 1,) in m of cells along the block; `rise` (n, x) in K of the face far from the side walls, above the
    air; `air` (n,) in K, by which the air has warmed.  `contact_conductance` (n - 1, x) is H of eq. (29), `wall_film`
    (n - 1,) h of eq. (28) for all walls, `section_film` (n - 1,) the part of the side walls' h that the 2D section
    already loses as a fin, all W/m2K.  `axial_conductivity_ratio` is k_x/k.
    """

    block: Material
    width: float
    height: float
    edges: Array
    times: Array
    rise: Array
    air: Array
    contact_conductance: Array
    wall_film: Array
    section_film: Array
    axial_conductivity_ratio: float = 1.0

    def temperature_deficit(
        self, z: Array, y: Array, moments: Array, kept: MatrixCache | None = None
    ) -> tuple[Array, Array, Array]:
        """How much cooler the block is near its side wall than in the section far from it, and what goes with that.

        `y` (m) is the depth behind the wall, `z` (m) the height above the face, `moments` are indices of `times`.
        Returns the deficit (moments, x, y, z) in K, the section's rise above the air (moments, x, z) in K, and the
        flux into the face (moments, x) in W/m2.  `kept` caches the operators of steps for blocks of equal properties.
        """
        kept = {} if kept is None else kept
        # a block thicker than heat can penetrate is cut off there: the same number of modes resolves the rest finer
        far = FAR_DIFFUSION_LENGTHS * np.sqrt(self.block.diffusivity * (self.times[-1] - self.times[0]))
        up, across = (
            SlabModes(min(self.height, far), VERTICAL_MODES),
            SlabModes(min(0.5 * self.width, far), LATERAL_MODES),
        )
        at, off = up.evaluate_at(np.minimum(z, up.depth)), across.evaluate_at(np.minimum(y, across.depth))
        walls = {film: self._wall_modes(across, film) for film in np.unique(self.wall_film)}
        places, wanted, basis = len(self.edges) - 1, set(np.asarray(moments).tolist()), np.eye(LATERAL_MODES)
        # (x, modes across, modes up); the last row across is the section, a block without side walls
        state = np.zeros((places, LATERAL_MODES + 1, VERTICAL_MODES))
        results = {0: (np.zeros((places, len(y), len(z))), np.zeros((places, len(z))), np.zeros(places))}
        k, D = self.block.conductivity, self.block.diffusivity
        properties = np.array(
            [k, D, self.axial_conductivity_ratio, self.width, across.depth, up.depth, *self.edges]
        ).tobytes()
        faces: dict[bytes, tuple[Array, Array]] = {}
        for i, dt in enumerate(np.diff(self.times)):
            wall = walls[self.wall_film[i]]
            if wall.vectors is not basis:  # h has changed: the state goes over to the new modes across
                state[:, :-1] = wall.vectors.T @ basis @ state[:, :-1]
                basis = wall.vectors
            conductance = self.contact_conductance[i].tobytes()
            key = b"%.9f %r %r" % (dt, self.wall_film[i], self.section_film[i]) + conductance + properties
            if key not in kept:  # few steps differ: schedules repeat
                if conductance not in faces:
                    faces[conductance] = up.decay_modes(D, self.contact_conductance[i] / k)
                kept[key] = self._step_operators(dt, self.section_film[i], wall, faces[conductance], up)
            step = kept[key]
            if air_step := self.air[i + 1] - self.air[i]:  # T is counted from the air, so warmer air lowers all of it
                state -= air_step * wall.integrals[:, None] * up.depth_integrals
            # rates across and up add, so their decays multiply (eq. (30)); conduction along x is split off
            state = step.lateral_decay * ((step.axial @ state.reshape(places, -1)).reshape(state.shape) @ step.vertical)
            # q of eq. (29): the flux that brings the section's face to the rise of the 2D run
            flux = (self.rise[i + 1] - state[:, -1] @ up.face_values) / step.face_gain
            state += step.flux_gain * flux[:, None, None]
            if i + 1 in wanted:
                section, here = state[:, -1] @ at.T, off @ basis @ state[:, :-1] @ at.T
                results[i + 1] = section[:, None] - here, section, flux - self.contact_conductance[i] * self.rise[i + 1]
        deficit, section, inflow = (np.array(part) for part in zip(*(results[int(m)] for m in moments), strict=True))
        return deficit, section, inflow

    def _step_operators(
        self, dt: float, section_film: float, wall: _WallModes, face: tuple[Array, Array], up: SlabModes
    ) -> _StepOperators:
        """What a step of `dt` (s) does to the modes, eq. (30)."""
        k, D, (rates, modes) = self.block.conductivity, self.block.diffusivity, face
        # both side walls cool the section, whose capacity per face area is rho c W: rate 2 h/(rho c W)
        lateral_rates = np.append(wall.rates, 2.0 * section_film * D / (k * self.width))[:, None]
        lateral_decay, vertical_decay = np.exp(-lateral_rates * dt), np.exp(-rates * dt)
        # a constant flux feeds a mode by (1 - exp(-(lambda + mu) dt))/(lambda + mu) (eq. (30))
        gain = (1.0 - lateral_decay * vertical_decay[:, None]) / np.maximum(
            lateral_rates + rates[:, None], MIN_RATE_PER_S
        )
        gain = (wall.integrals[:, None] * (D / k * (up.face_values @ modes))[:, None] * gain) @ modes.swapaxes(1, 2)
        return _StepOperators(
            wall.axial_conduction(dt),
            lateral_decay,
            (modes * vertical_decay[:, None]) @ modes.swapaxes(1, 2),
            gain,
            gain[:, -1] @ up.face_values,
        )

    def _wall_modes(self, across: SlabModes, film: float) -> _WallModes:
        """Modes across the block for a wall of heat-transfer coefficient `film` (W/m2K), eq. (28)."""
        rates, modes = across.decay_modes(self.block.diffusivity, np.array(film / self.block.conductivity))
        return _WallModes(rates, modes, np.append(across.depth_integrals @ modes, 1.0), self._axial_conduction(film))

    def _axial_conduction(self, film: float) -> Callable[[float], Array]:
        """Exponential of conduction along x: time (s) -> matrix (x, x) for the temperatures of cells.

        Leading and trailing wall lose heat with the coefficient `film` (W/m2K), in series with half a cell.
        """
        k, size = self.axial_conductivity_ratio * self.block.conductivity, np.diff(self.edges)
        between = 2.0 * k / (size[1:] + size[:-1])
        end = 1.0 / (0.5 * size[[0, -1]] / k + 1.0 / max(film, MIN_RATE_PER_S))
        out = np.concatenate([end[:1], between]) + np.concatenate([between, end[1:]])
        root = np.sqrt(size)  # scaling by it makes the matrix of uneven cells symmetric
        stiff = (np.diag(out) - np.diag(between, 1) - np.diag(between, -1)) / np.outer(root, root)
        rates, vectors = np.linalg.eigh(stiff / self.block.volumetric_capacity)
        return lambda dt: (vectors / root[:, None] * np.exp(-rates * dt)) @ (vectors.T * root)


class _WallModes(NamedTuple):
    """Modes across the block: `rates` (across,) 1/s, `vectors` (across, across), and conduction along x.

    `integrals` (across + 1,) are the components of a flux that is even across y; the last is that of the section.
    """

    rates: Array
    vectors: Array
    integrals: Array
    axial_conduction: Callable[[float], Array]


class _StepOperators(NamedTuple):
    """What a step does to a state: `axial` (x, x), `lateral_decay` (modes, 1) and `vertical` (x, up, up).

    A flux of 1 W/m2 adds `flux_gain` (x, modes, up) to the state and `face_gain` (x,) m2 K/W to the section's face.
    """

    axial: Array
    lateral_decay: Array
    vertical: Array
    flux_gain: Array
    face_gain: Array
