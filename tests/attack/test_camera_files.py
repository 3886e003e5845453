"""Camera files damaged by the thousand, endless, empty inside or of another kind: the right image, or one line.

Long: `long_files.py`, of which `make attack` prints what became of the damaged files of every container.
"""

from __future__ import annotations

import importlib.util
import os
import struct
import subprocess
import sys
import time
import zlib
from collections import Counter
from pathlib import Path

import h5py
import imagecodecs
import numpy as np
import pytest
import scipy.io
import tifffile

from flashtemp.camera.importing import recording_import
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.readers import iter_frames, read_frames
from flashtemp.errors import BadInput

ROOT = Path(__file__).parents[2]
_spec = importlib.util.spec_from_file_location("files_by_hand", ROOT / "tests" / "camera" / "test_formats.py")
make = importlib.util.module_from_spec(_spec)  # writes small files of every kind
_spec.loader.exec_module(make)

SEED = 18
QUICK = 15  # damaged files of every container and kind of damage
SCENE = make.SCENE + 0.05 * np.random.default_rng(1).standard_normal(make.SCENE.shape)
WIDE = np.round(20.0 + 5.0 * np.random.default_rng(5).random((60, 80)), 3)  # of a sensor that exists
COUNTS = np.round((SCENE + 273.15) / 0.01).astype(np.uint16)
LINEAR = {"scale": 0.01, "offset": -273.15}


def summed(block: bytes) -> bytes:
    """An FFF block with the checksums that cameras write into its directory."""
    data = bytearray(block)
    start, entries = struct.unpack_from("<2I", data, 0x18)
    for k in range(entries):
        kind, offset, length = struct.unpack_from("<H10x2I", data, start + 32 * k)
        if kind:
            struct.pack_into("<I", data, start + 32 * k + 28, zlib.crc32(data[offset : offset + length]))
    return bytes(data)


def recorded() -> bytes:
    """A recording of our own."""
    import tempfile

    from flashtemp.camera.recording import Recording

    T = np.stack([SCENE, SCENE + 1])
    u, v = 1e-3 * np.arange(SCENE.shape[1]), 1e-3 * np.arange(SCENE.shape[0])
    with tempfile.TemporaryDirectory() as folder:
        Recording("sidewall", T, np.arange(2.0), np.ones(2, int), u, v).save(Path(folder) / "r.nc")
        return (Path(folder) / "r.nc").read_bytes()


CONTAINERS = {  # name: bytes, what its file does not say, usual end of its name
    "FFF": (make.fff(), {}, "fff"),
    "FFF with checksums": (summed(make.fff()), {}, "fff"),
    "SEQ": (make.fff() + make.fff(), {}, "seq"),
    "CSQ": (make.fff(kind="jpeg-ls") + make.fff(kind="jpeg-ls"), {}, "csq"),
    "FLIR JPEG": (make.jpeg(summed(make.fff(kind="png"))), {}, "jpg"),
    "IRB": (make.irb(), {}, "irb"),
    "IRBIS ASCII": (make.irbis(), {}, "asc"),
    "CSV": (make.text(WIDE), {}, "csv"),
    "CSV, commas": (make.text(WIDE, ";", ",", end="\r\n"), {}, "txt"),
    "TIFF": (make.tiff(COUNTS), LINEAR, "tiff"),
    "TIFF, LZW": (make.tiff(COUNTS, compression="lzw"), LINEAR, "tif"),
    "TIFF, float": (make.tiff(SCENE.astype(np.float32)), {}, "tif"),
    "PNG": (imagecodecs.png_encode(COUNTS), LINEAR, "png"),
    "MAT": (make.matlab(T=SCENE), {}, "mat"),
    "MAT, packed": (make.matlab(compress=True, T=SCENE), {}, "mat"),
    "MAT v7.3": (make.hdf5({"T": SCENE}, user_block=512), {}, "mat"),
    "HDF5": (make.hdf5({"T": SCENE}), {}, "h5"),
    "recording": (recorded(), {}, "nc"),
}  # fmt: skip


