"""Parse column names and units in headers: "Time (ms)", "v, km/h", "TC1 °F", "Temp/K", "speed_mps"."""

from __future__ import annotations

import re
from dataclasses import dataclass

from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics import units

MAX_LABEL_LETTERS = 80  # longest label of a column with its unit
FORMAT_HINT = re.compile(r"[hmsfdytj:./\-, 0-9]*(?:hh?:?mm|mm:?ss|dd|yy|tt|jj)[a-z:./\-, 0-9]*", re.IGNORECASE)
UNITLESS_MARKS = ("", "-", "--", "utc", "gmt", "local", "am/pm", "24h", "12h")
QUICK_UNITS = {  # common units, recognised without importing the units library
    ("sec", "s"): "s", ("m_s", "m/s"): "m/s", ("mps", "m/s"): "m/s", ("C", "degC"): "degC", ("°C", "degC"): "degC",
}  # fmt: skip
_COMMON_UNIT_WORDS = (  # in a line of units, and as names of columns
    "s sec secs ms msec us µs min mins h hr hrs d days seconds minutes hours °C °F C F K degC degF degK ℃ ℉ mK Celsius"
    " Kelvin Fahrenheit celsius kelvin fahrenheit V mV A mA volt volts m mm cm um µm m/s mm/s km/h mph s-1 Pa kPa MPa"
    " GPa bar mbar N kN W Hz kHz rpm 1/min % - 1 ohm Ω W/m2 W/m² W/m2K Pa.s rad/s 1/s m^4 deg"
)
COMMON_UNITS = frozenset(_COMMON_UNIT_WORDS.split(" "))
TIME_WORDS = (
    r"time|t|zeit|(?:time|zeit)\d{1,3}(?:defaultsamplerate)?|times|times?tamps?|elapsed|elapsedtime|runtime|reltime|relativetime|abstime|absolutetime|datetime|datetimes?|"
    "datumzeit|datumuhrzeit|datumundzeit|dateandtime|datezeit|date|datum|uhrzeit|clock|clocktime|timeofday|localtime|"
    "utctime|utc|seconds?|secs?|sekunden?|minutes?|minuten?|hours?|stunden?|milliseconds?|millisekunden?|xvalue|epoch|"
    "unixtime|unixtimestamp|unix|posix|posixtime|heure|tiempo|tempo|hora|fecha|moment|messzeit|laufzeit|hhmmss|"
    "testtime|logtime|scantime|sampletime|samplingtime|measurementtime|recordtime|recordingtime|"
    "timehhmmss|zeitstempel|tijd|tid|日時|時刻|時間"
)
TIME_NAME = re.compile(TIME_WORDS)
DATE_NAME = re.compile(r"date|datum|fecha|day|tag|datetimes?|datumzeit|datumuhrzeit|dateandtime|datumundzeit|日時")
CLOCK_NAME = re.compile(r"uhrzeit|clock|clocktime|timeofday|localtime|utctime|heure|hora|hhmmss|timehhmmss|時刻")
COUNTER_NAME = re.compile(
    r"no|nr|num|number|n|#|scans?|scanno|scannumber|scansweepnumber|sample|samples|sampleno|samplenumber|index|idx|"
    r"id|entryid|rowid|recordid|record|recordno|recordnumber|rec|reading|readingno|readingnumber|row|line|point|points|datapoint|counts?|"
    r"counter|messung|messungnr|messpunkt|lfdnr|lfd|zeile|nummer|punkt|measurement|measurementno|entry|seq|sequence|"
    r"frame|frameno|番号"
)
STATUS_NAME = re.compile(
    r"(?:\w*alarm\w*|st|stat|status\w*|state|flags?|events?|markers?|logic|pulse|dio|trigger|quality|valid"
    r"|cjc?|coldjunction\w*|vergleichsstelle)\d*"
)
MILLISECOND_NAME = re.compile(r"ms|msec|msecs|millis|millisecs?|milliseconds?|millisekunden?|millitm|subseconds?ms")


