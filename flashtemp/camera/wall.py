"""The block's side wall, which its film cools below the section behind it.

In 2D the section is the mean across the width W.  What a film of h W/m2K draws from the wall lacks in a corner whose
face the contact holds, for the most part: s seconds later the lack has spread as T(z, t) has, less what has come in
through the face since.  So the wall is cooler by d,

    k d = sum over steps of h [ R(a) T(z, t) - int_0^a T(0, t - s) (g(z, s) (R(a) - R(s)) - R'(s) E(z, s)) ds ],

a the time since the step, R(s) what even cooling does to the wall of a plate against its mean, g(z, s) =
z exp(-z2/4Ds)/(2 sqrt(pi D) s^1.5) what a held face sends to z, E(z, s) = exp(-z2/4Ds) erfcx(z/(2 sqrt(Ds)) +
H sqrt(Ds)/k) what lacks because a contact of H W/m2K does not hold it quite.  How good that is: docs/camera.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PPoly
from scipy.special import erfcx

from flashtemp.model.laws import Laws
from flashtemp.model.scene import Scene
from flashtemp.physics.interpolation import between

STRETCHES = 8  # of a phase, in each of which the film of the walls is taken for even
FINE, AGES = 30, 3  # ages to a decade at which kernels are computed, and every how many of them a face's is taken
ORDERS, EARLY = np.arange(1.0, 5.0), 0.1  # modes of a plate, and Fourier's number below which it is a half-space
FAINT = 0.02  # of the largest rise of a face, and K: below, a change is no share of it
REACH = 3.5  # z/(2 sqrt(D s)) beyond which nothing has arrived from the face


@dataclass(frozen=True)
class Face:
    """The block's face: its `rise` (n, x) in K at `times` (n,) in s, and how firmly the contact holds it, W/m2K."""

    rise: np.ndarray
    times: np.ndarray
    held: float

    @classmethod
    def of(cls, run) -> Face:
        """That of a run: what the road takes for every kelvin of the face."""
        rise = run.T_block.astype(float) - run.ambient_degC
        slid = np.where(run.sliding[1:], np.diff(run.time), 0.0)
        warm = slid @ (0.5 * (rise[1:] + rise[:-1])) @ np.diff(run.mesh.x[run.mesh.first : run.mesh.last + 1])
        taken = float(run.energy["into_road"][-1] - run.energy["into_road"][0])
        return cls(rise, run.time, taken / warm if warm > 0.0 < taken else np.inf)

    def beside(self, run, level) -> Face:
        """That of a neighbour of this run, which is recorded at few of its times, as is the neighbour's own `level`.

        What a small change does is taken as a share: of the rise, linear between records, and of how firmly it is held
        (where the neighbour's ledger tells it).
        """
        moved, plain = Face.of(run), Face.of(level)
        share = (moved.rise - plain.rise) / np.maximum(plain.rise, FAINT * max(float(plain.rise.max()), FAINT))
        rise = self.rise * (1.0 + between(share, level.time, self.times))
        told = np.isfinite(moved.held) and np.isfinite(plain.held)
        return Face(rise, self.times, self.held * moved.held / plain.held if told else self.held)


def wall_rise(scene: Scene, steps, z, times, section, face: Face) -> np.ndarray:
    """Rise of the wall (frames, x, z) in K at `times` where the `section` behind it has risen by as much.

    `steps`: when its film changed (s) and by how much (W/m2K); z (m) above the face.  In 2D alone: in 3D the wall is
    resolved.
    """
    deep, k = z > 0.0, scene.block.conductivity
    wall = section.copy()
    begin, end = steps[0][0], max(times)
    if end <= begin:
        return wall
    memory = _Memory.of(scene, z[deep], end - begin, face.held / k)
    moments = np.union1d(face.times, steps[0])
    rise = between(face.rise, face.times, moments)
    for frame, t in enumerate(times):
        if t <= begin:
            continue
        at = np.append(np.union1d(moments[(begin <= moments) & (moments < t)], memory.before(t, begin)), t)
        reached, came = memory.since(t, at, *steps)
        history = between(rise, moments, at)
        drawn = reached * section[frame][:, deep] - (came @ (0.5 * (history[1:] + history[:-1]))).T
        wall[frame][:, deep] -= drawn / (k + reached - came.sum(axis=1))  # of a section that is warm evenly: per kelvin
    return wall


