"""Camera files of every kind: small ones written here, the makers' own where the data folder is, damaged ones."""

from __future__ import annotations

import io
import os
import struct
from pathlib import Path

import h5py
import imagecodecs
import numpy as np
import pytest
import scipy.io
import tifffile

from flashtemp.camera.importing import formats
from flashtemp.camera.importing.formats import fast_text
from flashtemp.camera.importing.formats.cell_parsing import count_numeric, parse_cells
from flashtemp.camera.importing.formats.text_layout import read_layout
from flashtemp.camera.importing.readers import read_frames
from flashtemp.camera.radiometry import ObjectParameters, PlanckCalibration, apparent_counts
from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput

PLANCK = PlanckCalibration(14985.93, 0.0112832, 1398.1, 1.0, -6233.0)
SEEN = ObjectParameters(emissivity=0.95, reflected=22.0, air=21.0, humidity=0.4, distance=1.5)
ROWS, COLUMNS = 12, 16
SCENE = 30.0 + 40.0 * np.exp(-(((np.arange(COLUMNS) - 9) / 5) ** 2) - (((np.arange(ROWS)[:, None] - 4) / 4) ** 2))
COUNTS = np.round(apparent_counts(SCENE, PLANCK, SEEN)).astype(np.uint16)
CLOCK = 1_700_000_000


def info_record(order="<", seen=SEEN, clock=CLOCK, thousandths=250, zone=-60, **change) -> bytes:
    """The calibration record: 2476 bytes with numbers where FLIR keeps them."""
    record = bytearray(2476)
    numbers = {
        0x20: seen.emissivity, 0x24: seen.distance, 0x28: seen.reflected + 273.15, 0x2C: seen.air + 273.15,
        0x30: 293.15, 0x34: seen.window, 0x3C: seen.humidity, 0x58: PLANCK.R1, 0x5C: PLANCK.B, 0x60: PLANCK.F,
        0x70: 0.006569, 0x74: 0.01262, 0x78: -0.002276, 0x7C: -0.00667, 0x80: 1.9, 0x98: 423.15, 0x9C: 233.15,
        0x30C: PLANCK.R2,
    } | change.get("numbers", {})  # fmt: skip
    struct.pack_into(order + "3H", record, 0, 2, COLUMNS, ROWS)
    for at, value in numbers.items():
        struct.pack_into(order + "f", record, at, value)
    struct.pack_into(order + "i", record, 0x308, int(PLANCK.O))
    record[0xD4:0xDC] = b"TestCam1"
    struct.pack_into(order + "2Ih", record, 0x384, clock, thousandths, zone)
    struct.pack_into(order + "H", record, 0x464, 30)
    return bytes(record)


def raw_record(counts=COUNTS, order="<", kind="plain") -> bytes:
    head = struct.pack(order + "3H", 2, counts.shape[1], counts.shape[0]).ljust(32, b"\0")
    if kind == "plain":
        return head + counts.astype(order + "u2").tobytes()
    if kind == "swapped png":
        return head + imagecodecs.png_encode(counts.byteswap())
    return head + (imagecodecs.png_encode if kind == "png" else imagecodecs.jpegls_encode)(counts)


def fff(counts=COUNTS, order="<", raw_order="<", kind="plain", records=None, **about) -> bytes:
    """One block: header, directory, records."""
    records = records or {0x01: raw_record(counts, raw_order, kind), 0x20: info_record(raw_order, **about)}
    at, directory, body = 64 + 32 * (len(records) + 1), b"", b""
    for kind_number, record in records.items():
        directory += struct.pack(order + "2H4I", kind_number, 2, 100, 1, at + len(body), len(record)).ljust(32, b"\0")
        body += record
    head = b"FFF\0" + b"Test".ljust(16, b"\0") + struct.pack(order + "3I", 100, 64, len(records) + 1)
    return head.ljust(64, b"\0") + directory + b"\0" * 32 + body


def jpeg(block: bytes, piece=700, leave_out=None) -> bytes:
    pieces = [block[k : k + piece] for k in range(0, len(block), piece)]
    out = b"\xff\xd8\xff\xe0\x00\x04ab"
    for number, part in enumerate(pieces):
        if number != leave_out:
            out += (
                b"\xff\xe1" + struct.pack(">H", len(part) + 10) + b"FLIR\0\1" + bytes([number, len(pieces) - 1]) + part
            )
    return out + b"\xff\xda\x00\x02\xff\xd9"


