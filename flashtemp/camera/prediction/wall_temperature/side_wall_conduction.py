"""A corner of the block in its section across: what films on the walls take from heat that came in through the face.

Up the block and across it heat spreads alike wherever it is, so that temperature is a sum of products of two slabs'
modes: one is held at its face by the contact, the other is cooled at its wall.  Both decay exactly; then heat spreads
along the block.  What flows in through the face is even within a step.  Beside it goes the same block without a side
wall, whose face is known: it tells what flowed in.
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

LATERAL_MODES, VERTICAL_MODES = 10, 14  # modes
FAR_DIFFUSION_LENGTHS = 6.0  # roots of diffusivity and time, beyond which no heat comes
MIN_RATE_PER_S = 1e-9  # 1/s, taken for the rate of what does not decay


@lru_cache
def _orthonormal_basis(count: int) -> tuple[Array, Array]:
    """Coefficients that make polynomials in the root of a depth from 0 to 1 orthonormal, and -d2/dz2 among them."""
    nodes, weights = legendre.leggauss(2 * count)
    weights, stretch = 0.5 * weights, nodes + 1.0
    values = legendre.legvander(nodes, count - 1)
    slopes = 2.0 * legendre.legval(nodes, legendre.legder(np.eye(count))).T
    make = np.linalg.inv(np.linalg.cholesky((values.T * (weights * stretch)) @ values))
    return make, make @ ((slopes.T * (weights / stretch)) @ slopes) @ make.T


@dataclass(frozen=True)
class SlabModes:
    """Heat conduction in a slab of some `depth` (m), insulated at its back: `count` functions, orthonormal over it.

    They are Legendre polynomials in the root of the depth, since what happens happens near the face.
    """

    depth: float
    count: int

    def evaluate_at(self, z: Array) -> Array:
        """The functions (z, count) at depths z (m)."""
        values = legendre.legvander(2.0 * np.sqrt(np.asarray(z) / self.depth) - 1.0, self.count - 1)
        functions: Array = values @ _orthonormal_basis(self.count)[0].T / np.sqrt(self.depth)
        return functions

    @cached_property
    def face_values(self) -> Array:
        """The functions (count,) at the face."""
        return self.evaluate_at(np.zeros(1))[0]

    @cached_property
    def depth_integrals(self) -> Array:
        """Their integrals (count,) over the depth, of which an even temperature is made: the first one is even."""
        return np.sqrt(self.depth) * np.eye(self.count)[0]

    def decay_modes(self, diffusivity: float, face_biot_per_m: Array) -> tuple[Array, Array]:
        """Rates (..., count) in 1/s and vectors (..., count, count) of a face `face_biot_per_m` (...) 1/m by what lies beyond."""
        at_face = np.outer(self.face_values, self.face_values)
        stiff = (
            _orthonormal_basis(self.count)[1] / self.depth**2 + np.asarray(face_biot_per_m)[..., None, None] * at_face
        )
        rates, vectors = np.linalg.eigh(diffusivity * stiff)
        return np.maximum(rates, MIN_RATE_PER_S), vectors


@dataclass(frozen=True)
class WallCornerModel:
    """A block of some `width` and `height` (m), and what acts on it in each of n - 1 steps between `times` (n,) in s.

    `edges` (x + 1,) in m of cells along the block, `rise` (n, x) in K of the face there, far from the side walls, above
    the air, which has warmed by `air` (n,) K: then all of the block is as much colder.  `contact_conductance` (n - 1, x) W/m2K by
    which the contact holds the face, `wall_film` (n - 1,) W/m2K of all walls, `section_film` (n - 1,) that part of the side walls'
    film which the section itself feels, as a whole.  Along the block conductivity is `axial` times that of the block.
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
        """By how much (moments, x, y, z) K the block is cooler `y` (m) off its wall and z (m) above its face than far
        from it; how warm (moments, x, z) K above the air it is there; what flux (moments, x) W/m2 comes in at its face.

        `moments` are numbers of `times`; `kept` are steps that corners like this one share.
        """
        kept = {} if kept is None else kept
        far = FAR_DIFFUSION_LENGTHS * np.sqrt(self.block.diffusivity * (self.times[-1] - self.times[0]))
        up, across = (
            SlabModes(min(self.height, far), VERTICAL_MODES),
            SlabModes(min(0.5 * self.width, far), LATERAL_MODES),
        )
        at, off = up.evaluate_at(np.minimum(z, up.depth)), across.evaluate_at(np.minimum(y, across.depth))
        walls = {film: self._wall_modes(across, film) for film in np.unique(self.wall_film)}
        places, wanted, turn = len(self.edges) - 1, set(np.asarray(moments).tolist()), np.eye(LATERAL_MODES)
        state = np.zeros(
            (places, LATERAL_MODES + 1, VERTICAL_MODES)
        )  # (x, modes across, up), last the block without side walls
        seen = {0: (np.zeros((places, len(y), len(z))), np.zeros((places, len(z))), np.zeros(places))}
        k, D = self.block.conductivity, self.block.diffusivity
        alike = np.array(
            [k, D, self.axial_conductivity_ratio, self.width, across.depth, up.depth, *self.edges]
        ).tobytes()
        faces: dict[bytes, tuple[Array, Array]] = {}
        for i, dt in enumerate(np.diff(self.times)):
            wall = walls[self.wall_film[i]]
            if wall.vectors is not turn:
                state[:, :-1] = wall.vectors.T @ turn @ state[:, :-1]
                turn = wall.vectors
            held = self.contact_conductance[i].tobytes()
            same = b"%.9f %r %r" % (dt, self.wall_film[i], self.section_film[i]) + held + alike
            if same not in kept:
                face = faces[held] = (
                    faces[held] if held in faces else up.decay_modes(D, self.contact_conductance[i] / k)
                )
                kept[same] = self._step_operators(dt, self.section_film[i], wall, face, up)
            move = kept[same]
            if warmer := self.air[i + 1] - self.air[i]:
                state -= warmer * wall.integrals[:, None] * up.depth_integrals
            state = move.lateral_decay * ((move.axial @ state.reshape(places, -1)).reshape(state.shape) @ move.vertical)
            flux = (self.rise[i + 1] - state[:, -1] @ up.face_values) / move.face_gain
            state += move.flux_gain * flux[:, None, None]
            if i + 1 in wanted:
                section, here = state[:, -1] @ at.T, off @ turn @ state[:, :-1] @ at.T
                seen[i + 1] = section[:, None] - here, section, flux - self.contact_conductance[i] * self.rise[i + 1]
        lack, section, came = (np.array(part) for part in zip(*(seen[int(m)] for m in moments), strict=True))
        return lack, section, came

    def _step_operators(
        self, dt: float, fin: float, wall: _WallModes, face: tuple[Array, Array], up: SlabModes
    ) -> _StepOperators:
        k, D, (rates, turn) = self.block.conductivity, self.block.diffusivity, face
        sinking = np.append(wall.rates, 2.0 * fin * D / (k * self.width))[:, None]
        sinks, left = np.exp(-sinking * dt), np.exp(-rates * dt)
        gain = (1.0 - sinks * left[:, None]) / np.maximum(sinking + rates[:, None], MIN_RATE_PER_S)
        gain = (wall.integrals[:, None] * (D / k * (up.face_values @ turn))[:, None] * gain) @ turn.swapaxes(1, 2)
        return _StepOperators(
            wall.axial_conduction(dt),
            sinks,
            (turn * left[:, None]) @ turn.swapaxes(1, 2),
            gain,
            gain[:, -1] @ up.face_values,
        )

    def _wall_modes(self, across: SlabModes, film: float) -> _WallModes:
        rates, turn = across.decay_modes(self.block.diffusivity, np.array(film / self.block.conductivity))
        return _WallModes(rates, turn, np.append(across.depth_integrals @ turn, 1.0), self._axial_conduction(film))

    def _axial_conduction(self, film: float) -> Callable[[float], Array]:
        """What a time (s) makes of temperatures (x,) in cells along the block, whose ends a film (W/m2K) cools."""
        k, size = self.axial_conductivity_ratio * self.block.conductivity, np.diff(self.edges)
        between = 2.0 * k / (size[1:] + size[:-1])
        end = 1.0 / (0.5 * size[[0, -1]] / k + 1.0 / max(film, MIN_RATE_PER_S))
        out = np.concatenate([end[:1], between]) + np.concatenate([between, end[1:]])
        root = np.sqrt(size)
        stiff = (np.diag(out) - np.diag(between, 1) - np.diag(between, -1)) / np.outer(root, root)
        rates, vectors = np.linalg.eigh(stiff / self.block.volumetric_capacity)
        return lambda dt: (vectors / root[:, None] * np.exp(-rates * dt)) @ (vectors.T * root)


class _WallModes(NamedTuple):
    """Modes across: rates (across,) 1/s, vectors, sizes of what is even and of the block without walls; along x."""

    rates: Array
    vectors: Array
    integrals: Array
    axial_conduction: Callable[[float], Array]


class _StepOperators(NamedTuple):
    """What a step makes of a state: along the block (x, x), across (modes, 1) and up (x, up, up), then by a flux of
    1 W/m2 (x, modes, up), and of the face's temperature by that, (x,) m2 K/W."""

    axial: Array
    lateral_decay: Array
    vertical: Array
    flux_gain: Array
    face_gain: Array
