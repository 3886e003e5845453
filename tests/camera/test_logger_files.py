"""Files of loggers as loggers write them: read rightly, or refused in one line that names file, line and cell."""

from __future__ import annotations

import numpy as np
import pytest

from flashtemp.camera.importing import thermocouple_files
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.errors import BadInput
from flashtemp.physics.interpolation import read_surface, read_xy_pairs
from flashtemp.physics.tables import column_matching
from flashtemp.physics.tables.cells import is_missing

HEADER = "Time (s),TC1 (degC),TC2 (degC)\n"


def import_table(folder, content, columns=(2, 3), name="log.csv", **facts):
    """The recording of a file and the notes on it; `columns` of the thermocouples, None to leave them to the file."""
    path = folder / name
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    names = ("TC1", "TC2")
    lines = [f"{c},{n},0.01,0.00{k}" for k, (c, n) in enumerate(zip(columns or names, names, strict=False), 1)]
    head = "column,name,x,z" if columns else "name,x,z"
    rows = lines if columns else [line.partition(",")[2] for line in lines]
    (folder / "places.csv").write_text("\n".join([head, *rows]) + "\n")
    if "zero" not in facts:
        facts = {"start": 0.0} | facts
    asked = ImportOptions(view="points", places=folder / "places.csv", repetition=1, **facts)
    recording, notes = thermocouple_files.read_recording([path], asked)
    return recording.time, recording.temperature[:, 0], "; ".join(notes)


def rows(times, separator=","):
    """Rows of times with temperatures of 20.5, 21.5, ... and 30.25, 31.25, ..."""
    return "".join(f"{t}{separator}{20 + k}.5{separator}{30 + k}.25\n" for k, t in enumerate(times))


def refused(folder, content, *words, **facts):
    """One line that names the file and holds the words."""
    with pytest.raises(BadInput) as fault:
        import_table(folder, content, **facts)
    [line] = fault.value.lines
    assert "\n" not in line
    for word in words:
        assert word in line
    return line


# --- units --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("header", "step"),
    [
        ("Time (s),A,B", 1.0), ("Time (ms),A,B", 1e-3), ("Time [min],A,B", 60.0), ("time_ms,A,B", 1e-3),
        ("t/h,A,B", 3600.0), ("t in min,A,B", 60.0), ("Elapsed, A,B", 1.0), ("Time\u00b7,A,B", 1.0),
        ("Time,A,B\nms,degC,degC", 1e-3), ("ms,°C,°C\nTime,A,B", 1e-3), ("Time;A;B\n(min);(C);(C)", 60.0),
        ("# Time (ms),A,B", 1e-3), ("Time (µs),A,B", 1e-6), ("s,A,B", 1.0), ("Time (hh:mm:ss),A,B", 1.0),
    ],
)  # fmt: skip
def test_the_unit_of_the_time_is_read_from_the_header(tmp_path, header, step):
    separator = ";" if ";" in header else ","
    t, _, notes = import_table(tmp_path, header + "\n" + rows([0, 1, 2], separator))
    assert t == pytest.approx([0.0, step, 2 * step], rel=1e-12)
    assert ("taken as s" in notes) == (header.split(separator)[0] in ("Elapsed", "Time\u00b7", "Time (hh:mm:ss)"))


@pytest.mark.parametrize(
    ("label", "cells", "right"),
    [
        ("TC1 (F)", ("71.6", "80.6"), (22.0, 27.0)), ("TC1 °F", ("71.6", "80.6"), (22.0, 27.0)),
        ("TC1_F", ("32", "212"), (0.0, 100.0)), ("TC1 [degF]", ("32", "212"), (0.0, 100.0)),
        ("Temp/K", ("295.15", "300.15"), (22.0, 27.0)), ("TC1 (K)", ("295.15", "300.15"), (22.0, 27.0)),
        ("TC1 (Type K) [C]", ("22", "27"), (22.0, 27.0)), ("TC1, °C", ("22", "27"), (22.0, 27.0)),
        ("TC1 (mK)", ("295150", "300150"), (22.0, 27.0)), ("TC1 Deg F", ("32", "212"), (0.0, 100.0)),
        ("TC1", ("71.6 °F", "80.6 °F"), (22.0, 27.0)), ("TC1", ("22.0C", "27.0C"), (22.0, 27.0)),
    ],
)  # fmt: skip
def test_the_unit_of_temperatures_is_read_from_header_or_cells(tmp_path, label, cells, right):
    text = f'Time (s),"{label}"\n0,{cells[0]}\n1,{cells[1]}\n'
    _, T, notes = import_table(tmp_path, text, (2,))
    assert T[:, 0] == pytest.approx(right, abs=1e-9)
    assert "taken as degC" not in notes


