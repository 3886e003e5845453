"""Dialects of exports by makers of loggers, cameras and profilometers: read rightly, or told what is assumed."""

from __future__ import annotations

import random

import numpy as np
import pytest
from camera.test_logger_files import import_table, refused, rows

from flashtemp.__main__ import main
from flashtemp.camera.importing import frame_times
from flashtemp.camera.importing.formats import text as text_images
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.thermocouple_files import read_positions
from flashtemp.physics.friction import measured_roughness
from flashtemp.physics.tables import timestamps
from flashtemp.physics.tables.cells import parse_number, shape_of
from flashtemp.physics.tables.dialect import TableDialect
from flashtemp.physics.tables.encoding import decode_text
from flashtemp.physics.tables.header import TableColumn
from flashtemp.physics.tables.text_table import TextTable, _cell_value
from flashtemp.physics.tables.timestamps import parse_stamp

TOA5 = (
    '"TOA5","CR1000","CR1000","1","CR1000.Std.22","CPU:p.CR1","35271","T"\n"TIMESTAMP","RECORD","BattV_Min","TC1","TC2"\n'
    '"TS","RN","Volts","Deg C","Deg C"\n"","","Min","Avg","Avg"\n'
)


# --- cells --------------------------------------------------------------------------------------------------
def test_blanks_behind_a_sign_pad_a_number(tmp_path):
    """Formats of fixed width write the sign first, as recorders do: "+  22.5"."""
    text = "No,Date&Time,ms,TC1,TC2\nNO.,Time,ms,degC,degC\n"
    text += "".join(f"{k},2024/05/31 12:00:00,{200 * k},+  2{k}.5,-  3{k}.25\n" for k in range(3))
    t, T, _ = import_table(tmp_path, text, (4, 5))
    assert t == pytest.approx([0.0, 0.2, 0.4])
    assert T.tolist() == [[20.5, -30.25], [21.5, -31.25], [22.5, -32.25]]
    assert parse_number("2 2.5", False) is None


@pytest.mark.parametrize(
    ("said", "encoding", "celsius"),
    [
        ("Â°F", "utf-8", 20.0), ("?F", "utf-8", 20.0), ("\ufffdF", "utf-8", 20.0), ("ﾟF", "utf-8", 20.0),
        ("ﾟF", "cp932", 20.0), ("°F", "mac-roman", 20.0), ("°F", "latin-1", 20.0), ("&deg;F", "utf-8", 20.0),
        ("Â°C", "utf-8", 68.0), ("°C", "utf-16-le", 68.0), ("°F", "utf-16-be", 20.0),
    ],
)  # fmt: skip
def test_a_degree_sign_that_an_encoding_spoiled_keeps_its_unit(tmp_path, said, encoding, celsius):
    for text in (f"Time (s),TC1 ({said})\n0,68\n1,68\n", f"Time,TC1\ns,{said}\n0,68\n1,68\n"):
        _, T, _ = import_table(tmp_path, text.encode(encoding), (2,))
        assert T[:, 0] == pytest.approx([celsius, celsius])


def test_a_minus_of_typesetters_is_a_minus_and_words_keep_their_letters():
    assert decode_text("\u22125.5;which?;Straße;ﾊﾟﾅ".encode(), "x") == "-5.5;which?;Straße;ﾊﾟﾅ"


@pytest.mark.parametrize("unit", ["Degree_F", "DEGREE F", "°F", "degF"])
def test_units_in_a_column_of_their_own_count(tmp_path, unit):
    text = "Place,Time,Ch1_Value,Ch1_Unit,Ch2_Value,Ch2_Unit\n"
    text += "".join(f"{k},12:00:0{k},68,{unit},212,{unit}\n" for k in range(3))
    _, T, _ = import_table(tmp_path, text, (3, 5))
    assert T[0] == pytest.approx([20.0, 100.0])
    refused(tmp_path, text.replace(f"2,12:00:02,68,{unit}", "2,12:00:02,68,Degree_C"), "units", columns=(3, 5))