def damaged(kind: str, whole: bytes, chance: np.random.Generator) -> tuple[bytes, int]:
    """A damaged file and how many of its bytes are other ones: 0 where it is cut off."""
    if kind == "cut":
        return whole[: chance.integers(1, len(whole))], 0
    data, count = bytearray(whole), 1 if kind == "flip" else int(chance.integers(2, 12))
    reach = len(whole) if kind == "flip" or chance.random() < 0.5 else min(len(whole), 400)
    for at in chance.integers(0, reach, count):
        data[at] ^= 1 << int(chance.integers(8))
    return bytes(data), count


def fate(path: Path, wanted: np.ndarray, unsaid: dict, changed: int) -> str:
    """What becomes of a damaged file: told, unharmed, fewer frames, as many wrong pixels as bytes at most, or wrong."""
    try:
        found = read_frames(path, **unsaid).temperature
    except BadInput as fault:
        [line] = fault.lines
        assert path.name in line
        assert "\n" not in line
        assert len(line) < 1000
        return "told"
    assert np.isfinite(found).any()
    assert np.nanmin(found) >= -273.15
    assert np.nanmax(found) <= 3500
    if found.shape != wanted.shape:
        shorter = 0 < len(found) < len(wanted) and found.shape[1:] == wanted.shape[1:]
        return "shorter" if shorter and np.allclose(found, wanted[: len(found)], atol=2e-3, equal_nan=True) else "wrong"
    off = ~((np.abs(found - wanted) < 2e-3) | (np.isnan(found) & np.isnan(wanted)))
    lost = np.isnan(found) & ~np.isnan(wanted)
    if not off.any():
        return "unharmed"
    return "pixel" if (off & ~lost).sum() <= max(1, changed) else "wrong"


def attacked(folder: Path, name: str, kind: str, times: int, seed: int = SEED) -> Counter:
    """Fates of damaged files of one container."""
    whole, unsaid, end = CONTAINERS[name]
    path = folder / f"file.{end}"
    path.write_bytes(whole)
    wanted, found = read_frames(path, **unsaid).temperature, Counter()
    chance = np.random.default_rng([seed, list(CONTAINERS).index(name), len(kind)])
    for _ in range(times):
        data, changed = damaged(kind, whole, chance)
        path.write_bytes(data)
        found[fate(path, wanted, unsaid, changed)] += 1
    return found


# --- damage ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", CONTAINERS)
def test_damage_is_told_or_harmless(tmp_path, name):
    """Quick: cut anywhere is told always; a container with checksums gives no wrong temperature."""
    few = QUICK // 3 if name == "recording" else QUICK
    cut, flipped = (attacked(tmp_path, name, kind, few) for kind in ("cut", "flip"))
    assert cut["wrong"] == 0
    if name in ("FFF with checksums", "PNG"):
        assert flipped["wrong"] == flipped["pixel"] == 0


def test_extensions_say_nothing(tmp_path):
    """Every container under the ends of others: the same image."""
    ends = sorted({end for *_, end in CONTAINERS.values()})
    for number, (name, (whole, unsaid, end)) in enumerate(CONTAINERS.items()):
        (tmp_path / f"right.{end}").write_bytes(whole)
        wanted = read_frames(tmp_path / f"right.{end}", **unsaid).temperature
        for other in ends[number % 3 :: 3]:
            path = tmp_path / f"swapped.{other}"
            path.write_bytes(whole)
            assert np.array_equal(read_frames(path, **unsaid).temperature, wanted, equal_nan=True), (name, other)


# --- point 11: whole images, clipped ends ------------------------------------------------------------------
def sky(mark: float, cold: int = 300, seed: int = 3) -> np.ndarray:
    """An image of 60 x 80 pixels over a cold sky: the `cold` coldest pixels read `mark`."""
    T = np.round(-39.0 + 40.0 * np.random.default_rng(seed).random((60, 80)), 3)
    if cold:
        T.flat[np.argsort(T, axis=None)[:cold]] = mark
    return T


