"""The page of a verdict: the answer, how certain it is, what it changes, what else it could be, what to do next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.display import format_count
from flashtemp.lab.campaign_lookup import find_campaign
from flashtemp.lab.charts import bar_options, bar_series, chart_options, line_series, show_chart
from flashtemp.lab.job_result import extended_case_words
from flashtemp.lab.jobs import command_text
from flashtemp.lab.page_layout import (
    card,
    chip,
    file_address,
    heading,
    note,
    page_address,
    show_command,
    show_errors,
)
from flashtemp.lab.result_files import ResultFolder
from flashtemp.lab.result_parts import (
    MainNumber,
    folded_part,
    load_later,
    refuse_unreadable,
    show_figures,
    show_list,
    show_sentences,
    show_table,
    write_text,
)
from flashtemp.lab.start_button import CommandStarter, options_address
from flashtemp.lab.verdict_data import (
    RecordingChange,
    StoredVerdict,
    describe_answer,
    describe_parameters,
    read_verdict,
)
from flashtemp.lab.workspace import escape_control, list_folder

KEY_PICTURES = ("what_is_wrong.png", "law.png")  # the one that exists shows the answer
MAX_PLANS = 3
VERDICT_BADGES = {"good": "certain enough to act on", "warning": "not certain yet", "error": "no answer yet"}


def show_verdict_parts(result: ResultFolder, starter: CommandStarter) -> None:
    """Show the cards of a verdict, read in the background."""

    def show(stored: StoredVerdict) -> None:
        VerdictCards(result, starter, stored).show()

    load_later(result.folder, "the verdict", lambda: read_verdict(result), show)


class VerdictCards:
    """The cards of one verdict, from the answer to the inputs."""

    def __init__(self, result: ResultFolder, starter: CommandStarter, stored: StoredVerdict):
        self.result, self.starter = result, starter
        self.stored, self.verdict = stored, stored.verdict

    def show(self) -> None:
        """Show all cards; a damaged part is reported in its place."""
        self._show_answer()
        file = f"{self.result.name}/verdict.json"
        with show_errors(self.result.folder), refuse_unreadable(file):
            show_law(self.stored)
        with ui.element("div").classes("ft-split"):
            with ui.column().classes("gap-4 items-stretch min-w-0"):
                self._show_picture()
                self._show_change()
            with ui.column().classes("gap-4 items-stretch min-w-0"):
                self._show_next_steps()
                self._show_certainty()
        for show_part in (show_rivals, show_inputs):
            with show_errors(self.result.folder), refuse_unreadable(file):
                show_part(self.stored)

    # --- answer ------------------------------------------------------------------------------------------
    def _show_answer(self) -> None:
        v = self.verdict
        words, grade = describe_answer(v)
        with ui.element("section").classes(f"ft-card ft-answer-card {grade}").props('aria-label="answer"'):
            with ui.row().classes("items-center gap-2"):
                chip(words, grade)
                doubtful = [c for c in v.causes if c.is_doubtful]
                chip("the cause is certain, its law is not" if doubtful else VERDICT_BADGES[grade])
            show_sentences(v.says or [f"{words}."])
            numbers = self._answer_numbers()
            if numbers:
                show_figures(numbers)
            if v.warnings:
                with folded_part(format_count(len(v.warnings), "remark")):
                    show_list(v.warnings)

    def _answer_numbers(self) -> list[MainNumber]:
        """Evidence, distance from other causes, and the size of the misfit."""
        from flashtemp.viz.number_format import format_number, format_ratio

        v, out = self.verdict, []
        for cause in v.causes[:2]:
            name = "the learned law" if self.stored.law else cause.effect.replace("_", " ")
            out.append(MainNumber("Evidence", format_number(cause.ln_bayes), "ln Bayes factor", name))
            if peak := _law_number(self.stored.law):
                out.append(peak)
                continue
            for parameter, value, band in describe_parameters(cause)[:1]:
                number, _, unit = value.partition(" ") if "×" not in value and "±" not in value else (value, "", "")
                out.append(MainNumber(parameter, number, unit, f"95 %: {band}"))
        if v.base is not None:
            after = v.extended or v.base
            change = f"{format_number(v.base.rmse_K)} K before" if v.extended else "of the calibrated base"
            out.append(MainNumber("Misfit", format_number(after.rmse_K), "K rms", change))
            out.append(MainNumber("chi2/dof", format_ratio(after.chi2_per_dof), "", "1: noise explains everything"))
        return out

    # --- picture and change ------------------------------------------------------------------------------
    def _show_picture(self) -> None:
        name = next((n for n in KEY_PICTURES if self.result.find_file(n) is not None), None)
        if name is None:
            return
        about = "Measured, computed by the calibrated base, and their difference, where the misfit is largest."
        with (
            card("The picture that shows it", about),
            ui.link(target=file_address(self.result.here / name), new_tab=True),
        ):
            picture = ui.element("img").classes("w-full")
            picture.props["src"], picture.props["alt"] = file_address(self.result.here / name), about

    def _show_change(self) -> None:
        """Before and after, in kelvin, on data that no fit has used where there are some."""
        v, stored = self.verdict, self.stored
        with card("What it changes"):
            if v.base is None:
                ui.label("The base model was not calibrated, so nothing can be compared.").classes("ft-muted")
                return
            if v.extended is not None:
                show_figures(_change_numbers(stored))
            for line in stored.measured:
                ui.label(line)
            held = [r for r in stored.recordings if r.held_out]
            shown = [*_left_out_change(stored), *(held or stored.recordings)]
            if shown:
                about = "recordings that no fit has used" if held else "data left out of the fit, then each recording"
                ui.label(f"Difference between measurement and model: {about}.").classes("ft-muted")
                _show_recordings(shown)

    # --- next steps --------------------------------------------------------------------------------------
    def _show_next_steps(self) -> None:
        with card("What to do next"):
            if self.verdict.next_experiment:
                write_text("p", self.verdict.next_experiment).classes("m-0")
            if self.result.find_file("extended.toml") is not None:
                self._show_extended_case()
            elif not self.verdict.next_experiment:
                ui.label("Nothing: the case as stated explains these data.").classes("ft-muted")
            with ui.row().classes("gap-4"):
                files = [r.file for r in self.stored.recordings]
                campaign = find_campaign(self.result.folder, files, self.verdict.title, with_forces=False)
                ui.link("Plan a measurement", options_address("plan", campaign or ""))
                for name in self._list_plans():
                    ui.link(f"Plan {name}", page_address("result", open=name))

    def _show_extended_case(self) -> None:
        """The button that runs the extended case, with its command line."""
        heading(3, "The extended case")
        ui.label("The case with the accepted causes, with the calibrated values.").classes("ft-muted")
        show_command(command_text(self._extended_words()))
        file = self.result.here / "extended.toml"
        with ui.row().classes("gap-3 items-center"):
            self.starter.add_button("Run the extended case", self._extended_words, main=True)
            self.starter.add_options_link("run", file)
            ui.link("Open it", page_address("case", open=file)).classes("ft-small")

    def _list_plans(self) -> list[str]:
        """The first plans of the folder: which measurements tell effects apart."""
        results = list_folder(self.result.folder).results
        names = [str(path) for path, command in results.items() if command == "plan"]
        return [name for name in names if escape_control(name) == name][:MAX_PLANS]

    def _extended_words(self) -> list[str]:
        return extended_case_words(self.result.folder, self.result.here, self.starter.jobs.all)

    # --- certainty ---------------------------------------------------------------------------------------
    def _show_certainty(self) -> None:
        from flashtemp.discovery.diagnostics.rule_sentences import explain_uncertainty

        v = self.verdict
        with card("How certain it is", "Each rule of the verdict with its number."):
            why = explain_uncertainty(v)
            if why:
                note(why, "warning")
            if not v.rules:
                ui.label("This verdict stores no rules.").classes("ft-muted")
                return
            rows = [_rule_cells(r) for r in v.rules]
            show_table(("rule", "value", "limit", "result"), rows, "rules of the verdict", numbers=(1, 2))


def _law_number(law: dict[str, Any]) -> MainNumber | None:
    """Where a learned law differs most from the case as stated, with its 95 % band; None where none was learned."""
    from flashtemp.viz.number_format import format_number, unit_suffix

    curve, band = law.get("curve"), law.get("band")
    if not isinstance(curve, dict) or not isinstance(band, dict):
        return None
    value, x, low, high = (np.asarray(v, float) for v in
                           (curve.get("value"), curve.get("argument"), band.get("low"), band.get("high")))  # fmt: skip
    unit, is_factor = str(curve.get("unit", "1")), curve.get("unit", "1") == "1"
    at = int(np.nanargmax(np.abs(np.log(value)) if is_factor else np.abs(value)))
    where = f"{format_number(x[at])}{unit_suffix(str(curve.get('argument_unit', '1')))}"
    band_text = f"95 %: {format_number(low[at])} to {format_number(high[at])}"
    name = "Factor" if is_factor else "Law"
    return MainNumber(f"{name} at {where}", format_number(value[at]), unit_suffix(unit).strip(), band_text)


def _rule_cells(rule: Any) -> tuple[str, str, str, str]:
    from flashtemp.discovery.diagnostics.rule_sentences import describe_rule
    from flashtemp.viz.number_format import format_number

    words = describe_rule(rule.name)
    result = "passed" if rule.passed else words.fails or rule.consequence
    if not words.measured_by:
        return words.passes, "–", "–", result
    limit = f"{'≤' if words.is_upper else '≥'} {format_number(rule.limit)}"
    return f"{words.passes} ({words.measured_by})", format_number(rule.value), limit, result


def _change_numbers(stored: StoredVerdict) -> list[MainNumber]:
    """Misfit before and after, on fitted data and on data that was left out."""
    from flashtemp.viz.number_format import format_number

    base, extended = stored.verdict.base, stored.verdict.extended
    if base is None or extended is None:
        return []
    rows = [
        ("Data that was not fitted", base.held_out_rmse_K, extended.held_out_rmse_K),
        ("Fitted data", base.rmse_K, extended.rmse_K),
        ("Near the contact, means over frames", base.near_contact_rmse_K, extended.near_contact_rmse_K),
    ]
    return [
        MainNumber(label, format_number(after), "K rms", f"{format_number(before)} K without the extension")
        for label, before, after in rows
        if math.isfinite(before) and math.isfinite(after)
    ]


def _left_out_change(stored: StoredVerdict) -> list[RecordingChange]:
    """The change of all data that was left out of the fit (cross-validation), where it was computed."""
    base, extended = stored.verdict.base, stored.verdict.extended
    if base is None or not math.isfinite(base.held_out_rmse_K):
        return []
    after = math.nan if extended is None else extended.held_out_rmse_K
    return [RecordingChange("data that was not fitted", True, base.held_out_rmse_K, after)]


def _show_recordings(recordings: Sequence[Any]) -> None:
    """Bars of the rms difference of every recording, before and after."""
    files = [r.file for r in recordings]
    series = [bar_series("case as stated, calibrated", files, [r.before_K for r in recordings], 4)]
    if any(math.isfinite(r.after_K) for r in recordings):
        series.append(bar_series("with the extension", files, [r.after_K for r in recordings], 0))
    options = bar_options(series, files, "measured minus computed (K rms)", 200)
    chart = show_chart(options, "before_and_after", "rms difference of every recording before and after")
    chart.style(f"height: {110 + 46 * len(files)}px")


def show_law(stored: StoredVerdict) -> None:
    """Show a learned law with its 95 % band; nothing where none was learned."""
    from flashtemp.viz.number_format import law_axis_labels

    law = stored.law
    curve, band = law.get("curve"), law.get("band")
    if not isinstance(curve, dict) or not isinstance(band, dict):
        return
    words = str(law.get("words", ""))
    with card("The learned law", words[:1].upper() + words[1:]):
        labels = law_axis_labels(
            str(law.get("words", "")), *(str(curve.get(u, "1")) for u in ("argument_unit", "unit"))
        )
        x, low, high = (np.asarray(v, float) for v in (curve.get("argument"), band.get("low"), band.get("high")))
        fine = {"lineStyle": {"color": "var(--series-1)", "type": "dashed", "width": 1}}
        series = [line_series("learned law", x, curve.get("value"))]
        series += [line_series(f"95 % band, {side}", x, v) | fine for side, v in (("low", low), ("high", high))]
        chart = show_chart(chart_options([*series, *_fill_between(x, low, high)], *labels), "learned_law",
                           "the learned law with its 95 % band")  # fmt: skip
        chart.options["legend"] |= {"data": [one["name"] for one in series]}
        if curve.get("unit", "1") == "1":
            ui.label("A factor of 1 is the law of the case as stated.").classes("ft-muted ft-small")
        if law.get("formula"):
            write_text("p", f"As a formula: {law['formula']}").classes("ft-mono m-0 break-words")


def _fill_between(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> list[dict[str, Any]]:
    """Two stacked series without lines or names that shade the band between two curves."""
    bare = {"stack": "band", "silent": True, "lineStyle": {"width": 0}, "tooltip": {"show": False}, "z": 1}
    shade = {"areaStyle": {"color": "var(--series-1)", "opacity": 0.15}}
    return [line_series("", x, low) | bare, line_series("", x, high - low) | bare | shade]


def show_rivals(stored: StoredVerdict) -> None:
    """Show the other hypotheses with their evidence: likely ones open, the others folded."""
    from flashtemp.viz.number_format import effect_label, format_number, needed_amplitude, score_and_basis

    v = stored.verdict
    accepted = {c.effect for c in v.causes}
    rivals = sorted((r for r in v.rivals if r.effect not in accepted), key=lambda r: -r.score)
    head = ("hypothesis", "it would need", "ln Bayes factor", "basis", "distinctness", "why not")
    with card("What else it could be", "Other causes that were tried, and what the data say about each."):
        if v.group:
            names = ", ".join(effect_label(g) for g in v.group)
            note(f"These data cannot tell apart: {names}.", "warning")
        tried = [r for r in rivals if score_and_basis(r)[1] != "not tried"]
        likely = [r for r in tried if r.score > 0 or r.effect in v.group]
        unlikely, untried = [r for r in tried if r not in likely], [r for r in rivals if r not in tried]
        rows = {
            r.effect: (
                effect_label(r.effect),
                needed_amplitude(r),
                *score_and_basis(r),
                f"{r.distinctness:.2f}",
                r.reason,
            )
            for r in rivals
        }
        _show_evidence(v, [r for r in tried[:12] if math.isfinite(r.score)])
        if likely:
            show_table(head, [rows[r.effect] for r in likely], "likely hypotheses", numbers=(2, 4))
        else:
            ui.label("No other candidate makes the data more probable.").classes("ft-muted")
        if unlikely:
            with folded_part(f"{len(unlikely)} candidates that do not make the data more probable"):
                show_table(head, [rows[r.effect] for r in unlikely], "unlikely hypotheses", numbers=(2, 4))
        if untried:
            with folded_part(f"{len(untried)} effects not tried"):
                reasons = [(effect_label(r.effect), r.reason.removeprefix("not tried: ")) for r in untried]
                show_table(("effect", "reason"), reasons, "effects not tried")
        ui.label(f"Computed in {format_number(v.seconds)} s.").classes("ft-muted ft-small")


def _show_evidence(v: Any, rivals: Sequence[Any]) -> None:
    """Bars of the evidence of the accepted causes and the best other candidates."""
    from flashtemp.viz.number_format import effect_label

    named = [(f"{effect_label(c.effect)} (accepted)", c.ln_bayes) for c in v.causes if math.isfinite(c.ln_bayes)]
    others = [(effect_label(r.effect), r.score) for r in rivals]
    labels = [label for label, _ in [*named, *others]]
    if len(labels) < 2:
        return
    series = [bar_series("accepted", [label for label, _ in named], [s for _, s in named], 0)] if named else []
    series.append(bar_series("not accepted", [label for label, _ in others], [s for _, s in others], 4))
    for one in series:
        one["stack"] = "evidence"
    chart = show_chart(bar_options(series, labels, "ln Bayes factor", 230), "evidence", "evidence of every hypothesis")
    chart.style(f"height: {100 + 26 * len(labels)}px")


def show_inputs(stored: StoredVerdict) -> None:
    """Show which stated inputs the data contradict, confirm or cannot check."""
    v = stored.verdict
    if not v.inputs:
        return
    head = ("stated input", "key", "stated", "uncertainty", "from the data alone", "sd away", "ln Bayes factor")
    by_kind = {
        kind: [i for i in v.inputs if i.verdict == kind] for kind in ("contradicted", "consistent", "not checkable")
    }
    with card("Stated inputs against the data", "Whether the data agree with the numbers that the case states."):
        with ui.row().classes("gap-2"):
            for kind, mark in (("contradicted", "error"), ("consistent", "good"), ("not checkable", "")):
                chip(f"{len(by_kind[kind])} {kind}", mark if by_kind[kind] else "")
        contradicted = sorted(by_kind["contradicted"], key=lambda i: -i.ln_bayes)
        if contradicted:
            show_table(head, [_input_cells(i) for i in contradicted], "contradicted inputs", numbers=(2, 4, 5, 6))
        else:
            ui.label("The data contradict no stated input.")
        for kind, words in (("consistent", "that agree"), ("not checkable", "that these data cannot check")):
            if by_kind[kind]:
                with folded_part(f"{len(by_kind[kind])} inputs {words}"):
                    rows = sorted(by_kind[kind], key=lambda i: -abs(i.pull))
                    show_table(head, [_input_cells(i) for i in rows], f"inputs {words}", numbers=(2, 4, 5, 6))
        for group in v.inputs_told_together:
            ui.label(f"These data cannot tell apart: {' and '.join(group)}.").classes("ft-muted")


def _input_cells(i: Any) -> tuple[str, ...]:
    from flashtemp.viz.key_labels import describe_key
    from flashtemp.viz.number_format import format_number, format_with_error, unit_suffix

    label = describe_key(i.key, i.unit)
    unit = f" {label.unit}" if label.unit else ""
    kelvin = unit_suffix("K" if i.unit == "degC" else i.unit)
    sd = f"{format_number(100 * i.sd)} %" if i.relative else f"{format_number(i.sd)}{kelvin}"
    data = format_with_error(label.factor * i.estimate, label.factor * i.stderr, "1")
    stated = f"{format_number(label.factor * i.stated)}{unit}"
    return (
        i.words,
        i.key,
        stated,
        f"{sd}, {i.source}",
        f"{data}{unit}",
        format_number(abs(i.pull)),
        format_number(i.ln_bayes),
    )
