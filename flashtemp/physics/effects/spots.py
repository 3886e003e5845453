"""Macroasperity spots cover a fraction of the nominal area: phi = phi_ref (p/p_ref)^n; theory.md, eq. (26).

>>> from types import SimpleNamespace as N
>>> [law] = Spots().heat(None, None)
>>> p = N(spot_fraction=0.2, spot_exponent=1.0, reference_pressure=1.5e5)
>>> float(law.law(None, N(local_pressure=3e5), p))
0.4
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Param, Term


class Spots(Effect):
    """Contact fraction of the macroasperity regions at the local nominal pressure."""

    cause = "contact happens in macroasperity spots that cover part of the nominal area"
    source = "Persson contact theory, phi = P(q_m); theory 7.4 option (i) n = 1, (ii) n = 0"
    tells = ("sets the concentration of heat in the road lanes",)
    section = "contact"
    base = True

    spot_fraction = Param(
        0.2, "1", "macroasperity contact fraction at the reference pressure", low=0.0, high=1.0, open_low=True
    )
    spot_exponent = Param(
        0.0, "1", "exponent n of phi with local pressure; decides the sign of run-in", low=0.0, high=1.0, off=0.0
    )
    reference_pressure = Param(1.5e5, "Pa", "nominal pressure at which spot_fraction holds", low=0.0, open_low=True)
    spot_diameter = Param(3e-3, "m", "diameter of the macroasperity contact regions", low=0.0, high=0.05, open_low=True)

    def heat(self, scene, p):
        """phi at every place along the block."""

        def law(T, now, p):
            if p.spot_exponent == 0:
                return p.spot_fraction
            ratio = now.local_pressure / p.reference_pressure
            ratio = np.where(np.real(ratio) > 0.0, ratio, 0.0)  # p^n has no derivative at p = 0
            return np.minimum(1.0, p.spot_fraction * ratio**p.spot_exponent)

        yield Term("contact.spot_fraction", law)
