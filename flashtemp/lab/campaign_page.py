"""The campaign page: measurements with their conditions, what is free, checks as you go, and the TOML text."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from nicegui import run, ui

from flashtemp.lab.campaign_additions import CampaignAdditions
from flashtemp.lab.campaign_checks import CampaignCheck, CampaignFault, check_campaign, find_outside_files
from flashtemp.lab.campaign_document import CampaignDocument
from flashtemp.lab.campaign_list import new_campaign_text, show_campaigns
from flashtemp.lab.campaign_scope import show_scope
from flashtemp.lab.free_keys import CandidateSwitches, FreeKeysPanel
from flashtemp.lab.jobs import JobList, command_text
from flashtemp.lab.page_layout import (
    action,
    add_script,
    card,
    heading,
    note,
    page_address,
    program_lines,
    show_command,
    show_error,
    show_errors,
)
from flashtemp.lab.programs import AllowedPrograms, programs_of_campaign
from flashtemp.lab.recording_store import RecordingStore, try_describe
from flashtemp.lab.recording_table import RecordingTable
from flashtemp.lab.saved_text import SavedText
from flashtemp.lab.saving import read_text
from flashtemp.lab.start_button import OPTIONS_LABEL, CommandStarter, options_address, start_once
from flashtemp.lab.style import read_asset
from flashtemp.lab.toml_editor import TomlEditor, prepare_editor
from flashtemp.lab.toml_tables import set_top_key
from flashtemp.lab.watch_card import WatchCard
from flashtemp.lab.workspace import FolderListing, escape_control, free_name, list_folder

CHECK_INTERVAL_S: Final = 0.4  # a text is checked when it has not changed for so long
COMMANDS: Final = {"compare": "Compare", "discover": "Ask what is missing", "plan": "Plan"}
PLACED_KEYS: Final = ("free", "known")  # whose errors stand beside their lists


class CampaignPage:
    """One campaign as text; the controls only edit the text, which alone is saved."""

    def __init__(
        self,
        folder: Path,
        allowed: AllowedPrograms | None = None,
        store: RecordingStore | None = None,
        jobs: JobList | None = None,
    ):
        self.folder, self.allowed, self.jobs = folder, allowed or AllowedPrograms(), jobs or JobList(folder)
        self.starter = CommandStarter(folder, self.jobs, self.allowed)
        self.store = store or RecordingStore(folder)
        self.listing = FolderListing()
        self.ticked_text: str | None = None  # at the last tick: the user may still be typing
        self.checked_text: str | None = None
        self.is_checking = False
        self.check = CampaignCheck()

    def show(self, name: str, new: bool = False) -> None:
        """Show a campaign of the folder, a new one, or the list of campaigns where neither is asked for."""
        if not name and not new:
            heading(1, "Campaigns")
            show_campaigns(self.folder)
            return
        prepare_editor()
        ui.add_css(read_asset("runs.css"))
        add_script("charts.js")  # charts of a watch are added later, when scripts do not run
        with show_errors(self.folder):
            self.listing = list_folder(self.folder)
            text, opened = read_text(self.folder, name) if name else (new_campaign_text(self.listing), None)
            self.saved = SavedText(self.folder, "campaign", text, opened)
            self.document = CampaignDocument(self.folder, name or free_name(self.folder, "campaign.toml"), text)
            self.document.changed, self.document.refused = self._text_edited, self._show_refusal
            self._build_page(is_new=not name)
            ui.timer(CHECK_INTERVAL_S, self._check_if_changed)

    # --- the page ----------------------------------------------------------------------------------------------
    def _build_page(self, is_new: bool) -> None:
        self._show_bar("compare" if is_new else "discover")
        with card() as box:
            box.props["aria-label"] = "title, case and commands"
            self._add_file_controls()
            self._add_commands()
        self.faults = ui.column().classes("w-full gap-1 ft-optional").props("aria-live=polite")
        self.additions = CampaignAdditions(self.document, self.store, self._check_again)
        self.table = RecordingTable(self.document, self.store, self.additions.duplicate_entry)
        with card(
            "Measurements", "Each row has the conditions under which it was made. A cell changes the text below."
        ):
            self.additions.show_suggestions()
            self.table.show()
        with card("Add measurements"):
            self.additions.show()
        self.watch = WatchCard(self.document, self.jobs, self.allowed, self._save)
        self.watch.imported = self._check_again
        self.watch.show()
        with ui.element("div").classes("ft-split"):
            self.keys = FreeKeysPanel(self.document)
            with card("What is fitted"):
                self.keys.show()
            with card("What these data can show"):
                self.scope = ui.column().classes("w-full gap-3").props("aria-live=polite")
                with self.scope:
                    ui.spinner(size="md")
        with card("Effects that may be missing"):
            words = ui.label().classes("ft-muted")
            self.candidates = CandidateSwitches(self.document, words.set_text)
            with ui.expansion("Choose effects").classes("w-full ft-fold"):
                self.candidates.show()
        about = "All of the above is this text; you may edit it here as well."
        is_open = self.document.raw is None
        with card("Text", about), ui.expansion("Show the text", value=is_open).classes("w-full") as self.text_fold:
            self.editor = TomlEditor(self.document.text, self._text_typed, "text of the campaign")
        self._show_state()

    def _show_bar(self, main: str) -> None:
        """Title, file name and the main actions."""
        self.main_command = main
        with ui.element("div").classes("ft-bar"):
            heading(1, "Campaign")
            self.name = ui.input("file", value=self.document.name, on_change=lambda: self._rename()).classes("ft-name")
            self.name.props("outlined dense")
            with ui.element("div").classes("ft-actions"):
                ui.link("All campaigns", page_address("campaign"))
                self.saved.show(self._save)
                action(COMMANDS[main], start_once(partial(self._start_command, main)), "play_arrow", main=True)

    def _add_file_controls(self) -> None:
        cases = {str(p): escape_control(str(p)) for p in self.listing.cases}
        with ui.element("div").classes("ft-form-row"):
            self.title = ui.input("title").props("outlined dense").classes("grow")
            self.title.on("change", lambda: self._set_key("title", self.title.value or None))
            self.case = ui.select(cases, label="case of the base model", on_change=lambda: self._choose_case())
            self.case.props("outlined dense").classes("grow")
            action("Open the case", lambda: self._open_case(), "tune")
        if not cases:
            with ui.row().classes("items-center gap-2"):
                note(
                    "The folder has no case. A campaign needs one: block, road, load, speed and what heats.", "warning"
                )
                action("Begin a case", lambda: ui.navigate.to(page_address("case")), "add")
        self._fill_file_controls()

    def _fill_file_controls(self) -> None:
        raw = self.document.raw
        if raw is None:
            return
        title, stated = raw.get("title"), self.document.find_file(raw.get("case", "case.toml"))
        self.title.value = title if isinstance(title, str) else ""
        home = self.folder.resolve()
        self.case.value = next((c for c in self.case.options if (home / c).resolve() == stated), None)

    def _add_commands(self) -> None:
        with ui.element("div").classes("ft-command-row"):
            self.command = ui.element("div").classes("min-w-0")
            for command, words in COMMANDS.items():
                if command != self.main_command:
                    action(words, start_once(partial(self._start_command, command)))
            self.options = ui.link(OPTIONS_LABEL, options_address(self.main_command, self.document.name))
            self.options.classes("ft-small").props["aria-label"] = f"Options of {self.main_command}"

    def _show_state(self) -> None:
        """Show whether the text is saved, and the command of the main action."""
        self.saved.update(self.document.name, self.document.text)
        self.command.clear()
        self.options.props["href"] = options_address(self.main_command, self.document.name)
        with self.command:
            show_command(command_text(self.starter.command_words(self.main_command, self.document.name)))

    # --- edits ---------------------------------------------------------------------------------------------
    def _set_key(self, key: str, value: Any) -> None:
        self.document.apply_edit(lambda text: set_top_key(text, key, value))

    def _rename(self) -> None:
        self.document.name = self.name.value or ""
        self.checked_text = None
        self._show_state()
        self.watch.update_choices()

    def _choose_case(self) -> None:
        chosen = self.case.value
        raw = self.document.raw or {}
        if chosen and self.document.find_file(raw.get("case", "case.toml")) != (self.folder / chosen).resolve():
            self._set_key("case", self.document.relative_name(Path(chosen)))

    def _open_case(self) -> None:
        ui.navigate.to(page_address("case", **({"open": self.case.value} if self.case.value else {})))

    def _text_edited(self) -> None:
        """A control has changed the text."""
        self.editor.set_text(self.document.text)
        self._show_text()

    def _text_typed(self) -> None:
        """The user has changed the text in the editor."""
        if self.editor.text != self.document.text:
            self.document.text = self.editor.text
            self._show_text()

    def _show_text(self) -> None:
        """Show the text in all controls; a text that is not TOML leaves them as they are."""
        self._show_state()
        if self.document.raw is not None:
            self._fill_file_controls()
            self.table.update_values()
            self.keys.update_values()
            self.candidates.update_values()
            self.additions.update_offers()
            self.watch.update_choices()

    def _show_refusal(self, error: str) -> None:
        ui.notify(escape_control(error), type="negative")

    # --- checks ----------------------------------------------------------------------------------------------
    async def _check_if_changed(self) -> None:
        """Check the text once it has stayed the same for one tick."""
        text = self.document.text
        settled = text == self.ticked_text
        self.ticked_text = text
        if settled and not self.is_checking and text != self.checked_text:
            self.is_checking = True
            self.checked_text = text
            try:
                await self._check(text)
            finally:
                self.is_checking = False

    def _check_again(self) -> None:
        """Check the same text again, because files have changed."""
        self.checked_text = None

    async def _check(self, text: str) -> None:
        """Check a text and show what is wrong where it is wrong; effect files run only with consent."""
        check = CampaignCheck()
        self.faults.clear()
        with self.faults, show_errors(self.folder):
            path = self.document.path
            if programs := self._find_programs(text, path):
                self._offer_programs(programs)
            else:
                check = await run.io_bound(check_campaign, text, path, self.store) or check
                if self.faults.is_deleted:
                    return
                self._show_faults(check.other_faults(*PLACED_KEYS))
        self.check = check
        if not self.faults.is_deleted:  # the page may have been closed meanwhile
            self._show_check(check)
            await run.io_bound(self._read_briefs)
        if not self.faults.is_deleted:
            self._show_check(check)
            self.additions.update_pictures()

    def _show_faults(self, faults: Sequence[CampaignFault]) -> None:
        """Show errors that belong to no row and no list, each with a way to its line."""
        if faults:
            with ui.column().classes("ft-note error gap-0").props("role=alert"):
                for fault in faults:
                    self.editor.show_fault(fault.in_text, self.folder, self.text_fold.open)

    def _find_programs(self, text: str, path: Path) -> list[Path]:
        """Effect files that the check would run without consent.  Raises BadInput."""
        raw = self.document.raw
        if raw is None or find_outside_files(raw, path, self.folder):
            return []
        return self.allowed.unconfirmed_files(programs_of_campaign(text, path.parent))

    def _read_briefs(self) -> None:
        """Read recordings that the check has not read: those it did not reach, and those not in the campaign."""
        entries = [self.document.find_file(e.get("file")) for e in self.document.list_entries("recording")]
        traces = [self.document.find_file(e.get("file")) for e in self.document.list_entries("force")]
        offered = [self.folder / path for path in self.additions.pictures]
        for path in [*entries, *traces, *offered]:
            if path is not None and (path.suffix == ".nc" or path in traces):
                try_describe(self.store, path)

    def _show_check(self, check: CampaignCheck) -> None:
        self.editor.mark_faults([fault.in_text for fault in check.faults])
        self.table.update_check(check)
        self.keys.update_check(check)
        self.candidates.update_check(check)
        self.scope.clear()
        with self.scope:
            show_scope(check, self.document)

    def _offer_programs(self, programs: list[Path]) -> None:
        """List the effect files that the check would run, with a button to allow it."""
        show_error("\n".join(["not checked yet", *program_lines(programs)]), self.folder)
        label = "Run it to check the campaign" if len(programs) == 1 else "Run them to check the campaign"
        action(label, lambda: self._run_programs(programs))

    def _run_programs(self, programs: list[Path]) -> None:
        self.allowed.allow(programs)
        self.checked_text = None

    # --- saving ----------------------------------------------------------------------------------------------
    async def _save(self) -> bool:
        """Save the text, even with errors in it; False where it was not saved."""
        with self.faults, show_errors(self.folder):
            return await self.saved.save(self.document.name, self.document.text)
        return False

    async def _start_command(self, command: str) -> bool:
        """Save, start a command and show its live view, unless the check finds errors; whether it was started."""
        if not await self._save():
            return False
        if self.checked_text != self.document.text or self.is_checking:
            self.checked_text = self.document.text
            await self._check(self.document.text)
        if self.check.faults:
            ui.notify("Saved. Repair the errors that are shown first.", type="warning")
            return False
        with self.faults, show_errors(self.folder):
            return await self.starter.start(self.starter.command_words(command, self.document.name))
        return False
