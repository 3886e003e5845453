"""From heights to a contact map: known contact, scaling, files of instruments."""

from __future__ import annotations

import json

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.errors import BadInput
from flashtemp.model.case import load_case
from flashtemp.physics.friction import contact_map
from flashtemp.physics.friction.spot_patterns import read_contact_map
from flashtemp.solver.time_integration import integrate_schedule

ROUGH = {"length": 0.03, "width": 0.02, "pixel": 1.5e-4, "hurst": 0.85, "rms": 3e-4, "rolloff": 5e-3}
E = 1.33e7
pytestmark = pytest.mark.filterwarnings("ignore:Function/property:DeprecationWarning")  # within the libraries


@pytest.fixture(scope="module")
def road():
    return contact_map.generate_topography(**ROUGH, seed=3)


def test_a_synthetic_road_is_what_was_asked_for(road):
    again = contact_map.generate_topography(**ROUGH, seed=3)
    np.testing.assert_array_equal(road.heights(), again.heights())
    assert not np.array_equal(road.heights(), contact_map.generate_topography(**ROUGH, seed=4).heights())
    assert road.physical_sizes == (0.03, 0.02)
    assert road.rms_height_from_area() == pytest.approx(3e-4, rel=0.2)


def test_a_sphere_touches_as_hertz_says():
    """One smooth asperity per period: a^3 = 3 F R/(4 E*), far from its images."""
    from SurfaceTopography import Topography

    n, side, R, p = 200, 0.02, 0.05, 60.0
    x = (np.arange(n) - n / 2) * side / n
    heights = -(x[:, None] ** 2 + x[None] ** 2) / (2 * R)
    found = contact_map.solve_contact_map(Topography(heights, (side, side), periodic=True), p, E, 2.01 * side / n)
    radius = (3 * p * side**2 * R / (4 * E)) ** (1 / 3)
    assert found.number == 1
    assert found.diameter == pytest.approx(2 * radius, rel=0.06)


def test_contact_grows_with_pressure_and_falls_with_resolution(road):
    """Linear in pressure while it is small (C of rough contact), less where finer asperities carry the load."""
    low, high = (contact_map.solve_contact_map(road, p, E, 1e-3).fraction for p in (1e5, 2e5))
    assert high / low == pytest.approx(2.0, rel=0.15)
    fine = contact_map.solve_contact_map(road, 1e5, E, 4e-4).fraction
    assert fine < 0.85 * low


