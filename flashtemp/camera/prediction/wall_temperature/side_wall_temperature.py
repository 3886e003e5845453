"""Temperature of the block's side wall, from a 2D run that does not resolve it.

A 2D run solves a section far from the side walls; the only cooling there that it knows is that of `block.sides`.
Air cools the wall below the section, the more the longer ago the heat behind it arrived.  The difference is the
solution for the corner between face and wall under the history of the face, eqs. (27) to (29) of
docs/explanation/theory.md.  Its accuracy is listed in docs/explanation/camera_model.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

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

FILM_SAMPLE_POINTS = np.array([-2.0, 0.0, 2.0]) / 3.0  # of an interval from -1 to 1, where coefficients are evaluated
FILM_INTERVALS = 8  # of a phase, in each of which the heat-transfer coefficient of the walls is constant
COLUMN_GROUPS = 10  # groups of columns along the block, between which splines interpolate the wall
FAINT_PEAK_FRACTION, FAINT_RISE_K = 0.01, 1e-9  # of the largest rise, and K: below, the deficit is not scaled
SECANT_RISE_K = 10.0  # K, typical rise of a wall, over which losses that are not proportional to it are linearised
MIN_FACE_RISE_FRACTION = 0.02  # of the largest rise of a face, and K: below, a change is not taken relative to it


@dataclass(frozen=True)
class FaceHistory:
    """History of the block's face: `rise` (n, x) in K above ambient at `times` (n,) in s.

    `contact_conductance` (n - 1, x) in W/m2K follows from the rise, the local `pressure` (n, x) in Pa and the depth by
    which the face is `worn` (n, x), m.  `step_times` (m,) in s: ends of the time steps of the corner model, beside the
    times at which it is evaluated.
    """

    rise: np.ndarray
    times: np.ndarray
    contact_conductance: np.ndarray
    pressure: np.ndarray
    worn: np.ndarray
    step_times: np.ndarray

    @classmethod
    def from_run(cls, run, scene: Scene) -> FaceHistory:
        """History of the face in a 2D run of a scene."""
        rise = run.T_block.astype(float) - run.ambient_degC
        pressure, worn = run.pressure.astype(float), run.worn.astype(float)
        conductance = effective_contact_conductance(scene, run.time, rise, pressure, worn)
        steps = corner_step_times(run.time, conductance, WallFilmCoefficients.from_scene(scene))
        return cls(rise, run.time, conductance, pressure, worn, steps)

    def for_perturbed_run(self, run, reference, scene: Scene) -> FaceHistory:
        """History of the face in a perturbed `run` of another `scene`.

        That run and its `reference` are recorded at few times.  Their relative difference, interpolated linearly in
        time, scales this history.  Its time steps are kept: other ones would show their own error as a change.
        """
        perturbed, base = (one.T_block.astype(float) - one.ambient_degC for one in (run, reference))
        relative_change = (perturbed - base) / np.maximum(
            base, MIN_FACE_RISE_FRACTION * max(float(base.max()), MIN_FACE_RISE_FRACTION)
        )
        rise = self.rise * (1.0 + interpolate_linear(relative_change, reference.time, self.times))
        # the unperturbed profiles of rise, pressure and wear enter here: their change is of second order
        conductance = effective_contact_conductance(scene, self.times, self.rise, self.pressure, self.worn)
        return replace(self, rise=rise, contact_conductance=conductance)


def corner_step_times(times: np.ndarray, contact_conductance: np.ndarray, films: WallFilmCoefficients) -> np.ndarray:
    """Ends of the time steps (s) of a corner model, from the records of a face at `times` (n,) s.

    They are every second record, those at which the `contact_conductance` (n - 1, x) changes, the times at which a
    heat-transfer coefficient changes, and those that describe air that warms.
    """
    changes = np.append(True, np.any(contact_conductance[1:] != contact_conductance[:-1], axis=1))
    records = times[:-1][changes | (np.arange(len(changes)) % 2 == 0)]
    return np.unique(np.concatenate([records, films.start_times, films.air[0] if np.ptp(films.air[1]) else []]))


def side_wall_rise(
    scene: Scene, films: WallFilmCoefficients, z, times, section, face: FaceHistory, kept: MatrixCache | None = None
) -> np.ndarray:
    """Temperature rise of the wall (frames, x, z) in K at `times` (s), from the rise of the `section` behind it.

    z (m) is the height above the face; `kept` caches matrices for the images of one recording.  For 2D runs only: a 3D
    run resolves the wall.
    """
    if max(times) <= face.times[0]:
        return section
    corner, moments = build_corner_model(scene, films, times, face)
    deficit, corner_section, _ = corner.temperature_deficit(z, np.zeros(1), moments, kept)
    deficit, first = deficit[:, :, 0], _group_starts(scene)
    if len(first) > 2:
        along = CubicSpline(0.5 * (first[1:] + first[:-1]), np.stack([deficit, corner_section]), axis=2)
        deficit, corner_section = along(np.arange(first[-1]) + 0.5)
    # The corner model's section is nearly the run's.  Where it is warm, the deficit is scaled by the ratio of the two;
    # where it is not, the ratio means nothing and tends to 1.
    conduction = KirchhoffTransform.from_scene(scene)
    faint = (FAINT_PEAK_FRACTION * np.abs(corner_section).max(axis=(1, 2), keepdims=True) + FAINT_RISE_K) ** 2
    above_air = conduction.theta(section) - corner.air[moments][:, None, None]
    ratio_weighted = deficit * (above_air * corner_section + faint) / (corner_section**2 + faint)
    return conduction.subtract_theta(section, ratio_weighted)


def build_corner_model(
    scene: Scene, films: WallFilmCoefficients, times, face: FaceHistory
) -> tuple[WallCornerModel, np.ndarray]:
    """Corner model of a block whose face has such a history, and the indices of `times` (s) among its moments."""
    last_time = max(times)
    moments = np.union1d(face.step_times, times)
    moments = moments[(moments >= face.times[0]) & (moments <= last_time)]
    mid = 0.5 * (moments[1:] + moments[:-1])
    interval = np.clip(np.searchsorted(face.times, mid) - 1, 0, len(face.contact_conductance) - 1)
    edges, mean = group_columns(scene)
    air, conduction = np.interp(moments, *films.air), KirchhoffTransform.from_scene(scene)
    rise = interpolate_linear(face.rise @ mean, face.times, moments)
    block, film_factor = conduction.mean_material(rise, moments)
    # H per kelvin of Kirchhoff's theta (eq. (32)), which the corner model solves for instead of the rise
    conductance = (face.contact_conductance @ mean)[interval] / conduction.conductivity_ratio(
        0.5 * (rise[1:] + rise[:-1])
    )
    corner = WallCornerModel(
        block=block,
        width=scene.width,
        height=scene.height,
        edges=edges,
        times=moments,
        rise=conduction.theta(rise) - air[:, None],
        air=air,
        contact_conductance=conductance,
        wall_film=film_factor * films.coefficient_at(mid, films.wall),
        section_film=film_factor * films.coefficient_at(mid, films.section),
        axial_conductivity_ratio=conduction.axial_conductivity_ratio,
    )
    return corner, np.searchsorted(moments, np.clip(times, moments[0], last_time))


def group_columns(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Edges (groups + 1,) in m of groups of columns, and the matrix (columns, groups) that averages over each group."""
    first, edges = _group_starts(scene), scene.mesh.x[scene.mesh.first : scene.mesh.last + 1]
    inside = np.repeat(np.eye(len(first) - 1), np.diff(first), axis=0)
    return edges[first], inside * np.diff(edges)[:, None] / np.diff(edges[first])


