"""Thermocouples in a block that nothing touches: fields at places, lags, held and heated faces, against closed forms."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import flashtemp
from flashtemp.camera import recording
from flashtemp.camera.prediction import synthetic_recording
from flashtemp.camera.prediction.sensor_observation import first_order_lag, required_times
from flashtemp.camera.recording import Recording
from flashtemp.camera.sensors import positions_from_rows
from flashtemp.comparison import campaign
from flashtemp.comparison.compare import compare
from flashtemp.comparison.synthetic_campaign import SEALED_TRUTH
from flashtemp.discovery.experiment_design import candidate_sensor_recordings
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.prediction.prediction import DerivativeRequest, predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.discovery.prediction.sensor_parameters import sensor_gain_id
from flashtemp.errors import BadInput
from flashtemp.model.case import load_case
from flashtemp.solver.time_integration import integrate_schedule

K, RHO, C, H = 0.08, 256.0, 1070.0, 0.01144  # a light board
D = K / (RHO * C)
CASE = f"""
free = ["materials.board.conductivity"]
effects = [EFFECTS]
[materials.board]
conductivity = {K}
density = {RHO}
heat_capacity = {C}
[block]
material = "board"
length = 0.05
height = {H}
[road]
depth = 0.001
upstream = 0.0
downstream = 0.0
[schedule]
alone = 300.0
[ambient]
convection = 0.0
[limits]
temperature = 2000.0
[numerics]
cells = [4, 80, 4]
first_x = 0.0125
last_x = 0.0125
first_block = 5e-5
rtol = 1e-6
"""


def write(folder, effects, more=""):
    named = ", ".join(f'"{e}"' for e in effects)
    (folder / "case.toml").write_text(CASE.replace("EFFECTS", named) + more)
    return folder / "case.toml"


def end(folder, effects, more="", given=None):
    """The run of a case, and its last field up the block (n,) degC at heights (n,) m."""
    case = load_case(write(folder, effects, more), given)
    run = integrate_schedule(case.scene, case.settings)
    mesh = run.mesh
    return run, run.field[-1][mesh.block[0]], 0.5 * (mesh.height[1:] + mesh.height[:-1])


def stepped(z, t, lag=0.0, terms=200):
    """Rise (t, z) in a slab whose face is 1 K warmer from t = 0 on and whose back is held, late by `lag` (s)."""
    n = np.arange(1, terms + 1)
    rate = D * (n * np.pi / H) ** 2
    t, z = np.asarray(t)[:, None, None], np.asarray(z)[None, :, None]
    fade = np.exp(-rate * t)
    steady = 1.0 - z[..., 0] / H
    if lag:
        fade = (fade - np.exp(-t / lag)) / (1.0 - rate * lag)
        steady = steady * (1.0 - np.exp(-t[..., 0] / lag))
    return steady - np.sum(2.0 / (n * np.pi) * np.sin(n * np.pi * z / H) * fade, axis=2)


def test_points_show_the_field_at_their_places_and_late(tmp_path, lab):
    """A slab stepped by 100 K, two beads in it, one of 20 s: the campaign's table is the closed form."""
    write(tmp_path, ["driven_faces"], "[driven_faces]\nface = [[0.0, 120.0]]\nback = [[0.0, 20.0]]\n")
    t, z, lags = np.linspace(10.0, 300.0, 30), np.array([0.00211, 0.0057]), (0.0, 20.0)
    T = np.stack([20.0 + 100.0 * stepped([h], t, lag)[:, 0] for h, lag in zip(z, lags, strict=True)], axis=1)
    np.savetxt(tmp_path / "t.csv", np.column_stack([t, T]), delimiter=",")
    points = ", ".join(f"{{ x = 0.025, z = {h}, lag_s = {lag} }}" for h, lag in zip(z, lags, strict=True))
    (tmp_path / "campaign.toml").write_text(
        f'case = "case.toml"\n[[recording]]\nview = "points"\nfile = "t.csv"\npoints = [{points}]\nsigma_K = 0.05\n'
    )
    [seeing] = compare(campaign.load(tmp_path)).recordings
    lab.check("points in a stepped slab, K of 100", float(np.abs(seeing.residual).max()), 0.02)
    assert np.abs(T[:, 1] - 20.0 - 100.0 * stepped(z[1:], t)[:, 0]).max() > 5.0  # the lag is seen