def irb(T=SCENE, compressed=0, depth=2, images=1) -> bytes:
    palette = np.linspace(250.0, 400.0, 256).astype("<f4")
    place = (T + 273.15 - 250.0) / (150.0 / 255)
    index = np.floor(place).astype(int)
    pixels = np.stack([np.floor(256 * (place - index)), index], axis=-1).astype(np.uint8).tobytes()
    image = bytearray(1728)
    struct.pack_into("<4H", image, 0, depth, compressed, T.shape[1], T.shape[0])
    struct.pack_into("<3f", image, 24, 0.95, 0.8, 298.15)
    image[60:1084] = palette.tobytes()
    struct.pack_into("<dI", image, 1624, 25569 + 19000.5, 250)
    block = bytes(image) + pixels
    head = (b"\xffIRB\0" + b"TESTCAM".ljust(8, b"\0")).ljust(21, b"\0") + struct.pack("<3I", 100, 64, images + 1)
    entries = b"".join(
        struct.pack("<5I", 1, 101, k, 64 + 32 * (images + 1) + k * len(block), len(block)).ljust(32, b"\0")
        for k in range(images)
    )
    return head.ljust(64, b"\0") + entries + b"\0" * 32 + block * images


def text(T=SCENE, separator="\t", decimal=".", header="", end="\n", digits=3, encoding="utf-8") -> bytes:
    lines = [separator.join(f"{x:.{digits}f}".replace(".", decimal) for x in row) for row in T]
    return (header + end.join(lines) + end).encode(encoding)


def irbis(T=SCENE, unit="C", decimal=".", rows=ROWS, content="Temperature") -> bytes:
    head = f"[Settings]\nVersion=3\nDelimiterValue=0x3B\nCommaValue={ord(decimal):#x}\nParams.Rec.Date=2021-10-12\n"
    head += f"Params.Rec.Time=13:48:49.893\nShotRange=290,000;310,000\nContent={content}\nTempUnit={unit}\n"
    return text(T, ";", decimal, head + f"ImageWidth={COLUMNS}\nImageHeight={rows}\n\n[Data]\n")


def tiff(values, **options) -> bytes:
    out = io.BytesIO()
    tifffile.imwrite(out, values, **options)
    return out.getvalue()


def hdf5(arrays, user_block=0, **attributes) -> bytes:
    out = io.BytesIO()
    with h5py.File(out, "w", userblock_size=user_block) as file:
        for name, values in arrays.items():
            file[name] = values
        for name, unit in attributes.items():
            file[name].attrs["units"] = unit
    if user_block:
        out.seek(0)
        out.write(b"MATLAB 7.3 MAT-file")
    return out.getvalue()


def matlab(compress=False, **arrays) -> bytes:
    out = io.BytesIO()
    scipy.io.savemat(out, arrays, do_compression=compress)
    return out.getvalue()


@pytest.fixture
def given(tmp_path):
    """Bytes -> Frames, through a file whose name says nothing."""

    def given(data: bytes, name="file.bin", **unsaid):
        (tmp_path / name).write_bytes(data)
        return read_frames(tmp_path / name, **unsaid)

    return given


def check_refused(given, data: bytes, says: str, **unsaid) -> str:
    with pytest.raises(BadInput, match=says) as fault:
        given(data, **unsaid)
    [line] = fault.value.lines
    assert "\n" not in line
    assert "file." in line
    return line


STEP = 0.5 * float(np.max(np.diff(SCENE) * 0 + 0.05))  # half a count is less than this, K


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("raw_order", "<>")
@pytest.mark.parametrize("kind", ["plain", "png", "swapped png", "jpeg-ls"])
def test_fff(given, order, raw_order, kind):
    frames = given(fff(order=order, raw_order=raw_order, kind=kind))
    assert np.array_equal(frames.counts[0], COUNTS)
    assert np.abs(frames.temperature[0] - SCENE).max() < STEP
    assert frames.parameters.emissivity == 0.95
    assert frames.stated_parameters["reflected"] == 22.0
    assert frames.camera == "TestCam1"
    assert frames.clock[0] == CLOCK + 3600.25
    assert frames.fps == 30


def test_jpeg_in_pieces(given):
    frames = given(jpeg(fff()))
    assert frames.format == "FLIR radiometric JPEG"
    assert np.array_equal(frames.counts[0], COUNTS)
    check_refused(given, jpeg(fff(), leave_out=1), "piece 2 of")
    check_refused(given, jpeg(b""), "without thermal data.*give")


