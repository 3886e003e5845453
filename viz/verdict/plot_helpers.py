"""What the pictures of a verdict share: recordings before and after, which of them are drawn, and their words."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.measurement.residual_plots import describe_condition, escape_dollars

VERDICT_WIDTH_IN = 9.6  # inches
MAX_CONDITIONS_DRAWN = 4  # conditions that are drawn
OUTLIER_SIGMA = 3.0  # sigma
MAX_NOISE_OUTLIER_FRACTION = 0.01  # share of pixels beyond it from which noise is not all; of noise alone it is 0.003
RARE_TEST_P = 0.01  # share of noise-only data; the simulations of a test are too few to tell smaller ones
STRUCTURE_P = 0.001  # chance of so many rare tests together from which structure is claimed
MAX_NOISE_SIGMA = (
    6.0  # sigma up to which the largest difference of a recording may be noise: among so many places it gets to 5
)
PROFILE_ROWS_M = 1e-3  # m from the contact, or from the centre line, over which T(x) is averaged
PICTURE_HEADINGS = {
    "what_is_wrong": "What is wrong",
    "not_noise": "It is not noise",
    "missing": "What is missing",
    "why": "Why this cause",
    "else": "Could it be something else",
    "gained": "What we gained",
}
SOUND_HEADINGS = {
    "what_is_wrong": "Measured against computed",
    "not_noise": "Is it noise",
    "missing": "Is any heat missing",
}
VIEW_ORDER = ("sidewall", "wake", "profile", "points")


@dataclass(frozen=True)
class BeforeAfter:
    """A recording against the calibrated base and, if there is one, the extended model; `words` of its condition."""

    before: Any
    after: Any
    words: str

    @property
    def recording(self):
        """What was measured."""
        return self.before.view.recording


def group_recordings(verdict) -> list[list[BeforeAfter]]:
    """All recordings, those of one condition together."""
    views = [s.view for s in verdict.before]
    if not views:
        return []
    shared = {k for k in set().union(*(v.given for v in views)) if len({repr(v.given.get(k)) for v in views}) == 1}
    after = dict(enumerate(verdict.after)) if len(verdict.after) == len(verdict.before) else {}
    groups: dict[str, list[BeforeAfter]] = {}
    for i, s in enumerate(verdict.before):
        own = {k: v for k, v in s.view.given.items() if k not in shared}
        words = describe_condition(own or s.view.given)
        groups.setdefault(repr(sorted(s.view.given.items(), key=lambda item: item[0])), []).append(
            BeforeAfter(s, after.get(i), words)
        )
    return list(groups.values())


def largest_difference(pair: BeforeAfter) -> float:
    """The largest structured difference (K) of a recording."""
    at = pair.before.largest
    value = abs(at.K) if at is not None else pair.before.rmse_K
    return float(value) if np.isfinite(value) else 0.0


def exceeds_noise(seeing) -> bool:
    """Whether the largest structured difference of a recording is more than noise reaches among so many places."""
    return seeing.largest is not None and abs(seeing.largest.sigma) > MAX_NOISE_SIGMA


def select_recordings(verdict) -> list[list[BeforeAfter]]:
    """At most MAX_CONDITIONS_DRAWN conditions, those with the largest differences, with one recording of every view."""
    groups = group_recordings(verdict)
    most = sorted(range(len(groups)), key=lambda i: -max(largest_difference(p) for p in groups[i]))[
        :MAX_CONDITIONS_DRAWN
    ]
    out = []
    for i in sorted(most):
        own = [[p for p in groups[i] if p.recording.view == view] for view in VIEW_ORDER]
        out.append([max(some, key=largest_difference) for some in own if some])
    return out


def describe_selection(verdict) -> str:
    """Which conditions are drawn, where that is not all of them; else nothing."""
    groups, drawn = group_recordings(verdict), select_recordings(verdict)
    if len(groups) == len(drawn):
        return ""
    names = "; ".join(g[0].words for g in drawn)
    return f"Drawn are the {len(drawn)} of {len(groups)} conditions with the largest differences: {names}."


def group_by_view(groups: list[list[BeforeAfter]]) -> dict[str, list[BeforeAfter]]:
    """The recordings of every view, in the order of the conditions."""
    flat = [p for g in groups for p in g]
    return {view: own for view in VIEW_ORDER if (own := [p for p in flat if p.recording.view == view])}


# --- figures ----------------------------------------------------------------------------------------
def picture_heading(verdict, name: str) -> str:
    """The heading of a picture, which for a sound model claims no fault."""
    if name in SOUND_HEADINGS and (
        verdict.kind == "none_needed" or (name == "not_noise" and not has_structure(verdict))
    ):
        return SOUND_HEADINGS[name]
    return "What was tried" if name == "why" and not verdict.causes else PICTURE_HEADINGS[name]


def has_structure(verdict) -> bool:
    """Whether maps or tests show that what the base leaves is more than noise; true where neither was made."""
    maps = [outlier_fraction(p.before) for g in select_recordings(verdict) for p in g if p.recording.places is None]
    tests = [t for t in verdict.tests if t.stage == "before"]
    return not (maps or tests) or count_rare_tests(tests)[1] or max(maps, default=0.0) > MAX_NOISE_OUTLIER_FRACTION


def count_rare_tests(tests: list) -> tuple[int, bool]:
    """How many tests are as rare as RARE_TEST_P in noise alone, and whether so many cannot be chance."""
    from scipy.stats import binom

    count = sum(t.p <= RARE_TEST_P for t in tests)
    return count, bool(count and binom.sf(count - 1, len(tests), RARE_TEST_P) < STRUCTURE_P)


def make_verdict_figure(verdict, words: str, width: float, height: float) -> Figure:
    """An empty figure (inches) that says what it shows and of which campaign."""
    fig = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    text = textwrap.shorten(f"{words}: {verdict.title}", round(11 * width), placeholder=" ...")
    fig.suptitle(escape_dollars(text), x=0.01, ha="left")
    return fig


def reword_condition(text: str) -> str:
    """A condition as its overrides were written, in words with units; what is no such list stays as it is.

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
    """Text for the space beside a picture, broken into lines."""
    return escape_dollars(textwrap.fill(text, width))