@dataclass(frozen=True)
class TableColumn:
    """A column of a table: its number from 1, its `label` in the header and its cell in a row of units, or ""."""

    number: int
    label: str = ""
    unit_cell: str = ""

    def __str__(self) -> str:
        return f"column {self.number}" + (f" {shorten_text(repr(self.label))}" if self.label else "")


def bare_name(text: str) -> str:
    """Letters and digits of a name in lower case.

    >>> bare_name("Date & Time"), bare_name("NO."), bare_name("#")
    ('datetime', 'no', '#')
    """
    return re.sub(r"[\W_]", "", text).casefold() or text.strip()


def is_unit_text(text: str, wanted: str) -> bool:
    """Whether a text is a unit of the dimension of `wanted`; common units do not need the units library."""
    text = text.strip()
    if not text or len(text) > units.MAX_UNIT_LETTERS or text == "a":  # "a" is an index, not a year
        return False
    return text == wanted or (text, wanted) in QUICK_UNITS or units.is_unit(_spell_unit(text), wanted)


def _spell_unit(text: str) -> str:
    """A unit with / instead of the underscore of column names: "mm_s" is "mm/s", but "deg_C" is "deg C"."""
    text = re.sub(r"(?i)(?<=deg|ree)_(?=[cfk]$)", " ", text)
    return re.sub(r"(?<=[^\W\d_])_(?=[^\W\d_])", "/", text)


def convert_unit(text: str, wanted: str, what: str) -> tuple[float, float]:
    """Factor and offset from a unit as a header writes it to `wanted`.  Raises BadInput that begins with `what`."""
    if text in ("", wanted) or QUICK_UNITS.get((text, wanted)) == wanted:
        return 1.0, 0.0
    if text in ("-", "1") and wanted == "1":
        return 1.0, 0.0
    try:
        return units.find_conversion(_spell_unit(text), wanted)
    except BadInput as fault:
        raise BadInput(f"{what}: {fault}") from fault


def split_label(label: str, wanted: str) -> tuple[str, str]:
    """Name and unit of a label; the unit is "" without one.  Any text in brackets is the unit.

    >>> split_label("Time (ms)", "s"), split_label("v, km/h", "m/s"), split_label("TC1 °F", "degC")
    (('Time', 'ms'), ('v', 'km/h'), ('TC1', '°F'))
    >>> split_label("Temp/K", "degC"), split_label("speed_m_s", "m/s"), split_label("Uhrzeit (hh:mm:ss)", "s")
    (('Temp', 'K'), ('speed', 'm_s'), ('Uhrzeit', ''))
    >>> split_label("TC1 (mV)", "degC"), split_label("front", "degC"), split_label("degC_5.72mm", "degC")
    (('TC1', 'mV'), ('front', ''), ('degC_5.72mm', 'degC'))
    >>> split_label("Temp, °F (LGR S/N: 12)", "degC"), split_label("type K (mV)", "degC")
    (('Temp', '°F'), ('type K', 'mV'))
    """
    if len(label) > MAX_LABEL_LETTERS:
        return label, ""
    groups = [g for g in bracket_groups(label) if g[0] or label[g[1] :].strip()]
    groups = [g for g in groups if g[2].casefold() not in UNITLESS_MARKS and not FORMAT_HINT.fullmatch(g[2])]
    for start, _, text in reversed(groups):
        if is_unit_text(text, wanted):
            return label[:start].strip(), text
    plain = strip_brackets(label)
    if groups:
        name, unit = _split_suffix(plain, wanted)
        if unit and name != unit and all(":" in text for *_, text in groups):  # remarks such as "LGR S/N: 12"
            return name, unit
        return label[: groups[0][0]].strip(), groups[-1][2]
    return _split_suffix(plain or label.strip(" ()[]{}<>") or label, wanted)


def bracket_groups(label: str) -> list[tuple[int, int, str]]:
    """Start, end and text of the outermost brackets of a label.

    >>> bracket_groups("alpha (kW/(m2 K))"), bracket_groups("T1 [degC] (front)")
    ([(6, 17, 'kW/(m2 K)')], [(3, 9, 'degC'), (10, 17, 'front')])
    """
    out, start, depth = [], 0, 0
    for at, letter in enumerate(label):
        if letter in "([{<":
            start, depth = (at if not depth else start), depth + 1
        elif letter in ")]}>" and depth:
            depth -= 1
            if not depth:
                out.append((start, at + 1, label[start + 1 : at].strip()))
    return out