@pytest.mark.parametrize("kind", ["plain", "jpeg-ls"])
def test_sequence(given, kind):
    """Frames one after another, gaps and a false mark inside the counts; each has its own parameters."""
    false = COUNTS.copy()
    false[5, 4:6] = np.frombuffer(b"FFF\0", "<u2")
    other = SEEN.with_values({"emissivity": 0.9})
    frames = given(fff(kind=kind) + b"\0" * 40 + fff(false, kind=kind, thousandths=500, seen=other))
    assert frames.format == "FLIR sequence"
    assert frames.temperature.shape == (2, ROWS, COLUMNS)
    assert np.diff(frames.clock) == pytest.approx(0.25)
    assert "parameters change" in frames.notes[0]
    assert frames.temperature[1, 4, 9] > frames.temperature[0, 4, 9] + 1
    assert frames.take_every(2).temperature.shape[0] == 1


def test_given_parameters_go_before_the_files(given):
    """An emissivity that nobody can use is replaced; window, air and calibration too."""
    broken = fff(numbers={0x20: float("nan")})
    check_refused(given, broken, "emissivity: nan; give")
    assert np.abs(given(broken, parameters={"emissivity": 0.95}).temperature[0] - SCENE).max() < STEP
    hot = SEEN.with_values({"emissivity": 0.8, "window": 0.7, "window_temperature": 50.0, "air": 35.0})
    counts = np.round(apparent_counts(SCENE, PLANCK, hot)).astype(np.uint16)
    change = {k: getattr(hot, k) for k in ("emissivity", "window", "window_temperature", "air")}
    assert np.abs(given(fff(counts), parameters=change).temperature[0] - SCENE).max() < 2 * STEP
    other = PlanckCalibration(PLANCK.R1, PLANCK.R2, PLANCK.B + 10, PLANCK.F, PLANCK.O)
    assert given(fff(), planck=other).temperature[0, 4, 9] > SCENE[4, 9] + 1


def test_beyond_the_range(given):
    counts = COUNTS.copy()
    counts[0, :3], counts[1, 0] = 7000, 65535
    frames = given(fff(counts))
    assert frames.outside == 4
    assert np.isnan(frames.temperature[0]).sum() == 4


