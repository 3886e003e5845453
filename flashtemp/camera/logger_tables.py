"""Tables of thermocouples as loggers write them: one line per reading, time and columns as a person says."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flashtemp.camera import points, timing
from flashtemp.camera.formats import cells, text
from flashtemp.camera.import_options import Facts, option
from flashtemp.camera.points import KEYS, Places
from flashtemp.camera.raw_frames import celsius, linear
from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput, nearest
from flashtemp.model import units
from flashtemp.physics import bounded_reading

OF_POINTS = {
    "view", "places", "start", "zero", "fps", "repetition", "starts", "case", "block", "every", "unit", "scale",
    "offset", "decimal", "limit", "netd",
}  # fmt: skip
STAMP = re.compile(
    r"""^[ "]*(?P<day>\d{4}-\d\d-\d\d|\d\d\.\d\d\.\d{4})(?P<apart>[T_ ]|"?[;\t,]"?)"""
    r"""(?P<clock>\d\d:\d\d:\d\d(?:[.,]\d{1,9})?)"?""",
    re.MULTILINE,
)
SECONDS = 12  # digits that a moment in microseconds has more than
COLUMNS = ("column", "name", *KEYS)
ASK = f"--places FILE.csv with a line of names among {','.join(COLUMNS)} and a line per thermocouple (m, s)"


@dataclass(frozen=True)
class Wired:
    """Thermocouples and the column of the table, counted from 1, that each is in."""

    places: Places
    columns: tuple[int, ...]


def recorded(names: list[Path], facts: Facts) -> tuple[Recording, tuple[str, ...]]:
    """The recording of one logger table with what was recognised.  Raises BadInput."""
    given = [name for name in Facts.__dataclass_fields__ if getattr(facts, name) is not None]
    if other := next((name for name in given if name not in OF_POINTS), None):
        raise BadInput(f"{option(other)}: belongs to images; leave it out for points")
    if len(names) != 1:
        raise BadInput(f"files: {len(names)} given; give one table of all thermocouples")
    if facts.places is None:
        raise BadInput(f"places: missing; where the thermocouples sit is not in the file: give {ASK}")
    path, wired = names[0], _wired(facts.places)
    try:
        time, values, notes = _read(path, wired, facts)
    except BadInput as fault:
        raise BadInput(*(f"{path}: {line}" for line in fault.lines)) from fault
    seen = [(path, timing.Stamps(len(values), time.get("time"), time.get("clock")))]
    t = timing.times(seen, facts)
    repetition = timing.repetitions(seen, t, facts)
    if np.any(np.diff(t) <= 0):
        k = int(np.argmax(np.diff(t) <= 0))
        raise BadInput(f"{path}: time goes from {t[k]:g} to {t[k + 1]:g} s; it must increase")
    n = len(wired.places)
    recording = Recording(
        "points", values[:, None], t, repetition, np.arange(n, dtype=float), np.zeros(1), netd_K=facts.netd,
        source=path.name, places=wired.places,
    )  # fmt: skip
    return recording, notes


