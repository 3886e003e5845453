"""Power spectra: files, heights of a surface made to a known spectrum, lines across it, a measured profile."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.special import beta, gamma

from flashtemp.__main__ import main
from flashtemp.errors import BadInput
from flashtemp.physics.friction import measured_roughness
from flashtemp.physics.friction.roughness_spectrum import MeasuredSpectrum, RoughnessSpectrum, SelfAffineLaw

DATA = Path(__file__).parents[1] / "data"
PIXEL, N, SURFACES = 2e-4, 512, 6
LAW = SelfAffineLaw(1e-14, 2 * np.pi * 40 / (N * PIXEL), 0.8)  # 40 roll-off wavelengths across
pytestmark = pytest.mark.filterwarnings("ignore:Function/property:DeprecationWarning")  # within the libraries


@pytest.fixture(scope="module")
def heights():
    """Every mode with the amplitude of the law, <h^2> = sum C dq^2, and a random phase: (surface, x, y)."""
    q = 2 * np.pi * np.fft.fftfreq(N, PIXEL)
    q = np.hypot(q[:, None], q[None])
    modes = np.fft.fft2(np.random.default_rng(5).standard_normal((SURFACES, N, N)))
    modes *= np.where(q > 0, np.sqrt(LAW(np.maximum(q, 1.0))), 0.0) / np.abs(modes)
    return np.fft.ifft2(modes).real * N**2 * 2 * np.pi / (N * PIXEL)


@pytest.fixture(scope="module")
def areas(heights):
    return [measured_roughness.spectrum_of_topography(h, PIXEL) for h in heights]


def mean(spectra: list[MeasuredSpectrum]) -> MeasuredSpectrum:
    """Of spectra over the same wavenumbers: what the windowed modes interfere falls out."""
    return MeasuredSpectrum(spectra[0].q, tuple(np.mean([p.C for p in spectra], axis=0)))


def ratio(points: MeasuredSpectrum, longest: float, shortest: float) -> float:
    """Mean of C over the law between two wavelengths, every mode of an area counting once."""
    q = np.array(points.q)
    inside = (2 * np.pi / q <= longest) & (2 * np.pi / q >= shortest)
    return float(np.average((np.array(points.C) / LAW(q))[inside], weights=q[inside] ** 2))


def test_a_known_surface_gives_its_spectrum(heights, areas):
    for surface, points in zip(heights, areas, strict=True):
        assert RoughnessSpectrum(points, *points.valid_range).rms_height == pytest.approx(surface.std(), rel=0.03)
        assert points.valid_range == pytest.approx((2 * 2 * np.pi / (N * PIXEL), np.pi / PIXEL), rel=0.08)
    points = mean(areas)
    assert ratio(points, 0.04, 3e-3) == pytest.approx(1.0, rel=0.04)
    assert ratio(points, 2e-3, 4e-4) == pytest.approx(1.0, rel=0.02)
    law = measured_roughness.fit_self_affine(points)
    assert law.level / LAW.level == pytest.approx(1.0, rel=0.06)
    assert law.rolloff == pytest.approx(LAW.rolloff, rel=0.05)
    assert law.hurst == pytest.approx(LAW.hurst, abs=0.02)


def test_pixels_need_not_be_square_and_points_may_be_missing(heights, areas):
    spread = np.repeat(heights[0], 2, axis=1)
    assert ratio(measured_roughness.spectrum_of_topography(spread, (PIXEL, PIXEL / 2)), 4e-3, 2e-3) == pytest.approx(
        ratio(areas[0], 4e-3, 2e-3), rel=0.03
    )
    holes = heights[0].copy()
    holes[np.random.default_rng(1).random(holes.shape) < 0.05] = np.nan
    holes[100:103, 200:230] = 0.04  # m, a reflection
    patched = measured_roughness.spectrum_of_topography(measured_roughness.remove_spikes(holes), PIXEL)
    far = np.array(patched.q) < 2 * np.pi / 2e-3
    np.testing.assert_allclose(np.array(patched.C)[far], np.array(areas[0].C)[far], rtol=0.05)
    spoiled = measured_roughness.spectrum_of_topography(holes, PIXEL)
    assert ratio(spoiled, 4e-3, 2e-3) > 1.3 * ratio(patched, 4e-3, 2e-3)


@pytest.mark.parametrize("hurst", [0.3, 0.8, 1.0])
def test_abel_of_a_power_law(hurst):
    k = np.geomspace(10.0, 1e5, 41)
    expected = k ** (-2 - 2 * hurst) * gamma(1 + hurst) / (np.sqrt(np.pi) * gamma(hurst + 0.5))
    np.testing.assert_allclose(measured_roughness.isotropic_spectrum(k, k ** (-1 - 2 * hurst)), expected, rtol=1e-8)


def test_abel_across_a_roll_off():
    """C = (1 + q^2)^-(1+H) is seen by a line as B(1/2, H + 1/2) (1 + k^2)^-(H+1/2)."""
    k = np.geomspace(1e-2, 1e2, 41)
    S = beta(0.5, 1.3) * (1 + k**2) ** -1.3
    np.testing.assert_allclose(measured_roughness.isotropic_spectrum(k, S), (1 + k**2) ** -1.8, rtol=2.5e-3)


def test_lines_tell_the_same_as_the_area(heights, areas):
    lines, area = mean([measured_roughness.spectrum_of_profile(h[::8], PIXEL) for h in heights]), mean(areas)
    assert ratio(lines, 0.04, 3e-3) == pytest.approx(ratio(area, 0.04, 3e-3), rel=0.08)
    assert ratio(lines, 2e-3, 8e-4) == pytest.approx(ratio(area, 2e-3, 8e-4), rel=0.05)
    found, expected = measured_roughness.fit_self_affine(lines), measured_roughness.fit_self_affine(area)
    assert found.level / expected.level == pytest.approx(1.0, rel=0.1)
    assert found.hurst == pytest.approx(expected.hurst, abs=0.05)
    assert lines.valid_range[1] <= np.pi / PIXEL / 2
    line = heights[0, 0]
    assert measured_roughness.profile_height(line, PIXEL) == pytest.approx(line.std(), rel=0.1)
    assert measured_roughness.profile_height(line, PIXEL, 1e-3) < 0.6 * measured_roughness.profile_height(line, PIXEL)


def test_tilt_and_place_count_for_nothing(heights, areas):
    """What the instrument's stage adds; and waves that do not fit twice are not told."""
    plane = 0.02 * PIXEL * np.arange(N)
    tilted = measured_roughness.spectrum_of_topography(heights[0] + plane + 3 * plane[:, None] + 0.01, PIXEL)
    np.testing.assert_allclose(tilted.C, areas[0].C, rtol=1e-6)
    flat, tilted = (
        measured_roughness.spectrum_of_profile(heights[0, 5] + extra, PIXEL) for extra in (0.0, plane + 0.01)
    )
    np.testing.assert_allclose(tilted.C, flat.C, rtol=1e-6)
    assert flat.valid_range[0] >= 0.999 * 2 * 2 * np.pi / (N * PIXEL)


