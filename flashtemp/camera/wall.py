"""The block's side wall, which its films cool below the section behind it.

In 2D the section is one that no side wall is near, but for films that the section itself feels (`block.sides`).  The wall
is cooler, the more the longer ago the heat came that lies behind it.  How much is that is a problem of the section across
(`flashtemp/camera/corner.py`), which is solved at some places along the block for what its face there has been through.
How good that is: docs/camera.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from flashtemp.camera.corner import Corner
from flashtemp.camera.hold import firmness
from flashtemp.model.laws import Laws
from flashtemp.model.scene import Scene
from flashtemp.physics.interpolation import between

STRETCHES = 8  # of a phase, in each of which the film of the walls is taken for even
PLACES = 14  # groups of columns along the block, between which the wall follows splines
FAINT = 0.02  # of the largest rise of a face, and K: below, a change is no share of it


@dataclass(frozen=True)
class Face:
    """The block's face: its `rise` (n, x) in K at `times` (n,) in s, and `hold` (n - 1, x) W/m2K by the contact since."""

    rise: np.ndarray
    times: np.ndarray
    hold: np.ndarray

    @classmethod
    def of(cls, run, scene: Scene) -> Face:
        """That of a run of a scene in 2D."""
        rise = run.T_block.astype(float) - run.ambient_degC
        return cls(rise, run.time, firmness(scene, run.time, rise))

    def beside(self, run, level, scene: Scene) -> Face:
        """That of a neighbour of this run with a scene of its own, which is recorded at few of its times, as is the
        neighbour's own `level`.

        What a small change does is taken as a share of the rise, linear between records.
        """
        moved, plain = (one.T_block.astype(float) - one.ambient_degC for one in (run, level))
        share = (moved - plain) / np.maximum(plain, FAINT * max(float(plain.max()), FAINT))
        rise = self.rise * (1.0 + between(share, level.time, self.times))
        return Face(rise, self.times, firmness(scene, self.times, rise))


def wall_rise(scene: Scene, films: Films, z, times, section, face: Face) -> np.ndarray:
    """Rise of the wall (frames, x, z) in K at `times` where the `section` behind it has risen by as much.

    z (m) above the face.  In 2D alone: in 3D the wall is resolved.
    """
    reach = max(times)
    asked = [face.times, films.begun, times]
    moments = np.unique(np.concatenate([t[(t >= face.times[0]) & (t <= reach)] for t in map(np.asarray, asked)]))
    mid = 0.5 * (moments[1:] + moments[:-1])
    since = np.clip(np.searchsorted(face.times, mid) - 1, 0, len(face.hold) - 1)
    first, groups, mean = _places(scene)
    corner = Corner(
        scene.block, scene.width, scene.height, groups, moments, between(face.rise @ mean, face.times, moments),
        (face.hold @ mean)[since], films.at(mid, films.wall), films.at(mid, films.section),
    )  # fmt: skip
    lacks = corner.lacks(z, np.searchsorted(moments, np.clip(times, moments[0], reach)))
    if len(first) > 2:
        lacks = CubicSpline(0.5 * (first[1:] + first[:-1]), lacks, axis=1)(np.arange(first[-1]) + 0.5)
    return section * (1.0 - lacks)


def _places(scene: Scene):
    """Where groups of columns begin, last the number of all; their edges (m), and means over them (columns, groups)."""
    mesh = scene.mesh
    edges = mesh.x[mesh.first : mesh.last + 1]
    first = np.unique(np.linspace(0, len(edges) - 1, PLACES + 1).round().astype(int))
    group = np.repeat(np.arange(len(first) - 1), np.diff(first))
    inside = group[:, None] == np.arange(len(first) - 1)
    return first, edges[first], inside * np.diff(edges)[:, None] / np.diff(edges[first])


@dataclass(frozen=True)
class Films:
    """Films of the side walls, each W/m2K from when (s) it has `begun`: what the `wall` feels, and of that the `section`."""

    begun: np.ndarray
    wall: np.ndarray
    section: np.ndarray

    @classmethod
    def of(cls, scene: Scene) -> Films:
        """Those of a scene: in 2D the walls feel what the leading wall feels."""
        laws = Laws(scene).films
        wall, section = (laws.get(site, []) for site in ("block.leading", "block.sides"))
        begun, seen = [], []
        for phase in scene.schedule.phases:
            edges = np.linspace(phase.begin, phase.end, STRETCHES + 1)
            moments = [scene.moment(phase, t) for t in 0.5 * (edges[1:] + edges[:-1])]
            begun += list(edges[:-1])
            seen += [[sum(part.law(now, p) for part, p, _ in site) for site in (wall, section)] for now in moments]
        changed = np.append(True, np.any(np.diff(seen, axis=0) != 0.0, axis=1))
        return cls(np.array(begun)[changed], *np.array(seen)[changed].T)

    def at(self, times, films: np.ndarray) -> np.ndarray:
        """One of the two at some `times` (s)."""
        return films[np.maximum(np.searchsorted(self.begun, times, side="right") - 1, 0)]


def corner_length(z, half: float):
    """Length l (m): h l/k is how much cooler the wall is than `half` behind it, at z (m) above a face that is held.

    Exact for even cooling of the wall of a corner without end; `half` far above, where heat flows straight to the wall.

    >>> [round(float(corner_length(z, 1.0)), 3) for z in (0.0, 0.1, 1.0, 100.0)]
    [0.0, 0.21, 0.721, 0.997]
    """
    above = np.maximum(z, 1e-9 * half)
    return 2.0 / np.pi * (0.5 * above * np.log1p((half / above) ** 2) + half * np.arctan(above / half))
