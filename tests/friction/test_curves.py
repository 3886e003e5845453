"""Friction over speed and temperature: branches, what a slope tester holds, depth of the heat, command and picture."""

from __future__ import annotations

import csv
import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex

from flashtemp.__main__ import main
from flashtemp.model.case import load_case
from flashtemp.physics.friction import flash_temperature, friction_curves, persson, rheology, roughness_spectrum
from flashtemp.physics.friction.adhesive_shear import AdhesiveShear
from flashtemp.physics.friction.curve_peak import find_peak
from flashtemp.physics.material import LIBRARY
from flashtemp.viz.theory import friction_curves as picture

A, RUBBER, SPOTS = rheology.READY_RUBBERS["A"], LIBRARY["tread_rubber"], flash_temperature.ContactSpots(3e-3)
ASPHALT = persson.PerssonTheory(A, roughness_spectrum.READY_ROADS["asphalt A"], shear=AdhesiveShear(4e6))
CONCRETE = persson.PerssonTheory(A, roughness_spectrum.READY_ROADS["concrete B"], shear=AdhesiveShear(4e6))
C8, C20 = 281.15, 293.15
SLOPE = Path(__file__).parents[2] / "cases" / "slope_tester"


@pytest.fixture(scope="module")
def asphalt():
    return friction_curves.compute_curves(ASPHALT, RUBBER, SPOTS, friction_curves.CURVE_SPEEDS_M_S, C20, 1.5e5)


@pytest.fixture(scope="module")
def concrete():
    return friction_curves.compute_curves(CONCRETE, RUBBER, SPOTS, friction_curves.CURVE_SPEEDS_M_S, C8, 1e5)


def test_branches_and_contact_are_the_theorys(asphalt):
    v = asphalt.speed
    np.testing.assert_allclose(v[[0, -1]], [1e-6, 10.0])
    cold, warm = flash_temperature.compute_branches(ASPHALT, RUBBER, SPOTS, v[::20], C20, 1.5e5)
    np.testing.assert_allclose(asphalt.cold.mu[::20], cold.mu)
    np.testing.assert_allclose(asphalt.hot.viscous[::20], warm.viscous, rtol=1e-6)
    np.testing.assert_allclose(asphalt.area, ASPHALT(v, C20, 1.5e5).area)
    np.testing.assert_allclose(asphalt.phi, ASPHALT.contact_fraction(2 * np.pi / 3e-3, v, C20, 1.5e5))
    assert asphalt.highest[-1] == pytest.approx(112.6, abs=0.1)


def test_adhesive_part_of_the_hot_branch_feels_the_shortest_waves(asphalt):
    found, T = flash_temperature.solve_hot_branch(ASPHALT, RUBBER, SPOTS, 10.0, C20, 1.5e5)
    assert T[-1] == pytest.approx(T.max(), abs=1e-3)
    assert asphalt.hot.adhesive[-1] == pytest.approx(float(ASPHALT.shear(10.0, T[-1]) * found.area / 1.5e5), rel=1e-5)


def test_table_over_temperature(asphalt):
    assert asphalt.mu.shape == (60, 40)
    assert asphalt.T[0] == pytest.approx(C20 - friction_curves.TABLE_K_BELOW)
    for v, known in ((0.1, [0.506, 0.450, 0.429, 0.357]), (1.0, [0.619, 0.494, 0.453, 0.436])):
        for T, mu in zip((20.0, 40.0, 60.0, 80.0), known, strict=True):
            at = (
                asphalt.to_dataset()
                .mu.assign_coords(speed=np.log(asphalt.speed))
                .interp(speed=np.log(v), temperature=T)
            )
            assert float(at) == pytest.approx(mu, abs=1.5e-3)


