"""Master curves and shift factors from the files that instruments write: one curve, whatever the file looks like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flashtemp.errors import BadInput
from flashtemp.physics.friction import master_curve_files
from flashtemp.physics.friction.rheology import WLF, ColeCole, MeasuredShift

DATA = Path(__file__).parents[1] / "data"
LAW = ColeCole(3e6, 1e9, 0.5, 1e-6)
SHIFT = WLF(8.0, 110.0, 293.15)
F = np.geomspace(1e-2, 1e4, 13)  # Hz
E = LAW(2 * np.pi * F)
TAN = E.imag / E.real


def lines(head: str, columns, sign: str, comma: bool = False) -> str:
    text = "\n".join(sign.join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True))
    return f"{head}{text.replace('.', ',') if comma else text}\n"


OMEGA, MPA, YOUNG, THIRD = 2 * np.pi * F, (F, E.real / 1e6, E.imag / 1e6), (E.real, E.imag), (E.real / 3, E.imag / 3)
WARM = 20 + 0 * F
STEP = "Angular frequency [rad/s]\tStorage modulus [Pa]\tLoss modulus [Pa]\n"
FORMATS = {
    "comments, tabs": lines("# DMA\n# Frequency (Hz)\tE' Storage Modulus (MPa)\tE'' Loss Modulus (MPa)\n", MPA, "\t"),
    "decimal commas": lines("Probe;7,5 mm\nfrequency;E'';E'\nHz;kPa;kPa\n", (F, E.imag / 1e3, E.real / 1e3), ";", True),
    "commas, no spaces": lines("omega,E_stor,E_loss,T\nrad/s,Pa,Pa,C\n", (OMEGA, *YOUNG, WARM), ","),
    "blanks, no header": lines("", (OMEGA, *YOUNG), "   "),
    "blanks, decimal commas": lines("f  E'  E''\nHz  MPa  MPa\n", MPA, "  ", True),
    "shear": lines("T=20;origin=x\nFreq\tG'\tG\"\tTemp\nrad/s\tPa\tPa\t°C\n", (OMEGA, *THIRD, WARM), "     "),
    "tan delta": lines("f / Hz;T / °C;tan δ;Storage modulus / GPa\n", (F, WARM, TAN, E.real / 1e9), ";"),
    "slashes": lines("f/Hz,E′/MPa,E″/MPa\n", MPA, ","),
    "brackets": lines("f(Hz);E'(MPa);E''(MPa)\n", MPA, ";"),
    "more names than columns": lines("w     G'     G''     Temp     tan_delta\n", (OMEGA, *THIRD, WARM), "  ")[:-1]
    + "  0.5\n",
    "steps": lines(STEP, (OMEGA[:5], E.real[:5], E.imag[:5]), "\t")
    + lines(f"\n# step 2\n{STEP}", (OMEGA[5:], E.real[5:], E.imag[5:]), "\t"),
}  # fmt: skip


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
@pytest.mark.parametrize("name", FORMATS)
def test_one_curve_from_every_file(name, encoding, tmp_path):
    (tmp_path / "curve.txt").write_text(FORMATS[name], encoding=encoding)
    found = master_curve_files.read_master_curve("curve.txt", tmp_path, "k")
    assert found.omega == pytest.approx(2 * np.pi * F, rel=1e-7)
    assert found.storage == pytest.approx(E.real, rel=1e-7)
    assert found.loss == pytest.approx(E.imag, rel=1e-7)


def test_rows_of_a_case_are_sorted_and_repeated_frequencies_averaged():
    rows = [[100.0, 4e6, 2e5], [10.0, 1e6, 1e5], [10.0, 4e6, 4e5], [1.0, 1e6, 1e5]]
    found = master_curve_files.read_master_curve(rows, Path("."), "k")
    assert found.omega == pytest.approx((1.0, 10.0, 100.0))
    assert found.storage == pytest.approx((1e6, 2e6, 4e6))
    assert found.loss == pytest.approx((1e5, 2e5, 2e5))


def test_old_encoding_and_poisson(tmp_path):
    head = "f;G';G'';T\nHz;MPa;MPa;°C\n"
    (tmp_path / "a.csv").write_bytes((head + "1;1;0.1;20\n2;1;0.1;20\n3;1;0.1;20\n").encode("latin-1"))
    assert master_curve_files.read_master_curve("a.csv", tmp_path, "k", None, 0.25).storage == pytest.approx(
        [2.5e6] * 3
    )


def test_measured_files():
    """Units line below the names, byte order mark, temperatures that drift by some 0.1 K within a sweep."""
    master = master_curve_files.read_master_curve("pyvisco_master.csv", DATA, "k")
    assert master.omega[0] / (2e-12 * np.pi) == pytest.approx(1.0)
    assert (master.storage[0], master.loss[0]) == pytest.approx((88.79651575665739e6, 10.502460140936773e6))
    assert len(master.omega) == 58
    shift = master_curve_files.read_shift("pyvisco_shift.csv", DATA, "s")
    assert shift.valid_range == pytest.approx((223.15, 373.15))
    assert np.log10(shift(268.15)) == pytest.approx(0.0, abs=1e-12)
    sweeps = master_curve_files.read_sweeps("pyvisco_raw.csv", DATA, "k")
    assert np.array(sweeps.temperatures) - 273.15 == pytest.approx((-49.91, -42.45, -34.92), abs=0.01)
    raw = master_curve_files.read_master_curve("pyvisco_raw.csv", DATA, "k", shift)
    assert raw.valid_range[0] == pytest.approx(0.2 * np.pi * shift(273.15 - 34.96), rel=0.2)
    assert raw.valid_range[1] == pytest.approx(200 * np.pi * shift(273.15 - 49.9912), rel=1e-9)


def raw_sweeps(tmp_path, name="raw.csv"):
    """Sweeps over three decades at seven temperatures, as a machine would measure them."""
    T, f = np.meshgrid(np.arange(-20.0, 41.0, 10.0), np.geomspace(0.1, 100.0, 10), indexing="ij")
    E = LAW(2 * np.pi * f * SHIFT(T + 273.15)).ravel()
    columns = (f.ravel(), E.real / 1e6, E.imag / 1e6, T.ravel())
    (tmp_path / name).write_text(lines("f,E',E'',T\nHz,MPa,MPa,degC\n", columns, ","))
    return columns


def test_sweeps_fall_on_the_master_curve(tmp_path):
    raw_sweeps(tmp_path)
    found = master_curve_files.read_master_curve("raw.csv", tmp_path, "k", SHIFT)
    assert found.valid_range == pytest.approx((0.2 * np.pi * SHIFT(313.15), 200 * np.pi * SHIFT(253.15)), rel=1e-6)
    omega = np.geomspace(*found.valid_range, 300)
    assert found(omega) == pytest.approx(LAW(omega), rel=3e-3)
    sweeps = master_curve_files.read_sweeps("raw.csv", tmp_path, "k")
    assert sweeps.rms_scatter(SHIFT) < 2e-3 < 0.2 < sweeps.rms_scatter(None)
    table = MeasuredShift(T := tuple(np.arange(250.0, 320.0, 2.5)), tuple(np.log10(SHIFT(np.array(T)))))
    assert master_curve_files.read_master_curve("raw.csv", tmp_path, "k", table)(omega) == pytest.approx(
        LAW(omega), rel=5e-3
    )


def test_sweeps_need_the_right_shift(tmp_path):
    f, storage, loss, T = raw_sweeps(tmp_path)
    with pytest.raises(BadInput, match="-20 to 40 degC without a shift; give WLF"):
        master_curve_files.read_master_curve("raw.csv", tmp_path, "k", None)
    wrong = MeasuredShift((250.0, 320.0), tuple(-np.log10(SHIFT(np.array([250.0, 320.0])))))
    with pytest.raises(BadInput, match="differ by .* decades after the shift"):
        master_curve_files.read_master_curve("raw.csv", tmp_path, "k", wrong)
    reduced = f * SHIFT(T + 273.15)
    (tmp_path / "done.csv").write_text(lines("f,E',E'',T\nHz,MPa,MPa,degC\n", (reduced, storage, loss, T), ","))
    with pytest.raises(BadInput, match="leave out the temperatures if the frequencies are reduced already"):
        master_curve_files.read_master_curve("done.csv", tmp_path, "k", SHIFT)


def test_shift_factors(tmp_path):
    (tmp_path / "s.csv").write_text("T [K];log10 aT\n333,15;-2,5\n293,15;0\n313,15;-1\n313,15;-2\n")
    found = master_curve_files.read_shift("s.csv", tmp_path, "k")
    np.testing.assert_allclose(found.T, (293.15, 313.15, 333.15))
    assert found.decades == pytest.approx((0.0, -1.5, -2.5))
    rows = master_curve_files.read_shift([[20.0, 0.0], [60.0, -2.0]], tmp_path, "k")
    assert (rows.T, rows.decades) == (pytest.approx((293.15, 333.15)), (0.0, -2.0))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("f,E',E''\n1,10,1\n2,11,1\n3,12,1\n",
         r"x.csv:2: E' \(Pa assumed, no unit stated\): 10 .*is the modulus in MPa\? say"),
        ("f,E',E''\nHz,Pa,Pa\n1,10,1\n2,11,1\n3,12,1\n",
         r"x.csv:3: E' \(Pa\): 10 in SI units; give a modulus from 1e3 to 1e12 Pa$"),
        ("f,E',E''\nHz,GPa,Pa\n1,1,1\n2,9000,1\n", r"x.csv:4: E' \(GPa\): 9e\+12"),
        ("f,E',E''\nHz,MPa,MPa\n1,10,1\n2,11,-1\n3,12,1\n", r"x.csv:4: E'' \(MPa\): -1e\+06 .* loss modulus > 0"),
        ("f,E',E''\nHz,MPa,MPa\n0,10,1\n2,11,1\n", r"x.csv:3: f \(Hz\): 0 in SI units; give a frequency > 0"),
        ("f,E',E''\nHz,mPa,MPa\n1,10,1\n2,11,1\n", r"unit 'mPa' is not known; give one of Pa, kPa"),
        ("f,E' (psi),E'' (psi)\n1,10,1\n2,11,1\n", r"unit 'psi' is not known"),
        ("f,E'\nHz,MPa\n1,10\n2,11\n", r"no column of tan delta, only 'f', \"E'\"; name it E'' \(MPa\) or tan delta"),
        ("f,E',E''\nHz,MPa,MPa\n1,10,1\n2,x,1\n", r"x.csv:4: '2,x,1' is not a row of numbers"),
        ("f,E',E''\nHz,MPa,MPa\n1,10,1\n2,11\n", r"x.csv:4: 2 values; give 3"),
        ("f,E',E''\nHz,MPa,MPa\n1,10,1\n2,,1\n", r"x.csv:4: E' \(MPa\): nan"),
        ("a,b,c,d\n1,2,3,4\n", r"4 columns without names; name them in a line: f \(Hz\)"),
        ("f,E',E'',T\nHz,MPa,MPa,degC\n1,10,1,900\n2,11,1,900\n", r"x.csv:3: T \(degC\): 1173.15"),
        ("no numbers\n", r"no rows of numbers; give columns"),
    ],
)  # fmt: skip
def test_wrong_files_are_told_by_line_and_column(text, says, tmp_path):
    (tmp_path / "x.csv").write_text(text)
    with pytest.raises(BadInput, match=says) as told:
        master_curve_files.read_master_curve("x.csv", tmp_path, "friction.master")
    assert str(told.value).startswith("friction.master: x.csv:")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ([[1.0, 10.0, 1.0], [2.0, 11.0, 1.0]], r"^k: row 1: storage modulus \(Pa\): 10 .* 1e3 to 1e12 Pa$"),
        ([[1.0, 1e6, 1e5], [1.0, 1e6, 1e5], [2.0, 1e6, 1e5]], "2 different frequencies; give 3 or more"),
        ("missing.csv", "file 'missing.csv' not found"),
        (
            7,
            r"^k: 7; give a file name or a list of rows, or a table { relaxed = Pa, unrelaxed = Pa, exponent = 1, "
            r"time = s } or { relaxed = Pa, terms = \[\[Pa, s\], ...\] }$",
        ),
    ],
)
def test_wrong_rows(source, says, tmp_path):
    with pytest.raises(BadInput, match=says):
        master_curve_files.read_master_curve(source, tmp_path, "k")


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ([[20.0, 0.0], [60.0, 2.0]], "^k: log10 a_T increases with temperature"),
        ([[20.0, 0.0]], "^k: 1 temperatures"),
        (5, "^k: 5; give a file name or a list of rows$"),
        ([[20.0, 0.0], [60.0, 1e4]], r"row 2: .*between -40 and 40"),
        ([[293.0, 0.0], [633.0, -2.0]], "row 2: temperature"),
    ],
)
def test_wrong_shifts(rows, says, tmp_path):
    with pytest.raises(BadInput, match=says):
        master_curve_files.read_shift(rows, tmp_path, "k")


def test_factors_that_are_no_logarithms(tmp_path):
    (tmp_path / "s.csv").write_text("T,aT\nC,-\n0,39\n20,1\n40,0.07\n")
    with pytest.raises(BadInput, match="these look like a_T itself"):
        master_curve_files.read_shift("s.csv", tmp_path, "k")