@pytest.mark.parametrize("mark", [-40.01, -40.011, -60.01, -39.999, -41.3])
def test_pixels_below_the_range_are_a_plateau(tmp_path, mark):
    T = sky(mark)
    path = tmp_path / "a.csv"
    path.write_bytes(make.text(T))
    found = read_frames(path)
    assert found.outside == 300
    assert np.array_equal(np.isnan(found.temperature[0]), mark == T)
    assert any("300 pixels at the end of the camera's range" in note for note in found.notes)
    kept = read_frames(path, below=-273.0)
    assert kept.outside == 0
    path.write_bytes(make.text(-T))  # and above it
    assert read_frames(path).outside == 300


def test_real_pixels_stay_whatever_they_read(tmp_path):
    T = sky(0.0, 0)
    T.flat[:9] = -20.01
    T.flat[9] = -40.02 + 1.03
    (tmp_path / "a.csv").write_bytes(make.text(T))
    assert read_frames(tmp_path / "a.csv").outside == 0


@pytest.mark.parametrize("separator", ["\t", ";", ",", " "])
@pytest.mark.parametrize("end", ["\n", "\r\n", "{}\n"])
@pytest.mark.sample("{}*;", "*r*n-,")
def test_a_text_image_cut_anywhere_is_told(tmp_path, separator, end):
    """A sensor's width tells its height: at line ends and inside of rows."""
    end = end.format(separator.strip())
    rows = np.round(20.0 + 5.0 * np.random.default_rng(5).random((60, 80)), 3)
    whole, path = make.text(rows, separator, end=end), tmp_path / "a.csv"
    path.write_bytes(whole)
    assert read_frames(path, decimal="point").outside == 0
    ends = [k + 1 for k, c in enumerate(whole[:-1]) if c == 10]
    last = len(whole) - len(end)
    for at in (*ends[::13], ends[-1], *range(ends[-2] - 2, last - 1, 61), *range(last - 5, last - 1)):
        path.write_bytes(whole[:at])
        with pytest.raises(BadInput, match="cut off|part of an image|values, others|no matrix|table"):
            read_frames(path, decimal="point")


def test_a_part_of_an_image_is_said(tmp_path):
    (tmp_path / "a.csv").write_bytes(make.text(sky(0, 0)[:20]))
    with pytest.raises(BadInput, match=r"20 rows of 80 values.*60 or 80.*--rows 20"):
        read_frames(tmp_path / "a.csv")
    assert read_frames(tmp_path / "a.csv", rows=20).shape == (20, 80)
    (tmp_path / "a.csv").write_bytes(make.text(sky(0, 0)[:20], header="Rows: 20\nColumns: 80\n"))
    assert read_frames(tmp_path / "a.csv").shape == (20, 80)
    (tmp_path / "a.csv").write_bytes(make.text(sky(0, 0)[:20], header="Rows: 60\nColumns: 80\n"))
    with pytest.raises(BadInput, match="20 rows of 80 values, its header says 60 of 80"):
        read_frames(tmp_path / "a.csv")


@pytest.mark.parametrize("to", [b"\n", b"\x0b", b"x", b"1", b".", b" ", b";"])
def test_a_damaged_separator_shifts_no_image(tmp_path, to):
    """In the first rows, in the middle, in the last: told, or the pixels stay where they are."""
    T = sky(0, 0)
    whole, path = make.text(T), tmp_path / "a.csv"
    tabs = [k for k, c in enumerate(whole) if c == 9]
    for at in (tabs[0], tabs[40], tabs[78], tabs[79], tabs[2400], tabs[-1]):
        path.write_bytes(whole[:at] + to + whole[at + 1 :])
        assert fate(path, T[None], {}, 0) in (("told", "unharmed") if to == b" " else ("told",))
    path.write_bytes(whole.replace(b"\n", b"\n\n", 1))
    assert np.array_equal(read_frames(path).temperature[0], T)


