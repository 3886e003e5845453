"""Zero offset of the camera, which drifts between its corrections: T_shown = T + offset + drift (r - 1).

>>> from types import SimpleNamespace as N
>>> [law] = CameraOffset().see(None)
>>> law.law(None, N(repetition=3), N(offset=1.0, drift=0.1))
1.2
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class CameraOffset(Effect):
    """The same offset for all pixels, growing by a constant amount with every repetition r."""

    cause = "the camera's zero is off or drifts"
    source = "data sheets: 2 K or 2 %, and 1-2 K between two corrections of its non-uniformity"
    tells = ("all pixels alike, also those that stay at ambient temperature", "also before the first start")
    candidate = True

    offset = Param(
        1.0, "K", "temperature shown minus true temperature, in the first repetition", low=-20, high=20, off=0.0
    )
    drift = Param(0.1, "K", "growth of the offset from repetition to repetition", low=-5.0, high=5.0, off=0.0)

    def see(self, p):
        """Adds to the temperature that the camera shows."""
        yield Term("camera.offset", lambda T, now, p: p.offset + p.drift * (now.repetition - 1))
