"""Viscoelastic modulus of rubber, E(omega, T) = E(omega a_T, T_ref): Cole-Cole, Prony series or measured.

>>> rubber = READY_RUBBERS["A"]
>>> E = rubber.complex_modulus(1e4, 293.15) / 1e6
>>> print(f"{E.real:.6f} {E.imag:.6f} {rubber.shift_factor(333.15):.6f}")
22.084178 13.887775 0.010681
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from flashtemp.physics.arrays import Value

WLF_POLE_MARGIN_K, MAX_WLF_TEMPERATURE_K = 20.0, 423.15  # K above the WLF pole, and K: constant shift beyond these


@dataclass(frozen=True)
class ColeCole:
    """E = E0 + (E1 - E0) s/(1 + s), s = (i omega tau)^a: moduli in Pa, `time` tau in s at the reference temperature."""

    relaxed: float
    unrelaxed: float
    exponent: float
    time: float

    valid_range = (0.0, np.inf)

    def __call__(self, omega: Value) -> Value:
        s = (1j * np.asarray(omega, dtype=float) * self.time) ** self.exponent
        return self.relaxed + (self.unrelaxed - self.relaxed) * s / (1.0 + s)


@dataclass(frozen=True)
class PronySeries:
    """E = E0 + sum E_i i omega tau_i/(1 + i omega tau_i), moduli in Pa, times in s."""

    relaxed: float
    moduli: tuple[float, ...]
    times: tuple[float, ...]

    valid_range = (0.0, np.inf)

    def __call__(self, omega: Value) -> Value:
        iwt = 1j * np.multiply.outer(np.asarray(omega, dtype=float), self.times)
        return self.relaxed + (iwt / (1.0 + iwt)) @ np.array(self.moduli)


@dataclass(frozen=True)
class MeasuredModulus:
    """Storage and loss modulus (Pa) at increasing frequencies (rad/s): monotone cubics in logs, constant beyond."""

    omega: tuple[float, ...]
    storage: tuple[float, ...]
    loss: tuple[float, ...]

    @property
    def valid_range(self) -> tuple[float, float]:
        """Lowest and highest measured angular frequency, rad/s."""
        return self.omega[0], self.omega[-1]

    @cached_property
    def _log_curves(self) -> Any:
        x = np.log(self.omega)
        return tuple(PchipInterpolator(x, np.log(y)) for y in (self.storage, self.loss))

    def __call__(self, omega: Value) -> Value:
        x = np.log(np.clip(omega, *self.valid_range))
        storage, loss = self._log_curves
        return np.exp(storage(x)) + 1j * np.exp(loss(x))


@dataclass(frozen=True)
class WLF:
    """log10 a_T = -C1 (T - T_ref)/(C2 + T - T_ref), K; constant near its pole and above 150 degC."""

    c1: float
    c2: float
    reference: float

    @property
    def valid_range(self) -> tuple[float, float]:
        """Temperatures (K) between which the law is used."""
        return min(self.reference - self.c2 + WLF_POLE_MARGIN_K, self.reference), max(
            MAX_WLF_TEMPERATURE_K, self.reference
        )

    def __call__(self, T: Value) -> Value:
        """a_T at T in K."""
        d = np.clip(T, *self.valid_range) - self.reference
        return 10.0 ** (-self.c1 * d / (self.c2 + d))


@dataclass(frozen=True)
class MeasuredShift:
    """Measured log10 a_T at increasing temperatures (K); monotone cubics, constant beyond."""

    T: tuple[float, ...]
    decades: tuple[float, ...]

    @property
    def valid_range(self) -> tuple[float, float]:
        """Lowest and highest temperature (K) of the table."""
        return self.T[0], self.T[-1]

    @cached_property
    def _shift_curve(self) -> Any:
        return PchipInterpolator(self.T, self.decades)

    def __call__(self, T: Value) -> Value:
        """a_T at T in K."""
        return 10.0 ** self._shift_curve(np.clip(T, *self.valid_range))


@dataclass(frozen=True)
class Rubber:
    """A master curve `modulus` at the reference temperature of its `shift`, and Poisson's ratio."""

    modulus: ColeCole | PronySeries | MeasuredModulus
    shift: WLF | MeasuredShift
    poisson: float = 0.5
    name: str = "rubber"

    def shift_factor(self, T: Value) -> Value:
        """Shift factor a_T at T (K)."""
        return self.shift(T)

    def complex_modulus(self, omega: Value, T: Value) -> Value:
        """E (Pa, complex) at angular frequency `omega` (rad/s) and temperature `T` (K)."""
        return self.modulus(np.asarray(omega) * self.shift_factor(T))

    __call__ = complex_modulus


def fit_prony_series(curve: ColeCole, per_decade: int = 2, decades: float = 12.0) -> PronySeries:
    """A Prony series for a Cole-Cole curve of exponent 1/2: E_i = (E1 - E0) dln tau/pi/(x^1/2 + x^-1/2).

    A reference for tests of `PronySeries` against a closed form; the model does not use it.
    """
    if curve.exponent != 0.5:
        raise ValueError("the relaxation spectrum is known in closed form for an exponent of 1/2")
    count = round(per_decade * 2 * decades) + 1
    ratio = np.logspace(-decades, decades, count)
    step = np.log(10.0) / per_decade
    moduli = (curve.unrelaxed - curve.relaxed) * step / np.pi / (np.sqrt(ratio) + 1.0 / np.sqrt(ratio))
    return PronySeries(curve.relaxed, tuple(moduli.tolist()), tuple((curve.time * ratio).tolist()))


READY_RUBBERS = {
    "A": Rubber(ColeCole(8e6, 2e9, 0.5, 1e-8), WLF(7.718, 116.6, 293.15), name="A"),
}