@pytest.mark.parametrize(
    ("reach", "T0", "low", "high"), [((290.0, 300.0), C20, 290.0, 300.0), ((330.0, 340.0), C20, C20, 340.0)]
)
def test_table_ends_where_the_shift_factors_do(reach, T0, low, high):
    rubber = rheology.Rubber(A.modulus, rheology.MeasuredShift(reach, (0.0, -1.0)))
    T = friction_curves._table_temperatures(
        persson.PerssonTheory(rubber, roughness_spectrum.READY_ROADS["asphalt A"]), T0
    )
    assert (T[0], T[-1]) == pytest.approx((low, high))


def test_depth_of_the_heat(asphalt):
    """Theory 3: a tenth, half and nine tenths come from deeper than 76, 1.7 and 0.29 um at 0.1 m/s and 20 degC."""
    assert [f"{1e6 * d:.2g}" for d in asphalt.depths.depths_at_speed(0.1)] == ["76", "1.7", "0.29"]
    assert 0.5 / np.array(asphalt.depths.depths_at_speed(0.1)) == pytest.approx([6.6e3, 2.9e5, 1.75e6], rel=0.01)
    q = 0.5 / np.array(asphalt.depths.depths_at_speed(10.0))
    found = ASPHALT(10.0, C20, 1.5e5)
    for share, cut in zip(friction_curves.DEPTH_HEAT_FRACTIONS, q, strict=True):
        below = float(np.interp(cut, found.q, ASPHALT.cumulative_integral(found.density)))
        assert below / float(found.viscous) == pytest.approx(share, abs=0.01)
    assert np.all(np.diff(asphalt.depths.deeper) >= 0)
    np.testing.assert_allclose(asphalt.depths.deeper[:, -1], 1.0, atol=1e-2)
    np.testing.assert_allclose(asphalt.depths.speed, [1e-3, 0.1, 10.0])


def test_peak_of_a_parabola_in_the_logarithm():
    v = np.geomspace(1e-3, 1e1, 41)
    top = find_peak(v, 0.8 - 0.05 * np.log(v / 0.0312) ** 2)
    assert (top.at, top.value, top.is_at_edge) == pytest.approx((0.0312, 0.8, False))
    assert find_peak(v, v).last
    assert find_peak(v, -v).first


@pytest.mark.parametrize(
    ("mu", "holds"),
    [
        ([1, 2, 3, 4], [True, True, True, True]),
        ([1, 3, 2, 1], [True, True, False, False]),
        ([4, 3, 2, 1], [True, False, False, False]),
        ([1, 3, 2, 3.5], [True, True, False, True]),  # what falls in between is jumped over
        ([1, 3, 2, 2.9], [True, True, False, False]),
    ],
)
def test_constant_force_holds_the_rising_branch_only(mu, holds):
    """C9."""
    assert friction_curves.is_steady_in_slope_tester(np.array(mu, dtype=float)).tolist() == holds


def test_a_slope_tester_on_concrete_and_on_asphalt(concrete, asphalt):
    """C9: below the maximum; all of it where the maximum does not lie inside."""
    for branch in concrete.branches.values():
        top = find_peak(concrete.speed, branch.mu)
        on = friction_curves.is_steady_in_slope_tester(branch.mu)
        assert 0.02 < top.at < 0.5
        assert np.all(on[concrete.speed < 0.9 * top.at])
        assert not np.any(on[concrete.speed > 1.2 * top.at])
    assert find_peak(asphalt.speed, asphalt.cold.mu).last
    assert friction_curves.is_steady_in_slope_tester(asphalt.cold.mu).all()
    assert not find_peak(asphalt.speed, asphalt.hot.mu).is_at_edge
    assert asphalt.as_dict()["maximum"].keys() == {"cold", "hot"}
    assert asphalt.as_dict()["maximum"]["hot"].keys() == {"speed", "mu"}
    text = str(concrete)
    assert "cold: highest 0.6695 at 0.0976 m/s" in text
    assert "cold: rises throughout" in str(asphalt)