def test_the_unit_above_the_table_counts_and_an_unsaid_one_is_told(tmp_path):
    _, T, _ = import_table(tmp_path, "Temperature unit: F\nTime (s),A,B\n0,68,32\n1,68,32\n")
    assert T[0].tolist() == pytest.approx([20.0, 0.0])
    _, _, notes = import_table(tmp_path, "Time (s),A,B\n0,68,32\n1,68,32\n")
    assert "unit not said in the file, taken as degC" in notes


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("Time (s),U1 (mV),U2 (mV)", ("column 2 'U1 (mV)'", "mV", "--unit")),
        ("Time (foo),A,B", ("column 1 'Time (foo)'", "'foo' is not known")),
        ("Time (m),A,B", ("column 1 'Time (m)'", "converted to s")),
        ("Time (s),A (K),B (K)", ("K is no usual temperature", "type of the thermocouple")),
        ("Time (s),A,B\nms,C,C", ("column 1 'Time (s)'", "'s' in the name, 'ms' in the row of units")),
        ("Time (s),A (C),B (C)\ns,F,F", ("column 2 'A (C)'", "'F' in the row of units")),
        ("Time (s),A (front),B (back)", ("'front' is not known", "--unit")),
    ],
)
def test_a_unit_of_another_dimension_is_refused(tmp_path, header, words):
    refused(tmp_path, header + "\n" + rows([0, 1, 2]), "log.csv", *words)


def test_a_unit_that_a_person_gives_goes_before_the_header_and_is_told(tmp_path):
    _, T, notes = import_table(tmp_path, "Time (s),A (K),B (K)\n0,20,30\n1,21,31\n", unit="degC")
    assert T[0].tolist() == [20.0, 30.0]
    assert "says K, read as degC as --unit says" in notes


# --- the column of the time ---------------------------------------------------------------------------------
GRAPHTEC = (
    "Vendor,GRAPHTEC Corporation\r\nSampling,200ms\r\nTotal data points,5\r\nStart time,2023-11-27,14:08:41\r\n"
    'CH1, " CH 1",TEMP,TC_K,5,70.000000,20.000000,degC\r\nData\r\nNumber,Date&Time,ms,CH1,CH2,Alarm,AlarmOut\r\n'
    "NO.,Time,ms,degC,degC,A12,A1\r\n"
    + "".join(
        f"{k + 1},2023-11-27 14:08:{42 + k // 5},{200 * (k % 5)},+2{k % 10}.0,+22.0,LLLLLLLLLL,LLLL\r\n"
        for k in range(12)
    )
)


def test_a_counter_is_no_time_beside_date_and_milliseconds(tmp_path):
    t, T, notes = import_table(tmp_path, GRAPHTEC, (4, 5))
    assert t == pytest.approx(0.2 * np.arange(12), abs=1e-9)
    assert T[:3, 0].tolist() == [20.0, 21.0, 22.0]
    assert "time from column 2 'Date&Time' and column 3 'ms'" in notes


@pytest.mark.parametrize("name", ["NO.", "Scan", "Sample", "#", "Index", "Record No.", "Reading", "foo"])
def test_counted_readings_need_a_stated_interval(tmp_path, name):
    table = f"{name},A,B\n" + rows([1, 2, 3, 4])
    refused(tmp_path, table, "log.csv", "counts the readings", "--fps", "--time-column")
    for stated in ("Sampling,200ms", "Sample interval: 0.2 s", "Rate;5 Hz", "Sampling interval (ms),200"):
        t, _, notes = import_table(tmp_path, f"{stated}\n{table}")
        assert t == pytest.approx([0.0, 0.2, 0.4, 0.6])
        assert "time from the stated interval" in notes


def test_a_table_without_header_that_counts_from_one_is_no_time_in_seconds(tmp_path):
    refused(tmp_path, rows([1, 2, 3]), "column 1 counts the readings")
    t, _, notes = import_table(tmp_path, rows([0, 1, 2]))
    assert t.tolist() == [0.0, 1.0, 2.0]
    assert "taken as s" in notes


def test_an_option_names_the_time_column(tmp_path):
    text = "a,b,c\n5,20,30\n7,21,31\n9,22,32\n"
    assert import_table(tmp_path, text, time_column="a")[0].tolist() == [0.0, 2.0, 4.0]
    text = "a,b,c\n20,5,30\n21,7,31\n22,9,32\n"
    assert import_table(tmp_path, text, (1, 3), time_column="2")[0].tolist() == [0.0, 2.0, 4.0]
    refused(tmp_path, text, "time_column: 'd': no such column", "a, b, c", columns=(1, 3), time_column="d")
    t, _, _ = import_table(tmp_path, "T1,T2,Time (s)\n20,30,0\n21,31,0.5\n", (1, 2))
    assert t.tolist() == [0.0, 0.5]


def test_two_columns_of_time_that_differ_are_refused(tmp_path):
    same = "Time (s),time_ms,A,B\n0,0,20,30\n10,10000,21,31\n"
    assert import_table(tmp_path, same, (3, 4))[0].tolist() == [0.0, 10.0]
    refused(tmp_path, same.replace("10000", "1000"), "both say time and differ", "--time-column", columns=(3, 4))


def test_readings_within_a_second_follow_the_stated_interval(tmp_path):
    table = "Time,A,B\n" + rows([f"12:00:0{k // 2}" for k in range(6)])
    t, _, notes = import_table(tmp_path, "Sampling,500ms\n" + table)
    assert t.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]
    assert "several readings in a second" in notes
    refused(tmp_path, table, "log.csv:3: time goes from 12:00:00 to 12:00:00")
    counted = "Time,A,B\n" + rows([1, 2, 3, 4])
    refused(tmp_path, "Sampling,200ms\n" + counted, "time steps by 1 s", "Sampling 200ms")


