"""Matrices of temperatures as text: exports of FLIR Tools, Testo, Optris, IRBIS and spreadsheets.

Nothing about such files is certain: separator, decimal comma, a header, labels, marks of pixels below the range.
All of it is recognised, and what was recognised is noted.
"""

from __future__ import annotations

import re

import numpy as np

from flashtemp.camera import plausible
from flashtemp.camera.formats import clean_text, irbis
from flashtemp.camera.formats.cells import cells, is_number, moment, mostly_numbers, numeric, parsed
from flashtemp.camera.raw_frames import UNSCALED, Frames, celsius, linear
from flashtemp.errors import BadInput
from flashtemp.physics import bounded_reading

SEPARATORS = {"\t": "TAB", ";": "';'", ",": "','", None: "spaces"}
PER_BYTE = 25.0  # bytes of memory while a byte of text becomes numbers
SAMPLE, SEEN = 20, 4000  # lines that tell the separator, and characters of each
HEADER, LABEL = 200, 300  # lines of a header that are looked at, and characters of each
UNIT = re.compile(
    r"(?:unit|einheit|temperatur)[^A-Za-z°]{0,10}[a-z]{0,12}[^A-Za-z°]{0,10}°?\s{0,3}(mK|C|K|F)\b", re.IGNORECASE
)
SIZE = {  # what headers call the number of rows and of columns
    "rows": re.compile(r"\W*(?:image[ _]?)?(?:rows|height|zeilen|höhe)\W{1,8}(\d{1,5})\W*", re.IGNORECASE),
    "columns": re.compile(r"\W*(?:image[ _]?)?(?:columns|width|spalten|breite)\W{1,8}(\d{1,5})\W*", re.IGNORECASE),
}
WORDS = {  # what headers call it, lower case: name here
    "emiss": "emissivity", "reflec": "reflected", "reflek": "reflected", "atmos": "air", "air temp": "air",
    "lufttemp": "air", "distance": "distance", "entfernung": "distance", "humid": "humidity", "feucht": "humidity",
}  # fmt: skip
VALUE = re.compile(r"[-+]?\d{1,20}(?:[.,]\d{1,20})?(?:[eE][-+]?\d{1,3})?", re.ASCII)
ASK_DECIMAL = "say which with --decimal comma or --decimal point, or export with TAB or ';' between the values"
AGAIN = "copy it again or export it anew and give that"
NO_TEXT = "no text with a matrix of temperatures; choose a file of a kind listed in docs/camera.md"


def read(data: bytes, unit=None, scale=None, offset=None, below=None, decimal=None, rows=None) -> Frames:
    """One image of a text file, degC.

    `below` (degC) marks what is at or under the camera's range; without it, a plateau at the lowest or the highest
    value does.  `rows` of the file where it holds a part of an image.
    """
    text = decoded(data)
    if text.lstrip().startswith(irbis.START):
        return irbis.read(text, unit)
    header, values, separator, comma = (decimal is None and clean_text.rows(text)) or _careful(text, decimal)
    values, labelled = _without_labels(values)
    said, header_unit, clock, size = _header(header)
    notes = [f"{SEPARATORS[separator]} between the values" + (", decimal commas" if comma else "")]
    notes += ["row and column numbers left out"] if labelled else []
    plausible.matrix(values, size, rows)
    if scale is not None or offset is not None:
        T, note = linear(values, scale, offset, "text"), ""
    else:
        T, note = celsius(values, unit or header_unit)
    marked = np.isnan(T)
    ends = below >= T if below is not None else plausible.clipped(T)
    if below is None and ends.any():
        notes.append(f"{ends.sum()} pixels at the end of the camera's range left out (--below -273 keeps them)")
    marked = marked | ends
    return Frames(
        format="text matrix",
        temperature=np.where(marked, np.nan, T)[None],
        clock=None if clock is None else np.array([clock]),
        said=said,
        outside=int(marked.sum()),
        notes=(*notes, *([note] if note else [])),
        counted=scale is UNSCALED,
    )


def _careful(text: str, decimal: str | None) -> tuple[list[str], np.ndarray, str | None, bool]:
    """Lines of the header, numbers (rows, columns), their separator, and whether commas are decimal."""
    header, found, separator, comma = _sniffed(bounded_reading.lines(text, "line"), decimal, text[-1] in "\r\n")
    return header, parsed(found, separator, comma), separator, comma


def table(text: str, decimal: str | None) -> tuple[list[list[str]], str | None, bool]:
    """Rows of cells of a table under any header, what stands between them, and whether commas are decimal."""
    _, rows, separator, comma = _sniffed(bounded_reading.lines(text, "line"), decimal, text[-1] in "\r\n")
    return rows, separator, comma


