"""The case page: drawing, form, effects and TOML text of one case, checked while typing; the text alone is saved."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from nicegui import background_tasks, run, ui

from flashtemp.api.inputs import parse_case
from flashtemp.errors import FlashtempError
from flashtemp.lab import case_cost, case_sketch_view
from flashtemp.lab.case_form import CaseForm, KeyField
from flashtemp.lab.case_list import CaseList
from flashtemp.lab.drawing import Drawing
from flashtemp.lab.effect_cards import EffectCards, effect_name, listed_effects
from flashtemp.lab.jobs import JobList, command_text
from flashtemp.lab.key_groups import CaseKey
from flashtemp.lab.page_layout import (
    action,
    card,
    heading,
    page_address,
    program_lines,
    relative_names,
    show_command,
    show_error,
    show_errors,
)
from flashtemp.lab.programs import AllowedPrograms, programs_of_text
from flashtemp.lab.remark_list import RemarkList
from flashtemp.lab.saved_text import SavedText
from flashtemp.lab.saving import TextVersion, read_text
from flashtemp.lab.start_button import OPTIONS_LABEL, CommandStarter, options_address, start_once
from flashtemp.lab.style import read_asset
from flashtemp.lab.toml_editing import add_toml_table, remove_empty_table, remove_toml_table, set_toml_key, try_parse
from flashtemp.lab.toml_editor import TextFault, TomlEditor, prepare_editor, read_faults
from flashtemp.lab.workspace import escape_control, free_name, list_folder, resolve_inside
from flashtemp.model.case import Case
from flashtemp.model.schema import named_table_kind
from flashtemp.physics.material import LIBRARY
from flashtemp.physics.units import to_unit

TYPING_PAUSE_S: Final = 0.08  # after a change of the text, before it is checked
OWN_MATERIAL: Final = "my_material"
KEYS_TEXT: Final = "An empty field has the default that stands in it in grey."
STALE_TEXT: Final = "The drawing shows the last case without errors."
NO_DRAWING_TEXT: Final = "The case is drawn here as soon as it has no errors."


class CasePage:
    """One case as text; form and cards only edit the text, which alone is saved."""

    def __init__(self, folder: Path, allowed: AllowedPrograms | None = None, jobs: JobList | None = None):
        self.folder, self.allowed = folder, allowed or AllowedPrograms()
        self.starter = CommandStarter(folder, jobs or JobList(folder), self.allowed)
        self.case: Case | None = None
        self.removed_tables: dict[str, str] = {}  # of effects that were switched off on this page
        self.raw: dict[str, Any] = {}
        self.pace, self.changes = 1.0, 0

    def show(self, name: str) -> None:
        """Show a case of the folder, or the list of cases where `name` is ""."""
        ui.add_css(read_asset("case.css"))
        prepare_editor()
        self.frame = ui.element("div").classes("ft-stack")
        with self.frame, show_errors(self.folder):
            if not name:
                CaseList(self.folder, self._open_new).show()
                return
            text, opened = read_text(self.folder, name)
            self._show_case(text, name, opened)

    def _open_new(self, text: str, name: str) -> None:
        """Show a new case, which is not saved yet."""
        self.frame.clear()
        with self.frame:
            self._show_case(text, free_name(self.folder, name))

    # --- layout -----------------------------------------------------------------------------------------------
    def _show_case(self, text: str, name: str, opened: TextVersion | None = None) -> None:
        self.raw = try_parse(text) or {}
        self.saved = SavedText(self.folder, "case", text, opened)
        self._show_bar(name)
        self.consent = ui.column().classes("w-full gap-2")
        self._show_drawings()
        with ui.element("div").classes("ft-split ft-case"):
            with ui.element("div").classes("ft-stack"), card("Keys", KEYS_TEXT):
                self.title = ui.input("title, in plots and reports", on_change=lambda: self._title_typed())
                self.title.props("outlined dense debounce=150").classes("w-full")
                self.form = CaseForm(self._key_changed, self._add_material)
                self.form.show(self.raw)
            with ui.element("div").classes("ft-beside"):
                self._show_text(text)
        about = "What acts in addition to friction heat, conduction and cooling by the air."
        with card("Effects", about) as self.effects_box:
            self.cards = EffectCards(self._effect_switched, self._key_changed)
            self.cards.show(self.raw)
        self._fill()
        self._show_saved()
        ui.timer(0.05, self._check, once=True)
        ui.timer(0.5, self._measure_pace, once=True)

    def _show_bar(self, name: str) -> None:
        """Title, file name and the actions."""
        with ui.element("div").classes("ft-bar"):
            heading(1, "Case")
            self.name = ui.input("file", value=name, on_change=lambda: self._name_changed()).classes("ft-name")
            self.name.props("outlined dense")
            self.state = ui.label("being checked").classes("ft-chip").props("aria-live=polite")
            with ui.element("div").classes("ft-actions"):
                ui.link("All cases", page_address("case"))
                self.saved.show(self._save)
                self.run = action("Run it", start_once(self._run), icon="play_arrow", main=True)
                self.run.set_enabled(False)
                self.options = ui.link(OPTIONS_LABEL, options_address("run", name)).classes("ft-small")
                self.options.props('aria-label="Options of run"')

    def _show_drawings(self) -> None:
        """Block and schedule, the estimate, and the keys that differ from the defaults."""
        with card() as box:
            box.props["aria-label"] = "geometry and schedule"
            with ui.element("div").classes("ft-split") as self.pictures:
                self.block = Drawing(*case_sketch_view.BLOCK_BOX, "the block on the road")
                self.schedule = Drawing(*case_sketch_view.SCHEDULE_BOX, "the schedule")
            with ui.element("div").classes("ft-facts"):
                self.cost = ui.label("").classes("ft-strong")
                self.stale = ui.label(STALE_TEXT).classes("ft-muted ft-small")
                self.stale.set_visibility(False)
            self.remarks = RemarkList(self._go_to_key)
            self.remarks.show()
            self.differences = ui.element("div").classes("ft-chips").props('role=group aria-label="changed keys"')

    def _show_text(self, text: str) -> None:
        with card("Text", "This is what is saved. The form and the cards write into it."):
            self.faults = ui.column().classes("w-full gap-1").props("aria-live=polite")
            self.editor = TomlEditor(text, self._text_changed, "TOML text of the case")
            self.commands = ui.column().classes("w-full gap-1")
        self._show_commands()

    def _show_commands(self) -> None:
        self.commands.clear()
        with self.commands:
            name = self.name.value or "case.toml"
            for words in (["check", name], self.starter.command_words("run", name)):
                show_command(command_text(words))

    # --- edits ------------------------------------------------------------------------------------------------
    def _key_changed(self, key: CaseKey, value: Any) -> None:
        """Write the value of a field into the text."""
        text = set_toml_key(self.editor.text, key.table, key.name, value)
        is_named = value is None and named_table_kind(key.table)
        self.editor.set_text(remove_empty_table(text, key.table) if value is None and not is_named else text)

    def _title_typed(self) -> None:
        """Write the title into the text, which may state it in another way."""
        typed = self.title.value or None
        if typed != self.raw.get("title"):
            self.editor.set_text(set_toml_key(self.editor.text, "", "title", typed))

    def _effect_switched(self, entry: str, is_on: bool) -> None:
        """List an effect in the text, or take it out with its table, which comes back when it is switched on again."""
        entries = [e for e in listed_effects(self.raw) if e != entry] + ([entry] if is_on else [])
        text, name = self.editor.text, effect_name(entry)
        if is_on and name in self.removed_tables and name not in self.raw:
            text = add_toml_table(text, self.removed_tables.pop(name))
        elif not is_on:
            text, removed = remove_toml_table(text, name)
            if removed:
                self.removed_tables[name] = removed
        self.editor.set_text(set_toml_key(text, "", "effects", entries))

    def _add_material(self) -> None:
        """Add a material with the values of the block's, and give it to the block."""
        own = self.raw.get("materials")
        names, number = set(own) if isinstance(own, dict) else set(), 1
        while (name := OWN_MATERIAL if number == 1 else f"{OWN_MATERIAL}_{number}") in names:
            number += 1
        like = self.case.scene.block if self.case is not None else next(iter(LIBRARY.values()))
        text = self.editor.text
        for key in ("conductivity", "density", "heat_capacity"):
            text = set_toml_key(text, f"materials.{name}", key, float(getattr(like, key)))
        if not self.raw.get("layers"):
            text = set_toml_key(text, "block", "material", name)
        self.editor.set_text(text)

    def _name_changed(self) -> None:
        self._show_commands()
        self._show_saved()
        self.options.props["href"] = options_address("run", self.name.value or "")
        self._check_later()

    def _text_changed(self) -> None:
        """Update form and cards from the text, and check it after a pause."""
        tables = try_parse(self.editor.text)
        if tables is not None:
            self.raw = tables
            self._fill()
        self._show_saved()
        self._check_later()

    def _fill(self) -> None:
        title = self.raw.get("title")
        self.title.value = title if isinstance(title, str) else ""
        self.form.fill(self.raw)
        self.cards.fill(self.raw, self.case.known_effects if self.case is not None else {})
        self._show_differences()

    def _show_saved(self) -> None:
        self.saved.update(self.name.value or "", self.editor.text)

    def _fields(self) -> Iterable[KeyField]:
        return [*self.form.fields.values(), *self.cards.fields.values()]

    def _show_differences(self) -> None:
        """All keys that differ from their defaults, with a way to the field of each."""
        changed = [f for f in self._fields() if f.is_changed]
        effects = listed_effects(self.raw)
        shown = [(f.key.dotted, f.value_words(), f.default_words()) for f in changed]
        if (state := (shown, effects)) == getattr(self, "_shown_differences", None):
            return
        self._shown_differences = state
        self.differences.clear()
        with self.differences:
            self._show_effect_chips(effects)
            n = len(changed)
            text = f"{n} key{'' if n == 1 else 's'} changed:" if n else "Every key has its default."
            ui.label(text).classes("ft-small")
            for field, (key, value, default) in zip(changed, shown, strict=True):
                button = ui.element("button").classes("ft-chip")
                button.props["type"], button.props["title"] = "button", f"default {default}"
                with button:
                    ui.label(f"{escape_control(key)} {escape_control(value)}").classes("inline")
                    ui.label(f"(default {escape_control(default)})").classes("inline ft-muted")
                button.on("click", lambda _, f=field: self._go_to_field(f))

    def _show_effect_chips(self, effects: list[str]) -> None:
        """The effects that are on, each as a chip."""
        n = len(effects)
        ui.label(f"{n} effect{'' if n == 1 else 's'} on:" if n else "No effect is on.").classes("ft-small")
        for name in effects:
            ui.label(escape_control(name.replace("_", " "))).classes("ft-chip accent")
        change = ui.button("Change effects", on_click=self._go_to_effects).props("flat dense size=sm color=primary")
        change.classes("ft-noprint")
        ui.element("span").classes("ft-break")

    def _go_to_effects(self) -> None:
        ui.run_javascript(f'getHtmlElement({self.effects_box.id}).scrollIntoView({{block: "start"}})')
        self.cards.search.run_method("focus")

    def _go_to_key(self, key: str) -> None:
        """Go to the field of a key, or to the card of an effect."""
        found = next((f for f in self._fields() if f.key.dotted == key or f.key.table == key), None)
        if found is not None:
            self._go_to_field(found)
        else:
            self._go_to_effects()

    def _go_to_field(self, field: KeyField) -> None:
        """Open the group of a field and focus it."""
        for box, fields, _, _ in self.form.groups.values():
            if field in fields:
                box.open()
        field.field.run_method("focus")
        ui.run_javascript(f'getHtmlElement({field.box.id}).scrollIntoView({{block: "center"}})')

    # --- check ------------------------------------------------------------------------------------------------
    def _check_later(self) -> None:
        """Check after a pause in typing."""
        self.changes += 1
        background_tasks.create(self._check_after_pause(self.changes))

    async def _check_after_pause(self, change: int) -> None:
        await asyncio.sleep(TYPING_PAUSE_S)
        if change == self.changes:
            with self.frame:
                self._check()

    def _check(self) -> None:
        """Check the text and draw the case; effect files run only with consent."""
        self.case = None
        faults: list[TextFault] = []
        self.consent.clear()
        waits = False
        try:
            text, path = self.editor.text, resolve_inside(self.folder, self.name.value or "case.toml")
            if programs := self.allowed.unconfirmed_files(programs_of_text(text, path.parent)):
                waits = True
                with self.consent:
                    self._offer_programs(programs)
            else:
                self.case = parse_case(text, path)
        except (FlashtempError, OSError) as fault:
            faults = read_faults(fault, path) if "path" in locals() else [TextFault(0, "", str(fault))]
        self._show_state(faults, waits)
        self._show_faults(faults)
        self.remarks.update(self.case)
        if self.case is not None:
            self.cards.fill(self.raw, self.case.known_effects)
            self._draw(self.case)

    def _show_state(self, faults: list[TextFault], waits: bool) -> None:
        """Whether the case can run, in a word."""
        n = len(faults)
        word = "ready to run" if self.case is not None else f"{n} error{'s' if n > 1 else ''}" if n else "not checked"
        self.state.set_text(word)
        kind = "good" if self.case is not None else "warning" if waits else "error"
        self.state.classes(remove="good warning error", add=kind)
        self.run.set_enabled(self.case is not None)
        is_stale = self.case is None
        drawn = bool(self.block.props["shapes"])
        self.pictures.classes(add="ft-stale") if is_stale else self.pictures.classes(remove="ft-stale")
        self.pictures.set_visibility(drawn or not is_stale)
        self.stale.set_text(STALE_TEXT if drawn else NO_DRAWING_TEXT)
        self.stale.set_visibility(is_stale)

    def _show_faults(self, faults: list[TextFault]) -> None:
        """Show errors above the text, at their lines, at their fields and on their cards."""
        self.faults.clear()
        if faults:
            with self.faults, ui.column().classes("ft-note error gap-0").props("role=alert"):
                for fault in faults:
                    self.editor.show_fault(fault, self.folder)
        self.editor.mark_faults(faults)
        at_keys: dict[str, str] = {}
        for fault in faults:
            at_keys.setdefault(fault.key, fault.text)
        for field in self._fields():
            field.set_fault(relative_names(at_keys.get(field.key.dotted, ""), self.folder))
        self.cards.show_notes([f"{f.key}: {f.text}" if f.key else f.text for f in faults])

    def _draw(self, case: Case) -> None:
        self.block.draw(*case_sketch_view.draw_block(case))
        self.schedule.draw(*case_sketch_view.draw_schedule(case))
        self.cost.set_text(f"{case_cost.estimate_cost(case, self.pace)}".capitalize())

    async def _measure_pace(self) -> None:
        """Learn from the results in the folder how fast this computer is."""

        def measure() -> float:
            to_unit("1 mm", "m")  # loads the library of units before the first value with a unit is typed
            results = [path for path, command in list_folder(self.folder).results.items() if command == "run"]
            return case_cost.measure_pace(case_cost.latest_summaries(self.folder, results))

        self.pace = await run.io_bound(measure) or 1.0
        if self.case is not None:
            self._draw(self.case)

    # --- effect files and saving ------------------------------------------------------------------------------
    def _offer_programs(self, programs: list[Path]) -> None:
        """List the effect files that the check would run, with a button to allow it."""
        show_error("\n".join(["not checked yet", *program_lines(programs)]))
        label = "Run it to check the case" if len(programs) == 1 else "Run them to check the case"
        ui.button(label, on_click=lambda: self._run_programs(programs)).props("outline dense no-caps")

    def _run_programs(self, programs: list[Path]) -> None:
        self.allowed.allow(programs)
        self._check()

    async def _save(self) -> bool:
        """Save the text atomically, even with errors in it; False where it was not saved."""
        with self.frame:
            try:
                return await self.saved.save(self.name.value or "", self.editor.text)
            except (FlashtempError, OSError) as fault:
                with self.faults:
                    show_error(str(fault), self.folder)
                return False

    async def _run(self) -> bool:
        """Save the text, run the case and show its live view; whether it was started."""
        if await self._save():  # also an unchanged text: the file may have changed on disk
            with self.faults, show_errors(self.folder):
                return await self.starter.start(self.starter.command_words("run", self.name.value or ""))
        return False
