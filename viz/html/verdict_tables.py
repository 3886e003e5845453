"""Tables of the verdict report: rules, inputs, tests, candidates, gains and priors; long tables are folded."""

from __future__ import annotations

import math

from flashtemp.discovery.diagnostics.rule_sentences import describe_rule, explain_uncertainty
from flashtemp.discovery.verdict import CandidateReport, InputResult, RuleResult, StructureTest, Verdict
from flashtemp.display import format_count
from flashtemp.viz import key_labels
from flashtemp.viz.html import page
from flashtemp.viz.number_format import (
    detectable_amplitude,
    effect_label,
    flatten_dict,
    format_number,
    format_probability,
    format_ratio,
    format_value,
    format_with_error,
    needed_amplitude,
    score_and_basis,
    unit_suffix,
)
from flashtemp.viz.verdict import plot_helpers

MIN_PULL_OPEN = 1.0  # prior standard deviations; smaller deviations are folded
FIT_METRICS = (
    ("rmse_K", "root mean square difference, noise included (K)"), ("mean_map_rmse_K", "of means over frames (K)"),
    ("near_contact_rmse_K", "of means over frames, near the contact (K)"), ("chi2_per_dof", "chi2/dof (–)"),
    ("held_out_rmse_K", "left-out data (K)"), ("held_out_z", "left-out data, in sigma (–)"),
)  # fmt: skip


# --- why this verdict -------------------------------------------------------------------------------
def rule_table(v: Verdict) -> list[str]:
    """The rules that led to the verdict, with the consequence of each that failed, and a note on uncertainty."""
    if not v.rules:
        return []
    rows = [_rule_row(r) for r in v.rules]
    head = ["rule", "measured by", "value", "limit", "result"]
    uncertain = explain_uncertainty(v)
    return [page.table(head, rows), *([page.paragraph(uncertain)] if uncertain else [])]


def _rule_row(r: RuleResult) -> list[str]:
    words = describe_rule(r.name)
    result = "passed" if r.passed else words.fails or r.consequence
    if not words.measured_by:  # a rule without a number: yes or no
        return [words.passes, "–", "–", "–", result]
    limit = f"{'≤' if words.is_upper else '≥'}\N{NO-BREAK SPACE}{format_number(r.limit)}"
    return [words.passes, words.measured_by, format_number(r.value + 0.0), limit, result]  # no negative zero


# --- stated inputs against the data ------------------------------------------------------------------
def input_tables(v: Verdict) -> list[str]:
    """Stated inputs that the data contradict, confirm, cannot check, or cannot distinguish from each other."""
    if not v.inputs:
        return []
    contradicted = sorted((i for i in v.inputs if i.verdict == "contradicted"), key=lambda i: -i.ln_bayes)
    consistent = sorted((i for i in v.inputs if i.verdict == "consistent"), key=lambda i: -abs(i.pull))
    unchecked = [i.key for i in v.inputs if i.verdict == "not checkable"]
    out = [_inputs_table(contradicted)] if contradicted else [page.paragraph("The data contradict no stated input.")]
    if consistent:
        out.append(page.fold_section(f"{format_count(len(consistent), 'stated input')} consistent with the data",
                             [_inputs_table(consistent)]))  # fmt: skip
    if unchecked:
        out.append(page.paragraph(f"These data cannot check: {', '.join(unchecked)}."))
    if v.inputs_told_together:
        groups = "; ".join(" and ".join(group) for group in v.inputs_told_together)
        out.append(page.paragraph(f"These data cannot distinguish from each other: {groups}."))
    return out


def _inputs_table(inputs: list[InputResult]) -> str:
    head = [
        "stated input",
        "key",
        "stated value",
        "stated uncertainty",
        "value from the data",
        "standard deviations away",
        "ln Bayes factor",
    ]
    return page.table(head, [_input_row(i) for i in inputs])


def _input_row(i: InputResult) -> list[str]:
    label = key_labels.describe_key(i.key, i.unit)
    unit = f" {label.unit}" if label.unit else ""
    sd = (
        f"{format_number(100 * i.sd)} %"
        if i.relative
        else format_number(i.sd) + unit_suffix("K" if i.unit == "degC" else i.unit)
    )
    data = format_with_error(label.factor * i.estimate, label.factor * i.stderr, "1")
    return [
        i.words,
        i.key,
        f"{format_number(label.factor * i.stated)}{unit}",
        f"{sd}, {i.source}",
        f"{data}{unit}",
        format_number(abs(i.pull)),
        format_number(i.ln_bayes),
    ]


