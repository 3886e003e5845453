"""Parse text tables of loggers: a block of rows of values, under names and units, with other lines around it.

A row belongs to the block if it has values in the same columns as the other rows.  Above the block are names, units and
lines about the measurement.  Below and between rows there may be empty lines, comments, remarks, repeated names and
statistics.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics import safe_text
from flashtemp.physics.tables import header
from flashtemp.physics.tables.cells import (
    has_marks_of_digits,
    is_missing,
    is_value,
    parse_number,
    shape_of,
    split_suffix,
)
from flashtemp.physics.tables.dialect import (
    SEPARATOR_NAMES,
    TableDialect,
    TableLine,
    detect_dialect,
    split_cells,
    split_lines,
)
from flashtemp.physics.tables.encoding import decode_text
from flashtemp.physics.tables.header import TableColumn
from flashtemp.physics.tables.records import SEP_LINE
from flashtemp.physics.tables.text_table import TextTable

HEADER_LINES = 6  # lines above the rows that are searched for names and units
COMMENT_SIGNS = ("#", "%", "//")
STATISTIC_NAME = re.compile(
    r"(?:min|max|mean|avg|average|mittel|mittelwert|median|std|stdev|stddev|sd|sdev|sigma|sum|summe|total|count|anzahl|"
    r"range|rms|minimum|maximum|moyenne|end|ende|eof|mean value|st\.? ?dev\.?|std\.? ?dev\.?)\W{0,3}(?:of\b.*)?",
    re.IGNORECASE,
)
WORD_WITH_UNIT = re.compile(r"[^\s(\[]+(?:\s*[(\[][^)\]]*[)\]])?")
TOA5_UNIT_MARKS = ("TS", "RN")  # time stamp and record number in the row of units of TOA5 files
MAX_REMARKS, MAX_REMARK_LETTERS = 200, 300  # lines around a table that are kept, and their length
WHOLE_COPY_REMEDY = "give a complete copy or export it again"


def read_text(path: Path, where: str) -> str:
    """The text of a file, within the bounds of a table.  Raises BadInput."""
    return decode_text(safe_text.read_bounded_bytes(path, where), where)


def parse_table(text: str, where: str, comma: bool | None = None, of_logger: bool = False) -> TextTable:
    """The table in a text.  `comma`: whether commas are decimal, if the user states it.

    `of_logger`: the file comes from a logger, so names may be channel numbers, and a shorter last line without a line
    end is truncated.  Raises BadInput, beginning with `where` and the line, for texts without rows of values and for
    lines that cannot belong to them.
    """
    raw = safe_text.split_bounded_lines(text, where)
    skipped = 1 if raw and SEP_LINE.fullmatch(raw[0].strip()) else 0
    body = [*[""] * skipped, *raw[skipped:]]
    dialect = detect_dialect(body, comma)
    if dialect is None:
        raise BadInput(f"{where}: no rows of numbers in it; give a table with a line per reading")
    block = _TableBlock(split_lines(body, dialect), dialect, where, of_logger)
    table = block.to_table()
    if of_logger and comma is None:
        _check_thousands(table)
    if of_logger and text[-1] not in "\r\n":
        _check_last_line(table, len(raw))
    return table


def _check_thousands(table: TextTable) -> None:
    """Raise BadInput for a column whose decimal sign may separate thousands: no decimals except groups of three."""
    sign = "," if table.dialect.comma else "."
    grouped = re.compile(rf"-?[1-9]\d{{0,2}}(?:\{sign}\d{{3}})+", re.ASCII)
    for column in table.columns:
        first = next((cell for cell in table.cells(column) if cell), "")
        if not (first.isdecimal() or grouped.fullmatch(first)):
            continue
        shapes = {cell for cell in table.cells(column) if cell}
        small = {cell for cell in shapes if cell.isdecimal() and len(cell) < 4}
        if small and shapes != small and all(map(grouped.fullmatch, shapes - small)):
            cell = next(c for c in table.cells(column) if c in shapes - small)
            raise BadInput(
                f"{table.where}: {cell!r} in {column} may be a whole number with a thousands separator; give --decimal"
                f" {'comma' if sign == ',' else 'point'} if it is not, else export without that separator"
            )


def _check_last_line(table: TextTable, last_line: int) -> None:
    """Raise BadInput where a text ends within its last number: no line end and fewer digits than all others."""
    if table.lines[-1] != last_line or len(table.rows) < 2:
        return
    sign = "," if table.dialect.comma else "."
    number = max(set(range(len(table.columns))) - {n - 1 for n in table.text_columns}, default=0)
    cells = [row[number] for row in table.rows]
    others = {split_suffix(shape_of(c)) for c in cells[:-1]}
    decimals = {len(c.partition(sign)[2]) for c, _ in others if parse_number(c, table.dialect.comma) is not None}
    last, unit = split_suffix(cells[-1])
    lost = (not last and all(cells[:-1])) or (not unit and all(u for _, u in others))
    fewer = len(table.rows) > 2 and len(decimals) == 1 and len(last.partition(sign)[2]) < decimals.pop()
    if lost or fewer:
        raise BadInput(
            f"{table.where}:{last_line}: ends with {cells[-1]!r} and without a line end: cut off; {WHOLE_COPY_REMEDY}"
        )


@dataclass
class _TableBlock:
    """Finds the rows of a text, its header and the lines around them."""

    lines: list[TableLine]
    dialect: TableDialect
    where: str
    of_logger: bool

    def to_table(self) -> TextTable:
        """The table of rows, header, preamble and remarks.  Raises BadInput."""
        self.shapes = self._line_shapes()
        of_shape = {s: [is_value(c, self.dialect.comma) for c in line.cells] for s, line in self._lines_by_shape()}
        self.values = {line.number: of_shape[s] for s, line in zip(self.shapes, self.lines, strict=True)}
        self.width, self.value_columns = self._width_and_value_columns()
        if not self.value_columns:
            raise BadInput(f"{self.where}: no rows of numbers in it; give a table with a line per reading")
        full = {shape: self._fills_row(line) for shape, line in self._lines_by_shape()}
        self.good = {line.number for shape, line in zip(self.shapes, self.lines, strict=True) if full[shape]}
        start = next((k for k, line in enumerate(self.lines) if self._is_row(line)), None)
        if start is None:
            raise BadInput(f"{self.where}: no rows of numbers in it; give a table with a line per reading")
        columns, header_lines, top = self._find_header(start)
        self.left_out = self.lines[:top]
        rows, notes = self._find_rows(start, header_lines)
        if self.dialect.separator == ",":
            self._check_decimal_commas(rows, bool(header_lines))
        width = self.width
        while width > 1 and not any(
            line.cells[width - 1 : width] != ("",) and len(line.cells) >= width for line in rows
        ):
            width -= 1  # a separator at the end of every line
        width = max(width, *(c.number for c in columns if c.label), 1) if header_lines else width
        cells = [line.cells if len(line.cells) == width else (*line.cells, *[""] * self.width)[:width] for line in rows]
        known = columns[:width] if header_lines else [TableColumn(k + 1) for k in range(width)]
        return TextTable(
            self.where, self.dialect, tuple(known), cells, [line.number for line in rows],
            tuple(_key_value_pairs(self.lines[:top], self.dialect)), tuple(notes), bool(header_lines),
            frozenset(k + 1 for k in range(width) if k not in self.value_columns),
            tuple((line.number, line.text[:MAX_REMARK_LETTERS]) for line in self.left_out[:MAX_REMARKS]),
        )  # fmt: skip

    def _line_shapes(self) -> list[str]:
        """The shape of every line: lines of equal shape have cells of equal kinds."""
        whole = "\n".join([line.text for line in self.lines])
        if not has_marks_of_digits(whole) and whole.count("\n") == len(self.lines) - 1:
            return shape_of(whole).split("\n")
        if has_marks_of_digits(whole):
            return [line.text if has_marks_of_digits(line.text) else shape_of(line.text) for line in self.lines]
        return [shape_of(line.text) for line in self.lines]

    def _lines_by_shape(self) -> list[tuple[str, TableLine]]:
        """Every shape with one line of it, so that cells are classified once per shape."""
        return list(dict(zip(self.shapes, self.lines, strict=True)).items())

    # --- rows ---------------------------------------------------------------------------------------
    def _value_flags(self, line: TableLine) -> list[bool]:
        return self.values[line.number]

    def _width_and_value_columns(self) -> tuple[int, list[int]]:
        """The most common number of cells of lines with mostly values, and the columns (from 0) of values."""
        counts: Counter[int] = Counter()
        mostly: list[tuple[TableLine, list[bool], int]] = []
        times = Counter(self.shapes)
        for share in (0.5, 0.0):
            for shape, line in self._lines_by_shape():
                values = [] if _is_comment(line) else self._value_flags(line)
                filled = sum(1 for c in line.cells if c)
                if sum(values) > share * filled:
                    mostly.append((line, values, times[shape]))
                    counts[len(line.cells)] += times[shape]
            if counts:
                break
        named = {
            len(line.cells)
            for _, line in self._lines_by_shape()
            if len(line.cells) > 1 and not any(self._value_flags(line))
        }
        width = max(counts, key=lambda n: (counts[n], n in named, n))
        same_width = [(line, values, count) for line, values, count in mostly if len(line.cells) == width]
        columns = []
        for k in range(width):
            filled = sum(count for line, _, count in same_width if line.cells[k])
            if 2 * sum(count for _, values, count in same_width if values[k]) > filled > 0:
                columns.append(k)
        return width, columns

    def _is_row(self, line: TableLine) -> bool:
        return line.number in self.good

    def _fills_row(self, line: TableLine) -> bool:
        """Whether a line has values or empty cells in all columns of values, and at least one value."""
        if _is_comment(line) or not self._has_room(line):
            return False
        values, cells = self._value_flags(line), line.cells
        good = all(values[k] or not cells[k] for k in self.value_columns)
        return good and any(values[k] and not is_missing(cells[k]) for k in self.value_columns)

    def _find_rows(self, start: int, names: list[TableLine]) -> tuple[list[TableLine], list[str]]:
        """The rows of the block, and notes on lines between and below them.  Raises BadInput."""
        last = next(k for k in range(len(self.lines) - 1, -1, -1) if self._is_row(self.lines[k]))
        known = {line.cells for line in names}
        rows: list[TableLine] = []
        notes: list[str] = []
        above = self.lines[start]
        for k in range(start, len(self.lines)):
            line = self.lines[k]
            if self._is_row(line):
                rows.append(line)
                above = line
                continue
            if not any(line.cells) or _is_comment(line) or line.cells in known:
                above = line
                continue
            if self._has_room(line) and not self._is_remark(line, k > last, above):
                rows.append(line)
            else:
                if rows:
                    self._check_row_of_words(line, rows[-1])
                notes.append(self._note_left_out(line, k > last, bool(any(above.cells)) and rows[-1] is above))
                self.left_out.append(line)
            above = line
        return rows, notes

    def _has_room(self, line: TableLine) -> bool:
        """Whether a line has the cells of a row: no value column is missing, and extra cells are words."""
        count, needed = len(line.cells), 1 + max(self.value_columns)
        beyond = [c for c in line.cells[self.width :] if c]
        return count >= needed and all(map(self._is_word, beyond))

    def _is_word(self, cell: str) -> bool:
        """Whether a cell is a word: neither a value nor a mistyped number."""
        value = is_value(cell, self.dialect.comma) or safe_text.is_mistyped_number(cell)
        return not value and any(c.isalpha() for c in cell)

    def _is_remark(self, line: TableLine, below: bool, above: TableLine) -> bool:
        """Whether a line of the right width is a remark, repeated names or a statistic rather than a damaged row."""
        values = self._value_flags(line)[: self.width]
        if not any(values[k] for k in self.value_columns if k < len(values)):
            return not _is_numeric(line.text)
        word = next((c for c in line.cells if c), "")
        if not self._is_word(word):
            return False
        return below and (not any(above.cells) or STATISTIC_NAME.fullmatch(word.strip()) is not None)

    def _check_row_of_words(self, line: TableLine, row: TableLine) -> None:
        """Raise BadInput for a line of other cells that begins with digits like a row, for example with a date."""
        first = next(iter(line.cells), "")
        if any(c.isdigit() for c in first) and shape_of(first) == shape_of(row.cells[0]):
            raise BadInput(self._describe_damage(line))

    def _describe_damage(self, line: TableLine) -> str:
        """The error text for a line with another number of cells than the rows."""
        text = shorten_text(" ".join(line.text.split()))[:60]
        return (
            f"{self.where}:{line.number}: {text!r} has {len(line.cells)} values, others {self.width}; the file is cut"
            f" off or damaged there: repair that line, or {WHOLE_COPY_REMEDY}"
        )

    def _note_left_out(self, line: TableLine, below: bool, directly: bool) -> str:
        """A note on a line that is not a row.  Raises BadInput for a damaged row or the names of a second table."""
        values = [v and not is_missing(c) for v, c in zip(self._value_flags(line), line.cells, strict=True)]
        filled = [c for c in line.cells if c]
        place = f"{self.where}:{line.number}"
        text = shorten_text(" ".join(line.text.split()))[:60]
        word = next(iter(filled), "")
        wordy = self._is_word(word)
        empty = not any(values) and not _is_numeric(line.text)
        if empty or (below and wordy and (not directly or STATISTIC_NAME.fullmatch(word.strip()))):
            if not below and len(filled) > 1 and len(line.cells) >= self.width and self.width > 1:
                raise BadInput(f"{place}: {text!r} begins a second table; give one table per file")
            return f"line {line.number} left out: {text!r}"
        raise BadInput(self._describe_damage(line))

    def _check_decimal_commas(self, rows: list[TableLine], headed: bool) -> None:
        """Raise BadInput where commas between whole numbers could be decimal and no header gives the column count."""
        sample = [c for line in rows[:20] for c in line.cells]
        quoted = any('"' in line.text for line in rows[:20])
        if headed or quoted or self.width % 2 or self.width < 4 or not all(c.isdecimal() for c in sample if c):
            return
        raise BadInput(
            f"{self.where}: commas between whole numbers could be decimal commas; say which with --decimal comma or"
            " --decimal point, put a line of names above, or export with TAB or ';' between the values"
        )

    # --- header -------------------------------------------------------------------------------------
    def _find_header(self, start: int) -> tuple[list[TableColumn], list[TableLine], int]:
        """Columns with names and units, the lines that contain these, and the index of the first of these lines."""
        found: list[tuple[int, list[str]]] = []
        remarks: list[tuple[int, list[str]]] = []
        for k in range(start - 1, max(-1, start - 1 - 2 * HEADER_LINES), -1):
            line = self.lines[k]
            if not any(line.cells):
                if found:
                    break
                continue
            comment = _is_comment(line)
            if not comment and not found:
                self._check_damaged_row(line, k == start - 1)
                self._check_other_row(line)
            cells = self._parse_names(line.text.lstrip("#%/ ") if comment and line.cells[0] != "#" else line.text)
            if cells is None:
                if not found and not comment:
                    self._check_damaged_first_row(k, self.lines[start])
                if found or not _is_rule(line):
                    break
                continue
            (remarks if comment and line.cells[0] != "#" else found).append((k, cells))
            if len(found) == HEADER_LINES:
                break
        lines = found or remarks[:2]
        if not lines:
            self._check_other_width(start)
            return [TableColumn(k + 1) for k in range(self.width)], [], start
        names, unit_row = self._names_and_units(lines)
        top = min(k for k, cells in lines if cells is names or cells is unit_row)
        columns = [TableColumn(k + 1, names[k], unit_row[k] if unit_row else "") for k in range(self.width)]
        return columns, [self.lines[k] for k, cells in lines if cells is names or cells is unit_row], top

    def _parse_names(self, text: str) -> list[str] | None:
        """The cells of a line that may name all columns; None where their number or kind does not match."""
        for names in _split_names(text, self.dialect, self.width):
            cells = [" ".join(c.split()) for c in names]
            while len(cells) > self.width and not cells[-1]:
                cells = cells[:-1]
            needed = 1 + max(self.value_columns)
            if not needed <= len(cells) <= self.width or (len(cells) < 2 <= self.width):
                continue
            cells = [*cells, *[""] * (self.width - len(cells))]
            numbers = [k for k in self.value_columns if is_value(cells[k], self.dialect.comma)]
            words = [k for k in self.value_columns if cells[k] and k not in numbers]
            if words and (not numbers or self._is_numbered(cells, numbers)):
                return cells
        return None

    def _is_numbered(self, cells: list[str], numbers: list[int]) -> bool:
        """Whether names are channel numbers after a name for the time."""
        first = cells[self.value_columns[0]]
        return (
            self.of_logger
            and header.is_time_label(TableColumn(1, first))
            and numbers == self.value_columns[1:]
            and all(cells[k].isdecimal() for k in numbers)
        )

    def _check_damaged_row(self, line: TableLine, directly: bool) -> None:
        """Raise BadInput for a line above the rows that is a row with a typing error, as O.1 for 0.1."""
        if len(line.cells) != self.width or self._parse_names(line.text) is not None:
            return
        cells = [line.cells[k] for k in self.value_columns if line.cells[k]]
        wrong = [c for c in cells if not is_value(c, self.dialect.comma)]
        mistyped = all(map(safe_text.is_mistyped_number, wrong))
        if not wrong or len(wrong) == len(cells) and not mistyped:
            return
        key_and_value = self.width == 2 and line.cells[0] in wrong and not mistyped and not directly
        if STATISTIC_NAME.fullmatch(wrong[0]) or key_and_value:
            return
        column = next(k + 1 for k in self.value_columns if line.cells[k] == wrong[0])
        raise BadInput(
            f"{self.where}:{line.number}: {safe_text.format_cells(list(line.cells))} is not numeric;"
            f" {shorten_text(repr(wrong[0]))} in column {column} is no number: repair it"
        )

    def _check_damaged_first_row(self, k: int, row: TableLine) -> None:
        """Raise BadInput for a line between the names and the first row that has values or begins like a row."""
        above = next((line for line in reversed(self.lines[:k]) if any(line.cells)), None)
        line = self.lines[k]
        if above is None or _is_comment(above) or not any(c.isdigit() for c in line.text):
            return
        is_like_row = any(self._value_flags(line)) or shape_of(line.cells[0]) == shape_of(row.cells[0])
        if is_like_row and len(line.cells) < self.width and self._parse_names(above.text) is not None:
            raise BadInput(self._describe_damage(line))

    def _check_other_row(self, line: TableLine) -> None:
        """Raise BadInput for a line above the rows with values only, in another number than the rows."""
        values = self._value_flags(line)
        filled = [c for c in line.cells if c]
        if len(line.cells) != self.width and len(filled) > 1 and sum(values) == len(filled):
            text = shorten_text(" ".join(line.text.split()))[:60]
            raise BadInput(
                f"{self.where}:{line.number}: {text!r} has {len(line.cells)} values, others {self.width}; the file is"
                f" damaged there: repair that line, or {WHOLE_COPY_REMEDY}"
            )

    def _check_other_width(self, start: int) -> None:
        """Raise BadInput where the line above names another number of columns than the rows have."""
        above = next((line for line in reversed(self.lines[:start]) if any(line.cells)), None)
        if above is None or _is_comment(above):
            return
        cells = [c for c in above.cells if c]
        if (
            len(cells) > 1
            and any(header.is_time_label(TableColumn(1, c)) for c in cells)
            and not any(self._value_flags(above))
        ):
            raise BadInput(
                f"{self.where}:{above.number}: names {len(cells)} columns, the rows below have {self.width} cells"
                f" ({SEPARATOR_NAMES[self.dialect.separator]} between them); name every column, or export with ';'"
                " between the values"
            )

    def _names_and_units(self, lines: list[tuple[int, list[str]]]) -> tuple[list[str], list[str] | None]:
        """The line of names closest to the rows, and the line of units below or above it."""
        unit_lines = [k for k, (_, cells) in enumerate(lines) if self._is_unit_line(cells)]
        named = [k for k in range(len(lines)) if k not in unit_lines]
        if not named:
            return lines[0][1], None
        names = named[0]
        if not any(header.is_time_label(TableColumn(1, c)) for c in lines[names][1]):
            # TOA5 has a line of processing types, such as Smp, Avg, Min, below the names; names are more varied
            names = max(named[:2], key=lambda k: (len({c for c in lines[k][1] if c}), -k))
        near = [k for k in unit_lines if abs(k - names) <= 2]
        return lines[names][1], lines[near[0]][1] if near else None

    def _is_unit_line(self, cells: list[str]) -> bool:
        """Whether at least half of the cells above values are units, not counting TS and RN of TOA5."""
        filled = [cells[k].strip("()[]{} ") for k in self.value_columns if cells[k].strip("()[]{} ")]
        filled = [c for c in filled if c not in TOA5_UNIT_MARKS]
        known = sum(_is_common_unit(c) or is_in_brackets(c) for c in filled)
        return bool(filled) and 2 * known >= len(filled) and any(map(_is_common_unit, filled))


def _is_common_unit(text: str) -> bool:
    return header.is_common_unit(text) or re.sub(r"[ .]", "", text).casefold() in ("degc", "degf", "degk", "°c", "°f")


def is_in_brackets(text: str) -> bool:
    """Whether a cell is a unit in brackets.

    >>> is_in_brackets("[foo]"), is_in_brackets("foo")
    (True, False)
    """
    return len(text) > 2 and (text[0], text[-1]) in (("(", ")"), ("[", "]"))


def _is_numeric(text: str) -> bool:
    """Whether a line has digits and no letters, as a row in another dialect but not a remark."""
    return any(c.isdigit() for c in text) and not any(c.isalpha() for c in text)


def _is_comment(line: TableLine) -> bool:
    """Whether a line is a comment; "#" alone in a cell is a name."""
    return bool(line.cells) and line.text.lstrip().startswith(COMMENT_SIGNS) and line.cells[0] != "#"


def _is_rule(line: TableLine) -> bool:
    """Whether a line is a rule, as -----, or one word, as Data."""
    return not any(c.isalnum() for c in line.text) or len([c for c in line.cells if c]) == 1


def _split_names(text: str, dialect: TableDialect, width: int) -> Iterator[list[str]]:
    """Ways to split a line of names: by the separator of the rows, by other separators, by blanks."""
    for sign in dict.fromkeys((dialect.separator.replace(" ", "\t"), "\t", ";", ",")):
        yield split_cells(text, sign)
    yield re.split(r"\s{2,}", text.strip())
    if len(text.split()) == width:
        yield text.split()
    if dialect.separator == " ":  # a unit in brackets belongs to the word before it
        words = WORD_WITH_UNIT.findall(text)
        if len(words) == width and "".join("".join(words).split()) == "".join(text.split()):
            yield words


def _key_value_pairs(lines: Sequence[TableLine], dialect: TableDialect) -> Iterator[tuple[str, str]]:
    """Pairs of key and value in the lines above a table."""
    for line in lines:
        text = line.text.lstrip("#%/ ").strip()
        cells = [c for c in split_cells(text, dialect.separator) if c] if dialect.separator != " " else []
        if len(cells) < 2:
            for sign in (":", "=", ";", ",", "\t"):
                key, found, value = text.partition(sign)
                if found and key.strip() and value.strip():
                    cells = [key.strip(), value.strip()]
                    break
        if len(cells) >= 2:
            yield cells[0].rstrip(":= "), ", ".join(cells[1:])
        elif quantity := re.match(r"([^\W\d][^\d]*?)\s+([-+]?\d.*)", text):
            yield quantity[1], quantity[2]


def read_table(path: Path, where: str, comma: bool | None = None, of_logger: bool = False) -> TextTable:
    """The table in a text file.  Raises BadInput as `parse_table` does."""
    return parse_table(read_text(path, where), where, comma, of_logger)
