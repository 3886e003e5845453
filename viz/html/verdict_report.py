"""HTML report of a verdict: the answer, one picture, a list of contents, then reasons, pictures and details."""

from __future__ import annotations

import math
from html import escape
from pathlib import Path

from flashtemp.comparison.campaign import Campaign
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.quantity_format import is_within_noise
from flashtemp.discovery.verdict import Cause, Verdict
from flashtemp.display import atomic_write
from flashtemp.viz import key_labels
from flashtemp.viz.html import page, title_page, verdict_tables
from flashtemp.viz.html.page import ReportSubject
from flashtemp.viz.number_format import effect_label, format_number, format_ratio, needed_amplitude

MIN_VISIBLE_GAIN = 0.005  # fraction of the root mean square difference; a smaller gain is invisible in three digits
ANSWERS_BY_KIND = {
    "named": ("The missing effect is identified", "good"),
    "learned": ("A law outside the catalogue is learned from the data", "good"),
    "held_key": ("A stated input differs from what the data require", "near"),
    "weak": ("A missing effect is likely, but the evidence is weak", "near"),
    "group": ("An effect is missing; these data cannot distinguish which of several", "near"),
    "none_needed": ("No extension is needed", "good"),
    "unexplained": ("Not explained: neither the model nor a candidate describes the data", "bad"),
    "no_verdict": ("No verdict: the calibration is not reliable", "bad"),
}
SETUP_ANSWERS_BY_KIND = {  # where no effect is missing
    "named": "The set-up differs from what is stated",
    "group": "The set-up differs from what is stated; these data cannot distinguish how",
}
INPUT_OR_EFFECT_ANSWER = "An effect is missing or a stated input is wrong; these data cannot distinguish which"
ODDS_NAMED = float(f"{math.exp(CRITERIA.ln_bayes_named):.1g}")
VERDICT_METHOD = (
    "The model as stated, the base, is calibrated to all recordings that are not held out. Free are: {free}. All other "
    "stated numbers, and the place, scale and gain of every image, move within what was known of them. Each candidate "
    "of the catalogue is then added to the base, scored by its sensitivities, and simulated in full if it is likely. "
    f"An effect is named as a cause from a ln Bayes factor of {CRITERIA.ln_bayes_named:g}, if data that no fit has "
    "used confirm it and no other effect explains them as well. Tests for structure in the residuals and the rules "
    "below decide whether the verdict is certain."
)
VERDICT_TERMS = (
    ("Base", "The model as stated, with its uncertain parameters calibrated to these data."),
    ("Extended", "The base with the accepted causes, calibrated again."),
    (
        "ln Bayes factor",
        "Natural logarithm of the ratio of two probabilities: that of the data with the effect, and that without it. "
        f"The model is calibrated in both. From {CRITERIA.ln_bayes_named:g}, a ratio of about "
        f"{ODDS_NAMED:g}, a cause is identified; from {CRITERIA.ln_bayes_hint:g} it is reported as a hint.",
    ),
    ("95 % interval", "Range that contains the true value in 19 of 20 such campaigns, if the model is right."),
    ("Distinctness", "Difference between the signature of an effect and those of all others: 0 equal, 1 orthogonal."),
    (
        "Full fit, sensitivities",
        "A full fit simulates the effect. Its sensitivities, from small changes, predict the result of a full fit.",
    ),
    (
        "Left-out data",
        "Recordings that no fit has used, or each condition predicted from the others. A model that is merely more "
        "flexible does not predict them better.",
    ),
    ("Detectable", "The amplitude that these data would show at 5 sigma. A smaller one can be present undetected."),
    ("p", "Fraction of simulated noise-only data sets in which the test result is at least as extreme."),
    ("chi2/dof", "Mean square of the differences in units of the noise: 1 where noise explains everything."),
    (
        "Standard deviations away",
        "Difference between a stated input and the value from the data alone, divided by the combined uncertainty.",
    ),
)
LAW_CAPTION = (
    "The learned law with its 95 % band. Points are the nodes of learned.py, with straight lines between them; a "
    "pressure is scaled to a mean of 1. The thin line is the case as stated."
)
VERDICT_STYLE = """
.answer { font-size: 1.25rem; font-weight: 600; } .verdict .says { margin: .5rem 0; }
.key { font-size: .95rem; } .key table { font-size: .9rem; margin: .3rem 0 .8rem; }
td.text { min-width: 11rem; max-width: 30rem; }
@media print { .answer { font-size: 12pt; } .key table { font-size: 8pt; } }
"""