# --- headers ------------------------------------------------------------------------------------------------
def test_names_stand_above_units_and_above_how_values_were_made(tmp_path):
    """Campbell's TOA5: time stamp and record number have no unit, a last line says Smp, Avg, Min."""
    text = TOA5 + "".join(f'"2024-05-31 12:00:0{k}",{k},13.2,2{k}.5,3{k}.25\n' for k in range(3))
    for columns in ((4, 5), None):
        t, T, _ = import_table(tmp_path, text, columns)
        assert t.tolist() == [0.0, 1.0, 2.0]
        assert T[2].tolist() == [22.5, 32.25]
    refused(tmp_path, text.replace('"TC1","TC2"', '"a","b"'), "'BattV_Min'", "Volts", columns=None)


def test_a_minimum_is_no_minute(tmp_path):
    """The symbol of the minute is "min" (SI Brochure, table 8)."""
    text = "Date,Time,MIN,MAX\n" + "".join(f"24/05/31,12:00:0{k},2{k}.5,3{k}.5\n" for k in range(3))
    t, T, _ = import_table(tmp_path, text, (3, 4))
    assert t.tolist() == [0.0, 1.0, 2.0]
    assert T[1].tolist() == [21.5, 31.5]
    t, _, _ = import_table(tmp_path, "min,TC1,TC2\n" + rows(range(3)))
    assert t.tolist() == [0.0, 60.0, 120.0]


def test_remarks_in_brackets_behind_a_unit_are_none(tmp_path):
    text = '"#","Date Time, GMT-07:00","Temp, °F (LGR S/N: 1, LBL: TC1)","Stopped (LGR S/N: 1)"\n'
    text += "1,05/31/24 02:03:00 PM,68,Logged\n2,05/31/24 02:03:01 PM,212,\n"
    _, T, _ = import_table(tmp_path, text, (3,))
    assert T[:, 0] == pytest.approx([20.0, 100.0])
    refused(tmp_path, "Time (s),type K (mV)\n0,1\n1,2\n", "mV", columns=(2,))


def test_blanks_part_names_but_not_their_units(tmp_path):
    t, T, _ = import_table(tmp_path, "Time (ms) TC1 [deg F] TC2\n" + rows(range(3), " "), None)
    assert t == pytest.approx([0.0, 1e-3, 2e-3])
    assert T[0] == pytest.approx([(20.5 - 32) / 1.8, 30.25])


@pytest.mark.parametrize("status", ["Alarm 101", "Status", "CJC", "Events"])
def test_columns_of_states_are_no_thermocouples_and_an_order_is_told(tmp_path, status):
    text = f"Time (s),A,{status},B,C\n" + "".join(f"{k},2{k},0,3{k},4{k}\n" for k in range(3))
    _, T, notes = import_table(tmp_path, text, None)
    assert T[0].tolist() == [20.0, 30.0]
    assert "thermocouples in their order from column 2 'A', column 4 'B'" in notes


@pytest.mark.parametrize("name", ["entity_id", "Sensor", "Channel", "device name"])
def test_sensors_under_each_other_are_refused(tmp_path, name):
    """A long table would mix the readings of two thermocouples."""
    ids = ("1", "2") if name == "Channel" else ("sensor.a", "sensor.b")
    text = f"{name},state,last_changed\n" + "".join(f"{ids[k % 2]},2{k},2024-05-31T12:00:0{k}Z\n" for k in range(6))
    refused(tmp_path, text, "names 2 sensors", "a column of temperatures for each", columns=(2,))
    t, T, _ = import_table(tmp_path, text.replace(ids[1] + ",", ids[0] + ","), (2,))
    assert t.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert T[5, 0] == 25.0


