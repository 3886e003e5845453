"""Friction acts below the holder's pivot and tips the block onto its leading edge, against the holder's stiffness.

>>> from types import SimpleNamespace as N
>>> give, arm = FrictionMoment().heat(None, None)
>>> give.law(None, None, N(compliance=0.01)), arm.law(None, None, N(arm=0.007))
(0.01, 0.007)
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class FrictionMoment(Effect):
    """The pressure tilts until its moment and the holder's rotation balance mu F h, with lift-off; eq. (24)."""

    cause = "the friction force tips the block onto its leading edge"
    source = "moment balance, theory 7.1; rotation stiffness K = 1/compliance"
    tells = ("leading edge pressed harder, the more so the higher friction", "does not vanish with wear")
    alike = "pressure_tilt"
    candidate = True

    compliance = Param(
        0.01, "rad/(N m)", "rotation of the holder per moment; 0: fixed, 'inf': free",
        low=0.0, off=0.0,
    )  # fmt: skip
    arm = Param(7e-3, "m", "height of the holder's pivot above the contact", low=0.0, high=1.0)

    def heat(self, scene, p):
        """Compliance of the holder and arm of the friction force."""
        yield Term("holder.compliance", lambda T, now, p: p.compliance)
        yield Term("holder.arm", lambda T, now, p: p.arm)