def _read(path: Path, wired: Wired, facts: Facts) -> tuple[dict[str, np.ndarray], np.ndarray, tuple[str, ...]]:
    """What the first column says of time (rows,), temperatures (rows, points) degC, and notes."""
    data = bounded_reading.raw(path, "table")
    if not data.strip():
        raise BadInput("nothing in it; give a logger's table with a line per reading")
    told, stamped = _stamped(text.decoded(data))
    rows, separator, comma = text.table(told, facts.decimal)
    rows = rows[:: facts.every or 1]
    if (most := max(wired.columns)) > len(rows[0]):
        raise BadInput(f"{len(rows[0])} columns, but a thermocouple is in column {most}; correct --places")
    values = cells.parsed([[row[c - 1] for c in wired.columns] for row in rows], separator, comma)
    if np.isinf(values).any():
        i, j = (int(k[0]) for k in np.nonzero(np.isinf(values)))
        raise BadInput(f"{rows[i][wired.columns[j] - 1]!r} in column {wired.columns[j]} is no number; repair that row")
    scaled = facts.scale is not None or facts.offset is not None
    if scaled:
        T, note = linear(values, facts.scale, facts.offset, "table"), ""
    else:
        T, note = celsius(values, facts.unit)
    notes = (f"{len(rows)} readings, {text.SEPARATORS[separator]} between the values", *([note] if note else []))
    if 1 in wired.columns or facts.fps is not None:
        return {}, T, notes
    if stamped and all(len(row[0]) > SECONDS and row[0].isdecimal() for row in rows):
        return {"clock": np.array([1e-6 * int(row[0]) for row in rows])}, T, notes
    time = cells.parsed([row[:1] for row in rows], separator, comma)[:, 0]
    if not np.isfinite(time).all():
        k = int(np.argmin(np.isfinite(time)))
        raise BadInput(f"{rows[k][0]!r} in column 1 is no time; give s or date and time there, or --fps")
    return {"time": time}, T, notes


def _stamped(told: str) -> tuple[str, int]:
    """A table whose dates and times, in one cell or in two, are whole microseconds since 1970, and their number."""

    def whole(found: re.Match[str]) -> str:
        line = told[found.start() : told.find("\n", found.end()) + 1 or None]
        day, clock, apart, rest = found["day"], found["clock"], found["apart"], ""
        if "," in clock and not re.search("[;\t]", line):  # there a comma stands between cells
            clock, comma, digits = clock.partition(",")
            rest = comma + digits
        seconds = cells.moment(f"{'-'.join(reversed(day.split('.')))} {clock}")
        if seconds is None:
            return found[0]
        return f"{1e6 * seconds:.0f}{'' if apart in 'T_ ' else apart + '0'}{rest}"

    return STAMP.subn(whole, told)


def _wired(file: Path) -> Wired:
    """Thermocouples of a CSV file with a line of names; columns count on from 2 where they are not given."""
    where = f"places: {file}"
    data = bounded_reading.raw(file, where)
    lines = bounded_reading.lines(text.decoded(data), where) if data.strip() else []
    filled = (line for line in lines if line.strip() and not line.strip().startswith("#"))
    table = [[c.strip() for c in row] for row in csv.reader(filled)]
    if not table:
        raise BadInput(f"{where}: nothing in it; give {ASK}")
    head, rows = table[0], table[1:]
    for name in head:
        if name not in COLUMNS:
            raise BadInput(f"{where}: {name!r}: unknown column{nearest(name, COLUMNS)}; give {', '.join(COLUMNS)}")
    if not rows:
        raise BadInput(f"{where}: no thermocouple in it; give {ASK}")
    made, columns = [], []
    for number, row in enumerate(rows, 1):
        if len(row) != len(head):
            raise BadInput(f"{where}: thermocouple {number}: {len(row)} values for {len(head)} names; give one each")
        entry = {k: v if k == "name" else _number(where, number, k, v) for k, v in zip(head, row, strict=True)}
        column = entry.pop("column", number + 1)
        if column != int(column) or column < 1 or int(column) in columns:
            raise BadInput(f"{where}: thermocouple {number}: column: {column:g}; give each its own, counted from 1")
        columns.append(int(column))
        made.append(entry)
    return Wired(points.of_rows(made, where), tuple(columns))


def _number(where: str, row: int, key: str, cell: str) -> float:
    value = bounded_reading.number(cell)
    if value is None and key in KEYS and units.meant(cell):
        try:
            value = units.plain(cell, KEYS[key][0], difference=True)
        except BadInput as fault:
            raise BadInput(f"{where}: thermocouple {row}: {key}: {fault}") from fault
    if value is None or not np.isfinite(value):
        raise BadInput(f"{where}: thermocouple {row}: {key}: {cell!r}; give a number")
    return value
