"""Shared by the pictures of a verdict: recordings before and after, their selection, labels and averages."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from flashtemp.discovery.diagnostics.adequacy_tests import NEIGHBOUR_CORRELATION
from flashtemp.viz import theme
from flashtemp.viz.key_labels import describe_condition
from flashtemp.viz.literal_text import escape_mathematics

VERDICT_WIDTH_IN = 8.4  # inches
MAX_CONDITIONS_DRAWN = 4
OUTLIER_SIGMA = 3.0  # sigma
MAX_NOISE_OUTLIER_FRACTION = 0.01  # of pixels beyond OUTLIER_SIGMA; with noise alone the fraction is 0.003
RARE_TEST_P = 0.01  # p of a rare test; the simulations of a test are too few to resolve smaller ones
STRUCTURE_P = 0.001  # probability of so many rare tests in noise, below which structure is claimed
MAX_NOISE_SIGMA = 6.0  # sigma of the largest difference that may be noise: among so many places noise reaches 5
PROFILE_ROWS_M = 1e-3  # m from the contact, or from the centre line, over which T(x) is averaged
PICTURE_HEADINGS = {
    "what_is_wrong": "Measured minus computed temperature",
    "not_noise": "Structure in the residuals",
    "missing": "Missing heat flux",
    "why": "Evidence for each candidate",
    "else": "Similarity of the candidates and calibrated values",
    "gained": "Differences before and after the extension",
}
SOUND_HEADINGS = {"not_noise": "Residuals against noise", "missing": "Test for missing heat flux"}
VIEW_ORDER = ("sidewall", "wake", "profile", "points")


@dataclass(frozen=True)
class BeforeAfter:
    """A recording compared with the calibrated base and the extended model (or None); `words`: its condition."""

    before: Any
    after: Any
    words: str

    @property
    def recording(self):
        """The measured recording."""
        return self.before.view.recording


def group_recordings(verdict) -> list[list[BeforeAfter]]:
    """All recordings of a verdict, grouped by condition."""
    views = [s.view for s in verdict.before]
    if not views:
        return []
    common = {k for k in set().union(*(v.given for v in views)) if len({repr(v.given.get(k)) for v in views}) == 1}
    after = dict(enumerate(verdict.after)) if len(verdict.after) == len(verdict.before) else {}
    groups: dict[str, list[BeforeAfter]] = {}
    for i, s in enumerate(verdict.before):
        distinctive = {k: v for k, v in s.view.given.items() if k not in common}
        words = describe_condition(distinctive or s.view.given)
        groups.setdefault(repr(sorted(s.view.given.items(), key=lambda item: item[0])), []).append(
            BeforeAfter(s, after.get(i), words)
        )
    return list(groups.values())


def largest_difference(pair: BeforeAfter) -> float:
    """Magnitude of the largest structured difference (K) of a recording; its RMSE where there is none."""
    peak = pair.before.largest
    value = abs(peak.K) if peak is not None else pair.before.rmse_K
    return float(value) if np.isfinite(value) else 0.0


def exceeds_noise(result) -> bool:
    """Whether the largest structured difference exceeds what noise reaches among so many places."""
    return result.largest is not None and abs(result.largest.sigma) > MAX_NOISE_SIGMA


def select_recordings(verdict) -> list[list[BeforeAfter]]:
    """At most MAX_CONDITIONS_DRAWN conditions, those with the largest differences; one recording per view."""
    groups = group_recordings(verdict)
    ranked = sorted(range(len(groups)), key=lambda i: -max(largest_difference(p) for p in groups[i]))
    out = []
    for i in sorted(ranked[:MAX_CONDITIONS_DRAWN]):
        by_view = [[p for p in groups[i] if p.recording.view == view] for view in VIEW_ORDER]
        out.append([max(pairs, key=largest_difference) for pairs in by_view if pairs])
    return out


def describe_selection(verdict) -> str:
    """A sentence on which conditions are drawn; "" where all are."""
    groups, drawn = group_recordings(verdict), select_recordings(verdict)
    if len(groups) == len(drawn):
        return ""
    names = "; ".join(g[0].words for g in drawn)
    return f"Drawn are the {len(drawn)} of {len(groups)} conditions with the largest differences: {names}."


def group_by_view(groups: list[list[BeforeAfter]]) -> dict[str, list[BeforeAfter]]:
    """{view: its recordings}, in the order of the conditions."""
    flat = [p for g in groups for p in g]
    return {view: pairs for view in VIEW_ORDER if (pairs := [p for p in flat if p.recording.view == view])}


# --- figures ----------------------------------------------------------------------------------------
def picture_heading(verdict, name: str) -> str:
    """The heading of a picture; for an adequate model it claims no structure and no missing heat."""
    if name in SOUND_HEADINGS and (
        verdict.kind == "none_needed" or (name == "not_noise" and not has_structure(verdict))
    ):
        return SOUND_HEADINGS[name]
    return PICTURE_HEADINGS[name]


def has_structure(verdict) -> bool:
    """Whether maps or tests show structure in the residuals of the base; True where neither was made.

    Residuals that are smaller than the stated noise are no structure.
    """
    maps = [outlier_fraction(p.before) for g in select_recordings(verdict) for p in g if p.recording.places is None]
    tests = [t for t in verdict.tests if t.stage == "before"]
    is_structure = count_rare_tests(tests)[1] and not are_residuals_small(tests)
    return not (maps or tests) or is_structure or max(maps, default=0.0) > MAX_NOISE_OUTLIER_FRACTION


def count_rare_tests(tests: list) -> tuple[int, bool]:
    """How many tests have p <= RARE_TEST_P, and whether so many are improbable in noise (binomial test)."""
    from scipy.stats import binom

    count = sum(t.p <= RARE_TEST_P for t in tests)
    return count, bool(count and binom.sf(count - 1, len(tests), RARE_TEST_P) < STRUCTURE_P)


def are_residuals_small(tests: list) -> bool:
    """Whether rare tests show residuals smaller than the noise, and none shows larger ones.

    Correlated residuals that are also small tell of a stated noise that is too large, or of data that are not
    independent.
    """
    rare = [t for t in tests if t.p <= RARE_TEST_P]
    return any(t.is_small for t in rare) and all(t.is_small or t.name == NEIGHBOUR_CORRELATION for t in rare)


def make_verdict_figure(verdict, words: str, width: float, height: float) -> Figure:
    """An empty figure (inches) titled by what is shown (`words`) and by the campaign."""
    return theme.make_figure(words, verdict.title, width, height)


def reword_condition(text: str) -> str:
    """A condition written as overrides, "key = value, ...", in words with units; other texts are unchanged.

    >>> reword_condition("contact.pressure = 150000, schedule.speed = 0.1"), reword_condition("the case")
    ('contact pressure 0.15 MPa, speed 0.1 m/s', 'the case')
    """
    parts = [part.partition(" = ") for part in text.split(", ")]
    if not all(equals for _, equals, _ in parts):
        return text
    return describe_condition({key: _parse_number(value) for key, _, value in parts})


def _parse_number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def wrap_label(text: str, width: int = 19) -> str:
    """Text wrapped for the space left of a picture."""
    return escape_mathematics(textwrap.fill(text, width))


def add_row_label(ax, text: str) -> None:
    """A label left of a picture, clear of its tick labels."""
    ax.annotate(
        text, (0.0, 0.5), (-40, 0), xycoords="axes fraction", textcoords="offset points", ha="right", va="center",
        fontsize=7.0,
    )  # fmt: skip


def plot_label(key: str) -> str:
    """The name of an effect or a parameter in words.

    >>> plot_label("third_body"), plot_label("friction.mu")
    ('third body', 'friction mu')
    """
    return escape_mathematics(key if " " in key else key.replace("_", " ").replace(".", " "))


# --- numbers ----------------------------------------------------------------------------------------
def profile_rows(result) -> np.ndarray:
    """Rows with compared pixels nearest the contact (side wall) or the centre line (wake)."""
    rows = np.flatnonzero(np.isfinite(result.residual).any(axis=(0, 2)))
    if not len(rows):
        return np.arange(len(result.view.recording.v))
    distance = np.abs(result.view.recording.v[rows])
    return rows[distance <= distance.min() + PROFILE_ROWS_M]


def describe_rows(result) -> str:
    """The rows over which T(x) is averaged, in words."""
    recording = result.view.recording
    if recording.view == "profile":
        return "along the block"
    v = 1e3 * recording.v[profile_rows(result)]
    axis = "z" if recording.view == "sidewall" else "y"
    return f"mean of {axis} = {theme.format_decimal(v[0], 2)} to {theme.format_decimal(v[-1], 2)} mm".replace("-", "−")


def row_mean_profile(result, values: np.ndarray, frame: int) -> np.ndarray:
    """T(x) (nu,) in degC of one frame of `values` (frames, nv, nu): mean over `profile_rows`, NaN where masked."""
    rows = profile_rows(result)
    good = np.isfinite(result.residual[frame, rows])
    count = good.sum(axis=0)
    total = np.where(good, values[frame, rows], 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def hottest_frame(result, frames: np.ndarray) -> int:
    """The frame of `frames` with the highest computed mean over its compared pixels."""
    compared = np.isfinite(result.residual[frames])
    count = compared.sum(axis=(1, 2))
    heat = np.where(compared, result.predicted[frames], 0.0).sum(axis=(1, 2)) / np.maximum(count, 1)
    return int(frames[np.argmax(np.where(count > 0, heat, -np.inf))])


def repetition_frames(result) -> dict[int, int]:
    """{repetition: its hottest frame}, for the first and the last repetition."""
    repetition = result.view.recording.repetition
    return {int(n): hottest_frame(result, np.flatnonzero(repetition == n)) for n in np.unique(repetition)[[0, -1]]}


def whitened_means(result) -> np.ndarray:
    """Means over frames (nv, nu) of the whitened differences, scaled to unit variance for pure noise."""
    good = np.isfinite(result.sigmas)
    count = good.sum(axis=0)
    total = np.where(good, result.sigmas, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.sqrt(np.maximum(count, 1)), np.nan)


def outlier_fraction(result) -> float:
    """Fraction of the compared pixels whose mean over frames is beyond 3 sigma; 0.003 for pure noise."""
    values = whitened_means(result)
    good = values[np.isfinite(values)]
    return float(np.mean(np.abs(good) > OUTLIER_SIGMA)) if len(good) else 0.0
