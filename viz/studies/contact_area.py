"""Area in contact over nominal pressure: elastic contact, its linear law, and saturation."""

from __future__ import annotations

from matplotlib.figure import Figure

from flashtemp.viz import theme


@theme.styled
def draw(study) -> Figure:
    """A/A0 (1) over p/E (1), both logarithmic; `study` is an AreaStudy."""
    fig = theme.make_figure("Area in contact over pressure", study.case.title, theme.NARROW_FIGURE_IN, 3.4)
    ax = fig.add_subplot()
    ax.axvspan(study.linear_up_to, study.ratio[-1], color=theme.WAITING_COLOUR, alpha=0.45, lw=0)
    ax.plot(study.ratio, study.linear, color=theme.AMBIENT_COLOUR, lw=1.0, ls=(0, (4, 3)), label="linear law")
    ax.plot(study.ratio, study.area, color=theme.SPOT_COLOUR, lw=1.8, label="elastic contact")
    area, _ = study.interpolate_area(0.1)
    ax.plot(0.1, area, "o", color=theme.SPOT_COLOUR, ms=5, mec="white", mew=0.8, zorder=4)
    ax.annotate(
        f"{theme.format_decimal(100 * area, 2)} % at p/E = 0.1", (0.1, area), (8, -9), textcoords="offset points"
    )
    ax.annotate("saturates", (study.linear_up_to, 1.2 * study.area[0]), (4, 0), textcoords="offset points")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(study.area[0], 2.0)
    ax.set_xlim(study.ratio[0], study.ratio[-1])
    ax.set(xlabel="nominal pressure / Young's modulus (–)", ylabel="area in contact A/A₀ (–)")
    ax.set_title(f"rms slope {theme.format_decimal(study.slope, 3)}")
    ax.legend(loc="upper left")
    return fig
