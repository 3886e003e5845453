"""Matrices of temperatures as text: exports of FLIR Tools, Testo, Optris, IRBIS and spreadsheets.

Nothing about such files is certain: separator, decimal comma, a header, labels, marks of pixels below the range.
All of it is recognised, and what was recognised is noted.
"""

from __future__ import annotations

import re
from datetime import datetime

import numpy as np

from flashtemp.camera.raw_frames import Frames, celsius, linear
from flashtemp.errors import BadInput

SEPARATORS = {"\t": "TAB", ";": "';'", ",": "','", None: "spaces"}
FLIR_BELOW = (-40.01, -60.01, -20.01)  # what FLIR's programs write of a pixel below the range
NUMBER = re.compile(r"[-+]?\d+([.,]\d+)?([eE][-+]?\d+)?")
NO_VALUE = re.compile(r"(-{1,3}|[<>].*|\*+|nan|n/a|under.*|over.*|)", re.IGNORECASE)
MOMENT = re.compile(r"(\d{4})-(\d\d)-(\d\d)[ T_](\d\d):(\d\d):(\d\d)(?:[.,](\d+))?")
WORDS = {  # what headers call it, lower case: name here
    "emiss": "emissivity", "reflec": "reflected", "reflek": "reflected", "atmos": "air", "air temp": "air",
    "lufttemp": "air", "distance": "distance", "entfernung": "distance", "humid": "humidity", "feucht": "humidity",
}  # fmt: skip
ASK_DECIMAL = "say which with --decimal comma or --decimal point, or export with TAB or ';' between the values"


def read(data: bytes, unit=None, scale=None, offset=None, below=None, decimal=None) -> Frames:
    """One image of a text file, degC; `below` (degC) marks what is at or under the camera's range."""
    text = decoded(data)
    if text.lstrip().startswith("[Settings]"):
        return _irbis(text, unit)
    header, rows, separator, comma = _sniffed(text.splitlines(), decimal)
    values = _parsed(rows, separator, comma)
    values, labelled = _without_labels(values)
    said, header_unit, clock = _header(header)
    notes = [f"{SEPARATORS[separator]} between the values" + (", decimal commas" if comma else "")]
    notes += ["row and column numbers left out"] if labelled else []
    if scale is not None or offset is not None:
        T, note = linear(values, scale, offset, "text"), ""
    else:
        T, note = celsius(values, unit or header_unit)
    marked = np.isnan(T) | np.any([np.abs(T - m) < 5e-4 for m in FLIR_BELOW], axis=0)
    if below is not None:
        marked |= below >= T
    return Frames(
        format="text matrix",
        temperature=np.where(marked, np.nan, T)[None],
        clock=None if clock is None else np.array([clock]),
        said=said,
        outside=int(marked.sum()),
        notes=(*notes, *([note] if note else [])),
    )


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
        raise BadInput("no text with a matrix of temperatures; choose a file of a kind listed in docs/camera.md")
    return text


def _cells(line: str, separator: str | None) -> list[str]:
    cells = [c.strip().strip('"') for c in line.split(separator)]
    while len(cells) > 1 and not cells[-1]:  # a separator at the end of the line
        cells.pop()
    return cells


def _plain(cell: str) -> str:
    return re.sub(r"\s*(°\s*C|C|K|°\s*F|F)$", "", cell)


def _numeric(cells: list[str]) -> int:
    return sum(bool(NUMBER.fullmatch(_plain(c))) or bool(c and NO_VALUE.fullmatch(c)) for c in cells)


def _sniffed(lines: list[str], decimal: str | None):
    """Header lines, the block of data as cells, its separator, and whether commas are decimal."""
    longest = sorted((line for line in lines if line.strip()), key=len, reverse=True)[:20]

    def clear(separator) -> int:
        split = [_cells(line, separator) for line in longest]
        return sum(n if (n := _numeric(c)) > 0.5 * len(c) and len(c) > 1 else 0 for c in split)

    separator = max(SEPARATORS, key=clear)
    if not clear(separator):
        raise BadInput("no matrix of numbers in it; give a text file with one row of the image per line")
    split = [_cells(line, separator) for line in lines]
    wide = [k for k, c in enumerate(split) if len(c) > 1 and _numeric(c) > 0.5 * len(c)]
    counts = [len(split[k]) for k in wide]
    columns = max(set(counts), key=lambda n: n * counts.count(n))
    first = wide[counts.index(columns)]
    end = max((k for k in range(len(lines)) if lines[k].strip()), default=first) + 1
    rows = []
    for k in range(first, end):
        if not lines[k].strip():
            break
        if (
            len(split[k]) < columns
            and _numeric(split[k]) == len(split[k])
            and lines[k].rstrip("\r\n ").endswith(separator or " ")
        ):
            split[k] += [""] * (columns - len(split[k]))  # empty cells at the end of a row
        if len(split[k]) != columns:
            if _numeric(split[k]) > 0.5 * len(split[k]):
                raise BadInput(
                    f"line {k + 1} has {len(split[k])} values, others {columns}; the file is cut off or damaged:"
                    " copy it again or export it anew and give that"
                )
            break
        rows.append(split[k])
    comma = _decimal_comma(rows, separator, decimal)
    return lines[:first], rows, separator, comma