@dataclass(frozen=True)
class _Memory:
    """What heat that has come through the face does at heights above it: over ln(a) of its age a, `fresh` is the
    integral of g from 0 to a, `lost` that of g R + R' E."""

    scene: Scene
    grid: np.ndarray
    fresh: PPoly
    lost: PPoly

    @classmethod
    def of(cls, scene: Scene, z, oldest: float, held: float) -> _Memory:
        """Of heights z (m) over the `oldest` age (s); `held` is H/k in 1/m."""
        D = scene.block.diffusivity
        first = min((float(z.min()) / (2.0 * REACH)) ** 2 / D, 0.1 * oldest)
        grid = np.geomspace(first, oldest, 2 + int(FINE * np.log10(oldest / first)))
        s, near = grid[:, None], z / (2.0 * np.sqrt(D * grid))[:, None]
        high = scene.height / np.sqrt(D * grid)[:, None]
        paths = ((1.0, near), (1.0, high - near), (-1.0, high + near), (-1.0, 2.0 * high - near))  # from the back too
        g = sum(sign * far * np.exp(-(far**2)) for sign, far in paths) / np.sqrt(np.pi)  # times s, as both parts
        loose = np.exp(-(near**2)) * erfcx(near + held * np.sqrt(D * s))
        parts = g, g * _reach(scene, s) + s * _rate(scene, s) * loose
        return cls(scene, grid, *(CubicSpline(np.log(grid), part).antiderivative() for part in parts))

    def before(self, t: float, begin: float) -> np.ndarray:
        """Moments (s) as close before t as the memory is short, none before `begin`."""
        at = t - self.grid[::-AGES]
        return at[at > begin]

    def since(self, t: float, at, begun, change) -> tuple[float, np.ndarray]:
        """What films that `begun` so far draw at the time t by their reach (W/mK), and what of it came (z, n - 1)
        through the face between the times `at` (n,) of which t is the last, both per kelvin."""
        on = begun < t
        strength = change[on] * _reach(self.scene, t - begun[on])
        acting = np.searchsorted(begun[on], at[:-1], side="right") - 1
        age = np.log(np.maximum(t - at, self.grid[0]))
        fresh, lost = (-np.diff(part(age), axis=0).T for part in (self.fresh, self.lost))
        return float(strength.sum()), np.cumsum(strength)[acting] * fresh - np.cumsum(change[on])[acting] * lost


def _reach(scene: Scene, s):
    """R(s) in m: how much cooler than its mean the wall of a plate as thick as the block is wide is, per q/k."""
    half, number, modes = _plate(scene, s)
    late = 1.0 / 3.0 - 2.0 * (modes / (np.pi * ORDERS) ** 2).sum(axis=-1)
    return half * np.where(number < EARLY, 2.0 * np.sqrt(number / np.pi) - number, late)


def _rate(scene: Scene, s):
    """R'(s) in m/s."""
    half, number, modes = _plate(scene, s)
    early = 1.0 / np.sqrt(np.pi * number) - 1.0
    return scene.block.diffusivity / half * np.where(number < EARLY, early, 2.0 * modes.sum(axis=-1))


def _plate(scene: Scene, s) -> tuple[float, np.ndarray, np.ndarray]:
    """Half the width (m), Fourier's number of s, and how much of every mode is left."""
    half = 0.5 * scene.width
    number = scene.block.diffusivity * s / half**2
    return half, number, np.exp(-((np.pi * ORDERS) ** 2) * number[..., None])


def corner_length(z, half: float):
    """Length l (m): h l/k is how much cooler the wall is than `half` behind it, at z (m) above a face that is held.

    Exact for even cooling of the wall of a corner without end; `half` far above, where heat flows straight to the wall.

    >>> [round(float(corner_length(z, 1.0)), 3) for z in (0.0, 0.1, 1.0, 100.0)]
    [0.0, 0.21, 0.721, 0.997]
    """
    above = np.maximum(z, 1e-9 * half)
    return 2.0 / np.pi * (0.5 * above * np.log1p((half / above) ** 2) + half * np.arctan(above / half))


def film_steps(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) at which the film of the block's walls changes, and by how much (W/m2K), from none at the start."""
    films = Laws(scene).films.get("block.sides" if scene.resolved else "block.leading", [])
    at, seen = [0.0], [0.0]
    for phase in scene.schedule.phases:
        edges = np.linspace(phase.begin, phase.end, STRETCHES + 1)
        moments = [scene.moment(phase, t) for t in 0.5 * (edges[1:] + edges[:-1])]
        at += list(edges[:-1])
        seen += [sum(part.law(now, p) for part, p, _ in films) for now in moments]
    change = np.diff(seen)
    some = change != 0.0
    return np.array(at[1:])[some], change[some]
