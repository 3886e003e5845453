"""Alternative texts of the pictures of a verdict, for readers who cannot see them."""

from __future__ import annotations

import numpy as np

from flashtemp.viz.number_format import effect_label, format_number
from flashtemp.viz.verdict import before_after, candidate_scores, plot_helpers

MAX_ITEMS_LISTED = 4  # items of a picture that its text lists


def describe_picture(verdict, name: str) -> str:
    """One picture of a verdict in a sentence: its heading, then its main numbers."""
    describe = {
        "what_is_wrong": _describe_images,
        "not_noise": _describe_noise,
        "missing": _describe_missing_heat,
        "why": _describe_scores,
        "else": _describe_alternatives,
        "gained": _describe_gain,
    }[name]
    return f"{plot_helpers.picture_heading(verdict, name)}: {describe(verdict)}."


def _selected_pairs(verdict) -> list:
    return [p for group in plot_helpers.select_recordings(verdict) for p in group]


def _describe_images(verdict) -> str:
    structured = sorted(
        (p for p in _selected_pairs(verdict) if plot_helpers.exceeds_noise(p.before)),
        key=plot_helpers.largest_difference,
    )
    if not structured:
        return "measured, computed and their difference; no difference exceeds the noise"
    lines = []
    for p in structured[::-1][:MAX_ITEMS_LISTED]:
        peak = p.before.largest
        where = f"x = {format_number(1e3 * peak.u)} mm" if p.recording.places is None else "one of its points"
        time = f"t = {format_number(peak.time)} s"
        lines.append(f"{p.before.view.file} by {format_number(peak.K)} K at {where}, {time}")
    return f"measured minus computed is largest in {'; '.join(lines)}"


def _describe_noise(verdict) -> str:
    lines = []
    for p in [p for p in _selected_pairs(verdict) if p.recording.places is None][:MAX_ITEMS_LISTED]:
        line = f"{p.before.view.file} {_outlier_percent(p.before)} with the base"
        lines.append(line + (f", {_outlier_percent(p.after)} extended" if p.after is not None else ""))
    return f"pixels whose mean over frames is beyond 3 sigma: {'; '.join(lines)}"


def _outlier_percent(result) -> str:
    return f"{format_number(100 * plot_helpers.outlier_fraction(result))} %"


def _describe_missing_heat(verdict) -> str:
    lines = []
    for m in verdict.missing[:MAX_ITEMS_LISTED]:
        i = np.unravel_index(np.argmax(np.abs(m.flux)), m.flux.shape)
        flux, error = 1e-3 * m.flux[i], 1e-3 * m.flux_sd[i]
        at = f"x = {format_number(1e3 * m.x[i[1]])} mm, repetition {m.repetition[i[0]]}"
        condition = plot_helpers.reword_condition(m.condition)
        lines.append(f"{condition} {format_number(flux)} ± {format_number(error)} kW/m² at {at}")
    return f"the missing heat flux is largest at {'; '.join(lines)}"


def _describe_scores(verdict) -> str:
    ranked = candidate_scores.ranked_scores(verdict)[:MAX_ITEMS_LISTED]
    best = ", ".join(f"{effect_label(name)} {format_number(score)}" for name, score, *_ in ranked)
    alarm = f"{candidate_scores.LN_BAYES_ALARM:g}"
    return f"ln Bayes factors of all candidates, the best {best}; the alarm level is {alarm}"


def _describe_alternatives(verdict) -> str:
    lines = []
    if verdict.separability is not None:
        names, matrix = verdict.separability
        rho = np.tril(np.abs(np.asarray(matrix, float)), -1)
        if rho.size and rho.max() > 0:
            i, j = np.unravel_index(np.argmax(rho), rho.shape)
            pair = f"{effect_label(names[i])} and {effect_label(names[j])}"
            lines.append(f"the most similar effects are {pair}, correlation {format_number(rho[i, j])}")
    if verdict.nuisance:
        p = max(verdict.nuisance, key=lambda p: abs(p.pull))
        lines.append(f"the largest deviation from prior knowledge is {p.name}, {format_number(p.pull)} sigma")
    return "; ".join(lines) or "no two effects have similar signatures"


def _describe_gain(verdict) -> str:
    lines = [
        f"{words} {format_number(b)} K to {format_number(a)} K" for words, b, a in before_after.rmse_pairs(verdict)
    ]
    lines += [
        f"{name} changed by {format_number(change)} %"
        for name, change, _ in before_after.parameter_shifts(verdict)[:MAX_ITEMS_LISTED]
    ]
    return f"root mean square differences from base to extended: {'; '.join(lines)}"
