"""Images and line scans as cameras and instruments of the field write them: read rightly, or refused in one line."""

from __future__ import annotations

import codecs
from pathlib import Path

import numpy as np
import pytest
from camera.test_formats import fff, info_record, jpeg, raw_record

from flashtemp.camera.importing import recording_import
from flashtemp.camera.importing.formats.cell_parsing import parse_cells
from flashtemp.camera.importing.formats.text_labels import is_evenly_spaced
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.import_request import describe_order, expand_patterns
from flashtemp.camera.importing.readers import read_frames
from flashtemp.camera.radiometry import ObjectParameters, PlanckCalibration, apparent_counts
from flashtemp.errors import BadInput
from flashtemp.physics.friction import measured_roughness
from flashtemp.runs.studies import road_surface


def scene(rows: int, columns: int) -> np.ndarray:
    """A warm spot with noise, degC to 0.01."""
    v, u = np.mgrid[:rows, :columns]
    spot = np.exp(-(((u / columns - 0.6) / 0.15) ** 2) - ((v / rows - 0.4) / 0.15) ** 2)
    return np.round(25.0 + 10.0 * spot + 0.05 * np.random.default_rng(20).standard_normal(u.shape), 2)


SCENE = scene(14, 20)  # a size that no sensor has
SENSOR = scene(60, 80)  # one that some have
ROWS, COLUMNS = SCENE.shape
IN_F, IN_K = np.round(1.8 * SCENE + 32, 2), np.round(SCENE + 273.15, 2)


def lines_of(T=SCENE, separator=",", decimal=".", suffix="", quote="", digits=2) -> list[str]:
    """Rows of an image as text."""
    cell = f"{quote}{{:.{digits}f}}{suffix}{quote}"
    return [separator.join(cell.format(x).replace(".", decimal) for x in row) for row in T]


def join(*lines: str, end="\n") -> bytes:
    return (end.join(lines) + end).encode()


@pytest.fixture
def load(tmp_path):
    """Bytes -> Frames, through a file."""

    def load(data: bytes, **said):
        (tmp_path / "image.csv").write_bytes(data)
        return read_frames(tmp_path / "image.csv", **said)

    return load


def refusal(load, data: bytes, says: str, **said) -> str:
    with pytest.raises(BadInput, match=says) as fault:
        load(data, **said)
    [line] = fault.value.lines
    assert "\n" not in line
    assert "image.csv" in line
    return line


def is_scene(frames, T=SCENE, tolerance=0.0061) -> bool:
    """Whether an image is the scene, to the digits that were written."""
    return frames.temperature.shape == (1, *T.shape) and np.nanmax(np.abs(frames.temperature[0] - T)) < tolerance


# --- FLIR: constants of the air -------------------------------------------------------------------------------
AIRS = {
    "compact": (5.4e-8, 7e-6, 0.0026, 0.0036, 0.99999),
    "drone": (1.24e-8, 1.11e-8, 0.00318, 0.00318, 0.732),
    "usual": (0.006569, 0.01262, -0.002276, -0.00667, 1.9),
    "X out of use": (0.006, 0.0, 0.0, 0.0, 1.0),
    "none": (0.0, 0.0, 0.0, 0.0, 0.0),
}
AT = (0x70, 0x74, 0x78, 0x7C, 0x80)
WARM = np.linspace(15.0, 80.0, 12 * 16).reshape(12, 16)
CALIBRATION = PlanckCalibration(14985.93, 0.0112832, 1398.1, 1.0, -6233.0)


def through_air(air, distance=2.0, constants=None) -> bytes:
    """A file of a camera that looks at WARM through air of those constants."""
    names = ("alpha1", "alpha2", "beta1", "beta2", "X")
    own = ObjectParameters(0.95, 22.0, 21.0, 0.4, distance, **dict(zip(names, air, strict=True)))
    counts = np.round(apparent_counts(WARM, CALIBRATION, own)).astype(np.uint16)
    return fff(counts, seen=own, numbers=dict(zip(AT, constants or air, strict=True)))


@pytest.mark.parametrize("kind", AIRS)
@pytest.mark.parametrize("distance", [0.0, 0.3, 2.0, 50.0])
def test_constants_of_the_air_of_any_size_are_used_while_the_transmission_is_one(load, kind, distance):
    frames = load(through_air(AIRS[kind], distance))
    assert np.abs(frames.temperature[0] - WARM).max() < 0.03  # half a count
    said = [note for note in frames.notes if "no constants" in note]
    assert len(said) == (kind == "none" and distance > 0)


