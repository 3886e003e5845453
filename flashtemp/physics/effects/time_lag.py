"""Time lag of the image by trigger, read-out or the bolometer's time constant.

>>> from types import SimpleNamespace as N
>>> [law] = TimeLag().see(None)
>>> law.law(None, None, N(lag=0.05))
0.05
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class TimeLag(Effect):
    """Frames show an earlier time than their time stamp."""

    cause = "the frames are stamped late"
    source = "trigger delay; time constant of a microbolometer, 8-12 ms"
    tells = ("wrong where temperature changes fast", "gone when it is steady")
    candidate = True

    lag = Param(0.05, "s", "time stamp minus time of the image", low=-5.0, high=5.0, off=0.0)

    def see(self, p):
        """Seconds by which the image is older than its time stamp."""
        yield Term("camera.lag", lambda T, now, p: p.lag)