def _decimal_comma(rows, separator, decimal) -> bool:
    sample = [c for row in rows[:20] for c in row]
    if separator == ",":
        whole = all("." not in c for c in sample)
        if decimal == "comma" or (decimal is None and whole and len(rows[0]) % 2 == 0):
            raise BadInput(f"commas between whole numbers could be decimal commas; {ASK_DECIMAL}")
        return False
    return decimal == "comma" or (decimal is None and any("," in c for c in sample))


def _parsed(rows: list[list[str]], separator, comma: bool) -> np.ndarray:
    if comma:
        rows = [[c.replace(",", ".") for c in row] for row in rows]
    try:
        return np.array(rows, dtype=float)
    except ValueError:
        return np.array([[_value(c) for c in row] for row in rows])


def _value(cell: str) -> float:
    """A number, NaN for a mark, infinity for a label."""
    if NO_VALUE.fullmatch(cell):
        return np.nan
    try:
        return float(_plain(cell))
    except ValueError:
        return np.inf


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
    """Object parameters, unit and clock that header lines state, in English or German."""
    said, unit, clock = {}, None, None
    for line in lines:
        key = line.lower()
        if (name := next((n for w, n in WORDS.items() if w in key), None)) and name not in said:
            rest = re.split(r"[:=;\t]", line, maxsplit=1)[-1]
            if found := NUMBER.search(rest):
                value = float(found.group().replace(",", "."))
                said[name] = value / 100 if name == "humidity" and value > 1 else value
        elif found := re.search(
            r"(?:unit|einheit|temperatur)[^A-Za-z°]*[a-z]*[^A-Za-z°]*°?\s*(mK|C|K|F)\b", line, re.IGNORECASE
        ):
            unit = {"c": "degC", "f": "degF", "k": "K", "mk": "mK"}[found.group(1).lower()]
        clock = clock if clock is not None else moment(line)
    return said, unit, clock


def moment(text: str) -> float | None:
    """Seconds since 1970 of a date and time like 2024-05-31 12:00:03.25; None where there is none.

    >>> moment("start 1970-01-02T00:00:01.5")
    86401.5
    """
    found = MOMENT.search(text)
    if not found:
        return None
    try:
        year, month, date, hour, minute, second = (int(p) for p in found.groups()[:6])
        day = datetime(year, month, date, hour, minute, second)
    except ValueError:
        return None
    return (day - datetime(1970, 1, 1)).total_seconds() + float("0." + (found.group(7) or "0"))


def _irbis(text: str, unit: str | None) -> Frames:
    """InfraTec IRBIS ASCII: [Settings] with KEY=VALUE, then [Data]; the header says separators, unit and size."""
    head, mark, body = text.partition("[Data]")
    pairs = dict(line.split("=", 1) for line in head.splitlines() if "=" in line)
    lines = [line for line in body.splitlines() if line.strip()]
    if not mark or not lines:
        raise BadInput("IRBIS header without [Data]: the file is cut off; export it anew and give that")
    try:
        separator = chr(int(pairs.get("DelimiterValue", "0x3B"), 16))
        comma = chr(int(pairs.get("CommaValue", "0x2E"), 16)) == ","
        size = (int(pairs["ImageHeight"]), int(pairs["ImageWidth"])) if "ImageWidth" in pairs else None
    except (ValueError, KeyError, OverflowError) as fault:
        raise BadInput(f"IRBIS header damaged ({fault}); export it anew and give that") from fault
    rows = [_cells(line, separator) for line in lines]
    widths = {len(r) for r in rows}
    if len(widths) > 1 or (size and (len(rows), len(rows[0])) != size):
        stated = f"{size[1]} x {size[0]}" if size else "equal rows"
        raise BadInput(
            f"{len(rows)} rows of {min(widths)} to {max(widths)} values, the header says {stated};"
            " the file is cut off: export it anew and give that"
        )
    values = _parsed(rows, separator, comma)
    if np.any(np.isinf(values)):
        raise BadInput("words stand among the numbers of [Data]; export it anew and give that")
    content = pairs.get("Content", "Temperature")
    difference = content.lower() in ("amplitude", "phase", "difference")
    T, note = celsius(values, unit or pairs.get("TempUnit"), difference)
    clock = moment(f"{pairs.get('Params.Rec.Date', '')} {pairs.get('Params.Rec.Time', '')}")
    return Frames(
        format="IRBIS ASCII",
        temperature=T[None],
        clock=None if clock is None else np.array([clock]),
        outside=int(np.isnan(T).sum()),
        notes=(*([note] if note else []), *([f"{content}: a difference of temperatures"] if difference else [])),
        difference=difference,
    )
