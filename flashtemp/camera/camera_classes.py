"""Sizes of the errors of real cameras by their class, as standard deviations.

Uncooled microbolometers are specified to 2 K or 2 %, drift by tenths of a kelvin between two flat-field corrections and
warm their own lens and housing; cooled photon detectors are specified to 1 K or 1 % and are far more stable (Minkina &
Dudzik, Infrared Thermography: Errors and Uncertainties, 2009; Vollmer & Moellmann, Infrared Thermal Imaging, 2nd ed.
2018, ch. 2; ISO 18434-1).
"""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches

UNCOOLED, COOLED = "uncooled", "cooled"
DETECTOR_CLASSES = {"bolometer": UNCOOLED, "insb": COOLED, "mct": COOLED, "qwip": COOLED}  # by a part of its name
MIN_SPELLING_RATIO = 0.75  # of a misspelling; "microbolometer" is no misspelling of "cooled"


@dataclass(frozen=True)
class CameraErrors:
    """Standard deviations of what a camera does.

    `level_K` of the offset after each flat-field correction, `drift_K_per_sqrt_s` of its Wiener process between them,
    `warm_up_K` of a steady drift over a whole recording (tenths of a kelvin while an uncooled camera warms up), `map_K`
    of a smooth static offset over the image, `gain_map` of a smooth static gain, `smear_s` of a pixel's response time,
    `halo` of the fraction of light that goes astray over a tenth of the image.
    """

    level_K: float
    drift_K_per_sqrt_s: float
    warm_up_K: float
    map_K: float
    gain_map: float
    smear_s: float
    halo: float


CAMERA_CLASSES = {
    UNCOOLED: CameraErrors(0.5, 0.02, 0.3, 0.15, 0.003, 0.01, 0.01),
    COOLED: CameraErrors(0.1, 0.003, 0.02, 0.05, 0.0015, 0.0005, 0.005),
}


def suggest_camera_class(name: str) -> str:
    """The end of an error message for an unknown class of camera: the class of a detector, or the right spelling.

    >>> suggest_camera_class("microbolometer"), suggest_camera_class("coled"), suggest_camera_class("warm")
    ("; did you mean 'uncooled'?", "; did you mean 'cooled'?", '')
    """
    by_detector = [known for detector, known in DETECTOR_CLASSES.items() if detector in name.lower()]
    match = by_detector or get_close_matches(name.lower(), CAMERA_CLASSES, n=1, cutoff=MIN_SPELLING_RATIO)
    return f"; did you mean '{match[0]}'?" if match else ""
