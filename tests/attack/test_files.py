"""Tables and recordings that are damaged, mistyped, endless or hostile: a line that helps, in time, in little memory."""

from __future__ import annotations

import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.camera import recording
from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput
from flashtemp.model.case import load_case
from flashtemp.physics import safe_text
from flashtemp.physics.friction.master_curve_files import read_master_curve, read_shift
from flashtemp.physics.friction.measured_roughness import read_profile, read_spectrum
from flashtemp.physics.interpolation import read_xy_pairs
from flashtemp.runs.studies.running_in import _read_csv_file

SOON = 5.0  # s on a machine that does other things too
CURVE = [[10.0**k, 1e6 * 2.0**k, 1e5 * 2.0**k] for k in range(6)]
SPECTRUM = [[10.0**k, 10.0 ** (-4 - 3 * k)] for k in range(2, 7)]
PROFILE = [[0.1 * k, 0.3 * (-1) ** k] for k in range(40)]
SHIFT = [[-20.0, 3.0], [0.0, 1.0], [20.0, 0.0], [40.0, -1.0]]
LOAD = [[1, 0.9], [2, 0.8], [3, 0.75], [4, 0.72]]
READERS = {  # what is read: header, rows, reader of a path
    "table": ("time,value", [[0, 0.1], [1, 0.2], [2, 0.3]], lambda p: read_xy_pairs(p.name, p.parent, "key")),
    "master curve": ("omega,E',E''", CURVE, lambda p: read_master_curve(p.name, p.parent, "key")),
    "shift": ("T,log_aT", SHIFT, lambda p: read_shift(p.name, p.parent, "key")),
    "spectrum": ("q,C", SPECTRUM, lambda p: read_spectrum(p.name, p.parent, "key")),
    "profile": ("x (mm),z (mm)", PROFILE, read_profile),
    "repetitions": ("repetition,mu", LOAD, lambda p: _read_csv_file(p, None)),
}


def written(path: Path, header: str, rows, slip: str | None = None, at: int = 0, separator: str = ",") -> Path:
    """A table; `slip` takes the place of the last cell of row `at`."""
    lines = [[f"{v:g}" for v in row] for row in rows]
    if slip is not None:
        lines[at][-1] = slip
    path.write_text("\n".join([header, *map(separator.join, lines)] if header else map(separator.join, lines)) + "\n")
    return path


def check_soon(call, *given) -> None:
    """A call ends soon, in whatever way."""
    begin = time.monotonic()
    lines: tuple[str, ...] = ()
    try:
        call(*given)
    except BadInput as fault:
        lines = fault.lines
    assert all(len(line) < 1000 for line in lines)
    assert time.monotonic() - begin < SOON


# --- point 10: no row of numbers is a header -----------------------------------------------------------
@pytest.mark.parametrize("slip", ["O.1", "1O", "l.5", "0.1.2", "1e", "0..1"])
@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("headed", [True, False], ids=["header", "no header"])
def test_a_first_row_with_a_slip_is_no_header(tmp_path, kind, slip, headed):
    header, rows, reader = READERS[kind]
    if headed or kind not in ("profile", "repetitions"):
        reader(written(tmp_path / "whole.csv", header if headed else "", rows))
    path = written(tmp_path / "slip.csv", header if headed else "", rows, slip)
    with pytest.raises(BadInput, match=r"slip\.csv") as fault:
        reader(path)
    assert len(fault.value.lines) == 1
    assert slip in str(fault.value) or kind == "repetitions"


def test_the_speed_of_a_case(tmp_path):
    """Ten rows, the first mistyped: refused with its line, not a schedule that begins at the second."""
    (tmp_path / "case.toml").write_text('[schedule]\nspeed = "v.csv"\ndistance = 0.1\n')
    written(tmp_path / "v.csv", "", [[0.1 * k, 0.1] for k in range(10)])
    load_case(tmp_path)
    written(tmp_path / "v.csv", "", [[0.1 * k, 0.1] for k in range(10)], "O.1")
    with pytest.raises(BadInput, match=r"schedule\.speed: v\.csv:1: .*O\.1.*not numeric"):
        load_case(tmp_path)


@pytest.mark.parametrize(
    "text", ["t,v\nslow,fast\n0,1_0\n0,1\n", "t,1\n0,1\n", "t,nan\n0,1\n", "0,1\nt,v\n1,2\n", "0,1_0\n1,2\n"]
)
def test_one_row_of_names_at_most_and_no_number_in_it(tmp_path, text):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(BadInput, match="not numeric|not a finite|second table"):
        read_xy_pairs("a.csv", tmp_path, "key")


