"""Recordings that do not belong to their condition: found before anything is fitted, reported, and left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flashtemp.discovery.prediction import Look
from flashtemp.discovery.problem import Study

CLEARLY = 0.5  # misfit otherwise over misfit as told, below which a recording is something else
SEEN = 0.3  # K: misfits below it are no ground for suspicion


def strangers(study: Study, looks: list[Look]) -> dict[str, str]:
    """{file: what it seems to be} of recordings that fit far better upside down or to another condition."""
    out = _copies(study)
    for number, ((_, views, _), look) in enumerate(zip(study.conditions, looks, strict=True)):
        for view in views:
            if view.file in out:
                continue
            sight, T = look.sights[view.file], view.recording.temperature
            own = _misfit(T, sight.predicted, sight.inside)
            if not own > SEEN:
                continue
            ways = {}
            if view.recording.view == "sidewall":
                ways["is upside down"] = _misfit(T[:, ::-1], sight.predicted, sight.inside)
                ways["is turned by 180 degrees"] = _misfit(T[:, ::-1, ::-1], sight.predicted, sight.inside)
            for other, (_, those, _) in enumerate(study.conditions):
                for like in those if other != number else ():
                    theirs = looks[other].sights[like.file]
                    if like.recording.view == view.recording.view and theirs.predicted.shape == T.shape:
                        fits = _misfit(T, theirs.predicted, sight.inside & theirs.inside)
                        ways[f"belongs to condition {other + 1}"] = fits
            best = min(ways, key=ways.get, default=None)
            if best is not None and ways[best] < CLEARLY * own:
                out[view.file] = f"{best}: it differs by {own:.2g} K rms as told, by {ways[best]:.2g} K so"
    return out


def _copies(study: Study) -> dict[str, str]:
    """Recordings that hold the same values as one before: noise repeated is no second measurement."""
    out, seen = {}, []
    for view in study.campaign.views:
        T = view.recording.temperature
        twin = next((v for v in seen if np.array_equal(v.recording.temperature, T, equal_nan=True)), None)
        if twin is not None and np.isfinite(T).any() and np.nanstd(T) > 0:
            out[view.file] = f"is the same as {twin.file}"
        seen.append(view)
    return out


def _misfit(measured: np.ndarray, predicted: np.ndarray, inside: np.ndarray) -> float:
    left = np.where(inside, measured - predicted, np.nan)
    return float(np.sqrt(np.nanmean(left**2))) if np.isfinite(left).any() else float("inf")


def without(study: Study, looks: list[list[Look]], refused: dict[str, str]) -> tuple[Study, list[list[Look]]]:
    """The study without some recordings, and its looks without conditions of which nothing is left."""
    conditions = [(g, [v for v in views if v.file not in refused], f) for g, views, f in study.conditions]
    kept = [i for i, (_, views, forces) in enumerate(conditions) if views or forces]
    campaign = replace(study.campaign, views=tuple(v for v in study.campaign.views if v.file not in refused))
    study = replace(
        study, campaign=campaign, conditions=tuple(conditions[i] for i in kept),
        pins=tuple(study.pins[i] for i in kept),
    )  # fmt: skip
    return study, [[look[i] for i in kept] for look in looks]
