"""The live view of a job: it shows the pictures for which the command has written data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.lab.job_record import LoggedJob
from flashtemp.lab.job_result import result_name
from flashtemp.lab.live_discovery import LiveDiscoveryPanel
from flashtemp.lab.live_run import LiveRunPanel
from flashtemp.lab.live_state import LiveState
from flashtemp.lab.live_table import LiveTable, cells_of_rows
from flashtemp.lab.page_layout import file_address
from flashtemp.lab.workspace import find_own_file

PANELS: dict[str, type] = {"run": LiveRunPanel, "stage": LiveDiscoveryPanel}  # section of the state file: its pictures
WATCH_PICTURE = "watch.png"


class LiveView:
    """A place on the page that shows the live pictures of one job, once there are any."""

    def __init__(self, folder: Path, job: LoggedJob):
        self.folder, self.job = folder, job
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
        self._update_watch()
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

    def _update_watch(self) -> None:
        """Show the picture that `flashtemp watch` keeps up to date in its result folder."""
        name = result_name(self.job.words)
        file = find_own_file(self.folder, Path(name) / WATCH_PICTURE) if name and self.job.words[0] == "watch" else None
        if file is None:
            return
        if "watch" not in self.panels:
            with self.place:
                self.panels["watch"] = ui.element("img").props('alt="comparison so far"').classes("w-full")
        changed = file.stat().st_mtime_ns
        if self.shown.get("watch") != changed:
            self.shown["watch"] = changed
            self.panels["watch"].props["src"] = f"{file_address(Path(name) / WATCH_PICTURE)}?{changed}"
            self.panels["watch"].update()
