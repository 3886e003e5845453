"""Stick-slip of the macroasperities: friction oscillates with the slid distance.

>>> from types import SimpleNamespace as N
>>> [law] = StickSlip().heat(None, None)
>>> round(float(law.law(None, N(slid=0.25), N(amplitude=0.2, wavelength=1.0))), 6)
1.2
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Factor, Param


class StickSlip(Effect):
    """Harmonic modulation of the friction coefficient with the slid distance."""

    cause = "friction oscillates along the track"
    source = "stick-slip of coupled macroasperities, EPL 113 56002 (abstract)"
    tells = ("ripples in friction and temperature at one spatial period",)
    candidate = True

    amplitude = Param(0.1, "1", "relative amplitude of the oscillation", low=0.0, high=1.0, off=0.0)
    wavelength = Param(0.5, "m", "slid distance of one period", low=5e-3, high=100.0)

    def heat(self, scene, p):
        """Multiplies mu."""
        yield Factor("friction.mu", lambda T, now, p: 1.0 + p.amplitude * np.sin(2 * np.pi * now.slid / p.wavelength))