@pytest.mark.parametrize(
    "bad", [(0.9, *AIRS["usual"][1:]), (*AIRS["usual"][:4], 40.0), (np.nan,) * 5, (-0.5, -0.5, 0, 0, 1)]
)
def test_a_transmission_beyond_0_to_1_is_refused_and_distance_0_is_the_remedy(load, bad):
    data = through_air(AIRS["usual"], 2.0, constants=bad)
    line = refusal(load, data, "air: its constants .* transmission of .*--distance 0")
    assert "alpha" in line
    assert np.isfinite(load(data, parameters={"distance": 0.0}).temperature).all()
    assert np.isfinite(load(through_air(AIRS["usual"], 0.0, constants=bad)).temperature).all()


def test_without_a_path_the_air_may_be_anything(load):
    data = fff(numbers={0x24: 0.0, 0x2C: 0.0, **dict.fromkeys(AT, 0.0)})  # 0 m, 0 K
    assert np.isfinite(load(data).temperature).all()
    refusal(load, fff(numbers={0x2C: 0.0}), "air: -273.15; give")


def test_the_transmission_over_no_distance_is_1_whatever_the_constants():
    assert ObjectParameters(distance=0.0, alpha1=np.nan, X=90.0).transmission == 1.0


# --- FLIR: calibrations that are none -----------------------------------------------------------------------
def calibrated(R1, R2, B, F, O, counts=8100) -> bytes:  # noqa: E741 (the maker's letter)
    image = np.full((12, 16), counts, np.uint16) + np.arange(16, dtype=np.uint16)
    record = bytearray(info_record(numbers={0x58: R1, 0x5C: B, 0x60: F, 0x30C: R2}))
    record[0x308:0x30C] = int(O).to_bytes(4, "little", signed=True)
    return fff(records={0x01: raw_record(image), 0x20: bytes(record)})


@pytest.mark.parametrize(
    "constants",
    [
        (366545, 1, 1428, 1, 342), (366545, 1, 1428, 1, -342), (395653, 1, 1428, 1, 156), (1, 1, 1428, 1, 0),
        (0, 0, 0, 0, 0), (1e9, 1e-3, 1428, 1, 0),
    ],
    ids=str,
)  # fmt: skip
@pytest.mark.parametrize("wrap", [lambda data: data, jpeg, lambda data: data * 2], ids=["FFF", "JPEG", "SEQ"])
def test_what_a_core_without_calibration_writes_is_refused_with_the_remedy(load, constants, wrap):
    data = wrap(calibrated(*constants))
    refusal(load, data, "planck: .*(--planck|copy it again)")
    own = PlanckCalibration(14000.0, 0.03, 1428.0, 1.0, -100.0)
    assert np.isfinite(load(data, planck=own).temperature).all()


@pytest.mark.parametrize(
    ("constants", "counts", "noted"),
    [
        ((364058, 1, 1428, 1, -228), 3000, False),  # a calibrated Tau 2
        ((17096.453, 0.04351538, 1428, 1, -55), 3000, False),  # Vue Pro R
        ((17096.453, 0.046642166, 1428, 1, -342), 3200, True),  # Zenmuse XT: the core's own constants
        ((21106.77, 0.012545258, 1501, 1, -7340), 15000, False),
    ],
)
def test_calibrations_of_radiometric_cores_are_read(load, constants, counts, noted):
    frames = load(calibrated(*constants, counts))
    assert -40 < np.nanmedian(frames.temperature) < 60
    assert any("several K off" in note for note in frames.notes) == noted


# --- units --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("T", "suffix"),
    [(IN_F, s) for s in (" degF", "°F", "F", " ° F", " deg F", " ℉", "ºF", " Fahrenheit")]
    + [(IN_K, s) for s in (" K", "K", " Kelvin")]
    + [(SCENE, s) for s in (" °C", "C", "˚C", " degC", "℃", " Celsius", "°")],
)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_the_unit_in_the_cells_is_read(load, T, suffix, separator):
    frames = load(join(*lines_of(T, separator, suffix=suffix)))
    assert is_scene(frames)
    assert any("the cells say" in note for note in frames.notes) == (suffix != "°")


HEADERS = {
    "degF": [
        "Temperature (F)", "Unit: °F", "Temperature unit: Fahrenheit", "[°F]", "Temperatur in °F", "Einheit;°F",
        "temp_unit=degF", "Temperature / F", "Data (°F)", "Temp [F]", "°F", "Units=F", "# unit: degF", "Scale: Fahrenheit",
        'Temperature Unit,"°F"', "Unidad: °F", "TempUnit = F", "Unit of temperature: deg F", "Values in Fahrenheit", "单位：℉",
        "Emissivity: 0.95; Temperature (°F)", "Title,Road test (C) 2019\nUnits,F",
    ],
    "K": ["Units=K", "Temp. unit;Kelvin", "T [K]", "Temperature,Kelvin", "Temperatur (K)", "; Unit K", "temperature_K"],
    "degC": ["[°C]", "Unit: °C", "Temperatur [C]", "Celsius", "Temperature (degC)", "Einheit = Grad C"],
}  # fmt: skip


