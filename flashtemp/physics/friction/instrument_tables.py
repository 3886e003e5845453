"""Read tables as instruments export them: columns by name, units from the header, any separator, decimal commas.

A text file contains columns of numbers under lines of words.  One of those lines names the columns.  Units are in it
(`E' (MPa)`, `E'/MPa`, `q_1/m`) or in a line below.  Without names the order of the requested quantities decides.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mode

import numpy as np

from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics import safe_text
from flashtemp.physics.arrays import Value
from flashtemp.physics.tables.cells import is_missing, parse_number
from flashtemp.physics.tables.table import WORD_WITH_UNIT, read_text

INSTRUMENT_DIALECTS = (("\t", False), ("\t", True), (";", False), (";", True), (",", False), (" ", False), (" ", True))
EMPTY_UNIT_CELLS = {"", "-", "--", "nan", "n/a", "na"}  # cells without a unit in a line of units
SIGN_SPELLINGS = str.maketrans(
    {c: "'" for c in "’′´`ʹ"} | {c: "''" for c in '″“”"'} | {"µ": "u", "μ": "u", "²": "2", "⁴": "4"}
)
DIALECT_SAMPLE_LINES = 200  # lines from which separator and decimal sign are detected
MAX_COLUMN_NAME_LETTERS = 80  # longest name of a column with its unit


@dataclass(frozen=True)
class ColumnSpec:
    """A column to find: `pattern` of its names without unit, `units` as (factor, zero) to SI, `default` unit.

    `default` may depend on the name: pairs of a pattern and a unit, of which the first match is used.
    """

    name: str
    pattern: str
    units: dict[str, tuple[float, float]]
    default: tuple[tuple[str, str], ...]
    usual: str

    def is_named_by(self, heading: str) -> bool:
        """Whether a `heading` without its unit names this quantity."""
        return re.fullmatch(self.pattern, normalise_name(heading)) is not None

    def assumed_unit(self, heading: str) -> str:
        """The unit of a column with a `heading` (without unit) where the file states none."""
        return next(unit for pattern, unit in self.default if re.search(pattern, normalise_name(heading)))


@dataclass(frozen=True)
class FoundColumn:
    """The column of a quantity in a file: its index, its name there, and its unit, `stated` or assumed."""

    at: int
    name: str
    unit: str
    stated: bool


@dataclass(frozen=True)
class InstrumentTable:
    """Columns (n,) in SI by quantity; `name` and `prefix` with the rows' `lines` locate values in messages."""

    name: str
    prefix: str
    lines: Sequence[int]
    values: dict[str, np.ndarray]
    columns: dict[str, FoundColumn]

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def require_rows(self, bad: np.ndarray, name: str, remedy: str, hint: str = "") -> None:
        """Raise BadInput for the first row (n,) that is `bad`; `hint` is added where the file states no unit."""
        if not np.any(bad):
            return
        row, column = int(np.argmax(bad)), self.columns[name]
        unit = f"{column.unit}" if column.stated else f"{column.unit} assumed, no unit stated"
        value = f"{self.values[name][row]:g} in SI units" if column.unit else f"{self.values[name][row]:g}"
        more = f"; {hint}" if hint and not column.stated else ""
        raise BadInput(f"{self.prefix}{self.lines[row]}: {column.name} ({unit}): {value}; give {remedy}{more}")


def table_of_rows(data: np.ndarray, key: str, quantities: Sequence[ColumnSpec]) -> InstrumentTable:
    """A table from rows (n, k) of a case, in the last `default` unit of each quantity."""
    columns = {q.name: FoundColumn(i, q.name, q.default[-1][1], True) for i, q in enumerate(quantities)}
    values = {q.name: _convert_to_si(data[:, i], q, q.default[-1][1]) for i, q in enumerate(quantities)}
    return InstrumentTable(key, f"{key}: row ", range(1, len(data) + 1), values, columns)