@pytest.mark.parametrize(
    ("records", "says"),
    [
        ({0x20: info_record()}, "no record of its counts"),
        ({0x01: raw_record()}, "no record of its calibration"),
        ({0x01: raw_record()[:-20], 0x20: info_record()}, "bytes of counts for 16 x 12"),
        ({0x01: raw_record(), 0x20: info_record()[:500]}, "calibration record is missing or damaged"),
        ({0x01: raw_record(), 0x20: info_record(numbers={0x58: 0.0})}, "planck"),
        ({0x01: b"\2\0\0\0\0\0" + raw_record()[6:], 0x20: info_record()}, "image of 0 x 0"),
        ({0x01: raw_record(kind="png")[:90], 0x20: info_record()}, "damaged"),
        ({0x01: raw_record(np.zeros_like(COUNTS)), 0x20: info_record()}, "no pixel holds a temperature"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_damaged_fff(given, records, says):
    check_refused(given, fff(records=records), says)


def test_cut_off_anywhere(given):
    whole = fff() + fff()
    for end in (10, 63, 70, 140, 300, 2000, len(whole) - 600, len(whole) - 20):
        check_refused(given, whole[:end], "cut off|no matrix|no text|no readable|damaged|empty|words")


def test_irb(given):
    frames = given(irb(images=2))
    assert np.abs(frames.temperature - SCENE).max() < 150 / 255 / 256
    assert frames.stated_parameters == {"emissivity": 0.95, "distance": 0.8, "reflected": 25.0}
    assert frames.clock[0] == 19000.5 * 86400 + 0.25
    check_refused(given, irb(compressed=1), "compressed.*ASCII")
    check_refused(given, irb(depth=4), "4 bytes per pixel.*ASCII")
    check_refused(given, irb()[:-9], "cut off")
    check_refused(given, irb()[:80], "cut off or damaged")
    check_refused(given, irb(images=0), "no image.*ASCII")


def hole(value: str) -> bytes:
    return text().replace(f"{SCENE[2, 3]:.3f}".encode(), value.encode(), 1)


@pytest.mark.parametrize(
    "data",
    [
        text(),
        text(encoding="utf-8-sig"),
        text(encoding="utf-16"),
        text(separator=";", decimal=","),
        text(separator="\t", decimal=",", end="\r\n"),
        text(separator=","),
        text(separator=", "),
        text(separator="  "),
        text(separator=" ", decimal=","),
        text(separator=";", end=";\r\n"),
        text(separator=";", decimal=",", header="Datei;Bild 3\nEmissionsgrad;0,95\nEinheit: °C\n\n", encoding="cp1252"),
        text(header="File:\tframe 1\nEmissivity:\t0.95\n\n"),
        text(separator="°C;", header="Testo\n"),
        "\n".join(["\t" + "\t".join(map(str, range(COLUMNS)))] + [f"{k}\t" + "\t".join(f"{x:.3f}" for x in row) for k, row in enumerate(SCENE)]).encode(),
        "\n".join(f"row {k};" + ";".join(f"{x:.3f}" for x in row) for k, row in enumerate(SCENE)).encode(),
        text(SCENE + 273.15, header="Temperature unit: K\n"),
        text(1.8 * SCENE + 32, header="Unit: °F\n"),
    ],
    ids=str,
)  # fmt: skip
def test_text_matrices(given, data):
    frames = given(data)
    assert frames.shape == SCENE.shape
    assert np.abs(frames.temperature[0] - SCENE).max() < 1e-3
    assert frames.outside == 0


def test_text_says_its_parameters(given):
    head = "Date: 2024-05-31 12:00:03.25\nEmissivity; 0,93\nReflected temperature; 18,5 °C\nHumidity; 45 %\n"
    frames = given(text(separator=";", decimal=",", header=head))
    assert frames.stated_parameters == {"emissivity": 0.93, "reflected": 18.5, "humidity": 0.45}
    assert frames.clock[0] == pytest.approx(1717156803.25)
    assert "decimal commas" in frames.notes[0]


@pytest.mark.parametrize(
    "cell",
    ["1.", ".5", "+-1", "-", "1e", "e5", "1.2.3", "1e2.5", "1e2e3", "--", "", "1 2", "1;2", "1_0", "nan", "9" * 65],
)
def test_what_is_no_plain_number_is_read_carefully(cell):
    assert fast_text.read_plain_rows("1\t2.5\n3\t4\n")[1].tolist() == [[1.0, 2.5], [3.0, 4.0]]
    for row in (f"{cell}\t4", f"3\t{cell}"):
        assert fast_text.read_plain_rows(f"1\t2\n{row}\n5\t6\n") is None


PLAIN = {
    "TAB": {}, "decimal commas": {"separator": ";", "decimal": ","}, "commas": {"separator": ","},
    "line ends": {"end": "\r\n"}, "one space": {"separator": " "}, "exponents": {"separator": "e0\t", "end": "e0\n"},
    "header": {"header": "Emissivity: 0.95\n\n"},
}  # fmt: skip


@pytest.mark.parametrize("kind", PLAIN)
def test_plain_text_is_read_at_once_and_as_carefully(kind):
    """And whatever is done to its letters: what the quick way takes, the careful way reads alike."""
    whole = text(**PLAIN[kind]).decode()
    rng, quick = np.random.default_rng(len(kind)), 0
    for number in range(300):
        said, k = whole, int(rng.integers(0, len(whole) - 1))
        if number:
            odd = str(rng.choice([*' .,;+-e\t\n"1x', "\n\n", "--", "1;1", "\n1;2;3\n"]))
            said = whole[:k] + odd + whole[k + int(rng.integers(0, 2)) :]
        found = fast_text.read_plain_rows(said)
        if found is None:
            assert number, "nothing was unusual"
            continue
        quick += 1
        layout = read_layout(said.splitlines(), None, said[-1] in "\r\n")
        header = [line for number, line in layout.others if line and number < layout.blocks[0].lines[0]]
        assert (header, layout.comma) == (list(filter(None, found[0])), found[3])
        np.testing.assert_array_equal(found[1], parse_cells(layout.rows, layout.separator, layout.comma))
    assert quick > 15, "some letters change a number into another"


@pytest.mark.parametrize("mark", ["--", "---", "-40.01", "<-20", ">150", "nan", "underflow", ""])
def test_marks_below_the_range(given, mark):
    frames = given(hole(mark))
    assert frames.outside == 1
    assert np.isnan(frames.temperature[0, 2, 3])
    assert np.nanmax(np.abs(frames.temperature[0] - SCENE)) < 1e-3


@pytest.mark.parametrize(
    ("row", "count"),
    [
        (["12", "-3.5", "+4,25", "1e-3", "2.5E+06"], 5),
        (["12 °C", "12C", "80 ° F", "300 K"], 4),
        (["--", "---", "<-20", "> 150", "**", "NaN", "n/a", "Underflow", "over range"], 9),
        (["", " ", "x", "12 mm", "1.2.3", "2024-05-31", "-", "°C"], 1),
        (["1" * 64, "1" * 65, "<" * 65], 1),
        (["row 1", "20.5", "", "--"], 2),
        ([], 0),
    ],
    ids=["numbers", "units", "marks", "words", "too long", "a row with its label", "nothing"],
)
def test_what_counts_as_a_number(row, count):
    assert count_numeric(row) == count


def test_a_threshold_for_below_the_range(given):
    assert given(text(), below=40.0).outside == (SCENE.round(3) <= 40.0).sum()


def test_text_that_cannot_be_read(given):
    check_refused(given, text(digits=1, separator=",", decimal=","), "decimal commas.*--decimal")
    assert given(text(digits=0, separator=","), decimal="point").shape == SCENE.shape
    check_refused(given, text(SCENE + 273.15), "--unit")
    assert given(text(SCENE + 273.15), unit="K").temperature[0] == pytest.approx(SCENE, abs=1e-3)
    check_refused(given, text()[:-30], "line 12 has .* values")
    check_refused(given, hole("broken"), "words")
    check_refused(given, b"nothing here\n", "no matrix")
    check_refused(given, text(SCENE * np.nan), "no pixel")
    check_refused(given, b"", "empty")


def test_irbis_ascii(given):
    frames = given(irbis())
    assert frames.format == "IRBIS ASCII"
    assert np.abs(frames.temperature[0] - SCENE).max() < 1e-3
    assert frames.clock[0] == pytest.approx(1634046529.893)
    assert np.abs(given(irbis(1e3 * (SCENE + 273.15), "mK", ",")).temperature[0] - SCENE).max() < 1e-3
    assert np.abs(given(irbis(SCENE + 273.15, "K")).temperature[0] - SCENE).max() < 1e-3
    amplitude = given(irbis(SCENE, "mK", content="Amplitude"))
    assert amplitude.difference
    assert amplitude.temperature[0] == pytest.approx(1e-3 * SCENE, abs=1e-6)
    check_refused(given, irbis(rows=ROWS + 1), "12 rows of 16 to 16.*cut off")
    check_refused(given, irbis()[:60], "without .Data.")


def test_tiff(given):
    counts = np.round((SCENE + 273.15) / 0.04).astype(np.uint16)
    for options in ({}, {"compression": "lzw"}, {"byteorder": ">"}):
        frames = given(
            tiff(np.stack([counts, counts]), photometric="minisblack", **options), scale=0.04, offset=-273.15
        )
        assert frames.temperature.shape == (2, ROWS, COLUMNS)
        assert np.abs(frames.temperature - SCENE).max() <= 0.0201
    line = check_refused(given, tiff(counts), "--scale and --offset")
    assert "7576 to" in line or str(counts.min()) in line
    check_refused(given, tiff(counts), "give --offset", scale=0.04)
    check_refused(given, tiff(counts), "scale: 0.4 and offset", scale=0.4, offset=-273.15)
    assert given(tiff(SCENE.astype(np.float32))).temperature[0] == pytest.approx(SCENE, abs=1e-4)
    check_refused(given, tiff(counts.astype(np.uint8)), "colours")
    check_refused(given, tiff(np.zeros((8, 8, 3), np.uint8), photometric="rgb"), "colours")
    png = imagecodecs.png_encode(counts)
    assert np.abs(given(png, scale=0.04, offset=-273.15).temperature[0] - SCENE).max() <= 0.0201
    check_refused(given, png, "--scale")


def test_arrays(given):
    stack = np.stack([SCENE, SCENE + 1])
    last = np.moveaxis(stack, 0, -1)
    for data in (
        matlab(T=last),
        matlab(compress=True, T=last, words="text", z=1j),
        matlab(Frame0=SCENE, Frame1=SCENE + 1, note=3.0),
        hdf5({"T": stack.transpose(0, 2, 1)}, user_block=512),
        hdf5({"a/T": stack, "time": np.array([0.5, 1.0])}),
        hdf5({"temperature": stack + 273.15, "raw": stack}, temperature="K"),
    ):
        frames = given(data)
        assert frames.temperature == pytest.approx(stack, abs=1e-9)
    assert given(hdf5({"a/T": stack, "time": np.array([0.5, 1.0])})).time.tolist() == [0.5, 1.0]
    two = hdf5({"a": stack, "b": stack})
    check_refused(given, two, "'a'.*'b'.*--variable")
    assert given(two, variable="b").temperature == pytest.approx(stack)
    check_refused(given, two, "known are a, b", variable="c")
    check_refused(given, matlab(x=3.0), "no array.*--variable")
    check_refused(given, hdf5({"a": (stack * 100).astype(np.uint16)}), "--scale")
    assert given(hdf5({"a": (stack * 100).astype(np.uint16)}), scale=0.01, offset=0.0).temperature == pytest.approx(
        stack, abs=0.011
    )


def test_own_recordings_and_classic_netcdf(given, tmp_path):
    T = np.stack([SCENE, SCENE + 1])
    made = Recording(
        "sidewall",
        T,
        np.array([0.0, 1.0]),
        np.array([1, 1]),
        1e-3 * np.arange(COLUMNS),
        1e-3 * np.arange(ROWS),
        emissivity=0.9,
    )
    made.save(tmp_path / "r.nc")
    frames = read_frames(tmp_path / "r.nc")
    assert (frames.view, frames.stated_parameters) == ("sidewall", {"emissivity": 0.9})
    assert frames.temperature == pytest.approx(T)
    assert frames.u == pytest.approx(made.u)
    out = tmp_path / "classic.nc"
    with scipy.io.netcdf_file(out, "w") as file:
        for name, size in zip("frc", T.shape, strict=True):
            file.createDimension(name, size)
        file.createVariable("T", "f8", tuple("frc"))[:] = T + 273.15
        file.variables["T"].units = "K"
    assert read_frames(out).temperature == pytest.approx(T)


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [
        ("file.ats", b"\1\2\3\4" * 9, "ATS.*closed kit.*TIFF"),
        ("file.ptw", b"CEDIP" + b"\0" * 40, "PTW.*export"),
        ("file.sfmov", b"\1\2\3\4" * 9, "SFMOV.*export"),
        ("file.ravi", b"RIFF1234AVI ", "RAVI.*CSV"),
        ("file.is2", b"PK\3\4", "IS2.*SmartView"),
        ("file.bmt", b"BM12345678", "BMT.*IRSoft"),
        ("file.xlsx", b"PK\3\4", "ZIP.*CSV"),
        ("file.mp4", b"\0\0\0\x18ftypmp42", "MP4.*colours"),
        ("file.avi", b"RIFF1234AVI ", "AVI.*colours"),
        ("file.bmp", b"BM12345678", "bitmap.*colours"),
        ("file.png", imagecodecs.png_encode(np.zeros((4, 4), np.uint8)), "PNG of 8 bits.*colours"),
        ("file.jpg", b"\xff\xd8\xff\xe0\0\4ab\xff\xda\0\2\xff\xd9", "JPEG without thermal.*colours"),
    ],
)
def test_formats_that_are_refused_say_what_to_export(given, name, data, says):
    with pytest.raises(BadInput, match=says) as fault:
        given(data, name)
    assert "give" in str(fault.value)
    assert len(fault.value.lines) == 1


NEW_FORMAT = """
import numpy as np
from flashtemp.camera.importing.formats.raw_frames import RawFrames

MAGIC = (b"NEWCAM",)

def read(file):
    T = np.frombuffer(file.read_all()[6:], "<f4").reshape(-1, 4, 5)
    yield RawFrames("new camera", T, time=np.arange(len(T)) / 10.0).take_every(file.options.every)
"""


def test_a_new_format_is_one_new_module(given, tmp_path, monkeypatch):
    """The module is found on the path of the package, recognised by its first bytes, and gets the reader's options."""
    data = b"NEWCAM" + np.linspace(20.0, 30.0, 60).astype("<f4").tobytes()
    with pytest.raises(BadInput, match="no text"):
        given(data)
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "new_camera.py").write_text(NEW_FORMAT)
    monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(tmp_path / "more")])
    frames = given(data, every=2)
    assert frames.format == "new camera"
    assert frames.temperature[1, 3, 4] == pytest.approx(30.0)
    assert frames.time == pytest.approx([0.0, 0.2])
    with pytest.raises(BadInput, match="read at once"):
        given(data, limit=1e-9)
    assert given(fff()).format == "FLIR FFF"