def test_a_wave_has_the_height_that_it_has():
    x = np.arange(4000) * 1e-4
    wave = 2e-3 * np.sin(2 * np.pi * x / 0.02) + 0.05 * x
    wave[500:520] = np.nan
    wave[-30:] = np.nan
    assert measured_roughness.profile_height(wave, 1e-4, 0.1) == pytest.approx(2e-3 / np.sqrt(2), rel=0.02)
    assert measured_roughness.profile_height(wave, 1e-4, 0.01) < 1e-4


def test_a_measured_profile():
    heights, step = measured_roughness.read_profile(DATA / "captif_profile.dat")
    assert step == pytest.approx(3.75e-5, rel=1e-3)
    clean = measured_roughness.remove_spikes(heights)
    plate = heights > 0.04
    assert plate.sum() == 48
    assert np.isnan(heights).sum() == 43
    assert np.isnan(clean[plate]).all()
    np.testing.assert_array_equal(clean[~plate], heights[~plate])
    assert np.nanstd(clean) < 5e-4 < 5e-3 < np.nanstd(heights)


SPECTRA = {
    "own": "q_1/m,C_m4\n100,1e-11\n1000,1e-12\n1000,1e-14\n10000,1e-16\n",
    "comments": "# PSD\n# Wavenumber q (1/m)\tPSD C(q) (m^4)\n"
    "1.E+02\t1.E-11\n1.E+03\t1.E-12\n1.E+03\t1.E-14\n1.E+04\t1.E-16\n",
    "micrometres": "q;C(q)\nµm^-1;µm^4\n0,0001;1e13\n0,001;1e12\n0,001;1e10\n0,01;1e8\n",
    "no header": "100 1e-11\n10000 1e-16\n1000 1e-12\n1000 1e-14\n",
}