@pytest.mark.parametrize(("unit", "header"), [(u, h) for u, some in HEADERS.items() for h in some])
def test_the_unit_in_the_header_is_read(load, unit, header):
    T = {"degF": IN_F, "K": IN_K, "degC": SCENE}[unit]
    frames = load(join(header, *lines_of(T, separator="\t")))
    assert is_scene(frames)
    assert not any("unit not said" in note for note in frames.notes)
    assert any(note.startswith(unit) for note in frames.notes)
    assert is_scene(load(join(*lines_of(T, separator="\t"), header))), "in a footer"


@pytest.mark.parametrize(
    "header",
    ["Distance unit: m", "Camera unit 3", "(C) 2023 Maker", "Emissivity: 0.95", "Pixel (K): 7", "Reflected temperature: 20 °C",
      "F 1.0", "Max: 41.3", "Frame K"],
)  # fmt: skip
def test_other_words_are_no_unit_of_the_image(load, header):
    frames = load(join(header, *lines_of()))
    assert is_scene(frames)
    assert any("unit not said" in note for note in frames.notes)


@pytest.mark.parametrize(
    ("lines", "says", "said"),
    [
        (["Unit: °C", *lines_of(IN_F, suffix=" °F")], "'Unit: °C' and the cells, in degF", {}),
        (["Unit: °C", "Temperature (F)", *lines_of(IN_F)], "state different units", {}),
        (["Unit: °F", *lines_of(IN_F)], "--unit K, but 'Unit: °F' says degF", {"unit": "K"}),
        (lines_of(IN_F, suffix="F"), "--unit degC, but the cells say degF", {"unit": "degC"}),
        (
            [*lines_of(SCENE[:-1], suffix="C"), *lines_of(IN_F[-1:], suffix="F")],
            "line 14: .* one unit in all cells",
            {},
        ),
        (["Unit: Rankine", *lines_of(IN_F)], "unit that is not known", {}),
        (["Units=K", *lines_of()], "in K would be -2.* degC", {}),
        (["Unit: counts", *lines_of(100 * SCENE, digits=0, separator=";")], "counts.*--scale", {}),
        (["Reflected temperature: 68 °F", *lines_of(IN_F)], "reflected 68 °F' is not in degC; give --unit", {}),
        (["Ambient (F): 70", *lines_of(IN_F)], "air 70 F' is not in degC; give --unit", {}),
        (["Fahrenheit thermogram", *lines_of(IN_F)], "'Fahrenheit thermogram' is not in degC; give --unit", {}),
        (["Maximum: 120.0 °F", *lines_of(IN_F)], "while 'Maximum: 120.0 °F' is not in degC; give --unit", {}),
    ],
)
def test_units_that_contradict_each_other_are_refused(load, lines, says, said):
    refusal(load, join(*lines), says, **said)


def test_a_maximum_of_the_image_in_a_footer_states_its_unit(load):
    frames = load(join(*lines_of(IN_F, separator="\t"), "", f"Max: {IN_F.max():.2f} °F", "Min: 76.5 °F"))
    assert is_scene(frames)
    assert any("°F" in note for note in frames.notes)


def test_object_parameters_are_read_in_their_own_units(load):
    head = [
        "Unit: °C",
        "Reflected Temp,68 °F,Emissivity,0.93",
        "Distance: 50 cm",
        "Humidity 45 %",
        "Atmospheric transmission: 0.99",
    ]
    assert load(join(*head, *lines_of())).stated_parameters == pytest.approx(
        {"reflected": 20.0, "emissivity": 0.93, "distance": 0.5, "humidity": 0.45}
    )
    head = ["Temperature unit: F", "Reflected temperature: 68", "Object distance (ft): 3"]
    assert load(join(*head, *lines_of(IN_F))).stated_parameters == pytest.approx(
        {"reflected": 20.0, "distance": 0.9144}
    )


# --- labels ---------------------------------------------------------------------------------------------------
def labelled(columns, rows, corner="", separator=";", decimal=",", T=SCENE, digits=1) -> list[str]:
    """An image with labels above and beside it."""
    head = separator.join([corner, *(f"{x:.{digits}f}".replace(".", decimal) for x in columns)])
    body = lines_of(T, separator, decimal)
    return [
        head,
        *(f"{y:.{digits}f}{separator}".replace(".", decimal) + row for y, row in zip(rows, body, strict=True)),
    ]


C, R = np.arange(COLUMNS), np.arange(ROWS)


