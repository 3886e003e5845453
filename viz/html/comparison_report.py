"""HTML report of a comparison: main result, overview, findings for each file, tables and pictures."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flashtemp.comparison.campaign import LoadCellEntry, RecordingEntry
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
from flashtemp.viz.html import page, title_page
from flashtemp.viz.html.page import ReportSubject

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_FILES_IN_ALT_TEXT = 6  # files listed in the alternative text of the overview
CHI2_NEAR_NOISE = 1.5  # chi2/dof up to which a residual counts as about as large as the noise
UPWARD_NAMES = {"sidewall": "z", "wake": "y", "profile": "", "points": ""}
BODY_NAMES = {"sidewall": "the block", "wake": "the road", "profile": "the block", "points": "the place"}
COMPARISON_METHOD = (
    "Each condition is simulated with the stated case, without any fit to these data. The computed temperatures are "
    "what the camera would report: imaged by its own pixels, optics, exposure and arithmetic. The difference is "
    "measured minus computed, in kelvin and in units of the noise of one pixel. An image is shifted only as far as "
    "the stated uncertainty of its position allows."
)
COMPARISON_TERMS = (
    (
        "Computed",
        "What the camera would report if the model were right: the simulated temperatures as imaged by the camera's "
        "own pixels, optics, exposure and arithmetic. The model was not fitted to these data. The one exception is a "
        "small shift of each image, where the file states how well the image's position is known. A larger shift is "
        "not applied.",
    ),
    (
        "Difference",
        "Measured minus computed. Red (positive): measured hotter than computed. Blue: colder. RMSE is its root mean "
        "square, bias its mean.",
    ),
    (
        "Sigma",
        "The difference in units of the noise of one pixel, after correction for the fixed pattern of the camera. "
        "With noise alone, 19 of 20 pixels are within ±2 sigma.",
    ),
    (
        "chi2/dof",
        "Mean square of the differences in sigma. Near 1: noise explains everything. 4: the differences are twice as "
        "large as the noise. Where the noise was estimated from the same data, a value near 1 is weaker evidence.",
    ),
    (
        "Whiteness",
        "White noise is uncorrelated between neighbouring pixels and successive frames. Both correlations are given "
        f"in standard errors. Beyond ±{WHITE_NOISE_LIMIT_SDS:g} the differences have structure, even where chi2/dof "
        "is near 1.",
    ),
    (
        "Largest structured difference",
        "The mean of five by five pixels of one frame that exceeds the noise most; a square marks it. Among so many "
        "places, noise alone reaches about 5 sigma.",
    ),
    (
        "Bands",
        "Blue bands show the effect of noise alone on a mean or a reading, two standard errors to either side. Red "
        "dots are outside.",
    ),
)


def write_report(comparison: Comparison, path, subject: ReportSubject | None = None) -> Path:
    """Write the report of a comparison as one HTML file with embedded pictures; returns its path."""
    path = Path(path)
    with atomic_write(path) as unfinished:
        unfinished.write_text(render_report(comparison, subject), encoding="utf-8")
    return path


def render_report(comparison: Comparison, subject: ReportSubject | None = None) -> str:
    """The whole text of the HTML file; with a `subject` it has a title page and a section on reproducibility."""
    from flashtemp.viz.measurement.comparison import draw_summary

    title = f"{comparison.campaign.title}: measured against computed"
    sizes = [f"{s.view.file} {s.rmse_K:.2g} K" for s in comparison.recordings[:MAX_FILES_IN_ALT_TEXT]]
    sizes += [f"{p.force.file} {p.rmse:.2g}" for p in comparison.forces[:MAX_FILES_IN_ALT_TEXT]]
    overview = f"Root mean square, mean and chi2/dof of all differences: {'; '.join(sizes)}"
    findings, figures = _worst_recording(comparison)
    answer = [
        f'<p class="small">Case {escape(str(comparison.campaign.case.name))}; {_count_files(comparison)}.</p>',
        page.heading("Main result", "found"),
    ]
    figures.append(
        page.embed_figure(draw_summary(comparison), overview, "Size of the differences, compared with the noise.")
    )
    sections = [
        page.Section("largest", "Largest difference", figures),
        page.Section("files", "Result for each file", _list_findings(comparison)),
        page.Section("numbers", "Numbers", _make_tables(comparison)),
        page.Section("pictures", "Pictures", []),
        *_picture_sections(comparison),
        page.Section("reading", "Terms", [page.term_list(COMPARISON_TERMS)]),
    ]
    return page.render_report(title, [*answer, *findings], subject, sections)


def describe_method(comparison: Comparison, command: str) -> ReportSubject:
    """The subject of the report: what was compared, and how the prediction was computed."""
    campaign = comparison.campaign
    return title_page.describe_campaign(campaign, campaign.load({}), command, COMPARISON_METHOD)


def _worst_recording(comparison: Comparison) -> tuple[list[str], list[str]]:
    """The recording with the largest chi2/dof: a sentence, and the frame with its largest difference."""
    if not comparison.recordings:
        return [_finding_paragraph(p.force.file, *judge_friction(p)) for p in comparison.forces], []
    s = find_worst_recording(comparison)
    finding = [_finding_paragraph(s.view.file, *judge_recording(s))]
    if not s.pixels:
        return finding, []
    others = len(comparison.recordings) - 1
    caption = "Frame with the largest difference" + (
        f"; the other {others} recordings differ less." if others > 1 else ""
    )
    return finding, [page.embed_figure(draw_largest_difference(comparison, s), judge_recording(s)[0], caption)]


def find_worst_recording(comparison: Comparison) -> RecordingComparison:
    """The recording with the largest chi2/dof, one in which nothing could be compared before all others."""
    return max(comparison.recordings, key=lambda s: s.chi2_per_dof if s.pixels else np.inf)


def draw_largest_difference(comparison: Comparison, s: RecordingComparison) -> Figure:
    """The frame of a recording with its largest difference: measured, computed and their difference."""
    from flashtemp.viz.measurement.comparison import draw_images

    return draw_images(s, _runs_by_view(comparison).get(id(s.view)), only=True)


def write_picture(comparison: Comparison, path: Path) -> None:
    """Write the picture of the largest difference of all recordings; none where no pixel is compared."""
    from flashtemp.viz.theme import save_figure

    if comparison.recordings and (s := find_worst_recording(comparison)).pixels:
        save_figure(draw_largest_difference(comparison, s), path)


def _list_findings(comparison: Comparison) -> list[str]:
    """A sentence about each file, with its numbers and cautions folded below."""
    out = [
        _finding_paragraph(s.view.file, *judge_recording(s), summary_line(s), _list_cautions(s))
        for s in comparison.recordings
    ]
    return out + [_finding_paragraph(p.force.file, *judge_friction(p), _friction_numbers(p)) for p in comparison.forces]


def _count_files(comparison: Comparison) -> str:
    """Number of files compared, and the energy imbalance of the simulations."""
    recordings, load_cells = len(comparison.recordings), len(comparison.forces)
    line = f"{format_count(recordings, 'recording')}, {format_count(load_cells, 'load-cell file')}"
    if comparison.runs:
        line += f"; energy imbalance of the simulations at most {max(r.energy_imbalance for r in comparison.runs):.1e}"
    return escape(line)


# --- findings ---------------------------------------------------------------------------------------
def judge_recording(s: RecordingComparison) -> tuple[str, str]:
    """The agreement of a recording in one sentence, and its grade: "good", "near" or "bad"."""
    if not s.pixels:
        return "Nothing could be compared: no pixel is well inside the simulated region.", "bad"
    times = f"{np.sqrt(s.chi2_per_dof):.2g} times"
    if s.is_white and s.chi2_per_dof <= CHI2_NEAR_NOISE:
        return "The model explains this recording: the difference is noise of the camera.", "good"
    if s.is_white:
        return f"The difference has no structure but is {times} the noise: the stated noise may be too small.", "near"
    if s.chi2_per_dof <= CHI2_NEAR_NOISE:
        return f"The differences are about as large as the noise but not random: {_describe_largest(s)}.", "near"
    largest = _describe_largest(s)
    return f"The model does not explain this recording. The differences are {times} the noise: {largest}.", "bad"


def _describe_largest(s: RecordingComparison) -> str:
    """The largest structured difference in words: body, size, place and time."""
    if s.largest is None:
        return "they are correlated"
    sign = "hotter" if s.largest.K > 0 else "colder"
    what = BODY_NAMES[s.view.recording.view]
    place = describe_place(s, s.largest)
    return f"at the largest, {what} is measured {abs(s.largest.K):.2g} K {sign} than computed at {place}"


def describe_place(s: RecordingComparison, at: ResidualPeak) -> str:
    """Place (mm, or the name of a point), time (s) and repetition in words."""
    up, points = UPWARD_NAMES[s.view.recording.view], s.view.recording.places
    where = f"x = {1e3 * at.u:.3g} mm" + (f", {up} = {1e3 * at.v:.3g} mm" if up else "")
    where = where if points is None else f"point {points.names[round(at.u)]}"
    return f"{where}, t = {at.time:.4g} s (repetition {at.repetition})"


def _list_cautions(s: RecordingComparison) -> list[str]:
    """Remarks on a recording: a shift that was not applied, noise that was estimated."""
    out = []
    if s.shift_refused is not None:
        out.append(
            f"A shift of the image by {_format_pair(s.shift_refused)} px would hide part of the difference. It exceeds "
            "the stated uncertainty of the image's position and was not applied. Either an effect is missing or the "
            "stated uncertainty is too small."
        )
    if s.noise.estimated:
        names = {"white": "of the pixels", "pattern": "that stays in all frames"}
        what = " and ".join(names[n] for n in s.noise.estimated)
        out.append(f"The noise {what} is not stated in the file and was estimated from the data.")
    return out


def judge_friction(p: ForceComparison) -> tuple[str, str]:
    """The agreement of a load-cell time series in one sentence, and its grade."""
    if not np.isfinite(p.bias):
        return "Nothing could be compared: no reading was taken while the block slides.", "bad"
    white = all(abs(s) < WHITE_NOISE_LIMIT_SDS for _, s in p.correlation.values())
    if p.chi2_per_dof <= CHI2_NEAR_NOISE:
        if white:
            return "The model explains the friction: the difference is noise of the load cell.", "good"
        return "The differences in friction are about as large as the noise but not random.", "near"
    sign = "higher" if p.bias > 0 else "lower"
    return f"The measured friction is {sign} than computed by {abs(p.bias):.2g} on average.", "bad"


def _friction_numbers(p: ForceComparison) -> str:
    return f"mu differs by {p.rmse:.4f} rms, {p.bias:+.4f} on average, chi2/dof {p.chi2_per_dof:.3g}"


def _finding_paragraph(
    file: str, sentence: str, grade: str, numbers: str = "", cautions: list[str] | None = None
) -> str:
    """A finding as a paragraph with an edge in the colour of its grade; numbers and cautions are folded."""
    more = [page.paragraph(line, "small") for line in (numbers, *(cautions or [])) if line]
    fold = "\n" + page.fold_section("Numbers and remarks", more) if more else ""
    return f'<div class="verdict {grade}">\n<p><b>{escape(file)}</b>: {escape(sentence)}</p>{fold}\n</div>'


# --- tables -----------------------------------------------------------------------------------------
def _make_tables(comparison: Comparison) -> list[str]:
    """Tables of all recordings and of all load-cell time series."""
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
    """The row of a recording in the table."""
    names = {"u": "x", "v": UPWARD_NAMES[s.view.recording.view], "time": "time"}
    known = [f"{names[k]} {v[1]:+.1f}" for k, v in s.correlation.items() if names[k]]
    level = [f"{getattr(s.noise, n):.3g}{' estimated' if n in s.noise.estimated else ''}" for n in ("white", "pattern")]
    shift = (
        f"{_format_pair(s.shift)} ± {', '.join(f'{e:.2f}' for e in s.shift_error)}" if any(s.shift_error) else "none"
    )
    if s.shift_refused is not None:
        shift = f"none; {_format_pair(s.shift_refused)} not applied"
    peak = s.largest
    largest = f"{peak.K:+.2f} K, {peak.sigma:+.0f} sigma at {describe_place(s, peak)}" if peak else "none"
    return [
        _file_label(s.view),
        _condition_label(s.view),
        str(s.view.recording.frames),
        f"{s.rmse_K:.3f}",
        f"{s.bias_K:+.3f}",
        f"{s.chi2_per_dof:.3g}",
        *level,
        shift,
        ", ".join(known),
        largest,
    ]


def _file_label(entry) -> str:
    return entry.file + (" (held out)" if entry.held_out else "")


def _condition_label(entry) -> str:
    from flashtemp.viz.key_labels import describe_condition

    return describe_condition(entry.given)


def _format_pair(values) -> str:
    return ", ".join(f"{v:+.2f}" for v in values)


# --- pictures ---------------------------------------------------------------------------------------
def _picture_sections(comparison: Comparison) -> list[page.Section]:
    """The pictures of every file with their captions, in a subsection for each file."""
    runs = _runs_by_view(comparison)
    pictures: list[tuple[RecordingEntry | LoadCellEntry, list[str]]] = [
        (s.view, _recording_pictures(s, runs.get(id(s.view)))) for s in comparison.recordings
    ]
    pictures += [(p.force, _friction_pictures(p)) for p in comparison.forces]
    return [
        page.Section(f"file-{i}", _file_label(entry), parts, level=3) for i, (entry, parts) in enumerate(pictures, 1)
    ]


def _recording_pictures(s: RecordingComparison, run: Run | None) -> list[str]:
    """The frames of a recording, and its mean differences."""
    from flashtemp.viz.measurement import comparison as draw

    more = "" if s.view.recording.is_single_row else " and in sigma; grey: dead pixels and pixels that are not compared"
    caption = f"Measured, computed and their difference in K{more}."
    frames = f"Frames of {s.view.file}. {judge_recording(s)[0]}"
    mean = f"Mean differences of {s.view.file} along its axes and in time: {s.bias_K:+.2g} K on average"
    return [
        page.embed_figure(draw.draw_images(s, run), frames, caption),
        page.embed_figure(draw.draw_mean_residuals(s, run), mean, "Mean differences by position and time."),
    ]


def _friction_pictures(p: ForceComparison) -> list[str]:
    """The friction coefficient of a load-cell file."""
    from flashtemp.viz.measurement import comparison as draw

    caption = "Friction coefficient measured and computed, and the difference."
    return [page.embed_figure(draw.draw_friction(p), f"Friction of {p.force.file}. {judge_friction(p)[0]}", caption)]


def _runs_by_view(comparison: Comparison) -> dict[int, Run]:
    """{id of a recording entry: its run}, for the runs that are kept."""
    groups = comparison.campaign.conditions
    return {id(v): run for c, run in zip(groups, comparison.runs, strict=False) for v in c.views}
