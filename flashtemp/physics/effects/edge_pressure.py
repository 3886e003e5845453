"""Pressure peak at the leading edge, where the sheared block folds under: B [exp(-d/l) - mean], d m behind the edge.

>>> from types import SimpleNamespace as N
>>> [law] = EdgePressure().heat(N(length=0.025), None)
>>> round(float(law.law(None, N(lead=0.0), N(B=4.0, length=2.5e-3))), 6)
3.600018
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Param, Term


class EdgePressure(Effect):
    """Peak of nominal contact pressure at the leading edge that decays over a length."""

    cause = "the nominal contact pressure peaks at the leading edge"
    source = "edge effect of a sheared block, theory 7.1: B = 2.5-6, l = 0.1 L"
    tells = ("hot spot near the leading edge",)
    candidate = True
    steady = True

    B = Param(4.0, "1", "height of the peak over the mean pressure", low=-1.0, high=30.0, off=0.0)
    length = Param(2.5e-3, "m", "decay length of the peak", low=0.0, high=0.1, open_low=True, spread=2.0)

    def heat(self, scene, p):
        """Adds to the ratio of local to mean pressure; the mean over the block is zero."""

        def law(T, now, p):
            mean = p.length / scene.length * -np.expm1(-scene.length / p.length)
            return p.B * (np.exp(-now.lead / p.length) - mean)

        yield Term("contact.pressure", law)
