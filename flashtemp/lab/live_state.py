"""The state file of a command, read as data of a stranger: every value is checked for its type and size."""

from __future__ import annotations

import json
import math
import os
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

MAX_STATE_BYTES = 4 * 2**20
MAX_ROWS = 2000  # of a list that is shown


@dataclass(frozen=True)
class LiveState:
    """Sections of a state file (see `runs.results.live_state`); missing or odd values are None, "" or []."""

    sections: dict[str, Any] = field(default_factory=dict)

    def find_value(self, *keys: str) -> Any:
        """The value at a path of keys, None where there is none."""
        value: Any = self.sections
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else None
        return value

    def number(self, *keys: str) -> float | None:
        """A finite number at a path of keys."""
        return finite_number(self.find_value(*keys))

    def text(self, *keys: str) -> str:
        """A text at a path of keys."""
        value = self.find_value(*keys)
        return value if isinstance(value, str) else ""

    def numbers(self, *keys: str) -> list[float]:
        """A list of numbers at a path of keys, NaN for what is none."""
        return number_list(self.find_value(*keys))

    def rows(self, *keys: str) -> list[dict[str, Any]]:
        """A list of tables at a path of keys."""
        value = self.find_value(*keys)
        return [row for row in value[:MAX_ROWS] if isinstance(row, dict)] if isinstance(value, list) else []

    def names(self, *keys: str) -> list[str]:
        """A list of texts at a path of keys."""
        value = self.find_value(*keys)
        return [name for name in value[:MAX_ROWS] if isinstance(name, str)] if isinstance(value, list) else []


def finite_number(value: Any) -> float | None:
    """A finite number, None for anything else.

    >>> finite_number(2), finite_number("2"), finite_number(float("nan")), finite_number(True)
    (2.0, None, None, None)
    """
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    try:
        return float(value) if is_number and math.isfinite(value) else None
    except OverflowError:  # an integer of hundreds of digits
        return None


def number_list(value: Any) -> list[float]:
    """A list of numbers, NaN for entries that are none."""
    entries = value[:MAX_ROWS] if isinstance(value, list) else []
    return [math.nan if (number := finite_number(entry)) is None else number for entry in entries]


def read_live_state(file: Path) -> LiveState:
    """The state in a file; empty where it is missing, not a regular file, too large or damaged."""
    try:
        found = os.lstat(file)
        if not stat.S_ISREG(found.st_mode) or found.st_size > MAX_STATE_BYTES:
            return LiveState()
        sections = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return LiveState()
    return LiveState(sections) if isinstance(sections, dict) else LiveState()