def test_columns_are_found_by_the_names_of_the_thermocouples(tmp_path):
    _, T, _ = import_table(tmp_path, "Time (s),TC2,TC1\n" + rows([0, 1]), None)
    assert T[0].tolist() == [30.25, 20.5]
    numbered = "NO.,Date&Time,ms,a,b\n1,2024-05-31 12:00:00,0,20,30\n2,2024-05-31 12:00:00,500,21,31\n"
    t, T, _ = import_table(tmp_path, numbered, None)  # behind the time, in order
    assert t.tolist() == [0.0, 0.5]
    assert T[0].tolist() == [20.0, 30.0]
    (tmp_path / "log.csv").write_text("Time (s),TC2,TC1\n" + rows([0, 1]))
    refused(tmp_path, HEADER + rows([0, 1]), "'Time (s)' says time", columns=(1, 2))


# --- formats of the time ------------------------------------------------------------------------------------
SECONDS = {  # four times one second apart
    "ISO 8601 with Z": [f"2024-05-31T12:59:5{k}.000Z" for k in range(4)],
    "ISO 8601 over a change of the clock": [
        "2024-10-27T02:59:59+02:00", "2024-10-27T02:00:00+01:00", "2024-10-27T02:00:01+01:00", "2024-10-27T02:00:02+01:00",
    ],
    "ISO 8601 basic": [f"20240531T12595{k}" for k in range(4)],
    "date with slashes": [f"2024/05/31 12:59:5{k}" for k in range(4)],
    "US over midnight": ["5/31/2024 11:59:59 PM", "6/1/2024 12:00:00 AM", "6/1/2024 12:00:01 AM", "6/1/2024 12:00:02 AM"],
    "US over noon": ["11:59:59 AM", "12:00:00 PM", "12:00:01 PM", "12:00:02 PM"],
    "dd.mm.yy": [f"31.05.24 12:59:5{k}" for k in range(4)],
    "dd.mm.yyyy": [f"31.05.2024 12:59:5{k},5" for k in range(4)],
    "dd/mm/yyyy by a day above 12": [f"31/05/2024 12:59:5{k}" for k in range(4)],
    "one day, order of no account": [f"01/02/2024 12:59:5{k}" for k in range(4)],
    "dd/mm over midnight": ["04/05/2024 23:59:59", "05/05/2024 00:00:00", "05/05/2024 00:00:01", "05/05/2024 00:00:02"],
    "mm/dd over midnight": ["04/05/2024 23:59:59", "04/06/2024 00:00:00", "04/06/2024 00:00:01", "04/06/2024 00:00:02"],
    "yy/mm/dd over midnight": ["24/05/31 23:59:59", "24/06/01 00:00:00", "24/06/01 00:00:01", "24/06/01 00:00:02"],
    "name of the month": [f"31-May-2024 12:59:5{k}" for k in range(4)],
    "German name of the month": [f"31. Mai 2024 12:59:5{k}" for k in range(4)],
    "name of the month first": [f"May 31, 2024 12:59:5{k} PM" for k in range(4)],
    "spans of pandas": ["0 days 23:59:59", "1 days 00:00:00", "1 days 00:00:01", "1 days 00:00:02"],
    "C": [f"Fri May 31 12:59:5{k} 2024" for k in range(4)],
    "clock before date": [f"12:59:5{k} 31.05.2024" for k in range(4)],
    "clock over midnight": ["23:59:59", "00:00:00", "00:00:01", "00:00:02"],
    "HHMMSS": ["144658", "144659", "144700", "144701"],
    "HHMMSS over midnight": ["235959", "000000", "000001", "000002"],
    "HHMMSS without the first zero": ["95958", "95959", "100000", "100001"],
    "14 digits": [f"2024053112595{k}" for k in range(4)],
    "Unix": [str(1717160390 + k) for k in range(4)],
    "Unix, ms": [str(1717160390000 + 1000 * k) for k in range(4)],
    "LabVIEW": [f"{3800005190 + k}.0" for k in range(4)],
    "elapsed": [f"0:59:5{k}" for k in range(4)],
    "elapsed beyond a day": ["99:59:58", "99:59:59", "100:00:00", "100:00:01"],
    "minutes, seconds, fractions": [f"12:5{k}.0" for k in range(4)],
}  # fmt: skip


@pytest.mark.parametrize("name", [n for n in SECONDS if n != "minutes, seconds, fractions"])
@pytest.mark.parametrize("label", ["Time", "Zeit"])
def test_a_format_of_time_is_read(tmp_path, name, label):
    t, T, _ = import_table(tmp_path, f"{label};A;B\n" + rows(SECONDS[name], ";"))
    assert t == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=1e-6)
    assert T[-1].tolist() == [23.5, 33.25]


@pytest.mark.parametrize(
    ("times", "right"),
    [
        (["12:59:50:250", "12:59:51:000", "12:59:51:500"], [0.0, 0.75, 1.25]),
        (["12:59:50:5", "12:59:50:50", "12:59:50:500"], [0.0, 0.045, 0.495]),  # not filled up: milliseconds
        (["00:01:02.5", "00:01:03.0", "00:01:03.5"], [0.0, 0.5, 1.0]),
        (["12:50.5", "12:51.0", "13:00.0"], [0.0, 0.5, 9.5]),
        (["12:59:50,25", "12:59:50,5", "12:59:51"], [0.0, 0.25, 0.75]),
        (["45443.5", "45443.500011574", "45443.500023148"], [0.0, 1.0, 2.0]),  # days of a spreadsheet
        (["739403.5", "739403.50001157", "739403.50002315"], [0.0, 1.0, 2.0]),  # MATLAB
        (["5", "7.25", "9"], [0.0, 2.25, 4.0]),
    ],
)
def test_fractions_and_days_are_read(tmp_path, times, right):
    t, _, _ = import_table(tmp_path, "Time;A;B\n" + rows(times, ";"))
    assert t == pytest.approx(right, abs=1e-3)