KINDS = {
    "fff": fff(), "png": fff(kind="png"), "csq": fff(kind="jpeg-ls") * 2, "jpeg": jpeg(fff()), "irb": irb(),
    "text": text(separator=";", decimal=","), "irbis": irbis(), "tiff": tiff(SCENE.astype(np.float32)),
    "lzw": tiff(SCENE.astype(np.float32), compression="lzw"), "mat": matlab(T=SCENE), "packed mat": matlab(compress=True, T=SCENE), "hdf5": hdf5({"T": SCENE}),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_damage_is_told_in_one_line(given, kind):
    """Truncated and corrupted at random (seeded): frames or one line, never a traceback."""
    chance, whole, told = np.random.default_rng(7), KINDS[kind], []
    for k in range(80):
        data = bytearray(whole)
        if k % 3 == 0:
            data = data[: chance.integers(1, len(data))]
        else:
            reach = min(len(data), 300) if k % 3 == 1 else len(data)
            for at in chance.integers(0, reach, chance.integers(1, 12)):
                data[at] = chance.integers(256)
        try:
            frames = given(bytes(data))
            assert np.isfinite(frames.temperature).any()
        except BadInput as fault:
            told.append(fault.lines)
    assert len(told) > 5
    for lines in told:
        assert len(lines) == 1
        assert "\n" not in lines[0]
        assert "file.bin" in lines[0]


DATA = Path(os.environ.get("FLASHTEMP_DATA", Path(__file__).parents[3] / "shared" / "data"))

if (DATA / "flir_jpeg_vs_flirtools").is_dir():
    IMAGES = sorted((DATA / "flir_jpeg_vs_flirtools").glob("*.jpg"))

    @pytest.mark.parametrize("image", IMAGES, ids=lambda p: p.stem)
    def test_makers_own_matrices(image):
        """Every image within 0.001 K of FLIR Tools (3 decimals); the same pixels are below the range."""
        ours, makers = read_frames(image).temperature, read_frames(image.with_suffix(".flirtools.csv")).temperature
        assert np.array_equal(np.isnan(ours), np.isnan(makers))
        worst = np.nanmax(np.abs(ours - makers))
        print(f"{image.stem}: {worst:.6f} K, {np.isnan(makers).sum()} below range")
        assert worst < 0.001

    @pytest.mark.parametrize(
        ("name", "unsaid", "shape", "low", "high"),
        [
            ("flir_seq_csq/IR_2412.jpg", {}, (1, 480, 640), 22.7, 35.3),
            ("flir_seq_csq/SampleSEQ.seq", {}, (2, 480, 640), 18.6, 38.2),
            ("flir_seq_csq/SampleCSQ.csq", {}, (8, 768, 1024), 15.7, 35.4),
            ("flir_tiff_fff/frame_000000.fff", {}, (1, 512, 640), 9.7, 12.7),
            ("flir_tiff_fff/frame_000000_le.fff", {}, (1, 240, 320), 22.9, 29.5),
            ("flir_tiff_fff/example_radiometric.tiff", {"scale": 0.04, "offset": -273.15}, (1, 512, 640), -3.4, 9.9),
            ("infratec_irb/AA011502.irb", {}, (1, 480, 640), 22.2, 46.2),
            (
                "infratec_irbis_ascii/QF01_FreqSweep_reverse_Results_0008_Period0001_Amp.txt",
                {},
                (1, 164, 1280),
                0.0,
                0.23,
            ),
        ],
    )
    def test_sample_files(name, unsaid, shape, low, high):
        frames = read_frames(DATA / name, **unsaid)
        assert frames.temperature.shape == shape
        assert (frames.temperature.min(), frames.temperature.max()) == pytest.approx((low, high), abs=0.1)

    def test_clock_of_a_sample():
        """ExifTool says 2018:11:05 12:14:43.084+01:00."""
        assert read_frames(DATA / "flir_tiff_fff/frame_000000.fff").clock[0] == pytest.approx(1541420083.084, abs=1e-3)