def test_derivatives_by_depth_and_time_constant_are_those_of_the_closed_form(tmp_path):
    """Beads at two depths and places: each column is the slope of its own bead's reading, and 0 for the other."""
    write(tmp_path, ["driven_faces"], "[driven_faces]\nface = [[0.0, 120.0]]\nback = [[0.0, 20.0]]\n")
    t, z, lags = np.linspace(10.0, 300.0, 30), (0.00211, 0.0057), (20.0, 10.0)
    (tmp_path / "t.csv").write_text("time (s),a (degC),b (degC)\n" + "".join(f"{when},20,20\n" for when in t))
    points = ", ".join(
        f'{{ name = "{name}", x = {x}, z = {h}, lag_s = {lag}, lag_sigma_s = 2.0, depth_sigma_m = 2e-4 }}'
        for name, x, h, lag in zip("ab", (0.025, 0.01), z, lags, strict=True)
    )
    (tmp_path / "campaign.toml").write_text(
        f'case = "case.toml"\n[[recording]]\nview = "points"\nfile = "t.csv"\npoints = [{points}]\nsigma_K = 0.05\n'
    )
    problem = prepare_problem(campaign.load(tmp_path), lambda tasks: [predict_condition(task) for task in tasks])
    [seen] = problem.predict(problem.make_tasks(problem.stated_model, DerivativeRequest(optics=True)))
    [shown] = seen.observables.values()
    for i, (name, h, lag) in enumerate(zip("ab", z, lags, strict=True)):
        by_depth = 100.0 * (stepped([h + 5e-5], t, lag) - stepped([h - 5e-5], t, lag))[:, 0] / 1e-4
        by_lag = 100.0 * (stepped([h], t, lag + 0.5) - stepped([h], t, lag - 0.5))[:, 0]
        for kind, axis, expected in ((ParameterKind.PLACE, (2,), by_depth), (ParameterKind.LAG, (), by_lag)):
            column = shown.columns[ParameterId(kind, axis, name=name)]
            assert column[:, i] == pytest.approx(expected, abs=0.01 * np.abs(expected).max()), (kind, name)
            assert not column[:, 1 - i].any()


def test_a_lag_is_exact_for_a_broken_line():
    t = np.array([0.0, 1.0, 4.0])
    one = 1.0 - 2.0 * (1.0 - np.exp(-0.5))
    after = 1.0 - 2.0 * 0.0 + (one - 1.0) * np.exp(-1.5)
    assert first_order_lag(t, np.array([0.0, 1.0, 1.0]), 2.0) == pytest.approx([0.0, one, after])


def test_a_lag_asks_for_fields_before_its_readings():
    places = positions_from_rows([{"z": 0.001}, {"z": 0.001, "lag_s": 2.0}])
    found = required_times(places, np.array([100.0, 100.1]))
    assert {100.0, 100.1} <= set(found.tolist())
    assert found.min() == pytest.approx(84.0)
    assert required_times(places.perturb_key("z", 1e-4), np.array([1.0])).min() > 0


def test_radiation_film_and_heater_balance_exactly_at_1000_K(tmp_path, lab):
    """Steady: a G + h (T_a - T) + eps sigma (T_a^4 - T^4) = k (T - T_b)/H, on a first cell of 1 mm."""
    effects = ["heated_face", "radiation", "driven_faces"]
    more = (
        "[heated_face]\nirradiance = 8e4\nabsorptivity = 0.9\nfilm = 12.0\n[radiation]\nemissivity = 0.0\nface = 0.8\n"
        "[driven_faces]\nback = [[0.0, 20.0]]\n"
    )
    run, T, z = end(tmp_path, effects, more, {"numerics.first_block": 1e-3, "schedule.alone": 2e4})

    def left(Ts):
        out = 12.0 * (Ts - 293.15) + 0.8 * 5.670374419e-8 * (Ts**4 - 293.15**4)
        return 0.9 * 8e4 - out - K * (Ts - 293.15) / H

    Ts = brentq(left, 300.0, 2000.0)
    assert Ts > 1000.0
    lab.check("face under a heater, K", float(np.abs(run.T_block[-1] + 273.15 - Ts).max()), 0.01)
    lab.check("board behind it, K", float(np.abs(T + 273.15 - (Ts - (Ts - 293.15) * z / H)).max()), 0.02)
    assert run.energy_imbalance < 1e-9