@pytest.mark.parametrize(
    ("columns", "rows", "digits"),
    [
        (0.5 * C, 0.5 * R, 1), (-20 + 0.5 * C, 14.75 - 0.5 * R, 2), (C, R, 0), (C + 1, R + 1, 0), (100 - C, R, 0),
        (C / 3, R / 3, 2), (1e-3 * C, 1e-3 * R, 4), (0.127 * C, 0.127 * (R[::-1] + 1), 3),
    ],
)  # fmt: skip
@pytest.mark.parametrize("corner", ["", "0", "Y/X", "y\\x [mm]", "mm"])
def test_labels_that_count_evenly_are_left_out(load, columns, rows, digits, corner):
    frames = load(join(*labelled(columns, rows, corner, digits=digits)))
    assert is_scene(frames)
    assert any("labels left out: columns" in note for note in frames.notes)


@pytest.mark.parametrize("where", ["columns", "rows"])
@pytest.mark.parametrize("start", [0.0, 1.0, -13.5])
def test_labels_on_one_side_are_left_out_where_the_size_is_a_sensors(load, where, start):
    labels = start + 0.5 * np.arange(80 if where == "columns" else 60)
    T = np.vstack([labels, SENSOR]) if where == "columns" else np.column_stack([labels, SENSOR])
    frames = load(join(*lines_of(T)))
    assert is_scene(frames, SENSOR)
    assert any(f"labels left out: {where}" in note for note in frames.notes)
    after = np.vstack([SENSOR, labels]) if where == "columns" else np.column_stack([SENSOR, labels])
    assert is_scene(load(join(*lines_of(after))), SENSOR), "below, and to the right"


@pytest.mark.parametrize("name", ["R{}", "row {}", "y={}", "Z{}"])
def test_names_of_rows_and_columns_are_left_out(load, name):
    body = [f"{name.format(k)};{row}" for k, row in enumerate(lines_of(separator=";"))]
    for corner in ("", "Y/X", "#"):
        head = ";".join([corner, *(f"C{k}" for k in C)])
        assert is_scene(load(join(head, *body)))
    assert is_scene(load(join(*body)))
    assert is_scene(load(join(";" + ";".join(map(str, C)), *body)))


def test_numbers_and_places_of_rows_and_columns_are_left_out(load):
    """Two lines of labels on a side, and columns named like those of a spreadsheet."""
    rows = lines_of(separator=";")
    both = [f"{k + 1};{0.5 * k:g};{row}" for k, row in enumerate(rows)]
    one = [f"{k + 1};{row}" for k, row in enumerate(rows)]
    numbers, places = ";".join(map(str, C)), ";".join(f"{0.25 * c:g}" for c in C)
    assert is_scene(load(join(";;" + places, *both)))
    assert is_scene(load(join(";" + numbers, ";" + places, *one)))
    assert is_scene(load(join(";;" + numbers, ";;" + places, *both)))
    letters = ";" + ";".join("ABCDEFGHIJKLMNOPQRSTUVWXYZ"[c] for c in C)
    refusal(load, join(letters, *one), "first column counts evenly.*--labels rows")
    assert is_scene(load(join(letters, *one), labels="rows")), "a table of a logger looks the same"
    assert is_scene(load(join(*(f"{13 - k};{row}" for k, row in enumerate(rows)), ";" + numbers))), "below"


def test_a_corner_may_state_the_unit(load):
    for corner in ("Temperature (F)", "T [°F]", "y/x [mm], T in °F"):
        frames = load(join(*labelled(0.5 * C, 0.5 * R, corner, T=IN_F)))
        assert is_scene(frames)


def test_labels_without_a_corner_are_left_out(load):
    lines = labelled(0.5 * C, 0.5 * R, separator="\t", decimal=".")
    assert is_scene(load(join(lines[0].lstrip("\t"), *lines[1:])))
    refusal(load, join("\t".join(map(str, C[:-1])), *lines_of(separator="\t")), "labels without a corner, or a row")


def gradient(kind: str, rows: int, columns: int) -> np.ndarray:
    """An image without noise, in which rows, columns or both count evenly."""
    v, u = np.mgrid[:rows, :columns].astype(float)
    return {
        "in both directions": 20.0 + 0.5 * u + 0.3 * v,
        "along rows": 20.0 + 0.5 * u,
        "down columns": 20.0 + 0.3 * v,
        "with a spot": np.round(20.0 + 0.5 * u + 0.3 * v + 20.0 * np.exp(-((u - 9) ** 2 + (v - 7) ** 2) / 4), 2),
        "twisted": 20.0 + 0.5 * u + 0.3 * v + 0.01 * u * v,
    }[kind]


GRADIENTS = ("in both directions", "along rows", "down columns", "with a spot", "twisted")


@pytest.mark.parametrize("kind", GRADIENTS)
@pytest.mark.parametrize("shape", [(60, 80), (14, 20)])
def test_a_gradient_is_an_image(load, kind, shape):
    T = gradient(kind, *shape)
    frames = load(join(*lines_of(T)), decimal="point")
    assert is_scene(frames, T)
    assert not any("labels" in note for note in frames.notes)