def decoded(data: bytes) -> str:
    """Text in whatever encoding an export uses; a byte order mark is taken off."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", "replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", "replace")
    if "\0" in text or not text.strip():
        raise BadInput(NO_TEXT)
    return text


def _sniffed(lines: list[str], decimal: str | None, ended: bool):
    """Header lines, the block of data as cells, its separator, and whether commas are decimal."""
    separator = _separator(lines)
    split = [cells(line, separator) for line in lines]
    wide = [k for k, c in enumerate(split) if len(c) > 1 and mostly_numbers(c)]
    counts = np.bincount([len(split[k]) for k in wide])
    columns = int(np.argmax(counts * np.arange(len(counts))))
    if separator is not None and _ends(split, wide, columns):  # a separator at the end of every line
        columns -= 1
        split = [c[:columns] if len(c) == columns + 1 and not c[-1] else c for c in split]
    first = next(k for k in wide if len(split[k]) == columns)
    rows = []
    for k in range(first, len(lines)):
        if not lines[k].strip():
            break
        if len(split[k]) != columns:
            _no_part(split[k], k, columns, 0.0)
            break
        rows.append(split[k])
    for k in (*range(first), *range(first + len(rows), len(lines))):
        _no_part(split[k], k, columns, 0.5)
    comma = _decimal_comma(rows, separator, decimal)
    if not ended and first + len(rows) == len(lines):
        _no_loose_end(rows, comma)
    elif not ended and first + len(rows) == len(lines) - 1 and not any(c.isalpha() for c in lines[-1]):
        raise BadInput(f"it ends with {lines[-1][:40]!r} and without a line end: cut off; {AGAIN}")
    return lines[:first], rows, separator, comma


def _separator(lines: list[str]) -> str | None:
    """What parts the lines with most digits, and some of all, into most numbers."""
    filled = [line[:SEEN] for line in lines if line.strip()]
    sample = [*sorted(filled, key=_digits, reverse=True)[:SAMPLE], *filled[:: max(1, len(filled) // SAMPLE)]]

    def clear(separator) -> int:
        split = [cells(line, separator) for line in sample]
        return sum(n if (n := numeric(c)) > 0.5 * len(c) and len(c) > 1 else 0 for c in split)

    clearest = {separator: clear(separator) for separator in SEPARATORS}
    separator = max(clearest, key=lambda separator: clearest[separator])
    if not clearest[separator]:
        raise BadInput(
            "no matrix of numbers in it; give files with a row of numbers per line, or a pattern that leaves this out"
        )
    return separator


def _digits(line: str) -> int:
    return sum(map(line.count, "0123456789"))


def _ends(split: list[list[str]], wide: list[int], columns: int) -> bool:
    """Whether most rows end with an empty cell, and all full ones before it are no emptier than others."""
    full = [split[k] for k in wide if len(split[k]) == columns]
    return sum(not row[-1] for row in full) > 0.9 * len(full)


def _no_part(row: list[str], k: int, columns: int, share: float) -> None:
    """BadInput where a line beside the matrix is a part of it: numbers, as many as `share` of a row, but not a row."""
    if len(row) > share * columns and numeric(row) > 0.5 * len(row) and not _running(row):
        raise BadInput(
            f"line {k + 1} has {len(row)} values, others {columns}; the file is cut off or damaged, or holds"
            f" several images: {AGAIN}"
        )


def _no_loose_end(rows: list[list[str]], comma: bool) -> None:
    """BadInput where the text ends inside its last number: without a line end, and shorter than most others are."""

    def decimals(cell: str) -> int:
        return len(cell.rpartition("," if comma else ".")[2]) if ("," if comma else ".") in cell else 0

    others = [c for row in rows for c in row[-1:]]
    usual = int(np.median([decimals(c) for c in others]))
    if decimals(rows[-1][-1]) < usual or (not rows[-1][-1] and any(others[:-1])):
        raise BadInput(f"it ends with {rows[-1][-1]!r} and without a line end: cut off; {AGAIN}")


def _running(row: list[str]) -> bool:
    """Whether a line counts 0, 1, 2, ...: column numbers."""
    return len(row) > 2 and all(is_number(c) and c.isdecimal() for c in row) and [int(c) for c in row] in (
        list(range(len(row))), list(range(1, len(row) + 1)),
    )  # fmt: skip


def _decimal_comma(rows, separator, decimal) -> bool:
    sample = [c for row in rows[:20] for c in row]
    if separator == ",":
        whole = all("." not in c for c in sample)
        if decimal == "comma" or (decimal is None and whole and len(rows[0]) % 2 == 0):
            raise BadInput(f"commas between whole numbers could be decimal commas; {ASK_DECIMAL}")
        return False
    return decimal == "comma" or (decimal is None and any("," in c for c in sample))


def _without_labels(values: np.ndarray) -> tuple[np.ndarray, bool]:
    """The matrix without a first row and column of running numbers or words."""

    def runs(numbers):
        return len(numbers) > 2 and numbers[0] in (0, 1) and np.all(numbers == numbers[0] + np.arange(len(numbers)))

    labelled = False
    if len(values) > 2 and runs(values[0, 1:]) and (runs(values[1:, 0]) or np.all(np.isinf(values[1:, 0]))):
        values, labelled = values[1:, 1:], True
    elif np.all(np.isinf(values[:, 0])):
        values, labelled = values[:, 1:], True
    if values.size == 0 or np.any(np.isinf(values)):
        raise BadInput("words stand among the numbers of the matrix; remove or repair them")
    return values, labelled


def _header(lines: list[str]):
    """Object parameters, unit, clock and size (rows, columns) that header lines state, in English or German."""
    said, unit, clock = {}, None, None
    size: dict[str, int | None] = dict.fromkeys(SIZE)
    for line in (whole[:LABEL] for whole in lines[:HEADER]):
        key = line.lower()
        if (name := next((n for w, n in WORDS.items() if w in key), None)) and name not in said:
            rest = re.split(r"[:=;\t]", line, maxsplit=1)[-1]
            if found := VALUE.search(rest):
                value = float(found.group().replace(",", "."))
                said[name] = value / 100 if name == "humidity" and value > 1 else value
        elif found := UNIT.search(line):
            unit = {"c": "degC", "f": "degF", "k": "K", "mk": "mK"}[found.group(1).lower()]
        for name, pattern in SIZE.items():
            if found := pattern.fullmatch(line.strip()):
                size[name] = int(found[1])
        clock = clock if clock is not None else moment(line)
    return said, unit, clock, (size["rows"], size["columns"])