# --- times --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("february", "march", "encoding"),
    [
        ("Feb", "Mär", "cp1252"), ("Februar", "März", "utf-8"), ("févr.", "mars", "cp1252"), ("febrero", "marzo", "utf-8"),
        ("fev", "mar", "utf-8"), ("febbraio", "marzo", "utf-8"), ("feb", "mrt", "utf-8"), ("FEB", "MAR", "utf-8"),
    ],
)  # fmt: skip
def test_names_of_months_are_read_in_the_languages_of_cldr(tmp_path, february, march, encoding):
    """The 29th of a leap year is followed by March in every language."""
    text = f"Zeit;TC1;TC2\n29. {february} 2024 23:59:58;20,5;30\n29 {february} 2024 23:59:59;21,5;31\n1. {march} 2024 0:00:00;22,5;32\n"
    t, T, _ = import_table(tmp_path, text.encode(encoding))
    assert t.tolist() == [0.0, 1.0, 2.0]
    assert T[2].tolist() == [22.5, 32.0]


def test_a_month_that_may_be_two_is_none():
    """ "jui" begins juin and juillet."""
    assert parse_stamp("31 jui 2024 12:00:00") is None
    assert parse_stamp("31 juil. 2024 12:00:00").date[1] == 7  # type: ignore[union-attr]
    assert [parse_stamp(f"{d} 5 mars 2024").date for d in ("mar.", "mardi")] == [(5, 3, 2024)] * 2  # type: ignore[union-attr]


def test_names_of_zones_carry_over_the_end_of_summer_time(tmp_path):
    """RFC 5322 and the usual names of Europe; without a zone the clock runs backwards, which is refused."""
    cells = ("02:59:58 CEST", "02:59:59 CEST", "02:00:00 CET")
    head = "time,TC1,TC2\n"
    t, _, _ = import_table(tmp_path, head + rows(f"2024-10-27 {c}" for c in cells))
    assert t.tolist() == [0.0, 1.0, 2.0]
    refused(tmp_path, head + rows(f"2024-10-27 {c.split()[0]}" for c in cells), "must increase")


def test_an_hour_more_than_usual_is_told(tmp_path):
    """A clock that was set forward looks like a gap."""
    cells = ("01:59:57", "01:59:58", "01:59:59", "03:00:00", "03:00:01")
    t, _, notes = import_table(tmp_path, "time,TC1,TC2\n" + rows(cells))
    assert t[-1] == 3604.0
    assert "line 5: the clock goes on by an hour more than usual" in notes
    _, _, notes = import_table(tmp_path, "time (hh:mm),TC1,TC2\n" + rows(("01:00", "02:00", "03:00")))
    assert "hour more" not in notes


def test_the_finer_of_two_times_counts_and_one_that_is_later_is_told(tmp_path):
    text = "Index;Date;Time;TC1;TC2\n" + "".join(
        f"{k};{45443.5 + k / 864000:.6f};{0.1 * k:.6f};2{k};3{k}\n" for k in range(5)
    )
    t, _, notes = import_table(tmp_path, text, (4, 5))
    assert t == pytest.approx(0.1 * np.arange(5), abs=1e-6)
    assert "time from column 3 'Time'" in notes
    _, _, notes = import_table(tmp_path, "Time1,TC1,Time2,TC2\n0,20,0.05,30\n1,21,1.05,31\n", (2, 4))
    assert "column 3 'Time2' is 0.05 s after column 1 'Time1'" in notes


def test_parts_of_a_day_are_asked_for(tmp_path):
    """A spreadsheet stores a clock as a part of the day; read as s, 12:00:00 to 12:00:04 would take 46 us."""
    text = "Time,TC1,TC2\n" + rows(f"{(43200 + k) / 86400:.9f}" for k in range(5))
    refused(tmp_path, text, "parts of a day", "Time (d)")
    t, _, _ = import_table(tmp_path, text.replace("Time,", "Time (d),"))
    assert np.diff(t) == pytest.approx(1.0, abs=1e-3)