@pytest.mark.parametrize("name", SPECTRA)
def test_spectra_from_files(name, tmp_path):
    (tmp_path / "psd.txt").write_text(SPECTRA[name], encoding="utf-8")
    found = measured_roughness.read_spectrum("psd.txt", tmp_path, "k")
    assert found.q == pytest.approx((100.0, 1000.0, 10000.0))
    np.testing.assert_allclose(found.C, (1e-11, 1e-13, 1e-16), rtol=1e-9)
    rows = [[100.0, 1e-11], [1000.0, 1e-13], [10000.0, 1e-16]]
    np.testing.assert_allclose(measured_roughness.read_spectrum(rows, tmp_path, "k").C, found.C, rtol=1e-9)


@pytest.mark.parametrize(
    ("source", "says"),
    [
        (
            "q,C\n1/m,m^4\n100,1e-3\n1000,1e-4\n1e4,1e-7\n",
            r"k: x.csv: rms height .* m; give one from 1e-9 to 0.1 m: is q",
        ),
        ("q,C\n1/m,m^4\n100,1e-11\n1000,0\n1e4,1e-7\n", r"x.csv:4: C \(m4\): 0 in SI units; give a number > 0"),
        ("q,C\n1/m,m^3\n100,1e-11\n1000,1e-12\n", "unit 'm3' is not known; give one of m4"),
        ("q,height\n1/m,m\n100,1e-11\n1000,1e-12\n", "no column of the power spectrum; name it C"),
        ([[100.0, 1e-11], [1000.0, 1e-12]], "^k: 2 different wavenumbers; give 3 or more$"),
        ([[100.0, 1e-3], [1000.0, 1e-4], [1e4, 1e-7]], "^k: rms height"),
        (5, "^k: 5; give a file name or a list of rows, or a law { height = m, rolloff = 1/m, hurst = 1, lowest"),
    ],
)
def test_wrong_spectra(source, says, tmp_path):
    if isinstance(source, str):
        (tmp_path / "x.csv").write_text(source)
        source = "x.csv"
    with pytest.raises(BadInput, match=says):
        measured_roughness.read_spectrum(source, tmp_path, "k")


def test_the_command_on_an_area(heights, tmp_path, capsys):
    from SurfaceTopography import Topography

    cut, side = heights[0, :256, :256], 256 * PIXEL
    Topography(1e6 * cut, (1e6 * side, 1e6 * side), unit="um").to_netcdf(tmp_path / "road.nc")
    np.save(tmp_path / "road.npy", cut)
    told = []
    for name, more in (("road.nc", []), ("road.npy", [f"--pixel={PIXEL}"])):
        out = tmp_path / f"{name}.csv"
        assert main(["spectrum", str(tmp_path / name), "--out", str(out), "--highpass", "0.01", *more, "--json"]) == 0
        told.append(json.loads(capsys.readouterr().out))
        assert Path(told[-1]["picture"]).stat().st_size > 5000
        points = measured_roughness.read_spectrum(out.name, tmp_path, "k")
        assert RoughnessSpectrum(points, *points.valid_range).rms_height == pytest.approx(
            told[-1]["rms_height_m"], rel=1e-6
        )
    assert told[0]["rms_height_m"] == pytest.approx(told[1]["rms_height_m"], rel=1e-3)
    assert told[0]["hurst"] == pytest.approx(0.8, abs=0.08)
    assert told[0]["remarks"] == []
    assert told[0]["longest_m"] <= 0.01
    assert told[0]["shortest_m"] == pytest.approx(2 * PIXEL, rel=0.1)


