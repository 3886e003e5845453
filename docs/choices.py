"""What every chosen input does to temperature and friction: `.venv/bin/python docs/choices.py` (two minutes).

Runs short slides of cases/run_in with friction by theory, one choice changed at a time, writes
benchmarks/results/choices.json and the table of docs/explanation/choices.md.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

import flashtemp

ROOT = Path(__file__).parents[1]
OUT = ROOT / "benchmarks" / "results" / "choices.json"
PAGE = ROOT / "docs" / "explanation" / "choices.md"
SPEEDS = (0.1, 1.0)  # m/s
MARKS = r"(<!-- choices: [^\n]*-->\n).*?(<!-- end -->)"
SHORT = {"schedule.distance": 0.4, "schedule.repetitions": 1, "schedule.wait": 0.0, "output.vtk": False}
PRESSURES = {  # of the contact, and the effects that give it beside friction by theory
    "uniform": ["persson_friction"],
    "peak at the leading edge": ["persson_friction", "edge_pressure", "wear"],
}
THEORY = {"persson_friction.spots": "theory"}
FILM = {"contact.alpha": 2e4}  # 0.2 W/mK over 10 um, full grown
MICRO = {"contact.alpha": {"contact_size": 1e-5, "contact_share": 0.1}}
CHOICES: dict[str, tuple[list[str], dict[str, Any]]] = {  # words: effects beside those of PRESSURES, keys
    "contact fraction 0.2, D = 3 mm, alpha infinite": ([], {}),
    "contact fraction by the theory, P(2 pi/D)": ([], THEORY),
    "contact fraction 0.1": ([], {"contact.spot_fraction": 0.1}),
    "spot diameter 1.5 mm": ([], {"contact.spot_diameter": 1.5e-3}),
    "spot diameter 6 mm": ([], {"contact.spot_diameter": 6e-3}),
    "alpha 1e5 W/m2K": ([], {"contact.alpha": 1e5}),
    "alpha 1e4 W/m2K": ([], {"contact.alpha": 1e4}),
    "alpha of micro-contacts, 10 um on 10 % of a spot": ([], MICRO),
    "micro-contacts hotter than their spot (`micro_flash`)": (["micro_flash"], {}),
    "debris film of 10 um at 0.2 W/mK": ([], FILM),
    "spots on stone tops": (["stone_tops"], {}),
    "theory's fraction, micro-contacts, film and stone": (["micro_flash", "stone_tops"], THEORY | FILM),
}


def measure(pressure: str, name: str, speed: float) -> dict[str, float]:
    """Rises (K) of face and spots at the end of the slide, and its friction."""
    beside, keys = CHOICES[name]
    given = SHORT | keys | {"effects": PRESSURES[pressure] + beside, "schedule.speed": speed}
    run = flashtemp.simulate(ROOT / "cases" / "run_in", given)
    k, middle = run.last_sliding_index, 0.5 * (run.x[0] + run.x[-1])
    return {
        "face_middle_K": float(np.interp(middle, run.x, run.T_block[k])) - run.ambient_degC,
        "face_largest_K": float(run.T_block[k].max()) - run.ambient_degC,
        "spot_largest_K": float(run.T_spot[k].max()) - run.ambient_degC,
        "mu": float(run.friction[k]),
    }


def table(found: dict[str, dict[str, dict[str, float]]]) -> str:
    """Face at L/2, its largest rise and friction, at both speeds, in Markdown."""
    names = [f"{what}, {v:g} m/s" for what in ("face at L/2, K", "largest, K", "mu") for v in SPEEDS]
    rows = ["| choice | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for name, own in found.items():
        at = [own[f"{v:g}"] for v in SPEEDS]
        cells = [f"{one['face_middle_K']:.1f}" for one in at] + [f"{one['face_largest_K']:.1f}" for one in at]
        rows.append(f"| {name} | " + " | ".join(cells + [f"{one['mu']:.3f}" for one in at]) + " |")
    return "\n".join(rows) + "\n"


def main() -> None:
    """Measure, write the figures and the table."""
    found = {p: {name: {f"{v:g}": measure(p, name, v) for v in SPEEDS} for name in CHOICES} for p in PRESSURES}
    tables = "\n".join(f"Pressure: {p}.\n\n{table(own)}" for p, own in found.items())
    OUT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    text, count = re.subn(
        MARKS, lambda place: place[1] + tables + place[2], PAGE.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    if count != 1:
        raise SystemExit(f"{PAGE}: has no place for the table")
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