# --- what would be wrong in silence -------------------------------------------------------------------------
def test_rows_in_another_dialect_are_not_left_out(tmp_path):
    text = "Time (s);TC1;TC2\n" + "".join(f"{k}.0;2{k}.5;3{k}.5\n" for k in range(5))
    refused(tmp_path, text + "5,0;25,5;35,5\n", "log.csv:7", "'5,0'")
    refused(tmp_path, text + "5,0;25,5\n", "log.csv:7")


@pytest.mark.parametrize("stamp", ["2024-05-31 12:00:0{}", "Fri May 31 12:00:0{} 2024", "{}"])
@pytest.mark.parametrize("damaged", [0, 2, 4])
def test_a_row_that_lost_a_separator_is_not_left_out(tmp_path, stamp, damaged):
    lines = [f"{stamp.format(k)},2{k}.5,3{k}.5" for k in range(5)]
    lines[damaged] = lines[damaged].replace(".5,", ".5")
    refused(tmp_path, ",TC1,TC2\n" + "\n".join(lines) + "\n", f"log.csv:{damaged + 2}")


@pytest.mark.parametrize("end", ["22.5 ", "22.", "2", ""])
def test_a_last_cell_that_lost_its_unit_is_cut_off(tmp_path, end):
    refused(tmp_path, f"Time (s),TC1\n0,20.5 C\n1,21.5 C\n2,{end}", "log.csv:4", "cut off", columns=(2,))


def test_a_row_that_stands_twice_is_refused_but_for_coarse_clocks(tmp_path):
    """A stated interval tells readings of one second or minute apart; it does not explain a copy of a row."""
    fine = "Sampling,200ms\nTime,ms,TC1,TC2\n" + "".join(f"12:00:00,{200 * k},2{k},3{k}\n" for k in (0, 1, 1, 2, 3))
    refused(tmp_path, fine, "must increase", columns=(3, 4))
    whole = "Interval,1 s\nTime,TC1,TC2\n" + rows(f"12:00:0{k}" for k in (0, 1, 1, 2, 3))
    refused(tmp_path, whole, "must increase")
    coarse = "Interval,20 s\nTime (hh:mm),TC1,TC2\n" + rows(f"12:0{k // 3}" for k in range(7))
    t, _, notes = import_table(tmp_path, coarse)
    assert t.tolist() == [20.0 * k for k in range(7)]
    assert "several readings in a minute" in notes


def test_a_column_of_units_that_holds_another_word_is_refused(tmp_path):
    text = "Time (s),TC1,Unit\n0,68,degF\n1,68,degF\n"
    refused(tmp_path, text + "2,68,deg\n", "units", columns=(2,))
    refused(tmp_path, text.replace("degF", "mV"), "mV", columns=(2,))


def test_signs_of_thousands_are_refused_where_they_could_be_decimal(tmp_path):
    text = "Zeit [ms];TC1;TC2\n" + "".join(f"{'0' if not k else f'{k}.000'};2{k};3{k}\n" for k in range(5))
    refused(tmp_path, text, "'1.000'", "--decimal point")
    t, _, _ = import_table(tmp_path, text, decimal="point")
    assert t == pytest.approx(1e-3 * np.arange(5))


@pytest.mark.parametrize(("label", "cell"), [("TC1 (C)", "-273.15"), ("TC1 (C)", "-273.1"), ("TC1 (K)", "0")])
def test_absolute_zero_is_no_reading(tmp_path, label, cell):
    other = "300" if "K" in label else "20"
    refused(
        tmp_path, f"Time (s),{label}\n0,{other}\n1,{cell}\n2,{other}\n", "log.csv:3", "is absolute zero", columns=(2,)
    )


