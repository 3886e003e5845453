"""Parse dates and clock times of loggers: ISO 8601 and common national formats, with one format per column.

The dateutil parser is not suitable.  It decides the order of day and month for each cell, completes "12:59" or "10"
with today's date, reads "22,0" as a date, and rejects "12:59:50:250" and "45443.54".
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics.tables.cells import shape_of

DAY_S = 86400.0
HALF_DAY_S = 43200.0
RowLocator = Callable[[int], str]
EPOCH_ORDINAL = date(1970, 1, 1).toordinal()
MAX_CELL_LETTERS = 64
CENTURY_PIVOT = 69  # two-digit years from 69 on are in the 20th century (POSIX strptime)
_MONTH_NAMES = (  # names of the Unicode Common Locale Data Repository, without accents: en de fr es it pt nl sv da
    "january januar janvier enero gennaio janeiro januari",
    "february februar fevrier febrero febbraio fevereiro februari",
    "march marz mars marzo marco maart mrz mrt", "april avril abril aprile", "may mai mayo maggio maio mei maj",
    "june juni juin junio giugno junho", "july juli juillet julio luglio julho", "august aout agosto augustus augusti",
    "september septembre septiembre settembre setembro", "october oktober octobre octubre ottobre outubro",
    "november novembre noviembre novembro", "december dezember decembre diciembre dicembre dezembro",
)  # fmt: skip
MONTH_NUMBERS = {name: number for number, names in enumerate(_MONTH_NAMES, 1) for name in names.split()}
_DAYS_OF_WEEK = " ".join(  # in the same languages
    (
        " monday tuesday wednesday thursday friday saturday sunday montag dienstag mittwoch donnerstag freitag samstag",
        "sonnabend sonntag lundi mardi mercredi jeudi vendredi samedi dimanche lunes martes miercoles jueves viernes",
        "sabado domingo lunedi martedi mercoledi giovedi venerdi sabato domenica segunda terca quarta quinta sexta",
        "maandag dinsdag woensdag donderdag vrijdag zaterdag zondag mandag tirsdag onsdag torsdag fredag lordag sondag",
        "tisdag",
    )
)
ZONES_S = {  # RFC 5322, 4.3, and the usual names of Europe
    "UT": 0, "UTC": 0, "GMT": 0, "EST": -18000, "EDT": -14400, "CST": -21600, "CDT": -18000, "MST": -25200,
    "MDT": -21600, "PST": -28800, "PDT": -25200, "WET": 0, "WEST": 3600, "CET": 3600, "CEST": 7200, "MEZ": 3600,
    "MESZ": 7200, "EET": 7200, "EEST": 10800,
}  # fmt: skip
TIME_SPAN_DAYS = re.compile(r"(\d{1,5}) days?,? ", re.ASCII)
BLANKS = re.compile(r"[\s_\u202f]+")
FIRST_WORD = re.compile(r"([^\W\d_]{2,9})[.,]{0,2}\s+")
BEFORE_CLOCK = re.compile(r"^(?:T|[ ,;]+|-(?=\d))")
NUMERIC_DATE = re.compile(r"(\d{4}|\d{1,2})([-/.])(\d{1,2})\2(\d{4}|\d{1,2})", re.ASCII)
COMPACT_DATE = re.compile(r"(\d{4})(\d\d)(\d\d)", re.ASCII)
DAY_MONTH_YEAR = re.compile(r"(\d{1,2})[-/. ]{1,2}([^\W\d]{3,9})\.?[-/., ]{1,2}(\d{4}|\d{2})")
MONTH_DAY_YEAR = re.compile(r"([^\W\d]{3,9})\.? {1,2}(\d{1,2}),? {1,2}(\d{4})")
C_TIME = re.compile(r"([^\W\d]{3}) {1,2}(\d{1,2}) (\d{1,2}:\d\d:\d\d)(?: ([A-Z]{2,4}))? (\d{4})")
CLOCK_TIME = re.compile(
    r"(?P<a>\d{1,4}):(?P<b>\d{2})(?::(?P<c>\d{2}))?(?:(?P<sign>[.,:])(?P<part>\d{1,30}))?"
    r"(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?",
    re.ASCII,
)
COMPACT_CLOCK = re.compile(r"(\d\d)(\d\d)(\d\d)(?:[.,](\d{1,9}))?", re.ASCII)
ZONE_PATTERN = re.compile(rf"(?: ?(Z)| ?({'|'.join(ZONES_S)})?(?: ?([-+])(\d\d):?(\d\d)?)?)", re.ASCII)
NUMERIC_ORDERS = ("dmy", "mdy", "ymd")


class TimeStamp(NamedTuple):
    """A parsed cell: numbers of its date with their possible `orders`, clock, and zone (s) if stated.

    `date` is (first, second, third) in the order of the cell, () without a date.  `clock` is (hours, minutes, seconds)
    or, with two numbers, (first, second), () without a clock; `part` are the digits of a fraction after `sign`, `half`
    is "a" or "p" for AM or PM.
    """

    date: tuple[int, ...] = ()
    orders: tuple[str, ...] = ()
    clock: tuple[int, ...] = ()
    sign: str = ""
    part: str = ""
    half: str = ""
    zone: float | None = None


@dataclass(frozen=True)
class TimeColumn:
    """A column of dates or times: seconds (n,) from its own zero, and the possible dates of that zero.

    `starts` are the times of second 0, s since 1970, for the possible orders of day and month, () without a date.
    `zone` is the offset from UTC stated in the file, s.  `has_date` and `has_clock` describe the cells.
    """

    seconds: np.ndarray
    has_date: bool
    has_clock: bool
    starts: tuple[float, ...] = ()
    zone: float | None = None
    whole_seconds: bool = False
    note: str = ""


@lru_cache(maxsize=65536)
def parse_stamp(cell: str) -> TimeStamp | None:
    """Parse a date, a clock time or both in one cell; None where there is neither.

    >>> parse_stamp("2024-05-31T12:59:50.25Z").clock, parse_stamp("5/31/2024 2:03 PM").half, parse_stamp("22.5")
    ((12, 59, 50), 'p', None)
    """
    if len(cell) > MAX_CELL_LETTERS:
        return None
    text = BLANKS.sub(" ", cell.strip().strip("'\"")).strip()
    if found := TIME_SPAN_DAYS.match(text):  # a time span as pandas writes it
        span = _clock_and_zone(text[found.end() :])
        if span is None or len(span.clock) != 3 or span.half or span.zone is not None:
            return None
        hours, minutes, seconds = span.clock
        return TimeStamp((), (), (24 * int(found[1]) + hours, minutes, seconds), span.sign, span.part)
    if text[:1].isalpha():
        text = _strip_weekday(text)
        if found := C_TIME.fullmatch(text):
            text = f"{found[2]} {found[1]} {found[5]} {found[3]} {found[4] or ''}".rstrip()
    if clock := _clock_and_zone(text):
        return clock
    found_date = _leading_date(text)
    if found_date is None:
        return _clock_before_date(text)
    date_numbers, orders, rest = found_date
    rest = BEFORE_CLOCK.sub("", rest).strip()
    if not rest:
        return TimeStamp(date_numbers, orders)
    clock = _clock_and_zone(rest) or _compact_clock(rest)
    return None if clock is None else TimeStamp(date_numbers, orders, *_clock_fields(clock))


def _clock_before_date(text: str) -> TimeStamp | None:
    first, _, rest = text.partition(" ")
    clock, found = _clock_and_zone(first), _leading_date(rest.strip())
    if clock is None and rest[:2].casefold() in ("am", "pm"):
        clock, found = _clock_and_zone(f"{first} {rest[:2]}"), _leading_date(rest[2:].strip())
    if clock is None or found is None or found[2]:
        return None
    return TimeStamp(found[0], found[1], *_clock_fields(clock))


def _clock_fields(clock: TimeStamp) -> tuple[tuple[int, ...], str, str, str, float | None]:
    return clock.clock, clock.sign, clock.part, clock.half, clock.zone


def _leading_date(text: str) -> tuple[tuple[int, int, int], tuple[str, ...], str] | None:
    """Numbers of the date at the beginning of a text, their possible orders, and the rest of the text."""
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
        number = _month_number(found[month]) if found else None
        if found and number:
            return (int(found[day]), number, int(found[3])), ("dmy",), text[found.end() :]
    return None


@lru_cache(maxsize=256)
def _month_number(name: str) -> int | None:
    """The month of a name or of its first three or more letters; None where there is none or more than one.

    >>> [_month_number(name) for name in ("März", "févr", "juil", "jui", "Mag", "sept", "foo")]
    [3, 2, 7, None, 5, 9, None]
    """
    plain = _strip_accents(name)
    found = {number for month, number in MONTH_NUMBERS.items() if len(plain) > 2 and month.startswith(plain)}
    return found.pop() if len(found) == 1 else None


def _strip_accents(word: str) -> str:
    return "".join(c for c in unicodedata.normalize("NFKD", word.casefold()) if not unicodedata.combining(c))


def _strip_weekday(text: str) -> str:
    """A text without a leading day of the week; a word that begins a date is a month and is kept."""
    word = FIRST_WORD.match(text)
    if word is None or _leading_date(text) is not None or C_TIME.fullmatch(text):
        return text
    plain = _strip_accents(word[1])
    return text[word.end() :] if f" {plain}" in _DAYS_OF_WEEK else text


def _zone_offset_s(zone: re.Match[str]) -> float | None:
    """The offset of a zone from UTC, s; None for an empty zone."""
    if not (zone[1] or zone[2] or zone[3]):
        return None
    sign = -1.0 if zone[3] == "-" else 1.0
    return ZONES_S.get(zone[2] or "", 0) + sign * (3600.0 * int(zone[4] or 0) + 60.0 * int(zone[5] or 0))


def _clock_and_zone(text: str) -> TimeStamp | None:
    found = CLOCK_TIME.match(text)
    if found is None:
        return None
    zone = ZONE_PATTERN.fullmatch(text[found.end() :])
    if zone is None:
        return None
    offset = _zone_offset_s(zone)
    clock = tuple(int(found[k]) for k in "abc" if found[k] is not None)
    return TimeStamp((), (), clock, found["sign"] or "", found["part"] or "", (found["half"] or "").lower(), offset)


def _compact_clock(text: str) -> TimeStamp | None:
    """A clock in the basic format of ISO 8601, as 125950 after a date."""
    zone = ZONE_PATTERN.fullmatch(text[found.end() :]) if (found := COMPACT_CLOCK.match(text)) else None
    if found is None or zone is None:
        return None
    offset = _zone_offset_s(zone)
    return TimeStamp((), (), (int(found[1]), int(found[2]), int(found[3])), ".", found[4] or "", "", offset)


def parse_moments(cells: Sequence[str], place: RowLocator, label: str = "", column: int | None = None) -> TimeColumn:
    """Convert a column of dates, clock times or both to seconds.

    `place` returns file and line of a row (from 0); `label` and `column` are the column's name and number in messages.
    Clock times without a date continue over midnight.  Raises BadInput for a cell of another kind, for times that do
    not exist, and where the order of day and month or the meaning of two numbers is ambiguous.
    """
    stamps = _parse_cells(cells, place, column)
    first = stamps[0]
    kind = bool(first.date), len(first.clock), first.zone is None
    for k, stamp in enumerate(stamps):
        if (bool(stamp.date), len(stamp.clock), stamp.zone is None) != kind:
            raise BadInput(
                f"{place(k)}: {shorten_text(repr(cells[k]))} is not written as the first time"
                f" {shorten_text(repr(cells[0]))} is; repair it"
            )
    seconds = _clock_seconds(stamps, cells, place, label)
    zone = first.zone
    if zone is not None:
        seconds = seconds - np.array([s.zone or 0.0 for s in stamps]) + zone
    whole = not any(s.part.strip("0") for s in stamps) and len(first.clock) != 2
    if first.date:
        days, starts = _midnight_seconds(stamps, seconds, cells, place)
        return TimeColumn(days + seconds, True, bool(first.clock), starts, zone, whole)
    seconds = seconds + DAY_S * np.concatenate([[0.0], np.cumsum(np.diff(seconds) < -HALF_DAY_S)])
    return TimeColumn(seconds, False, True, (), zone, whole)


def _parse_cells(cells: Sequence[str], place: RowLocator, column: int | None) -> list[TimeStamp]:
    """The stamp of every cell, with one parser per shape of cells.  Raises BadInput."""
    parsers: dict[str, Callable[[str], TimeStamp | None]] = {}
    out = []
    for row, cell in enumerate(cells):
        shape = shape_of(cell)
        parse = parsers.get(shape)
        if parse is None:
            parse = parsers[shape] = _make_parser(cell, shape)
        stamp = parse(cell)
        if stamp is None:
            at = "" if column is None else f" in column {column}"
            raise BadInput(
                f"{place(row)}: {shorten_text(repr(cell))}{at} is no time; repair it, or name the time with"
                " --time-column"
            )
        out.append(stamp)
    return out


def _make_parser(cell: str, shape: str) -> Callable[[str], TimeStamp | None]:
    """A fast `parse_stamp` for all cells of one shape.

    Probes with a single 1 among zeros show to which number each digit belongs.  The result is checked against
    `parse_stamp` for `cell`, which is returned itself where they differ.
    """
    zero = parse_stamp(shape)
    if zero is None:
        return parse_stamp
    places: dict[tuple[str, int], list[int]] = {}
    for at in (k for k, letter in enumerate(shape) if letter == "0"):
        probe = parse_stamp(f"{shape[:at]}1{shape[at + 1 :]}")
        if probe is None or probe.zone != zero.zone:
            return parse_stamp
        for name in ("date", "clock", "part"):
            for n, (one, none) in enumerate(zip(getattr(probe, name), getattr(zero, name), strict=True)):
                if one != none:
                    places.setdefault((name, 0 if name == "part" else n), []).append(at)
    slices = {key: slice(at[0], at[-1] + 1) for key, at in places.items()}
    date_of = _number_reader([slices.get(("date", n), number) for n, number in enumerate(zero.date)])
    clock_of = _number_reader([slices.get(("clock", n), number) for n, number in enumerate(zero.clock)])
    part = slices.get(("part", 0), slice(0, 0))
    _, orders, _, sign, _, half, zone = zero

    def parse_same_shape(text: str) -> TimeStamp:
        return TimeStamp(date_of(text), orders, clock_of(text), sign, text[part], half, zone)

    try:
        is_right = parse_same_shape(cell) == parse_stamp(cell)
    except ValueError:  # the digits of a number are not adjacent
        is_right = False
    return parse_same_shape if is_right else parse_stamp


def _clock_seconds(stamps: list[TimeStamp], cells: Sequence[str], place: RowLocator, label: str) -> np.ndarray:
    """Seconds since midnight of every stamp, 0 without a clock."""
    minutes_first = _is_minutes_first(stamps, cells, place, label)
    fraction = _fraction_rule(stamps)
    count = len(stamps[0].clock)
    if not count:
        return np.zeros(len(stamps))
    numbers = np.array([s.clock for s in stamps])  # as many in every row
    hours, minutes, seconds = np.hstack([numbers, np.zeros((len(stamps), 3 - count), int)]).T
    long = count == 2 and minutes_first
    if long:
        hours, minutes, seconds = 0 * hours, hours, minutes
    half = np.array([s.half for s in stamps])
    _raise_for_row((half != "") & ((hours < 1) | (hours > 12)), "is no time of 12 hours", cells, place)
    hours = np.where(half == "", hours, hours % 12 + 12 * (half == "p"))
    wrong = (seconds > 60) | ((minutes > 59) & (not long)) | ((hours > 24) & bool(stamps[0].date))
    _raise_for_row(wrong, "is a time that does not exist", cells, place)
    return np.asarray(3600.0 * hours + 60.0 * minutes + seconds + np.array([fraction(s) for s in stamps]))


def _raise_for_row(is_wrong: np.ndarray, what: str, cells: Sequence[str], place: RowLocator) -> None:
    """Raise BadInput for the first row where `is_wrong` (n,) is True."""
    if is_wrong.any():
        k = int(np.argmax(is_wrong))
        raise BadInput(f"{place(k)}: {shorten_text(repr(cells[k]))} {what}; repair it")


def _is_minutes_first(stamps: list[TimeStamp], cells: Sequence[str], place: RowLocator, label: str) -> bool:
    """Whether times of two numbers are minutes and seconds, by a fraction or the label.  Raises BadInput."""
    if len(stamps[0].clock) != 2 or stamps[0].half or stamps[0].date:
        return False
    if any(s.part for s in stamps) or re.search(r"m+ ?: ?s", label, re.IGNORECASE):
        return True
    if re.search(r"h+ ?: ?m", label, re.IGNORECASE) or label.casefold().strip() == "uhrzeit":
        return False
    raise BadInput(
        f"{place(0)}: {shorten_text(repr(cells[0]))} may be hours and minutes or minutes and seconds; say which in the"
        " header, as Time (mm:ss), or give --fps"
    )


def _fraction_rule(stamps: list[TimeStamp]) -> Callable[[TimeStamp], float]:
    """Value of the digits of a fraction: decimals, but milliseconds after a colon where their number varies."""
    lengths = {len(s.part) for s in stamps if s.sign == ":"}
    if len(lengths) > 1 and max(lengths) <= 3:
        return lambda stamp: 1e-3 * int(stamp.part or 0)
    return lambda stamp: float(f"0.{stamp.part}") if stamp.part else 0.0


def _number_reader(parts: list[slice | int]) -> Callable[[str], tuple[int, ...]]:
    """A reader of the numbers of a text at the slices `parts`, or fixed numbers; results are cached by text."""
    places = [p for p in parts if isinstance(p, slice)]
    span = slice(min((p.start for p in places), default=0), max((p.stop for p in places), default=0))
    known: dict[str, tuple[int, ...]] = {}

    def read_numbers(text: str) -> tuple[int, ...]:
        found = known.get(text[span])
        if found is None:
            found = known[text[span]] = tuple(int(text[p]) if isinstance(p, slice) else p for p in parts)
        return found

    return read_numbers


# --- the order of day, month and year ---------------------------------------------------------------
def _midnight_seconds(
    stamps: list[TimeStamp], clock: np.ndarray, cells: Sequence[str], place: RowLocator
) -> tuple[np.ndarray, tuple[float, ...]]:
    """Seconds (n,) of midnight from the first one, and the possible times of the first midnight.

    Only orders that give a date in every row and in which time does not decrease are used.  Where they differ in
    elapsed time, the one without a gap is used; if that is not unique, raises BadInput.
    """
    found: dict[str, np.ndarray] = {}
    for order in stamps[0].orders:
        ordinals = [_day_ordinal(s.date, order) for s in stamps]
        if None not in ordinals:
            found[order] = DAY_S * (np.array(ordinals, dtype=float) - EPOCH_ORDINAL)
    if not found:
        k = next((n for n, s in enumerate(stamps) if not any(_day_ordinal(s.date, o) for o in s.orders)), 0)
        raise BadInput(f"{place(k)}: {shorten_text(repr(cells[k]))} is a date that does not exist; repair it")
    forward = {o: d for o, d in found.items() if np.all(np.diff(d + clock) >= 0)} or found
    passed = {o: d - d[0] for o, d in forward.items()}
    first = next(iter(passed.values()))
    if any(not np.array_equal(first, other) for other in passed.values()):
        passed = _drop_orders_with_gaps(passed, clock)
        if len(passed) != 1:
            k = int(np.argmax([s.date != stamps[0].date for s in stamps]))
            raise BadInput(
                f"{place(k)}: {shorten_text(repr(cells[k]))} after {shorten_text(repr(cells[0]))}: the order of day and"
                " month is ambiguous; write dates as 2024-05-31, or give --time-column or --fps"
            )
    chosen = [o for o in passed if o == "mdy"] if stamps[0].half and "mdy" in passed else list(passed)
    return passed[chosen[0]], tuple(dict.fromkeys(float(forward[o][0]) for o in chosen))


def _drop_orders_with_gaps(passed: dict[str, np.ndarray], clock: np.ndarray) -> dict[str, np.ndarray]:
    """Orders without a step longer than a day, or all orders if each has one."""
    return {o: d for o, d in passed.items() if np.max(np.diff(d + clock), initial=0.0) <= DAY_S} or passed


@lru_cache(maxsize=4096)
def _day_ordinal(numbers: tuple[int, ...], order: str) -> int | None:
    """The ordinal day of a date in an order of day, month and year; None for an impossible date."""
    named = dict(zip(order, numbers, strict=True))
    year = named["y"]
    if year < 100:
        year += 1900 if year >= CENTURY_PIVOT else 2000
    try:
        return date(year, named["m"], named["d"]).toordinal()
    except ValueError:
        return None
