"""How firmly the contact holds the block's face: what flows out of it for every kelvin that it is warmer.

On the share phi of the face spots pass heat on through what lies in the contact and their flash resistance, R, to lanes
that were not warm when they came under the block.  A rise T(x) of the face loses phi J(x), where

    T(x) = R J(x) + int_0^x c((x - x')/v) / (e_S sqrt(pi v (x - x'))) J(x') dx',

c what a lane keeps of its heat as it widens (theory.md, eq. (15c)).  A lifted face is held by its film alone.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from flashtemp.model.effect_laws import EffectLaws
from flashtemp.model.scene import LawContext, Scene
from flashtemp.physics.arrays import Array

AGE_NODES, AGE_WEIGHTS = np.polynomial.legendre.leggauss(4)
SPREAD_NODES, SPREAD_WEIGHTS = np.polynomial.laguerre.laggauss(
    16
)  # of the squared way sideways, over that of heat of one age
AGE_INTERVALS = 40  # of the root of the age, in each of which what came lies along a line
WAIT_DOUBLINGS = 8  # of the time for which a block has waited in contact
MAX_CONDUCTANCE_W_M2K = 1e6  # W/m2K


def effective_contact_conductance(scene: Scene, times: Array, rise: Array, pressure: Array, worn: Array) -> Array:
    """H (n - 1, x) in W/m2K by which the face's `rise` (n, x) in K, kept at `times` (n,) in s, is held in between.

    It is that of a phase of the schedule, for the mean shapes that rise, local `pressure` (n, x) in Pa and worn depth
    (n, x) in m have in all that are like it.
    """
    laws, mid = EffectLaws(scene), 0.5 * (times[1:] + times[:-1])
    out = np.zeros((len(mid), rise.shape[1]))
    alike: dict[tuple, tuple[LawContext, list[np.ndarray]]] = {}  # phases in which the contact is the same
    for begin, end, phase in _iter_contact_intervals(scene):
        here, now = (mid > begin) & (mid <= end), scene.law_context(phase, 0.5 * (begin + end))
        if now.touching and here.any():
            alike.setdefault((now.speed, now.pressure, now.waited, now.direction), (now, []))[1].append(here)
        else:
            films = laws.films.get("block.face", [])
            out[here] = min(sum(part.law(now, p) for part, p, _ in films), MAX_CONDUCTANCE_W_M2K)
    for now, parts in alike.values():
        here = np.any(parts, axis=0)
        load, lost = (a[1:][here].mean(axis=0)[:: now.direction] for a in (pressure, worn))
        shape = np.maximum(rise[1:][here].mean(axis=0), 0.0)[:: now.direction]
        shape = shape + 0.01 * shape.max() if shape.any() else np.ones_like(shape)
        phi, resistance = _contact_transfer(scene, laws, now, load, lost)
        out[here] = (phi * np.linalg.solve(resistance, shape) / shape)[:: now.direction]
    return np.clip(out, 0.0, MAX_CONDUCTANCE_W_M2K)


def _iter_contact_intervals(scene: Scene):
    """Begin and end (s) of phases; of waits in contact, which holds ever less, of every doubling of their time."""
    for phase in scene.schedule.phases:
        if phase.sliding or scene.schedule.lifted or scene.schedule.alone:
            yield phase.begin, phase.end, phase
            continue
        ends = phase.begin + (phase.end - phase.begin) * np.append(0.0, 0.5 ** np.arange(WAIT_DOUBLINGS, -1.0, -1.0))
        for begin, end in pairwise(ends.tolist()):
            yield begin, end, phase


def _contact_transfer(scene: Scene, laws: EffectLaws, now: LawContext, load: Array, worn: Array) -> tuple[Array, Array]:
    """Contact fraction (x,), and what fluxes (x,) of the spots make of the face's rise there, (x, x) in m2 K/W."""
    mesh = scene.mesh
    edges = mesh.x[mesh.first : mesh.last + 1] - mesh.x[mesh.first]
    one = np.ones(len(edges) - 1)
    at = now.under_block(mesh, local_pressure=load, worn=worn, face=scene.ambient * one)
    phi = np.clip(laws("contact.spot_fraction", 0.0, None, at) * one, 1e-6, 1.0)
    seen = at.with_fields(spot_fraction=phi, covered=float(phi @ np.diff(edges) / scene.length))
    beside = sum(laws(f"contact.{name}", 0.0, None, seen) for name in ("resistance", "micro_resistance"))
    beside = np.maximum(beside + laws("contact.flash_resistance", 0.0, None, seen), 0.0) * one
    last = now.last_speed if now.last_speed > 0.0 else scene.length
    pace = 1.0 / (1.0 / last + now.waited / scene.length)  # a block at rest is one that passes slowly
    came = _lane_response(scene, laws, seen, scene.length / pace)
    centres = 0.5 * (edges[1:] + edges[:-1])
    reached = came(np.maximum(centres[:, None] - edges, 0.0) / pace)
    common = np.minimum(phi[:, None], phi) / phi[:, None]  # lanes that were in contact there, of those that are here
    return phi, np.diag(beside) + common * (reached[:, :-1] - reached[:, 1:])


def _lane_response(scene: Scene, laws: EffectLaws, seen: LawContext, oldest: float):
    """The rise in K of a lane per W/m2 as a function of how long it has taken that, s, up to the `oldest`."""
    ends = np.linspace(0.0, np.sqrt(oldest), AGE_INTERVALS + 1)
    half = 0.5 * ends[1]
    roots = (ends[1:, None] - half + half * AGE_NODES)[..., None]
    apart = 2.0 * roots * np.sqrt(scene.road.diffusivity * SPREAD_NODES)
    kept = laws("road.lane_overlap", 1.0, None, seen, apart) * np.ones_like(apart) @ SPREAD_WEIGHTS
    steps = 2.0 * half / (scene.road.effusivity * np.sqrt(np.pi)) * (kept @ AGE_WEIGHTS)
    rise = np.append(0.0, np.cumsum(steps))
    return lambda age: np.interp(np.sqrt(age), ends, rise)