# --- point 12: what is no image ------------------------------------------------------------------------------
def table(columns: int, rows: int, header: str = "") -> bytes:
    chance = np.random.default_rng(columns)
    body = [[0.1 * k, *(20 + chance.random(columns - 1))] for k in range(rows)]
    return (header + "\n".join(";".join(f"{v:.3f}" for v in row) for row in body) + "\n").encode()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"\n".join(b"%g,%g,%g" % (10.0**k, 1e6 * 2.0**k, 1e5) for k in range(20)), "table, no image"),
        (b"\n".join(b"\t".join(b"%g" % (10.0 ** (k + j)) for j in range(9)) for k in range(12)), "no temperatures"),
        (table(9, 300), "counts evenly"),
        (table(16, 3000), "table, no image"),
        (table(5, 20), "table, no image"),
    ],
    ids=["DMA", "spectra", "times", "milling", "thermocouples"],
)
def test_tables_are_no_images(tmp_path, data, says):
    (tmp_path / "a.csv").write_bytes(data)
    with pytest.raises(BadInput, match=says):
        read_frames(tmp_path / "a.csv", unit="degC")


@pytest.mark.parametrize(
    ("segments", "says"),
    [
        ([(0xE1, b"Exif\0\0MM\0*DJI M30T"), *[(0xE3, bytes(60_000))] * 8], "DJI R-JPEG.*Thermal"),
        ([(0xE1, b"Exif\0\0MM\0*DJI Mavic"), (0xE1, b"http://ns.adobe.com/xap/1.0/" + b"x" * 20000)], "without thermal"),
        ([(0xE2, b"IJPEG" + bytes(50_000))], "maker's own data.*TIFF or CSV"),
        ([(0xE4, b"HIKMICRO" + bytes(50_000))], "HIKMICRO Analyzer"),
        ([(0xE2, b"ICC_PROFILE\0" + bytes(50_000))], "without thermal"),
    ],
    ids=["DJI", "DJI photo", "IJPEG", "HIKMICRO", "ICC"],
)  # fmt: skip
def test_a_jpeg_says_whose_it_is(tmp_path, segments, says):
    parts = b"".join(b"\xff" + bytes([k]) + struct.pack(">H", len(b) + 2) + b for k, b in segments)
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8" + parts + b"\xff\xda\0\2\xff\xd9")
    with pytest.raises(BadInput, match=says):
        read_frames(tmp_path / "a.jpg")


def test_clipped_sky_is_no_dead_pixel(tmp_path):
    (tmp_path / "a.csv").write_bytes(make.text(sky(-40.011)))
    facts = ImportOptions(
        view="sidewall", downstream="right", pixel=(0.0, 59.0), mm_per_pixel=0.2, start=0.0, repetition=1
    )
    found = recording_import.import_recording([tmp_path / "a.csv"], facts)
    said = " ".join(found.notes)
    assert "300 values beyond the camera's range are left out; they are no dead pixels" in said
    assert "dead pixels found" not in said
    assert "dead" not in str(found.recording)


def test_a_damaged_calibration_is_told(tmp_path):
    """Constants that no camera has, sizes that contradict each other, a checksum that does not fit."""
    path = tmp_path / "a.fff"
    for numbers in ({0x5C: 1e5}, {0x60: 40.0}, {0x70: 0.9}, {0x80: 90.0}, {0x78: float("nan")}):
        path.write_bytes(make.fff(numbers=numbers))
        with pytest.raises(BadInput, match="planck|calibration"):
            read_frames(path)
    whole = bytearray(summed(make.fff()))
    whole[-700] ^= 1
    path.write_bytes(bytes(whole))
    with pytest.raises(BadInput, match="checksum of its calibration does not fit"):
        read_frames(path)