@pytest.mark.parametrize("kind", GRADIENTS)
def test_labels_around_a_gradient_are_left_out(load, kind):
    T = gradient(kind, 14, 20)
    assert is_scene(load(join(*labelled(2.0 * C, 2.0 * R, T=T))), T)


@pytest.mark.parametrize("side", ["first row", "last column", "first column"])
def test_labels_that_cannot_be_told_from_the_image_are_asked_for(load, side):
    """A size that no sensor has: the message names the option, and each answer is obeyed."""
    T = SCENE.copy()
    if side == "first row":
        T[0] = 25.0 + 0.03 * np.arange(COLUMNS)
    elif side == "first column":
        T[:, 0] = 0.5 * np.arange(ROWS)
    else:
        T[:, -1] = 0.5 * np.arange(ROWS)
    name = "columns" if side == "first row" else "rows"
    refusal(load, join(*lines_of(T, separator=";")), f"{side} counts evenly.*--labels {name} or --labels none")
    assert is_scene(load(join(*lines_of(T, separator=";")), labels="none"), T)
    if side != "last column":
        rest = T[1:] if name == "columns" else T[:, 1:]
        assert is_scene(load(join(*lines_of(T, separator=";")), labels=name), rest)


def test_is_even_needs_a_step():
    assert not is_evenly_spaced(np.full(9, 25.0))
    assert not is_evenly_spaced(np.array([1.0, 2.0]))
    assert is_evenly_spaced(np.array([3.0, 1.0, -1.0]))
    assert not is_evenly_spaced(np.array([0.0, 1.0, np.nan, 3.0]))
    assert not is_evenly_spaced(25.0 + 0.01 * np.arange(80) + 0.02 * np.sin(np.arange(80)))


# --- quotes and decimal signs ---------------------------------------------------------------------------------
@pytest.mark.parametrize("bom", [b"", codecs.BOM_UTF8])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("separator", [",", ";", "\t", ", "])
@pytest.mark.parametrize("decimal", [",", "."])
def test_quoted_cells_need_no_decimal(load, bom, end, separator, decimal):
    data = bom + join('"Temperature unit","°C"', *lines_of(separator=separator, decimal=decimal, quote='"'), end=end)
    assert is_scene(load(data))


def test_other_ways_of_quoting(load):
    some = [row.replace('"25,00"', "25") for row in lines_of(decimal=",", quote='"')]
    assert is_scene(load(join(*some))), "whole numbers without quotes"
    assert is_scene(load(join(*(f'"{row}"' for row in lines_of(separator=";", decimal=","))))), "whole rows"
    assert is_scene(load(join(*lines_of(decimal=",", quote='"', digits=3)))), "25,031 as thousands is no temperature"
    assert is_scene(load(join(*lines_of(separator=" ", decimal=",", quote='"')))), "blanks between"
    assert is_scene(load(join(*lines_of(decimal=",", quote='"')), decimal="comma")), "said as well"


@pytest.mark.parametrize(
    ("lines", "says", "said"),
    [
        ([row.replace("25,", "1.025,") for row in lines_of(separator=";", decimal=",")], "thousands separator", {}),
        ([row.replace("25.", "1,025.") for row in lines_of(quote='"')], "thousands separator", {}),
        ([row.replace("25.", "1'025.") for row in lines_of(separator=";")], "thousands separator", {}),
        (lines_of(1.0 + 0.01 * SCENE, decimal=",", quote='"', digits=3), "'1,25.' could be 125. or 1.25.; say --decimal comma", {}),
        (lines_of(decimal=","), "decimal comma|values, others|decimal commas", {}),
        (lines_of(separator=";"), "decimal: comma said, but '2", {"decimal": "comma"}),
        (lines_of(separator=";", decimal=","), "decimal: point said, but '2", {"decimal": "point"}),
        ([*lines_of(SCENE[:9], ";", ","), *lines_of(SCENE[9:], ";", ".")], "has a comma and .* a point", {}),
    ],
)  # fmt: skip
def test_signs_that_could_part_thousands_are_refused(load, lines, says, said):
    refusal(load, join(*lines), says, **said)


