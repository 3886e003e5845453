"""Remarks on the case of the case page, each a line that leads to its key; the dear check of effects has a button."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import run, ui

from flashtemp.errors import FlashtempError
from flashtemp.lab.workspace import escape_control
from flashtemp.model.case import Case
from flashtemp.runs.checks.case_remarks import (
    CaseRemark,
    remark_on_memory,
    remark_on_resolution,
    remark_on_side_walls,
    remark_on_values,
)
from flashtemp.runs.checks.inactive_effects import find_inactive_effects


class RemarkList:
    """The remarks; `go_to` is called with the key, or the name of the effect, of one that is clicked."""

    def __init__(self, go_to: Callable[[str], Any]):
        self.go_to = go_to
        self.case: Case | None = None
        self.shown: list[CaseRemark] = []

    def show(self) -> None:
        """Show the place for the remarks."""
        self.lines = ui.element("div").classes("w-full ft-optional").props("aria-live=polite")
        with ui.row().classes("items-center gap-3") as self.effects_row:
            ui.button("Check that each effect acts", icon="fact_check", on_click=self._check_effects).props(
                "outline dense no-caps"
            )
            self.answer = ui.label().classes("ft-muted ft-small").props("aria-live=polite")
        self.effects_row.set_visibility(False)

    def update(self, case: Case | None) -> None:
        """Show what can be said of a case at once; None where it has errors."""
        self.case = case
        self.answer.set_text("")
        self.effects_row.set_visibility(case is not None and bool(case.effects))
        remarks_of = (remark_on_resolution, remark_on_memory, remark_on_values, remark_on_side_walls)
        self._show_lines([] if case is None else [remark for make in remarks_of for remark in make(case)])

    async def _check_effects(self) -> None:
        """Evaluate the heat balance with and without each effect."""
        case = self.case
        if case is None:
            return
        self.answer.set_text("checking ...")
        try:
            inactive = await run.io_bound(find_inactive_effects, case)
        except FlashtempError as fault:
            self.answer.set_text(escape_control(str(fault)))
            return
        if case is not self.case:  # edited meanwhile
            return
        kept = [remark for remark in self.shown if remark.key not in case.effects]
        self._show_lines(kept + [CaseRemark(name, why) for name, why in (inactive or {}).items()])
        self.answer.set_text(f"{len(inactive)} of {len(case.effects)} do not act" if inactive else "Each effect acts.")

    def _show_lines(self, remarks: list[CaseRemark]) -> None:
        if remarks == self.shown:
            return
        self.shown = remarks
        self.lines.clear()
        if not remarks:
            return
        with self.lines, ui.column().classes("ft-note warning gap-0"):
            for remark in remarks:
                with ui.element("button").classes("ft-fault").props("type=button") as button:
                    ui.label(escape_control(str(remark))).classes("inline")
                button.on("click", lambda _, key=remark.key: self.go_to(key))