def read_instrument_table(
    source: str, folder: Path, key: str, quantities: Sequence[ColumnSpec], order: Sequence[str], alternative: str = ""
) -> InstrumentTable:
    """Read the columns of a file that match `quantities`; in a file without names, `order` assigns them.

    `alternative` describes other values that a case may give, for the message where `source` is not a file name.
    Raises BadInput naming the key, the file and its line, for files without numbers, unknown units, damaged rows.
    """
    if not isinstance(source, str):
        raise BadInput(f"{key}: {source!r}; give a file name or a list of rows{alternative}")
    path = Path(folder) / source
    if not path.is_file():
        raise BadInput(f"{key}: file '{source}' not found in {folder}; give a text file of columns there")
    name = f"{key}: {source}"
    prefix = f"{name}:"
    lines = safe_text.split_bounded_lines(read_text(path, name), name)
    dialect = _detect_dialect(lines)
    header, data, at, width = _split_header_and_rows(lines, dialect, prefix)
    if not data:
        raise BadInput(f"{prefix} no rows of numbers; give columns {_list_quantities(quantities, order)}")
    columns = _find_columns(header, quantities, width, dialect[0], prefix) or _columns_by_order(
        quantities, order, width, prefix
    )
    last = max(c.at for c in columns.values())
    for line, row in zip(at, data, strict=True):
        if len(row) <= last:
            raise BadInput(f"{prefix}{line}: {len(row)} values; give {last + 1} or more in every row")
    known = {q.name: q for q in quantities}
    values = {n: _convert_to_si(np.array([row[c.at] for row in data]), known[n], c.unit) for n, c in columns.items()}
    return InstrumentTable(name, prefix, at, values, columns)


def normalise_name(raw: str) -> str:
    """Letters, digits and primes of a name in lower case; a single letter keeps its case.

    >>> normalise_name("E_stor"), normalise_name("G″"), normalise_name("T")
    ('estor', "g''", 'T')
    """
    kept = re.sub(r"[^\w']|_", "", raw.translate(SIGN_SPELLINGS))
    return kept if len(kept) == 1 else kept.lower()


def _convert_to_si(values: Value, quantity: ColumnSpec, unit: str) -> np.ndarray:
    factor, zero = quantity.units[unit]
    return factor * np.asarray(values, dtype=float) + zero


def _split_cells(line: str, separator: str) -> list[str]:
    parts = line.split() if separator == " " else line.rstrip().rstrip(separator).split(separator)
    return [c[1:-1].strip() if len(c) > 1 and c[0] == c[-1] == '"' else c for c in map(str.strip, parts)]


def _parse_cell(cell: str, comma: bool) -> float | None:
    """The number in a cell, NaN for a missing value, None for words."""
    return float("nan") if is_missing(cell) else parse_number(cell, comma)


def _parse_row(line: str, dialect: Value) -> list[float] | None:
    """The numbers of a line, None for a line with words or without any number."""
    separator, comma = dialect
    cells = _split_cells(line, separator)
    if len(cells) < 2:
        return None
    found = []
    for cell in cells:
        value = _parse_cell(cell, comma)
        if value is None:
            return None
        found.append(value)
    return found if any(v == v for v in found) else None


def _detect_dialect(lines: list[str]) -> Value:
    sample = [line for line in lines if line.strip()][-DIALECT_SAMPLE_LINES:]
    return max(INSTRUMENT_DIALECTS, key=lambda d: sum(_parse_row(line, d) is not None for line in sample))


def _split_header_and_rows(lines: list[str], dialect: Value, prefix: str) -> Value:
    """Header lines, rows of numbers, their line numbers and the most common width; the header may be repeated."""
    header, data, at = {}, [], []
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if not text:
            continue
        row = None if text[0] in "#%" else _parse_row(line, dialect)
        if row is not None:
            data.append(row)
            at.append(number)
        elif not data:
            header[line.lstrip("#% ") if text[0] in "#%" else line] = number
        elif text[0] not in "#%" and line not in header:
            raise BadInput(
                f"{prefix}{number}: {shorten_text(text)[:40]!r} is not a row of numbers; remove or repair it"
            )
    width = mode(map(len, data)) if data else 0
    for line, number in header.items():
        _check_damaged_row(_split_cells(line, dialect[0]), width, dialect[1], f"{prefix}{number}")
    return list(header), data, at, width


def _check_damaged_row(cells: list[str], width: int, comma: bool, place: str) -> None:
    """Raise BadInput for a line above the numbers that is a row with a typing error, as O.1 for 0.1."""
    wrong = [c for c in cells if _parse_cell(c, comma) is None]
    if len(cells) == width and wrong and all(map(safe_text.is_mistyped_number, wrong)):
        raise BadInput(
            f"{place}: {shorten_text(repr(wrong[0]))} is not a number; repair it, or put # before a line of words"
        )