def _group_starts(scene: Scene) -> np.ndarray:
    """Index (groups + 1,) of the first column of each group, and the number of columns."""
    columns = scene.mesh.last - scene.mesh.first
    return np.unique(np.linspace(0, columns, COLUMN_GROUPS + 1).round().astype(int))


@dataclass(frozen=True)
class WallFilmCoefficients:
    """Heat-transfer coefficients of the side walls in intervals that begin at `start_times` (n,) s.

    `wall` (n,) W/m2K is the whole coefficient, `section` (n,) the part that the 2D section already loses as a fin.
    `air`: times (m,) in s and the warming of the air since the start (m,) in K, linear in between.
    """

    start_times: np.ndarray
    wall: np.ndarray
    section: np.ndarray
    air: tuple[np.ndarray, np.ndarray]

    @classmethod
    def from_scene(cls, scene: Scene) -> WallFilmCoefficients:
        """Coefficients of a scene; in 2D the air cools the side walls as it cools the leading wall."""
        laws = EffectLaws(scene)
        starts, values, air = [], [], [0.0]
        is_constant = laws.base_films_only and not (laws.patches or laws.has_law("ambient.temperature"))
        for phase in scene.schedule.phases:
            edges = np.linspace(phase.begin, phase.end, 1 + (1 if is_constant else FILM_INTERVALS))
            within = 0.5 * (edges[:-1, None] + edges[1:, None] + np.diff(edges)[:, None] * FILM_SAMPLE_POINTS)
            starts += list(edges[:-1])
            values += [
                np.mean([_film_coefficients(laws, scene.law_context(phase, t), scene) for t in sample_times], axis=0)
                for sample_times in within
            ]
            air += [laws("ambient.temperature", 0.0, None, scene.law_context(phase, t)) for t in edges[1:]]
        changed = np.append(True, np.any(np.diff(values, axis=0) != 0.0, axis=1))
        on_wall, on_section = np.array(values)[changed].T
        clock = np.append(starts, scene.schedule.phases[-1].end)
        return cls(np.array(starts)[changed], on_wall, on_section, (clock, np.array(air)))

    def coefficient_at(self, times, films: np.ndarray) -> np.ndarray:
        """`wall` or `section` at `times` (s); at the very time of a change, the value before it."""
        return films[np.maximum(np.searchsorted(self.start_times, times) - 1, 0)]


