"""Conductance of the contact: heat flux out of the block's face per kelvin of its temperature rise, W/m2K.

Spots cover the fraction phi of the face.  They pass heat through the resistance R, of the contact and of flash
temperature, into heated tracks (lanes) that were cold when they came under the block.  A rise T(x) loses phi J(x):

    T(x) = R J(x) + int_0^x c((x - x')/v) / (e_S sqrt(pi v (x - x'))) min(phi, phi')/phi J(x') dx'

This is theory.md, eq. (31); c is the fraction of its heat that a lane keeps as it widens, eqs. (15b) and (15c).
The conductance is H = phi J/T for the mean profile T(x) of a phase.  A lifted face has the heat-transfer coefficient
of `block.face` alone.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from flashtemp.model.effect_laws import EffectLaws
from flashtemp.model.scene import LawContext, Scene
from flashtemp.physics.arrays import Array

AGE_NODES, AGE_WEIGHTS = np.polynomial.legendre.leggauss(4)
# Laguerre nodes: squares of the sideways distance that heat has spread, over 4 a_S tau of its age tau, as in eq. (15b)
SPREAD_NODES, SPREAD_WEIGHTS = np.polynomial.laguerre.laggauss(16)
AGE_INTERVALS = 40  # of the root of the age, in each of which the response is linear
WAIT_DOUBLINGS = 8  # intervals of a wait in contact, each twice as long as the one before
MAX_CONDUCTANCE_W_M2K = 1e6  # W/m2K


def effective_contact_conductance(scene: Scene, times: Array, rise: Array, pressure: Array, worn: Array) -> Array:
    """H (n - 1, x) in W/m2K between `times` (n,) in s, from the face's `rise` (n, x) in K.

    Phases of equal speed, pressure, waiting time and direction share one H.  It follows from the mean profiles of rise,
    local `pressure` (n, x) in Pa and worn depth (n, x) in m over all of them.
    """
    laws, mid = EffectLaws(scene), 0.5 * (times[1:] + times[:-1])
    out = np.zeros((len(mid), rise.shape[1]))
    same_contact: dict[tuple, tuple[LawContext, list[np.ndarray]]] = {}
    for begin, end, phase in _iter_contact_intervals(scene):
        here, now = (mid > begin) & (mid <= end), scene.law_context(phase, 0.5 * (begin + end))
        if now.touching and here.any():
            same_contact.setdefault((now.speed, now.pressure, now.waited, now.direction), (now, []))[1].append(here)
        else:
            films = laws.films.get("block.face", [])
            out[here] = min(sum(part.law(now, p) for part, p, _ in films), MAX_CONDUCTANCE_W_M2K)
    for now, parts in same_contact.values():
        here = np.any(parts, axis=0)
        # laws and eq. (31) count x from the edge that meets the road first
        load, worn_depth = (a[1:][here].mean(axis=0)[:: now.direction] for a in (pressure, worn))
        shape = np.maximum(rise[1:][here].mean(axis=0), 0.0)[:: now.direction]
        # 1 % of the peak everywhere keeps J/T finite where the face is cold
        shape = shape + 0.01 * shape.max() if shape.any() else np.ones_like(shape)
        phi, resistance = _contact_transfer(scene, laws, now, load, worn_depth)
        out[here] = (phi * np.linalg.solve(resistance, shape) / shape)[:: now.direction]
    return np.clip(out, 0.0, MAX_CONDUCTANCE_W_M2K)


def _iter_contact_intervals(scene: Scene):
    """Begin and end (s) of phases; a wait in contact is cut where its time doubles, since its conductance falls."""
    for phase in scene.schedule.phases:
        if phase.sliding or scene.schedule.lifted or scene.schedule.alone:
            yield phase.begin, phase.end, phase
            continue
        ends = phase.begin + (phase.end - phase.begin) * np.append(0.0, 0.5 ** np.arange(WAIT_DOUBLINGS, -1.0, -1.0))
        for begin, end in pairwise(ends.tolist()):
            yield begin, end, phase


def _contact_transfer(scene: Scene, laws: EffectLaws, now: LawContext, load: Array, worn: Array) -> tuple[Array, Array]:
    """Contact fraction (x,), and the matrix (x, x) in m2 K/W from fluxes of the spots to the face's rise, eq. (31)."""
    mesh = scene.mesh
    edges = mesh.x[mesh.first : mesh.last + 1] - mesh.x[mesh.first]
    one = np.ones(len(edges) - 1)
    at = now.under_block(mesh, local_pressure=load, worn=worn, face=scene.ambient * one)
    phi = np.clip(laws("contact.spot_fraction", 0.0, None, at) * one, 1e-6, 1.0)
    context = at.with_fields(spot_fraction=phi, covered=float(phi @ np.diff(edges) / scene.length))
    local = sum(laws(f"contact.{name}", 0.0, None, context) for name in ("resistance", "micro_resistance"))
    local = np.maximum(local + laws("contact.flash_resistance", 0.0, None, context), 0.0) * one
    last = now.last_speed if now.last_speed > 0.0 else scene.length
    speed = 1.0 / (1.0 / last + now.waited / scene.length)  # a block at rest counts as one that passes slowly
    response = _lane_response(scene, laws, context, scene.length / speed)
    centres = 0.5 * (edges[1:] + edges[:-1])
    # J is even over a column, so the integral of eq. (31) is a difference between its two edges
    reached = response(np.maximum(centres[:, None] - edges, 0.0) / speed)
    common = np.minimum(phi[:, None], phi) / phi[:, None]  # nested lanes: those here that touched there (eq. (15d))
    return phi, np.diag(local) + common * (reached[:, :-1] - reached[:, 1:])


def _lane_response(scene: Scene, laws: EffectLaws, context: LawContext, oldest: float):
    """Temperature rise of a lane, K per W/m2, as a function of how long it has been heated, s, up to `oldest`.

    The kernel of eq. (31) is integrated over the root of the age, in which it is smooth.
    """
    ends = np.linspace(0.0, np.sqrt(oldest), AGE_INTERVALS + 1)
    half = 0.5 * ends[1]
    roots = (ends[1:, None] - half + half * AGE_NODES)[..., None]
    # sideways distance r of heat of age tau: s = r^2/(4 a_S tau) makes eq. (15b) a Gauss-Laguerre integral
    apart = 2.0 * roots * np.sqrt(scene.road.diffusivity * SPREAD_NODES)
    kept = laws("road.lane_overlap", 1.0, None, context, apart) * np.ones_like(apart) @ SPREAD_WEIGHTS
    # d tau/sqrt(tau) = 2 d sqrt(tau) removes the singularity of eq. (31)
    steps = 2.0 * half / (scene.road.effusivity * np.sqrt(np.pi)) * (kept @ AGE_WEIGHTS)
    rise = np.append(0.0, np.cumsum(steps))
    return lambda age: np.interp(np.sqrt(age), ends, rise)