def test_date_and_clock_in_two_columns_with_milliseconds(tmp_path):
    text = "Datum;Uhrzeit;ms;A;B\n31.05.2024;23:59:59;500;20;30\n01.06.2024;00:00:00;0;21;31\n"
    t, _, _ = import_table(tmp_path, text, (4, 5), zero="2024-05-31T23:59:58")
    assert t == pytest.approx([1.5, 2.0], abs=1e-6)
    text = "Datums-Praefix;20240531\n\nUhrzeit;A;B\n144640;22,0;22,0\n144701;23,3;22,8\n"
    assert import_table(tmp_path, text, zero="2024-05-31 14:46:30")[0] == pytest.approx([10.0, 31.0])


@pytest.mark.parametrize(
    ("cell", "zero", "first"),
    [
        ("2024-05-31T12:59:5{}+02:00", "2024-05-31T10:59:49Z", 1.0),
        ("2024-05-31T12:59:5{}+02:00", "2024-05-31T12:59:49", 1.0),
        ("01/02/2024 12:59:5{}", "2024-02-01T12:59:49", 1.0),
        ("01/02/2024 12:59:5{}", "2024-01-02T12:59:49", 1.0),
        ("12:59:5{}", "12:59:49", 1.0),
    ],
)
def test_zero_is_a_moment_of_the_logger_s_clock(tmp_path, cell, zero, first):
    text = "Time;A;B\n" + rows([cell.format(k) for k in range(3)], ";")
    assert import_table(tmp_path, text, zero=zero)[0][0] == pytest.approx(first, abs=1e-6)


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (["12:00:00", "12:00:0x", "12:00:02"], (":3: '12:00:0x' in column 1 is no time",)),
        (["12:00:01", "12:00:02", "12:00:00"], (":4: time goes from 12:00:02 to 12:00:00",)),
        (["0", "1", "1"], (":4: time goes from 1 to 1",)),
        (["2024-05-31 25:00:00"] * 3, ("'2024-05-31 25:00:00' is a time that does not exist",)),
        (["2024-02-30 12:00:00"] * 3, ("'2024-02-30 12:00:00' is a date that does not exist",)),
        (["01:02", "01:03", "01:04"], ("'01:02' may be hours and minutes or minutes and seconds",)),
        (
            ["01/02/2024 12:00:00", "02/03/2024 12:00:00", "03/04/2024 12:00:00"],
            ("order of day and month is ambiguous",),
        ),
        (["12:59:59", "1:00:00", "1:00:01"], ("time goes from 12:59:59 to 1:00:00",)),
        (["13:00:00 PM"] * 3, ("no time of 12 hours",)),
        (["12:00:00", "2024-05-31 12:00:01", "12:00:02"], ("not written as the first time",)),
        (["0", "", "2"], (":3: no time in column 1",)),
        (["0", "OL", "2"], (":3: no time in column 1", "'OL'")),
    ],
)
def test_a_time_that_cannot_be_told_is_refused_as_it_stands(tmp_path, times, words):
    refused(tmp_path, "Time;A;B\n" + rows(times, ";"), "log.csv", *words)


def test_a_zero_that_does_not_fit_the_clock_is_refused(tmp_path):
    clock = "Time;A;B\n" + rows(["12:59:50", "12:59:51"], ";")
    refused(tmp_path, clock, "has no date", zero="2024-05-31T12:59:49")
    refused(tmp_path, clock.replace("12:", "2024-05-31 12:"), "has a date", zero="12:59:49")
    refused(tmp_path, clock, "zero: 'noon'", zero="noon")


# --- missing values -----------------------------------------------------------------------------------------
MARKS = [
    "OL", "O.L", "O.L.", "Open", "OPEN", "Open TC", "----", "--", "-", "---.-", "#N/A", "N/A", "n/a", "NaN", "nan", "ERR",
    "Error", "Err 12", "Over", "Over Range", "OVERFLOW", "Under", "Under-Range", "+OVER", "-OVER", "-OL", "BURNOUT",
    "Burn-out", "1.#QNAN", "-1.#IND", "1.#INF", "-1.#INF00", "9.9E37", "-9.9E+37", "9.91E37", "+9.90000000E+37",
    "9.91E+037", "", "*****", "inf", "-Infinity", "????", "#VALUE!", "null", "Fault", "no data", "<-200", ">1370",
]  # fmt: skip


@pytest.mark.parametrize("mark", [m for m in MARKS if m != "9.91E+037"])
def test_a_mark_of_a_missing_value_is_one(tmp_path, mark):
    for separator, sign in ((",", "."), (";", ",")):
        text = f"Time (s),A,B\n0,20.5,30.5\n1,{mark},31.5\n2,22.5,32.5\n"
        if sign == ",":
            text = f"Time (s);A;B\n0;20,5;30,5\n1;{mark};31,5\n2;22,5;32,5\n"
        _, T, _ = import_table(tmp_path, text)
        assert np.isnan(T).tolist() == [[False, False], [True, False], [False, False]], separator
        assert T[2, 0] == 22.5


