"""Display and storage of results: text, HTML tables for notebooks, standard JSON, atomic file writes."""

from __future__ import annotations

import json
import os
import re
import secrets
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from flashtemp.errors import RenamedAttribute

MAX_TABLE_ROWS = 40  # rows of a table in a notebook
TITLE_STYLE = "font-weight: 600; margin: .3em 0"
NOTE_STYLE = "margin: .2em 0"


class DisplayMixin:
    """Base of results: `repr` is the text of `__str__`, and a notebook shows `to_table` as HTML.

    A subclass defines `__str__` and, if that text is a table, `to_table`.
    """

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return self.to_table().to_html()

    def to_table(self) -> DisplayTable:
        """The text of `__str__` with its first line as the title."""
        title, *notes = str(self).splitlines()
        return DisplayTable(title, notes=tuple(note.strip() for note in notes))

    sheet = RenamedAttribute("to_table")


@dataclass(frozen=True)
class DisplayTable:
    """Contents of a notebook table: title, `rows` of cells below a `head`, `notes`, and `parts` that unfold.

    >>> DisplayTable("a < b", rows=[("mu", 0.25, "1")]).to_html().count("&lt;")
    1
    """

    title: str
    rows: Sequence[Sequence[Any]] = ()
    head: Sequence[str] = ()
    notes: Sequence[str] = ()
    parts: Sequence[DisplayTable] = ()

    def to_html(self) -> str:
        """An HTML fragment; every text is escaped."""
        return f'<div><p style="{TITLE_STYLE}">{escape(self.title)}</p>{self._inner_html()}</div>'

    def _inner_html(self) -> str:
        notes = "".join(f'<p style="{NOTE_STYLE}">{escape(note)}</p>' for note in self.notes)
        folded = "".join(
            f"<details><summary>{escape(part.title)}</summary>{part._inner_html()}</details>" for part in self.parts
        )
        return _html_table(self.head, self.rows) + notes + folded


def _html_table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """The first MAX_TABLE_ROWS rows as an HTML table; numbers to four digits."""
    if not rows:
        return ""
    top = f"<thead>{_html_row('th', head)}</thead>" if head else ""
    body = "".join(_html_row("td", map(format_value, row)) for row in rows[:MAX_TABLE_ROWS])
    more = f'<p style="{NOTE_STYLE}">and {len(rows) - MAX_TABLE_ROWS} more</p>' if len(rows) > MAX_TABLE_ROWS else ""
    return f"<table>{top}<tbody>{body}</tbody></table>{more}"


def _html_row(tag: str, cells: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"


def format_value(value: Any) -> str:
    """A value as text: numbers to four digits, yes or no, lists with commas, nothing for None.

    >>> format_value(0.123456), format_value(None), format_value((1, 2.0)), format_value(True)
    ('0.1235', '', '1, 2', 'yes')
    """
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    return ", ".join(map(format_value, value)) if isinstance(value, (list, tuple)) else str(value)


def make_json_safe(data: Any) -> Any:
    """Data with infinite numbers as text and NaN as null, which standard JSON requires.

    >>> make_json_safe({"a": [float("nan"), float("-inf")]})
    {'a': [None, '-inf']}
    """
    if isinstance(data, dict):
        return {k: make_json_safe(v) for k, v in data.items()}
    if isinstance(data, (list, tuple)):
        return [make_json_safe(v) for v in data]
    if isinstance(data, float) and data != data:
        return None
    if isinstance(data, float) and abs(data) == float("inf"):
        return "inf" if data > 0 else "-inf"
    return data


class ProgressMessage(str):
    """A progress message with `details` as plain data, which the web app draws while the command runs.

    >>> message = ProgressMessage("fitting wear", fitting=["wear"])
    >>> message, dict(message.details)
    ('fitting wear', {'fitting': ['wear']})
    """

    details: Mapping[str, Any]

    def __new__(cls, text: str, **details: Any) -> ProgressMessage:
        """The message `text`; details of a message that `text` is already are kept."""
        message = super().__new__(cls, text)
        message.details = {**getattr(text, "details", {}), **details}
        return message


def to_json(data: Any) -> str:
    """Plain data as indented JSON text."""
    return json.dumps(make_json_safe(data), indent=2, default=float)


def write_json(data: Any, file: Path) -> None:
    """Write plain data to a JSON file atomically."""
    with atomic_write(file) as fresh:
        fresh.write_text(to_json(data) + "\n", encoding="utf-8")


def format_count(count: int, thing: str) -> str:
    """A count with its noun in singular or plural.

    >>> format_count(1, "frame"), format_count(2, "frame")
    ('1 frame', '2 frames')
    """
    return f"{count} {thing}{'' if count == 1 else 's'}"


PARTIAL_FILE_NAME = re.compile(r"\.[0-9a-f]{16}(\.[A-Za-z0-9]+)?")  # names of files that are being written


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`; it replaces `path` when all is on disk.

    A failure leaves an existing `path` unchanged.  Raises OSError with the name of `path`.
    """
    fresh = path.with_name(f".{secrets.token_hex(8)}{path.suffix}")
    try:
        yield fresh
        with fresh.open("r+b") as file:  # Windows syncs only files opened for writing
            os.fsync(file.fileno())
        fresh.replace(path)
    except OSError as fault:
        if str(fault.filename) != str(fresh):
            raise
        raise OSError(fault.errno, fault.strerror, str(path)) from fault  # report the name that the user gave
    finally:
        fresh.unlink(missing_ok=True)
