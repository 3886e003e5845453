"""Arguments that all public functions accept: cases or their paths, and progress callbacks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.model import case as cases
from flashtemp.model.case import Case
from flashtemp.model.case_file import KeyLocations, parse_toml

Overrides = Mapping[str, Any]
Say = Callable[[str], Any]  # called with progress messages
Count = Callable[[float, float], Any]  # called with (done, total)


def ignore_message(text: str) -> None:
    """The default of `say`: does nothing."""


def ignore_progress(done: float, total: float) -> None:
    """The default of `watch`: does nothing."""


def load(case: str | Path, overrides: Overrides | Iterable[str] | None = None, *, trust: bool = False) -> Case:
    """Read a case from a folder with a case.toml or from a .toml file; `overrides` {"table.key": value} change it.

    `trust` runs effect files of the case even if another user may have written them.  Raises BadInput with all errors
    at once, one line each.
    """
    return cases.load_case(case, overrides, trust=trust)


def parse_case(text: str, file: Path) -> Case:
    """The case that `text` describes as the content of `file`, which need not exist.  Raises BadInput."""
    try:
        raw = parse_toml(text)
    except (ValueError, RecursionError) as fault:
        raise BadInput(f"{file}: not valid TOML: {str(fault).split(chr(10))[0]}; repair that line") from fault
    name = file.parent.name if file.name == "case.toml" else file.stem
    return cases.assemble_case(raw, {}, KeyLocations(str(file), text), file.parent, name)


def resolve_case(case: str | Path | Case, overrides: Overrides | None = None) -> Case:
    """The case itself, or the one read from a path, with overrides.  Raises BadInput."""
    if not isinstance(case, Case):
        return load(case, overrides)
    return case.with_values(overrides) if overrides else case


def parse_points(text: str) -> list[dict[str, Any]]:
    """Thermocouple positions from a command line, `x=0.01,z=0.002;z=0.004`, as tables.  Raises BadInput.

    >>> parse_points("x=0.01, z=0.002; z=4e-3"), parse_points("")
    ([{'x': 0.01, 'z': 0.002}, {'z': 0.004}], [])
    """
    out: list[dict[str, Any]] = []
    for part in text.split(";") if text.strip() else ():
        row: dict[str, Any] = {}
        for item in part.split(","):
            key, _, value = (v.strip() for v in item.partition("="))
            try:
                row[key] = value if key == "name" else float(value)
            except ValueError:
                remedy = "write x=0.01,z=0.002 in m, with ; between points"
                raise BadInput(f"--points: {item.strip()!r}; {remedy}") from None
        out.append(row)
    return out