@pytest.mark.parametrize("cell", ["-9999", "-999.9", "1e30", "7999"])
def test_a_plausible_number_is_no_mark_but_impossible_temperatures_are_named(tmp_path, cell):
    assert not is_missing(cell)
    refused(
        tmp_path, HEADER + f"0,20,30\n1,{cell},31\n2,22,32\n", "log.csv:3", repr(cell), "column 2", "empty that cell"
    )


@pytest.mark.parametrize("cell", ["2O.5", "20.5.1", "20 5", "l2", "abc", "1_0", "٣٤", "0x1F", "20,5e"])
def test_a_damaged_cell_is_named_with_line_and_column(tmp_path, cell):
    text = (HEADER + f"0;20.1;30\n1;{cell};31\n2;22.1;32\n").replace(",", ";", 2)
    refused(tmp_path, text, "log.csv:3", repr(cell), "column 2", "no number")


# --- lines around the table ---------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "footer",
    ["Max;27,0;25,0", "\nMax;27,0;25,0\nMin;20,0;21,0", "End of data", "Average;;", "Mean value;21,5;31,0", ";;", "\n\n",
     "Total: 3 readings", "*** END ***", "Max;27,0", "\nRemarks;brake;on", "Std.Dev.;0,1;0,1"],
)  # fmt: skip
def test_a_footer_is_left_out_and_told(tmp_path, footer):
    t, T, notes = import_table(tmp_path, f"Time (s);A;B\n0,0;20,5;30,5\n0,5;21,5;31,5\n1,0;22,5;32,5\n{footer}\n")
    assert t.tolist() == [0.0, 0.5, 1.0]
    assert T[-1].tolist() == [22.5, 32.5]
    assert ("left out" in notes) == bool(footer.strip("\n;"))


@pytest.mark.parametrize(
    "between",
    ["", "\n", "# pause", "Time (s),TC1 (degC),TC2 (degC)", "brake on", ",,", "-----"],
    ids=["nothing", "empty lines", "comment", "header again", "remark", "separators", "rule"],
)
def test_reading_goes_on_after_what_stands_between(tmp_path, between):
    t, T, _ = import_table(tmp_path, HEADER + rows([0, 1]) + between + "\n" + "2,22.5,32.25\n3,23.5,33.25\n")
    assert t.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert T[:, 0].tolist() == [20.5, 21.5, 22.5, 23.5]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEADER + "0,20,30\n1,21\n2,22,32\n", (":3:", "'1,21' has 2 values, others 3")),
        (HEADER + "0,20,30\n1,21,31\n2,22", (":4:", "'2,22' has 2 values")),
        (HEADER + "0,20,30\n1,21,31,5\n2,22,32\n", (":3:", "has 4 values, others 3")),
        (HEADER + "0,20,302,22,32\n3,21,31\n4,21,33\n", (":2:", "has 5 values, others 3")),
        (HEADER + "0,20.50,30.50\n1,21.50,31.50\n2,22.50,3", (":4:", "'3'", "cut off")),
        (HEADER + rows([0, 1]) + "Time (s),TC3,TC4\n" + rows([0, 1]), (":4:", "begins a second table")),
        (HEADER + "x,20,30\n1,21,31\n2,22,32\n", (":2:", "'x'")),
        ("O,20,30\n1,21,31\n2,22,32\n", (":1:", "'O'")),
        (HEADER + '0,20,30\n1,"21,31\n2,22,32\n3,23,33\n', (":3:", '"21')),
        ("Time,A,flag\n0,20,LL\n1,LL\n2,22,LL\n", (":3:", "'LL'")),
        ("Time,T1,T2\n0,0,20,5,30,2\n0,5,21,5,31,2\n1,0,22,5,32,2\n", (":1:", "names 3 columns", "6 cells")),
        ("0,0,20,5\n0,5,21,5\n1,0,22,5\n", ("decimal commas", "--decimal")),
        ("Time;A;B\n0;20,5;30,2\n1;21.5;31,2\n2;22,5;32,2\n", (":3:", "'21.5'")),
        (HEADER, ("no rows of numbers",)),
        ("Datum;20260617\n\nUhrzeit;A;B\n144640;22", ("log.csv",)),
        ("", ("the file is empty",)),
        ("PK\x03\x04xl", ("spreadsheet", "CSV")),
        (HEADER + "0,20,30\n1,21\0,31\n", (":3:", "NUL")),
        (HEADER + "0,20,30\n1,21,31\n\x02\x03garb\n", (":4:", "damaged")),
        (HEADER + "0,20,\n1,21,\n2,22,\n", ("column 3", "no temperature at all")),
        ("Time (s),A,B\n0,20 C,30\n1,70 F,31\n", ("column 2", "C and F in one column")),
    ],
)
def test_a_damaged_table_is_refused_with_its_line(tmp_path, text, words):
    refused(tmp_path, text, "log.csv", *words)


def test_no_truncation_of_a_table_changes_a_value(tmp_path):
    """Cut anywhere, a table is refused or gives the first of its readings unchanged."""
    whole = "Time (s),TC1,TC2\n" + "".join(f"{0.5 * k:.1f},{20 + 0.1 * k:.2f},{30 + 0.2 * k:.2f}\n" for k in range(8))
    t, T, _ = import_table(tmp_path, whole)
    kept = 0
    for end in range(60, len(whole)):
        try:
            some_t, some_T, _ = import_table(tmp_path, whole[:end])
        except BadInput:
            continue
        kept += 1
        assert np.array_equal(some_t, t[: len(some_t)]), whole[:end][-20:]
        assert np.array_equal(some_T, T[: len(some_T)]), whole[:end][-20:]
    assert kept >= 6


