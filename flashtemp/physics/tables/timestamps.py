"""Dates and clock times of loggers as seconds: ISO 8601 and the usual national formats, decided per column.

The dateutil parser was tried and is not used.  It decides day and month cell by cell, completes "12:59" or "10" with
today's date, takes "22,0" for a date, and refuses "12:59:50:250" and "45443.54".  A column has one format.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from functools import lru_cache

import numpy as np

from flashtemp.errors import BadInput, short

DAY_S = 86400.0
HALF_DAY_S = 43200.0
Place = Callable[[int], str]
EPOCH = date(1970, 1, 1).toordinal()
MAX_CELL_LETTERS = 64
CENTURY_PIVOT = 69  # two-digit years from here on are of the last century (POSIX strptime)
MONTHS = {
    "jan": 1, "feb": 2, "mar": 3, "mär": 3, "mrz": 3, "apr": 4, "may": 5, "mai": 5, "jun": 6, "jul": 7, "aug": 8,
    "sep": 9, "oct": 10, "okt": 10, "nov": 11, "dec": 12, "dez": 12,
}  # fmt: skip
DAYS = re.compile(r"(\d{1,5}) days?,? ", re.ASCII)
BLANKS = re.compile(r"[\s_\u202f]+")
WEEKDAY = re.compile(r"^(?:mon|tue|wed|thu|fri|sat|sun|mo|di|mi|do|fr|sa|so)[a-z]*[.,]{0,2}\s+", re.IGNORECASE)
BEFORE_CLOCK = re.compile(r"^(?:T|[ ,;]+|-(?=\d))")
NUMERIC_DATE = re.compile(r"(\d{4}|\d{1,2})([-/.])(\d{1,2})\2(\d{4}|\d{1,2})", re.ASCII)
COMPACT_DATE = re.compile(r"(\d{4})(\d\d)(\d\d)", re.ASCII)
DAY_MONTH_YEAR = re.compile(r"(\d{1,2})[-/. ]{1,2}([^\W\d]{3,9})\.?[-/., ]{1,2}(\d{4}|\d{2})")
MONTH_DAY_YEAR = re.compile(r"([^\W\d]{3,9})\.? {1,2}(\d{1,2}),? {1,2}(\d{4})")
C_TIME = re.compile(r"([^\W\d]{3}) {1,2}(\d{1,2}) (\d{1,2}:\d\d:\d\d) (\d{4})")
CLOCK = re.compile(
    r"(?P<a>\d{1,4}):(?P<b>\d{2})(?::(?P<c>\d{2}))?(?:(?P<sign>[.,:])(?P<part>\d{1,30}))?"
    r"(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?",
    re.ASCII,
)
COMPACT_CLOCK = re.compile(r"(\d\d)(\d\d)(\d\d)(?:[.,](\d{1,9}))?", re.ASCII)
ZONE = re.compile(r"(?: ?(Z)| ?(UTC|GMT)?(?: ?([-+])(\d\d):?(\d\d)?)?)", re.ASCII)
NUMERIC_ORDERS = ("dmy", "mdy", "ymd")


@dataclass(frozen=True)
class Stamp:
    """A cell taken apart: numbers of its date with their possible `orders`, clock, zone (s) where it has one.

    `date` is (first, second, third) as they stand, () without one.  `clock` is (hours, minutes, seconds) or, of two
    numbers, (first, second), () without one; `part` are the digits of a fraction behind `sign`, `half` "a" or "p".
    """

    date: tuple[int, ...] = ()
    orders: tuple[str, ...] = ()
    clock: tuple[int, ...] = ()
    sign: str = ""
    part: str = ""
    half: str = ""
    zone: float | None = None


@dataclass(frozen=True)
class Moments:
    """A column of dates or times, s: seconds (n,) from its own zero, and what that zero may be.

    `starts` are the moments, s since 1970, of second 0 in the possible orders of day and month, () without a date.
    `zone` is the offset from UTC that the file states, s.  `has_date` and `has_clock` say what stands in the cells.
    """

    seconds: np.ndarray
    has_date: bool
    has_clock: bool
    starts: tuple[float, ...] = ()
    zone: float | None = None
    whole_seconds: bool = False
    note: str = ""


@lru_cache(maxsize=65536)
def parse_stamp(cell: str) -> Stamp | None:
    """A date, a clock time or both in one cell; None where there is neither.

    >>> parse_stamp("2024-05-31T12:59:50.25Z").clock, parse_stamp("5/31/2024 2:03 PM").half, parse_stamp("22.5")
    ((12, 59, 50), 'p', None)
    """
    if len(cell) > MAX_CELL_LETTERS:
        return None
    text = BLANKS.sub(" ", cell.strip().strip("'\"")).strip()
    if found := DAYS.match(text):  # of a time span, as pandas writes it
        span = _clock_and_zone(text[found.end() :])
        if span is None or len(span.clock) != 3 or span.half or span.zone is not None:
            return None
        hours, minutes, seconds = span.clock
        return Stamp((), (), (24 * int(found[1]) + hours, minutes, seconds), span.sign, span.part)
    if text[:1].isalpha():
        text = WEEKDAY.sub("", text)
        if found := C_TIME.fullmatch(text):
            text = f"{found[2]} {found[1]} {found[4]} {found[3]}"
    if clock := _clock_and_zone(text):
        return clock
    found_date = _leading_date(text)
    if found_date is None:
        return _clock_before_date(text)
    date_numbers, orders, rest = found_date
    rest = BEFORE_CLOCK.sub("", rest).strip()
    if not rest:
        return Stamp(date_numbers, orders)
    clock = _clock_and_zone(rest) or _compact_clock(rest)
    return None if clock is None else Stamp(date_numbers, orders, *_clock_fields(clock))


def _clock_before_date(text: str) -> Stamp | None:
    first, _, rest = text.partition(" ")
    clock, found = _clock_and_zone(first), _leading_date(rest.strip())
    if clock is None and rest[:2].casefold() in ("am", "pm"):
        clock, found = _clock_and_zone(f"{first} {rest[:2]}"), _leading_date(rest[2:].strip())
    if clock is None or found is None or found[2]:
        return None
    return Stamp(found[0], found[1], *_clock_fields(clock))


def _clock_fields(clock: Stamp) -> tuple[tuple[int, ...], str, str, str, float | None]:
    return clock.clock, clock.sign, clock.part, clock.half, clock.zone


def _leading_date(text: str) -> tuple[tuple[int, int, int], tuple[str, ...], str] | None:
    """Numbers of the date that a text begins with, their possible orders, and the rest of the text."""
    if (found := NUMERIC_DATE.match(text)) and not text[found.end() : found.end() + 1].isdigit():
        numbers = int(found[1]), int(found[3]), int(found[4])
        if len(found[1]) == 4:
            return numbers, ("ymd",), text[found.end() :]
        if len(found[4]) == 1:
            return None
        short_year = len(found[4]) == 2
        orders = ("dmy",) if found[2] == "." else NUMERIC_ORDERS if short_year else NUMERIC_ORDERS[:2]
        return numbers, orders, text[found.end() :]
    if (found := COMPACT_DATE.match(text)) and not text[found.end() : found.end() + 1].isdigit():
        return (int(found[1]), int(found[2]), int(found[3])), ("ymd",), text[found.end() :]
    for pattern, day, month in ((DAY_MONTH_YEAR, 1, 2), (MONTH_DAY_YEAR, 2, 1)):
        found = pattern.match(text)
        number = MONTHS.get(found[month][:3].casefold()) if found else None
        if found and number:
            return (int(found[day]), number, int(found[3])), ("dmy",), text[found.end() :]
    return None


def _clock_and_zone(text: str) -> Stamp | None:
    found = CLOCK.match(text)
    if found is None:
        return None
    zone = ZONE.fullmatch(text[found.end() :])
    if zone is None:
        return None
    offset = None
    if zone[1] or zone[2] or zone[3]:
        sign = -1.0 if zone[3] == "-" else 1.0
        offset = sign * (3600.0 * int(zone[4] or 0) + 60.0 * int(zone[5] or 0))
    clock = tuple(int(found[k]) for k in "abc" if found[k] is not None)
    return Stamp((), (), clock, found["sign"] or "", found["part"] or "", (found["half"] or "").lower(), offset)


def _compact_clock(text: str) -> Stamp | None:
    """The clock of the basic format of ISO 8601, as 125950 behind a date."""
    zone = ZONE.fullmatch(text[found.end() :]) if (found := COMPACT_CLOCK.match(text)) else None
    if found is None or zone is None:
        return None
    offset = None
    if zone[1] or zone[2] or zone[3]:
        offset = (-1.0 if zone[3] == "-" else 1.0) * (3600.0 * int(zone[4] or 0) + 60.0 * int(zone[5] or 0))
    return Stamp((), (), (int(found[1]), int(found[2]), int(found[3])), ".", found[4] or "", "", offset)


def parse_moments(cells: Sequence[str], place: Place, label: str = "", column: int | None = None) -> Moments:
    """A column of dates, clock times or both as seconds.

    `place` says where a row (from 0) stands, `label` and `column` are the column's name and number, for messages.
    Clock times without a date go on over midnight.  Raises BadInput for a cell of another kind, for times that do not
    exist, and where the order of day and month or the meaning of two numbers cannot be told.
    """
    stamps = [_parse_cell(cell, k, place, column) for k, cell in enumerate(cells)]
    first = stamps[0]
    kind = bool(first.date), len(first.clock), first.zone is None
    for k, stamp in enumerate(stamps):
        if (bool(stamp.date), len(stamp.clock), stamp.zone is None) != kind:
            raise BadInput(
                f"{place(k)}: {short(repr(cells[k]))} is not written as the first time {short(repr(cells[0]))} is;"
                " repair it"
            )
    seconds = _clock_seconds(stamps, cells, place, label)
    zone = first.zone
    if zone is not None:
        seconds = seconds - np.array([s.zone or 0.0 for s in stamps]) + zone
    whole = not any(s.part.strip("0") for s in stamps) and len(first.clock) != 2
    if first.date:
        days, starts = _days(stamps, seconds, cells, place)
        return Moments(days + seconds, True, bool(first.clock), starts, zone, whole)
    seconds = seconds + DAY_S * np.concatenate([[0.0], np.cumsum(np.diff(seconds) < -HALF_DAY_S)])
    return Moments(seconds, False, True, (), zone, whole)


def _parse_cell(cell: str, row: int, place: Place, column: int | None) -> Stamp:
    stamp = parse_stamp(cell)
    if stamp is None:
        at = "" if column is None else f" in column {column}"
        raise BadInput(
            f"{place(row)}: {short(repr(cell))}{at} is no time; repair it, or name the time with --time-column"
        )
    return stamp


def _clock_seconds(stamps: list[Stamp], cells: Sequence[str], place: Place, label: str) -> np.ndarray:
    """Seconds of the clock of every stamp, 0 without one."""
    minutes_first = _is_minutes_first(stamps, cells, place, label)
    fraction = _fraction_rule(stamps)
    out = np.zeros(len(stamps))
    for k, stamp in enumerate(stamps):
        if not stamp.clock:
            continue
        hours, minutes, seconds = (stamp.clock if len(stamp.clock) == 3 else (*stamp.clock, 0))[:3]
        if len(stamp.clock) == 2 and minutes_first:
            hours, minutes, seconds = 0, stamp.clock[0], stamp.clock[1]
        if stamp.half:
            if not 1 <= hours <= 12:
                raise BadInput(f"{place(k)}: {short(repr(cells[k]))} is no time of 12 hours; repair it")
            hours = hours % 12 + (12 if stamp.half == "p" else 0)
        long = len(stamp.clock) == 2 and minutes_first
        if seconds > 60 or (minutes > 59 and not long) or (hours > 24 and stamp.date):
            raise BadInput(f"{place(k)}: {short(repr(cells[k]))} is a time that does not exist; repair it")
        out[k] = 3600.0 * hours + 60.0 * minutes + seconds + fraction(stamp)
    return out


def _is_minutes_first(stamps: list[Stamp], cells: Sequence[str], place: Place, label: str) -> bool:
    """Whether times of two numbers are minutes and seconds: a fraction or the label says so.  Raises BadInput."""
    if len(stamps[0].clock) != 2 or stamps[0].half or stamps[0].date:
        return False
    if any(s.part for s in stamps) or re.search(r"m+ ?: ?s", label, re.IGNORECASE):
        return True
    if re.search(r"h+ ?: ?m", label, re.IGNORECASE) or label.casefold().strip() == "uhrzeit":
        return False
    raise BadInput(
        f"{place(0)}: {short(repr(cells[0]))} may be hours and minutes or minutes and seconds; say which in the"
        " header, as Time (mm:ss), or give --fps"
    )


def _fraction_rule(stamps: list[Stamp]) -> Callable[[Stamp], float]:
    """How the digits of a fraction count: decimals, but milliseconds behind a colon where their number varies."""
    lengths = {len(s.part) for s in stamps if s.sign == ":"}
    if len(lengths) > 1 and max(lengths) <= 3:
        return lambda stamp: 1e-3 * int(stamp.part or 0)
    return lambda stamp: float(f"0.{stamp.part}") if stamp.part else 0.0


# --- the order of day, month and year ---------------------------------------------------------------
def _days(
    stamps: list[Stamp], clock: np.ndarray, cells: Sequence[str], place: Place
) -> tuple[np.ndarray, tuple[float, ...]]:
    """Seconds (n,) of midnight from the first one, and the moments that the first midnight may be.

    Of the orders that are dates in every row those count in which time does not run backwards.  Where they differ in
    the time that passes, the one without a gap counts; where that does not tell either, BadInput asks.
    """
    found: dict[str, np.ndarray] = {}
    for order in stamps[0].orders:
        ordinals = [_ordinal(s.date, order) for s in stamps]
        if None not in ordinals:
            found[order] = DAY_S * (np.array(ordinals, dtype=float) - EPOCH)
    if not found:
        k = next((n for n, s in enumerate(stamps) if not any(_ordinal(s.date, o) for o in s.orders)), 0)
        raise BadInput(f"{place(k)}: {short(repr(cells[k]))} is a date that does not exist; repair it")
    forward = {o: d for o, d in found.items() if np.all(np.diff(d + clock) >= 0)} or found
    passed = {o: d - d[0] for o, d in forward.items()}
    first = next(iter(passed.values()))
    if any(not np.array_equal(first, other) for other in passed.values()):
        passed = _without_gap(passed, clock)
        if len(passed) != 1:
            k = int(np.argmax([s.date != stamps[0].date for s in stamps]))
            raise BadInput(
                f"{place(k)}: {short(repr(cells[k]))} after {short(repr(cells[0]))}: day and month may stand in either"
                " order; write dates as 2024-05-31, or give --time-column or --fps"
            )
    chosen = [o for o in passed if o == "mdy"] if stamps[0].half and "mdy" in passed else list(passed)
    return passed[chosen[0]], tuple(dict.fromkeys(float(forward[o][0]) for o in chosen))


def _without_gap(passed: dict[str, np.ndarray], clock: np.ndarray) -> dict[str, np.ndarray]:
    """Orders in which no step over a change of date is longer than a day, where the others have such gaps."""
    return {o: d for o, d in passed.items() if np.max(np.diff(d + clock), initial=0.0) <= DAY_S} or passed


@lru_cache(maxsize=4096)
def _ordinal(numbers: tuple[int, ...], order: str) -> int | None:
    """The day of a date in an order of day, month and year; None where there is none."""
    named = dict(zip(order, numbers, strict=True))
    year = named["y"]
    if year < 100:
        year += 1900 if year >= CENTURY_PIVOT else 2000
    try:
        return date(year, named["m"], named["d"]).toordinal()
    except ValueError:
        return None
