"""A heat source moves over the face of a block without contact: a line, or both arcs of a round tool's rim.

>>> from types import SimpleNamespace as N
>>> arcs, _ = MovingSource().heat(N(width=0.01), None)
>>> more = {"axis": 0.0, "tilt": 0.0, "back_tilt": 0.0, "edges": 0.0, "chips": 0.0, "bite": 0.0}
>>> p = N(strength=1e3, speed=2e-3, enters=1.0, width=1e-3, back=0.5, back_width=None, radius=5e-3, **more)
>>> now = N(t=6.0, x=0.01, y=0.0, touching=False)  # the leading arc is here, the trailing one at x = 0
>>> round(arcs.law(300.0, now, p)), round(arcs.law(300.0, N(t=6.0, x=0.0, y=0.0, touching=False), p))
(398942, 199471)
"""

from __future__ import annotations

from math import inf, isfinite, pi, sqrt

import numpy as np

from flashtemp.physics.effect import Effect, Heat, Param, Term


class MovingSource(Effect):
    """Heat of a cutter, a torch or a laser: a Gaussian along x about a line across, or about the rim of a tool."""

    cause = "a source moves over the face of the block"
    source = (
        "moving Gaussian source, Rosenthal (1946) and followers; the rim of a face mill cuts in front and rubs behind"
    )
    tells = ("a maximum that wanders along the block at one speed", "two of them behind one another under a round tool")
    needs = "a block that nothing touches: schedule.alone, or lifted waits"

    strength = Param(1e3, "W/m", "heat into the face per metre across, of the leading arc", low=0.0, high=1e7, off=0.0)
    speed = Param(2e-3, "m/s", "speed along x", low=0.0, open_low=True, high=100.0)
    enters = Param(0.0, "s", "time at which it passes the edge x = 0", low=-1e7, high=1e7)
    width = Param(2e-3, "m", "standard deviation along x", low=0.0, open_low=True, high=1.0)
    radius = Param(inf, "m", "radius of a round tool, whose rim heats; 'inf': a straight line", low=0.0, open_low=True)
    axis = Param(0.0, "m", "y of the tool's axis from the centre line", low=-10.0, high=10.0)
    back = Param(0.0, "1", "strength of a round tool's trailing arc relative to the leading arc", low=0.0, high=100.0)
    back_width = Param(
        None, "m", "standard deviation of the trailing arc; `width` if not given", low=0.0, open_low=True
    )
    tilt = Param(0.0, "1", "growth of the leading arc over half the width, towards y > 0", low=-1.5, high=1.5)
    back_tilt = Param(0.0, "1", "growth of the trailing arc likewise", low=-1.5, high=1.5)
    edges = Param(0.0, "1", "growth of both arcs towards both side walls, as y squared", low=-1.5, high=3.0)
    chips = Param(
        0.0, "1", "heat of chips thrown ahead, uniform across, relative to the leading arc", low=0.0, high=10.0
    )
    chips_ahead = Param(0.02, "m", "mean distance ahead of the tool's tip at which chips fall", low=-1.0, high=1.0)
    chips_width = Param(0.01, "m", "standard deviation along x of where chips fall", low=0.0, open_low=True, high=1.0)
    chips_rise = Param(0.0, "s", "time constant of the build-up of chips, from `enters` on", low=0.0, high=1e6)
    chips_tilt = Param(0.0, "1", "growth of the chips' heat over half the width, towards y > 0", low=-1.5, high=1.5)
    bite = Param(
        0.0, "1", "extra strength of the leading arc on entry, relative to its later strength", low=0.0, high=100.0
    )
    bite_length = Param(1e-3, "m", "travel over which the extra strength decays by e", low=0.0, open_low=True, high=1.0)
    bite_tilt = Param(0.0, "1", "growth of the extra strength over half the width, towards y > 0", low=-1.5, high=1.5)

    def heat(self, scene, p):
        """Flux at the face; time steps are at most the time in which the source moves by its own width."""

        def law(T, now, p):
            if now.touching:
                return 0.0 * T
            since_entry = now.t - p.enters
            tip = now.x - p.speed * since_entry
            e = 2.0 * now.y / scene.width
            even = 1.0 + p.edges * (e * e - 1.0 / 3.0)  # its mean over the width is 1, as for both arcs
            bend = (
                p.radius - np.sqrt(np.maximum(p.radius**2 - (now.y - p.axis) ** 2, 0.0)) if isfinite(p.radius) else 0.0
            )
            shape = (even + p.tilt * e) * _gaussian_density(tip + bend, p.width)
            if p.bite:
                shape = shape * (
                    1.0 + p.bite * (1.0 + p.bite_tilt * e) * _exponential_decay(p.speed * since_entry, p.bite_length)
                )
            if isfinite(p.radius):
                behind = _gaussian_density(tip + 2.0 * p.radius - bend, p.back_width or p.width)
                shape = shape + p.back * (even + p.back_tilt * e) * behind
            if p.chips:
                build_up = 1.0 - _exponential_decay(since_entry, p.chips_rise) if p.chips_rise else 1.0
                density = (1.0 + p.chips_tilt * e) * _gaussian_density(tip - p.chips_ahead, p.chips_width)
                shape = shape + p.chips * build_up * density
            return p.strength * shape + 0.0 * T

        def step_rate(T, now, p):
            if now.touching or not p.strength:
                return 0.0
            return p.speed / min(p.width, p.back_width or p.width, p.bite_length if p.bite else inf)

        yield Heat.patch("block.face", law)
        yield Term("march.rate", step_rate)


def _gaussian_density(x, width):
    return np.exp(-0.5 * (x / width) ** 2) / (width * sqrt(2.0 * pi))


def _exponential_decay(since, scale):
    """1 for since < 0, then exp(-since / scale)."""
    return np.exp(-max(since, 0.0) / scale)