def test_radiation_of_the_back_balances_the_heat_that_is_conducted_to_it(tmp_path, lab):
    """Steady, face held at 800 degC: k (T_f - T)/H = eps sigma (T^4 - T_a^4); a grey back of 0.7 on a cell of 1 mm."""
    more = "[radiation]\nemissivity = 0.0\nback = 0.7\n[driven_faces]\nface = [[0.0, 800.0]]\n"
    run, T, z = end(
        tmp_path, ["radiation", "driven_faces"], more, {"numerics.first_block": 1e-3, "schedule.alone": 2e4}
    )
    face = 1073.15

    def left(T):
        return K * (face - T) / H - 0.7 * 5.670374419e-8 * (T**4 - 293.15**4)

    back = brentq(left, 293.15, face)
    assert 300.0 < back < 800.0
    lab.check("slab whose back radiates, K", float(np.abs(T + 273.15 - (face - (face - back) * z / H)).max()), 0.02)
    assert run.energy_imbalance < 1e-9


def test_heat_absorbed_in_depth_follows_beer(tmp_path, lab):
    """Steady, face insulated, back held: T = q/(k w) [(H - z) - d (exp(-z/d) - exp(-H/d))], w = 1 - exp(-H/d)."""
    q, d = 500.0, 2e-3
    more = (
        f"[heated_face]\nirradiance = {q}\nabsorptivity = 1.0\nin_depth = 1.0\ndepth = {d}\n"
        "[driven_faces]\nback = [[0.0, 20.0]]\n"
    )
    _, T, z = end(tmp_path, ["heated_face", "driven_faces"], more, {"schedule.alone": 2e4})
    whole = 1.0 - np.exp(-H / d)
    exact = q / (K * whole) * ((H - z) - d * (np.exp(-z / d) - np.exp(-H / d)))
    lab.check("absorbed in depth, of the largest rise", float(np.abs(T - 20.0 - exact).max() / exact.max()), 2e-4)


def test_the_heater_follows_its_course_and_its_profile(tmp_path, lab):
    """All that it sends stays in an insulated board: q W integral of course times mean of profile."""
    more = (
        "[heated_face]\nirradiance = 1000.0\nabsorptivity = 0.5\nin_depth = 0.3\ncourse = [[0.0, 0.0], [100.0, 1.0]]\n"
        "place = [[0.0, 0.0], [0.05, 1.0]]\n"
    )
    run, *_ = end(tmp_path, ["heated_face"], more)
    given = 0.5 * 1000.0 * 0.05 * 0.5 * (50.0 + 200.0)
    lab.check("heat in the board, relative", abs(run.energy["block"][-1] / given - 1.0), 1e-4)


def test_nothing_acts_on_the_face_while_it_slides(tmp_path):
    """A heater and a held face are of a block that nothing touches: under the contact they are off."""
    effects = ["heated_face", "driven_faces"]
    more = "[driven_faces]\nface = [[0.0, 120.0]]\n"
    case = load_case(write(tmp_path, effects, more))
    on = dict(case.values["schedule"])
    assert on["alone"] == 300.0
    given = {"schedule.alone": None}
    text = (tmp_path / "case.toml").read_text().replace("alone = 300.0", "distance = 0.1")
    (tmp_path / "case.toml").write_text(text)
    hot, cold = load_case(tmp_path / "case.toml"), load_case(tmp_path / "case.toml", {"effects": []})
    a, b = (integrate_schedule(c.scene, c.settings).T_block[-1] for c in (hot, cold))
    assert np.array_equal(a, b), given


def test_a_recording_of_points_survives_its_file(tmp_path):
    rows = [
        {"name": "bead", "x": 0.01, "y": -0.002, "z": 0.003, "lag_s": 1.5, "place_sigma_m": 5e-4, "gain_sigma": 0.01}
    ]
    rows.append({"z": -0.001, "depth_sigma_m": 1e-3})
    made = Recording(
        "points", np.array([[[20.0, 21.0]], [[22.0, np.nan]]]), np.array([0.0, 1.0]), np.array([1, 1]),
        np.arange(2.0), np.zeros(1), places=positions_from_rows(rows),
    )  # fmt: skip
    made.save(tmp_path / "p.nc")
    read = recording.load(tmp_path / "p.nc")
    assert read.places.as_rows() == made.places.as_rows()
    assert np.array_equal(read.temperature, made.temperature, equal_nan=True)
    assert "2 points" in str(read)


