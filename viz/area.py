"""Area in contact over nominal pressure: elastic contact beside its linear law, and where it saturates."""

from __future__ import annotations

from matplotlib.figure import Figure

from flashtemp.viz import theme


@theme.styled
def draw(found) -> Figure:
    """A/A0 (1) over p/E (1), both logarithmic; `found` is runs.area_study.AreaStudy."""
    fig = theme.figure(found.case.title, theme.NARROW, 3.4)
    ax = fig.add_subplot()
    ax.axvspan(found.linear_up_to, found.ratio[-1], color=theme.WAITING, alpha=0.45, lw=0)
    ax.plot(found.ratio, found.linear, color=theme.AMBIENT, lw=1.0, ls=(0, (4, 3)), label="linear law")
    ax.plot(found.ratio, found.area, color=theme.SPOT, lw=1.8, label="elastic contact")
    area, _ = found.at(0.1)
    ax.plot(0.1, area, "o", color=theme.SPOT, ms=5, mec="white", mew=0.8, zorder=4)
    ax.annotate(f"{theme.number(100 * area, 2)} % at p/E = 0.1", (0.1, area), (8, -9), textcoords="offset points")
    ax.annotate("saturates", (found.linear_up_to, 1.2 * found.area[0]), (4, 0), textcoords="offset points")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(found.area[0], 2.0)
    ax.set_xlim(found.ratio[0], found.ratio[-1])
    ax.set(xlabel="nominal pressure / Young's modulus (–)", ylabel="area in contact A/A₀ (–)")
    ax.set_title(f"rms slope {theme.number(found.slope, 3)}")
    ax.legend(loc="upper left")
    return fig
