"""Physical effects on a sliding rubber block: the names that an effect file imports.

>>> from flashtemp.physics import Effect, Factor, Param
"""

from __future__ import annotations

from flashtemp.physics.effect import Deposit, Effect, Factor, Heat, Param, Term, catalogue
from flashtemp.physics.interpolation import Curve, Surface
from flashtemp.physics.quantities import KELVIN

__all__ = ["KELVIN", "Curve", "Deposit", "Effect", "Factor", "Heat", "Param", "Surface", "Term", "catalogue"]