def logged(folder, text, places="column,name,x,z\n2,inner,0.01,0.002\n3,outer,0.02,-0.001\n"):
    (folder / "log.csv").write_text(text)
    (folder / "places.csv").write_text(places)
    return {"view": "points", "places": folder / "places.csv", "repetition": 1}


def test_a_table_of_a_logger_is_imported(tmp_path):
    """Decimal commas, a header, date and time; columns in any order and one that is not a thermocouple's."""
    text = "Datum;T1;T2;Volt\n" + "".join(f"2024-05-31 12:00:{s:02d};{20 + s},5;{30 + s},25;0,1\n" for s in range(12))
    places = "name,column,z,x,lag_s\nouter,3,-0.001,0.02,0.5\ninner,2,0.002,0.01,0\n"
    told = logged(tmp_path, text, places)
    found = flashtemp.import_recording(
        tmp_path / "log.csv", out=tmp_path / "log.nc", zero="2024-05-31T12:00:02", unit="degC", **told
    )
    back = recording.load(tmp_path / "log.nc")
    np.testing.assert_allclose(back.time, np.arange(12) - 2.0)
    np.testing.assert_allclose(back.temperature[:, 0, 0], 30.25 + np.arange(12))
    np.testing.assert_allclose(back.temperature[:, 0, 1], 20.5 + np.arange(12))
    assert back.places.names == ("outer", "inner")
    assert back.places.lag_s.tolist() == [0.5, 0.0]
    assert found.picture is not None
    assert found.picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        ("31.05.2024;12:00:03,25;20,5;21,5\n31.05.2024;12:00:04,25;22,5;23,5\n", (3, 4)),
        ("2024-05-31 12:00:03.25,20.5,21.5\n2024-05-31 12:00:04.25,22.5,23.5\n", (2, 3)),
        ('"31.05.2024"\t"12:00:03"\t20,5\t21,5\n"31.05.2024"\t"12:00:04"\t22,5\t23,5\n', (3, 4)),
        ("31.05.2024,12:00:03,20.5,21.5\n31.05.2024,12:00:04,22.5,23.5\n", (3, 4)),
    ],
    ids=["date and time apart, decimal commas", "one cell", "quoted", "commas between cells"],
)
def test_dates_and_times_of_loggers_are_read_as_they_write_them(tmp_path, rows, columns):
    places = "".join(f"{c},t{c},0.01,0.00{c}\n" for c in columns)
    told = logged(tmp_path, "Datum;Uhrzeit;T1;T2\n" + rows, "column,name,x,z\n" + places)
    found = flashtemp.import_recording(tmp_path / "log.csv", zero="2024-05-31T12:00:02", **told).recording
    assert found.time == pytest.approx([1.25, 2.25] if "03,25" in rows or "03.25" in rows else [1.0, 2.0], abs=1e-6)
    assert found.temperature[:, 0].tolist() == [[20.5, 21.5], [22.5, 23.5]]


def test_places_may_have_units(tmp_path):
    told = logged(
        tmp_path, "0;20;21\n1;22;23\n", "name,x,z,lag_s,depth_sigma_m\na,10 mm,2mm,500 ms,1 mm\nb,0.02,-1 mm,0.1,2e-4\n"
    )
    places = flashtemp.import_recording(tmp_path / "log.csv", start=0.0, **told).recording.places.as_rows()
    assert [(p["x"], p["z"], p["lag_s"], p["depth_sigma_m"]) for p in places] == [
        (0.01, 0.002, 0.5, 1e-3), (0.02, -0.001, 0.1, 2e-4),
    ]  # fmt: skip
    (tmp_path / "places.csv").write_text("name,x,z\na,10 s,0.002\n")
    with pytest.raises(BadInput, match="thermocouple 1: x: '10 s' is not a quantity in m"):
        flashtemp.import_recording(tmp_path / "log.csv", start=0.0, **told)


def test_one_thermocouple_with_date_and_time_is_a_table(tmp_path):
    told = logged(tmp_path, "2024-05-31 12:00:03;20,5\n2024-05-31 12:00:04;21,5\n", "name,x,z\na,0.01,0.002\n")
    found = flashtemp.import_recording(tmp_path / "log.csv", start=0.0, **told).recording
    assert (found.time.tolist(), found.temperature.ravel().tolist()) == ([0.0, 1.0], [20.5, 21.5])


