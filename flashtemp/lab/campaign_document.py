"""A campaign as its text, which every control of the page edits; nothing else is its state."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from flashtemp.errors import BadInput
from flashtemp.lab.toml_editing import try_parse
from flashtemp.lab.toml_tables import Table, read_entries
from flashtemp.lab.workspace import resolve_inside
from flashtemp.model.case_file import parse_toml
from flashtemp.model.toml_format import value_text

MAX_PLAIN_NUMBER: Final = 1e6  # larger whole numbers are shown with an exponent


class CampaignDocument:
    """The text of the campaign `name` of the folder; `changed` is called after an edit, `refused` with its error."""

    def __init__(self, folder: Path, name: str, text: str):
        self.folder, self.name, self.text = folder, name, text
        self._parsed: tuple[str, dict[str, Any] | None] | None = None  # a text and its tables
        self.changed: Callable[[], Any] = lambda: None
        self.refused: Callable[[str], Any] = lambda error: None

    @property
    def path(self) -> Path:
        """The resolved path of the campaign file.  Raises BadInput."""
        return resolve_inside(self.folder, self.name or "campaign.toml")

    @property
    def raw(self) -> dict[str, Any] | None:
        """The tables of the text, which must not be changed; None where it is not TOML."""
        if self._parsed is None or self._parsed[0] != self.text:
            self._parsed = (self.text, try_parse(self.text))
        return self._parsed[1]

    def list_entries(self, kind: str) -> list[Table]:
        """The entries [[recording]] or [[force]]."""
        return read_entries(self.raw or {}, kind)

    def apply_edit(self, edit: Callable[[str], str]) -> bool:
        """Edit the text; False where the edit is refused."""
        try:
            text = edit(self.text)
        except BadInput as fault:
            self.refused(str(fault))
            return False
        if text != self.text:
            self.text = text
            self.changed()
        return True

    def find_file(self, name: Any) -> Path | None:
        """The path of a file that the campaign names; None where that is no file name or lies outside the folder."""
        if not isinstance(name, str) or not name:
            return None
        try:
            return resolve_inside(self.folder, os.path.relpath(self.path.parent / name, self.folder.resolve()))
        except (BadInput, ValueError):
            return None

    def relative_name(self, path: Path) -> str:
        """A file, relative to the folder of the page, as the campaign names it."""
        return Path(os.path.relpath(self.folder / path, (self.folder / self.name).parent)).as_posix()


def format_cell(value: Any) -> str:
    """A value of the text for a cell: TOML, a text without its quotes, nothing for None.

    >>> format_cell(150000.0), format_cell(2.5e8), format_cell("150 kPa"), format_cell(None)
    ('150000', '2.5e8', '150 kPa', '')
    """
    if isinstance(value, float) and value.is_integer() and abs(value) < MAX_PLAIN_NUMBER:
        return str(int(value))
    return "" if value is None else value if isinstance(value, str) else value_text(value)


def parse_cell(typed: str | None, unit: str = "") -> Any:
    """The value of a typed cell: TOML, a number without the `unit` of its key, or the text; None for an empty cell.

    >>> parse_cell("1.5e5"), parse_cell("150 kPa", "Pa"), parse_cell(" 2e5 Pa", "Pa"), parse_cell("")
    (150000.0, '150 kPa', 200000.0, None)
    """
    text = (typed or "").strip()
    if not text:
        return None
    bare = text.removesuffix(unit).strip() if unit not in ("", "1") else text
    for candidate in (bare, text):
        try:
            if isinstance(value := parse_toml(f"v = {candidate}")["v"], (int, float, list, dict)):
                return value
        except (ValueError, RecursionError, KeyError):
            continue
    return text
