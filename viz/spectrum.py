"""The power spectrum of a road with the self-affine law through it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.physics.friction.roughness_spectrum import Points, SelfAffine
from flashtemp.viz import theme


@theme.styled
def draw(points: Points, law: SelfAffine, title: str) -> Figure:
    """C (m^4) over q (1/m), both logarithmic, wavelengths in mm above."""
    fig = theme.figure(title, theme.NARROW, 3.8)
    ax = fig.subplots()
    q = np.geomspace(*points.reach, 200)
    ax.loglog(points.q, points.C, "o-", color=theme.ROAD, ms=2.5, lw=0.8, label="measured")
    rolloff = theme.number(2e3 * np.pi / law.rolloff, 2)
    label = f"self-affine below {rolloff} mm, H = {law.hurst:.2f}"
    ax.loglog(q, law(q), "--", color=theme.SPOT, label=label)
    ax.set(xlabel="wavenumber q (1/m)", ylabel="C (m⁴)")
    above = ax.secondary_xaxis("top", functions=(_wavelength, _wavelength))
    above.set_xlabel("wavelength (mm)")
    ax.legend(loc="lower left")
    return fig


def _wavelength(q):
    """2 pi/q in mm, its own inverse."""
    return 2e3 * np.pi / np.maximum(q, 1e-300)
