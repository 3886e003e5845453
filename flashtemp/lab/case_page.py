"""The case page: a form of all declared keys, the TOML text, errors while typing, and a sketch."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.api.inputs import parse_case
from flashtemp.api.templates import new
from flashtemp.lab.jobs import command_text
from flashtemp.lab.page_layout import page_address, program_lines, save_text, show_command, show_error, show_errors
from flashtemp.lab.programs import AllowedPrograms, programs_of_text
from flashtemp.lab.saving import TextVersion, read_text
from flashtemp.lab.toml_editing import set_toml_key
from flashtemp.lab.workspace import escape_control, free_name, resolve_inside
from flashtemp.model.case import Case
from flashtemp.model.case_file import parse_toml
from flashtemp.model.schema import CASE_TABLES, declared_params
from flashtemp.model.toml_format import value_text
from flashtemp.physics.effect import Effect, Param, catalogue

FOLDED_TABLES = ("numerics", "output", "limits")  # folded when the page opens


class CasePage:
    """One case as text; the form only edits the text, which alone is saved."""

    def __init__(self, folder: Path, allowed: AllowedPrograms | None = None):
        self.folder, self.file, self.allowed = folder, "", allowed or AllowedPrograms()
        self.opened: TextVersion | None = None
        self.case: Case | None = None
        self.inputs: dict[tuple[str, str], Any] = {}
        self.filling = False

    def show(self, name: str) -> None:
        """Show a case of the folder, or a new case where `name` is ""."""
        with show_errors(self.folder):
            text, self.opened = read_text(self.folder, name) if name else (new("case").text, None)
            self.file = name or free_name(self.folder, "case.toml")
            with ui.row().classes("w-full items-center"):
                self.name = ui.input("file", value=self.file).classes("w-96")
                ui.button("Save", on_click=self._save)
                ui.link("run it", "").bind_visibility_from(self, "case").on(
                    "click.prevent", lambda: ui.navigate.to(page_address("runs", command="run", of=self.name.value))
                )
            self.faults = ui.column().classes("w-full gap-1").props("aria-live=polite")
            with ui.row().classes("w-full items-start no-wrap max-lg:flex-wrap"):
                self.form = ui.column().classes("w-full lg:w-1/2 gap-1")
                with ui.column().classes("w-full lg:w-1/2"):
                    self.text = ui.codemirror(text, language="TOML", on_change=lambda: self._text_changed()).classes(
                        "w-full h-96"
                    )
                    self.drawing = ui.element("img").props('alt="sketch of the case"').classes("w-full")
            self._build_form()
            self._check()
            show_command(command_text(["check", self.file]))

    # --- the form -----------------------------------------------------------------------------------------
    def _build_form(self) -> None:
        raw = self._parse_text()
        self.form.clear()
        self.inputs = {}
        with self.form:
            names = [n for n, e in catalogue().items() if not e.base]
            chosen = [n for n in raw.get("effects", []) if n in names] if isinstance(raw.get("effects"), list) else []
            self.effects = ui.select(
                names, multiple=True, value=chosen, label="effects", on_change=lambda: self._effects_chosen()
            ).classes("w-full").props("use-chips")  # fmt: skip
            for table in [*CASE_TABLES, *chosen]:
                self._add_table(table, raw)

    def _add_table(self, table: str, raw: dict[str, Any]) -> None:
        keys = declared_params(table)
        effect = catalogue().get(table)
        if not keys:
            return
        stated = raw.get(table) if isinstance(raw.get(table), dict) else {}
        about = f"{table}: {effect.cause}" if isinstance(effect, type) and issubclass(effect, Effect) else table
        with ui.expansion(about, value=bool(stated) and table not in FOLDED_TABLES).classes("w-full border rounded"):
            for key, param in keys.items():
                self._add_field(table, key, param, (stated or {}).get(key))

    def _add_field(self, table: str, key: str, param: Param, stated: Any) -> None:
        unit = "" if param.unit in ("", "1") else f" ({param.unit})"
        default = "" if param.value is None else f"default {_format_value(param.value)}"
        field = ui.input(f"{key}{unit}", value="" if stated is None else _format_value(stated), placeholder=default)
        field.classes("w-full").props("dense stack-label bottom-slots")
        field.props["aria-label"] = f"{table}.{key}"
        with field.add_slot("hint"):
            ui.label(f"{param.about}{_describe_range(param)}").classes("text-xs")
        field.on("change", lambda: self._field_changed(table, key, field.value))
        self.inputs[table, key] = field

    def _field_changed(self, table: str, key: str, typed: str) -> None:
        """Write the value of a field into the text."""
        self._set_text(set_toml_key(self.text.value or "", table, key, _parse_value(typed)))

    def _effects_chosen(self) -> None:
        if not self.filling:
            self._set_text(set_toml_key(self.text.value or "", "", "effects", list(self.effects.value)))
            self._build_form()

    def _set_text(self, text: str) -> None:
        self.text.value = text
        self._check()

    # --- the text -----------------------------------------------------------------------------------------
    def _text_changed(self) -> None:
        """Update the fields from the text."""
        raw = self._parse_text()
        self.filling = True
        for (table, key), field in self.inputs.items():
            stated = raw.get(table) if isinstance(raw.get(table), dict) else {}
            value = (stated or {}).get(key)
            field.value = "" if value is None else _format_value(value)
        effects = raw.get("effects", [])
        if isinstance(effects, list) and set(effects) != set(self.effects.value) and set(effects) <= set(catalogue()):
            self.effects.value = effects
            self._build_form()
        self.filling = False
        self._check()

    def _parse_text(self) -> dict[str, Any]:
        try:
            return parse_toml(self.text.value or "")
        except (ValueError, RecursionError):
            return {}

    def _check(self) -> None:
        """Show the errors of the text, or a sketch of the case; effect files run only with consent."""
        self.faults.clear()
        self.case, drawing = None, ""
        with self.faults, show_errors(self.folder):
            text, path = self.text.value or "", resolve_inside(self.folder, self.name.value or "case.toml")
            if programs := self.allowed.unconfirmed_files(programs_of_text(text, path.parent)):
                self._offer_programs(programs)
            else:
                self.case = parse_case(text, path)
                drawing = _drawing_address(self.case)
        self.drawing.props["src"] = drawing
        self.drawing.set_visibility(bool(drawing))

    def _offer_programs(self, programs: list[Path]) -> None:
        """List the effect files that the check would run, with a button to allow it."""
        show_error("\n".join(["not checked yet", *program_lines(programs)]))
        label = "Run it to check the case" if len(programs) == 1 else "Run them to check the case"
        ui.button(label, on_click=lambda: self._run_programs(programs)).props("outline dense no-caps")

    def _run_programs(self, programs: list[Path]) -> None:
        self.allowed.allow(programs)
        self._check()

    async def _save(self) -> None:
        """Save the text atomically, even with errors in it."""
        name = self.name.value or ""
        with self.faults, show_errors(self.folder):
            if (version := await save_text(self.folder, name, self.text.value or "", self.opened)) is None:
                return
            self.opened = version
            ui.notify(f"{escape_control(name)} is saved")


def _format_value(value: Any) -> str:
    """A value in TOML; a text without its quotes."""
    return value if isinstance(value, str) else value_text(value)


def _parse_value(typed: str | None) -> Any:
    """A typed value: TOML, or else the text itself; None where nothing was typed."""
    if not (typed or "").strip():
        return None
    try:
        return parse_toml(f"v = {typed}")["v"]
    except (ValueError, RecursionError):
        return (typed or "").strip()


def _describe_range(param: Param) -> str:
    """The range of a numeric key in words, "" for others."""
    if "number" not in param.kinds and "amount" not in param.kinds:
        return ""
    low, high = (f"{v:g}" if abs(v) < float("inf") else "" for v in (param.low, param.high))
    return f"; {low} to {high}" if low and high else f"; from {low}" if low else ""


def _drawing_address(case: Case) -> str:
    """The sketch of a case as a data address of an image, in which no script runs; "" where it cannot be drawn."""
    from flashtemp.viz.run.case_sketch import sketch_svg

    try:
        text = sketch_svg(case)
    except ValueError as fault:  # a layer's name that matplotlib reads as a formula
        show_error(f"not drawn: {' '.join(str(fault).split())}")
        return ""
    return "data:image/svg+xml;base64," + b64encode(text.encode()).decode()
