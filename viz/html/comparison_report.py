"""One HTML file about a comparison: verdicts in words, an overview, a list of the rest, tables and pictures."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from flashtemp.comparison.compare import (
    WHITE_NOISE_LIMIT_SDS,
    Comparison,
    ForceComparison,
    RecordingComparison,
    summary_line,
)
from flashtemp.comparison.noise import ResidualPeak
from flashtemp.display import atomic_write, format_count
from flashtemp.solver.run import Run
from flashtemp.viz.html import page

MAX_FILES_IN_ALT_TEXT = 6  # files whose size of differences the words of a picture tell
CHI2_NEAR_NOISE = 1.5  # chi2/dof up to which a difference is about as large as the noise
UPWARD_NAMES = {"sidewall": "z", "wake": "y", "profile": "", "points": ""}
BODY_NAMES = {"sidewall": "the block", "wake": "the road", "profile": "the block", "points": "the place"}
COMPARISON_TERMS = (
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
     f" ±{WHITE_NOISE_LIMIT_SDS:g} something is left that noise does not do, even where chi2/dof is near 1."),
    ("Largest structured difference", "The mean of five by five pixels of one frame that stands out most from noise;"
     " a square marks it. Among so many places noise alone reaches about 5 sigma."),
    ("Bands", "Blue bands show what noise alone would do to a mean or a reading, two standard errors to either side;"
     " red dots lie beyond."),
)  # fmt: skip


def write_report(comparison: Comparison, path) -> Path:
    """Write one self-contained HTML file about a comparison, pictures inside; returns its path."""
    path = Path(path)
    with atomic_write(path) as fresh:
        fresh.write_text(render_report(comparison), encoding="utf-8")
    return path


def render_report(comparison: Comparison) -> str:
    """The whole text of the HTML file."""
    from flashtemp.viz.measurement.comparison import draw_summary

    title = f"Measured against computed: {comparison.campaign.title}"
    sizes = [f"{s.view.file} {s.rmse_K:.2g} K" for s in comparison.recordings[:MAX_FILES_IN_ALT_TEXT]]
    sizes += [f"{p.force.file} {p.rmse:.2g}" for p in comparison.forces[:MAX_FILES_IN_ALT_TEXT]]
    overview = f"Root mean square, mean and chi2/dof of all differences: {'; '.join(sizes)}"
    more = [
        ("files", "File by file", _list_findings(comparison)),
        ("numbers", "Numbers", _make_tables(comparison)),
        ("pictures", "Pictures", _make_pictures(comparison)),
        ("reading", "How to read this", [page.term_list(COMPARISON_TERMS)]),
    ]
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="small">Case {escape(str(comparison.campaign.case.name))}; {_count_files(comparison)}.</p>',
        page.heading("What was found", "found"),
        *_worst_recording(comparison),
        page.embed_figure(
            draw_summary(comparison), overview, "Size of the differences and how they compare with noise."
        ),
        page.contents_list([(mark, head) for mark, head, _ in more] + _file_marks(comparison)),
        *(line for mark, head, parts in more for line in (page.heading(head, mark), *parts)),
    ]
    return page.render_page(title, body)


def _worst_recording(comparison: Comparison) -> list[str]:
    """The recording that is explained worst: a sentence, and the frame where it differs most."""
    from flashtemp.viz.measurement.comparison import draw_images

    if not comparison.recordings:
        return [_finding_paragraph(p.force.file, *judge_friction(p)) for p in comparison.forces]
    s = max(comparison.recordings, key=lambda s: s.chi2_per_dof if s.pixels else np.inf)
    told = [_finding_paragraph(s.view.file, *judge_recording(s))]
    if not s.pixels:
        return told
    others = len(comparison.recordings) - 1
    caption = "Where measured and computed differ most" + (
        f"; the other {others} recordings differ less." * (others > 1)
    )
    return [
        *told,
        page.embed_figure(
            draw_images(s, _runs_by_view(comparison).get(id(s.view)), only=True), judge_recording(s)[0], caption
        ),
    ]


def _list_findings(comparison: Comparison) -> list[str]:
    """A sentence about every file, its numbers and cautions below."""
    out = [
        _finding_paragraph(s.view.file, *judge_recording(s), summary_line(s), _list_cautions(s))
        for s in comparison.recordings
    ]
    return out + [_finding_paragraph(p.force.file, *judge_friction(p), _friction_numbers(p)) for p in comparison.forces]


def _count_files(comparison: Comparison) -> str:
    """How much was compared, and how well the simulations conserve energy."""
    recordings, traces = len(comparison.recordings), len(comparison.forces)
    line = f"{format_count(recordings, 'recording')}, {format_count(traces, 'load-cell trace')}"
    if comparison.runs:
        line += f"; energy imbalance of the simulations at most {max(r.energy_imbalance for r in comparison.runs):.1e}"
    return escape(line)


# --- verdicts ---------------------------------------------------------------------------------------
def judge_recording(s: RecordingComparison) -> tuple[str, str]:
    """A recording in one sentence for people, and how good that is: "good", "near" or "bad"."""
    if not s.pixels:
        return "Nothing could be compared: no pixel lies well inside what was simulated.", "bad"
    times = f"{np.sqrt(s.chi2_per_dof):.2g} times"
    if s.is_white and s.chi2_per_dof <= CHI2_NEAR_NOISE:
        return "The model explains this recording: what is left is noise of the camera.", "good"
    if s.is_white:
        return f"What is left has no structure but is {times} the noise: is the noise stated too small?", "near"
    if s.chi2_per_dof <= CHI2_NEAR_NOISE:
        return f"The differences are hardly larger than the noise, but not random: {_describe_largest(s)}.", "near"
    return (
        f"The model does not explain this recording; the differences are {times} the noise: {_describe_largest(s)}.",
        "bad",
    )


def _describe_largest(s: RecordingComparison) -> str:
    """Where the block or road differs most, in words."""
    if s.largest is None:
        return "they are correlated"
    sign = "hotter" if s.largest.K > 0 else "colder"
    what = BODY_NAMES[s.view.recording.view]
    return f"most of all, {what} is measured {abs(s.largest.K):.2g} K {sign} than computed at {describe_place(s, s.largest)}"


def describe_place(s: RecordingComparison, at: ResidualPeak) -> str:
    """A place and time of a recording: mm, s."""
    up, points = UPWARD_NAMES[s.view.recording.view], s.view.recording.places
    where = f"x = {1e3 * at.u:.3g} mm" + (f", {up} = {1e3 * at.v:.3g} mm" if up else "")
    where = where if points is None else f"point {points.names[round(at.u)]}"
    return f"{where}, t = {at.time:.4g} s (repetition {at.repetition})"


def _list_cautions(s: RecordingComparison) -> list[str]:
    """What else a reader of one recording must know."""
    out = []
    if s.shift_refused is not None:
        out.append(
            f"A shift of the image by {_format_pair(s.shift_refused)} px would hide part of the difference, but its place is"
            " stated to be known better: the image was left where it is. Either physics is missing or that statement"
            " is wrong."
        )
    if s.noise.estimated:
        names = {"white": "of the pixels", "pattern": "that stays in all frames"}
        what = " and ".join(names[n] for n in s.noise.estimated)
        out.append(f"The noise {what} is not stated in the file and was estimated from the data.")
    return out


def judge_friction(p: ForceComparison) -> tuple[str, str]:
    """A load-cell trace in one sentence for people, and how good that is."""
    if not np.isfinite(p.bias):
        return "Nothing could be compared: no reading was taken while the block slides.", "bad"
    white = all(abs(s) < WHITE_NOISE_LIMIT_SDS for _, s in p.correlation.values())
    if p.chi2_per_dof <= CHI2_NEAR_NOISE:
        if white:
            return "The model explains the friction: what is left is noise of the load cell.", "good"
        return "The friction differs hardly more than the noise, but not at random.", "near"
    sign = "higher" if p.bias > 0 else "lower"
    return f"Friction is measured {sign} than computed by {abs(p.bias):.2g} on average.", "bad"


def _friction_numbers(p: ForceComparison) -> str:
    return f"mu differs by {p.rmse:.4f} rms, {p.bias:+.4f} on average, chi2/dof {p.chi2_per_dof:.3g}"


def _finding_paragraph(
    file: str, sentence: str, grade: str, numbers: str = "", cautions: list[str] | None = None
) -> str:
    """One verdict as a paragraph with a coloured edge, numbers and cautions in a fold."""
    more = [page.paragraph(line, "small") for line in (numbers, *(cautions or [])) if line]
    fold = "\n" + page.fold_section("numbers", more) if more else ""
    return f'<div class="verdict {grade}">\n<p><b>{escape(file)}</b>: {escape(sentence)}</p>{fold}\n</div>'


# --- tables -----------------------------------------------------------------------------------------
def _make_tables(comparison: Comparison) -> list[str]:
    """Numbers of all recordings and of all load-cell traces."""
    out = []
    if comparison.recordings:
        head = ["recording", "condition", "frames", "RMSE (K)", "bias (K)", "chi2/dof (–)", "white noise (K)",
                "fixed pattern (K)", "image shift u, v (px)", "correlation of neighbours in sigma",
                "largest structured difference"]  # fmt: skip
        out.append(page.table(head, [_recording_row(s) for s in comparison.recordings]))
    if comparison.forces:
        head = ["load cell", "condition", "readings", "RMSE (–)", "bias (–)", "chi2/dof (–)", "noise (–)",
                "correlation in time in sigma"]  # fmt: skip
        rows = [
            [_file_label(p.force), _condition_label(p.force), str(int(np.isfinite(p.residual).sum())), f"{p.rmse:.4f}",
             f"{p.bias:+.4f}", f"{p.chi2_per_dof:.3g}",
             f"{p.sigma:.3g}{'' if p.force.sigma else ' estimated'}", f"{p.correlation['time'][1]:+.1f}"]
            for p in comparison.forces
        ]  # fmt: skip
        out.append(page.table(head, rows))
    return out


def _recording_row(s: RecordingComparison) -> list[str]:
    """A recording in the table."""
    names = {"u": "x", "v": UPWARD_NAMES[s.view.recording.view], "time": "time"}
    known = [f"{names[k]} {v[1]:+.1f}" for k, v in s.correlation.items() if names[k]]
    level = [f"{getattr(s.noise, n):.3g}{' estimated' if n in s.noise.estimated else ''}" for n in ("white", "pattern")]
    shift = (
        f"{_format_pair(s.shift)} ± {', '.join(f'{e:.2f}' for e in s.shift_error)}" if any(s.shift_error) else "none"
    )
    if s.shift_refused is not None:
        shift = f"none; {_format_pair(s.shift_refused)} refused"
    at = s.largest
    largest = f"{at.K:+.2f} K, {at.sigma:+.0f} sigma at {describe_place(s, at)}" if at else "none"
    return [
        _file_label(s.view), _condition_label(s.view), str(s.view.recording.frames), f"{s.rmse_K:.3f}", f"{s.bias_K:+.3f}",
        f"{s.chi2_per_dof:.3g}", *level, shift, ", ".join(known), largest,
    ]  # fmt: skip


def _file_label(entry) -> str:
    return entry.file + (" (held out)" if entry.held_out else "")


def _condition_label(entry) -> str:
    from flashtemp.viz.measurement.residual_plots import describe_condition

    return describe_condition(entry.given)


def _format_pair(values) -> str:
    return ", ".join(f"{v:+.2f}" for v in values)


# --- pictures ---------------------------------------------------------------------------------------
def _file_marks(comparison: Comparison) -> list[tuple[str, str]]:
    """Mark and name of every file whose pictures are shown."""
    entries = [s.view for s in comparison.recordings] + [p.force for p in comparison.forces]
    return [(f"file-{i}", _file_label(entry)) for i, entry in enumerate(entries, 1)]


def _make_pictures(comparison: Comparison) -> list[str]:
    """Every picture with its caption, file by file."""
    from flashtemp.viz.measurement import comparison as draw

    runs, marks = _runs_by_view(comparison), iter(_file_marks(comparison))
    out = []
    for s in comparison.recordings:
        run, (mark, name) = runs.get(id(s.view)), next(marks)
        seen = "Measured, computed and their difference in K" + (
            "" if s.view.recording.is_single_row else " and in sigma; grey: dead pixels and what is not compared"
        )
        mean = f"Mean differences of {s.view.file} along its axes and in time: {s.bias_K:+.2g} K on average"
        out += [
            page.heading(name, mark, level=3),
            page.embed_figure(
                draw.draw_images(s, run), f"Frames of {s.view.file}. {judge_recording(s)[0]}", f"{seen}."
            ),
            page.embed_figure(draw.draw_mean_residuals(s, run), mean, "Where and when the differences lie."),
        ]
    for p in comparison.forces:
        words = "Friction coefficient measured and computed, and the difference."
        mark, name = next(marks)
        out.append(page.heading(name, mark, level=3))
        out.append(
            page.embed_figure(draw.draw_friction(p), f"Friction of {p.force.file}. {judge_friction(p)[0]}", words)
        )
    return out


def _runs_by_view(comparison: Comparison) -> dict[int, Run]:
    """The run of every view by its identity, as far as runs are kept."""
    groups = comparison.campaign.conditions
    return {id(v): run for c, run in zip(groups, comparison.runs, strict=False) for v in c.views}