# --- lines around and between the rows -------------------------------------------------------------------------
BODY = lines_of(SENSOR, separator=";")
EXPORTS = {
    "blank line": [*BODY[:17], "", *BODY[17:]],
    "blank lines in halves": [*BODY[:30], "", *BODY[30:]],
    "a blank after every row": [line for row in BODY for line in (row, "")],
    "comments": ["# FLIR", "# 80 x 60", *BODY[:9], "# shutter", *BODY[9:], "# end"],
    "slashes": ["// export", *BODY],
    "footers": [*BODY, "", "Max: 35.0", "Min;24.8", "Average;27.1;°C"],
    "a footer at once": [*BODY, "Max: 35.0"],
    "trailing separators": [row + ";" for row in BODY],
    "two trailing separators": [row + ";;" for row in BODY],
    "some trailing separators": [row + ";" * (k % 3) for k, row in enumerate(BODY)],
    "remarks": [row + (";shutter closed" if k in (7, 8) else "") for k, row in enumerate(BODY)],
    "a column of remarks": [row + ";ok" for row in BODY],
    "spreadsheet": ["Emissivity;0.95" + ";" * 78, "Unit;°C" + ";" * 78, ";" * 79, *BODY, ";" * 79],
    "ResearchIR": ["Image file,C:\\data\\rec 0001.ats", "Object parameters", "Emissivity;0.95", "Distance (m);1.0", "", *BODY],
    "Optris": ["Time:;12:00:03.250", "Area 1;25.1;°C", *BODY],
    "Testo": ["IRSoft;Version 4.5", "Datum;31.05.2024", "Emissionsgrad;0,95", "Reflektierte Temperatur [°C];20,0", *BODY],
    "Hikmicro": ["Basic Info", "Device;Pocket2", "Emissivity;;;0.96", "Max. Temp;;;35.05 ℃", "Temperature Data (℃)", *BODY],
    "rows and columns": ["Rows: 60", "Columns: 80", *BODY],
}  # fmt: skip


@pytest.mark.parametrize("kind", EXPORTS)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_around_the_rows_of_an_export(load, kind, end):
    assert is_scene(load(join(*EXPORTS[kind], end=end)), SENSOR)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252", "latin-1"])
def test_encodings(load, encoding):
    data = join("Temperatur [°F]", *lines_of(IN_F, "\t", ",")).decode().encode(encoding)
    assert is_scene(load(data))


def test_nul_bytes(load):
    whole = join(*BODY)
    frames = load(whole + b"\0" * 500)
    assert is_scene(frames, SENSOR)
    assert any("500 NUL bytes" in note for note in frames.notes)
    refusal(load, whole[:9000] + b"\0" * 40 + whole[9040:], "line 1?[0-9]+ holds a NUL byte|no text")
    refusal(load, whole[:9000] + b"\0" * 500, "cut off|values, others|part of an image")


MARKS = ["--", "----", "OL", "-OL", "#N/A", "#NV", "NaN", "nan", "9.9E37", "-9.9E+37", "9.91E37", "1.#QNAN", "-1.#IND", "***",
         "Over", "<-20", "> 150", "n/a", "NULL", "#VALUE!", "", "inf", "Error", "?"]  # fmt: skip


@pytest.mark.parametrize("mark", MARKS)
def test_marks_of_no_value_are_missing(load, mark):
    rows = [row.split(";") for row in lines_of(separator=";")]
    for y, x in ((0, 0), (7, 9), (13, 19), (7, 10)):
        rows[y][x] = mark
    frames = load(join(*(";".join(row) for row in rows)))
    assert is_scene(frames)
    assert frames.outside == np.isnan(frames.temperature).sum() == 4


def test_the_numbers_of_an_open_channel_are_missing():
    """SCPI-1999: 9.9E37 is infinity, 9.91E37 not a number."""
    values = parse_cells([["9.9E37", "-9.9E+37", "9.91E37", "9.8E37", "25.0", "x"]], ";", False)[0]
    assert np.isnan(values).tolist() == [True, True, True, False, False, False]
    assert np.isinf(values[5])


def test_a_row_without_most_of_its_values_stays_where_it_is(load):
    rows = [row.split(";") for row in lines_of(separator=";")]
    for y in (0, 5, 13):
        rows[y][:18] = [""] * 18
    frames = load(join(*(";".join(row) for row in rows)))
    assert is_scene(frames)
    assert frames.outside == 3 * 18


FRAME = [np.round(SENSOR + k, 2) for k in range(3)]


@pytest.mark.parametrize(
    "between", [["", "Frame {}"], ["Image {}; 2024-05-31 12:00:0{}.5"], ["# frame {}", ""], ["", ""]]
)
def test_several_images_in_one_file(load, between):
    lines = [line for k, T in enumerate(FRAME) for line in (*(b.format(k, k) for b in between), *lines_of(T, ";"))]
    frames = load(join("Unit: °C", *lines))
    np.testing.assert_allclose(frames.temperature, np.stack(FRAME), rtol=0.0, atol=0.006)
    assert any("3 images in the file" in note for note in frames.notes)
    if "2024" in between[0]:
        assert np.diff(frames.clock) == pytest.approx([1.0, 1.0])
    refusal(load, join("Unit: °C", *lines[:-20]), "image 3 has 40 rows, others 60|--rows")