def write_report(verdict: Verdict, path, subject: ReportSubject | None = None) -> Path:
    """Write the report of a verdict as one HTML file with embedded pictures; returns its path."""
    path = Path(path)
    with atomic_write(path) as unfinished:
        unfinished.write_text(render_report(verdict, subject), encoding="utf-8")
    return path


def render_report(verdict: Verdict, subject: ReportSubject | None = None) -> str:
    """The whole text of the HTML file; with a `subject` it has a title page and a section on reproducibility."""
    title = f"{verdict.title}: search for missing effects"
    pictures = _picture_sections(verdict) if _is_calibrated(verdict) else []
    result = _result_parts(verdict)
    sections = [
        *([page.Section("result", "Result", result)] if result else []),
        *pictures[:1],
        *_reason_sections(verdict),
        *pictures[1:],
        *_detail_sections(verdict),
    ]
    return page.render_report(title, _answer_box(verdict), subject, sections, VERDICT_STYLE)


def describe_method(campaign: Campaign, command: str) -> ReportSubject:
    """The subject of the report: the campaign, and how causes are named."""
    free = ", ".join(key_labels.describe_key(k).words for k in campaign.free)
    method = VERDICT_METHOD.format(free=free or "none")
    return title_page.describe_campaign(campaign, campaign.load({}), command, method)


def _is_calibrated(v: Verdict) -> bool:
    """Whether the base model was calibrated."""
    return v.kind != "no_verdict" or v.base is not None


# --- the answer -------------------------------------------------------------------------------------
def _answer_box(v: Verdict) -> list[str]:
    """The answer in a sentence, and what the verdict says."""
    words, grade = _grade_answer(v)
    says = "\n".join(f'<p class="says">{escape(line)}</p>' for line in v.says)
    return [f'<div class="verdict {grade}">\n<p class="answer">{escape(words)}</p>\n{says}\n</div>']


def _result_parts(v: Verdict) -> list[str]:
    """Causes with their parameters, and the gain of the extension."""
    if v.kind == "no_verdict":
        known = "There are no results to show." if v.base is None else "The sections below show the results so far."
        return [page.paragraph(f"No cause can be identified until the calibration converges. {known}")]
    out: list[str] = []
    for cause in v.causes:
        out += _describe_cause(cause)
    if v.group:
        out.append(f"<p>Not distinguishable: <b>{escape(', '.join(effect_label(g) for g in v.group))}</b>.</p>")
        rows = [
            [effect_label(r.effect), needed_amplitude(r), format_number(r.score), f"{r.distinctness:.2f}"]
            for r in v.rivals
            if r.effect in v.group
        ]
        head = ["effect", "required amplitude", "ln Bayes factor", "distinctness"]
        out += [page.table(head, rows)] if rows else []
    out += [f"<p>{escape(line)}</p>" for line in _describe_gain(v)]
    return ['<div class="key">', *out, "</div>"] if out else []


def _grade_answer(v: Verdict) -> tuple[str, str]:
    """The answer and its grade; an answer that hardly changes the computed signal is not graded "good"."""
    words, grade = ANSWERS_BY_KIND[v.kind]
    effects = [c for c in v.causes if not c.laboratory]
    if not effects and any(c.laboratory for c in v.causes):
        words = SETUP_ANSWERS_BY_KIND.get(v.kind, words)
    elif v.kind == "group" and any("." in name for name in v.group):  # a key of the case or of a view
        words = INPUT_OR_EFFECT_ANSWER
    elif v.kind == "named" and len(effects) > 1:
        words = f"{len(effects)} missing effects are identified"
    if v.kind in ("named", "learned") and _is_negligible(v):
        signal = "temperatures" if _has_temperatures(v) else "friction"
        return f"{words}, but it hardly changes the computed {signal}", "near"
    return words, grade