def test_a_table_without_times_takes_the_rate(tmp_path):
    """Column 1 is the time unless a thermocouple is in it."""
    told = logged(tmp_path, "20.0\t30.0\n21.0\t31.0\n22.0\t32.0\n", "name,x,z,column\na,0.01,0.002,1\nb,0.02,0.002,2\n")
    with pytest.raises(BadInput, match="give --fps"):
        flashtemp.import_recording(tmp_path / "log.csv", start=0.0, **told)
    found = flashtemp.import_recording(tmp_path / "log.csv", start=-0.5, fps=2.0, **told)
    assert found.recording.time.tolist() == [-0.5, 0.0, 0.5]
    assert found.recording.temperature[:, 0, 1].tolist() == [30.0, 31.0, 32.0]


@pytest.mark.parametrize(
    ("text", "changes", "said"),
    [
        ("0,20,30\n1,21,31\n2,22,32\n", {"places": None}, "places: missing; where the thermocouples sit"),
        ("0,20,30\n1,21,31\n2,22,32\n", {"emissivity": 0.9}, "--emissivity: belongs to images"),
        ("0,20,30\n1,21,31\n1,22,32\n", {}, "log.csv:3: time goes from 1 to 1; it must increase"),
        ("0;20\n1;21\n2;22\n", {}, "2 columns, but a thermocouple is in column 3"),
        ("0,20,30\n1,2O.1,31\n2,22,32\n", {}, "'2O.1' in column 2 is no number"),
        ("0,20,30\nx,21,31\n2,22,32\n", {}, "'x' in column 1 is no time"),
        ("0,20,30\n1,21,31\n2,22,32\n", {"view": "wake"}, "places: belong to thermocouples"),
    ],
)
def test_a_logger_table_that_cannot_be_read_is_told(tmp_path, text, changes, said):
    told = logged(tmp_path, text) | changes
    with pytest.raises(BadInput, match=said):
        flashtemp.import_recording(tmp_path / "log.csv", **told)


@pytest.mark.parametrize(
    ("places", "said"),
    [
        ("", "the file is empty|not text"),
        ("x,z\n", "no thermocouple in it"),
        ("x,depth\n0.01,0.002\n", "'depth': unknown column"),
        ("x,z\n0.01\n", "1 values for 2 names"),
        ("x,z\n0.01,deep\n", "z: 'deep'; give a number"),
        ("column,z\n2,0.002\n2,0.003\n", "column: 2; give each its own"),
        ("x\n0.01\n", "z: missing"),
    ],
)
def test_places_that_cannot_be_read_are_told(tmp_path, places, said):
    told = logged(tmp_path, "0,20,30\n1,21,31\n2,22,32\n", places)
    with pytest.raises(BadInput, match=said):
        flashtemp.import_recording(tmp_path / "log.csv", **told)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([{"x": 0.01}], "z: missing"),
        ([{"z": 0.001, "depth": 1}], "depth: unknown key"),
        ([{"z": "deep"}], "z: 'deep'; give a number (m)"),
        ([{"z": 0.001, "lag_s": -1.0}], "lag_s: -1 of a point; give 0 to 10000 s"),
        ([{"z": 0.001, "gain_sigma": 0.5}], "gain_sigma: 0.5 of a point; give 0 to 0.2 1"),
        (3, "give a table per point"),
    ],
)
def test_places_that_cannot_be_are_refused(rows, said):
    with pytest.raises(BadInput) as fault:
        positions_from_rows(rows)
    assert said in str(fault.value)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("points = [{ z = 0.02 }]", "z = 0.02 m lies outside what is simulated, -0.001 to 0.01144 m"),
        ("points = [{ z = 0.001 }, { z = 0.002 }]", "has 2 values; give 3 numbers per row"),
        ('view = "wake"\npoints = [{ z = 0.001 }]', "points belong to view"),
    ],
)
def test_campaigns_refuse_points_that_do_not_fit(tmp_path, entry, said):
    write(tmp_path, ["driven_faces"], "[driven_faces]\nface = [[0.0, 120.0]]\n")
    (tmp_path / "t.csv").write_text("0,20\n10,21\n")
    (tmp_path / "campaign.toml").write_text(f'case = "case.toml"\n[[recording]]\nfile = "t.csv"\n{entry}\n')
    with pytest.raises(BadInput) as fault:
        compare(campaign.load(tmp_path))
    assert said in str(fault.value)