def test_the_command_on_a_profile(heights, tmp_path, capsys):
    line = heights[0, 3].copy()
    rows = "\n".join(f"{1e3 * PIXEL * i:.3f}\t{'NaN' if i % 50 == 7 else f'{1e3 * h:.6f}'}" for i, h in enumerate(line))
    (tmp_path / "line.txt").write_text(f"Road\tA\nDistance (mm)\tDepth (mm)\n{rows}\n")
    out = tmp_path / "psd.csv"
    assert main(["spectrum", str(tmp_path / "line.txt"), "--out", str(out), "--profile"]) == 0
    said = capsys.readouterr().out
    assert "rms height of the line itself" in said
    assert "dropouts and spikes: 2.1 %" in said
    assert (tmp_path / "psd.png").is_file()
    assert measured_roughness.read_spectrum("psd.csv", tmp_path, "k").valid_range[1] <= np.pi / PIXEL / 2
    np.savetxt(tmp_path / "bare.txt", np.where(np.isnan(line), 0.0, line))
    out = tmp_path / "bare.csv"
    argv = ["spectrum", str(tmp_path / "bare.txt"), "--out", str(out), "--profile", f"--pixel={PIXEL}", "--json"]
    assert main(argv) == 0
    assert json.loads(capsys.readouterr().out)["rms_height_of_line_m"] == pytest.approx(line.std(), rel=0.1)


def test_the_numbers_of_a_law_carry_their_units():
    """Of points on the law: its own level, roll-off and exponent."""
    q = np.geomspace(0.1 * LAW.rolloff, 100 * LAW.rolloff, 61)
    told = measured_roughness.SpectrumSummary.from_points(MeasuredSpectrum(tuple(q), tuple(LAW(q)))).as_dict()
    assert told["level_m4"] == pytest.approx(LAW.level, rel=0.02)
    assert told["rolloff_m"] == pytest.approx(2 * np.pi / LAW.rolloff, rel=0.02)
    assert (told["longest_m"], told["shortest_m"]) == pytest.approx((2 * np.pi / q[0], 2 * np.pi / q[-1]))
    assert {k for k in told if not k.endswith(("_m", "_m4"))} == {"rms_slope", "hurst", "remarks"}


