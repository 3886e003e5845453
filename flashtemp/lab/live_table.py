"""A table on the page whose rows are replaced while a command runs; cells are texts, never HTML."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement

from flashtemp.lab.live_state import finite_number
from flashtemp.lab.workspace import escape_control

Cells = Sequence[Sequence[str]]


class LiveTable:
    """An empty table; `show_rows` fills it anew where its content has changed."""

    def __init__(self) -> None:
        with ui.element("div").classes("ft-scroll"):
            self.table = ui.element("table").classes("ft-table")
        self.content: list[list[str]] = []

    def show_rows(self, head: Sequence[str], rows: Cells) -> None:
        """Show a heading and rows of cells; nothing without rows."""
        content = [[*head], *([*row] for row in rows)] if rows else []
        if content == self.content:
            return
        self.content = content
        self.table.clear()
        with self.table:
            for number, row in enumerate(content):
                with ui.element("tr"):
                    for cell in row:
                        TextElement(tag="td" if number else "th", text=escape_control(cell))


def cells_of_rows(rows: Sequence[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """The heading and the cells of rows {name: value}.

    >>> cells_of_rows([{"friction.mu": 0.5}, {"friction.mu": 1, "note": "b"}])
    (['friction.mu', 'note'], [['0.5', ''], ['1', 'b']])
    """
    names = list(dict.fromkeys(str(name) for row in rows for name in row))
    return names, [[format_cell(row.get(name)) for name in names] for row in rows]


def format_cell(value: Any) -> str:
    """A value as the text of a cell: a number with four figures."""
    number = finite_number(value)
    return f"{number:.4g}" if number is not None else "" if value is None else str(value)
