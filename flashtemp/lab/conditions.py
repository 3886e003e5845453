"""The keys of a result's case in words: which differ from the defaults, and which differ between results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from nicegui import ui

from flashtemp.lab.key_units import describe_value
from flashtemp.lab.page_layout import card, page_address
from flashtemp.lab.result_files import ResultFolder
from flashtemp.lab.result_parts import folded_part, show_table
from flashtemp.lab.start_button import CommandStarter, options_address
from flashtemp.lab.workspace import escape_control
from flashtemp.model.schema import UNDECLARED_PARAM, declared_params
from flashtemp.physics.effect import Param

OUTPUT_TABLES = ("output", "numerics")  # of a case: how it is computed and drawn, not what
LEFT_OUT_KEYS = ("title", "free")
MAX_VALUE_CHARACTERS = 200
NEEDS_WORDS = ("sweep",)  # commands that a case alone does not state


@dataclass(frozen=True)
class KeyValue:
    """A key of a case: what it means, its value with its unit, and whether that differs from the default."""

    key: str
    meaning: str
    value: str
    is_changed: bool

    @property
    def is_output(self) -> bool:
        """Whether the key only states how the result is computed and drawn."""
        return self.key.partition(".")[0] in OUTPUT_TABLES


def describe_values(values: Mapping[str, Any]) -> dict[str, KeyValue]:
    """{key: its value in words} of the keys of a case, in the units of the case page."""
    tables = {table: declared_params(table) for table in {key.rpartition(".")[0] for key in values}}
    out = {}
    for key, value in values.items():
        if key not in LEFT_OUT_KEYS:
            table, _, name = key.rpartition(".")
            param = tables[table].get(name)
            is_changed = value != [] and (param is None or value != param.value)
            meaning = escape_control(key.replace("_", " ")) if param is None else param.about
            out[key] = KeyValue(escape_control(key), meaning, _describe_value(value, param), is_changed)
    return out


def _describe_value(value: Any, param: Param | None) -> str:
    """A value as text: a number with its unit, yes or no, or a short list."""
    if isinstance(value, (list, tuple)):
        text = ", ".join(map(str, value)) or "none"
    else:
        text = describe_value(value, param or UNDECLARED_PARAM)
    return escape_control(text)[:MAX_VALUE_CHARACTERS]


def different_keys(cases: Sequence[Mapping[str, Any]]) -> list[str]:
    """Keys that do not have the same value in all cases, physical ones first."""
    keys = dict.fromkeys(key for case in cases for key in case if key not in LEFT_OUT_KEYS)
    out = [key for key in keys if any(case.get(key) != cases[0].get(key) for case in cases)]
    return sorted(out, key=lambda key: key.partition(".")[0] in OUTPUT_TABLES)


def show_conditions(result: ResultFolder, values: Mapping[str, Any], starter: CommandStarter) -> None:
    """Show the conditions of a result, and the button that computes it again into a new folder."""
    with card("Conditions", "Keys that differ from the defaults of the program; those of the computation come last."):
        rows = list(describe_values(values).values())
        head = ("key", "meaning", "value")
        changed = sorted((r for r in rows if r.is_changed), key=lambda r: r.is_output)
        if changed:
            show_table(head, [(r.key, r.meaning, r.value) for r in changed], "conditions", numbers=(2,))
        else:
            ui.label("All keys have their default values.").classes("ft-muted")
        with folded_part("All keys"):
            show_table(head, [(r.key, r.meaning, r.value) for r in rows], "all keys of the case", numbers=(2,))
        case = result.here / "case.toml"
        if result.command not in NEEDS_WORDS:
            options = ["--area"] if result.find_file("area.json") is not None else []
            words = partial(starter.repeat_words, result.command, result.here, options)
            starter.show("Run it again", result.command, case, words=words)
        with ui.row().classes("gap-4"):
            ui.link("Open the case", page_address("case", open=case))
            if result.command in NEEDS_WORDS:
                ui.link(f"Another {result.command}", options_address(result.command, case))