@pytest.mark.parametrize(("v", "says"), [([3.0, 10.0], "holds none of it"), ([1e-6, 1e-4], "reaches all of it")])
def test_words_for_branches_without_a_maximum(v, says):
    found = friction_curves.compute_curves(CONCRETE, RUBBER, SPOTS, np.geomspace(*v, 8), C8, 1e5)
    assert f"{says}" in str(found)
    assert found.as_dict()["maximum"]["cold"] is None


def test_shift_moves_the_ridge(concrete):
    """C10: the maximum of the viscoelastic part moves by the factor that is told, with temperature in the table too."""
    plain = friction_curves.compute_curves(
        persson.PerssonTheory(A, CONCRETE.road), RUBBER, SPOTS, np.geomspace(1e-6, 1e3, 80), C8, 1e5
    )
    v = plain.peak_speeds()
    at = np.exp(np.interp([C8, C8 + friction_curves.SHIFT_STEP_K], plain.T, np.log(v)))
    assert at[1] / at[0] == pytest.approx(plain.shift[0], rel=0.05)
    assert plain.shift[1] is None
    assert concrete.shift == pytest.approx((240, 171), rel=0.01)
    assert "shear stress" not in str(plain)
    assert "shear stress of the real contact to 171-fold" in str(concrete)


def test_ridge_is_unknown_where_the_maximum_is_outside(asphalt):
    assert np.isnan(asphalt.peak_speeds()[-1])


def test_remarks_tell_what_lies_outside(asphalt, concrete):
    assert not asphalt.remarks
    assert ["contact fractions reach" in r for r in concrete.remarks] == [True]
    short = rheology.MeasuredModulus((1e-4, 1e4), (1e7, 1e8), (2e6, 5e7))
    rubber = rheology.Rubber(short, rheology.MeasuredShift((283.15, 303.15), (1.0, -1.0)))
    said = friction_curves.compute_curves(
        persson.PerssonTheory(rubber, ASPHALT.road), RUBBER, SPOTS, np.geomspace(1e-2, 10, 5), C20, 1.5e5
    ).remarks
    assert any("beyond the master curve" in r for r in said)
    assert any("hot branch reaches" in r for r in said)
    assert len(set(said)) == len(said)


# --- the command ----------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def results(tmp_path_factory):
    out = tmp_path_factory.mktemp("curves") / "out"
    assert main(["friction", str(SLOPE), "contact.pressure=2e5", "--out", str(out)]) == 0
    return out


