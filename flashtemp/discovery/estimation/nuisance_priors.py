"""Priors of nuisance parameters: everything that calibration estimates in addition to free keys."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import numpy.typing as npt

from flashtemp.camera.camera_classes import CAMERA_CLASSES
from flashtemp.camera.image_placement import ImagePlacement
from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.discovery.estimation.camera_error_columns import NO_CAMERA_ERRORS
from flashtemp.discovery.estimation.model_discrepancy import TYPICAL_DISCREPANCY
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.parameters import (
    CAMERA_ERROR_KINDS,
    PLACEMENT_KINDS,
    POINT_KINDS,
    SETUP_KINDS,
    SHIFT_KINDS,
    ParameterId,
    ParameterKind,
    Priors,
)
from flashtemp.discovery.prediction.prediction import DerivativeRequest, Observable, Single, flatten_valid_pixels
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.prediction.sensor_parameters import COLD_JUNCTION_SD_K, sensor_priors

PRESSURE_MODE_COUNT = 6  # cosines of the pressure along the block
NUISANCE_SD = {  # standard deviations, by the kind of nuisance
    ParameterKind.SCATTER: 0.01,  # of friction from repetition to repetition
    ParameterKind.LEVEL: 0.02,  # of friction from condition to condition
    ParameterKind.GAIN: 0.01,  # relative gain of a view on the radiance
    ParameterKind.SPREAD: 0.05,  # relative width of the optics
    ParameterKind.MAP: 0.003,  # gain along and up a view
    ParameterKind.WALL: 0.01,  # relative cooling of the wall against the section behind it
    ParameterKind.MESH: 0.5,  # of the mesh error by Richardson extrapolation: observed orders of 1.5 to 3
    ParameterKind.CELL: 0.005,  # gain of the load cell
    ParameterKind.COLD_JUNCTION: COLD_JUNCTION_SD_K,  # K: of thermocouples whose zero is not known
    ParameterKind.MODEL_DISCREPANCY: TYPICAL_DISCREPANCY,  # of the temperature rise; evidence chooses 1e-3 or 3e-3
    ParameterKind.SCALE: 0.01,  # pixel scale of a view
    ParameterKind.TURN: np.pi / 180.0,  # rad: turn of an image, 1 degree
    ParameterKind.CLOCK: 0.02,  # s: clock of a camera against the schedule, half a frame of 25 Hz
    ParameterKind.SIZE: 0.01,  # length and width of the block
}
UNSTATED_OPTICS_SD = 0.4  # relative, of the width of the optics if a recording does not state it
PRESSURE_MODE_SD = 0.01  # of the first pressure mode; the n-th has an n-th of it
GAIN_MAP_HALF_WAVES = ((1, 0), (2, 0), (0, 1), (1, 1), (0, 2))
PIVOT_SD_FRACTION = 3.0**-0.5  # of half an image: standard deviation of the point about which it is rotated
# of a usual scale: from where the point about which it is off is not the one that was marked
USUAL_SCALE_FRACTION = 0.5
# widened with pressure shapes, up to MAX_SCALED_FACTOR
SCALED_KINDS = (ParameterKind.SCATTER, ParameterKind.MAP, ParameterKind.WALL)
MAX_SCALED_FACTOR = 3.0
HEAT_MODE_SD = 0.05  # of the local heat: standard deviation of modes of additional heat
RIGID_KINDS = frozenset(  # kinds that a model without flexible terms calibrates too
    {
        ParameterKind.KEY,
        *SHIFT_KINDS,
        *PLACEMENT_KINDS,
        ParameterKind.GAIN,
        ParameterKind.SPREAD,
        ParameterKind.LEVEL,
        ParameterKind.CELL,
        ParameterKind.MESH,
        ParameterKind.SIZE,
        *POINT_KINDS,
        *CAMERA_ERROR_KINDS,
    }
)
WALL_COOLING_DEPTHS_M = (1e-3, 4e-3)  # m: depths over which the wall's own cooling fades up the block


def all_derivatives(problem: Problem) -> DerivativeRequest:
    """The derivatives by all parameters that calibration may change."""
    return DerivativeRequest(problem.free_keys, True, PRESSURE_MODE_COUNT, True, optics=True, block_sizes=True)


def nuisance_priors(problem: Problem, names: Iterable[ParameterId], model: ModelPoint) -> Priors:
    """(mean, standard deviation) of everything that calibration may change, relative to a point."""
    out: Priors = {}
    free = problem.key_priors
    recordings = {v.file: v.recording for v in problem.campaign.views}
    points = sensor_priors(problem.campaign.views)
    # priors are about the usual values; relative to a point the mean is minus what the point contains already
    for p in names:
        if p in free:
            out[p] = (-model.free[p.name], free[p])
        elif p.kind in SHIFT_KINDS:
            sd = position_sd_px(recordings[p.file], model.image_placement(p.file), p.shift_axis)
            out[p] = (-model.image_shift(p.file)[p.shift_axis], sd)
        elif p.kind in POINT_KINDS:
            out[p] = (-model.bead_offsets.get(p, 0.0), points[p])
        elif p.kind in CAMERA_ERROR_KINDS or is_camera_gain(p):
            out[p] = (0.0, _camera_error_sd(recordings[p.file], p))
        elif p.kind in SETUP_KINDS:
            out[p] = (-model.setup_value(p), NUISANCE_SD[p.kind])
        elif p.kind in (ParameterKind.MODE, ParameterKind.TREND):
            out[p] = (0.0, PRESSURE_MODE_SD / p.index[0])
        elif p.kind is ParameterKind.MESH:
            out[p] = (1.0, NUISANCE_SD[p.kind])  # what the extrapolation says
        elif p.kind in NUISANCE_SD:
            unsure = p.kind is ParameterKind.SPREAD and "psf_sigma_px" in problem.assumed_camera_facts.get(p.file, ())
            out[p] = (0.0, UNSTATED_OPTICS_SD if unsure else NUISANCE_SD[p.kind])
    return out


def _camera_error_sd(recording: Recording, p: ParameterId) -> float:
    """Prior width of a camera error; most columns already have the usual size of the error."""
    return CAMERA_CLASSES[recording.camera].gain_map if is_camera_gain(p) else 1.0


def position_sd_px(recording: Recording, place: ImagePlacement, axis: int) -> float:
    """Standard deviation (px along u, 0, or v, 1) of the position of an image with a `place`.

    The point about which a camera was rotated is unknown: any point of the image is equally likely.  The same holds for
    a scale error beyond the usual size.  Both are added to the uncertainty of the origin.  A wake is aligned with the
    edge where it begins and has neither.
    """
    if recording.view != "sidewall":
        return recording.registration_sigma_px or 0.0
    wrong = (
        max(abs(place.scale) - USUAL_SCALE_FRACTION * NUISANCE_SD[ParameterKind.SCALE], 0.0),
        PIVOT_SD_FRACTION * abs(place.turn),
    )
    reach = [0.5 * float(centres[-1] - centres[0]) for centres in (recording.u, recording.v)]
    moved = np.hypot(wrong[0] * reach[axis], wrong[1] * reach[1 - axis])
    return float(np.hypot(recording.registration_sigma_px or 0.0, moved / recording.pitch[axis]))


def prior_scale_factors(scale: float) -> dict[ParameterKind, float]:
    """Factors on the prior widths of pressure shapes and friction scatter at a `scale`."""
    return {
        ParameterKind.MODE: scale,
        ParameterKind.TREND: scale,
        **dict.fromkeys(SCALED_KINDS, min(scale, MAX_SCALED_FACTOR)),
    }


def is_camera_gain(p: ParameterId) -> bool:
    """Whether a parameter belongs to the gain map of a real camera, not to the slight one of every camera."""
    return p.kind is ParameterKind.MAP and len(p.index) > 2


def width_factors(scale: float, families: Mapping[ParameterKind, float]) -> dict[tuple[ParameterKind, bool], float]:
    """Factors on prior widths, by kind and `is_camera_gain`: `scale` for pressure shapes and friction scatter, and the
    sizes of the `families` of camera errors; 0 for errors that a camera does not have."""
    out = {(kind, False): times for kind, times in (dict(families) | prior_scale_factors(scale)).items()}
    return out | {(ParameterKind.MAP, True): families[ParameterKind.MAP]}


def scale_priors(
    priors: Priors, scale: float, discrepancy_sd: float, families: Mapping[ParameterKind, float] = NO_CAMERA_ERRORS
) -> Priors:
    """Priors at given hyperparameters; families of size 0 are left out.

    `scale`: of pressure shapes and friction scatter.  `discrepancy_sd`: of the model discrepancy.  `families`: sizes of
    camera errors.
    """
    out, times = {}, width_factors(scale, families)
    for p, (mean, sd) in priors.items():
        wide = (
            discrepancy_sd
            if p.kind is ParameterKind.MODEL_DISCREPANCY
            else sd * times.get((p.kind, is_camera_gain(p)), 1.0)
        )
        if wide > 0.0:
            out[p] = (mean, wide)
    return out


def usual_width_ratio(p: ParameterId, families: Mapping[ParameterKind, float]) -> float:
    """Usual width of an error over that of its prior, at least 1.

    Evidence may find that most errors of a family are small.  One that has its usual size is not unusual for that.

    >>> usual_width_ratio(ParameterId(ParameterKind.STATIC, (1, 0)), {ParameterKind.STATIC: 0.5})
    2.0
    """
    size = families.get(p.kind, 1.0) if p.kind in CAMERA_ERROR_KINDS or is_camera_gain(p) else 1.0
    return 1.0 / size if 0.0 < size < 1.0 else 1.0


def rigid_priors(priors: Priors) -> Priors:
    """Priors without free pressure shapes, wall terms and friction of repetitions; gain maps only for a camera that
    clearly has one."""
    kinds = RIGID_KINDS | ({ParameterKind.MAP} if any(map(is_camera_gain, priors)) else set())
    return {p: v for p, v in priors.items() if p.kind in kinds}


def unnamed_heat_priors(names: Iterable[ParameterId]) -> Priors:
    """Priors of heat of any shape along the block, by condition, constant or growing over repetitions."""
    return {
        p: (0.0, HEAT_MODE_SD / p.index[0] ** 0.5) for p in names if p.kind in (ParameterKind.FLUX, ParameterKind.TREND)
    }


def camera_smooth_basis(view: RecordingEntry, predicted: Observable) -> dict[ParameterId, Single]:
    """Smooth maps that no simulation contains: a slight gain along a view, and the cooling of the wall itself."""
    r = view.recording
    if r.places is not None:  # points are no image
        return {}
    rise = predicted.values - (r.reflected_degC or float(np.nanmin(predicted.values)))
    out = {}
    x, y = _scale_to_unit(r.u), _scale_to_unit(r.v)
    for m, n in GAIN_MAP_HALF_WAVES:
        if n and len(r.v) == 1:
            continue
        out[ParameterId(ParameterKind.MAP, (m, n))] = rise * np.cos(n * np.pi * y)[:, None] * np.cos(m * np.pi * x)
    if r.view == "sidewall":
        for k, depth in enumerate(WALL_COOLING_DEPTHS_M):
            out[ParameterId(ParameterKind.WALL, (k,))] = rise * np.exp(-np.maximum(r.v, 0.0) / depth)[:, None]
    return {k: flatten_valid_pixels(values, predicted.inside) for k, values in out.items()}


def _scale_to_unit(centres: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Centres of pixels from 0 to 1."""
    return (centres - centres[0]) / max(centres[-1] - centres[0], 1e-12) if len(centres) > 1 else np.zeros(1)
