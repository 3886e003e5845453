"""Draw docs/pictures/run_in_range.svg from the run-in study: .venv/bin/python docs/run_in_range.py"""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib as mpl

from flashtemp.viz import theme

ROOT = Path(__file__).parent.parent
STUDY = ROOT / "benchmarks" / "results" / "run_in_study.json"
OUT = ROOT / "docs" / "pictures" / "run_in_range.svg"

MARKS = {  # statement: place in its cell, marker, colour of Okabe and Ito, words
    "hot_spot_leading": (-0.26, "o", "#D55E00", "new block hottest in its leading fifth"),
    "even_after_ten": (0.0, "s", "#0072B2", "within ±15 % over 0.2-0.9 L after ten repetitions"),
    "friction_rises": (0.26, "^", "#009E73", "friction higher in the tenth repetition than in the first"),
}
ROOM = 0.42  # of half a cell, for the shade of the ready case


@theme.styled
def draw(runs: list[dict]):
    """One panel per exponent and wear rate: which statements hold at every compliance and height of the pivot."""
    fig = theme.figure("", theme.WIDE, 6.6)
    inputs = [r["overrides"] for r in runs]
    compliances, arms, rates, exponents = (
        sorted({o[key] for o in inputs})
        for key in ("friction_moment.compliance", "friction_moment.arm", "wear.rate", "contact.spot_exponent")
    )
    axes = fig.subplots(len(exponents), len(rates), sharex=True, sharey=True)
    for n, row in zip(exponents, axes, strict=True):
        for rate, ax in zip(rates, row, strict=True):
            here = [
                r for r in runs if r["overrides"]["wear.rate"] == rate and r["overrides"]["contact.spot_exponent"] == n
            ]
            for run in here:
                _mark(ax, run, compliances, arms)
            if n == 0.0 and rate == rates[0]:
                at = compliances.index(0.01) - 0.5, arms.index(0.03) - ROOM
                ax.add_patch(mpl.patches.Rectangle(at, 1.0, 2 * ROOM, fill=False, ec="black", lw=0.9))
            spots = "fixed by the road" if n == 0 else "in proportion to pressure"
            ax.set_title(f"wear {1e10 * rate:g}e-10 m²/N, spots {spots}", fontsize=8)
            ax.set(xlim=(-0.6, len(compliances) - 0.4), ylim=(-0.6, len(arms) - 0.4))
            ax.set_xticks(range(len(compliances)), ["guided", *(f"{c:g}" for c in compliances[1:])], fontsize=7)
            ax.set_yticks(range(len(arms)), [f"{1e3 * h:g}" for h in arms], fontsize=7)
    for ax in axes[-1]:
        ax.set_xlabel("compliance of the holder (rad/(N m))")
    for ax in axes[:, 0]:
        ax.set_ylabel("height of the pivot (mm)")
    handles = [
        mpl.lines.Line2D([], [], ls="", marker=m, color=c, ms=5, label=words) for _, m, c, words in MARKS.values()
    ]
    handles += [
        mpl.lines.Line2D(
            [],
            [],
            ls="",
            marker="x",
            color=theme.AMBIENT,
            ms=5,
            label="snaps over, or worn through",
        ),
        mpl.patches.Patch(fill=False, ec="black", label="cases/run_in"),
    ]
    fig.legend(handles=handles, loc="outside lower left", ncols=2, fontsize=8)
    return fig


def _mark(ax, run: dict, compliances: list[float], arms: list[float]) -> None:
    """The statements that hold in one run, beside each other in its cell; a guided holder has no pivot."""
    given = run["overrides"]
    x, y = compliances.index(given["friction_moment.compliance"]), arms.index(given["friction_moment.arm"])
    if "failure" in run:
        ax.plot(x, y, "x", color=theme.AMBIENT, ms=5)
        return
    ax.plot(x, y, ".", color=theme.AMBIENT, ms=1.5, zorder=0)
    for name, (aside, marker, colour, _) in MARKS.items():
        if run["holds"][name]:
            ax.plot(x + aside, y, marker, color=colour, ms=4)


def main() -> None:
    mpl.rcParams["svg.hashsalt"] = "run_in_range"
    runs = list(json.loads(STUDY.read_text(encoding="utf-8"))["map"].values())
    draw(runs).savefig(OUT, metadata={"Date": None})


if __name__ == "__main__":
    main()