@pytest.mark.parametrize(
    ("table", "remedy"),
    [
        ("0,165\n10,166\n", "write it in a header line above the numbers, e.g. 'time (s), T1 (degC)'"),
        ("time,T1\n0,165\n10,166\n", "write it in the header of its column, e.g. 'T1 (degC)'"),
        ("time,T1 (mV)\n0,165\n10,166\n", "write degC, K or degF there, or name the column of the point"),
        ("time,T1 (K)\n0,20\n10,21\n", "write degC instead"),
        ("time,T1 (degC),T2\n0,,1\n10,,1\n", "leave its point out"),
        ("time,T1 (degC)\n0,20\n10,9999\n", "else correct the unit in the header"),
    ],
)
def test_campaigns_tell_how_their_tables_state_the_unit(tmp_path, table, remedy):
    """A campaign has no options of the command line; the remedy of the first two is tried."""
    write(tmp_path, ["driven_faces"], "[driven_faces]\nface = [[0.0, 120.0]]\n")
    (tmp_path / "t.csv").write_text(table)
    (tmp_path / "campaign.toml").write_text(
        'case = "case.toml"\n[[recording]]\nfile = "t.csv"\npoints = [{ name = "T1", z = 0.001 }]\n'
    )
    with pytest.raises(BadInput) as fault:
        campaign.load(tmp_path)
    assert remedy in str(fault.value)
    assert "t.csv" in str(fault.value)
    assert "--" not in str(fault.value)
    (tmp_path / "t.csv").write_text("time (s), T1 (degC)\n0,165\n10,166\n")
    assert campaign.load(tmp_path).views[0].recording.temperature.max() == 166.0


@pytest.mark.long
def test_a_twin_of_thermocouples_gives_its_slope_and_its_beads_back(tmp_path):
    """Beads up to 1 mm from where they are said to be (0.3 mm known), conductivity 4 % off: both come back."""
    effects = "[driven_faces]\nface = [[0.0, 20.0], [100.0, 400.0]]\nback = [[0.0, 20.0], [300.0, 100.0]]\n"
    case = load_case(write(tmp_path, ["driven_faces"], effects), {"numerics.cells": [3, 30, 3], "numerics.rtol": 1e-4})
    beads = [
        {"name": n, "x": 0.02, "z": z, "place_sigma_m": 3e-4} for n, z in (("a", 0.003), ("b", 0.006), ("c", 0.009))
    ]
    made = flashtemp.twin(
        case, hide=["conductivity_slope"], seed=3, out=tmp_path / "twin", conditions=1, views=["points"], points=beads
    )
    truth = json.loads((tmp_path / "twin" / SEALED_TRUTH).read_text())
    found = flashtemp.discover(replace(made.campaign(), candidates=("conductivity_slope", "capacity_slope")), workers=1)
    assert [c.effect for c in found.causes] == ["conductivity_slope"]
    hidden = truth["hidden"]["conductivity_slope"]["block"]
    [slope] = [p for p in found.causes[0].parameters if p.name.endswith("block")]
    assert abs(slope.value - hidden) < 0.02 * abs(hidden)


@pytest.mark.long
def test_the_next_thermocouple_belongs_where_the_unknown_heat_goes(tmp_path):
    """Face held, back insulated: what leaves through the back is seen best at the back."""
    case = write(tmp_path, ["driven_faces"], "[driven_faces]\nface = [[0.0, 120.0]]\n")
    case.write_text(case.read_text().replace("4, 80, 4", "3, 20, 3").replace("1e-6", "1e-4"))
    (tmp_path / "campaign.toml").write_text(
        'case = "case.toml"\nfree = ["materials.board.conductivity"]\ncandidates = ["holder_sink"]\n'
        '[[recording]]\nview = "points"\npoints = [{ x = 0.025, z = 0.002 }]\nsigma_K = 0.1\n'
    )
    outlook = flashtemp.plan(tmp_path, workers=1)
    best = outlook.sensors[0]
    assert best.words == "at x = 25 mm, z = 11.2 mm"  # the node nearest the back
    assert best.z_left["holder_sink"] > 2.0 * outlook.sensors[-1].z_left["holder_sink"]
    assert "next thermocouple at x = 25 mm, z = 11.2 mm" in str(outlook)
    assert not outlook.experiments or all("speed" not in e.words for e in outlook.experiments)


