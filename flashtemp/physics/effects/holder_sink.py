"""Heat loss from the back of the block into its holder.

>>> from types import SimpleNamespace as N
>>> [film] = HolderSink().heat(None, None)
>>> film.law(None, N(coefficient=50.0, temperature=None)), film.to
(50.0, 'holder')
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Heat, Param
from flashtemp.physics.quantities import KELVIN


class HolderSink(Effect):
    """Contact of the block's back with a holder at fixed temperature; 'inf' makes the back isothermal."""

    cause = "the holder carries heat away"
    source = "theory 1.3: insulated, isothermal or a coefficient"
    tells = ("cold back of the block", "matters after H^2/(pi^2 D) = 40 s")
    candidate = True

    coefficient = Param(50.0, "W/m2K", "heat-transfer coefficient to the holder, or 'inf'", low=0.0, off=0.0)
    temperature = Param(None, "degC", "temperature of the holder; ambient if not given", low=-60.0, high=300.0)

    def heat(self, scene, p):
        """Heat transfer at the back."""

        def holder_temperature(now, p):
            return now.ambient if p.temperature is None else p.temperature + KELVIN

        yield Heat.film("block.holder", lambda now, p: p.coefficient, to="holder", far=holder_temperature)
