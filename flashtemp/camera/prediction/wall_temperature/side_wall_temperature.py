"""The block's side wall, which its films cool below the section behind it.

In 2D the section is one that no side wall is near, but for films that the section itself feels (`block.sides`).  The
wall is cooler, the more the longer ago the heat came that lies behind it: a problem of the block's corner, which is
solved for what its face has been through (`flashtemp/camera/prediction/wall_temperature/side_wall_conduction.py`).  How good that is:
docs/explanation/camera_model.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from flashtemp.camera.prediction.pixel_sampling import MatrixCache
from flashtemp.camera.prediction.wall_temperature.contact_conductance import (
    MAX_CONDUCTANCE_W_M2K,
    effective_contact_conductance,
)
from flashtemp.camera.prediction.wall_temperature.kirchhoff_transform import KirchhoffTransform
from flashtemp.camera.prediction.wall_temperature.side_wall_conduction import WallCornerModel
from flashtemp.model.effect_laws import EffectLaws
from flashtemp.model.scene import LawContext, Scene
from flashtemp.physics.interpolation import interpolate_linear

FILM_SAMPLE_POINTS = np.array([-2.0, 0.0, 2.0]) / 3.0  # a stretch from -1 to 1, where films are asked for
FILM_INTERVALS = 8  # of a phase, in each of which the film of the walls is taken for even
COLUMN_GROUPS = 10  # groups of columns along the block, between which the wall follows splines
FAINT_PEAK_FRACTION, FAINT_RISE_K = 0.01, 1e-9  # of the warmest place, and K: below, what lacks is no share
SECANT_RISE_K = 10.0  # K by which a wall has warmed in the mean, for heat that is not proportional to that
MIN_FACE_RISE_FRACTION = 0.02  # of the largest rise of a face, and K: below, a change is no share of it


@dataclass(frozen=True)
class FaceHistory:
    """The block's face: its `rise` (n, x) in K at `times` (n,) in s, the contact's `contact_conductance` (n - 1, x) in W/m2K, and what
    that follows from: local `pressure` (n, x) in Pa and how far it is `worn` (n, x), m."""

    rise: np.ndarray
    times: np.ndarray
    contact_conductance: np.ndarray
    pressure: np.ndarray
    worn: np.ndarray

    @classmethod
    def from_run(cls, run, scene: Scene) -> FaceHistory:
        """That of a run of a scene in 2D."""
        rise = run.T_block.astype(float) - run.ambient_degC
        pressure, worn = run.pressure.astype(float), run.worn.astype(float)
        return cls(rise, run.time, effective_contact_conductance(scene, run.time, rise, pressure, worn), pressure, worn)

    def for_perturbed_run(self, run, level, scene: Scene) -> FaceHistory:
        """That of a neighbour of this run with a scene of its own, which is recorded at few of its times, as is the
        neighbour's own `level`.

        What a small change does is taken as a share of the rise, linear between records.
        """
        moved, plain = (one.T_block.astype(float) - one.ambient_degC for one in (run, level))
        share = (moved - plain) / np.maximum(
            plain, MIN_FACE_RISE_FRACTION * max(float(plain.max()), MIN_FACE_RISE_FRACTION)
        )
        rise = self.rise * (1.0 + interpolate_linear(share, level.time, self.times))
        hold = effective_contact_conductance(
            scene, self.times, self.rise, self.pressure, self.worn
        )  # its own shapes are of second order
        return FaceHistory(rise, self.times, hold, self.pressure, self.worn)


def side_wall_rise(
    scene: Scene, films: WallFilmCoefficients, z, times, section, face: FaceHistory, kept: MatrixCache | None = None
) -> np.ndarray:
    """Rise of the wall (frames, x, z) in K at `times` where the `section` behind it has risen by as much.

    z (m) above the face; `kept` is what images of one recording share.  In 2D alone: in 3D the wall is resolved.
    """
    if max(times) <= face.times[0]:
        return section
    corner, moments = build_corner_model(scene, films, times, face)
    lack, own, _ = corner.temperature_deficit(z, np.zeros(1), moments, kept)
    lack, first = lack[:, :, 0], _group_starts(scene)
    if len(first) > 2:
        along = CubicSpline(0.5 * (first[1:] + first[:-1]), np.stack([lack, own]), axis=2)
        lack, own = along(np.arange(first[-1]) + 0.5)
    # the corner's section is nearly this one: what it lacks, as a share where it is warm
    faint, conduction = (
        (FAINT_PEAK_FRACTION * np.abs(own).max(axis=(1, 2), keepdims=True) + FAINT_RISE_K) ** 2,
        KirchhoffTransform.from_scene(scene),
    )
    warm = conduction.theta(section) - corner.air[moments][:, None, None]
    return conduction.subtract_theta(section, lack * (warm * own + faint) / (own**2 + faint))


def build_corner_model(
    scene: Scene, films: WallFilmCoefficients, times, face: FaceHistory
) -> tuple[WallCornerModel, np.ndarray]:
    """The corner of a block whose face has such a history, and which of its moments are `times` (s)."""
    reach = max(times)
    other = np.append(True, np.any(face.contact_conductance[1:] != face.contact_conductance[:-1], axis=1))
    records = face.times[:-1][other | (np.arange(len(other)) % 2 == 0)]  # every second, and where the hold changes
    asked = [records, films.start_times, times, films.air[0] if np.ptp(films.air[1]) else films.start_times]
    moments = np.unique(np.concatenate([t[(t >= face.times[0]) & (t <= reach)] for t in map(np.asarray, asked)]))
    mid = 0.5 * (moments[1:] + moments[:-1])
    since = np.clip(np.searchsorted(face.times, mid) - 1, 0, len(face.contact_conductance) - 1)
    edges, mean = group_columns(scene)
    air, conduction = np.interp(moments, *films.air), KirchhoffTransform.from_scene(scene)
    rise = interpolate_linear(face.rise @ mean, face.times, moments)
    block, felt = conduction.mean_material(rise, moments)
    hold = (face.contact_conductance @ mean)[since] / conduction.conductivity_ratio(0.5 * (rise[1:] + rise[:-1]))
    corner = WallCornerModel(
        block, scene.width, scene.height, edges, moments, conduction.theta(rise) - air[:, None], air, hold,
        felt * films.coefficient_at(mid, films.wall), felt * films.coefficient_at(mid, films.section), conduction.axial_conductivity_ratio,
    )  # fmt: skip
    return corner, np.searchsorted(moments, np.clip(times, moments[0], reach))


def group_columns(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Edges (groups + 1,) in m of groups of columns, and what makes means over them of columns (columns, groups)."""
    first, edges = _group_starts(scene), scene.mesh.x[scene.mesh.first : scene.mesh.last + 1]
    inside = np.repeat(np.eye(len(first) - 1), np.diff(first), axis=0)
    return edges[first], inside * np.diff(edges)[:, None] / np.diff(edges[first])


