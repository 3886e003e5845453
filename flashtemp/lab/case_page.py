"""The page of a case: a form made from the declared keys, the TOML beside it, faults as one types, a drawing."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.api.inputs import case_of_text
from flashtemp.api.starting import new
from flashtemp.errors import FlashtempError
from flashtemp.lab.folder import free_name, inside
from flashtemp.lab.jobs import shown
from flashtemp.lab.shared import command_line, link, saved, told, when_it_fails
from flashtemp.lab.toml_text import edited
from flashtemp.model.case import Case
from flashtemp.model.schema import TABLES, declared
from flashtemp.model.toml_value import value_text
from flashtemp.physics.effect import Effect, Param, catalogue

HIDDEN = ("numerics", "output", "limits")  # tables folded at first


class CasePage:
    """One case as text; the form only writes into the text, so that there is one truth."""

    def __init__(self, folder: Path):
        self.folder, self.file = folder, ""
        self.case: Case | None = None
        self.inputs: dict[tuple[str, str], Any] = {}
        self.filling = False

    def show(self, name: str) -> None:
        """The page for a file of the folder, or for a new case."""
        with when_it_fails():
            path = inside(self.folder, name) if name else None
            text = path.read_text(encoding="utf-8") if path is not None else new("case").text
            self.file = name or free_name(self.folder, "case.toml")
            with ui.row().classes("w-full items-center"):
                self.name = ui.input("file", value=self.file).classes("w-96")
                ui.button("Save", on_click=self._save)
                ui.link("run it", "").bind_visibility_from(self, "case").on(
                    "click.prevent", lambda: ui.navigate.to(link("work", command="run", of=self.name.value))
                )
            self.faults = ui.column().classes("w-full gap-1").props("aria-live=polite")
            with ui.row().classes("w-full items-start no-wrap max-lg:flex-wrap"):
                self.form = ui.column().classes("w-full lg:w-1/2 gap-1")
                with ui.column().classes("w-full lg:w-1/2"):
                    self.text = ui.codemirror(text, language="TOML", on_change=lambda: self._typed()).classes(
                        "w-full h-96"
                    )
                    self.drawing = ui.html("", sanitize=False).classes("w-full")
            self._form()
            self._check()
            command_line(shown(["check", self.file]))

    # --- the form -----------------------------------------------------------------------------------------
    def _form(self) -> None:
        raw = self._raw()
        self.form.clear()
        self.inputs = {}
        with self.form:
            names = [n for n, e in catalogue().items() if not e.base]
            chosen = [n for n in raw.get("effects", []) if n in names] if isinstance(raw.get("effects"), list) else []
            self.effects = ui.select(
                names, multiple=True, value=chosen, label="effects", on_change=lambda: self._effects_chosen()
            ).classes("w-full").props("use-chips")  # fmt: skip
            for table in [*TABLES, *chosen]:
                self._table(table, raw)

    def _table(self, table: str, raw: dict[str, Any]) -> None:
        keys = declared(table)
        effect = catalogue().get(table)
        if not keys:
            return
        given = raw.get(table) if isinstance(raw.get(table), dict) else {}
        about = f"{table}: {effect.cause}" if isinstance(effect, type) and issubclass(effect, Effect) else table
        with ui.expansion(about, value=bool(given) and table not in HIDDEN).classes("w-full border rounded"):
            for key, param in keys.items():
                self._key(table, key, param, (given or {}).get(key))

    def _key(self, table: str, key: str, param: Param, given: Any) -> None:
        unit = "" if param.unit in ("", "1") else f" ({param.unit})"
        rest = "" if param.value is None else f"default {_written(param.value)}"
        field = ui.input(f"{key}{unit}", value="" if given is None else _written(given), placeholder=rest)
        field.classes("w-full").props(f'dense stack-label bottom-slots aria-label="{table}.{key}"')
        with field.add_slot("hint"):
            ui.label(f"{param.about}{_range(param)}").classes("text-xs")
        field.on("change", lambda: self._entered(table, key, field.value))
        self.inputs[table, key] = field

    def _entered(self, table: str, key: str, typed: str) -> None:
        """A field was filled in: its key in the text follows."""
        self._set(edited(self.text.value or "", table, key, _meant(typed)))

    def _effects_chosen(self) -> None:
        if not self.filling:
            self._set(edited(self.text.value or "", "", "effects", list(self.effects.value)))
            self._form()

    def _set(self, text: str) -> None:
        self.text.value = text
        self._check()

    # --- the text -----------------------------------------------------------------------------------------
    def _typed(self) -> None:
        """The text was changed: fields follow."""
        raw = self._raw()
        self.filling = True
        for (table, key), field in self.inputs.items():
            own = raw.get(table) if isinstance(raw.get(table), dict) else {}
            now = (own or {}).get(key)
            field.value = "" if now is None else _written(now)
        effects = raw.get("effects", [])
        if isinstance(effects, list) and set(effects) != set(self.effects.value) and set(effects) <= set(catalogue()):
            self.effects.value = effects
            self._form()
        self.filling = False
        self._check()

    def _raw(self) -> dict[str, Any]:
        try:
            return tomllib.loads(self.text.value or "")
        except (ValueError, RecursionError):
            return {}

    def _check(self) -> None:
        """Faults of the text as it stands, or a drawing of what it means."""
        self.faults.clear()
        try:
            self.case = case_of_text(self.text.value or "", inside(self.folder, self.name.value or "case.toml"))
            self.drawing.content = _drawing(self.case)
        except FlashtempError as fault:
            self.case = None
            with self.faults:
                told(str(fault).replace(f"{self.folder}/", ""))

    def _save(self) -> None:
        """Write the text as it stands, whole or not at all; faults do not hold it back."""
        with self.faults:
            try:
                saved(self.folder, self.name.value, self.text.value or "")
            except (FlashtempError, OSError) as fault:
                told(str(fault))
                return
        ui.notify(f"{self.name.value} is saved")


def _written(value: Any) -> str:
    """A value as TOML writes it; text without its quotes."""
    return value if isinstance(value, str) else value_text(value)


def _meant(typed: str | None) -> Any:
    """What was typed: a TOML value, bare words as text; None for nothing."""
    if not (typed or "").strip():
        return None
    try:
        return tomllib.loads(f"v = {typed}")["v"]
    except (ValueError, RecursionError):
        return (typed or "").strip()


def _range(param: Param) -> str:
    """The range of a key in words, where it has one."""
    if "number" not in param.kinds and "amount" not in param.kinds:
        return ""
    low, high = (f"{v:g}" if abs(v) < float("inf") else "" for v in (param.low, param.high))
    return f"; {low} to {high}" if low and high else f"; from {low}" if low else ""


def _drawing(case: Case) -> str:
    from flashtemp.viz.case_sketch import svg

    return svg(case)