# --- tests for structure ------------------------------------------------------------------------------------
def noise_section(v: Verdict) -> list[str]:
    """The residuals compared with noise, by maps and by tests; the table of tests is folded."""
    out = [page.paragraph(line) for line in (*_describe_maps(v), *_count_tests(v))]
    if not v.tests:
        return [*out, page.paragraph("No tests for structure were run.", "small")]
    models = {"before": "base", "after": "extended"}
    rows = [
        [t.name, t.where, models.get(t.stage, t.stage), format_number(t.statistic), _p_value(t)]
        for t in sorted(v.tests, key=lambda t: (t.stage != "before", t.p))
    ]
    table = page.table(["test for structure", "recording", "model", "statistic", "p, simulated"], rows)
    return [*out, page.fold_section(f"All {len(rows)} tests for structure", [table])]


def _p_value(t: StructureTest) -> str:
    """The p value of a test; an upper limit if no simulated data set is beyond its statistic."""
    p = format_probability(t.p)
    return f"≤\N{NO-BREAK SPACE}{p}" if t.is_p_limited and not p.startswith("below") else p


def _describe_maps(v: Verdict) -> list[str]:
    """The largest fraction of pixels beyond 3 sigma in the maps drawn, for each model."""
    lines = []
    imaged = [p for g in plot_helpers.select_recordings(v) for p in g if p.recording.places is None]
    for stage, model in (("before", "base"), ("after", "extended model")):
        results = [r for r in (getattr(p, stage) for p in imaged) if r is not None]
        if results:
            worst = max(results, key=plot_helpers.outlier_fraction)
            percent = format_number(100 * plot_helpers.outlier_fraction(worst))
            lines.append(f"{percent} % with the {model} ({worst.view.file})")
    return [f"Pixels beyond ±3 sigma, at most: {', '.join(lines)}; with noise alone 0.3 %."] if lines else []


def _count_tests(v: Verdict) -> list[str]:
    """How many tests find the residuals of each model unlike noise, and what that means."""
    out = []
    for stage, model in (("before", "base"), ("after", "extended model")):
        tests = [t for t in v.tests if t.stage == stage]
        if tests:
            count, is_structure = plot_helpers.count_rare_tests(tests)
            if not is_structure:
                meaning = "noise alone can explain this"
            elif plot_helpers.are_residuals_small(tests):
                meaning = "the residuals are smaller than the stated noise, or the data are not independent"
            else:
                meaning = "this is structure, not noise"
            out.append(
                f"In the residuals of the {model}, {count} of {len(tests)} tests give results that occur in at most "
                f"1 % of simulated noise: {meaning}."
            )
    return out


# --- candidates ---------------------------------------------------------------------------------------
def rival_tables(v: Verdict) -> list[str]:
    """The candidates that were not accepted, best first; those that do not make the data more probable are folded."""
    accepted = {c.effect for c in v.causes}
    rivals = sorted((r for r in v.rivals if r.effect not in accepted), key=lambda r: -r.score)
    if not rivals:
        return [page.paragraph("No other candidate was tried.", "small")]
    tried = [r for r in rivals if score_and_basis(r)[1] != "not tried"]
    likely = [r for r in tried if r.score > 0 or r.effect in v.group]
    out = [_candidate_table(likely)] if likely else [page.paragraph("No other candidate makes the data more probable.")]
    unlikely, untried = [r for r in tried if r not in likely], [r for r in rivals if r not in tried]
    if unlikely:
        words = f"{format_count(len(unlikely), 'candidate')} that would not make the data more probable"
        out.append(page.fold_section(words, [_candidate_table(unlikely)]))
    if untried:
        rows = [[effect_label(r.effect), r.reason.removeprefix("not tried: ")] for r in untried]
        words = f"{format_count(len(untried), 'effect')} not tried"
        out.append(page.fold_section(words, [page.table(["effect", "reason"], rows)]))
    return out


def _candidate_table(candidates: list[CandidateReport]) -> str:
    head = [
        "candidate",
        "required amplitude",
        "ln Bayes factor",
        "basis",
        "below the accepted cause",
        "distinctness",
        "reason for rejection",
    ]
    rows = [
        [
            effect_label(r.effect),
            needed_amplitude(r),
            *score_and_basis(r),
            "–" if r.left is None else format_number(r.left),
            f"{r.distinctness:.2f}",
            r.reason,
        ]
        for r in candidates
    ]
    return page.table(head, rows)