def _film_coefficients(laws: EffectLaws, now: LawContext, scene: Scene) -> tuple[float, float]:
    """Heat-transfer coefficient of the side walls, and the part of it that the 2D section itself loses, W/m2K.

    It covers convection and every other loss that grows as the wall warms, such as radiation.  The base laws of a 2D
    scene know no side walls: their coefficient of the leading wall is used there.
    """
    at_wall = now.at_position(scene.mesh, np.array([0.5 * scene.length]), 0.0, local_pressure=now.pressure,
                   spot_fraction=scene.spot_fraction, covered=scene.spot_fraction)  # fmt: skip
    base = {acting.name for acting in scene.acting if acting.effect.base}
    sides, leading = laws.films.get("block.sides", []), laws.films.get("block.leading", [])
    side_effects = {name for _, _, name in sides}
    section = sum(part.law(now, p) for part, p, _ in sides)
    wall = sum(part.law(now, p) for part, p, name in leading if name in base - side_effects)
    for part, p, _ in laws.patches:
        if part.site == "block.sides":
            # heat into the wall falls as it warms: the secant slope is its heat-transfer coefficient
            cold, warm = (np.mean(part.law(T, at_wall, p)) for T in (at_wall.ambient, at_wall.ambient + SECANT_RISE_K))
            section += max(float(cold - warm), 0.0) / SECANT_RISE_K
    return min(float(section + wall), MAX_CONDUCTANCE_W_M2K), min(float(section), MAX_CONDUCTANCE_W_M2K)


def wall_deficit_length(z, half: float):
    """Length l (m) of which h l/k is the relative drop of temperature from a depth of `half` (m) to the wall.

    z (m) is the height above a face of fixed temperature.  Exact for uniform cooling of the wall of an infinite corner;
    it tends to `half` far above the face, where heat flows straight to the wall.

    >>> [round(float(wall_deficit_length(z, 1.0)), 3) for z in (0.0, 0.1, 1.0, 100.0)]
    [0.0, 0.21, 0.721, 0.997]
    """
    above = np.maximum(z, 1e-9 * half)  # eq. (34) has the limit 0 at z = 0, where z ln(1/z) cannot be evaluated
    return 2.0 / np.pi * (0.5 * above * np.log1p((half / above) ** 2) + half * np.arctan(above / half))