def test_blocks_that_could_be_one_image_or_several_are_asked_for(load):
    rows = lines_of(separator=";")
    data = join(*rows[:7], "", *rows[7:])
    refusal(load, data, "line 8: an empty line splits the rows .* --rows 14 for one, --rows 7 for several")
    assert load(data, rows=14).temperature.shape == (1, 14, 20)
    assert load(data, rows=7).temperature.shape == (2, 7, 20)


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([*BODY[:30], ";".join(BODY[30].split(";")[:50]), *BODY[31:]], "line 31 has 50 values .*others 80"),
        ([*BODY[:30], BODY[30].replace(";", ";abc;", 1).rpartition(";")[0], *BODY[31:]], "line 31: 'abc' in column 2"),
        (BODY[:45], "45 rows of 80 values"),
        (["Rows: 60", *BODY[:45]], "45 rows of 80 values, its header says 60"),
    ],
)
def test_damage_names_its_place(load, lines, says):
    refusal(load, join(*lines), says)


# --- order of files ------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "names",
    [
        ["a.csv", "a (1).csv", "a (2).csv", "a (10).csv", "b.csv"],
        ["IMG_1.jpg", "IMG_2.jpg", "IMG_10.jpg", "IMG_10 - Copy.jpg", "IMG_10 - Copy (2).jpg", "IMG_11.jpg"],
        ["IMG_20231115_170431.csv", "IMG_20231115_170431(1).csv", "IMG_20231115_170432.csv"],
        ["Bild.csv", "Bild - Kopie.csv", "Bild - Kopie (2).csv"],
        ["shot.csv", "shot copy.csv", "shot copy 2.csv", "shot copy 10.csv"],
        ["x.csv", "x (copy).csv", "x (another copy).csv", "x (3rd copy).csv"],
        ["r.csv", "r_1.csv", "r_2.csv", "r_10.csv"],
        ["T (1).csv", "T (2).csv", "T (11).csv"],
        ["cam 2023-11-15 17-04-31.csv", "cam 2023-11-15 17-04-31 (1).csv", "cam 2023-11-15 17-04-32.csv"],
        ["FLIR0099.jpg", "FLIR0100.jpg", "FLIR0100 (1).jpg", "FLIR1000.jpg"],
    ],
    ids=lambda names: names[1],
)
def test_a_copy_comes_after_what_it_is_a_copy_of(names, tmp_path):
    for name in names:
        (tmp_path / name).touch()
    shuffled = [str(tmp_path / name) for name in sorted(names)]
    for asked in (shuffled, shuffled[::-1], [str(tmp_path)], [str(tmp_path / "*.*")]):
        assert [path.name for path in expand_patterns(asked)] == names


def test_an_order_that_names_do_not_tell_is_noted():
    assert describe_order([Path("IMG_1.csv"), Path("IMG_2.csv"), Path("IMG_10.csv")]) == []
    [note] = describe_order([Path("b/a.csv"), Path("a/a.csv")])
    assert "b/a.csv, a/a.csv" in note
    assert "different folders" in note
    assert "numbered alike" in describe_order([Path("a (1).csv"), Path("a - Copy.csv")])[0]
    assert "different patterns" in describe_order([Path("left_1.csv"), Path("right_1.csv")])[0]
    assert "after the file" in describe_order([Path("a.csv"), Path("a (1).csv")])[0]


def test_frames_follow_the_order_of_the_copies(tmp_path):
    names = ["s_31 (1).csv", "s_31.csv", "s_32.csv"]
    for name, k in zip(names, (1, 0, 2), strict=True):
        (tmp_path / name).write_bytes(join(*lines_of(FRAME[k], ";")))
    facts = ImportOptions(
        view="sidewall", downstream="right", pixel=(0.0, 59.0), mm_per_pixel=0.5, start=0.0, repetition=1, fps=1.0
    )
    result = recording_import.import_recording(expand_patterns([str(tmp_path / name) for name in names]), facts)
    assert np.diff(result.recording.temperature.mean(axis=(1, 2))) == pytest.approx([1.0, 1.0], abs=1e-3)
    assert any(note.startswith("order of the files: s_31.csv, s_31 (1).csv, s_32.csv") for note in result.notes)


# --- line scans -----------------------------------------------------------------------------------------------
STEP = 0.5e-6
HEIGHTS = 1e-6 * np.cumsum(np.random.default_rng(4).standard_normal(400)) / 20


def columns_of(x_factor, z_factor, separator=",", end="", digits=4, more="") -> list[str]:
    rows = (f"{x_factor * STEP * k:.6f}{separator}{z_factor * z:.{digits}f}{more}{end}" for k, z in enumerate(HEIGHTS))
    return list(rows)


