"""Draw the figures of docs/ and README from the ready cases: .venv/bin/python docs/figures.py"""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from flashtemp.__main__ import main as flashtemp
from flashtemp.comparison import campaign
from flashtemp.comparison.compare import compare
from flashtemp.comparison.synthetic_campaign import SyntheticPlan, make_synthetic_campaign
from flashtemp.model.case import load_case
from flashtemp.solver.time_integration import integrate_schedule
from flashtemp.viz import theme
from flashtemp.viz.measurement import comparison
from flashtemp.viz.run import field, profile, run_in_maps, space_time, wear_profile

ROOT = Path(__file__).parent.parent
OUT = ROOT / "docs" / "pictures"


def simulate(name: str, **change):
    """March a ready case with overrides given as table__key."""
    case = load_case(ROOT / "cases" / name, {k.replace("__", "."): v for k, v in change.items()})
    return integrate_schedule(case.scene, case.settings, case.title)


@theme.styled
def against_speed(run_of):
    """Rise at x = L/2 against speed for both pressures and both ambient temperatures (claim C13)."""
    fig = theme.make_figure("Surface temperature of the block over speed", "", 4.6, 3.6)
    ax = fig.add_subplot()
    speeds = sorted({v for v, _, _ in run_of})
    for p, colour in ((0.5e5, "#0072B2"), (1.5e5, "#D55E00")):
        for T0, style in ((20.0, "-"), (40.0, "--")):
            runs = [run_of[(v, p, T0)] for v in speeds]
            T = [r.at_x(r.T_block[r.last_sliding_index], 0.0125) for r in runs]
            ax.plot(speeds, T, style, marker="o", color=colour, label=f"{p * 1e-6:.2f} MPa, from {T0:.0f} °C")
    ax.set(xlabel="sliding speed (m/s)", ylabel="block surface at x = L/2 (°C)", xlim=(0, None))
    ax.legend()
    return fig


@theme.styled
def against_alpha(run_of):
    """T(x) in the spots and in the lanes for falling heat-transfer coefficients (claim C19)."""
    fig = theme.make_figure("Temperature along the block", run_of["inf"].title, 4.6, 3.6)
    ax = fig.add_subplot()
    for (name, run), colour in zip(run_of.items(), ("#000000", "#0072B2", "#009E73", "#D55E00"), strict=True):
        ax.plot(
            1e3 * run.x,
            run.T_spot[run.last_sliding_index],
            color=colour,
            label=f"alpha = {name} W/m²K" if name != "inf" else "alpha = inf",
        )
        ax.plot(1e3 * run.x, run.T_road[run.last_sliding_index], ":", color=colour)
    ax.set(xlabel="x from the leading edge (mm)", ylabel="rubber in the spots, road dotted (°C)", xlim=(0, 25))
    ax.legend()
    return fig


@theme.styled
def exponents(run_of):
    """What the exponent of phi(p) does to T(x) and to the sign of friction in a run-in (theory 7.4)."""
    shown = "Surface temperature and friction by two laws of contact fraction, phi ~ pⁿ"
    fig = theme.make_figure(shown, "", theme.WIDE_FIGURE_IN, 3.3)
    axes = fig.subplots(1, 3, width_ratios=[1, 1, 1.15])
    for ax, name, words in zip(axes, ("n = 0", "n = 1"), ("spots fixed by the road", "more spots"), strict=False):
        run = run_of[name]
        for r, colour in ((1, theme.SPOT_COLOUR), (3, "#E69F00"), (10, theme.BLOCK_COLOUR)):
            end = np.flatnonzero(run.sliding & (run.repetition == r))[-1]
            ax.plot(1e3 * run.x, run.T_block[end], color=colour, label=f"repetition {r}")
        ax.set(xlabel="x from the leading edge (mm)", xlim=(0, 25), ylim=(20, 62), title=f"{name}: {words}")
    axes[0].set_ylabel("block surface (°C)")
    axes[1].legend(loc="upper left")
    styles = {
        "n = 0": ("#B2182B", "-", "n = 0, wear: rises"),
        "n = 1": ("#0072B2", "-", "n = 1, wear: falls"),
        "n = 0, no wear": ("#B2182B", ":", "n = 0, no wear"),
        "n = 1, no wear": ("#0072B2", ":", "n = 1, no wear"),
    }
    for name, (colour, line, label) in styles.items():
        mu = run_of[name].friction_per_repetition
        axes[2].plot(range(1, len(mu) + 1), mu, line, marker="o", ms=3, color=colour)
        above = name != "n = 1"
        axes[2].text(
            10, mu[-1] + (0.004 if above else -0.004), label, color=colour, ha="right", va="bottom" if above else "top"
        )
    axes[2].set(xlabel="repetition", ylabel="friction, mean of the repetition (–)", title="friction, 0.25 MPa, 0.1 m/s")
    return fig