@pytest.mark.long
def test_the_command_makes_a_map_that_a_case_runs_on(tmp_path, capsys):
    out = tmp_path / "road.npz"
    given = [f"--{k}={v}" for k, v in ROUGH.items()]
    assert main(["spots", "--synthetic", *given, "--cutoff", "1e-3", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    ground = read_contact_map(out, "k")
    assert ground.covered.mean() == pytest.approx(told["fraction"])
    assert ground.repeat == pytest.approx(0.03)
    (tmp_path / "case.toml").write_text(
        f"""effects = ["resolved_spots"]
[block]
length = 0.015
width = 0.02
height = 0.003
[contact]
spot_fraction = {told["fraction"]}
spot_diameter = {told["diameter"]}
[schedule]
distance = 0.004
[resolved_spots]
contact_map = "road.npz"
[numerics]
cells = [30, 8, 8]
across = 40
first_x = 5e-4
last_x = 5e-4
[output]
fields = 3
"""
    )
    case = load_case(tmp_path)
    run = integrate_schedule(case.scene, case.settings)
    assert run.maps["cover"].mean() == pytest.approx(told["fraction"], rel=0.35)
    assert run.energy_imbalance < 1e-10
    assert run.T_spot[-1].max() > run.T_block[-1].max() + 1.0


def test_a_file_of_an_instrument_is_read_in_its_own_unit(road, tmp_path):
    from SurfaceTopography import Topography

    micro = Topography(1e6 * road.heights(), tuple(1e6 * s for s in road.physical_sizes), unit="um", periodic=True)
    micro.to_netcdf(tmp_path / "road.nc")
    read = contact_map.read_height_map(tmp_path / "road.nc")
    assert read.physical_sizes == pytest.approx((0.03, 0.02))
    direct, same = (contact_map.solve_contact_map(t, 1e5, E, 1e-3).fraction for t in (road, read))
    assert same == pytest.approx(direct, rel=0.05)


SIZE = ["--length", "0.03", "--width", "0.02"]
TEXTS = {  # heights per m, header, what is given besides
    "m, size given": (1.0, "", SIZE),
    "m, size in the file": (1.0, "# Width: 30 mm\n# Height: 20 mm\n# Value units: m\n", []),
    "um in the file": (1e6, "# Value units: um\n", SIZE),
}


def matrix(road, file, scale=1.0, header=""):
    """Heights as text, a line along the direction of sliding in every row."""
    with file.open("w") as out:
        out.write(header)
        np.savetxt(out, scale * road.heights().T)
    return file


@pytest.mark.parametrize("kind", TEXTS)
def test_a_text_matrix_is_read(road, tmp_path, capsys, kind):
    scale, header, given = TEXTS[kind]
    file = matrix(road, tmp_path / "road.txt", scale, header)
    assert main(["spots", str(file), *given, "--cutoff", "1e-3", "--out", str(tmp_path / "a.npz"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    direct = contact_map.solve_contact_map(road, 1.5e5, E, 1e-3)
    assert told["size_m"] == pytest.approx([0.03, 0.02])
    assert told["fraction"] == pytest.approx(direct.fraction, rel=0.1)  # it is detrended
    assert np.mean(read_contact_map(tmp_path / "a.npz", "k").covered == direct.ground.covered) > 0.98


@pytest.mark.parametrize(
    ("kind", "given", "says"),
    [
        ("plain", [], ["matrix.txt", "--length", "--width"]),
        ("plain", ["--length", "0.03"], ["--width", "missing"]),
        ("plain", ["--length", "0.03", "--width", "0"], ["--width", "> 0"]),
        ("sized", SIZE, ["--length", "states its own size"]),
        ("um", SIZE, ["matrix.txt", "heights in m"]),
        ("line", [], ["matrix.txt", "not an area"]),
        ("commas", SIZE, ["matrix.txt", "no topography", "text matrix"]),
    ],
)
def test_matrices_that_say_too_little_are_told_in_one_line(road, tmp_path, capsys, kind, given, says):
    file = tmp_path / "matrix.txt"
    if kind == "line":
        np.savetxt(file, np.c_[np.arange(50.0), np.arange(50.0) % 7])
    elif kind == "commas":
        np.savetxt(file, road.heights(), delimiter=",")
    else:
        header = TEXTS["m, size in the file"][1] if kind == "sized" else ""
        matrix(road, file, 1e6 if kind == "um" else 1.0, header)
    out = tmp_path / "a.npz"
    assert main(["spots", str(file), *given, "--cutoff", "1e-3", "--out", str(out)]) == 2
    said = capsys.readouterr().err.strip()
    assert all(word in said for word in says), said
    assert "\n" not in said
    assert not out.exists()


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["--cutoff", "1e-3"], "one FILE"),
        (["--synthetic", "--cutoff", "1e-5"], "two pixels"),
        (["--synthetic", "--cutoff", "-1"], "--cutoff"),
        (["--synthetic", "--cutoff", "1e-3", "--hurst", "1.5"], "--hurst"),
        (["missing.x3p", "--cutoff", "1e-3"], "no topography"),
    ],
)
def test_bad_wishes_are_told_in_one_line(argv, says, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["spots", *argv, "--out", "a.npz"]) == 2
    said = capsys.readouterr().err.strip()
    assert says in said
    assert "\n" not in said
    assert not (tmp_path / "a.npz").exists()


def test_without_the_library(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    with pytest.raises(BadInput, match=r"pip install 'flashtemp\[topography\]'"):
        contact_map.read_height_map("a.x3p")
