"""The six pictures of a verdict, their captions and the reasons for absent ones; a learned law adds a seventh."""

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
        "Left to right: measured by the camera, computed by the calibrated base in the same colours, and measured "
        "minus computed (red: measured hotter). The frame is that of the largest difference, or the hottest frame "
        "where no difference exceeds the noise. The black line encloses differences beyond 3 sigma; noise alone gives "
        "a few specks. Right: T(x). Dots off the dashed line show the misfit of the base, and the solid line, where "
        "there is one, is the extended model."
    ),
    "not_noise": (
        "Each map is the mean over all frames in units of its noise. Noise alone is random from pixel to pixel, with "
        "0.3 % of the pixels beyond ±3. A patch of one colour is something that the model does not reproduce."
    ),
    "missing": (
        "The heat flux that would have to be added at the contact (left) and the corresponding pressure (right), "
        "estimated without any list of causes. Heat is missing where a band excludes the thin line (0 or 1). Grey "
        "marks regions that these data cannot resolve."
    ),
    "why": (
        "Each bar shows how much more probable the data become with that one effect; noise alone rarely exceeds the "
        "dashed line. Right, where drawn: the amplitude in each condition. If the cause is the same everywhere, all "
        "points agree with the band."
    ),
    "else": (
        "Dark squares are pairs of effects with the same signature in these data, so that one can be mistaken for the "
        "other. Points are calibrated parameters, in standard deviations from prior knowledge; beyond ±3 they are "
        "implausible."
    ),
    "gained": (
        "Squares (base) and dots (extended): the root mean square differences. Bars away from zero mark calibrated "
        "parameters that were biased without the cause. Below, where data were left out: their prediction."
    ),
}
POINTS_CAPTION = (
    "Measured minus computed temperature of every point over time: left with the calibrated base, right, where there "
    "is one, with the extended model. Open dots were left out of the fit. The blue band is two standard deviations of "
    "the noise."
)
ABSENCE_REASONS = {
    "what_is_wrong": "This verdict has no recording of temperatures, so no images are shown.",
    "not_noise": "This verdict has no recording of a camera, so no maps are shown.",
    "missing": "The missing heat flux along the contact was not computed: the data do not show it, or nothing slides.",
    "why": "No candidate was scored.",
    "else": "Neither correlations between effects nor calibrated parameters were kept.",
    "gained": "The model was not extended, so there is nothing to compare.",
}


def choose_caption(verdict, name: str) -> str:
    """The caption of a picture; recordings of points have no images to explain."""
    only_points = all(s.view.recording.places is not None for s in verdict.before)
    return POINTS_CAPTION if name == "what_is_wrong" and only_points else PICTURE_CAPTIONS[name]


def draw_figures(verdict) -> dict[str, Figure]:
    """{name: figure} of the pictures that apply to a verdict, in reading order; none where nothing was calibrated."""
    if verdict.kind == "no_verdict" and verdict.base is None:
        return {}
    has_correlations = verdict.separability is not None and len(verdict.separability[0]) > 0
    pictures = {
        "law": (learned_law.draw, verdict.law is not None),
        "what_is_wrong": (residual_images.draw, bool(verdict.before)),
        "not_noise": (whitened_maps.draw, bool(whitened_maps.select_imaged(verdict))),
        "missing": (missing_heat.draw, bool(verdict.missing)),
        "why": (candidate_scores.draw_scores, bool(candidate_scores.ranked_scores(verdict))),
        "else": (candidate_scores.draw_alternatives, has_correlations or bool(verdict.nuisance)),
        "gained": (before_after.draw, before_after.has_changes(verdict)),
    }
    return {name: draw(verdict) for name, (draw, applies) in pictures.items() if applies}


def draw_all(verdict, folder) -> list[Path]:
    """Write every picture that applies as a PNG file into a folder that exists; returns their paths."""
    return [theme.save_figure(fig, Path(folder) / f"{name}.png") for name, fig in draw_figures(verdict).items()]