@pytest.mark.parametrize(
    ("above", "below"),
    [
        ("Temperatures in °F\n", ""), ("Channel,Type,Units\nTC1,K,F\n\n", ""), ("", "\nAll temperatures in F\n"),
        ("CH1,TC1,TEMP,TC_K,Off,degF\n", ""),
    ],
)  # fmt: skip
def test_fahrenheit_around_a_table_without_units_is_asked_for(tmp_path, above, below):
    text = f"{above}Time (s),TC1,TC2\n0,68,212\n1,68,212\n{below}"
    refused(tmp_path, text, "says Fahrenheit", "--unit degF")
    _, T, _ = import_table(tmp_path, text, unit="degF")
    assert T[0] == pytest.approx([20.0, 100.0])
    _, T, _ = import_table(tmp_path, text.replace("TC1,TC2", "TC1 (C),TC2 (C)"))
    assert T[0].tolist() == [68.0, 212.0]


# --- quick ways ---------------------------------------------------------------------------------------------
ODD = [
    "",
    "OL",
    "9.9E37",
    "-9.91e+37",
    "1e999",
    "1_0",
    "nan",
    "+ 5",
    "5,",
    "5.",
    "1.#QNAN",
    "22.5 C",
    "--",
    "٣",
    "1e",
    "5,e3",
    ".5",
]


def test_columns_are_read_at_once_as_cell_by_cell():
    draw = random.Random(3)
    for comma in (False, True):
        for _ in range(500):
            cells = [
                draw.choice([f"{draw.uniform(-1e3, 1e3):.3f}", draw.choice(ODD)]) for _ in range(draw.randint(1, 5))
            ]
            cells = [c.replace(".", ",") if comma and draw.random() < 0.9 else c for c in cells]
            column = TableColumn(1)
            table = TextTable("x", TableDialect(";", comma), (column,), [(c,) for c in cells], list(range(len(cells))))
            np.testing.assert_array_equal(table.numbers(column), [_cell_value(c, comma) for c in cells], str(cells))


@pytest.mark.parametrize(
    "cell",
    ["2024-05-31 14:03:00.250", "31.05.24 1:03", "5/31/2024 2:03:00 PM", "31. Mai 2024 23:59:59,5", "20240531T140300Z",
     "2 days 03:04:05.5", "14:03:00:250", "Fri May 31 14:03:00 CEST 2024", "2024-05-31T14:03:00+02:00"],
)  # fmt: skip
def test_times_of_one_shape_are_read_as_one_by_one(cell):
    draw = random.Random(4)
    quick = timestamps._make_parser(cell, shape_of(cell))
    for _ in range(50):
        other = "".join(str(draw.randint(0, 9)) if c.isdigit() and draw.random() < 0.7 else c for c in cell)
        parse = quick if "+" not in cell else timestamps._make_parser(other, shape_of(other))
        assert parse(other) == parse_stamp(other)


def test_lines_of_one_shape_are_judged_alike_but_for_marks_of_digits(tmp_path):
    """9.9E+37 marks a missing value beside decimal commas, 9.8E+36 is no number there."""
    text = "Zeit;TC1;TC2\n" + "".join(f"{k},0;2{k},5;3{k},5\n" for k in range(5))
    _, T, _ = import_table(tmp_path, text + "5,0;25,5;9.9E+37\n")
    assert np.isnan(T[5, 1])
    refused(tmp_path, text + "5,0;25,5;9.8E+36\n", "log.csv:7", "9.8E+36")


# --- small tables, images, line scans, tables of a case -----------------------------------------------------
@pytest.mark.parametrize(
    "text",
    [
        "sep=;\nname;x;z\nfront;0,01;0,002\nback;0,01;0,006\n", "name;x;z;\nfront;0,01;0,002;\nback;0,01;0,006;\n",
        "Name,X (mm),Z (mm)\nfront,10,2\nback,10,6\n", "name;x;z\nfront;10 mm;2 mm\nback;1,0 cm;0,6 cm\n",
    ],
)  # fmt: skip
def test_places_are_read_as_spreadsheets_write_them(tmp_path, text):
    (tmp_path / "places.csv").write_text(text)
    placed = read_positions(tmp_path / "places.csv")
    assert placed.places.names == ("front", "back")
    assert [*placed.places.x, *placed.places.z] == pytest.approx([0.01, 0.01, 0.002, 0.006])