def _find_columns(
    header: list[str], quantities: Value, width: int, separator: str, prefix: str
) -> dict[str, FoundColumn]:
    """Columns named by the header line in which most quantities are recognised; empty where no line names any."""
    best, found = (0, 0), {}
    for number, line in enumerate(header):
        for parts in _split_candidates(line, width, separator):
            named = _recognise_cells(parts[:width], quantities)
            if len(parts) > 1 and (len(named), number) > best and named:
                best, found = (len(named), number), _add_units(named, parts, header[number + 1 :], quantities, prefix)
    return found


def _split_candidates(line: str, width: int, separator: str) -> Iterator[list[str]]:
    """Ways to split a header line; single blanks separate names only if that gives the right number of columns."""
    for sign in dict.fromkeys((separator.replace(" ", "\t"), "\t", ";", ",")):
        yield _split_cells(line, sign)
    yield re.split(r"\s{2,}", line.strip())
    if len(line.split()) == width:
        yield line.split()
    if separator == " ":
        yield WORD_WITH_UNIT.findall(line)


def _recognise_cells(parts: list[str], quantities: Value) -> dict[str, tuple[int, str, str | None]]:
    """For every quantity, the first cell that names it: its index, name and unit text."""
    named, taken = {}, set()
    for quantity in quantities:
        for i, cell in enumerate(parts):
            match = None if i in taken else _match_cell(cell, quantity)
            if match is not None:
                named[quantity.name] = (i, *match)
                taken.add(i)
                break
    return named


def _match_cell(cell: str, quantity: ColumnSpec) -> tuple[str, str | None] | None:
    """(name, unit text or None) of a header cell that names the quantity, else None."""
    if len(cell) > MAX_COLUMN_NAME_LETTERS:
        return None
    bracket = re.fullmatch(r"(.*?)(\s*)[(\[]([^()\[\]]*)[)\]]", cell)
    if bracket and (bracket[2] or normalise_unit(bracket[3]) in quantity.units):
        return (bracket[1], normalise_unit(bracket[3])) if quantity.is_named_by(bracket[1]) else None
    for sign in "_/, ":
        for name, _, unit in (cell.partition(sign), cell.rpartition(sign)):
            word = normalise_unit(unit.strip().removeprefix("in "))
            if word and word in quantity.units and quantity.is_named_by(name.removesuffix(" in")):
                return name, word
    return (cell, None) if quantity.is_named_by(cell) else None


def normalise_unit(text: str) -> str:
    """A unit in one spelling.

    >>> normalise_unit("[m^4]"), normalise_unit("°C"), normalise_unit("µm")
    ('m4', 'degC', 'um')
    """
    return re.sub(r"[\s^*·()\[\]]", "", text.translate(SIGN_SPELLINGS)).replace("°", "deg").replace("sec", "s")


def _add_units(named: Value, parts: Value, below: list[str], quantities: Value, prefix: str) -> dict[str, FoundColumn]:
    """Columns with the unit in their name, else from the line below in which most units are recognised."""
    known = {q.name: q for q in quantities}
    line: dict[str, str] = {}
    for text in below:
        for cells in _split_candidates(text, len(parts), "\t"):
            words = {n: normalise_unit(cells[i]) for n, (i, *_) in named.items() if i < len(cells)}
            if sum(w in known[n].units for n, w in words.items()) > len(line):
                line = words
    columns = {}
    for name, (i, raw, unit) in named.items():
        stated = unit or line.get(name) or ""
        if stated in EMPTY_UNIT_CELLS and stated not in known[name].units:
            stated = ""
        if stated and stated not in known[name].units:
            units = ", ".join(u for u in known[name].units if u)
            raise BadInput(f"{prefix} column {raw.strip()!r}: unit {stated!r} is not known; give one of {units}")
        columns[name] = FoundColumn(i, raw.strip(), stated or known[name].assumed_unit(raw), bool(stated))
    return columns


def _columns_by_order(quantities: Value, order: Sequence[str], width: int, prefix: str) -> dict[str, FoundColumn]:
    if width != len(order):
        raise BadInput(
            f"{prefix} {width} columns without names; name them in a line: {_list_quantities(quantities, order)}"
        )
    known = {q.name: q for q in quantities}
    return {name: FoundColumn(i, f"column {i + 1}", known[name].default[-1][1], False) for i, name in enumerate(order)}


def _list_quantities(quantities: Value, order: Sequence[str]) -> str:
    known = {q.name: q for q in quantities}
    return ", ".join(known[name].usual for name in order)
