"""The six pictures of a verdict: what is wrong, not noise, missing, why, what else, gained; and a law, if learned."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.verdict import (
    before_after,
    candidate_scores,
    learned_law,
    missing_heat,
    residual_images,
    whitened_maps,
)

PICTURE_CAPTIONS = {
    "what_is_wrong": (
        "Left to right: what the camera measured, what the calibrated base computes in the same colours, and "
        "measured minus computed at the moment of the largest difference, or the hottest where none stands out from "
        "noise (red: measured hotter; the black line "
        "encloses what differs by more than 3 sigma, of which noise alone draws a few specks); at the right T(x), "
        "where dots off the dashed line show what the base misses and the drawn line, if any, what the extended "
        "model makes of it."
    ),
    "not_noise": (
        "Each map is the mean over all frames in units of its noise: noise alone looks like pepper and salt with "
        "0.3 % of the pixels beyond ±3, a patch of one colour is something that the model does not reproduce."
    ),
    "missing": (
        "The heat flux that would have to be added at the contact (left) and the pressure that it stands for "
        "(right), found without any list of causes: where a band excludes the thin line (0 or 1) something is "
        "missing, and grey hides what these data cannot resolve."
    ),
    "why": (
        "Each bar shows how much more probable the data become with that one effect; noise alone hardly ever exceeds "
        "the dashed line. At the right, where it is drawn, points of all conditions must agree with the band if the "
        "cause is the same everywhere."
    ),
    "else": (
        "Dark squares are pairs of effects with the same signature in these data, so that one can be mistaken for the "
        "other. Points are calibrated parameters, in standard deviations from prior knowledge; beyond ±3 they are not "
        "plausible."
    ),
    "gained": (
        "Squares to dots: how the differences shrink once the cause is in the model. Bars away from zero show which "
        "calibrated parameters were biased without it. Below, where data were left out, their prediction."
    ),
}
ABSENCE_REASONS = {
    "what_is_wrong": "No recording was kept with this verdict, so no images are shown.",
    "not_noise": "No recording was kept with this verdict, so no maps are shown.",
    "missing": "The missing heat flux was not computed for these data.",
    "why": "No candidate was scored.",
    "else": "Neither correlations between effects nor calibrated parameters were kept.",
    "gained": "The model was not extended, so there is nothing to compare.",
}


def draw_figures(verdict) -> dict[str, Figure]:
    """The pictures that apply to a verdict, by name, in the order in which they are read."""
    if verdict.kind == "no_verdict" and verdict.base is None:  # nothing was calibrated
        return {}
    alike = verdict.separability is not None and len(verdict.separability[0]) > 0
    drawn = {
        "law": (learned_law.draw, verdict.law is not None),
        "what_is_wrong": (residual_images.draw, bool(verdict.before)),
        "not_noise": (whitened_maps.draw, bool(whitened_maps.select_imaged(verdict))),
        "missing": (missing_heat.draw, bool(verdict.missing)),
        "why": (candidate_scores.draw_scores, bool(candidate_scores.ranked_scores(verdict))),
        "else": (candidate_scores.draw_alternatives, alike or bool(verdict.nuisance)),
        "gained": (before_after.draw, before_after.has_changes(verdict)),
    }
    return {name: draw(verdict) for name, (draw, applies) in drawn.items() if applies}


def draw_all(verdict, folder) -> list[Path]:
    """Write every picture that applies as a PNG file into a folder that exists; returns their paths."""
    return [theme.save_figure(fig, Path(folder) / f"{name}.png") for name, fig in draw_figures(verdict).items()]