# --- gain of the extension ----------------------------------------------------------------------------------
def gain_tables(v: Verdict) -> list[str]:
    """Fit metrics of the base and the extended model, and the parameters that changed."""
    out = []
    if v.base is not None:
        models = [m for m in (v.base, v.extended) if m is not None]
        rows = [
            [words, *((format_number if key.endswith("K") else format_ratio)(getattr(m, key)) for m in models)]
            for key, words in FIT_METRICS
        ]
        rows = [r for r in rows if any(cell not in ("–", "0") for cell in r[1:])]
        out.append(page.table(["measure", "base", "extended"][: 1 + len(models)], rows))
    for c in v.causes:
        gain = f"{effect_label(c.effect)}: left-out data become more probable by {format_number(c.held_out_gain)} (ln)"
        out.append(page.paragraph(f"{gain}; chi2 lower by {format_number(c.delta_chi2)}.", "small"))
    if v.shifts:
        rows = [[n, format_number(b), format_number(a), format_number(s)] for n, b, a, s in v.shifts]
        out.append(page.table(["calibrated parameter", "base", "extended", "standard error"], rows))
    return out


# --- priors, limits and convergence -----------------------------------------------------------------------------------
def prior_tables(v: Verdict) -> list[str]:
    """Prior standard deviations, and the calibrated values in units of them."""
    out = []
    if v.assumed:
        rows = [[n, format_number(s)] for n, s in v.assumed.items()]
        table = page.table(["quantity", "prior standard deviation"], rows)
        out.append(page.fold_section("Assumed prior knowledge (relative where no unit is given)", [table]))
    far = [p for p in v.nuisance if abs(p.pull) >= MIN_PULL_OPEN]
    near = [p for p in v.nuisance if p not in far]
    for parameters, fold in ((far, False), (near, True)):
        rows = [
            [p.name, format_with_error(p.value, p.stderr, p.unit), f"{p.pull:+.1f}".replace("-", "−")]
            for p in parameters
        ]
        table = page.table(["calibrated", "value ± standard error", "deviation in prior sigma"], rows)
        title = f"{format_count(len(parameters), 'calibrated value')} within one prior sigma"
        out += [page.fold_section(title, [table]) if fold else table] if parameters else []
    return out


def detection_limits(v: Verdict) -> list[str]:
    """The smallest amplitude of each effect that these data would show at 5 sigma."""
    limited = [r for r in v.rivals if math.isfinite(r.detectable)]
    if not limited:
        return [page.paragraph("Detection limits were not computed.")]
    rows = [
        [
            effect_label(r.effect),
            r.parameter or "amplitude",
            detectable_amplitude(r),
            f"{format_number(100 * r.raw_share)} %",
        ]
        for r in limited
    ]
    head = ["effect", "parameter", "detectable at 5 sigma", "signal remaining after calibration"]
    return [
        page.paragraph("Smaller amplitudes may be present: these data would not show them at 5 sigma."),
        page.fold_section(format_count(len(rows), "effect"), [page.table(head, rows)]),
    ]


def adequacy_table(v: Verdict) -> list[str]:
    """The adequacy tests that are not among the rules of the verdict."""
    shown, rows = {r.name for r in v.rules}, []
    for name, (value, limit) in v.gates.items():
        if name not in shown:
            words = describe_rule(name)
            passed = "no" if value > limit else "yes"
            rows.append([words.passes, words.measured_by, format_number(value), format_number(limit), passed])
    return [page.table(["adequacy test", "measured by", "value", "limit", "passed"], rows)] if rows else []


def convergence_section(v: Verdict) -> list[str]:
    """Whether the calibration converged, with its steps folded."""
    if not v.certificate:
        return [page.paragraph("The convergence of the calibration was not recorded.")]
    rows = [[effect_label(k), format_value(value)] for k, value in flatten_dict(v.certificate)]
    table = page.table(["calibration", "value"], rows)
    converged = v.certificate.get("converged")
    if converged is None:
        return [table]
    words = "converged: another step would change no result noticeably" if converged else "did not converge"
    return [page.paragraph(f"The calibration {words}."), page.fold_section("Steps of the calibration", [table])]


def parameter_table(c) -> list[str]:
    """The parameters of a cause with their 95 % intervals."""
    rows = [
        [
            p.name,
            format_with_error(p.value, p.stderr, p.unit),
            f"{format_number(p.ci95[0])} to {format_number(p.ci95[1])}{unit_suffix(p.unit)}"
            if p.ci95[1] > p.ci95[0]
            else "–",
            "yes: the interval is unreliable" if p.bound else "no",
        ]
        for p in c.parameters
    ]
    return [page.table(["parameter", "value ± standard error", "95 % interval", "at its bound"], rows)] if rows else []