@pytest.mark.parametrize("taken", ["a.csv", "a.png"])
def test_no_file_is_overwritten(taken, tmp_path, capsys, monkeypatch):
    """Told before anything is read or computed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(measured_roughness, "remove_spikes", lambda heights: pytest.fail("computed"))
    np.save("road.npy", np.zeros((32, 32)))
    Path(taken).write_text("mine")
    assert main(["spectrum", "road.npy", "--pixel", "1e-4", "--out", "a.csv"]) == 2
    assert capsys.readouterr().err.strip().endswith(f"--out: {taken} exists; choose another name")
    assert Path(taken).read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(
    ("kind", "pixel", "said"),
    [("noise", "1e-3", ["Hurst exponent -"]), ("road", "1e-12", ["rms slope"]), ("road", str(PIXEL), [])],
)
@pytest.mark.sample("road-0.0002-said2")
def test_what_no_road_has_is_remarked(heights, kind, pixel, said, tmp_path, capsys):
    noise = 1e-4 * np.random.default_rng(2).standard_normal((128, 128))
    np.save(tmp_path / "road.npy", noise if kind == "noise" else heights[0, :256, :256])
    argv = ["spectrum", str(tmp_path / "road.npy"), "--pixel", pixel]
    assert main([*argv, "--out", str(tmp_path / "a.csv"), "--json"]) == 0
    remarks = json.loads(capsys.readouterr().out)["remarks"]
    assert len(remarks) == len(said)
    assert all(remark.startswith(words) for remark, words in zip(remarks, said, strict=True))
    assert main([*argv, "--out", str(tmp_path / "b.csv")]) == 0
    text = capsys.readouterr().out
    assert [line for line in text.splitlines() if "remark" in line] == [f"  remark: {remark}" for remark in remarks]


def test_a_hurst_exponent_may_reach_its_limits():
    for hurst, count in ((-0.02, 1), (0.0, 0), (1.0, 0), (1.004, 0), (1.02, 1)):
        assert (
            len(measured_roughness.SpectrumSummary(1e-4, 9.9, 1e3, 1e5, SelfAffineLaw(1e-14, 1e3, hurst)).remarks)
            == count
        )
    assert len(measured_roughness.SpectrumSummary(1e-4, 10.1, 1e3, 1e5, SelfAffineLaw(1e-14, 1e3, 0.8)).remarks) == 1


def test_the_picture_shows_points_and_law():
    from flashtemp.viz.theory import spectrum

    q = np.geomspace(100.0, 1e5, 20)
    points = MeasuredSpectrum(tuple(q), tuple(LAW(q)))
    fig = spectrum.draw(points, LAW, "road")
    measured, law = fig.axes[0].lines
    np.testing.assert_array_equal(measured.get_xydata(), np.column_stack([points.q, points.C]))
    np.testing.assert_allclose(law.get_ydata(), LAW(law.get_xdata()))
    assert "H = 0.80" in law.get_label()


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["missing.x3p", "--out", "a.csv"], "missing.x3p: not found"),
        (["words.txt", "--out", "a.csv"], "not a topography: no format that SurfaceTopography can read; give"),
        (["matrix.txt", "--out", "a.csv"], "heights without the size of their area; give"),
        (["flat.txt", "--out", "a.csv"], "a line, not an area; give"),
        (["words.txt", "--out", "a.csv", "--profile"], "no rows of numbers"),
        (["words.txt", "--out", "a.csv", "--pixel", "1e-4"], "not a table of heights"),
        (["flat.npy", "--out", "a.csv", "--pixel", "1e-4"], "flat"),
        (["flat.npy", "--out", "a.csv", "--pixel", "-1"], "--pixel"),
        (["flat.npy", "--out", "a.csv", "--pixel", "1e-4", "--profile"], "2 dimensions"),
        (["flat.npy", "--out", "a.npz", "--pixel", "1e-4"], ".csv"),
        (["flat.csv", "--out", "a.csv", "--profile"], "give one from 1e-9"),
        (["empty.npy", "--out", "a.csv", "--pixel", "1e-4"], "not a table of heights"),
        (["empty.txt", "--out", "a.csv", "--pixel", "1e-4"], "not a table of heights"),
        (["lost.csv", "--out", "a.csv", "--profile"], "100 % are missing"),
        (["steps.csv", "--out", "a.csv", "--profile"], "even steps"),
        (["metres.csv", "--out", "a.csv", "--profile"], "rms height"),
        (["holes.npy", "--out", "a.csv", "--pixel", "1e-4"], "missing"),
    ],
)
def test_bad_wishes_are_told_in_one_line(argv, says, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("words.txt").write_text("no heights here\n")
    np.savetxt("matrix.txt", np.eye(32))
    np.savetxt("flat.txt", np.c_[np.arange(50.0), np.zeros(50)])
    np.save("flat.npy", np.zeros((32, 32)))
    np.save("holes.npy", np.where(np.arange(1024).reshape(32, 32) % 3 == 0, 1e-3, np.nan))
    Path("steps.csv").write_text("x,z\nmm,mm\n0,1\n1,2\n5,1\n")
    Path("empty.npy").touch()
    Path("empty.txt").touch()
    Path("flat.csv").write_text("x,z\nmm,mm\n" + "".join(f"{i},1\n" for i in range(200)))
    Path("lost.csv").write_text("x,z\nmm,mm\n" + "".join(f"{i},NaN\n" for i in range(200)))
    rough = np.random.default_rng(0).standard_normal(200)
    Path("metres.csv").write_text("x,z\n" + "".join(f"{i},{z:.3f}\n" for i, z in enumerate(rough)))
    assert main(["spectrum", *argv]) == 2
    said = capsys.readouterr().err.strip()
    assert says in said
    assert "\n" not in said
    assert not any(word in said for word in ("--length", "--width", "--synthetic"))
    if says.endswith("; give"):
        assert "--profile" in said
        assert "--pixel" in said
    assert not Path("a.csv").exists()


def test_what_a_reader_says_ends_with_a_whole_word(tmp_path, capsys, monkeypatch):
    from flashtemp.physics.friction import contact_map

    def read(path):
        raise OSError("damaged " * 40)

    monkeypatch.setattr(contact_map.load_topography_library(), "read_topography", read)
    monkeypatch.setattr(contact_map.load_topography_library(), "open_topography", read)
    (tmp_path / "a.nc").touch()
    assert main(["spectrum", str(tmp_path / "a.nc"), "--out", str(tmp_path / "a.csv")]) == 2
    said = capsys.readouterr().err
    assert "not a topography: damaged damaged" in said
    assert "damaged ...; give a height map" in said


def test_without_the_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    with pytest.raises(BadInput, match=r"pip install 'flashtemp\[topography\]'"):
        measured_roughness.spectrum_of_topography(np.eye(32), 1e-4)


def test_the_command_without_the_library(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    (tmp_path / "a.nc").touch()
    assert main(["spectrum", str(tmp_path / "a.nc"), "--out", str(tmp_path / "a.csv")]) == 2
    assert "pip install 'flashtemp[topography]'" in capsys.readouterr().err
