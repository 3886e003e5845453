"""The image shows what was a moment ago: trigger, read-out or the bolometer's time constant.

>>> from types import SimpleNamespace as N
>>> [law] = TimeLag().see(None)
>>> law.law(None, None, N(lag=0.05))
0.05
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class TimeLag(Effect):
    """Frames belong to an earlier time than their stamp says."""

    cause = "the frames are stamped late"
    source = "trigger delay; time constant of a microbolometer, 8-12 ms"
    tells = ("wrong where temperature changes fast", "gone when it is steady")
    candidate = True

    lag = Param(0.05, "s", "time of the stamp less that of the image", low=-5.0, high=5.0, off=0.0)

    def see(self, p):
        """Seconds by which the image is older than its stamp."""
        yield Term("camera.lag", lambda T, now, p: p.lag)
