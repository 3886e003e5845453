"""Hysteresis heat through the whole height of the vibrating rubber: q''' = loss p v/H.

>>> from types import SimpleNamespace as N
>>> [law] = InternalHeat().heat(N(height=0.01), None)
>>> float(law.law(300.0, N(pressure=1e5, speed=0.1), N(loss=0.02)))
20000.0
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Heat, Param


class InternalHeat(Effect):
    """Hysteresis heat, uniform in the block, in addition to the heat mu p v of the contact; counted as friction heat.

    The drive supplies it as if `loss` were added to the friction coefficient; none of it is released at the contact.
    """

    cause = "hysteresis warms the rubber through its whole height"
    source = "standing vibration and stick-slip; a few per cent of the friction work is the order to look for"
    uniform = True
    tells = ("warm also far from the contact", "grows with load and speed alike", "nothing while waiting")
    candidate = True

    loss = Param(0.02, "1", "heat in the block per p v of the contact", low=0.0, high=1.0, off=0.0)

    def heat(self, scene, p):
        """Volumetric heat at the mean pressure."""

        def law(T, now, p):
            return p.loss * now.pressure * now.speed / scene.height + 0.0 * T

        yield Heat.zone("block", law, to="friction")