def hidden_tilt():
    """One recording of a synthetic campaign with a hidden tilt, against a model without it."""
    case = load_case(ROOT / "cases" / "uniform_pressure", {"schedule.repetitions": 2, "schedule.wait": 5.0})
    with TemporaryDirectory() as folder:
        plan = SyntheticPlan(("pressure_tilt",), seed=3, conditions=1, views=("sidewall",))
        result = compare(campaign.load(make_synthetic_campaign(case, plan, Path(folder) / "lab")))
    return comparison.draw_images(result.recordings[0], result.runs[0])


def run_in() -> None:
    """The pictures of docs/explanation/run_in.md that its case draws."""
    heavy = {"contact__pressure": 2.5e5}
    laws = {
        name: simulate("run_in", **heavy, contact__spot_exponent=n, wear__rate=rate)
        for name, n, rate in (
            ("n = 0", 0.0, 1e-10), ("n = 1", 1.0, 1e-10), ("n = 0, no wear", 0.0, 0.0), ("n = 1, no wear", 1.0, 0.0),
        )
    }  # fmt: skip
    exponents(laws).savefig(OUT / "exponent.png", dpi=130)
    run = simulate("run_in")
    for name, module in (
        ("run_in", run_in_maps),
        ("run_in_map", space_time),
        ("run_in_field", field),
        ("worn", wear_profile),
    ):
        module.draw(run).savefig(OUT / f"{name}.png", dpi=110)


def main() -> None:
    OUT.mkdir(exist_ok=True)
    hidden_tilt().savefig(OUT / "compare.png", dpi=110)
    run_in()
    profile.draw(simulate("uniform_pressure")).savefig(OUT / "profile.png", dpi=110)
    speeds = np.array([0.1, 0.25, 0.5, 1.0])
    sweep = {
        (v, p, T0): simulate("speed_sweep", schedule__speed=float(v), contact__pressure=p, ambient__temperature=T0)
        for v in speeds for p in (0.5e5, 1.5e5) for T0 in (20.0, 40.0)
    }  # fmt: skip
    against_speed(sweep).savefig(OUT / "speed_sweep.png", dpi=110)
    values = {"inf": "inf", "1e6": 1e6, "1e5": 1e5, "1e4": 1e4}
    alphas = {name: simulate("alpha_sensitivity", contact__alpha=a) for name, a in values.items()}
    against_alpha(alphas).savefig(OUT / "alpha_sensitivity.png", dpi=110)
    for command, name, *given in (
        ("friction", "slope_tester"),
        ("loads", "mu_of_p"),
        ("tread", "tread_block"),
        ("tyre", "tyre", "ambient.temperature=20"),
    ):
        with TemporaryDirectory() as folder:
            out = Path(folder) / command
            flashtemp([command, str(ROOT / "cases" / name), *given, "--out", str(out)])
            shutil.copy(out / f"{command}.png", OUT)


if __name__ == "__main__":
    main()
