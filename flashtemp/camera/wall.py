"""The block's side wall, which its films cool below the section behind it.

In 2D the section is one that no side wall is near, but for films that the section itself feels (`block.sides`).  The
wall is cooler, the more the longer ago the heat came that lies behind it: a problem of the block's corner, which is
solved for what its face has been through (`flashtemp/camera/corner.py`).  How good that is:
docs/explanation/camera_model.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from flashtemp.camera.corner import Corner
from flashtemp.camera.hold import FIRMEST, firmness
from flashtemp.camera.kirchhoff import Kirchhoff
from flashtemp.camera.pixels import Kept
from flashtemp.model.laws import Laws
from flashtemp.model.scene import Moment, Scene
from flashtemp.physics.interpolation import between

WITHIN = np.array([-2.0, 0.0, 2.0]) / 3.0  # a stretch from -1 to 1, where films are asked for
STRETCHES = 8  # of a phase, in each of which the film of the walls is taken for even
PLACES = 10  # groups of columns along the block, between which the wall follows splines
CLOSE, TINY = 0.01, 1e-9  # of the warmest place, and K: below, what lacks is no share
WARM = 10.0  # K by which a wall has warmed in the mean, for heat that is not proportional to that
FAINT = 0.02  # of the largest rise of a face, and K: below, a change is no share of it


@dataclass(frozen=True)
class Face:
    """The block's face: its `rise` (n, x) in K at `times` (n,) in s, the contact's `hold` (n - 1, x) in W/m2K, and what
    that follows from: local `pressure` (n, x) in Pa and how far it is `worn` (n, x), m."""

    rise: np.ndarray
    times: np.ndarray
    hold: np.ndarray
    pressure: np.ndarray
    worn: np.ndarray

    @classmethod
    def of(cls, run, scene: Scene) -> Face:
        """That of a run of a scene in 2D."""
        rise = run.T_block.astype(float) - run.ambient_degC
        pressure, worn = run.pressure.astype(float), run.worn.astype(float)
        return cls(rise, run.time, firmness(scene, run.time, rise, pressure, worn), pressure, worn)

    def beside(self, run, level, scene: Scene) -> Face:
        """That of a neighbour of this run with a scene of its own, which is recorded at few of its times, as is the
        neighbour's own `level`.

        What a small change does is taken as a share of the rise, linear between records.
        """
        moved, plain = (one.T_block.astype(float) - one.ambient_degC for one in (run, level))
        share = (moved - plain) / np.maximum(plain, FAINT * max(float(plain.max()), FAINT))
        rise = self.rise * (1.0 + between(share, level.time, self.times))
        hold = firmness(scene, self.times, self.rise, self.pressure, self.worn)  # its own shapes are of second order
        return Face(rise, self.times, hold, self.pressure, self.worn)


def wall_rise(scene: Scene, films: Films, z, times, section, face: Face, kept: Kept | None = None) -> np.ndarray:
    """Rise of the wall (frames, x, z) in K at `times` where the `section` behind it has risen by as much.

    z (m) above the face; `kept` is what images of one recording share.  In 2D alone: in 3D the wall is resolved.
    """
    if max(times) <= face.times[0]:
        return section
    corner, moments = corner_of(scene, films, times, face)
    lack, own, _ = corner.lacks(z, np.zeros(1), moments, kept)
    lack, first = lack[:, :, 0], _groups(scene)
    if len(first) > 2:
        along = CubicSpline(0.5 * (first[1:] + first[:-1]), np.stack([lack, own]), axis=2)
        lack, own = along(np.arange(first[-1]) + 0.5)
    # the corner's section is nearly this one: what it lacks, as a share where it is warm
    faint, conduction = (CLOSE * np.abs(own).max(axis=(1, 2), keepdims=True) + TINY) ** 2, Kirchhoff.of(scene)
    warm = conduction.theta(section) - corner.air[moments][:, None, None]
    return conduction.rise(section, lack * (warm * own + faint) / (own**2 + faint))


def corner_of(scene: Scene, films: Films, times, face: Face) -> tuple[Corner, np.ndarray]:
    """The corner of a block whose face has such a history, and which of its moments are `times` (s)."""
    reach = max(times)
    other = np.append(True, np.any(face.hold[1:] != face.hold[:-1], axis=1))
    records = face.times[:-1][other | (np.arange(len(other)) % 2 == 0)]  # every second, and where the hold changes
    asked = [records, films.begun, times, films.air[0] if np.ptp(films.air[1]) else films.begun]
    moments = np.unique(np.concatenate([t[(t >= face.times[0]) & (t <= reach)] for t in map(np.asarray, asked)]))
    mid = 0.5 * (moments[1:] + moments[:-1])
    since = np.clip(np.searchsorted(face.times, mid) - 1, 0, len(face.hold) - 1)
    edges, mean = means(scene)
    air, conduction = np.interp(moments, *films.air), Kirchhoff.of(scene)
    rise = between(face.rise @ mean, face.times, moments)
    block, felt = conduction.mean(rise, moments)
    hold = (face.hold @ mean)[since] / conduction.factor(0.5 * (rise[1:] + rise[:-1]))
    corner = Corner(
        block, scene.width, scene.height, edges, moments, conduction.theta(rise) - air[:, None], air, hold,
        felt * films.at(mid, films.wall), felt * films.at(mid, films.section), conduction.along,
    )  # fmt: skip
    return corner, np.searchsorted(moments, np.clip(times, moments[0], reach))


def means(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Edges (groups + 1,) in m of groups of columns, and what makes means over them of columns (columns, groups)."""
    first, edges = _groups(scene), scene.mesh.x[scene.mesh.first : scene.mesh.last + 1]
    inside = np.repeat(np.eye(len(first) - 1), np.diff(first), axis=0)
    return edges[first], inside * np.diff(edges)[:, None] / np.diff(edges[first])