def add_row_label(ax, text: str) -> None:
    """Words at the left of a picture, clear of its numbers."""
    ax.annotate(
        text, (0.0, 0.5), (-40, 0), xycoords="axes fraction", textcoords="offset points", ha="right", va="center",
        fontsize=7.0,
    )  # fmt: skip


def plot_label(key: str) -> str:
    """An effect or a parameter for a label.

    >>> plot_label("third_body"), plot_label("friction.mu")
    ('third body', 'friction mu')
    """
    return escape_dollars(key if " " in key else key.replace("_", " ").replace(".", " "))


# --- numbers ----------------------------------------------------------------------------------------
def profile_rows(seeing) -> np.ndarray:
    """Rows of an image that hold anything and are nearest the contact (side wall) or the centre line (wake)."""
    seen = np.flatnonzero(np.isfinite(seeing.residual).any(axis=(0, 2)))
    if not len(seen):
        return np.arange(len(seeing.view.recording.v))
    away = np.abs(seeing.view.recording.v[seen])
    return seen[away <= away.min() + PROFILE_ROWS_M]


def describe_rows(seeing) -> str:
    """The rows of T(x) in words."""
    recording = seeing.view.recording
    if recording.view == "profile":
        return "along the block"
    v = 1e3 * recording.v[profile_rows(seeing)]
    axis = "z" if recording.view == "sidewall" else "y"
    return f"mean of {axis} = {theme.format_decimal(v[0], 2)} to {theme.format_decimal(v[-1], 2)} mm".replace("-", "−")


def row_mean_profile(seeing, values: np.ndarray, frame: int) -> np.ndarray:
    """T(x) (nu,) in degC of one frame of images (frames, nv, nu): mean of `profile_rows`, NaN where nothing is compared."""
    some = profile_rows(seeing)
    good = np.isfinite(seeing.residual[frame, some])
    count = good.sum(axis=0)
    total = np.where(good, values[frame, some], 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def hottest_frame(seeing, frames: np.ndarray) -> int:
    """The frame, of some, that is computed to be hottest."""
    seen = np.isfinite(seeing.residual).any(axis=0)
    heat = np.where(seen, seeing.predicted[frames], 0.0).sum(axis=(1, 2))
    return int(frames[np.argmax(heat)])


def repetition_frames(seeing) -> dict[int, int]:
    """The hottest frame of the first and of the last repetition, by the number of the repetition."""
    told = seeing.view.recording.repetition
    return {int(n): hottest_frame(seeing, np.flatnonzero(told == n)) for n in np.unique(told)[[0, -1]]}


def whitened_means(seeing) -> np.ndarray:
    """Means over frames (nv, nu) of the whitened differences, of unit variance where only noise is left."""
    good = np.isfinite(seeing.sigmas)
    count = good.sum(axis=0)
    total = np.where(good, seeing.sigmas, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.sqrt(np.maximum(count, 1)), np.nan)


def outlier_fraction(seeing) -> float:
    """The share of the pixels compared whose mean over frames is beyond 3 sigma; noise alone: 0.003."""
    values = whitened_means(seeing)
    good = values[np.isfinite(values)]
    return float(np.mean(np.abs(good) > OUTLIER_SIGMA)) if len(good) else 0.0
