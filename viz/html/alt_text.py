"""What the pictures of a verdict show, in words, for those who cannot see them."""

from __future__ import annotations

import numpy as np

from flashtemp.viz.number_format import effect_label, format_number
from flashtemp.viz.verdict import before_after, candidate_scores, plot_helpers

MAX_ITEMS_LISTED = 4  # things told of a picture


def describe_picture(verdict, name: str) -> str:
    """One picture of a verdict in a sentence, with its own numbers; its heading first."""
    told = {
        "what_is_wrong": _describe_images, "not_noise": _describe_noise, "missing": _describe_missing_heat, "why": _describe_scores, "else": _describe_alternatives,
        "gained": _describe_gain,
    }  # fmt: skip
    return f"{plot_helpers.picture_heading(verdict, name)}: {told[name](verdict)}."


def _selected_pairs(verdict) -> list:
    return [p for group in plot_helpers.select_recordings(verdict) for p in group]


def _describe_images(verdict) -> str:
    some = sorted(
        (p for p in _selected_pairs(verdict) if plot_helpers.exceeds_noise(p.before)),
        key=plot_helpers.largest_difference,
    )
    if not some:
        return "measured, computed and their difference; no difference stands out from noise"
    lines = []
    for p in some[::-1][:MAX_ITEMS_LISTED]:
        at = p.before.largest
        where = f"x = {format_number(1e3 * at.u)} mm" if p.recording.places is None else "one of its points"
        lines.append(f"{p.before.view.file} by {format_number(at.K)} K at {where}, t = {format_number(at.time)} s")
    return f"measured less computed is largest in {'; '.join(lines)}"


def _describe_noise(verdict) -> str:
    lines = []
    for p in [p for p in _selected_pairs(verdict) if p.recording.places is None][:MAX_ITEMS_LISTED]:
        share = f"{format_number(100 * plot_helpers.outlier_fraction(p.before))} % with the base"
        share += (
            f", {format_number(100 * plot_helpers.outlier_fraction(p.after))} % extended" if p.after is not None else ""
        )
        lines.append(f"{p.before.view.file} {share}")
    return f"pixels whose mean over frames is beyond 3 sigma: {'; '.join(lines)}"


def _describe_missing_heat(verdict) -> str:
    lines = []
    for m in verdict.missing[:MAX_ITEMS_LISTED]:
        i = np.unravel_index(np.argmax(np.abs(m.flux)), m.flux.shape)
        flux, error = 1e-3 * m.flux[i], 1e-3 * m.flux_sd[i]
        at = f"x = {format_number(1e3 * m.x[i[1]])} mm, repetition {m.repetition[i[0]]}"
        lines.append(
            f"{plot_helpers.reword_condition(m.condition)} {format_number(flux)} ± {format_number(error)} kW/m² at {at}"
        )
    return f"the heat flux to be added is largest at {'; '.join(lines)}"


def _describe_scores(verdict) -> str:
    best = [
        f"{effect_label(name)} {format_number(score)}"
        for name, score, *_ in candidate_scores.ranked_scores(verdict)[:MAX_ITEMS_LISTED]
    ]
    return f"ln Bayes factors of all candidates, the best {', '.join(best)}; {candidate_scores.LN_BAYES_ALARM:g} is the alarm level"


def _describe_alternatives(verdict) -> str:
    lines = []
    if verdict.separability is not None:
        names, matrix = verdict.separability
        alike = np.tril(np.abs(np.asarray(matrix, float)), -1)
        if alike.size and alike.max() > 0:
            i, j = np.unravel_index(np.argmax(alike), alike.shape)
            lines.append(
                f"most alike are {effect_label(names[i])} and {effect_label(names[j])}, correlation {format_number(alike[i, j])}"
            )
    if verdict.nuisance:
        p = max(verdict.nuisance, key=lambda p: abs(p.pull))
        lines.append(f"farthest from what was known is {p.name}, by {format_number(p.pull)} sigma")
    return "; ".join(lines) or "no two effects are alike"


def _describe_gain(verdict) -> str:
    lines = [
        f"{words} {format_number(b)} K to {format_number(a)} K" for words, b, a in before_after.rmse_pairs(verdict)
    ]
    lines += [
        f"{name} moved by {format_number(change)} %"
        for name, change, _ in before_after.parameter_shifts(verdict)[:MAX_ITEMS_LISTED]
    ]
    return f"root mean square differences from base to extended: {'; '.join(lines)}"