def _groups(scene: Scene) -> np.ndarray:
    """Number of the column with which each group of columns begins, and of all."""
    columns = scene.mesh.last - scene.mesh.first
    return np.unique(np.linspace(0, columns, PLACES + 1).round().astype(int))


@dataclass(frozen=True)
class Films:
    """Films of the side walls (n,) W/m2K, from when (s) each has `begun`: the `wall`'s, and of that the `section`'s.

    `air`: times (m,) in s, and by how much the air is warmer then than at the start (m,), K; linear between.
    """

    begun: np.ndarray
    wall: np.ndarray
    section: np.ndarray
    air: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, scene: Scene) -> Films:
        """Those of a scene: in 2D the air cools the side walls as it does the leading one."""
        laws = Laws(scene)
        begun, seen, air = [], [], [0.0]
        calm = laws.calm_films and not (laws.patches or laws.has("ambient.temperature"))  # nothing changes in a phase
        for phase in scene.schedule.phases:
            edges = np.linspace(phase.begin, phase.end, 1 + (1 if calm else STRETCHES))
            within = 0.5 * (edges[:-1, None] + edges[1:, None] + np.diff(edges)[:, None] * WITHIN)
            begun += list(edges[:-1])
            seen += [np.mean([_films(laws, scene.moment(phase, t), scene) for t in some], axis=0) for some in within]
            air += [laws("ambient.temperature", 0.0, None, scene.moment(phase, t)) for t in edges[1:]]
        changed = np.append(True, np.any(np.diff(seen, axis=0) != 0.0, axis=1))
        on_wall, on_section = np.array(seen)[changed].T
        clock = np.append(begun, scene.schedule.phases[-1].end)
        return cls(np.array(begun)[changed], on_wall, on_section, (clock, np.array(air)))

    def at(self, times, films: np.ndarray) -> np.ndarray:
        """One of the two at some `times` (s), where it changes the one before."""
        return films[np.maximum(np.searchsorted(self.begun, times) - 1, 0)]


def _films(laws: Laws, now: Moment, scene: Scene) -> tuple[float, float]:
    """What side walls lose for every kelvin, and of that what the section feels as a whole, W/m2K.

    By films and by what else changes as a wall warms.  In 2D the base's films say nothing of side walls: what they say
    of the leading one holds there.
    """
    there = now.at(scene.mesh, np.array([0.5 * scene.length]), 0.0, local_pressure=now.pressure,
                   spot_fraction=scene.spot_fraction, covered=scene.spot_fraction)  # fmt: skip
    base = {acting.name for acting in scene.acting if acting.effect.base}
    sides, leading = laws.films.get("block.sides", []), laws.films.get("block.leading", [])
    said = {name for _, _, name in sides}
    section = sum(part.law(now, p) for part, p, _ in sides)
    wall = sum(part.law(now, p) for part, p, name in leading if name in base - said)
    for part, p, _ in laws.patches:
        if part.site == "block.sides":
            cold, warm = (np.mean(part.law(T, there, p)) for T in (there.ambient, there.ambient + WARM))
            section += max(float(cold - warm), 0.0) / WARM
    return min(float(section + wall), FIRMEST), min(float(section), FIRMEST)


def corner_length(z, half: float):
    """Length l (m): h l/k is how much cooler the wall is than `half` behind it, at z (m) above a face that is held.

    Exact for even cooling of the wall of a corner without end; `half` far above, where heat flows straight to the wall.

    >>> [round(float(corner_length(z, 1.0)), 3) for z in (0.0, 0.1, 1.0, 100.0)]
    [0.0, 0.21, 0.721, 0.997]
    """
    above = np.maximum(z, 1e-9 * half)
    return 2.0 / np.pi * (0.5 * above * np.log1p((half / above) ** 2) + half * np.arctan(above / half))
