"""Sizes of the errors of real cameras by their class, as standard deviations.

Uncooled microbolometers are specified to 2 K or 2 %, drift by tenths of a kelvin between two flat-field corrections and
warm their own lens and housing; cooled photon detectors are specified to 1 K or 1 % and are far more stable (Minkina &
Dudzik, Infrared Thermography: Errors and Uncertainties, 2009; Vollmer & Moellmann, Infrared Thermal Imaging, 2nd ed.
2018, ch. 2; ISO 18434-1).
"""

from __future__ import annotations

from dataclasses import dataclass

UNCOOLED, COOLED = "uncooled", "cooled"


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