# --- time constants ---------------------------------------------------------------------------------------
def slow(folder, known, truth=6.0, told=2.0):
    """A campaign of two beads in a slab that is stepped by 100 K, the first slower than told, by the closed form."""
    case = write(folder, ["driven_faces"], "[driven_faces]\nface = [[0.0, 120.0]]\nback = [[0.0, 20.0]]\n")
    case.write_text(case.read_text().replace("4, 80, 4", "3, 40, 3").replace("1e-6", "1e-5"))
    t, z = np.arange(10.0, 300.0, 5.0), (0.003, 0.006)
    T = np.stack([20.0 + 100.0 * stepped([h], t, lag)[:, 0] for h, lag in zip(z, (truth, told), strict=True)], axis=1)
    T += 0.05 * np.random.default_rng(3).normal(size=T.shape)
    np.savetxt(folder / "t.csv", np.column_stack([t, T]), delimiter=",")
    points = ", ".join(
        f'{{ name = "{n}", x = 0.025, z = {h}, lag_s = {told}, lag_sigma_s = {known} }}'
        for n, h in zip("ab", z, strict=True)
    )
    (folder / "campaign.toml").write_text(
        'case = "case.toml"\ncandidates = ["conductivity_slope"]\n[[recording]]\nview = "points"\n'
        f'file = "t.csv"\npoints = [{points}]\nsigma_K = 0.05\n'
    )
    return campaign.load(folder)


@pytest.mark.parametrize(
    ("truth", "told"),
    [(1.0, 0.0), pytest.param(6.0, 2.0, marks=pytest.mark.long), pytest.param(0.0, 1.0, marks=pytest.mark.long)],
)
def test_a_time_constant_is_calibrated_within_what_is_known_of_it(tmp_path, truth, told):
    """Found within three standard errors, from and down to none at all, and told in the verdict."""
    verdict = flashtemp.discover(slow(tmp_path, 3.0, truth, told), workers=1)
    known = {p.name: p for p in verdict.nuisance}
    a, b = known["time constant of point a"], known["time constant of point b"]
    assert abs(a.value - (truth - told)) < 3.0 * a.stderr
    assert abs(b.value) < 3.0 * b.stderr
    assert max(a.stderr, b.stderr) < 0.3
    assert a.unit == "s"
    assert verdict.kind == "none_needed"
    assert verdict.base.rmse_K < 0.06
    assert "time constant of point a" in verdict.as_dict()["nuisance"]


def test_twins_are_late_by_what_is_drawn_and_never_early(tmp_path):
    recording = slow(tmp_path, 3.0, told=1.0).views[0].recording
    drawn = [synthetic_recording.draw_errors(recording, np.random.default_rng(s), 1.0).lags for s in range(200)]
    assert np.std(drawn) == pytest.approx(3.0, rel=0.15)
    scene = load_case(tmp_path / "case.toml").scene
    times = tuple(required_times(recording.places, recording.time).tolist())
    run = integrate_schedule(scene, replace(load_case(tmp_path / "case.toml").settings, times=times, fields=2))
    shown = {}
    for lags in ((0.0, 5.0), (-1.0, 0.0), (-9.0, 0.0)):
        faults = synthetic_recording.SyntheticRecordingErrors((0.0, 0.0), 0.0, 1.0, 0.0, lags=lags)
        shown[lags] = synthetic_recording.render_recording(
            run, scene, recording, faults, np.random.default_rng(1)
        ).temperature[:, 0]
    assert np.array_equal(shown[-1.0, 0.0], shown[-9.0, 0.0])  # as fast as can be
    late = 100.0 * (stepped([0.006], recording.time, 6.0) - stepped([0.006], recording.time, 1.0))[:, 0]
    assert (shown[0.0, 5.0] - shown[-1.0, 0.0])[:, 1] == pytest.approx(late, abs=0.05)


