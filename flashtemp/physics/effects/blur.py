"""Blur of the optics beyond the value stated in the recording.

>>> from types import SimpleNamespace as N
>>> [law] = Blur().see(None)
>>> law.law(None, None, N(sigma=0.5))
0.5
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class Blur(Effect):
    """Gaussian point spread of the optics, in addition to the integration over each pixel."""

    cause = "the image is blurred"
    source = "knife edge in the image; a fraction of a pixel in focus"
    tells = ("edges and steep gradients washed out", "the same in every frame")
    candidate = True

    sigma = Param(0.5, "px", "standard deviation added to that of the recording", low=0.0, high=20.0, off=0.0)

    def see(self, p):
        """Adds to the recording's point spread."""
        yield Term("camera.blur", lambda T, now, p: p.sigma)
