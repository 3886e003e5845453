"""Shift of the image by a fraction of a pixel against the origin stated in the recording.

>>> from types import SimpleNamespace as N
>>> along, up = Registration().see(None)
>>> along.law(None, None, N(du=0.2, dv=0.0))
0.2
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class Registration(Effect):
    """Shift of the whole image relative to block and road."""

    cause = "the image is shifted"
    source = "marked points good to 0.3 px leave 0.15-0.35 px"
    tells = ("residual follows the gradient of the image", "fixed in pixels")
    candidate = True

    du = Param(0.2, "px", "what is seen at u lies at u + du", low=-20.0, high=20.0, off=0.0)
    dv = Param(0.0, "px", "what is seen at v lies at v + dv", low=-20.0, high=20.0, off=0.0)

    def see(self, p):
        """Pixels by which the image is shifted."""
        yield Term("camera.shift_u", lambda T, now, p: p.du)
        yield Term("camera.shift_v", lambda T, now, p: p.dv)