def _has_temperatures(v: Verdict) -> bool:
    """Whether the campaign has recordings of temperature, not only of friction."""
    return v.base is not None and math.isfinite(v.base.rmse_K)


def _is_negligible(v: Verdict) -> bool:
    """Whether no root mean square difference falls visibly: fitted, means over frames, near contact, left-out.

    For friction alone, the difference in units of the noise is compared.
    """
    if v.base is None or v.extended is None:
        return False
    if not _has_temperatures(v):
        before, after = (math.sqrt(m.chi2_per_dof) for m in (v.base, v.extended))
        return not before - after > MIN_VISIBLE_GAIN * before
    pairs = [
        (getattr(v.base, key), getattr(v.extended, key))
        for key in ("rmse_K", "mean_map_rmse_K", "near_contact_rmse_K", "held_out_rmse_K")
    ]
    return all(not b - e > MIN_VISIBLE_GAIN * b for b, e in pairs if math.isfinite(b) and math.isfinite(e))


def _describe_cause(c: Cause) -> list[str]:
    """An accepted cause in a sentence, and the table of its parameters."""
    words = f"{c.words[:1].upper()}{c.words[1:]}" if c.words else effect_label(c.effect)
    line = f"<p><b>{escape(words)}</b> ({escape(effect_label(c.effect))}); ln Bayes factor {format_number(c.ln_bayes)},"
    line += f" distinctness {c.distinctness:.2f}.</p>"
    return [line, *verdict_tables.parameter_table(c)]


def _describe_gain(v: Verdict) -> list[str]:
    """The change made by the extension and its gain, in sentences."""
    if v.base is None:
        return []
    b, e = v.base, v.extended
    if e is None:
        if not math.isfinite(b.rmse_K):
            return [f"chi2/dof of the base is {format_ratio(b.chi2_per_dof)}."]
        line = f"The root mean square difference of the base is {format_number(b.rmse_K)} K"
        line += f" (chi2/dof {format_ratio(b.chi2_per_dof)})"
        if math.isfinite(b.held_out_rmse_K):
            line += f", on left-out data {format_number(b.held_out_rmse_K)} K"
        return [f"{line}."]
    ratios = f"{format_ratio(b.chi2_per_dof)} to {format_ratio(e.chi2_per_dof)}"
    if not math.isfinite(b.rmse_K):  # a campaign of load cells alone
        return [*_describe_extension(v), f"With the extension, chi2/dof goes from {ratios}."]
    fitted = _describe_change(b.rmse_K, e.rmse_K, e.rmse_change_error_K)
    line = f"With the extension, the root mean square of the differences, noise included, {fitted}"
    line += f" (chi2/dof {ratios})"
    if math.isfinite(b.near_contact_rmse_K) and math.isfinite(e.near_contact_rmse_K):
        near_contact = _describe_change(b.near_contact_rmse_K, e.near_contact_rmse_K)
        line += f", that of means over frames near the contact {near_contact}"
    if math.isfinite(b.held_out_rmse_K) and math.isfinite(e.held_out_rmse_K):
        left_out = _describe_change(b.held_out_rmse_K, e.held_out_rmse_K, e.held_out_change_error_K)
        line += f", that of left-out data {left_out}"
    return [*_describe_extension(v), f"{line}."]


def _describe_change(before: float, after: float, error: float = math.nan) -> str:
    """A change from `before` to `after` (K) in words; "stays" where it rounds to zero or is within its `error`."""
    if format_number(before) == format_number(after):
        return f"stays at {format_number(before)} K"
    if is_within_noise(before, after, error):
        return f"stays the same ({format_number(before)} K and {format_number(after)} K, within noise)"
    return f"{'falls' if after < before else 'grows'} from {format_number(before)} K to {format_number(after)} K"


def _describe_extension(v: Verdict) -> list[str]:
    """The largest change by the extension after recalibration, in a sentence."""
    if not v.gain or not v.gain.get("file"):
        return []
    percent = f"{format_number(100 * v.gain['share'])} % of its temperature rise"
    size = f"{format_number(v.gain['changed_K'])} K root mean square ({percent})"
    line = f"After recalibration the extension changes {v.gain['file']} by {size}, more than any other recording"
    change = v.gain.get("friction", 0.0)
    return [f"{line}, and the friction by {format_number(100 * change)} %." if change >= 1e-3 else f"{line}."]


