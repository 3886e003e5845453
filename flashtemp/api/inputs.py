"""What every public call accepts: a path or what was loaded from it, and listeners."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.model import case as cases
from flashtemp.model.case import Case
from flashtemp.model.case_file import KeyLocations, parse_toml

Overrides = Mapping[str, Any]
Say = Callable[[str], Any]  # told in words what is being done
Count = Callable[[float, float], Any]  # told (done, total)


def ignore_message(text: str) -> None:
    """Says nothing."""


def ignore_progress(done: float, total: float) -> None:
    """Counts nothing."""


def load(case: str | Path, overrides: Overrides | Iterable[str] | None = None, *, trust: bool = False) -> Case:
    """Read a case: a folder with a case.toml, or a .toml file; `overrides` {"table.key": value}.

    `trust` lets effect files of the case run whose ever they are.  Raises BadInput with all faults at once, one line
    each.
    """
    return cases.load_case(case, overrides, trust=trust)


def parse_case(text: str, file: Path) -> Case:
    """The case that a text means as the content of `file`, which need not exist.  Raises BadInput with all faults."""
    try:
        raw = parse_toml(text)
    except (ValueError, RecursionError) as fault:
        raise BadInput(f"{file}: not valid TOML: {str(fault).split(chr(10))[0]}; repair that place") from fault
    name = file.parent.name if file.name == "case.toml" else file.stem
    return cases.assemble_case(raw, {}, KeyLocations(str(file), text), file.parent, name)


def resolve_case(case: str | Path | Case, overrides: Overrides | None = None) -> Case:
    """A case from its path, or one that is loaded, with overrides.  Raises BadInput."""
    if not isinstance(case, Case):
        return load(case, overrides)
    return case.with_values(overrides) if overrides else case


def parse_points(text: str) -> list[dict[str, Any]]:
    """Places of thermocouples as typed, `x=0.01,z=0.002;z=0.004`, as tables.  Raises BadInput.

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
                said = "write x=0.01,z=0.002 in m, ; between points"
                raise BadInput(f"--points: {item.strip()!r}; {said}") from None
        out.append(row)
    return out
