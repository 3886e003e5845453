"""Tables of a verdict's report: rules, inputs, tests, candidates, gains, prior knowledge; long ones are folded."""

from __future__ import annotations

import math

from flashtemp.discovery.diagnostics.verdict_sentences import describe_rule, explain_uncertainty
from flashtemp.discovery.verdict import CandidateReport, InputResult, RuleResult, Verdict
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

MIN_PULL_OPEN = 1.0  # prior standard deviations, from which a calibrated number is not folded
FIT_METRICS = (
    ("rmse_K", "root mean square difference, noise included (K)"), ("mean_map_rmse_K", "of means over frames (K)"),
    ("near_contact_rmse_K", "of means over frames, near the contact (K)"), ("chi2_per_dof", "chi2/dof (–)"),
    ("held_out_rmse_K", "left-out data (K)"), ("held_out_z", "left-out data, in sigma (–)"),
)  # fmt: skip


# --- why this verdict -------------------------------------------------------------------------------
def rule_table(v: Verdict) -> list[str]:
    """Every rule that led to the verdict, with what follows where one did not pass; why it is not more certain."""
    if not v.rules:
        return []
    rows = [_rule_row(r) for r in v.rules]
    head = ["what was asked", "measured by", "value", "limit", "result"]
    uncertain = explain_uncertainty(v)
    return [page.table(head, rows), *([page.paragraph(uncertain)] if uncertain else [])]


def _rule_row(r: RuleResult) -> list[str]:
    words = describe_rule(r.name)
    result = "passed" if r.passed else words.fails or r.consequence
    if not words.measured_by:  # a yes or no, without a number
        return [words.passes, "–", "–", "–", result]
    limit = f"{'≤' if words.is_upper else '≥'}\N{NO-BREAK SPACE}{format_number(r.limit)}"
    return [words.passes, words.measured_by, format_number(r.value + 0.0), limit, result]  # no negative zero


# --- inputs that the data question ------------------------------------------------------------------
def input_tables(v: Verdict) -> list[str]:
    """Stated inputs: those that the data contradict, those that agree, those that the data cannot check or separate."""
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


def _inputs_table(some: list[InputResult]) -> str:
    head = ["stated input", "key", "stated", "known to", "the data want", "standard deviations away", "ln Bayes factor"]
    return page.table(head, [_input_row(i) for i in some])


def _input_row(i: InputResult) -> list[str]:
    words = key_labels.describe_key(i.key, i.unit)
    unit = f" {words.unit}" if words.unit else ""
    sd = (
        f"{format_number(100 * i.sd)} %"
        if i.relative
        else format_number(i.sd) + unit_suffix("K" if i.unit == "degC" else i.unit)
    )
    data = format_with_error(words.factor * i.estimate, words.factor * i.stderr, "1")
    return [
        i.words, i.key, f"{format_number(words.factor * i.stated)}{unit}", f"{sd}, {i.source}", f"{data}{unit}",
        format_number(abs(i.pull)), format_number(i.ln_bayes),
    ]  # fmt: skip


# --- is it noise ------------------------------------------------------------------------------------
def noise_section(v: Verdict) -> list[str]:
    """What maps and tests show about the same data, in sentences; the tests in a fold."""
    out = [page.paragraph(line) for line in (*_describe_maps(v), *_count_tests(v))]
    if not v.tests:
        return [*out, page.paragraph("No tests for structure were run.", "small")]
    left_by = {"before": "base", "after": "extended"}
    rows = [
        [t.name, t.where, left_by.get(t.stage, t.stage), format_number(t.statistic), format_probability(t.p)]
        for t in sorted(v.tests, key=lambda t: (t.stage != "before", t.p))
    ]
    table = page.table(["test for structure", "recording", "left by", "statistic", "p, simulated"], rows)
    return [*out, page.fold_section(f"All {len(rows)} tests for structure", [table])]


def _describe_maps(v: Verdict) -> list[str]:
    """The largest share of pixels beyond 3 sigma in the maps that are drawn, by model."""
    lines = []
    for stage, words in (("before", "the base leaves at worst"), ("after", "the extended model")):
        some = [getattr(p, stage) for g in plot_helpers.select_recordings(v) for p in g if p.recording.places is None]
        some = [s for s in some if s is not None]
        if some:
            worst = max(some, key=plot_helpers.outlier_fraction)
            share = format_number(100 * plot_helpers.outlier_fraction(worst))
            lines.append(f"{words} {share} % of the pixels of {worst.view.file}")
    return [f"Beyond ±3 sigma {', '.join(lines)}; noise alone 0.3 %."] if lines else []


def _count_tests(v: Verdict) -> list[str]:
    """How many tests find structure, by what is left."""
    out = []
    for stage, model in (("before", "base"), ("after", "extended model")):
        some = [t for t in v.tests if t.stage == stage]
        if some:
            count, found = plot_helpers.count_rare_tests(some)
            meaning = "that is structure, not noise" if found else "noise alone may do as much"
            out.append(
                f"In the residuals of the {model}, {count} of {len(some)} tests find structure that noise shows in at "
                f"most 1 % of simulated data: {meaning}."
            )
    return out