def test_the_folder_holds_curves_table_numbers_and_picture(results):
    assert sorted(f.name for f in results.iterdir()) == [
        "case.toml", "friction.csv", "friction.json", "friction.png", "mu_table.nc",
    ]  # fmt: skip
    with (results / "friction.csv").open() as file:
        rows = [{k: float(x) for k, x in row.items()} for row in csv.DictReader(file)]
    assert len(rows) == 60
    first = rows[0]
    assert first["mu_cold"] == pytest.approx(first["viscous_cold"] + first["adhesive_cold"], rel=1e-6)
    assert first["mu_cold"] == pytest.approx(float(CONCRETE(1e-6, C8, 2e5).mu), rel=1e-6)
    assert {row["held_cold"] for row in rows} == {0.0, 1.0}
    told = json.loads((results / "friction.json").read_text())
    assert (told["pressure_Pa"], told["T0_degC"], told["spot_diameter_m"]) == (2e5, 8.0, 3e-3)
    assert told["curves"]["mu_hot"][30] == pytest.approx(rows[30]["mu_hot"], rel=1e-6)
    with xr.open_dataset(results / "mu_table.nc", engine="h5netcdf") as found:
        assert found.mu.sizes == {"speed": 60, "temperature": 40}
        assert (found.speed.units, found.temperature.units, found.mu.units) == ("m/s", "degC", "1")
        at = found.mu.sel(temperature=8.0, method="nearest")
        T = float(at.temperature) + 273.15
        np.testing.assert_allclose(at, CONCRETE(found.speed.values, T, 2e5).mu, rtol=1e-9)
    assert (results / "friction.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_the_folder_holds_a_case_that_gives_the_same(results, tmp_path):
    assert load_case(results)["contact.pressure"] == 2e5
    assert main(["friction", str(results), "--out", str(tmp_path / "again")]) == 0
    assert (tmp_path / "again" / "friction.csv").read_text() == (results / "friction.csv").read_text()


@pytest.mark.long
def test_files_of_the_case_come_along(tmp_path):
    q = np.geomspace(250.0, 1e6, 20)
    np.savetxt(
        tmp_path / "C.csv",
        np.c_[q, roughness_spectrum.READY_ROADS["asphalt A"](q)],
        delimiter=",",
        header="q,C",
        comments="",
    )
    (tmp_path / "case.toml").write_text(
        'effects = ["persson_friction"]\n[contact]\npressure = [[0.0, 1e5], [5.0, 3e5]]\n'
        '[persson_friction]\nspectrum = "C.csv"\nhighest = 1e6\n'
    )
    out = tmp_path / "out"
    assert main(["friction", str(tmp_path), "--fastest", "1", "--out", str(out)]) == 0
    assert tomllib.loads((out / "case.toml").read_text())["persson_friction"]["spectrum"].startswith("inputs/")
    assert load_case(out)
    assert json.loads((out / "friction.json").read_text())["pressure_Pa"] == 3e5


@pytest.mark.long
def test_json_is_all_that_is_printed(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["friction", str(SLOPE), "friction.mu=0.5", "--slowest", "1e-5", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["out"] == str(Path("results") / "slope_tester-friction")
    assert told["curves"]["speed_m_s"][0] == pytest.approx(1e-5)
    assert told["remarks"][0].startswith("friction is that of the theory alone")
    assert main(["friction", str(SLOPE)]) == 0
    assert (tmp_path / "results" / "slope_tester-friction-2").is_dir()
    text = capsys.readouterr().out
    assert "remark: friction is" not in text
    assert "results in" in text


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["effects=[]"], 'add "persson_friction"'),
        (["--slowest", "1", "--fastest", "0.1"], "give 1e-12 <= slowest < fastest <= 1000 m/s"),
        (["--slowest", "0"], "<= slowest"),
        (["--fastest", "inf"], "fastest <="),
        (["--fastest", "nan"], "fastest <="),
        (["contact.spot_diameter=0.03"], "not below the road's longest wave, 0.0251 m"),
        (["persson_friction.rubber=B"], "persson_friction.rubber"),
    ],
)
def test_bad_wishes_are_told_in_one_line(argv, says, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["friction", str(SLOPE), *argv, "--out", str(out)]) == 2
    said = capsys.readouterr().err.strip()
    assert says in said
    assert "\n" not in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("wrong", [np.nan, -1e-6])
def test_friction_that_is_no_number_is_refused(wrong, tmp_path, capsys, monkeypatch, concrete):
    spoilt = replace(concrete, mu=np.where(np.arange(40) == 7, wrong, concrete.mu))
    monkeypatch.setattr(friction_curves, "compute_curves", lambda *a: spoilt)
    assert main(["friction", str(SLOPE), "--out", str(tmp_path / "out")]) == 2
    assert "around 8 degC; check" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_exists_is_left_alone(tmp_path, capsys):
    (tmp_path / "mine").write_text("kept")
    assert main(["friction", str(SLOPE), "--out", str(tmp_path)]) == 2
    assert "exists" in capsys.readouterr().err
    assert [f.name for f in tmp_path.iterdir()] == ["mine"]