# --- gains ----------------------------------------------------------------------------------------------
def gauged(folder, sigma, off=0.01):
    """A campaign of two beads in a slab that is stepped by 100 K, of which the first shows 1 % more than its rise."""
    case = write(folder, ["driven_faces"], "[driven_faces]\nface = [[0.0, 120.0]]\nback = [[0.0, 20.0]]\n")
    case.write_text(case.read_text().replace("4, 80, 4", "3, 30, 3").replace("1e-6", "1e-4"))
    t, z = np.arange(20.0, 300.0, 20.0), np.array([0.003, 0.006])
    T = 20.0 + 100.0 * stepped(z, t) * np.array([1.0 + off, 1.0])
    T += 0.02 * np.random.default_rng(7).normal(size=T.shape)
    np.savetxt(folder / "t.csv", np.column_stack([t, T]), delimiter=",")
    points = ", ".join(
        f'{{ name = "{n}", x = 0.025, z = {h}, gain_sigma = {sigma}, zero_sigma_K = 0 }}'
        for n, h in zip("ab", z, strict=True)
    )
    (folder / "campaign.toml").write_text(
        'case = "case.toml"\ncandidates = ["conductivity_slope"]\n[[recording]]\nview = "points"\n'
        f'file = "t.csv"\npoints = [{points}]\nsigma_K = 0.02\n'
    )
    return campaign.load(folder)


def test_a_gain_is_calibrated_within_what_is_known_of_it(tmp_path):
    """1 % too much, 0.5 % usual: found within three standard errors, told in the verdict, and left over where none may be."""
    verdict = flashtemp.discover(gauged(tmp_path, 0.005), out=tmp_path / "found", workers=1)
    told = {p.name: p for p in verdict.nuisance}
    a, b = told["gain of point a"], told["gain of point b"]
    assert abs(a.value - b.value - 0.01) < 3.0 * np.hypot(a.stderr, b.stderr)
    assert a.pull == pytest.approx(a.value / 0.005, rel=1e-6)
    assert a.stderr < 0.005
    assert verdict.base.rmse_K < 0.03
    assert "gain of point a" in (tmp_path / "found" / "verdict.json").read_text()


@pytest.mark.long
def test_without_a_gain_the_same_is_left_over(tmp_path):
    """A conductivity alone cannot make one of two beads show 1 % more: several times the noise is left."""
    verdict = flashtemp.discover(gauged(tmp_path, 0.0), workers=1)
    assert not [p for p in verdict.nuisance if p.name.startswith("gain")]
    assert verdict.base.rmse_K > 0.06


def test_a_gain_moves_the_rise_of_its_own_point(tmp_path):
    made = gauged(tmp_path, 0.005)
    problem = prepare_problem(made, lambda tasks: [predict_condition(t) for t in tasks])
    [seen] = problem.predict(
        problem.make_tasks(problem.stated_model, DerivativeRequest(problem.free_keys, optics=True))
    )
    shown = seen.observables[made.views[0].file]
    column = shown.columns[sensor_gain_id("b", 1)]
    rise = shown.values[:, 0] - 20.0
    assert np.array_equal(column[:, 0], 0.0 * rise[:, 0])
    assert column[:, 1] == pytest.approx(rise[:, 1], rel=1e-6)


def test_twins_and_places_for_one_more_thermocouple_have_gains(tmp_path):
    """A gain is drawn within its standard deviation and shown; one more thermocouple is as good as those that there are."""
    made = gauged(tmp_path, 0.05)
    problem = prepare_problem(made, lambda tasks: [predict_condition(t) for t in tasks])
    assert all(v.recording.places.gain_sigma == 0.05 for v in candidate_sensor_recordings(problem))
    scene, recording = problem.case.scene, made.views[0].recording
    drawn = [synthetic_recording.draw_errors(recording, np.random.default_rng(s), 1.0).gains for s in range(200)]
    assert np.std(drawn) == pytest.approx(0.05, rel=0.15)
    run = integrate_schedule(scene, replace(problem.case.settings, times=tuple(recording.time), fields=2))
    plain, larger = (
        synthetic_recording.render_recording(
            run,
            scene,
            recording,
            synthetic_recording.SyntheticRecordingErrors((0.0, 0.0), 0.0, 1.0, 0.0, (), g),
            np.random.default_rng(1),
        )
        for g in ((), (0.1, 0.0))
    )
    more = (larger.temperature - plain.temperature)[:, 0]
    assert more == pytest.approx(0.1 * (plain.temperature[:, 0] - 20.0) * np.array([1.0, 0.0]), abs=1e-9)


def test_depth_is_known_like_the_place_unless_said(tmp_path):
    places = positions_from_rows(
        [{"z": 0.001, "place_sigma_m": 2e-4}, {"z": 0.001, "depth_sigma_m": "1 mm", "place_sigma_m": 2e-4}]
    )
    assert [places.place_sigma(axis).tolist() for axis in range(3)] == [[2e-4, 2e-4], [2e-4, 2e-4], [2e-4, 1e-3]]
