"""What camera files do not say and their reader needs, such as unit or scale: the fields that an error asks for."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from nicegui import ui

from flashtemp.camera.importing.import_options import CHOICES, ImportOptions
from flashtemp.lab.page_layout import action, card


@dataclass(frozen=True)
class ReaderField:
    """An option of the readers: its label on the page, and the value that the field shows first."""

    label: str
    usual: Any = None


READER_FIELDS: Final = {
    "scale": ReaderField("scale, °C per count", 0.04),
    "offset": ReaderField("offset, °C of count 0", -273.15),
    "unit": ReaderField("unit of the temperatures"),
    "decimal": ReaderField("decimal mark of a text file"),
    "rows": ReaderField("rows of one image in a text file"),
    "labels": ReaderField("labels around the numbers of a text file"),
    "variable": ReaderField("name of the array"),
    "below": ReaderField("lowest temperature of the camera, °C"),
    "every": ReaderField("keep one frame of so many"),
    "limit": ReaderField("memory that one file may take, GB"),
}
WHOLE_NUMBERS: Final = ("rows", "every")
TEXT_FIELDS: Final = ("variable",)
HOW_TO_READ: Final = "State what these files do not say. An empty field leaves it to the program."
HOW_TO_SCALE: Final = (
    "The temperature is scale times count plus offset.  The camera's program states both; usual scales are 0.01, 0.04, "
    "0.1 and 0.4 °C."
)


def find_reader_fields(message: str) -> list[str]:
    """The options of the readers that an error message of the command line names.

    >>> find_reader_fields("values in an unknown unit; give --unit degC, or --scale and --offset for counts")
    ['scale', 'offset', 'unit']
    """
    named = set(re.findall(r"(?<![\w-])--([a-z]+)", message))
    return [name for name in READER_FIELDS if name in named]


def show_reader_form(message: str, facts: ImportOptions, reopen: Callable[[ImportOptions], Awaitable[None]]) -> None:
    """Show fields for what an error message asks for; `reopen` is called with the options that they complete."""
    names = find_reader_fields(message)
    if not names:
        return
    boxes: dict[str, Any] = {}
    with card("How to read these files", HOW_TO_READ + (f" {HOW_TO_SCALE}" if "scale" in names else "")):
        with ui.row().classes("gap-3"):
            for name in names:
                boxes[name] = _add_field(name, getattr(facts, name))

        async def use() -> None:
            values = {name: _read_field(name, box.value) for name, box in boxes.items()}
            if values.get("unit") is not None:  # temperatures, no counts
                values |= {name: None for name in ("scale", "offset") if name in values}
            await reopen(replace(facts, **values))

        action("Open again", use, main=True).classes("self-start")


def _add_field(name: str, stated: Any) -> Any:
    """A field with the value that is stated, or else the usual one."""
    field = READER_FIELDS[name]
    value = field.usual if stated is None else stated
    if name in CHOICES:
        box: Any = ui.select(list(CHOICES[name]), value=value, label=field.label).classes("min-w-64")
        return box.props("outlined dense clearable")
    box = ui.input(field.label, value=value) if name in TEXT_FIELDS else ui.number(field.label, value=value)
    return box.classes("min-w-64").props("outlined dense clearable")


def _read_field(name: str, value: Any) -> Any:
    """The value of a field as its option takes it; None for an empty one."""
    if value in (None, ""):
        return None
    if name in CHOICES or name in TEXT_FIELDS:
        return str(value)
    return int(value) if name in WHOLE_NUMBERS else float(value)
