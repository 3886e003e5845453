"""Power spectrum of a road surface with the fitted self-affine law."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.physics.friction.roughness_spectrum import MeasuredSpectrum, SelfAffineLaw
from flashtemp.viz import theme


@theme.styled
def draw(points: MeasuredSpectrum, law: SelfAffineLaw, title: str) -> Figure:
    """C (m^4) over q (1/m), both logarithmic, wavelengths in mm above."""
    fig = theme.make_figure("Power spectrum of the road", title, theme.NARROW_FIGURE_IN, 3.8)
    ax = fig.subplots()
    q = np.geomspace(*points.valid_range, 200)
    ax.loglog(points.q, points.C, "o-", color=theme.ROAD_COLOUR, ms=2.5, lw=0.8, label="measured")
    rolloff = theme.format_decimal(2e3 * np.pi / law.rolloff, 2)
    label = f"self-affine below {rolloff} mm, H = {law.hurst:.2f}"
    ax.loglog(q, law(q), "--", color=theme.SPOT_COLOUR, label=label)
    ax.set(xlabel="wavenumber q (1/m)", ylabel="C (m⁴)")
    above = ax.secondary_xaxis("top", functions=(_wavelength_mm, _wavelength_mm))
    above.set_xlabel("wavelength (mm)")
    ax.legend(loc="lower left")
    return fig


def _wavelength_mm(q):
    """2 pi/q in mm, its own inverse."""
    return 2e3 * np.pi / np.maximum(q, 1e-300)