@pytest.mark.long
def test_refuses_to_extrapolate_where_told_so(tmp_path, capsys):
    """The case itself slides within the measured range; the speeds asked for do not."""
    omega = np.geomspace(1e-2, 1e7, 80)
    E = A.modulus(omega)
    np.savetxt(
        tmp_path / "E.csv",
        np.c_[omega, E.real, E.imag],
        delimiter=",",
        header="omega (rad/s),E' (Pa),E'' (Pa)",
        comments="",
    )
    (tmp_path / "case.toml").write_text(
        'effects = ["persson_friction"]\n[schedule]\nspeed = 1e-3\ndistance = 0.01\n'
        '[persson_friction]\nmaster_curve = "E.csv"\nextrapolate = false\n'
    )
    ask = ["friction", str(tmp_path), "--slowest", "1e-4", "--out", str(tmp_path / "out")]
    assert main([*ask, "--fastest", "1e3"]) == 2
    said = capsys.readouterr().err.strip()
    assert "persson_friction.extrapolate" in said
    assert "--fastest" in said
    assert "\n" not in said
    assert not list(tmp_path.glob("out*"))
    assert main([*ask, "--fastest", "1"]) == 0


# --- the picture ----------------------------------------------------------------------------------
FOUND = {
    "concrete": (CONCRETE, C8, 1e5, (1e-6, 10.0)),
    "asphalt": (ASPHALT, C20, 1.5e5, (1e-6, 10.0)),
    "hot": (ASPHALT, 393.15, 1.5e5, (1e-3, 1.0)),
    "falling": (persson.PerssonTheory(A, CONCRETE.road), C8, 1e5, (3.0, 10.0)),
}


@pytest.mark.parametrize("name", FOUND)
@pytest.mark.sample("hot")
def test_picture_has_units_and_no_overlaps(name):
    theory, T0, p, ends = FOUND[name]
    fig = picture.draw(friction_curves.compute_curves(theory, RUBBER, SPOTS, np.geomspace(*ends, 30), T0, p), name)
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    renderer = canvas.get_renderer()
    labels = [text for ax in fig.axes for text in (ax.get_xlabel(), ax.get_ylabel()) if text]
    assert len(labels) == 9
    assert all("(" in text for text in labels)
    texts = [t for ax in fig.axes for t in (ax.xaxis.label, ax.yaxis.label, ax._left_title, *ax.texts)]
    texts += [t for ax in fig.axes if ax.get_legend() for t in ax.get_legend().get_texts()]
    boxes = [t.get_window_extent(renderer) for t in [*texts, fig._suptitle, fig._supxlabel] if t.get_text()]
    for i, box in enumerate(boxes):
        assert fig.bbox.x0 <= box.x0
        assert box.x1 <= fig.bbox.x1, texts[i].get_text()
        assert not any(box.overlaps(other) for other in boxes[:i])
    ax = fig.axes[0]
    key = ax.get_legend().get_window_extent(renderer)
    for curve in ax.lines:
        points = ax.transData.transform(curve.get_xydata())
        assert not any(key.contains(*point) for point in points[np.isfinite(points).all(axis=1)])


def test_picture_tells_what_no_tester_holds(concrete, asphalt):
    def drawn(found, style):
        ax = picture.draw(found, "x").axes[0]
        lines = [
            i for i in ax.lines if to_hex(i.get_color()) == to_hex(picture.COLD_COLOUR) and i.get_linewidth() > 1.0
        ]
        return next(i.get_ydata() for i in lines if (i.get_linestyle() == "-") == (style == "full"))

    top = find_peak(concrete.speed, concrete.cold.mu)
    full, dashed = drawn(concrete, "full"), drawn(concrete, "dashed")
    assert concrete.speed[np.isfinite(full)].max() <= 1.2 * top.at
    assert concrete.speed[np.isfinite(dashed)].min() >= 0.8 * top.at
    assert np.all(np.isfinite(full) | np.isfinite(dashed))
    assert np.all(np.isfinite(drawn(asphalt, "full")))
    assert not np.any(np.isfinite(drawn(asphalt, "dashed")))
