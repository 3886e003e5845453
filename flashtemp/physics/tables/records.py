"""Small tables with a line of names that mix words and numbers: places of thermocouples, times of files."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from flashtemp.errors import BadInput
from flashtemp.physics import bounded_reading
from flashtemp.physics.tables.cells import parse_number
from flashtemp.physics.tables.encoding import decode_text

SEPARATORS = (",", ";", "\t")


@dataclass(frozen=True)
class Record:
    """Cells of a line by the names of their columns; `comma`: commas may be decimal."""

    line: int
    cells: dict[str, str]
    comma: bool

    def number(self, cell: str) -> float | None:
        """The number of a cell, None for anything else."""
        value = parse_number(cell, False)
        return parse_number(cell, True) if value is None and self.comma else value


def read_records(path: Path, where: str, remedy: str) -> list[Record]:
    """The lines of a table under its first one, which names the columns; empty lines and comments are left out.

    Raises BadInput, beginning with `where` and ending with `remedy`, for files without text and for lines that have
    more or fewer cells than there are names.
    """
    data = bounded_reading.raw(path, where)
    if not data.strip():
        raise BadInput(f"{where}: nothing in it; {remedy}")
    lines = bounded_reading.lines(decode_text(data, where), where)
    filled = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not filled:
        raise BadInput(f"{where}: nothing in it; {remedy}")
    separator = max(SEPARATORS, key=filled[0][1].count)
    try:
        table = [(n, [c.strip() for c in next(csv.reader([line], delimiter=separator), [])]) for n, line in filled]
    except csv.Error as fault:
        raise BadInput(f"{where}: no text of cells; {remedy}") from fault
    names = table[0][1]
    if repeated := next((n for n in names if names.count(n) > 1), None):
        raise BadInput(f"{where}: two columns {repeated!r}; {remedy}")
    for number, cells in table[1:]:
        if len(cells) != len(names):
            raise BadInput(f"{where}:{number}: {len(cells)} values for {len(names)} names; give one each")
    return [Record(n, dict(zip(names, cells, strict=True)), separator != ",") for n, cells in table[1:]]
