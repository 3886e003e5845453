"""HTML report of a run: main numbers, title page, all pictures with captions, and the table of numbers."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp import viz
from flashtemp.display import atomic_write
from flashtemp.viz.html import page
from flashtemp.viz.html.page import ReportSubject
from flashtemp.viz.number_format import flatten_dict, format_number, format_value
from flashtemp.viz.run import run_views

PICTURE_ORDER = ("profile", "space_time", "field", "friction", "budget")  # others follow by name
RUN_TERMS = (
    ("Temperature rise", "Temperature above that of the surroundings, on the block's surface averaged across y."),
    (
        "Contact regions",
        "The macroasperity contact regions, also called spots: the parts of the face that touch the road. They are "
        "hotter than the surface averaged across y.",
    ),
    ("Nominal pressure", "Load over the whole area of the face, not over the parts that touch."),
    ("Leading edge", "The edge of the block that meets fresh road; x counts from it."),
    (
        "Energy imbalance",
        "Heat created or lost by the computation, as a fraction of all heat exchanged. Rounding gives about 10⁻¹².",
    ),
)
SUMMARY_WORDS = {
    "T_max_degC": "highest temperature (°C)",
    "rise_leading_K": "rise at the leading edge, end of the last repetition (K)",
    "rise_middle_K": "rise in the middle, end of the last repetition (K)",
    "rise_trailing_K": "rise at the trailing edge, end of the last repetition (K)",
    "friction_per_repetition": "friction, mean of each repetition (–)",
    "energy_imbalance": "energy imbalance (–)",
    "partition_error": "error of the split of heat between block and road (–)",
    "worn_mean_m": "worn depth, mean (m)",
    "worn_leading_m": "worn depth at the leading edge (m)",
    "worn_volume_m3": "worn volume (m³)",
    "energy_J": "heat (J)",
    "cells": "cells",
    "steps": "time steps",
    "rhs_evaluations": "solver: evaluations of the heat balance",
    "jacobian_products": "solver: products with the Jacobian",
    "preconditioner_setups": "solver: set-ups of the preconditioner",
    "preconditioner_solves": "solver: solutions of the preconditioner",
    "wall_s": "computing time (s)",
}
OMITTED_NUMBERS = ("title", "versions", "commit", "remarks", "own_effects")


def write_report(run: Any, path: Path, subject: ReportSubject) -> Path:
    """Write the report of a run as one HTML file with embedded pictures; returns its path."""
    with atomic_write(path) as unfinished:
        unfinished.write_text(render_report(run, subject, path.parent), encoding="utf-8")
    return path


def render_report(run: Any, subject: ReportSubject, folder: Path) -> str:
    """The whole text of the HTML file; `folder` has the pictures that were drawn with the run."""
    answer = [f'<div class="verdict">\n<p>{escape(summarise_run(run))}</p>\n</div>']
    remarks = [page.paragraph(text) for text in run.statistics.get("remarks", ())]
    sections = [
        *([page.Section("remarks", "Remarks", remarks)] if remarks else []),
        *_draw_pictures(run, folder),
        page.Section("numbers", "Numbers", [page.table(["quantity", "value"], _summary_rows(run))]),
        page.Section("reading", "Terms", [page.term_list(RUN_TERMS)]),
    ]
    return page.render_report(f"{run.title}: simulated temperatures", answer, subject, sections)


def summarise_run(run: Any) -> str:
    """The main numbers of a run in sentences."""
    s, number = run.summary, format_number
    repetition = run.repetition[run.last_sliding_index]
    words = (
        f"The highest temperature is {number(s['T_max_degC'])} °C. At the end of repetition {repetition} the block's "
        f"surface is warmer than its surroundings by {number(s['rise_leading_K'])} K at the leading edge, "
        f"{number(s['rise_middle_K'])} K in the middle and {number(s['rise_trailing_K'])} K at the trailing edge."
    )
    heat, friction = run.budget, run.friction_per_repetition
    if heat["friction"] > 0:
        words += f" {number(100 * heat['road'] / heat['friction'])} % of the friction heat enters the road."
    if friction:
        first, last = number(friction[0]), number(friction[-1])
        words += f" The friction coefficient is {first}"
        words += "." if first == last else f" in the first repetition and {last} in the last."
    return words


def _draw_pictures(run: Any, folder: Path) -> list[page.Section]:
    """A section for every picture that applies to a run.

    A run that has not saved its temperature fields shows the pictures of them that were drawn when it ended.
    """
    modules = sorted(viz.list_pictures(), key=lambda m: (PICTURE_ORDER.index(m) if m in PICTURE_ORDER else 99, m))
    out = []
    for name in modules:
        module = import_module(f"{viz.run_modules.__name__}.{name}")
        if not viz.is_applicable(name, run):
            data = page.read_png(folder / f"{module.PICTURE}.png") if not run_views.has_fields(run) else b""
            if data:
                caption = (module.__doc__ or name).partition("\n")[0]
                heading = caption.partition(":")[0].rstrip(".")
                out.append(page.Section(f"picture-{name}", heading, [page.embed_png(data, caption, caption)]))
            continue
        figure = module.draw(run)
        heading = figure.get_suptitle().partition(",")[0].replace("\n", " ")
        caption = (module.__doc__ or heading).partition("\n")[0]
        alt = f"{heading}: {ALT_TEXTS[name](run) if name in ALT_TEXTS else caption}"
        out.append(page.Section(f"picture-{name}", heading, [page.embed_figure(figure, alt, caption)]))
    return out


# --- alternative texts ------------------------------------------------------------------------------
def _describe_profile(run: Any) -> str:
    k = run.last_sliding_index
    i = int(np.nanargmax(run.T_spot[k]))
    hottest, place = format_number(run.T_spot[k, i]), format_number(1e3 * run.x[i])
    ends = " and ".join(format_number(run.T_block[k, end]) for end in (0, -1))
    return (
        f"hottest {hottest} °C in the contact regions at x = {place} mm; averaged across y, {ends} °C at both ends of "
        "the block"
    )


def _describe_history(run: Any) -> str:
    low, high = format_number(run.T_block.min()), format_number(run.T_block.max())
    return f"between {low} °C and {high} °C over {format_number(run.time[-1])} s"


def _describe_friction(run: Any) -> str:
    numbers = [format_number(mu) for mu in run.friction_per_repetition]
    return f"mean of the repetitions {numbers[0]} to {numbers[-1]}" if numbers else "no record"


def _describe_budget(run: Any) -> str:
    heat = run.budget
    if not heat["friction"] > 0:
        return "no friction heat"
    parts = ("road", "block", "holder", "air")
    return ", ".join(f"{name} {format_number(100 * heat[name] / heat['friction'])} %" for name in parts)


def _describe_wear(run: Any) -> str:
    return f"worn off {format_number(1e9 * run.worn_volume)} mm³, at most {format_number(1e6 * run.worn[-1].max())} µm"


def _describe_field(run: Any) -> str:
    return f"between {format_number(run.field.min())} °C and {format_number(run.field.max())} °C in the stored fields"


ALT_TEXTS: dict[str, Callable[[Any], str]] = {
    "profile": _describe_profile, "space_time": _describe_history, "friction": _describe_friction,
    "budget": _describe_budget, "wear_profile": _describe_wear, "field": _describe_field, "spots": _describe_field,
    "run_in_maps": _describe_field, "width_maps": _describe_field,
}  # fmt: skip


def _summary_rows(run: Any) -> list[list[str]]:
    """All numbers of summary.json in words; versions and remarks stand elsewhere."""
    numbers = {SUMMARY_WORDS.get(k, k.replace("_", " ")): v for k, v in run.summary.items() if k not in OMITTED_NUMBERS}
    return [[name, format_value(value)] for name, value in flatten_dict(numbers)]
