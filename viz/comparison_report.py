"""One HTML file about a comparison: verdicts in words, an overview, a list of the rest, tables and pictures."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from flashtemp.comparison.compare import SURE, Comparison, Pulling, Seeing, words
from flashtemp.comparison.noise import Place
from flashtemp.showing import several, whole_file
from flashtemp.solver.run import Run
from flashtemp.viz import html

TOLD = 6  # files whose size of differences the words of a picture tell
CLOSE = 1.5  # chi2/dof up to which a difference is about as large as the noise
UP = {"sidewall": "z", "wake": "y", "profile": "", "points": ""}
BODY = {"sidewall": "the block", "wake": "the road", "profile": "the block", "points": "the place"}
READING = (
    ("Computed", "What the camera would have reported if the model were right: the simulated temperatures seen through"
     " the camera's own pixels, optics, exposure and arithmetic. The model was not fitted to these data. The one"
     " exception is a small shift of the whole image, one per recording, where the file says how well the image's"
     " place is known; a shift beyond that is refused."),
    ("Difference", "Measured minus computed. Red (positive): measured hotter than computed. Blue: colder. RMSE is its"
     " root mean square, bias its mean."),
    ("Sigma", "The same difference in units of the noise of one pixel, after the pattern that the camera itself leaves"
     " in all frames has been allowed for. Noise alone stays within ±2 sigma in 19 of 20 pixels."),
    ("chi2/dof", "Mean square of the differences in sigma. Near 1: noise explains everything. 4: the differences are"
     " twice as large as noise. Where the noise was estimated from the data themselves, a value near 1 says less."),
    ("Whiteness", "Noise is as likely up as down, whatever its neighbour does. The correlation of neighbouring pixels"
     " and of successive frames tests this; it is given in standard errors, and beyond"
     f" ±{SURE:g} something is left that noise does not do, even where chi2/dof is near 1."),
    ("Largest structured difference", "The mean of five by five pixels of one frame that stands out most from noise;"
     " a square marks it. Among so many places noise alone reaches about 5 sigma."),
    ("Bands", "Blue bands show what noise alone would do to a mean or a reading, two standard errors to either side;"
     " red dots lie beyond."),
)  # fmt: skip


def write(comparison: Comparison, path) -> Path:
    """Write one self-contained HTML file about a comparison, pictures inside; returns its path."""
    path = Path(path)
    with whole_file(path) as fresh:
        fresh.write_text(text(comparison), encoding="utf-8")
    return path


def text(comparison: Comparison) -> str:
    """The whole text of the HTML file."""
    from flashtemp.viz.comparison import summary

    title = f"Measured against computed: {comparison.campaign.title}"
    sizes = [f"{s.view.file} {s.rmse_K:.2g} K" for s in comparison.seeings[:TOLD]]
    sizes += [f"{p.force.file} {p.rmse:.2g}" for p in comparison.pullings[:TOLD]]
    overview = f"Root mean square, mean and chi2/dof of all differences: {'; '.join(sizes)}"
    more = [
        ("files", "File by file", _findings(comparison)),
        ("numbers", "Numbers", _tables(comparison)),
        ("pictures", "Pictures", _pictures(comparison)),
        ("reading", "How to read this", [html.terms(READING)]),
    ]
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="small">Case {escape(str(comparison.campaign.case.name))}; {_counted(comparison)}.</p>',
        html.heading("What was found", "found"),
        *_worst(comparison),
        html.figure(summary(comparison), overview, "Size of the differences and how they compare with noise."),
        html.contents([(mark, head) for mark, head, _ in more] + _files(comparison)),
        *(line for mark, head, parts in more for line in (html.heading(head, mark), *parts)),
    ]
    return html.whole(title, body)


def _worst(comparison: Comparison) -> list[str]:
    """The recording that is explained worst: a sentence, and the frame where it differs most."""
    from flashtemp.viz.comparison import images

    if not comparison.seeings:
        return [_finding(p.force.file, *grip(p)) for p in comparison.pullings]
    s = max(comparison.seeings, key=lambda s: s.chi2_per_dof if s.pixels else np.inf)
    told = [_finding(s.view.file, *verdict(s))]
    if not s.pixels:
        return told
    others = len(comparison.seeings) - 1
    caption = "Where measured and computed differ most" + (
        f"; the other {others} recordings differ less." * (others > 1)
    )
    return [*told, html.figure(images(s, _runs(comparison).get(id(s.view)), only=True), verdict(s)[0], caption)]


def _findings(comparison: Comparison) -> list[str]:
    """A sentence about every file, its numbers and cautions below."""
    out = [_finding(s.view.file, *verdict(s), words(s), _cautions(s)) for s in comparison.seeings]
    return out + [_finding(p.force.file, *grip(p), _mu(p)) for p in comparison.pullings]


def _counted(comparison: Comparison) -> str:
    """How much was compared, and how well the simulations conserve energy."""
    recordings, traces = len(comparison.seeings), len(comparison.pullings)
    line = f"{several(recordings, 'recording')}, {several(traces, 'load-cell trace')}"
    if comparison.runs:
        line += f"; energy imbalance of the simulations at most {max(r.energy_imbalance for r in comparison.runs):.1e}"
    return escape(line)


# --- verdicts ---------------------------------------------------------------------------------------
def verdict(s: Seeing) -> tuple[str, str]:
    """A recording in one sentence for people, and how good that is: "good", "near" or "bad"."""
    if not s.pixels:
        return "Nothing could be compared: no pixel lies well inside what was simulated.", "bad"
    times = f"{np.sqrt(s.chi2_per_dof):.2g} times"
    if s.white and s.chi2_per_dof <= CLOSE:
        return "The model explains this recording: what is left is noise of the camera.", "good"
    if s.white:
        return f"What is left has no structure but is {times} the noise: is the noise stated too small?", "near"
    if s.chi2_per_dof <= CLOSE:
        return f"The differences are hardly larger than the noise, but not random: {_most(s)}.", "near"
    return f"The model does not explain this recording; the differences are {times} the noise: {_most(s)}.", "bad"


def _most(s: Seeing) -> str:
    """Where the block or road differs most, in words."""
    if s.largest is None:
        return "they are correlated"
    sign = "hotter" if s.largest.K > 0 else "colder"
    what = BODY[s.view.recording.view]
    return f"most of all, {what} is measured {abs(s.largest.K):.2g} K {sign} than computed at {place(s, s.largest)}"


def place(s: Seeing, at: Place) -> str:
    """A place and time of a recording: mm, s."""
    up, points = UP[s.view.recording.view], s.view.recording.places
    where = f"x = {1e3 * at.u:.3g} mm" + (f", {up} = {1e3 * at.v:.3g} mm" if up else "")
    where = where if points is None else f"point {points.names[round(at.u)]}"
    return f"{where}, t = {at.time:.4g} s (repetition {at.repetition})"


def _cautions(s: Seeing) -> list[str]:
    """What else a reader of one recording must know."""
    out = []
    if s.shift_refused is not None:
        out.append(
            f"A shift of the image by {_pair(s.shift_refused)} px would hide part of the difference, but its place is"
            " stated to be known better: the image was left where it is. Either physics is missing or that statement"
            " is wrong."
        )
    if s.noise.estimated:
        names = {"white": "of the pixels", "pattern": "that stays in all frames"}
        what = " and ".join(names[n] for n in s.noise.estimated)
        out.append(f"The noise {what} is not stated in the file and was estimated from the data.")
    return out


def grip(p: Pulling) -> tuple[str, str]:
    """A load-cell trace in one sentence for people, and how good that is."""
    if not np.isfinite(p.bias):
        return "Nothing could be compared: no reading was taken while the block slides.", "bad"
    white = all(abs(s) < SURE for _, s in p.correlation.values())
    if p.chi2_per_dof <= CLOSE:
        if white:
            return "The model explains the friction: what is left is noise of the load cell.", "good"
        return "The friction differs hardly more than the noise, but not at random.", "near"
    sign = "higher" if p.bias > 0 else "lower"
    return f"Friction is measured {sign} than computed by {abs(p.bias):.2g} on average.", "bad"


def _mu(p: Pulling) -> str:
    return f"mu differs by {p.rmse:.4f} rms, {p.bias:+.4f} on average, chi2/dof {p.chi2_per_dof:.3g}"


def _finding(file: str, sentence: str, grade: str, numbers: str = "", cautions: list[str] | None = None) -> str:
    """One verdict as a paragraph with a coloured edge, numbers and cautions in a fold."""
    more = [html.paragraph(line, "small") for line in (numbers, *(cautions or [])) if line]
    fold = "\n" + html.fold("numbers", more) if more else ""
    return f'<div class="verdict {grade}">\n<p><b>{escape(file)}</b>: {escape(sentence)}</p>{fold}\n</div>'


# --- tables -----------------------------------------------------------------------------------------
def _tables(comparison: Comparison) -> list[str]:
    """Numbers of all recordings and of all load-cell traces."""
    out = []
    if comparison.seeings:
        head = ["recording", "condition", "frames", "RMSE (K)", "bias (K)", "chi2/dof (–)", "white noise (K)",
                "fixed pattern (K)", "image shift u, v (px)", "correlation of neighbours in sigma",
                "largest structured difference"]  # fmt: skip
        out.append(html.table(head, [_row(s) for s in comparison.seeings]))
    if comparison.pullings:
        head = ["load cell", "condition", "readings", "RMSE (–)", "bias (–)", "chi2/dof (–)", "noise (–)",
                "correlation in time in sigma"]  # fmt: skip
        rows = [
            [_file(p.force), _given(p.force), str(int(np.isfinite(p.residual).sum())), f"{p.rmse:.4f}",
             f"{p.bias:+.4f}", f"{p.chi2_per_dof:.3g}",
             f"{p.sigma:.3g}{'' if p.force.sigma else ' estimated'}", f"{p.correlation['time'][1]:+.1f}"]
            for p in comparison.pullings
        ]  # fmt: skip
        out.append(html.table(head, rows))
    return out


def _row(s: Seeing) -> list[str]:
    """A recording in the table."""
    names = {"u": "x", "v": UP[s.view.recording.view], "time": "time"}
    known = [f"{names[k]} {v[1]:+.1f}" for k, v in s.correlation.items() if names[k]]
    level = [f"{getattr(s.noise, n):.3g}{' estimated' if n in s.noise.estimated else ''}" for n in ("white", "pattern")]
    shift = f"{_pair(s.shift)} ± {', '.join(f'{e:.2f}' for e in s.shift_error)}" if any(s.shift_error) else "none"
    if s.shift_refused is not None:
        shift = f"none; {_pair(s.shift_refused)} refused"
    at = s.largest
    largest = f"{at.K:+.2f} K, {at.sigma:+.0f} sigma at {place(s, at)}" if at else "none"
    return [
        _file(s.view), _given(s.view), str(s.view.recording.frames), f"{s.rmse_K:.3f}", f"{s.bias_K:+.3f}",
        f"{s.chi2_per_dof:.3g}", *level, shift, ", ".join(known), largest,
    ]  # fmt: skip


def _file(entry) -> str:
    return entry.file + (" (held out)" if entry.held_out else "")


def _given(entry) -> str:
    from flashtemp.viz.residuals import condition

    return condition(entry.given)


def _pair(values) -> str:
    return ", ".join(f"{v:+.2f}" for v in values)


# --- pictures ---------------------------------------------------------------------------------------
def _files(comparison: Comparison) -> list[tuple[str, str]]:
    """Mark and name of every file whose pictures are shown."""
    entries = [s.view for s in comparison.seeings] + [p.force for p in comparison.pullings]
    return [(f"file-{i}", _file(entry)) for i, entry in enumerate(entries, 1)]


def _pictures(comparison: Comparison) -> list[str]:
    """Every picture with its caption, file by file."""
    from flashtemp.viz import comparison as draw

    runs, marks = _runs(comparison), iter(_files(comparison))
    out = []
    for s in comparison.seeings:
        run, (mark, name) = runs.get(id(s.view)), next(marks)
        seen = "Measured, computed and their difference in K" + (
            "" if s.view.recording.line else " and in sigma; grey: dead pixels and what is not compared"
        )
        mean = f"Mean differences of {s.view.file} along its axes and in time: {s.bias_K:+.2g} K on average"
        out += [
            html.heading(name, mark, level=3),
            html.figure(draw.images(s, run), f"Frames of {s.view.file}. {verdict(s)[0]}", f"{seen}."),
            html.figure(draw.along(s, run), mean, "Where and when the differences lie."),
        ]
    for p in comparison.pullings:
        words = "Friction coefficient measured and computed, and the difference."
        mark, name = next(marks)
        out.append(html.heading(name, mark, level=3))
        out.append(html.figure(draw.force(p), f"Friction of {p.force.file}. {grip(p)[0]}", words))
    return out


def _runs(comparison: Comparison) -> dict[int, Run]:
    """The run of every view by its identity, as far as runs are kept."""
    groups = comparison.campaign.conditions
    return {id(v): run for c, run in zip(groups, comparison.runs, strict=False) for v in c.views}