# --- sections ---------------------------------------------------------------------------------------
def _reason_sections(v: Verdict) -> list[page.Section]:
    """The rules behind the verdict, and the check of the stated inputs."""
    sections = [
        page.Section("rules", "Why this verdict", verdict_tables.rule_table(v)),
        page.Section("inputs", "Stated inputs against the data", verdict_tables.input_tables(v)),
    ]
    return [section for section in sections if section.parts]


def _picture_sections(v: Verdict) -> list[page.Section]:
    """A section per picture, with the picture or the reason for its absence and tables; a learned law first."""
    from flashtemp.viz.html import alt_text
    from flashtemp.viz.verdict import plot_helpers, verdict_figures

    figures = verdict_figures.draw_figures(v)
    tables = {
        "what_is_wrong": _selection_note,
        "not_noise": verdict_tables.noise_section,
        "else": verdict_tables.rival_tables,
        "gained": verdict_tables.gain_tables,
    }
    out = _law_section(v, figures)
    for count, name in enumerate(verdict_figures.PICTURE_CAPTIONS, 1):
        parts = [page.paragraph(verdict_figures.ABSENCE_REASONS[name])]
        if name in figures:
            alt, caption = alt_text.describe_picture(v, name), verdict_figures.choose_caption(v, name)
            parts = [page.embed_figure(figures[name], alt, caption)]
        parts += tables[name](v) if name in tables else []
        heading = f"{count}. {plot_helpers.picture_heading(v, name)}"
        out.append(page.Section(name.replace("_", "-"), heading, parts))
    return out


def _law_section(v: Verdict, figures) -> list[page.Section]:
    """The section of a learned law; none where no law was learned."""
    law = v.law
    if law is None or "law" not in figures:
        return []
    argument_unit, unit = ("" if u == "1" else f" {u}" for u in (law.argument_unit, law.unit))

    def describe(i: int) -> str:
        band = f"({format_number(law.low[i])} to {format_number(law.high[i])}){unit}"
        return f"{format_number(law.curve[i])} {band} at {format_number(law.at[i])}{argument_unit}"

    first, last = describe(0), describe(-1)
    picture = page.embed_figure(figures["law"], f"{law.words}: {first}, {last}", LAW_CAPTION)
    return [page.Section("law", f"{law.words[0].upper()}{law.words[1:]}", [picture])]


def _selection_note(v: Verdict) -> list[str]:
    """Which conditions are drawn, where not all are."""
    from flashtemp.viz.verdict import plot_helpers

    return [page.paragraph(words, "small") for words in [plot_helpers.describe_selection(v)] if words]


def _detail_sections(v: Verdict) -> list[page.Section]:
    """The next experiment, and the details behind the verdict."""
    calibrated = _is_calibrated(v)
    warnings = [page.paragraph("None.")]
    if v.warnings:
        warnings = ["<ul>", *(f"<li>{escape(w)}</li>" for w in v.warnings), "</ul>"]
    time_spent = [page.paragraph(f"Computed in {format_number(v.seconds)} s.", "small")] if v.seconds else []
    known = verdict_tables.prior_tables(v) if calibrated else []
    sections = [
        page.Section("next", "What to measure next", [page.paragraph(v.next_experiment)] if v.next_experiment else []),
        page.Section("warnings", "Warnings", warnings),
        page.Section("checked", "Adequacy tests", verdict_tables.adequacy_table(v)),
        page.Section("known", "Prior knowledge and calibrated values", known),
        page.Section("unseen", "Detection limits", verdict_tables.detection_limits(v) if calibrated else []),
        page.Section(
            "certificate", "Convergence of the calibration", [*verdict_tables.convergence_section(v), *time_spent]
        ),
        page.Section("reading", "Terms", [page.term_list(VERDICT_TERMS)] if calibrated else []),
    ]
    return [section for section in sections if section.parts]