@pytest.mark.parametrize(
    "content",
    [
        (HEADER + rows([0, 1])).encode("utf-16"),
        b"\xef\xbb\xbf" + (HEADER + rows([0, 1])).replace("\n", "\r\n").encode(),
        ("Time (s);T1 (\u00b0C);T2 (\u00b0C)\n" + rows([0, 1], ";")).encode("latin-1"),
        "sep=;\n" + (HEADER + rows([0, 1])).replace(",", ";"),
        '"Time (s)","TC1","TC2"\n"0,0","20,5","30,25"\n"1,0","21,5","31,25"\n',
        '"Time\n(s)","TC1\n(degC)",TC2\n0,20.5,30.25\n1,21.5,31.25\n',
        (HEADER + rows([0, 1])).replace(",", "\t"),
        (HEADER + rows([0, 1])).replace(",", "|"),
        "Time (s)  TC1  TC2\n  0.0  20.5  30.25\n  1.0  21.5  31.25\n",
        "Time (s);A;B;\n0;20,5;30,25;\n1;21,5;31,25;\n",
        "Time (s);A;B\n0;20,5;30,25;\n1;21,5;31,25;\n",
        "Time (s),A,B,remark\n0,20.5,30.25,start\n1,21.5,31.25,\n",
        "Time (s),A,B\n0,20.5,30.25\n1,21.5,31.25,brake on\n",
        "Run 3\nOperator: Max\nChannels,2\nGain,5,7\n\n" + HEADER + rows([0, 1]),
        "Time (s)\tA\tB\n-----\t---\t---\n0\t20.5\t30.25\n1\t21.5\t31.25\n",
        "Time,1,2\n0,20.5,30.25\n1,21.5,31.25\n",
    ],
)
def test_a_dialect_is_recognised(tmp_path, content):
    t, T, _ = import_table(tmp_path, content)
    assert t.tolist() == [0.0, 1.0]
    assert T.tolist() == [[20.5, 30.25], [21.5, 31.25]]


# --- LabVIEW and TDMS ---------------------------------------------------------------------------------------
def lvm(x_columns="One", decimal=".", pref="Relative", unit="Deg C", starts=(("14:41:45.511", (0.0, 0.5)),), samples=None,
        separator="\t"):  # fmt: skip
    """A LabVIEW Measurement file of segments: their clock and X_Value."""
    names = "X_Value\tTC1\tX_Value\tTC2\tComment" if x_columns == "Multi" else "X_Value\tTC1\tTC2\tComment"
    word = {"\t": "Tab", ",": "Comma"}[separator]
    out = [
        "LabVIEW Measurement\t", "Writer_Version\t2", f"Separator\t{word}", f"Decimal_Separator\t{decimal}",
        "Multi_Headings\tYes", f"X_Columns\t{x_columns}", f"Time_Pref\t{pref}", "Date\t2024/05/31",
        "Time\t14:41:45.5111323470585990021", "***End_of_Header***\t", "\t",
    ]  # fmt: skip
    row = 0
    for clock, xs in starts:
        n = samples or len(xs)
        out += [
            "Channels\t2\t\t", f"Samples\t{n}\t{n}\t", "Date\t2024/05/31\t2024/05/31\t", f"Time\t{clock}\t{clock}\t",
            f"Y_Unit_Label\t{unit}\t{unit}\t", "X_Dimension\tTime\tTime\t", f"X0\t{xs[0]}\t{xs[0]}\t".replace(".", decimal),
            "Delta_X\t0.500000\t0.500000\t".replace(".", decimal), "***End_of_Header***\t\t\t", names,
        ]  # fmt: skip
        for x in xs:
            cells = [f"{v:.6f}".replace(".", decimal) for v in (x, 20.5 + row, 30.25 + row)]
            x_cell = "" if x_columns == "No" else cells[0]
            middle = [cells[0]] if x_columns == "Multi" else []
            out.append("\t".join([x_cell, cells[1], *middle, cells[2], "" if row else "start of sliding"]))
            row += 1
        out.append("")
    return "\r\n".join(out).replace("\t", separator) + "\r\n"


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"x_columns": "No"},
        {"decimal": ","},
        {"x_columns": "No", "decimal": ","},
        {"separator": ","},
        {"x_columns": "Multi"},
    ],  # fmt: skip
)
def test_a_labview_file_is_read_by_its_header(tmp_path, options):
    columns = (2, 4) if options.get("x_columns") == "Multi" else (2, 3)
    t, T, notes = import_table(tmp_path, lvm(**options), columns)
    assert t.tolist() == [0.0, 0.5]
    assert T.tolist() == [[20.5, 30.25], [21.5, 31.25]]
    assert "LabVIEW Measurement file, 1 segment" in notes
    assert import_table(tmp_path, lvm(**options), columns, zero="2024-05-31T14:41:45")[0][0] == pytest.approx(
        0.511, abs=1e-6
    )


