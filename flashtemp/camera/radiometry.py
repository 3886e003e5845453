"""Radiometry: counts of an infrared camera for an object behind air and a window, and the inverse."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics.quantities import KELVIN

PARAMETER_RANGES = {  # attribute: lowest, highest value, unit
    "emissivity": (0.01, 1.0, ""),
    "reflected": (-273.0, 3000.0, "degC"),
    "air": (-100.0, 500.0, "degC"),
    "humidity": (0.0, 1.0, "(50 % = 0.5)"),
    "distance": (0.0, 10000.0, "m"),
    "window": (0.01, 1.0, ""),
    "window_temperature": (-273.0, 3000.0, "degC"),
}
USUAL_DISTANCE_M = 100.0  # m, up to which constants of the air must give a valid transmission
PATH_STEPS = 8  # points of the path, uniform in its square root, at which the transmission is checked
TRANSMISSION_ROUNDING = 1e-6  # tolerance above 1: constants are stored in single precision


@dataclass(frozen=True)
class PlanckCalibration:
    """A camera's calibration: counts S(T) = R1/(R2 (exp(B/T) - F)) - O, T in K; O with the sign that FLIR stores.

    Works on numbers and arrays of any shape, real or complex (complex steps pass through).

    >>> camera = PlanckCalibration(14906.2, 0.0108, 1396.6, 1.0, -7261.0)
    >>> round(float(camera.temperature(camera.counts(80.0))), 9)
    80.0
    """

    R1: float
    R2: float
    B: float
    F: float = 1.0
    O: float = 0.0  # noqa: E741 (the maker's letter)

    def __post_init__(self):
        values = np.array([self.R1, self.R2, self.B, self.F, self.O])
        if not (np.all(np.isfinite(values)) and np.all(values[:4] > 0)):
            raise BadInput(
                f"planck: {values.tolist()} are no calibration; give R1, R2, B and F greater than zero, and O"
            )

    def counts(self, T):
        """Counts of a black body at T degC."""
        return self.R1 / (self.R2 * (np.exp(self.B / (T + KELVIN)) - self.F)) - self.O

    def temperature(self, counts):
        """Temperature, degC, of a black body with these counts; NaN for counts below those of any temperature."""
        light = counts + self.O
        real = np.real(light) > 0
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            T = self.B / np.log(self.R1 / (self.R2 * np.where(real, light, 1.0)) + self.F) - KELVIN
        return np.where(real, T, np.nan)

    def temperature_per_count(self, counts):
        """dT/dS (K per count) at these counts."""
        T, light = self.temperature(counts) + KELVIN, counts + self.O
        with np.errstate(divide="ignore", invalid="ignore"):
            return T**2 / (self.B * light * (1.0 + self.F * self.R2 * light / self.R1))


LONG_WAVE = PlanckCalibration(1.0, 1.0, 1428.0)  # a generic 8-14 um band, for files that hold temperatures only


@dataclass(frozen=True)
class ObjectParameters:
    """Emissivity of the object, its reflected surroundings, the air and a window between object and camera.

    Temperatures in degC, `humidity` relative, 0 to 1, `distance` in m, `window` a transmission; at distance 0 the air
    has no effect.  alpha, beta and X are the maker's constants of the air's transmission.  BadInput names a value
    outside its range.
    """

    emissivity: float = 1.0
    reflected: float = 20.0
    air: float = 20.0
    humidity: float = 0.5
    distance: float = 0.0
    window: float = 1.0
    window_temperature: float = 20.0
    alpha1: float = 0.006569
    alpha2: float = 0.01262
    beta1: float = -0.002276
    beta2: float = -0.00667
    X: float = 1.9

    def __post_init__(self):
        for name, (low, high, unit) in PARAMETER_RANGES.items():
            if not low <= getattr(self, name) <= high:
                raise BadInput(f"{name}: {getattr(self, name):g}; give {low:g} to {high:g} {unit}".rstrip())
        _check_air(self)

    @property
    def transmission(self) -> float:
        """Fraction of radiation that the air transmits over one path of length `distance` (not two halves of it).

        With t the air's degC, water w^2 = humidity exp(1.5587 + 0.06939 t - 2.7816e-4 t2 + 6.8455e-7 t3):
        tau = X exp(-sqrt(d) (a1 + b1 w)) + (1 - X) exp(-sqrt(d) (a2 + b2 w)), as FLIR's manuals say; 1 at distance 0.
        """
        return float(self.path_transmission(np.array([self.distance]))[0])

    def path_transmission(self, distances: np.ndarray) -> np.ndarray:
        """Transmission of the air over paths (n,) in m; 1 at length 0 for any constants."""
        t, path = self.air, np.sqrt(distances)
        water = np.sqrt(self.humidity * np.exp(1.5587 + t * (6.939e-2 + t * (-2.7816e-4 + t * 6.8455e-7))))
        with np.errstate(over="ignore", invalid="ignore"):
            first = np.exp(-path * (self.alpha1 + self.beta1 * water))
            second = np.exp(-path * (self.alpha2 + self.beta2 * water))
            return np.where(path > 0, self.X * first + (1 - self.X) * second, 1.0)

    def with_values(self, given: dict[str, float]) -> ObjectParameters:
        """Copy with some values replaced."""
        return replace(self, **given)

    def __str__(self) -> str:
        text = (
            f"emissivity {self.emissivity:g}, reflected {self.reflected:g} degC, air {self.air:g} degC,"
            f" humidity {100 * self.humidity:g} %, distance {self.distance:g} m"
        )
        if self.window < 1:
            text += f", window {self.window:g} at {self.window_temperature:g} degC"
        return text


def _check_air(p: ObjectParameters) -> None:
    """BadInput where the air's transmission leaves (0, 1] on the way to the object or within usual distances.

    Cameras write constants of very different sizes, so only the resulting transmission can be checked.
    """
    if p.distance == 0:
        return
    distances = max(p.distance, USUAL_DISTANCE_M) * np.linspace(0.0, 1.0, PATH_STEPS + 1) ** 2
    tau = p.path_transmission(np.append(p.distance, distances))
    bad = ~((tau > 0) & (tau <= 1 + TRANSMISSION_ROUNDING))
    if bad.any():
        at = int(np.argmax(bad))
        over = np.append(p.distance, distances)[at]
        raise BadInput(
            f"air: its constants in the calibration (alpha {p.alpha1:g} and {p.alpha2:g}, beta {p.beta1:g} and"
            f" {p.beta2:g}, X {p.X:g}) give a transmission of {tau[at]:.3g} over {over:.3g} m at"
            f" {p.air:g} degC, it must be above 0 and at most 1; give --distance 0 to leave the air out, or copy the"
            " file again"
        )


PARAMETER_NAMES = tuple(PARAMETER_RANGES)  # parameters that a user may change
AIR_CONSTANTS = tuple(f.name for f in fields(ObjectParameters) if f.name not in PARAMETER_RANGES)


def _gain_and_background(planck: PlanckCalibration, p: ObjectParameters) -> tuple[float, float]:
    """Gain of the object's counts and the counts of everything else: S = gain S(T) + background."""
    tau = p.transmission
    before = (1 - p.emissivity) * tau * planck.counts(p.reflected) + (1 - tau) * planck.counts(p.air)
    return p.window * p.emissivity * tau, p.window * before + (1 - p.window) * planck.counts(p.window_temperature)


def apparent_counts(T, planck: PlanckCalibration, p: ObjectParameters):
    """Counts of the camera for an object at T degC (any shape, real or complex).

    S = w (eps tau S(T) + (1 - eps) tau S(reflected) + (1 - tau) S(air)) + (1 - w) S(window).
    """
    gain, added = _gain_and_background(planck, p)
    return gain * planck.counts(T) + added


def object_temperature(counts, planck: PlanckCalibration, p: ObjectParameters):
    """Temperature of the object, degC, from the counts of the camera; NaN for too few counts."""
    gain, added = _gain_and_background(planck, p)
    return planck.temperature((counts - added) / gain)


def recompute_temperature(T, old: ObjectParameters, new: ObjectParameters, band: PlanckCalibration = LONG_WAVE):
    """Temperatures (degC) that were computed with `old` parameters, converted to `new` ones."""
    return T if old == new else object_temperature(apparent_counts(T, band, old), band, new)
