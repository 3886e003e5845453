"""Nuisances that no laboratory knows better: what calibration may move besides free keys, and how far."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import numpy.typing as npt

from flashtemp.camera.camera_classes import CAMERA_CLASSES
from flashtemp.camera.placement import Place
from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import View
from flashtemp.discovery.estimation.camera_error_columns import NONE
from flashtemp.discovery.estimation.model_discrepancy import TYPICAL_DISCREPANCY
from flashtemp.discovery.hypotheses.candidates import Model
from flashtemp.discovery.parameters import (
    OF_A_POINT,
    OF_THE_CAMERA,
    OF_THE_LABORATORY,
    PLACED,
    SHIFTS,
    Kind,
    ParameterId,
    Priors,
)
from flashtemp.discovery.prediction.prediction import Derivatives, Observable, Single, flatten_valid_pixels
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.prediction.sensor_parameters import sensor_priors

MODES = 6  # cosines of the pressure along the block
GROUPS = {  # standard deviations, by the kind of nuisance
    Kind.SCATTER: 0.01,  # of friction from repetition to repetition
    Kind.LEVEL: 0.02,  # of friction from condition to condition
    Kind.GAIN: 0.01,  # what a view takes the radiance times
    Kind.SPREAD: 0.05,  # relative width of the optics
    Kind.MAP: 0.003,  # gain along and up a view
    Kind.WALL: 0.01,  # what the wall is cooler than the section behind it
    Kind.MESH: 0.5,  # of the difference to a mesh that is coarser in one direction, or in all
    Kind.CELL: 0.005,  # gain of the load cell
    Kind.FLOOR: TYPICAL_DISCREPANCY,  # the model's own error over the rise, 1e-3 to 3e-3 by evidence
    Kind.SCALE: 0.01,  # pixel scale of a view
    Kind.TURN: np.pi / 180.0,  # rad: turn of an image, 1 degree
    Kind.CLOCK: 0.02,  # s: clock of a camera against the schedule, half a frame of 25 Hz
    Kind.SIZE: 0.01,  # length and width of the block
}
UNSURE = 0.4  # relative width of optics that a recording does not say
MODE = 0.01  # of the first pressure mode; the n-th has an n-th of it
MAPS = ((1, 0), (2, 0), (0, 1), (1, 1), (0, 2))
ABOUT = 3.0**-0.5  # of half an image: standard deviation of the point in it about which it is turned
CARELESS = 0.5  # of a usual scale: from where the point about which it is off is not the one that was marked
LARGER = (Kind.SCATTER, Kind.MAP, Kind.WALL)  # than said where deviations of unknown shape are, up to MOST times
MOST = 3.0
FLUX = 0.05  # of the local heat: standard deviation of modes that have no name
PLAIN = frozenset(  # what everybody would calibrate
    {
        Kind.KEY,
        *SHIFTS,
        *PLACED,
        Kind.GAIN,
        Kind.SPREAD,
        Kind.LEVEL,
        Kind.CELL,
        Kind.MESH,
        Kind.SIZE,
        *OF_A_POINT,
        *OF_THE_CAMERA,
    }
)
WALLS = (1e-3, 4e-3)  # m: depths over which the wall's own cooling fades up the block


def all_derivatives(problem: Problem) -> Derivatives:
    """Derivatives by all that calibration may move."""
    return Derivatives(problem.free, True, MODES, True, optics=True, laboratory=True)


def nuisance_priors(problem: Problem, names: Iterable[ParameterId], model: Model) -> Priors:
    """(mean, standard deviation) of everything that calibration may move, seen from a point."""
    out: Priors = {}
    free = problem.priors
    recordings = {v.file: v.recording for v in problem.campaign.views}
    points = sensor_priors(problem.campaign.views)
    for p in names:
        if p in free:
            out[p] = (-model.free[p.name], free[p])
        elif p.kind in SHIFTS:
            sd = position_sd_px(recordings[p.file], model.place(p.file), p.axis)
            out[p] = (-model.shift(p.file)[p.axis], sd)
        elif p.kind in OF_A_POINT:
            out[p] = (-model.beads.get(p, 0.0), points[p])
        elif p.kind in OF_THE_CAMERA or is_camera_gain(p):
            out[p] = (0.0, _usual(recordings[p.file], p))
        elif p.kind in OF_THE_LABORATORY:
            out[p] = (-model.placed(p), GROUPS[p.kind])
        elif p.kind in (Kind.MODE, Kind.TREND):
            out[p] = (0.0, MODE / p.index[0])
        elif p.kind in GROUPS:
            unsure = p.kind is Kind.SPREAD and "psf_sigma_px" in problem.assumed_camera_facts.get(p.file, ())
            out[p] = (0.0, UNSURE if unsure else GROUPS[p.kind])
    return out


def _usual(recording: Recording, p: ParameterId) -> float:
    """Usual size of an error of a real camera; most columns are as large as it is already."""
    return CAMERA_CLASSES[recording.camera].gain_map if is_camera_gain(p) else 1.0


def position_sd_px(recording: Recording, place: Place, axis: int) -> float:
    """Standard deviation (px along u, 0, or v, 1) of where an image with a `place` stands.

    Nobody notes about which point a camera was turned: any that the image shows, alike; nor about which a scale is off
    beyond what is usual; added to how well its origin is known.  A wake begins at the edge that it is lined up with.
    """
    if recording.view != "sidewall":
        return recording.registration_sigma_px or 0.0
    wrong = max(abs(place.scale) - CARELESS * GROUPS[Kind.SCALE], 0.0), ABOUT * abs(place.turn)
    reach = [0.5 * float(centres[-1] - centres[0]) for centres in (recording.u, recording.v)]
    moved = np.hypot(wrong[0] * reach[axis], wrong[1] * reach[1 - axis])
    return float(np.hypot(recording.registration_sigma_px or 0.0, moved / recording.pitch[axis]))


def prior_scale_factors(scale: float) -> dict[Kind, float]:
    """Times as wide as said: priors of what is small and unknown in shape, at a `scale`."""
    return {Kind.MODE: scale, Kind.TREND: scale, **dict.fromkeys(LARGER, min(scale, MOST))}


def is_camera_gain(p: ParameterId) -> bool:
    """Whether it belongs to a gain map that only real cameras have, not to the slight one of every camera."""
    return p.kind is Kind.MAP and len(p.index) > 2


def factors(scale: float, families: Mapping[Kind, float]) -> dict[tuple[Kind, bool], float]:
    """Times as wide as said, by kind and whether only real cameras have it (`is_camera_gain`): priors of what is small
    and unknown in shape, at a `scale`, and of camera errors by family; 0 of errors that a camera does not have."""
    out = {(kind, False): times for kind, times in (dict(families) | prior_scale_factors(scale)).items()}
    return out | {(Kind.MAP, True): families[Kind.MAP]}


def scale_priors(priors: Priors, scale: float, floor: float, families: Mapping[Kind, float] = NONE) -> Priors:
    """The same at a `scale` of what is small and unknown in shape, a `floor` of the model's own relative error, and
    sizes of the `families` of camera errors; those that are none are left out."""
    out, times = {}, factors(scale, families)
    for p, (mean, sd) in priors.items():
        wide = floor if p.kind is Kind.FLOOR else sd * times.get((p.kind, is_camera_gain(p)), 1.0)
        if wide > 0.0:
            out[p] = (mean, wide)
    return out


def rigid_priors(priors: Priors) -> Priors:
    """Priors of nuisances that may not bend the pressure, the walls or the friction of a repetition; gain maps are
    calibrated where a camera clearly has one."""
    kinds = PLAIN | ({Kind.MAP} if any(map(is_camera_gain, priors)) else set())
    return {p: v for p, v in priors.items() if p.kind in kinds}


def unnamed_heat(names: Iterable[ParameterId]) -> Priors:
    """Priors of heat of any shape along the block, per condition and growing over the repetitions."""
    return {p: (0.0, FLUX / p.index[0] ** 0.5) for p in names if p.kind in (Kind.FLUX, Kind.TREND)}


def camera_smooth_basis(view: View, seen: Observable) -> dict[ParameterId, Single]:
    """Smooth maps that no run explains: a slight gain along a view, and the wall's own cooling."""
    r = view.recording
    if r.places is not None:  # points are no image
        return {}
    rise = seen.values - (r.reflected_degC or float(np.nanmin(seen.values)))
    out = {}
    x, y = _unit(r.u), _unit(r.v)
    for m, n in MAPS:
        if n and len(r.v) == 1:
            continue
        out[ParameterId(Kind.MAP, (m, n))] = rise * np.cos(n * np.pi * y)[:, None] * np.cos(m * np.pi * x)
    if r.view == "sidewall":
        for k, depth in enumerate(WALLS):
            out[ParameterId(Kind.WALL, (k,))] = rise * np.exp(-np.maximum(r.v, 0.0) / depth)[:, None]
    return {k: flatten_valid_pixels(values, seen.inside) for k, values in out.items()}


def _unit(centres: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Centres of pixels from 0 to 1."""
    return (centres - centres[0]) / max(centres[-1] - centres[0], 1e-12) if len(centres) > 1 else np.zeros(1)