def _group_starts(scene: Scene) -> np.ndarray:
    """Number of the column with which each group of columns begins, and of all."""
    columns = scene.mesh.last - scene.mesh.first
    return np.unique(np.linspace(0, columns, COLUMN_GROUPS + 1).round().astype(int))


@dataclass(frozen=True)
class WallFilmCoefficients:
    """Films of the side walls (n,) W/m2K, from when (s) each has `start_times`: the `wall`'s, and of that the `section`'s.

    `air`: times (m,) in s, and by how much the air is warmer then than at the start (m,), K; linear between.
    """

    start_times: np.ndarray
    wall: np.ndarray
    section: np.ndarray
    air: tuple[np.ndarray, np.ndarray]

    @classmethod
    def from_scene(cls, scene: Scene) -> WallFilmCoefficients:
        """Those of a scene: in 2D the air cools the side walls as it does the leading one."""
        laws = EffectLaws(scene)
        begun, seen, air = [], [], [0.0]
        calm = laws.base_films_only and not (
            laws.patches or laws.has_law("ambient.temperature")
        )  # nothing changes in a phase
        for phase in scene.schedule.phases:
            edges = np.linspace(phase.begin, phase.end, 1 + (1 if calm else FILM_INTERVALS))
            within = 0.5 * (edges[:-1, None] + edges[1:, None] + np.diff(edges)[:, None] * FILM_SAMPLE_POINTS)
            begun += list(edges[:-1])
            seen += [
                np.mean([_film_coefficients(laws, scene.law_context(phase, t), scene) for t in some], axis=0)
                for some in within
            ]
            air += [laws("ambient.temperature", 0.0, None, scene.law_context(phase, t)) for t in edges[1:]]
        changed = np.append(True, np.any(np.diff(seen, axis=0) != 0.0, axis=1))
        on_wall, on_section = np.array(seen)[changed].T
        clock = np.append(begun, scene.schedule.phases[-1].end)
        return cls(np.array(begun)[changed], on_wall, on_section, (clock, np.array(air)))

    def coefficient_at(self, times, films: np.ndarray) -> np.ndarray:
        """One of the two at some `times` (s), where it changes the one before."""
        return films[np.maximum(np.searchsorted(self.start_times, times) - 1, 0)]


def _film_coefficients(laws: EffectLaws, now: LawContext, scene: Scene) -> tuple[float, float]:
    """What side walls lose for every kelvin, and of that what the section feels as a whole, W/m2K.

    By films and by what else changes as a wall warms.  In 2D the base's films say nothing of side walls: what they say
    of the leading one holds there.
    """
    there = now.at_position(scene.mesh, np.array([0.5 * scene.length]), 0.0, local_pressure=now.pressure,
                   spot_fraction=scene.spot_fraction, covered=scene.spot_fraction)  # fmt: skip
    base = {acting.name for acting in scene.acting if acting.effect.base}
    sides, leading = laws.films.get("block.sides", []), laws.films.get("block.leading", [])
    said = {name for _, _, name in sides}
    section = sum(part.law(now, p) for part, p, _ in sides)
    wall = sum(part.law(now, p) for part, p, name in leading if name in base - said)
    for part, p, _ in laws.patches:
        if part.site == "block.sides":
            cold, warm = (np.mean(part.law(T, there, p)) for T in (there.ambient, there.ambient + SECANT_RISE_K))
            section += max(float(cold - warm), 0.0) / SECANT_RISE_K
    return min(float(section + wall), MAX_CONDUCTANCE_W_M2K), min(float(section), MAX_CONDUCTANCE_W_M2K)


def wall_deficit_length(z, half: float):
    """Length l (m): h l/k is how much cooler the wall is than `half` behind it, at z (m) above a face that is held.

    Exact for even cooling of the wall of a corner without end; `half` far above, where heat flows straight to the wall.

    >>> [round(float(wall_deficit_length(z, 1.0)), 3) for z in (0.0, 0.1, 1.0, 100.0)]
    [0.0, 0.21, 0.721, 0.997]
    """
    above = np.maximum(z, 1e-9 * half)
    return 2.0 / np.pi * (0.5 * above * np.log1p((half / above) ** 2) + half * np.arctan(above / half))
