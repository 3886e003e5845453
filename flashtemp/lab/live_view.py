"""The live view of a job: it shows the pictures for which the command has written data."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from flashtemp.lab.job_record import LoggedJob
from flashtemp.lab.live_discovery import LiveDiscoveryPanel
from flashtemp.lab.live_run import LiveRunPanel
from flashtemp.lab.live_state import LiveState
from flashtemp.lab.live_table import LiveTable, cells_of_rows
from flashtemp.lab.live_watch import LiveWatchPanel

PANELS: dict[str, type] = {  # section of the state file: its pictures
    "run": LiveRunPanel, "stage": LiveDiscoveryPanel, "watch": LiveWatchPanel,
}  # fmt: skip


class LiveView:
    """A place on the page that shows the live pictures of one job, once there are any."""

    def __init__(self, job: LoggedJob):
        self.job = job
        self.panels: dict[str, Any] = {}
        self.shown: dict[str, int] = {}
        self.place = ui.column().classes("w-full gap-2 items-stretch")

    def update(self) -> bool:
        """Draw what is new; returns whether there is anything to see."""
        state = self.job.live
        for section, panel in PANELS.items():
            if isinstance(state.find_value(section), dict) and self._is_wanted(section, state):
                self._update_panel(section, panel, state)
        if rows := state.rows("stage", "rows"):
            self._update_table(rows)
        return bool(self.panels)

    def _is_wanted(self, section: str, state: LiveState) -> bool:
        """Whether a section has data for its pictures; comparisons and plans have a stage without candidates."""
        return section != "stage" or self.job.words[0] == "discover" or bool(state.rows("stage", "candidates"))

    def _update_panel(self, section: str, panel: type, state: LiveState) -> None:
        if section not in self.panels:
            with self.place:
                self.panels[section] = panel()
        if self.shown.get(section) != self.job.live_version:
            self.shown[section] = self.job.live_version
            self.panels[section].update(state)

    def _update_table(self, rows: list[dict[str, Any]]) -> None:
        """Show what a comparison or a study has computed so far as a table."""
        if "rows" not in self.panels:
            with self.place:
                ui.label("Done so far").classes("ft-small")
                self.panels["rows"] = LiveTable()
        self.panels["rows"].show_rows(*cells_of_rows(rows))