@pytest.mark.parametrize(
    ("starts", "right"),
    [
        ((("14:41:45.0", (0.0, 0.5)), ("14:41:50.0", (0.0, 0.5))), [0.0, 0.5, 5.0, 5.5]),
        ((("14:41:45.0", (0.0, 0.5)), ("14:41:45.0", (5.0, 5.5))), [0.0, 0.5, 5.0, 5.5]),
        ((("14:41:45.0", (0.0, 0.5)), ("14:41:50.0", (5.0, 5.5))), [0.0, 0.5, 5.0, 5.5]),
        ((("14:41:45.0", (0.0, 0.5)), ("14:51:50.0", (5.0, 5.5))), None),
        ((("14:41:45.0", (0.0, 0.5)), ("14:41:45.0", (0.0, 0.5))), None),
    ],
)
def test_segments_of_a_labview_file_follow_their_clocks(tmp_path, starts, right):
    if right is None:
        refused(tmp_path, lvm(starts=starts), "log.csv:", "--fps")
    else:
        t, T, _ = import_table(tmp_path, lvm(starts=starts))
        assert t == pytest.approx(right)
        assert T[:, 0].tolist() == [20.5, 21.5, 22.5, 23.5]


def test_absolute_times_of_a_labview_file_count_from_1904(tmp_path):
    first = (np.datetime64("2024-05-31T12:41:45") - np.datetime64("1904-01-01")) / np.timedelta64(1, "s")
    text = lvm(pref="Absolute", starts=(("14:41:45.0", (first, first + 0.5)),))
    t, _, notes = import_table(tmp_path, text, zero="2024-05-31T12:41:44")
    assert t == pytest.approx([1.0, 1.5])
    assert "UTC" in notes


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (lvm(unit="Volts"), ("column 2 'TC1'", "'Volts'")),
        (lvm(samples=9), ("2 rows of a segment of 9 samples", "cut off")),
        (lvm().replace("21.500000", "2l.5"), ("'2l.5' in column 2",)),
        (lvm()[:-15], ("cut off",)),
        (lvm().split("X_Value")[0], ("no rows",)),
        (lvm()[:150], ("header of this LabVIEW file does not end",)),
        (
            lvm().replace("X_Dimension\tTime\tTime", "X_Dimension\tFrequency\tFrequency"),
            ("X_Dimension is 'Frequency'",),
        ),
        (lvm("No").replace("0.500000\t0.500000", "0.500000\t0.250000"), ("differ in X0 or Delta_X",)),
    ],
)
def test_a_labview_file_that_cannot_be_read_is_refused(tmp_path, text, words):
    refused(tmp_path, text, "log.csv", *words)


