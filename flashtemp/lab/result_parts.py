"""Parts that the pages of results share: main numbers, tables of text, loading in the background."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nicegui import run, ui
from nicegui.elements.mixins.text_element import TextElement

from flashtemp.errors import BadInput, FlashtempError
from flashtemp.lab.page_layout import add_script, chip, show_errors
from flashtemp.lab.style import read_asset
from flashtemp.lab.workspace import escape_control

MAX_TABLE_ROWS = 200
MAX_ROWS = 200  # records of a JSON file that are shown
MAX_CELL_CHARACTERS = 400
MAX_NUMBER_CHARACTERS = 30  # of a cell that never breaks into lines
MAX_ANSWER_LINES = 6  # sentences of an answer that are not folded


@dataclass(frozen=True)
class MainNumber:
    """One number of a result: what it is, its value as text, its unit, and a remark of second rank."""

    label: str
    value: str
    unit: str = ""
    remark: str = ""


def record_list(value: Any) -> list[dict[str, Any]]:
    """The tables in a list of a JSON file."""
    return [v for v in value if isinstance(v, dict)][:MAX_ROWS] if isinstance(value, list) else []


def text_list(value: Any) -> list[str]:
    """The entries of a list of a JSON file as texts."""
    return [str(v) for v in value[:MAX_ROWS]] if isinstance(value, list) else []


def stored_number(value: Any) -> float:
    """A number of a JSON file, infinite ones as text; NaN for null and for anything else."""
    try:
        return float(value) if isinstance(value, (int, float)) or value in ("inf", "-inf") else math.nan
    except OverflowError:  # an integer of hundreds of digits
        return math.nan


def percent_change(ln_change: float) -> float:
    """A change of a logarithm as a change in %; infinite beyond the numbers that a computer holds.

    >>> round(percent_change(0.05), 2), percent_change(1e4), percent_change(-1e4)
    (5.13, inf, -100.0)
    """
    try:
        return 100.0 * math.expm1(ln_change)
    except OverflowError:
        return math.inf


def number_text(value: Any) -> str:
    from flashtemp.viz.number_format import format_number

    return format_number(stored_number(value))


def add_result_assets() -> None:
    """Add the style sheet of results and the script of charts to this page, before it is open.

    A script that is added to an open page would not run, and the charts are drawn then.
    """
    ui.add_css(read_asset("results.css"))
    add_script("charts.js")


def show_figures(numbers: Sequence[MainNumber]) -> None:
    """Show the main numbers of a result in large type."""
    with ui.element("dl").classes("ft-figures m-0"):
        for number in numbers:
            with ui.element("div"):
                write_text("dt", number.label).classes("ft-muted ft-small")
                with write_text("dd", number.value).classes("ft-figure m-0"):
                    write_text("span", number.unit).classes("ft-unit")
                if number.remark:
                    write_text("dd", number.remark).classes("ft-muted ft-small m-0")


def show_answer(sentences: Sequence[str], numbers: Sequence[MainNumber] = (), grade: str = "", state: str = "") -> None:
    """Show the answer of a result: its first sentence in large type, the others as a list, and the main numbers.

    `grade` good, warning or error colours the card; `state` is that in words.
    """
    with ui.element("section").classes(f"ft-card ft-answer-card {grade}").props('aria-label="answer"'):
        if state:
            with ui.row():  # as wide as its words
                chip(state, grade)
        show_sentences(sentences or ["This result holds no numbers."])
        if numbers:
            show_figures(numbers)


def show_sentences(sentences: Sequence[str]) -> None:
    """Show the first sentence in large type and the others as a list, of which many are folded."""
    write_text("p", sentences[0]).classes("ft-answer m-0")
    if sentences[1:]:
        show_list(sentences[1:MAX_ANSWER_LINES])
    if len(sentences) > MAX_ANSWER_LINES:
        with folded_part(f"{len(sentences) - MAX_ANSWER_LINES} further findings"):
            show_list(sentences[MAX_ANSWER_LINES:])


def write_text(tag: str, text: str) -> Any:
    """An element with a text that the page shows as it is."""
    return TextElement(tag=tag, text=escape_control(str(text)))


def show_table(head: Sequence[str], rows: Sequence[Sequence[str]], about: str, numbers: Sequence[int] = ()) -> None:
    """Show a table of texts; `about` names it for screen readers, `numbers` are columns aligned to the right."""
    with ui.element("div").classes("ft-scroll"), ui.element("table").classes("ft-table") as table:
        table.props["aria-label"] = about
        with ui.element("thead"), ui.element("tr"):
            for k, name in enumerate(head):
                write_text("th", name).classes("number" if k in numbers else "").props("scope=col")
        with ui.element("tbody"):
            for row in rows[:MAX_TABLE_ROWS]:
                with ui.element("tr"):
                    for k, value in enumerate(row):
                        text = value if len(value) <= MAX_CELL_CHARACTERS else f"{value[:MAX_CELL_CHARACTERS]}..."
                        is_number = k in numbers and len(text) <= MAX_NUMBER_CHARACTERS
                        kind = "number" if is_number else "words" if len(text) > 40 else ""
                        write_text("td", text).classes(kind)
    if len(rows) > MAX_TABLE_ROWS:
        ui.label(f"and {len(rows) - MAX_TABLE_ROWS} more rows").classes("ft-muted ft-small")


def show_list(lines: Sequence[str]) -> None:
    """Show sentences as a list."""
    with ui.element("ul").classes("ft-lines"):
        for line in lines:
            write_text("li", line)


@contextmanager
def folded_part(title: str, opened: bool = False) -> Iterator[Any]:
    """Context manager: a part of a card that opens with a click."""
    with ui.expansion(escape_control(title), value=opened).classes("w-full").props("dense expand-separator") as part:
        yield part


@contextmanager
def refuse_unreadable(what: str) -> Iterator[None]:
    """Context manager: any exception while a part of a result is shown becomes BadInput, since its file is damaged."""
    try:
        yield
    except (FlashtempError, OSError):
        raise
    except Exception as fault:  # values of types and shapes that no command of flashtemp writes
        raise BadInput(f"{what}: cannot be shown ({type(fault).__name__}); run the command again") from fault


def load_later(folder: Path, what: str, read: Callable[[], Any], show: Callable[[Any], None | Awaitable[None]]) -> None:
    """Read in the background once the page is open, then show; errors are shown in place.

    `what` is read, in words, for the line that is shown meanwhile.
    """
    place = ui.column().classes("w-full gap-4 items-stretch")
    with place, ui.row().classes("items-center gap-2 ft-muted"):
        ui.spinner(size="sm")
        ui.label(f"Reading {what} ...")

    async def load() -> None:
        fault: Exception | None = None
        content: Any = None
        try:
            content = await run.io_bound(read)
        except Exception as caught:
            fault = caught
        place.clear()
        with place, show_errors(folder), refuse_unreadable(what):
            if fault is not None:
                raise fault
            if content is not None and (ends := show(content)) is not None:
                await ends

    ui.timer(0.05, load, once=True)