# --- point 14: memory and time --------------------------------------------------------------------------------
def bombs(folder: Path) -> dict[str, Path]:
    """Small files that unpack to gigabytes, or claim to."""
    zeros = zlib.compress(bytes(4 * 10**6))
    out = {
        name: folder / name for name in ("a.h5", "b.h5", "a.mat", "a.tif", "b.tif", "a.png", "a.fff", "a.csv", "b.csv")
    }
    with h5py.File(out["a.h5"], "w") as file:
        made = file.create_dataset("T", (1500, 1000, 1000), "f4", chunks=(1, 1000, 1000), compression="gzip")
        for k in range(3):
            made.id.write_direct_chunk((k, 0, 0), zeros)
    with h5py.File(out["b.h5"], "w") as file:
        file.create_dataset("T", (30_000, 30_000), "f8", chunks=(15_000, 15_000), compression="gzip")
    packed = zlib.compressobj()
    body = b"".join(packed.compress(bytes(10**7)) for _ in range(14)) + packed.flush()
    head = make.matlab(T=SCENE)[:128]
    out["a.mat"].write_bytes(head + struct.pack("<2I", 15, len(body)) + body)
    strip = zlib.compress(bytes(10**8), 1)
    small = bytearray(make.tiff(COUNTS, compression="zlib"))
    (folder / "small.tif").write_bytes(bytes(small))
    with tifffile.TiffFile(folder / "small.tif") as file:
        offset, length, columns, rows = (file.pages[0].tags[n].valueoffset for n in (273, 279, 256, 257))
    large = small[:]
    struct.pack_into("<H", large, columns, 6900)
    struct.pack_into("<H", large, rows, 7000)
    out["a.tif"].write_bytes(bytes(large))
    struct.pack_into("<I", small, offset, len(small))
    struct.pack_into("<I", small, length, len(strip))
    out["b.tif"].write_bytes(bytes(small) + strip)
    png = bytearray(imagecodecs.png_encode(COUNTS))
    png[16:24] = struct.pack(">2I", 6900, 7000)
    out["a.png"].write_bytes(bytes(png))
    record = bytearray(make.raw_record(kind="png"))
    record[2:6] = struct.pack("<2H", 7000, 7000)
    out["a.fff"].write_bytes(make.fff(records={1: bytes(record), 0x20: make.info_record()}))
    out["a.csv"].write_bytes(b"1;" * 15_000_000)
    out["b.csv"].write_bytes(b"20.5;" * 100 + b"\n" + b"a" * 10**7 + b"\n")
    return out


CHILD = """
import resource, sys, time
from pathlib import Path
from flashtemp.camera.importing.readers import read_frames
from flashtemp.errors import BadInput
for name in sys.argv[1:]:
    begin = time.monotonic()
    try:
        read_frames(name, scale=0.01, offset=-273.15)
        end = "READ"
    except BadInput as fault:
        end = str(fault)
    status = Path("/proc/self/status")  # its peak begins with this program; ru_maxrss with the one that started it
    peak = status.read_text().split("VmHWM:")[1].split()[0] if status.exists() else resource.getrusage(0).ru_maxrss
    print(name, int(peak) // 1024, f"{time.monotonic() - begin:.1f}", end, sep="|")
"""


def test_bombs(tmp_path):
    """Each is told within seconds and 700 MB of memory, the program's own 150 MB included."""
    files = bombs(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", CHILD, *map(str, files.values())], capture_output=True, text=True, cwd=ROOT, check=True
    )
    lines = [line.split("|") for line in done.stdout.splitlines()]
    assert len(lines) == len(files)
    for name, megabytes, seconds, end in lines:
        print(Path(name).name, megabytes, "MB", seconds, "s", end[:120])
        assert end != "READ", name
        assert float(seconds) < 10, name
        assert int(megabytes) < 700, (name, megabytes)


@pytest.mark.parametrize(
    "word", ["unit" + " " * 2500, "unit1" * 500, "temperatur" * 250, "a" * 2500, "°" * 2500, "1e" * 1200]
)
def test_no_header_takes_long(tmp_path, word):
    (tmp_path / "a.csv").write_bytes(make.text(SCENE, header=f"{word}\n" * 60))
    begin = time.monotonic()
    assert read_frames(tmp_path / "a.csv").shape == SCENE.shape
    assert time.monotonic() - begin < 5


