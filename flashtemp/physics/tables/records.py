"""Read small tables of named columns with words and numbers: positions of thermocouples, times of files."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

from flashtemp.errors import BadInput
from flashtemp.physics import safe_text
from flashtemp.physics.tables.cells import parse_number
from flashtemp.physics.tables.encoding import decode_text

RECORD_SEPARATORS = (",", ";", "\t")
SEP_LINE = re.compile(r'"?sep=.?"?', re.IGNORECASE)  # first line that spreadsheets write
LEADING_DECIMAL_COMMA = re.compile(r"^([-+]?\d+),(?=\d)")


@dataclass(frozen=True)
class TableRecord:
    """Cells of a line by the names of their columns; `comma`: commas may be decimal."""

    line: int
    cells: dict[str, str]
    comma: bool

    def parse_number_cell(self, cell: str) -> float | None:
        """The number in a cell, None for anything else."""
        value = parse_number(cell, False)
        return parse_number(cell, True) if value is None and self.comma else value

    def replace_decimal_comma(self, cell: str) -> str:
        """Replace the decimal comma of a cell that begins with a number, perhaps with a unit, by a point."""
        return LEADING_DECIMAL_COMMA.sub(r"\1.", cell) if self.comma else cell


def read_records(path: Path, where: str, remedy: str) -> list[TableRecord]:
    """The lines of a table below its first line, which names the columns.

    Empty lines, comments, a line "sep=;" at the top and a separator at the end of every line are ignored.
    Raises BadInput, beginning with `where` and ending with `remedy`, for files without text and for lines with more or
    fewer cells than there are names.
    """
    data = safe_text.read_bounded_bytes(path, where)
    if not data.strip():
        raise BadInput(f"{where}: the file is empty; {remedy}")
    lines = safe_text.split_bounded_lines(decode_text(data, where), where)
    filled = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    filled = [(n, line) for n, line in filled if n > 1 or not SEP_LINE.fullmatch(line.strip())]
    if not filled:
        raise BadInput(f"{where}: the file is empty; {remedy}")
    separator = max(RECORD_SEPARATORS, key=filled[0][1].count)
    try:
        table = [(n, [c.strip() for c in next(csv.reader([line], delimiter=separator), [])]) for n, line in filled]
    except csv.Error as fault:
        raise BadInput(f"{where}: not a table of cells; {remedy}") from fault
    while len(table[0][1]) > 1 and all(len(cells) == len(table[0][1]) and not cells[-1] for _, cells in table):
        table = [(n, cells[:-1]) for n, cells in table]  # a separator at the end of every line
    names = table[0][1]
    if repeated := next((n for n in names if names.count(n) > 1), None):
        raise BadInput(f"{where}: two columns {repeated!r}; {remedy}")
    for number, cells in table[1:]:
        if len(cells) != len(names):
            raise BadInput(f"{where}:{number}: {len(cells)} values for {len(names)} names; give one each")
    return [TableRecord(n, dict(zip(names, cells, strict=True)), separator != ",") for n, cells in table[1:]]
