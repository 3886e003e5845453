"""How far the chosen inputs spread temperature over speed (three minutes).

Run it with the interpreter of the project: `.venv/bin/python docs/temperature_speed_band.py`.

Slides of 0.5 m of cases/uniform_pressure with friction by theory, at every choice of docs/choices.py, two loads and two
ambient temperatures.  Read at the end: the face at L/2, and the hottest pixel of the side wall at L/2 as a camera
sees it.  Writes benchmarks/results/temperature_speed_band.json and docs/pictures/temperature_speed_band.png.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from choices import CHOICES, ROOT

import flashtemp
from flashtemp.camera.prediction.observation import SIDE_WALL_CELLS, observe
from flashtemp.camera.recording import Recording
from flashtemp.viz import theme

OUT = ROOT / "benchmarks" / "results" / "temperature_speed_band.json"
PICTURE = ROOT / "docs" / "pictures" / "temperature_speed_band.png"
SPEEDS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # m/s
PRESSURES, AMBIENT = (0.5e5, 1.5e5), (20.0, 40.0)  # Pa, degC
DISTANCE = 0.5  # m
PIXEL, ROWS = 0.2e-3, 10  # m, pixels from the face up: the lowest is centred 0.1 mm above it
CAMERA: dict[str, float] = {
    "emissivity": 0.95,
    "psf_sigma_px": 0.7,
}  # as stated; a usual blur
SHORT = {
    "schedule.distance": DISTANCE, "schedule.repetitions": 1, "schedule.wait": 0.0, "output.vtk": False,
    "numerics.above": SIDE_WALL_CELLS,
}  # fmt: skip
PLACES = {"face": "face of the block at x = L/2", "wall": "hottest pixel of the side wall at x = L/2"}
COLOURS = {0.5e5: "#0072B2", 1.5e5: "#D55E00"}  # told apart by every kind of colour vision (Okabe and Ito)
DEFAULT, THEORY = list(CHOICES)[0], list(CHOICES)[-1]


def measure(name: str, speed: float, pressure: float, ambient: float) -> dict[str, float]:
    """Temperatures (degC) of the face and of the hottest wall pixel at L/2 at the end of the slide, and friction."""
    beside, keys = CHOICES[name]
    own = {"effects": ["persson_friction", *beside], "schedule.speed": speed, "contact.pressure": pressure}
    case = flashtemp.load(ROOT / "cases" / "uniform_pressure", SHORT | keys | own | {"ambient.temperature": ambient})
    run = flashtemp.simulate(case)
    middle, rows = 0.5 * case.scene.length, PIXEL * (np.arange(ROWS) + 0.5)
    frame = np.array([run.time[run.last_sliding_index]]), np.array([1])
    column = Recording("sidewall", np.zeros((1, ROWS, 1)), *frame, np.array([middle]), rows, **CAMERA)
    seen = observe(run, case.scene, column, case.scene.acting).temperature[0, :, 0]
    return {
        "face": round(float(run.at_x(run.T_block[run.last_sliding_index], middle)), 2),
        "wall": round(float(seen.max()), 2),
        "row": int(seen.argmax()),
        "mu": round(float(run.friction[run.last_sliding_index]), 4),
    }


def lines(rows: list[dict[str, Any]], place: str, pressure: float, ambient: float) -> dict[str, np.ndarray]:
    """Temperature (speeds,) in degC at every choice, for one load and ambient temperature."""
    own = [r for r in rows if (r["pressure_Pa"], r["ambient_degC"]) == (pressure, ambient)]
    return {name: np.array([r[place] for r in own if r["choice"] == name]) for name in CHOICES}


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Per place: lowest and highest rise over the default's in the whole band, and for every choice alone."""
    out: dict[str, Any] = {}
    for place in PLACES:
        ratios: dict[str, list[float]] = {name: [] for name in CHOICES}
        for pressure in PRESSURES:
            for ambient in AMBIENT:
                found = lines(rows, place, pressure, ambient)
                for name, T in found.items():
                    ratios[name] += list((T - ambient) / (found[DEFAULT] - ambient))
        spans = {name: [round(min(own), 2), round(max(own), 2)] for name, own in ratios.items()}
        every = [value for span in spans.values() for value in span]
        out[place] = {"rise over the default's": [min(every), max(every)], "each choice": spans}
    return out


@theme.styled
def draw(rows: list[dict[str, Any]]):
    """Temperature over speed: face and wall, 20 and 40 degC; bands of all choices, lines of defaults and theory."""
    fig = theme.make_figure(
        "Surface temperature over speed", "what the chosen inputs leave open", theme.WIDE_FIGURE_IN, 5.4
    )
    axes = fig.subplots(2, 2, sharex=True, sharey="row")
    for row, (place, words) in zip(axes, PLACES.items(), strict=True):
        for ax, ambient in zip(row, AMBIENT, strict=True):
            for pressure, hatch in zip(PRESSURES, ("", "////"), strict=True):
                found, colour = lines(rows, place, pressure, ambient), COLOURS[pressure]
                every, load = np.array(list(found.values())), f"{pressure * 1e-6:.2f} MPa"
                ax.fill_between(
                    SPEEDS, every.min(axis=0), every.max(axis=0), facecolor=colour, edgecolor=colour, alpha=0.25,
                    hatch=hatch, linewidth=0.0, label=f"{load}: all choices",
                )  # fmt: skip
                ax.plot(SPEEDS, found[DEFAULT], color=colour, marker="o", ms=3, label=f"{load}: defaults")
                ax.plot(SPEEDS, found[THEORY], "--", color=colour, label=f"{load}: theory, all on")
            ax.set(xscale="log", title=f"{words}, from {ambient:.0f} °C")
            ax.set_xticks(SPEEDS, [f"{v:g}" for v in SPEEDS], minor=False)
            ax.minorticks_off()
        row[0].set_ylabel("temperature (°C)")
    for ax in axes[1]:
        ax.set_xlabel("sliding speed (m/s)")
    axes[0, 0].legend(loc="upper left")
    return fig


def main() -> None:
    """Run every choice at every condition, write figures and picture."""
    rows = [
        {"choice": name, "speed_m_s": v, "pressure_Pa": p, "ambient_degC": T} | measure(name, v, p, T)
        for name in CHOICES for p in PRESSURES for T in AMBIENT for v in SPEEDS
    ]  # fmt: skip
    about = {"distance_m": DISTANCE, "pixel_m": PIXEL, "rows": ROWS, "speeds_m_s": SPEEDS} | CAMERA
    said = json.dumps({"about": about, "summary": summary(rows)}, indent=1)
    each = ",\n".join(json.dumps(row) for row in rows)
    OUT.write_text(f'{said[:-2]},\n "rows": [\n{each}\n]}}\n', encoding="utf-8")
    theme.save_figure(draw(rows), PICTURE, dpi=110)
    print(said)


if __name__ == "__main__":
    main()
