"""What the pictures of a verdict share: recordings before and after, which of them are drawn, and their words."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.residuals import condition, plain

WIDTH = 9.6  # inches
MOST = 4  # conditions that are drawn
BEYOND = 3.0  # sigma
MANY = 0.01  # share of pixels beyond it from which noise is not all; of noise alone it is 0.003
RARE = 0.01  # share of noise-only data; the simulations of a test are too few to tell smaller ones
SURE = 0.001  # chance of so many rare tests together from which structure is claimed
CHANCE = 6.0  # sigma up to which the largest difference of a recording may be noise: among so many places it gets to 5
NEAR = 1e-3  # m from the contact, or from the centre line, over which T(x) is averaged
HEADS = {
    "what_is_wrong": "What is wrong",
    "not_noise": "It is not noise",
    "missing": "What is missing",
    "why": "Why this cause",
    "else": "Could it be something else",
    "gained": "What we gained",
}
SOUND = {
    "what_is_wrong": "Measured against computed",
    "not_noise": "Is it noise",
    "missing": "Is any heat missing",
}
ORDER = ("sidewall", "wake", "profile", "points")


@dataclass(frozen=True)
class Pair:
    """A recording against the calibrated base and, if there is one, the extended model; `words` of its condition."""

    before: Any
    after: Any
    words: str

    @property
    def recording(self):
        """What was measured."""
        return self.before.view.recording


def every(verdict) -> list[list[Pair]]:
    """All recordings, those of one condition together."""
    views = [s.view for s in verdict.before]
    if not views:
        return []
    shared = {k for k in set().union(*(v.given for v in views)) if len({repr(v.given.get(k)) for v in views}) == 1}
    after = dict(enumerate(verdict.after)) if len(verdict.after) == len(verdict.before) else {}
    groups: dict[str, list[Pair]] = {}
    for i, s in enumerate(verdict.before):
        own = {k: v for k, v in s.view.given.items() if k not in shared}
        words = condition(own or s.view.given)
        groups.setdefault(repr(sorted(s.view.given.items(), key=lambda item: item[0])), []).append(
            Pair(s, after.get(i), words)
        )
    return list(groups.values())


def difference(pair: Pair) -> float:
    """The largest structured difference (K) of a recording."""
    at = pair.before.largest
    value = abs(at.K) if at is not None else pair.before.rmse_K
    return float(value) if np.isfinite(value) else 0.0


def stands_out(seeing) -> bool:
    """Whether the largest structured difference of a recording is more than noise reaches among so many places."""
    return seeing.largest is not None and abs(seeing.largest.sigma) > CHANCE


def shown(verdict) -> list[list[Pair]]:
    """At most MOST conditions, those with the largest differences, with one recording of every view."""
    groups = every(verdict)
    most = sorted(range(len(groups)), key=lambda i: -max(difference(p) for p in groups[i]))[:MOST]
    out = []
    for i in sorted(most):
        own = [[p for p in groups[i] if p.recording.view == view] for view in ORDER]
        out.append([max(some, key=difference) for some in own if some])
    return out


def choice(verdict) -> str:
    """Which conditions are drawn, where that is not all of them; else nothing."""
    groups, drawn = every(verdict), shown(verdict)
    if len(groups) == len(drawn):
        return ""
    names = "; ".join(g[0].words for g in drawn)
    return f"Drawn are the {len(drawn)} of {len(groups)} conditions with the largest differences: {names}."


def by_view(groups: list[list[Pair]]) -> dict[str, list[Pair]]:
    """The recordings of every view, in the order of the conditions."""
    flat = [p for g in groups for p in g]
    return {view: own for view in ORDER if (own := [p for p in flat if p.recording.view == view])}


# --- figures ----------------------------------------------------------------------------------------
def head(verdict, name: str) -> str:
    """The heading of a picture, which for a sound model claims no fault."""
    if name in SOUND and (verdict.kind == "none_needed" or (name == "not_noise" and not noisy(verdict))):
        return SOUND[name]
    return "What was tried" if name == "why" and not verdict.causes else HEADS[name]


def noisy(verdict) -> bool:
    """Whether maps or tests show that what the base leaves is more than noise; true where neither was made."""
    maps = [beyond(p.before) for g in shown(verdict) for p in g if p.recording.places is None]
    tests = [t for t in verdict.tests if t.stage == "before"]
    return not (maps or tests) or structure(tests)[1] or max(maps, default=0.0) > MANY


def structure(tests: list) -> tuple[int, bool]:
    """How many tests are as rare as RARE in noise alone, and whether so many cannot be chance."""
    from scipy.stats import binom

    count = sum(t.p <= RARE for t in tests)
    return count, bool(count and binom.sf(count - 1, len(tests), RARE) < SURE)


def titled(verdict, words: str, width: float, height: float) -> Figure:
    """An empty figure (inches) that says what it shows and of which campaign."""
    fig = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    text = textwrap.shorten(f"{words}: {verdict.title}", round(11 * width), placeholder=" ...")
    fig.suptitle(plain(text), x=0.01, ha="left")
    return fig


def told(text: str) -> str:
    """A condition as its overrides were written, in words with units; what is no such list stays as it is.

    >>> told("contact.pressure = 150000, schedule.speed = 0.1"), told("the case")
    ('contact pressure 0.15 MPa, speed 0.1 m/s', 'the case')
    """
    parts = [part.partition(" = ") for part in text.split(", ")]
    if not all(equals for _, equals, _ in parts):
        return text
    return condition({key: _value(value) for key, _, value in parts})


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def narrow(text: str, width: int = 19) -> str:
    """Text for the space beside a picture, broken into lines."""
    return plain(textwrap.fill(text, width))


def beside(ax, text: str) -> None:
    """Words at the left of a picture, clear of its numbers."""
    ax.annotate(
        text, (0.0, 0.5), (-40, 0), xycoords="axes fraction", textcoords="offset points", ha="right", va="center",
        fontsize=7.0,
    )  # fmt: skip


def name(key: str) -> str:
    """An effect or a parameter for a label.

    >>> name("third_body"), name("friction.mu")
    ('third body', 'friction mu')
    """
    return plain(key if " " in key else key.replace("_", " ").replace(".", " "))


# --- numbers ----------------------------------------------------------------------------------------
def rows(seeing) -> np.ndarray:
    """Rows of an image that hold anything and are nearest the contact (side wall) or the centre line (wake)."""
    seen = np.flatnonzero(np.isfinite(seeing.residual).any(axis=(0, 2)))
    if not len(seen):
        return np.arange(len(seeing.view.recording.v))
    away = np.abs(seeing.view.recording.v[seen])
    return seen[away <= away.min() + NEAR]


def where(seeing) -> str:
    """The rows of T(x) in words."""
    recording = seeing.view.recording
    if recording.view == "profile":
        return "along the block"
    v = 1e3 * recording.v[rows(seeing)]
    axis = "z" if recording.view == "sidewall" else "y"
    return f"mean of {axis} = {theme.number(v[0], 2)} to {theme.number(v[-1], 2)} mm".replace("-", "−")


def line(seeing, values: np.ndarray, frame: int) -> np.ndarray:
    """T(x) (nu,) in degC of one frame of images (frames, nv, nu): mean of `rows`, NaN where nothing is compared."""
    some = rows(seeing)
    good = np.isfinite(seeing.residual[frame, some])
    count = good.sum(axis=0)
    total = np.where(good, values[frame, some], 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def hottest(seeing, frames: np.ndarray) -> int:
    """The frame, of some, that is computed to be hottest."""
    seen = np.isfinite(seeing.residual).any(axis=0)
    heat = np.where(seen, seeing.predicted[frames], 0.0).sum(axis=(1, 2))
    return int(frames[np.argmax(heat)])


def ends(seeing) -> dict[int, int]:
    """The hottest frame of the first and of the last repetition, by the number of the repetition."""
    told = seeing.view.recording.repetition
    return {int(n): hottest(seeing, np.flatnonzero(told == n)) for n in np.unique(told)[[0, -1]]}


def means(seeing) -> np.ndarray:
    """Means over frames (nv, nu) of the whitened differences, of unit variance where only noise is left."""
    good = np.isfinite(seeing.sigmas)
    count = good.sum(axis=0)
    total = np.where(good, seeing.sigmas, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.sqrt(np.maximum(count, 1)), np.nan)


def beyond(seeing) -> float:
    """The share of the pixels compared whose mean over frames is beyond 3 sigma; noise alone: 0.003."""
    values = means(seeing)
    good = values[np.isfinite(values)]
    return float(np.mean(np.abs(good) > BEYOND)) if len(good) else 0.0
