"""Live pictures of a discovery: its stage, what is being fitted, and the evidence for each candidate so far."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.lab.charts import AXIS_STYLE, show_chart
from flashtemp.lab.live_state import LiveState, finite_number
from flashtemp.lab.live_table import LiveTable
from flashtemp.lab.workspace import escape_control

STAGES = {  # heading: first words of the messages of that stage
    "Stated model": ("simulating the stated",),
    "Mesh error": ("simulating coarser",),
    "Calibration": ("calibrating",),
    "Sensitivities": ("sensitivities",),
    "Full fits": ("fitting", "candidates in addition", "identifying", "evaluation"),
    "Judgement": ("judging",),
    "Stated inputs": ("questioning",),
    "Report": ("writing",),
}
MAX_BARS = 12
EVIDENCE_HEADINGS = ("candidate", "score", "full fit", "state")
NOTHING_SCORED = "No candidate is scored yet: first the stated model is simulated and calibrated."
FIT_WORDS = {
    "fitting": "being fitted", "converged": "fitted", "stalled": "fitted, stopped early",
    "budget": "fitted, not converged", "outrun": "given up: far behind", "failed": "could not be simulated",
}  # fmt: skip


@dataclass(frozen=True)
class CandidateEvidence:
    """What is known of a model with these effects: ln Bayes factors of its `score` and full `fit`, and its `state`."""

    effects: str
    score: float | None = None
    fit: float | None = None
    state: str = ""

    @property
    def best_known(self) -> float:
        """The ln Bayes factor of the fit, else that of the score."""
        known = self.fit if self.fit is not None else self.score
        return known if known is not None else float("-inf")


class LiveDiscoveryPanel:
    """Stage, sentence, bars and table that `update` draws anew."""

    def __init__(self) -> None:
        with ui.element("ol").classes("ft-steps"):
            self.steps = [TextElement(tag="li", text=words) for words in STAGES]
        self.facts = ui.label().classes("ft-muted")
        with ui.element("div").classes("w-full") as self.figure:
            ui.label("Evidence so far: ln Bayes factor against the stated model").classes("ft-small")
            self.chart = show_chart(
                _bar_options(), "evidence", "ln Bayes factor of every candidate against the stated model"
            )
        self.table = LiveTable()
        self.nothing = ui.label(NOTHING_SCORED).classes("ft-small")

    def update(self, state: LiveState) -> None:
        """Draw the state of a discovery."""
        self._mark_stage(len(STAGES) if state.find_value("end") is not None else current_stage(state))
        self.facts.text = describe_discovery(state)
        found = collect_evidence(state)
        bars = [one for one in found if one.best_known > float("-inf")][:MAX_BARS]
        self.figure.set_visibility(bool(bars))
        self.chart.options["yAxis"]["data"] = [escape_control(one.effects) for one in reversed(bars)]
        for series, values in zip(
            self.chart.options["series"],
            ([one.score for one in reversed(bars)], [one.fit for one in reversed(bars)]),
            strict=True,
        ):
            series["data"] = values
        self.chart.update()
        self.table.show_rows(EVIDENCE_HEADINGS, evidence_cells([one for one in found if one.state][:MAX_BARS]))
        left = [one.effects for one in found if not one.state]
        self.nothing.text = f"Not scored yet: {escape_control(', '.join(left))}." if left else NOTHING_SCORED
        self.nothing.set_visibility(bool(left) or not bars)

    def _mark_stage(self, now: int) -> None:
        """Mark the present stage and those that are done."""
        for k, step in enumerate(self.steps):
            step.classes(replace="done" if k < now else "")
            if k == now:
                step.props["aria-current"] = "step"
            else:
                step.props.pop("aria-current", None)
            step.update()


def describe_discovery(state: LiveState) -> str:
    """How many candidates there are, and how far the fits have got, in words."""
    scored = [r for r in state.rows("stage", "candidates") if finite_number(r.get("score")) is not None]
    count, fits = len(state.rows("stage", "candidates")), _collect_fits(state)
    words = []
    if count:
        words.append(f"{count} candidates" + (f", {len(scored)} scored" if scored else ""))
    if fits:
        running = sum(state_of == "fitting" for _, state_of in fits.values())
        words.append(f"{len(fits) - running} full fits done" + (f", {running} under way" if running else ""))
    if accepted := state.names("stage", "accepted"):
        words.append(f"accepted so far: {escape_control(', '.join(accepted))}")
    return " · ".join(words) or "The recordings are being read."


def collect_evidence(state: LiveState) -> list[CandidateEvidence]:
    """All candidates and models with what is known of them, the most probable first."""
    base = state.number("stage", "ln_evidence_base")
    scores = {str(r.get("effect")): finite_number(r.get("score")) for r in state.rows("stage", "candidates")}
    found = {
        name: CandidateEvidence(name, score, None, "scored" if score is not None else "")
        for name, score in scores.items()
    }
    begun = state.find_value("stage", "fitting")
    for row in begun if isinstance(begun, list) else []:
        name = " + ".join(map(str, row)) if isinstance(row, list) else ""
        if name:
            found[name] = CandidateEvidence(name, scores.get(name), None, "being fitted")
    for name, (evidence, fit_state) in _collect_fits(state).items():
        gain = None if evidence is None or base is None else evidence - base
        found[name] = CandidateEvidence(name, scores.get(name), gain, FIT_WORDS.get(fit_state, fit_state))
    return sorted(found.values(), key=lambda one: (-one.best_known, one.effects))


def _collect_fits(state: LiveState) -> dict[str, tuple[float | None, str]]:
    """{effects: (ln evidence, state)} of all full fits, begun or ended."""
    rows = [*state.rows("stage", "fits"), *state.rows("stage", "running"), *state.rows("stage", "failed")]
    out: dict[str, tuple[float | None, str]] = {}
    for row in rows:
        effects, words = row.get("effects"), row.get("state", "failed")
        if isinstance(effects, list) and effects:
            out[" + ".join(map(str, effects))] = (finite_number(row.get("ln_evidence")), str(words))
    return out


def current_stage(state: LiveState) -> int:
    """The number of the present stage in STAGES."""
    latest = state.text("message").strip() or state.text("stage", "stage")
    return next((k for k, starts in enumerate(STAGES.values()) if latest.startswith(starts)), 0)


def evidence_cells(found: list[CandidateEvidence]) -> list[list[str]]:
    """Cells of the table of candidates: name, score, ln Bayes factor of the full fit, state."""
    return [[one.effects, _format_gain(one.score), _format_gain(one.fit), one.state] for one in found]


def _format_gain(value: float | None) -> str:
    return "" if value is None else f"{value:,.1f}"


def _bar_options() -> dict[str, Any]:
    """Options of ECharts for two bars per candidate, with a line where an effect is named."""
    threshold = {"symbol": "none", "silent": True, "data": [{"xAxis": CRITERIA.ln_bayes_named}]}
    style = {"lineStyle": {"color": "var(--text)", "type": "dashed"}, "label": {"show": False}}
    return {
        "animation": False,
        "textStyle": {"fontFamily": "inherit", "color": "var(--text)"},
        "grid": {"left": 8, "right": 24, "top": 36, "bottom": 44, "containLabel": True},
        "tooltip": {
            "trigger": "axis", "backgroundColor": "var(--surface)", "borderColor": "var(--line)",
            "textStyle": {"color": "var(--text)"}, "axisPointer": {"type": "shadow"},
        },
        "legend": {"show": True, "top": 4, "textStyle": {"color": "var(--text)"}},
        "xAxis": {**AXIS_STYLE, "name": "ln Bayes factor (dashed: an effect is named)", "nameGap": 26, "scale": False},
        "yAxis": {"type": "category", "data": [], "axisLabel": {"color": "var(--text)"},
                  "axisLine": {"lineStyle": {"color": "var(--line)"}}},
        "series": [
            {"type": "bar", "name": "score", "data": [], "itemStyle": {"color": "var(--series-5)"}, "barMaxWidth": 10},
            {"type": "bar", "name": "full fit", "data": [], "itemStyle": {"color": "var(--series-1)"},
             "barMaxWidth": 10, "markLine": threshold | style},
        ],
    }  # fmt: skip
