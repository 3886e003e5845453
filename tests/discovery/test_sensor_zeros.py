"""Zero errors of thermocouples and of their cold junction are calibrated, and effects of a camera need an image."""

from __future__ import annotations

import numpy as np
import pytest

import flashtemp
from flashtemp.camera.sensors import positions_from_rows
from flashtemp.comparison import campaign
from flashtemp.discovery.diagnostics.verdict_sentences import describe_nuisance
from flashtemp.discovery.parameters import ALL_CONDITIONS
from flashtemp.discovery.prediction.prediction import DerivativeRequest, predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.discovery.prediction.sensor_parameters import cold_junction_id, sensor_priors, sensor_zero_id

CONDUCTIVITY, HEIGHT, NOISE_K = 0.1, 0.012, 0.02
DIFFUSIVITY = CONDUCTIVITY / (250.0 * 1000.0)
CASE = f"""
effects = ["driven_faces"]
[materials.board]
conductivity = {CONDUCTIVITY}
density = 250.0
heat_capacity = 1000.0
[block]
material = "board"
length = 0.05
height = {HEIGHT}
[road]
depth = 0.001
upstream = 0.0
downstream = 0.0
[schedule]
alone = 400.0
[ambient]
convection = 0.0
[driven_faces]
face = [[0.0, 60.0]]
back = [[0.0, 20.0]]
[numerics]
cells = [3, 30, 3]
first_x = 0.0125
last_x = 0.0125
first_block = 1e-4
"""
HEIGHTS_M = {"a": 0.003, "b": 0.006}


def slab_rise(t, z):
    """Rise (times, points) of a slab whose face is stepped by 1 K; Carslaw and Jaeger 1959, section 3.4."""
    n = np.arange(1, 200)
    modes = np.sin(n * np.pi * z[:, None] / HEIGHT) / n
    decay = np.exp(-DIFFUSIVITY * (n * np.pi / HEIGHT) ** 2 * t[:, None])
    return 1.0 - z / HEIGHT - 2.0 / np.pi * decay @ modes.T


def write_campaign(folder, zeros=(0.0, 0.0), points_keys="", more=""):
    """A campaign of two thermocouples in a slab with errors `zeros` (K); its last readings are held out."""
    (folder / "case.toml").write_text(CASE)
    t, z = np.arange(20.0, 400.0, 20.0), np.array(list(HEIGHTS_M.values()))
    T = 20.0 + 40.0 * slab_rise(t, z) + zeros + NOISE_K * np.random.default_rng(3).normal(size=(len(t), 2))
    points = ", ".join(f'{{ name = "{n}", x = 0.025, z = {h}{points_keys} }}' for n, h in HEIGHTS_M.items())
    text = 'case = "case.toml"\nfree = { "materials.board.conductivity" = 0.05 }\n' + more
    for file, part, end in (("early.csv", slice(12), ""), ("late.csv", slice(12, None), "held_out = true\n")):
        np.savetxt(folder / file, np.column_stack([t, T])[part], delimiter=",")
        text += f'[[recording]]\nview = "points"\nfile = "{file}"\npoints = [{points}]\nsigma_K = {NOISE_K}\n{end}'
    (folder / "campaign.toml").write_text(text)
    return campaign.load(folder)


def prepare(made):
    return prepare_problem(made, lambda tasks: [predict_condition(t) for t in tasks])


def predicted_columns(problem):
    request = DerivativeRequest(problem.free_keys, optics=True)
    [seen] = problem.predict(problem.make_tasks(problem.stated_model, request))
    return seen.observables[problem.campaign.views[0].file].columns


def test_a_zero_error_is_calibrated_within_what_is_known_of_it(tmp_path):
    """Type K of class 1 may err by 1.5 K: 1.2 K is found, told in K, and taken along to held-out readings."""
    verdict = flashtemp.discover(
        write_campaign(tmp_path, (0.0, 1.2), more='candidates = ["conductivity_slope"]\n'), workers=1
    )
    told = {p.name: p for p in verdict.nuisance}
    difference = told["zero of point b"].value - told["zero of point a"].value
    assert difference == pytest.approx(1.2, abs=0.2)
    assert told["zero of point b"].unit == "K"
    assert told["zero of point b"].pull == pytest.approx(told["zero of point b"].value / 0.87, rel=1e-6)
    assert "cold junction of the named points" in told
    assert verdict.kind == "none_needed"
    assert verdict.base.rmse_K < 2.0 * NOISE_K
    assert verdict.base.held_out_rmse_K < 2.0 * NOISE_K


def test_a_zero_moves_its_own_point_and_a_cold_junction_all_of_them(tmp_path):
    problem = prepare(write_campaign(tmp_path))
    columns, places = predicted_columns(problem), problem.campaign.views[0].recording.places
    assert np.all(columns[sensor_zero_id("a", 0)] == [1.0, 0.0])
    assert np.all(columns[sensor_zero_id("b", 1)] == [0.0, 1.0])
    assert np.all(columns[cold_junction_id(places)] == 1.0)


def test_a_zero_that_was_corrected_is_no_unknown(tmp_path):
    problem = prepare(write_campaign(tmp_path, points_keys=", zero_sigma_K = 0.0"))
    places = problem.campaign.views[0].recording.places
    assert not {sensor_zero_id("a", 0), cold_junction_id(places)} & predicted_columns(problem).keys()


def test_named_points_have_one_zero_in_all_recordings_and_unnamed_ones_one_in_each(tmp_path):
    views = write_campaign(tmp_path).views
    priors = sensor_priors(views)
    assert priors[sensor_zero_id("b", 1)] == 0.87
    assert priors[cold_junction_id(views[0].recording.places)] == 0.5
    unnamed = positions_from_rows([{"z": 0.001}, {"z": 0.002, "zero_sigma_K": "300 mK"}])
    assert unnamed.zero_sigma_K.tolist() == [0.87, 0.3]
    own = [cold_junction_id(unnamed).with_scope(ALL_CONDITIONS, file) for file in ("day/early.csv", "late.csv")]
    assert own[0] != own[1]
    assert describe_nuisance(own[0]) == "cold junction of early.csv"
    assert describe_nuisance(sensor_zero_id("2", 1).with_scope(0, "late.csv")) == "zero of point 2 of late.csv"


def test_a_places_file_tells_the_uncertainty_of_zeros(tmp_path):
    (tmp_path / "log.csv").write_text("0;20;21\n1;22;23\n")
    given = {"view": "points", "places": tmp_path / "places.csv", "repetition": 1, "start": 0.0}
    for head, cell in (("zero_sigma_K", "0.2"), ("zero_sigma_K", "200 mK"), ("zero_sigma_k", "0.2")):
        (tmp_path / "places.csv").write_text(f"name,x,z,{head}\na,0.01,0.002,{cell}\nb,0.02,0.002,{cell}\n")
        found = flashtemp.import_recording(tmp_path / "log.csv", **given).recording
        assert found.places.zero_sigma_K == pytest.approx([0.2, 0.2])


def test_effects_of_a_camera_are_tried_where_there_is_an_image(tmp_path):
    """Without one they are left out with the reason, unless a campaign names them."""
    problem = prepare(write_campaign(tmp_path))
    assert not [c.effect for c in problem.candidates if c.is_optical]
    assert "no recording is an image" in problem.excluded_candidates["camera_offset"]
    assert {"emissivity", "reflection", "registration"} <= problem.excluded_candidates.keys()
    named = prepare(write_campaign(tmp_path, more='candidates = ["camera_offset"]\n'))
    assert [c.effect for c in named.candidates] == ["camera_offset"]
