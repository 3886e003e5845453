"""The air of the laboratory warms up during the test: T_air = T_0 + rate t.

>>> from types import SimpleNamespace as N
>>> [law] = AmbientDrift().heat(None, None)
>>> law.law(None, N(t=100.0), N(rate=0.01))
1.0
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class AmbientDrift(Effect):
    """Air and entering road drift with time."""

    cause = "the ambient temperature drifts"
    source = "thermometer of the laboratory"
    tells = ("slow common shift of everything", "also while waiting")
    candidate = True

    rate = Param(0.005, "K/s", "drift of the ambient temperature", low=-0.2, high=0.2, off=0.0)

    def heat(self, scene, p):
        """Adds to the ambient temperature."""
        yield Term("ambient.temperature", lambda T, now, p: p.rate * now.t)
