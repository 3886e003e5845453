"""Frictional shear stress of the real contact area, from thermally activated bonds (theory.md, eq. (18)).

>>> shear = AdhesiveShear(4e6)
>>> print(f"{float(shear(0.1, 293.15)) / 1e6:.6f} {float(shear(0.1, 333.15)) / 1e6:.6f}")
3.445272 3.726043
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.physics.arrays import Value

BOLTZMANN_EV_K = 8.617333262e-5  # eV/K


@dataclass(frozen=True)
class AdhesiveShear:
    """tau_f = `stress` exp(-c [log10(v a/v0)]^2), ln a = (eps/k)(1/T - 1/T_ref); theory.md, section 2.3.

    `stress` Pa, `width` c, `speed` v0 in m/s at `reference` K, `activation` eps in eV.
    """

    stress: float
    width: float = 0.1
    speed: float = 6e-3
    activation: float = 1.0
    reference: float = 293.15

    def shift_factor(self, T: Value) -> Value:
        """Shift factor at T (K)."""
        return np.exp(self.activation / BOLTZMANN_EV_K * (1.0 / T - 1.0 / self.reference))

    def __call__(self, v: Value, T: Value) -> Value:
        """tau_f (Pa) at sliding speed v (m/s) and contact temperature T (K)."""
        return self.stress * np.exp(-self.width * np.log10(v * self.shift_factor(T) / self.speed) ** 2)