# --- candidates ---------------------------------------------------------------------------------------
def rival_tables(v: Verdict) -> list[str]:
    """Every candidate that was not accepted, best first; those below the level of a hint folded."""
    taken = {c.effect for c in v.causes}
    some = sorted((r for r in v.rivals if r.effect not in taken), key=lambda r: -r.score)
    if not some:
        return [page.paragraph("No other candidate was tried.", "small")]
    tried = [r for r in some if score_and_basis(r)[1] != "not tried"]
    likely = [r for r in tried if r.score > 0 or r.effect in v.group]
    out = [_candidate_table(likely)] if likely else [page.paragraph("No other candidate makes the data more probable.")]
    less, idle = [r for r in tried if r not in likely], [r for r in some if r not in tried]
    if less:
        words = f"{format_count(len(less), 'candidate')} less probable than none"
        out.append(page.fold_section(words, [_candidate_table(less)]))
    if idle:
        rows = [[effect_label(r.effect), r.reason.removeprefix("not tried: ")] for r in idle]
        out.append(
            page.fold_section(f"{len(idle)} effects that were not tried", [page.table(["effect", "why not"], rows)])
        )
    return out


def _candidate_table(some: list[CandidateReport]) -> str:
    head = ["candidate", "would need", "ln Bayes factor", "by", "below the accepted", "distinctness", "why not"]
    rows = [
        [
            effect_label(r.effect), needed_amplitude(r), *score_and_basis(r),
            "–" if r.left is None else format_number(r.left), f"{r.distinctness:.2f}", r.reason,
        ]
        for r in some
    ]  # fmt: skip
    return page.table(head, rows)


# --- what was gained ----------------------------------------------------------------------------------
def gain_tables(v: Verdict) -> list[str]:
    """Numbers of the base and of the extended model, and the parameters that moved."""
    out = []
    if v.base is not None:
        models = [m for m in (v.base, v.extended) if m is not None]
        rows = [
            [words, *((format_number if key.endswith("K") else format_ratio)(getattr(m, key)) for m in models)]
            for key, words in FIT_METRICS
        ]
        rows = [r for r in rows if any(cell != "–" for cell in r[1:])]
        out.append(page.table(["", "base", "extended"][: 1 + len(models)], rows))
    for c in v.causes:
        gain = f"{effect_label(c.effect)}: left-out data become more probable by {format_number(c.held_out_gain)} (ln)"
        out.append(page.paragraph(f"{gain}; chi2 lower by {format_number(c.delta_chi2)}.", "small"))
    if v.shifts:
        rows = [[n, format_number(b), format_number(a), format_number(s)] for n, b, a, s in v.shifts]
        out.append(page.table(["calibrated parameter", "base", "extended", "standard error"], rows))
    return out


# --- what it rests on -----------------------------------------------------------------------------------
def prior_tables(v: Verdict) -> list[str]:
    """Prior knowledge, and the calibrated numbers against it."""
    out = []
    if v.assumed:
        rows = [[n, format_number(s)] for n, s in v.assumed.items()]
        table = page.table(["quantity", "prior standard deviation"], rows)
        out.append(page.fold_section("Assumed prior knowledge; without a unit: relative", [table]))
    away = [p for p in v.nuisance if abs(p.pull) >= MIN_PULL_OPEN]
    for some, fold in ((away, False), ([p for p in v.nuisance if p not in away], True)):
        rows = [
            [p.name, format_with_error(p.value, p.stderr, p.unit), f"{p.pull:+.1f}".replace("-", "−")] for p in some
        ]
        table = page.table(["calibrated", "value ± standard error", "deviation in prior sigma"], rows)
        title = f"{len(some)} calibrated numbers within one prior sigma"
        out += [page.fold_section(title, [table]) if fold else table] if some else []
    return out


def detection_limits(v: Verdict) -> list[str]:
    """The smallest amplitudes that these data would show."""
    some = [r for r in v.rivals if math.isfinite(r.detectable)]
    if not some:
        return [page.paragraph("They were not computed.")]
    rows = [
        [
            effect_label(r.effect),
            r.parameter or "amplitude",
            detectable_amplitude(r),
            f"{format_number(100 * r.raw_share)} %",
        ]
        for r in some
    ]
    head = ["effect", "parameter", "detectable at 5 sigma", "signal left by calibration"]
    return [
        page.paragraph("Smaller amplitudes may be present: these data would not show them at 5 sigma."),
        page.fold_section(f"{len(rows)} effects", [page.table(head, rows)]),
    ]


def adequacy_table(v: Verdict) -> list[str]:
    """Adequacy tests that are not among the rules of the verdict."""
    shown, rows = {r.name for r in v.rules}, []
    for name, (value, limit) in v.gates.items():
        if name not in shown:
            words = describe_rule(name)
            passed = "no" if value > limit else "yes"
            rows.append([words.passes, words.measured_by, format_number(value), format_number(limit), passed])
    return [page.table(["what was checked", "measured by", "value", "limit", "passed"], rows)] if rows else []


def convergence_section(v: Verdict) -> list[str]:
    """Whether the calibration converged."""
    if not v.certificate:
        return [page.paragraph("Nothing is known about the convergence of the calibration.")]
    rows = [[effect_label(k), format_value(value)] for k, value in flatten_dict(v.certificate)]
    table = page.table(["calibration", ""], rows)
    done = v.certificate.get("converged")
    if done is None:
        return [table]
    words = "converged: another step would change nothing of importance" if done else "did not converge"
    return [page.paragraph(f"The calibration {words}."), page.fold_section("Steps of the calibration", [table])]


def parameter_table(c) -> list[str]:
    """The parameters of a cause with their intervals."""
    rows = [
        [
            p.name,
            format_with_error(p.value, p.stderr, p.unit),
            f"{format_number(p.ci95[0])} to {format_number(p.ci95[1])}{unit_suffix(p.unit)}"
            if p.ci95[1] > p.ci95[0]
            else "–",
            "yes: its interval means little" if p.bound else "no",
        ]
        for p in c.parameters
    ]
    return [page.table(["parameter", "value ± standard error", "95 % interval", "at its bound"], rows)] if rows else []