# --- point 14: time and memory ---------------------------------------------------------------------------
WORDS = {
    "word": "a" * 2500, "brackets": "(" * 2500, "blanks": "x" + " " * 2500 + "x", "ciso": "ciso" * 600 + "!",
    "cq": "cq" * 1200 + "!", "units": "unit" + " " * 2500, "unit": "unit1" * 500, "red": "reduced" * 400 + "!",
    "primes": "e" + "'" * 2500, "stor": "stor" * 600 + "1", "signs": "_/, " * 600, "under": "_" * 2500,
}  # fmt: skip


@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize("kind", READERS)
def test_no_header_takes_long(tmp_path, kind, word):
    _, rows, reader = READERS[kind]
    check_soon(reader, written(tmp_path / "a.csv", ",".join([WORDS[word]] * len(rows[0])), rows))


@pytest.mark.parametrize("kind", READERS)
def test_an_endless_line_is_refused_soon(tmp_path, kind):
    header, rows, reader = READERS[kind]
    path = written(tmp_path / "a.csv", header, rows)
    path.write_text(path.read_text() + "1," * 3_000_000 + "\n")
    check_soon(reader, path)
    with pytest.raises(BadInput, match="a line of 6000000 characters"):
        reader(path)


@pytest.mark.parametrize("kind", READERS)
def test_a_table_of_gigabytes_is_refused_unread(tmp_path, kind):
    _, _, reader = READERS[kind]
    with (tmp_path / "a.csv").open("wb") as file:
        file.truncate(3 * 10**9)
    with pytest.raises(BadInput, match="3000 MB; a table may have 100 MB"):
        reader(tmp_path / "a.csv")


def test_a_digit_of_another_script_is_no_number():
    assert safe_text.parse_plain_number("١") is None
    assert safe_text.parse_plain_number("1" * 101) is None


def small() -> Recording:
    T = np.full((2, 8, 9), 20.0)
    return Recording("sidewall", T, np.arange(2.0), np.ones(2, int), 1e-3 * np.arange(9), 1e-3 * np.arange(8))


def test_a_small_recording_that_claims_gigabytes(tmp_path):
    """36 kB that unpack to 8 GB: refused before anything is allocated; --limit is named."""
    path = tmp_path / "r.nc"
    small().save(path)
    with h5py.File(path, "a") as file:
        attributes = dict(file["temperature"].attrs)
        del file["temperature"]
        made = file.create_dataset("temperature", (2000, 1000, 1000), "f4", chunks=(1, 1000, 1000), compression="gzip")
        made.attrs["units"] = attributes["units"]
    assert path.stat().st_size < 200_000
    check_soon(recording.load, path)
    with pytest.raises(BadInput, match=r"r\.nc: 'temperature' .* GB of memory, the limit is 1 GB; .*--limit \d+"):
        recording.load(path)
    with pytest.raises(BadInput, match=r"the limit is 2 GB"):
        recording.load(path, 2.0)


# --- point 15: nothing from elsewhere, nothing that acts on a terminal -----------------------------------------
def test_a_recording_whose_data_lie_in_another_file(tmp_path):
    (tmp_path / "secret").write_bytes(np.full((2, 8, 9), 25.0, "<f4").tobytes())
    path = tmp_path / "r.nc"
    for kind in ("external", "link", "virtual"):
        small().save(path)
        with h5py.File(path, "a") as file:
            del file["temperature"]
            if kind == "external":
                file.create_dataset("temperature", (2, 8, 9), "<f4", external=[(str(tmp_path / "secret"), 0, 576)])
            elif kind == "link":
                file["temperature"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/T")
            else:
                layout = h5py.VirtualLayout((2, 8, 9), "<f4")
                layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "T", (2, 8, 9))
                file.create_virtual_dataset("temperature", layout)
        with pytest.raises(BadInput, match=r"r\.nc: .*another file"):
            recording.load(path)


@pytest.mark.parametrize("name", ["\x1b[2J\x1b]0;owned\x07", "\x9b31m", "\u202emoc.elif", "a\rb", "\x7f"])
def test_control_characters_are_printed_escaped(tmp_path, capsys, monkeypatch, name):
    """In names of files, in keys of cases and in JSON: nothing that a terminal acts upon."""
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(
        f'title = "{name!r:.1}"\n[friction]\n"m{name.encode("unicode_escape").decode()}" = 1\n'.replace("\\x", "\\u00")
    )
    for given in (
        ["check", name],
        ["check", "case.toml"],
        ["run", "case.toml", "--out", f"{name}/x"],
        ["check", ".", f"{name}=1"],
    ):
        assert main([*given]) in (1, 2)
        out, err = capsys.readouterr()
        assert err
        assert all(c.isprintable() or c == "\n" for c in out + err), (out, err)
    from flashtemp.cli.terminal import print_result

    for as_json in (True, False):
        print_result({"name": name}, as_json, name)
        out, _ = capsys.readouterr()
        assert all(c.isprintable() or c == "\n" for c in out)