def tdms(folder, *channels, group="Temperatures"):
    """A TDMS file of channels (name, values, properties)."""
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(folder / "log.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject(group, n, np.asarray(v), p) for n, v, p in channels])
    return (folder / "log.tdms").read_bytes()


WAVEFORM = {"wf_start_time": np.datetime64("2024-05-31T12:00:00"), "wf_increment": 0.25, "wf_start_offset": 0.0}
RISE = np.array([20.0, 21.0, 22.0, 23.0])


def test_channels_of_a_tdms_file_are_columns_and_its_waveform_is_the_time(tmp_path):
    data = tdms(tmp_path, ("TC2", RISE + 10, WAVEFORM), ("TC1", RISE, WAVEFORM | {"unit_string": "degC"}))
    t, T, notes = import_table(tmp_path, data, None)
    assert t.tolist() == [0.0, 0.25, 0.5, 0.75]
    assert T[0].tolist() == [20.0, 30.0]
    assert "wf_increment" in notes
    assert "UTC" in notes
    assert import_table(tmp_path, data, (2, 1), zero="2024-05-31T11:59:59")[0][0] == pytest.approx(1.0)
    data = tdms(tmp_path, ("A", [68.0, np.nan, 9.9e37, 68.0], WAVEFORM | {"unit_string": "°F"}))
    _, T, _ = import_table(tmp_path, data, (1,))
    assert T[[0, 3], 0].tolist() == pytest.approx([20.0, 20.0])
    assert np.isnan(T[1:3]).all()


def test_a_channel_of_a_tdms_file_may_be_the_time(tmp_path):
    t, _, _ = import_table(tmp_path, tdms(tmp_path, ("Time (ms)", 500 * np.arange(4.0), {}), ("A", RISE, {})), (2,))
    assert t.tolist() == [0.0, 0.5, 1.0, 1.5]
    stamps = np.datetime64("2024-05-31T12:00:00") + np.arange(4) * np.timedelta64(500, "ms")
    t, _, _ = import_table(
        tmp_path, tdms(tmp_path, ("Stamp", stamps, {}), ("A", RISE, {})), (2,), zero="2024-05-31T12:00:00"
    )
    assert t == pytest.approx([0.0, 0.5, 1.0, 1.5], abs=1e-5)


def test_a_tdms_file_that_cannot_be_read_is_refused(tmp_path, capfd):
    both = [("A", RISE, WAVEFORM), ("B", RISE, WAVEFORM)]
    whole = tdms(tmp_path, *both)
    for end in (5, 30, len(whole) // 2, len(whole) - 40, len(whole) - 8):
        refused(tmp_path, whole[:end], "log.csv")
    assert capfd.readouterr().err == ""
    refused(tmp_path, tdms(tmp_path, ("A", RISE, {}), ("B", RISE, {})), "--fps", columns=(1, 2))
    other = WAVEFORM | {"wf_increment": 0.5}
    refused(tmp_path, tdms(tmp_path, both[0], ("B", RISE, other)), "differ in wf_increment", columns=(1, 2))
    refused(tmp_path, tdms(tmp_path, both[0], ("B", RISE[:3], WAVEFORM)), "3 to 4 samples", columns=(1, 2))


# --- tables of a case ---------------------------------------------------------------------------------------
SPEEDS = (column_matching.TIME, column_matching.SPEED)
FORCES = (column_matching.TIME, column_matching.FRICTION)


def read_pairs(folder, text, columns, **bounds):
    (folder / "a.csv").write_text(text)
    return read_xy_pairs("a.csv", folder, "schedule.speed", columns=columns, **bounds)


@pytest.mark.parametrize(
    ("header", "factors"),
    [
        ("time (s),speed (mm/s)", (1.0, 1e-3)), ("time_ms,speed_mps", (1e-3, 1.0)), ("t [min],v [km/h]", (60.0, 1 / 3.6)),
        ("t;v", (1.0, 1.0)), ("time,speed\nms,mm/s", (1e-3, 1e-3)), ("time_s,speed_m_s", (1.0, 1.0)),
        ("t/s,v/m/s", (1.0, 1.0)), ("s,m/s", (1.0, 1.0)), ("Time, Belt", (1.0, 1.0)), ("t,v,remark", (1.0, 1.0)),
    ],
)  # fmt: skip
def test_a_schedule_is_read_in_the_units_of_its_header(tmp_path, header, factors):
    separator = ";" if ";" in header else ","
    remark = ",on" if "remark" in header else ""
    t, v = read_pairs(tmp_path, f"{header}\n0{separator}100{remark}\n1{separator}200{remark}\n", SPEEDS)
    assert t == pytest.approx((0.0, factors[0]))
    assert v == pytest.approx((100 * factors[1], 200 * factors[1]))


@pytest.mark.parametrize("header", ["mu,time_s", "COF,Time (s)", "mu [-],t", "friction coefficient,time_s"])
def test_columns_are_exchanged_where_their_names_are(tmp_path, header):
    assert read_pairs(tmp_path, f"{header}\n0.9,1\n0.8,2\n", FORCES) == ((1.0, 2.0), (0.9, 0.8))


@pytest.mark.parametrize(
    ("header", "columns", "words"),
    [
        ("time_s,time_ms", SPEEDS, "'time_s' and 'time_ms' both say time"),
        ("time_s,temperature", SPEEDS, "says temperature"), ("time_s,force_N", SPEEDS, "'N' is no unit of speed"),
        ("time (s),speed (rpm)", SPEEDS, "the unit 'rpm' cannot be converted"), ("time,mu (N)", FORCES, "the unit 'N' cannot be converted"),
        ("mu,cof", FORCES, "both say friction coefficient"), ("time (foo),speed", SPEEDS, "'foo' is not known"),
    ],
)  # fmt: skip
def test_names_and_units_that_contradict_are_refused(tmp_path, header, columns, words):
    with pytest.raises(BadInput) as fault:
        read_pairs(tmp_path, f"{header}\n0,1\n1,2\n", columns)
    [line] = fault.value.lines
    assert line.startswith("schedule.speed: a.csv: ")
    assert words in line


def test_columns_that_nobody_asks_for_may_stand_beside(tmp_path):
    assert read_pairs(tmp_path, "t_s;F_N;mu;note\n0;5;0,9;a\n1;6;0,8;b\nMax;6;0,9;\n", FORCES) == (
        (0.0, 1.0),
        (0.9, 0.8),
    )
    with pytest.raises(BadInput, match=r"\['0', '5', '0.9'\] has 3 values; give 2 numbers per row"):
        read_pairs(tmp_path, "t,a,b\n0,5,0.9\n1,6,0.8\n", FORCES)


def test_a_friction_table_is_read_by_its_names(tmp_path):
    (tmp_path / "a.csv").write_text("mu,speed (km/h),T (F)\n0.9,3.6,68\n0.8,3.6,212\n0.7,7.2,68\n0.6,7.2,212\n")
    surface = read_surface(
        "a.csv",
        tmp_path,
        "friction.table",
        (column_matching.SPEED, column_matching.TEMPERATURE, column_matching.FRICTION),
    )
    assert surface.u == pytest.approx((1.0, 2.0))
    assert surface.v == pytest.approx((20.0, 100.0))
    assert surface.z == ((0.9, 0.8), (0.7, 0.6))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,v\n0,1\n2,1\n1,1\n", "a.csv:4: time goes from 2 to 1"),
        ("t,v\n0,1\n1,-5\n", "a.csv:3: value -5 in the table; give values >= 0"),
        ("t,v\n0,1\n1,OL\n", "a.csv:3: OL is not a finite number"),
        ("t,v\n0,1\n1,O.1\n2,1\n", "a.csv:3: ['1', 'O.1'] is not numeric"),
        ("time,v\n2024-05-31 12:00:00,1\n2024-05-31 12:00:01,1\n", "is a date; give the time in s"),
    ],
)
def test_a_table_of_a_case_names_line_and_cell(tmp_path, text, words):
    with pytest.raises(BadInput) as fault:
        read_pairs(tmp_path, text, SPEEDS, low=0.0)
    assert words in str(fault.value)


def test_elapsed_times_count_in_a_table_of_a_case(tmp_path):
    assert read_pairs(tmp_path, "time,mu\n00:00:01.5,0.8\n00:01:02.5,0.9\n", FORCES) == ((1.5, 62.5), (0.8, 0.9))