SCANS = {
    "Dektak": ["Scan Parameters", "Scan Type,Standard Scan", "Length,200.0 um", "Scan Data", "Lateral(um),Total Profile(Å)", *columns_of(1e6, 1e10)],
    "Dektak, blank line": ["Scan Parameters", "Length,200.0 um", "Scan Data", "", "Lateral um,Raw Micrometer,", *columns_of(1e6, 1e6, end=",", digits=7)],
    "Taylor Hobson": ["Talysurf", "X [mm]; Z [um]", *columns_of(1e3, 1e6, ";", digits=7)],
    "decimal commas": ["X [mm]; Z [µm]", *(row.replace(".", ",") for row in columns_of(1e3, 1e6, ";", digits=7))],
    "Ambios": ["Sample A", "X(um)\tZ(A)", *columns_of(1e6, 1e10, "\t")],
    "KLA": ["Scan length: 200 um", "Position (µm),Height (nm)", *columns_of(1e6, 1e9)],
    "units below": ["x,z", "mm,nm", *columns_of(1e3, 1e9)],
    "HFM": ["X;Y;valid", "[mm];[mm];[1/0]", *columns_of(1e3, 1e3, ";", digits=9, more=";1")],
    "XYZ of one line": ["X (mm),Y (mm),Z (um)", *(row.replace(",", ",3.5,", 1) for row in columns_of(1e3, 1e6, digits=7))],
    "units of axes": ["Form", "X Units: mm, Z Units: um", "X,Z", *columns_of(1e3, 1e6, digits=7)],
    "inches": ["Distance (in),Height (uin)", *(f"{STEP * k / 0.0254:.9f},{z / 2.54e-8:.5f}" for k, z in enumerate(HEIGHTS))],
}  # fmt: skip


@pytest.mark.parametrize("kind", SCANS)
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-8-sig"])
def test_a_line_scan_with_units_needs_no_profile(tmp_path, kind, encoding):
    file = tmp_path / "scan.csv"
    file.write_bytes(("\n".join(SCANS[kind]) + "\n").encode(encoding))
    scan = measured_roughness.read_line_scan(file)
    assert scan.step == pytest.approx(STEP, rel=1e-3)
    assert scan.heights == pytest.approx(HEIGHTS, abs=1e-12)
    assert len(scan.notes) == 1
    heights, step, _ = road_surface._read_heights(file, False, None)
    assert (heights.ndim, step) == (1, pytest.approx(STEP, rel=1e-3))


def test_invalid_points_are_dropouts_and_y_beside_z_is_no_height(tmp_path):
    rows = [row[:-1] + "0" if k == 7 else row for k, row in enumerate(SCANS["HFM"])]
    (tmp_path / "scan.csv").write_text("\n".join(rows))
    assert np.flatnonzero(np.isnan(measured_roughness.read_line_scan(tmp_path / "scan.csv").heights)).tolist() == [5]
    area = ["X (mm),Y (mm),Z (um)", *(f"{k % 20},{k // 20},{z:.9f}" for k, z in enumerate(1e6 * HEIGHTS))]
    (tmp_path / "scan.csv").write_text("\n".join(area))
    with pytest.raises(BadInput, match="y varies, an area"):
        measured_roughness.read_line_scan(tmp_path / "scan.csv")


def test_a_scan_without_units_is_asked_for(tmp_path):
    file = tmp_path / "scan.csv"
    rows = [f"{1e-3 * k:.4f},{1e3 * z:.7f}" for k, z in enumerate(HEIGHTS)]
    file.write_text("x,z\n" + "\n".join(rows) + "\n")
    with pytest.raises(BadInput, match="--profile"):
        road_surface.read_road_spectrum(file)
    notes = road_surface.read_road_spectrum(file, profile=True).notes
    assert [note.partition(": unit of ")[2] for note in notes] == [f"{c!r} not in the file, taken as m" for c in "xz"]


def test_a_unit_of_one_column_alone_is_refused(tmp_path):
    (tmp_path / "scan.csv").write_text("X (um),Z\n" + "\n".join(columns_of(1e6, 1e6)))
    with pytest.raises(BadInput, match="no unit of 'Z', while the other column has one"):
        measured_roughness.read_line_scan(tmp_path / "scan.csv")


def test_a_scan_that_only_the_library_reads(tmp_path):
    from SurfaceTopography import UniformLineScan

    UniformLineScan(1e6 * HEIGHTS, 1e6 * STEP * len(HEIGHTS), unit="um").to_netcdf(tmp_path / "scan.nc")
    scan = measured_roughness.read_line_scan(tmp_path / "scan.nc")
    assert scan.step == pytest.approx(STEP, rel=1e-6)
    assert scan.heights == pytest.approx(HEIGHTS, rel=1e-6)
