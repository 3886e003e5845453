"""The campaign page: its case, recordings with conditions, free parameters, and the TOML text."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.api.campaigns import open_campaign
from flashtemp.errors import BadInput
from flashtemp.lab.page_layout import ask_to_run, page_address, save_text, show_error, show_errors
from flashtemp.lab.programs import AllowedPrograms, programs_of_campaign
from flashtemp.lab.saving import TextVersion, read_text
from flashtemp.lab.toml_editing import set_toml_key
from flashtemp.lab.workspace import escape_control, free_name, list_folder
from flashtemp.model.case_file import parse_toml
from flashtemp.model.toml_format import value_text

NEW_CAMPAIGN = 'title = "my campaign"\ncase = "case.toml"\nfree = ["friction.mu"]\n'


class CampaignPage:
    """One campaign as text; the controls only edit the text, which alone is saved."""

    def __init__(self, folder: Path, allowed: AllowedPrograms | None = None):
        self.folder, self.allowed = folder, allowed or AllowedPrograms()
        self.opened: TextVersion | None = None

    def show(self, name: str) -> None:
        """Show a campaign of the folder, or a new one where `name` is ""."""
        with show_errors(self.folder):
            self.listing = list_folder(self.folder)
            text, self.opened = read_text(self.folder, name) if name else (self._new_text(), None)
            with ui.row().classes("w-full items-center"):
                self.name = ui.input("file", value=name or free_name(self.folder, "campaign.toml")).classes("w-96")
                ui.button("Save", on_click=self._save)
                for command in ("compare", "discover", "plan"):
                    ui.button(command, on_click=lambda c=command: self._open_command(c)).props("outline no-caps")
            self.faults = ui.column().classes("w-full gap-1").props("aria-live=polite")
            with ui.row().classes("w-full items-start no-wrap max-lg:flex-wrap"):
                with ui.column().classes("w-full lg:w-1/2"):
                    self._add_controls(text)
                self.text = ui.codemirror(text, language="TOML").classes("w-full lg:w-1/2 h-96")

    def _new_text(self) -> str:
        """A new campaign with case.toml, or else the first case of the folder."""
        cases = [p.as_posix() for p in self.listing.cases]
        return NEW_CAMPAIGN if "case.toml" in cases or not cases else NEW_CAMPAIGN.replace("case.toml", cases[0])

    def _add_controls(self, text: str) -> None:
        cases = [str(p) for p in self.listing.cases]
        try:
            stated = (self.folder / self.name.value).parent / str(parse_toml(text).get("case", ""))
            chosen = next((c for c in cases if (self.folder / c).resolve() == stated.resolve()), None)
        except (ValueError, RecursionError, OSError):  # not TOML, or an impossible file name
            chosen = None
        ui.select(
            cases, value=chosen, label="case of the base model",
            on_change=lambda e: self._set_key("case", self._relative_path(e.value)),
        ).classes("w-full")  # fmt: skip
        self.free = ui.input("free keys, separated by commas", value="friction.mu").classes("w-full")
        self.free.on(
            "change", lambda: self._set_key("free", [k.strip() for k in self.free.value.split(",") if k.strip()])
        )
        ui.label("Add a recording").classes("text-lg font-medium")
        recordings = [str(p) for p in self.listing.recordings]
        self.file = ui.select(recordings, label="recording", with_input=True).classes("w-full")
        self.conditions = ui.input("conditions, e.g. contact.pressure=3e5, schedule.speed=0.2").classes("w-full")
        self.held_out = ui.checkbox("leave out of the fit")
        ui.button("Add", on_click=self._add_recording).props("outline")

    def _relative_path(self, path: str) -> str:
        """A file of the folder relative to the campaign file."""
        campaign_folder = (self.folder / self.name.value).parent
        return os.path.relpath(self.folder / path, campaign_folder)

    def _set_key(self, key: str, value: Any) -> None:
        self.text.value = set_toml_key(self.text.value or "", "", key, value)

    def _add_recording(self) -> None:
        """Append a recording to the text."""
        if not self.file.value:
            return
        self.faults.clear()
        with self.faults, show_errors(self.folder):
            rows = ["", "[[recording]]", f"file = {value_text(self._relative_path(self.file.value))}"]
            if conditions := _parse_conditions(self.conditions.value or ""):
                rows.append(f"with = {value_text(conditions)}")
            if self.held_out.value:
                rows.append("held_out = true")
            self.text.value = (self.text.value or "").rstrip() + "\n" + "\n".join(rows) + "\n"

    async def _save(self) -> bool:
        """Save the text, then show its errors; effect files of its case run only with consent."""
        self.faults.clear()
        with self.faults, show_errors(self.folder):
            name, text = self.name.value or "", self.text.value or ""
            if (version := await save_text(self.folder, name, text, self.opened)) is None:
                return False
            self.opened = version
            if not await ask_to_run(programs_of_campaign(text, version.path.parent), self.allowed):
                show_error(
                    f"{escape_control(name)} is saved but not checked, since its effect files were not allowed to run"
                )
                return False
            open_campaign(version.path, planned=True)
            return True
        return False

    async def _open_command(self, command: str) -> None:
        if await self._save():
            ui.navigate.to(page_address("runs", command=command, of=self.name.value))


def _parse_conditions(typed: str) -> dict[str, Any]:
    """Parse keys and values separated by commas.  Raises BadInput.

    >>> _parse_conditions("contact.pressure=3e5, schedule.speed = 0.2")
    {'contact.pressure': 300000.0, 'schedule.speed': 0.2}
    """
    out = {}
    for part in typed.split(",") if typed.strip() else ():
        key, equals, value = part.partition("=")
        try:
            out[key.strip()] = parse_toml(f"v = {value}")["v"]
        except (ValueError, RecursionError):
            out[key.strip()] = value.strip()
        if not equals:
            raise BadInput(f"{part.strip()!r}; write table.key=value")
    return out