def strip_brackets(label: str) -> str:
    """A label without brackets and their contents."""
    for start, end, _ in reversed(bracket_groups(label)):
        label = label[:start] + label[end:]
    return label.strip()


def _split_suffix(label: str, wanted: str) -> tuple[str, str]:
    """Name and unit separated by a sign; a unit alone or before an underscore is both name and unit."""
    for sign in ("/", ",", ";", "_", " "):
        for name, _, unit in (label.partition(sign), label.rpartition(sign)):
            unit = unit.strip().removeprefix("in ").strip(" .")
            name = name.strip().removesuffix(" in")
            if name and is_unit_text(unit, wanted) and not _is_index(name, unit, wanted):
                return name, unit
    if (label in COMMON_UNITS or len(label) > 2) and label != "1" and is_unit_text(label, wanted):
        return label, label
    first = label.partition("_")[0]
    if len(first) > 1 and first != label and is_unit_text(first, wanted):
        return label, first
    return label, ""


def _is_index(name: str, unit: str, wanted: str) -> bool:
    """Whether a single letter after a name is an index of a temperature rather than a unit, as in T_f and T_r."""
    return wanted in ("degC", "K") and unit in ("r", "R", "f", "k", "c") and len(bare_name(name)) < 3


def column_unit(column: TableColumn, wanted: str) -> tuple[str, str]:
    """Name and unit of a column, from its label, else from the row of units."""
    name, unit = split_label(column.label, wanted)
    return name, unit or _strip_outer_brackets(column.unit_cell.strip())


def check_units_agree(column: TableColumn, wanted: str, where: str) -> None:
    """Raise BadInput where the label of a column and the row of units state different units."""
    units_of = [split_label(column.label, wanted)[1], _strip_outer_brackets(column.unit_cell.strip())]
    known = [u for u in units_of if is_unit_text(u, wanted)]
    if len(known) == 2 and convert_unit(known[0], wanted, where) != convert_unit(known[1], wanted, where):
        raise BadInput(f"{where}: {column}: {known[0]!r} in the name, {known[1]!r} in the row of units; correct one")


def _strip_outer_brackets(text: str) -> str:
    groups = bracket_groups(text)
    return groups[0][2] if len(groups) == 1 and groups[0][:2] == (0, len(text)) else text


def is_time_label(column: TableColumn) -> bool:
    """Whether a column is a time, by its name or by its unit."""
    name, unit = column_unit(column, "s")
    if not column.label and not unit:
        return False
    bare = bare_name(name)
    if bare == "t":  # T is a temperature
        return name.strip() == "t" or is_unit_text(unit, "s")
    if TIME_NAME.fullmatch(bare) or TIME_NAME.fullmatch(bare_name(strip_brackets(column.label))):
        return True
    if unit in ("Min", "MIN") or (is_common_unit(column.unit_cell) and not is_unit_text(column.unit_cell, "s")):
        return False  # a minimum: the symbol of the minute is "min" (SI Brochure, table 8)
    return bool(unit) and (is_unit_text(unit, "s") or bool(FORMAT_HINT.fullmatch(unit)))


def is_common_unit(text: str) -> bool:
    """Whether a text is a common unit in rows of units; longer words in upper or lower case."""
    return text in COMMON_UNITS or (len(text) > 3 and text.casefold() in COMMON_UNITS)


def is_status_label(column: TableColumn) -> bool:
    """Whether a label names a column that is not a thermocouple: "Alarm 101", "Status", "Events", "CJC"."""
    return STATUS_NAME.fullmatch(bare_name(column.label)) is not None


def is_counter_label(column: TableColumn) -> bool:
    """Whether a label names a counter of readings: "NO.", "Scan", "#", "Index"."""
    _, unit = column_unit(column, "s")
    if unit and is_unit_text(unit, "s"):
        return False
    return COUNTER_NAME.fullmatch(bare_name(column.label)) is not None