def test_times_of_files_have_names_in_letters_of_either_case(tmp_path):
    (tmp_path / "times.csv").write_text("sep=;\nFile;Time;\na.csv;0;\nb.csv;1,5 s;\n")
    seen = [(tmp_path / name, frame_times.FrameTimestamps(1)) for name in ("a.csv", "b.csv")]
    assert frame_times.resolve_times(seen, ImportOptions(times=tmp_path / "times.csv")).tolist() == [0.0, 1.5]


IMAGE = np.round(25.0 + np.add.outer(np.sin(np.arange(60.0)), np.cos(np.arange(80.0))), 2)


def image_text(T, separator=";"):
    return "".join(separator.join(f"{x:.2f}" for x in row) + "\n" for row in T)


def test_units_of_an_image_may_stand_behind_the_word_temperature():
    for line in ("Units,Temperature F", "Unit: Temperature (Fahrenheit)", "Temperature [?F]"):
        found = text_images.read_text((line + "\n\n" + image_text(1.8 * IMAGE + 32, ",")).encode())
        assert found.temperature[0] == pytest.approx(IMAGE, abs=0.006)


def test_pixels_at_absolute_zero_are_missing():
    T = IMAGE.copy()
    T[3, 4] = T[3, 5] = -273.15
    found = text_images.read_text(image_text(T).encode())
    assert np.isnan(found.temperature[0]).sum() == 2
    assert "2 pixels at absolute zero left out" in found.notes


def test_separator_and_comma_of_irbis_are_found_where_the_header_does_not_say_them():
    head = "[Settings]\nImageWidth=80\nImageHeight=60\nTempUnit=°C\n\n[Data]\n"
    for body in (image_text(IMAGE, "\t").replace(".", ","), image_text(IMAGE), image_text(IMAGE, " ")):
        assert text_images.read_text((head + body).encode("cp1252")).temperature[0] == pytest.approx(IMAGE, abs=1e-9)


def test_a_line_scan_may_have_units_behind_blanks_and_a_path_length(tmp_path):
    h = np.round(np.cumsum(np.random.default_rng(1).normal(0, 0.2, 200)), 3)
    for head in ("X (mm) Z (µm)", "Path length [mm]\tDepth [µm]"):
        sign = "\t" if "\t" in head else " "
        lines = [head, *(f"{0.002 * k:.3f}{sign}{z:.3f}" for k, z in enumerate(h))]
        (tmp_path / "scan.txt").write_text("\n".join(lines) + "\n")
        scan = measured_roughness.read_line_scan(tmp_path / "scan.txt", "profile", stated=True)
        assert scan.step == pytest.approx(2e-6)
        assert np.ptp(scan.heights) == pytest.approx(1e-6 * np.ptp(h))


def test_what_is_left_out_of_a_table_of_a_case_is_told_once(tmp_path, capsys):
    (tmp_path / "v.csv").write_text("Time (s),v\n0,0.1\n100,0.1\n\nMax,0.1\n")
    assert main(["check", "cases/uniform_pressure", f"schedule.speed={tmp_path / 'v.csv'}"]) == 0
    said = capsys.readouterr().err
    assert said.count("left out: 'Max,0.1'") == 1
    assert said.count("column 2 'v': unit not stated, taken as m/s") == 1
    assert main(["check", "cases/uniform_pressure", f"schedule.speed={tmp_path / 'v.csv'}", "block.length=-1"]) == 2
    said = capsys.readouterr().err
    assert "block.length" in said
    assert "v.csv" not in said
