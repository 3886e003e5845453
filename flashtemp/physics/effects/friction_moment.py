"""Friction acts below the holder and tips the block onto its leading edge; the holder gives by an angle.

>>> from types import SimpleNamespace as N
>>> give, arm = FrictionMoment().heat(None, None)
>>> give.law(None, None, N(compliance=0.01)), arm.law(None, None, N(arm=0.007))
(0.01, 0.007)
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class FrictionMoment(Effect):
    """Pressure tilts until its moment and the holder's rotation stiffness carry mu F h; lift-off included."""

    cause = "the friction force tips the block onto its leading edge"
    source = "moment balance, theory 7.1; rotation stiffness K = 1/compliance"
    tells = ("leading edge pressed harder, the more so the higher friction", "does not vanish with wear")
    alike = "pressure_tilt"
    candidate = True

    compliance = Param(
        0.01, "rad/(N m)", "turn of the holder per moment; 0 guides it, 'inf' lets it turn freely",
        low=0.0, off=0.0,
    )  # fmt: skip
    arm = Param(7e-3, "m", "height of the holder's pivot above the contact", low=0.0, high=1.0)

    def heat(self, scene, p):
        """What the holder does with the friction moment."""
        yield Term("holder.compliance", lambda T, now, p: p.compliance)
        yield Term("holder.arm", lambda T, now, p: p.arm)