def test_a_long_sequence_is_read_piece_by_piece(tmp_path):
    """Frames of a sequence are the same whether they are read together or a few at a time, and few are held."""
    counts = np.tile(make.COUNTS, (40, 40))
    one = make.fff(counts) + make.fff(counts + 1)
    (tmp_path / "a.seq").write_bytes(one * 15)
    found = [p.temperature.shape for p in iter_frames(tmp_path / "a.seq")]
    assert sum(s[0] for s in found) == 30
    assert max(np.prod(s) for s in found) <= 4_000_000
    assert len(found) == 3
    facts = ImportOptions(
        view="sidewall", downstream="right", pixel=(0.0, 479.0), mm_per_pixel=0.1, fps=10.0, start=0.0, repetition=1
    )
    r = recording_import.import_recording([tmp_path / "a.seq"], facts, folder=tmp_path).recording
    assert r.temperature.shape == (30, *counts.shape)
    first = read_frames(tmp_path / "a.seq", every=14).temperature
    assert np.allclose(r.temperature[0, ::-1], first[0], atol=1e-4, equal_nan=True)
    assert np.allclose(r.temperature[1::2], r.temperature[1], equal_nan=True)
    with pytest.raises(BadInput, match=r"frames at once would take .* --limit"):
        read_frames(tmp_path / "a.seq", limit=0.1)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["plain", "jpeg-ls"])
def test_two_gigabytes_in_one(tmp_path, capsys, kind):
    """A sequence of 2 GB is imported in 1 GB of memory; all of a SEQ, every twentieth frame of a CSQ."""
    chance = np.random.default_rng(4)
    counts = (
        12500 + np.add.outer(np.arange(480) % 97, np.arange(640) % 89) + chance.integers(0, 9, (480, 640))
    ).astype(np.uint16)
    block = make.fff(counts, kind=kind)
    name = tmp_path / ("a.seq" if kind == "plain" else "a.csq")
    with name.open("wb") as file:
        while file.tell() < 2 * 10**9:
            file.write(block * 50)
    program = (
        "import resource, sys; from flashtemp.__main__ import main; code = main(sys.argv[1:]);"
        " print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024, file=sys.stderr); sys.exit(code)"
    )
    given = ["import", str(name), "--out", str(tmp_path / "a.nc"), "--view", "sidewall", "--downstream", "right", "--pixel", "0", "479",
             "--mm-per-pixel", "0.1", "--fps", "30", "--start", "0", "--repetition", "1", "--every", "1" if kind == "plain" else "20"]  # fmt: skip
    begin = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", program, *given], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr
    megabytes = int(done.stderr.split()[-1])
    size = os.path.getsize(tmp_path / "a.nc") / 1e6
    with capsys.disabled():
        print(
            f"\n  2 GB of {name.suffix}: {megabytes} MB of memory, {time.monotonic() - begin:.0f} s, recording of {size:.0f} MB"
        )
    assert megabytes < 1000


def test_hdf5_with_data_elsewhere(tmp_path):
    (tmp_path / "secret").write_bytes(np.full((10, 9), 25.0, "<f8").tobytes())
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("T", (10, 9), "<f8", external=[(str(tmp_path / "secret"), 0, 720)])
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["T"] = h5py.ExternalLink(str(tmp_path / "a.h5"), "/T")
    with h5py.File(tmp_path / "c.h5", "w") as file:
        layout = h5py.VirtualLayout((10, 9), "<f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "a.h5"), "T", (10, 9))
        file.create_virtual_dataset("T", layout)
    for name in "abc":
        with pytest.raises(BadInput, match=rf"{name}\.h5: .*another file"):
            read_frames(tmp_path / f"{name}.h5")


def test_classic_netcdf_is_read_whole(tmp_path):
    with scipy.io.netcdf_file(tmp_path / "a.nc", "w") as file:
        for name, size in zip("rc", SCENE.shape, strict=True):
            file.createDimension(name, size)
        file.createVariable("T", "f8", tuple("rc"))[:] = SCENE
    whole = (tmp_path / "a.nc").read_bytes()
    wanted = read_frames(tmp_path / "a.nc").temperature
    (tmp_path / "b.nc").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BadInput):
        read_frames(tmp_path / "b.nc")
    assert np.allclose(wanted[0], SCENE)
