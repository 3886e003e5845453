"""Power spectrum C(q) of a rough road: <h^2> = 2 pi int q C dq, isotropic, q in 1/m, C in m^4.

>>> road = READY_ROADS["asphalt A"]
>>> print(f"{road.law.level:.10e} {road.q1:.7e} {road.rms_slope():.6f}")
1.3984054661e-14 2.5401710e+06 1.300000
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq

from flashtemp.errors import BadInput
from flashtemp.physics.arrays import Value

CUTOFF_RMS_SLOPE = 1.3  # rms slope at which spectra end: Persson's usual cut-off


@dataclass(frozen=True)
class SelfAffineLaw:
    """C = `level` (m^4) below the roll-off wavenumber `rolloff` (1/m), falling as q^(-2-2 hurst) above."""

    level: float
    rolloff: float
    hurst: float

    def __call__(self, q: Value) -> Value:
        return self.level * np.maximum(np.asarray(q) / self.rolloff, 1.0) ** (-2.0 - 2.0 * self.hurst)

    @property
    def bend_wavenumbers(self) -> tuple[float, ...]:
        """Wavenumbers (1/m) at which the slope of the law changes."""
        return (self.rolloff,)

    @property
    def valid_range(self) -> tuple[float, float]:
        return 0.0, np.inf


@dataclass(frozen=True)
class MeasuredSpectrum:
    """Measured C (m^4) at increasing wavenumbers q (1/m): power laws between, and that of the last decade beyond."""

    q: tuple[float, ...]
    C: tuple[float, ...]

    @property
    def bend_wavenumbers(self) -> tuple[float, ...]:
        return self.q

    @property
    def valid_range(self) -> tuple[float, float]:
        """Lowest and highest measured wavenumber, 1/m."""
        return self.q[0], self.q[-1]

    @cached_property
    def _log_curve(self) -> Any:
        x, y = np.log(self.q), np.log(self.C)
        upper = x > x[-1] - np.log(10.0)  # the last decade determines the power law beyond
        slope = np.polyfit(x[upper], y[upper], 1)[0] if upper.sum() > 2 else (y[-1] - y[-2]) / (x[-1] - x[-2])
        return x, y, float(np.clip(slope, -4.0, -2.0))

    def __call__(self, q: Value) -> Value:
        x, y, slope = self._log_curve
        at = np.log(q)
        return np.exp(np.interp(at, x, y) + slope * np.maximum(at - x[-1], 0.0))


@dataclass(frozen=True)
class RoughnessSpectrum:
    """A law C(q) between the wavenumbers q0 and q1 (1/m)."""

    law: SelfAffineLaw | MeasuredSpectrum
    q0: float
    q1: float
    name: str = "road"

    def __call__(self, q: Value) -> Value:
        """C in m^4."""
        return self.law(q)

    def panel_edges(self, per_decade: float = 4.0) -> np.ndarray:
        """Wavenumbers that divide q0..q1 into panels on which C is smooth."""
        inner = [b for b in self.law.bend_wavenumbers if self.q0 < b < self.q1]
        if len(inner) > 40:  # a measured table is finer than the panels need to be
            inner = []
        marks = [self.q0, *inner, self.q1]
        parts = [
            np.geomspace(a, b, max(1, round(per_decade * np.log10(b / a))) + 1)[:-1]
            for a, b in zip(marks[:-1], marks[1:], strict=True)
        ]
        return np.append(np.concatenate(parts), self.q1)

    def _spectral_moment(self, power: int, upto: float) -> float:
        """2 pi int q^power C dq from q0 to `upto`."""
        if upto <= self.q0:
            return 0.0
        edges = replace(self, q1=upto).panel_edges(40.0)
        nodes, weights = np.polynomial.legendre.leggauss(6)
        mid, half = 0.5 * np.log(edges[1:] * edges[:-1]), 0.5 * np.diff(np.log(edges))
        q = np.exp(mid + np.multiply.outer(nodes, half))
        return float(2 * np.pi * np.sum(weights[:, None] * half * q ** (power + 1) * self.law(q)))

    def rms_slope(self, upto: float | None = None) -> float:
        """Rms slope of the roughness up to a wavenumber, q1 if none is given."""
        return float(np.sqrt(self._spectral_moment(3, upto or self.q1)))

    @property
    def rms_height(self) -> float:
        """Rms height, m."""
        return float(np.sqrt(self._spectral_moment(1, self.q1)))

    def cut_at_slope(self, slope: float) -> RoughnessSpectrum:
        """The spectrum up to the wavenumber at which its rms slope is `slope`.  Raises BadInput where it never is."""
        low, high = np.log(self.q0 * 1.01), np.log(1e11)
        least, most = self.rms_slope(np.exp(low)), self.rms_slope(np.exp(high))
        if not least < slope < most:
            why = "never reached" if slope >= most else f"less than that of its longest waves, {least:.2g}"
            raise BadInput(f"rms_slope: {slope:g} is {why} by this spectrum; give its upper wavenumber instead")
        found = brentq(lambda x: self.rms_slope(np.exp(x)) - slope, low, high, xtol=1e-12)
        return replace(self, q1=float(np.exp(found)))


def self_affine_spectrum(
    height: float, rolloff: float, hurst: float, q0: float, slope: float | None = CUTOFF_RMS_SLOPE, name: str = "road"
) -> RoughnessSpectrum:
    """Self-affine roughness of rms `height` (m, integrated to infinity), cut at an rms `slope` unless that is None.

    Raises BadInput for a Hurst exponent outside ]0, 1[ or a roll-off below q0.
    """
    if not 0 < hurst < 1 or not rolloff > q0:
        raise BadInput(f"self-affine spectrum: hurst {hurst:g}, rolloff {rolloff:g}; give 0 < hurst < 1, rolloff > q0")
    level = height**2 / (2 * np.pi * (0.5 * (rolloff**2 - q0**2) + rolloff**2 / (2 * hurst)))
    road = RoughnessSpectrum(SelfAffineLaw(level, rolloff, hurst), q0, 10 * rolloff, name)
    return road if slope is None else road.cut_at_slope(slope)


READY_ROADS = {
    "asphalt A": self_affine_spectrum(3e-4, 1000.0, 0.9, 250.0, name="asphalt A"),
    "concrete B": self_affine_spectrum(5e-5, 3000.0, 0.8, 250.0, name="concrete B"),
}
