"""Values of a [[recording]] or a [[force]]: stated noise, and class of the camera."""

from __future__ import annotations

from typing import Any

from flashtemp.camera.camera_classes import CAMERA_CLASSES, UNCOOLED, suggest_camera_class
from flashtemp.camera.quantisation import add_dither, quantisation_step, remove_dither
from flashtemp.camera.recording import Recording
from flashtemp.comparison.noise import estimate_white_noise
from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics import units

NOISE_KEYS = {"recording": ("sigma_K", "K"), "force": ("sigma", "1")}  # key and unit
NOISE_EXAMPLES = {"recording": '"50 mK"', "force": "0.01"}
MAX_STATED_NOISE = 1e3  # in the unit of the key
TABLE_SUFFIXES = (".csv", ".tsv", ".txt", ".dat")  # of files that hold columns of numbers, not frames
MAX_NOISE_RATIO = 30.0  # of stated to seen noise: far from chance and model errors, and from the 1000 of a wrong prefix
MAX_CREDIBLE_NOISE_K = 5.0  # also of the worst sensors; below, frames may be computed ones, with next to no noise
MAX_NOISE_FRAMES = 100  # from which the noise is estimated


def read_stated_noise(entry: dict[str, Any], kind: str) -> float | None:
    """The noise that an entry states: `sigma_K` (K) of a recording, `sigma` (1) of a force; None where it does not.

    A text is a number with its unit, "50 mK".  Raises BadInput, which begins with the key.
    """
    key, unit = NOISE_KEYS[kind]
    value = stated = entry.get(key)
    if isinstance(stated, str) and units.looks_like_quantity(stated):
        try:
            value = units.to_unit(stated, unit)
        except BadInput as fault:
            raise BadInput(f"{key}: {fault}") from fault
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < MAX_STATED_NOISE:
        raise BadInput(
            f"{key}: {shorten_text(repr(stated))}; give a number > 0{' in K' if unit == 'K' else ''}, such as "
            f"{NOISE_EXAMPLES[kind]}, or leave it out to have it estimated"
        )
    return float(value)


def find_noise_fault(recorded: Recording, sigma_K: float | None) -> str | None:
    """The fault of a stated noise `sigma_K` (K) that is far above what the frames of a recording show, or None.

    Changes of the scene between frames count as noise of the frames, so that only a stated noise that cannot be meant
    is a fault.
    """
    if sigma_K is None or sigma_K <= MAX_CREDIBLE_NOISE_K:
        return None
    frames = recorded.temperature[:MAX_NOISE_FRAMES]
    step = quantisation_step(frames)
    seen = remove_dither(estimate_white_noise(add_dither(frames, step)), step)
    if not 0.0 < MAX_NOISE_RATIO * seen < sigma_K:
        return None
    return (
        f'sigma_K: {sigma_K:g} K, but the frames show a noise of {seen:.2g} K; write "{sigma_K:g} mK" if mK is meant, '
        "or leave it out to have it estimated"
    )


def find_camera_fault(entry: dict[str, Any]) -> str | None:
    """The fault of the class of camera that an entry states, or None."""
    camera = entry.get("camera", UNCOOLED)
    if isinstance(camera, str) and camera in CAMERA_CLASSES:
        return None
    known = " or ".join(f'"{name}"' for name in CAMERA_CLASSES)
    return f"camera: {shorten_text(repr(camera))}; give {known}{suggest_camera_class(str(camera))}"


def describe_table_as_recording(file: str) -> str | None:
    """The fault of a [[recording]] without points whose file is a table, or None where it is none."""
    if not file.lower().endswith(TABLE_SUFFIXES):
        return None
    return (
        f"file: {shorten_text(repr(file))} is a table, not a recording; list friction over time as [[force]], give "
        "points for thermocouples, or import the frames of a camera with flashtemp import"
    )
