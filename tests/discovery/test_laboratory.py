"""Errors of the laboratory: images turned, scaled and mirrored, clocks, sizes of the block, keys stated wrongly."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from flashtemp.camera.image_placement import ImagePlacement
from flashtemp.camera.importing.rectification import _interpolate_image
from flashtemp.camera.prediction.pixel_sampling import PixelAxis, sample_rotated
from flashtemp.camera.radiometry import LONG_WAVE
from flashtemp.camera.recording import Recording
from flashtemp.comparison import campaign
from flashtemp.comparison.synthetic_campaign import SEALED_TRUTH, SyntheticPlan, make_synthetic_campaign
from flashtemp.discovery import engine
from flashtemp.discovery.estimation.nuisance_priors import position_sd_px
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.prediction import prediction
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.model.case import load_case
from flashtemp.runs.results.worker_pool import open_worker_pool

TINY = {
    "block.height": 0.005, "schedule.distance": 0.3, "road.track_length": 0.3, "numerics.mesh": 0.4,
    "output.profiles": 20,
}  # fmt: skip
PITCH, WIDTH = 2.5e-4, 0.7 * 2.5e-4
U, V = np.arange(-1e-3, 0.026, PITCH), np.arange(-1e-3, 0.008, PITCH)
MIDDLE = 0.0125


# --- where an image may lie ---------------------------------------------------------------------------------
def test_an_image_is_as_far_off_as_any_point_about_which_it_turned_makes_it():
    """Points drawn anywhere in an image of 48 x 12 mm that is turned by 9 mrad: where its middle lies."""
    u, v = np.arange(0.0, 0.048, 3e-4), np.arange(0.0, 0.012, 3e-4)
    frames = np.full((1, len(v), len(u)), 20.0)
    x, z = np.random.default_rng(1).uniform(-0.5, 0.5, (2, 100_000)) * np.array([[np.ptp(u)], [np.ptp(v)]])
    r = Recording("sidewall", frames, np.zeros(1), np.ones(1, int), u, v, registration_sigma_px=0.2)
    for axis, moved in ((0, z), (1, x)):
        off = np.hypot(0.2, 9e-3 * moved.std() / 3e-4)
        assert position_sd_px(r, ImagePlacement(turn=9e-3), axis) == pytest.approx(off, rel=0.01)
        assert position_sd_px(r, ImagePlacement(scale=0.003), axis) == 0.2  # grows from the corner that was marked
    assert (
        position_sd_px(replace(r, view="wake"), ImagePlacement(turn=9e-3), 0) == 0.2
    )  # lined up along the block's edge


# --- an image that is turned or scaled ----------------------------------------------------------------------
def bump(x, z, w=1.5e-3):
    """A round hill of width w about a point of the wall."""
    return np.exp(-0.5 * ((x - 0.018) ** 2 + (z - 0.003) ** 2) / w**2)


def seen_turned(degrees, kept=None, step=0.0, slopes=False, nodes=(1001, 281)):
    along, up = np.linspace(0.0, 0.025, nodes[0]), np.linspace(0.0, 0.007, nodes[1])
    field = bump(along[None], up[:, None])[None]
    axes = PixelAxis(U, PITCH, WIDTH), PixelAxis(V, PITCH, WIDTH)
    return sample_rotated(field, (along, up), axes, np.radians(degrees) + step, (MIDDLE, 0.0), kept, slopes)


@pytest.mark.parametrize("degrees", [*(pytest.param(d, marks=pytest.mark.long) for d in (1e-9, 0.3)), 1.0, -5.0])
def test_a_turned_image_shows_a_round_hill_where_it_lies(degrees):
    """A hill that is a Gaussian, seen through a Gaussian, is a wider and lower one: whatever the turn, exactly."""
    a = np.radians(degrees)
    x = MIDDLE + (U[None] - MIDDLE) * np.cos(a) - V[:, None] * np.sin(a)
    z = (U[None] - MIDDLE) * np.sin(a) + V[:, None] * np.cos(a)
    w2 = 1.5e-3**2 + WIDTH**2 + PITCH**2 / 12.0  # a box is as wide as a Gaussian of its second moment, to 2e-5 here
    wanted = 1.5e-3**2 / w2 * np.exp(-0.5 * ((x - 0.018) ** 2 + (z - 0.003) ** 2) / w2)
    near = (abs(x - 0.018) < 5e-3) & (z > 1e-3) & (z < 6e-3)
    assert near.sum() > 400
    second = a**2 * (w2 / 1.5e-3**2 - 1.0)  # what two shears leave of the optics, over the hill's own curvature
    np.testing.assert_allclose(seen_turned(degrees).seen[0][near], wanted[near], atol=1e-4 + second)


def test_images_with_common_matrices_are_what_each_is_alone():
    few = {"nodes": (251, 71)}
    kept, alone = {}, {degrees: seen_turned(degrees, **few).seen for degrees in (0.3, -5.0)}
    for degrees in (0.3, -5.0, 0.3):
        for slopes in (False, True, False):
            np.testing.assert_array_equal(seen_turned(degrees, kept, 0.0, slopes, **few).seen, alone[degrees])


# --- a small campaign, altered ------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """One condition, side wall only, nothing hidden."""
    folder = tmp_path_factory.mktemp("tiny")
    (folder / "case.toml").write_text("")
    return campaign.load(
        make_synthetic_campaign(
            load_case(folder / "case.toml", TINY), SyntheticPlan((), 41, 1, ("sidewall",), 3), folder / "lab"
        )
    )


def altered(told, change):
    [view] = told.views
    return replace(told, views=(replace(view, recording=change(view.recording)),))


def mirrored(r, length):
    """The recording with the block's ends exchanged."""
    return replace(r, u=length - r.u[::-1], temperature=r.temperature[..., ::-1])


def test_a_scale_that_is_off_and_a_mirror_are_found(tiny):
    """Both at once: pixels told 0.8 % too large, and the ends exchanged.  A whole discovery names the mirror."""

    def worse(r):
        return mirrored(replace(r, u=r.u * 1.008, v=r.v * 1.008), 0.025)

    verdict, found = engine.discover(replace(altered(tiny, worse), candidates=()), workers=1)
    assert (verdict.kind, [c.effect for c in verdict.causes]) == ("named", ["mirrored"])
    assert [(e.kind, e.files) for e in found.recording_errors] == [("mirrored", ("condition1_sidewall.nc",))]
    base, p = found.base, ParameterId(ParameterKind.SCALE, file="condition1_sidewall.nc")
    assert base.is_converged
    parts = (p, ParameterId(ParameterKind.SCALE, name="sidewall"))  # its own, and what all images of its view share
    at = [base.solution.names.index(q) for q in parts]
    scale = base.model.placements[p.file].scale + sum(base.solution[q] for q in parts)
    sd = float(np.sqrt(base.solution.covariance[np.ix_(at, at)].sum()))
    assert abs(scale - (1.0 / 1.008 - 1.0)) < 4.0 * sd
    assert sd < 3e-3  # the data know it
    assert abs(base.solution.chi2 / base.solution.count - 1.0) < 5.0 * np.sqrt(2.0 / base.solution.count)


@pytest.mark.long
def test_a_block_much_longer_than_told_is_found(tmp_path, calibrate):
    """Nearly four times what a ruler may be off by: from the length that was told no fit gets there."""
    told = 0.0241
    (tmp_path / "case.toml").write_text("")
    lab = make_synthetic_campaign(
        load_case(tmp_path / "case.toml", TINY), SyntheticPlan((), 43, 1, ("sidewall", "wake"), 12), tmp_path / "lab"
    )
    text = (lab / "case.toml").read_text()
    assert "length = 0.025" in text
    (lab / "case.toml").write_text(text.replace("length = 0.025", f"length = {told}"))
    base, p = calibrate(campaign.load(lab)).base, ParameterId(ParameterKind.SIZE, name="block.length")
    found = told * (1.0 + base.model.sizes[p.name] + base.solution[p])
    assert base.is_comparable
    assert abs(found - 0.025) < min(1e-4, 3.0 * told * base.solution.sd(p))


@pytest.mark.parametrize("kind", [ParameterKind.SCALE, ParameterKind.TURN])
@pytest.mark.parametrize("where", [(0.0, 0.0, 0.0), (0.006, 0.012, 0.4)])
def test_columns_of_scale_and_turn_are_differences_of_images(tiny, kind, where):
    """Wherever the image lies already: pixels that are larger also see more at once."""
    scale, turn, shift = where
    problem = prepare_problem(tiny, lambda tasks: [prediction.predict_condition(t) for t in tasks])
    [view] = tiny.views
    p, step = ParameterId(kind, file=view.file), 2e-4
    model = problem.stated_model.with_step(ParameterId(ParameterKind.SCALE, file=view.file), scale)
    model = replace(
        model.with_step(ParameterId(ParameterKind.TURN, file=view.file), turn), shifts={view.file: (shift, 0.0)}
    )

    def seen(model, **derivatives):
        [made] = problem.predict(problem.make_tasks(model, prediction.DerivativeRequest(**derivatives)))
        return made.observables[view.file]

    there = seen(model, model_parameters=problem.free_keys, optics=True)
    ahead, behind = (seen(model.with_step(p, s)).values[:, there.inside] for s in (step, -step))
    slope = (ahead - behind) / (2.0 * step)
    off = there.columns[ParameterId(kind)] - slope
    rough = {ParameterKind.SCALE: 3e-5, ParameterKind.TURN: 4e-4}[kind]  # two shears leave a little of the optics
    assert np.sqrt(np.mean(off**2)) < rough * np.sqrt(np.mean(slope**2))


@pytest.mark.parametrize("early", [pytest.param(0.015, marks=pytest.mark.long), 0.06])
def test_a_clock_that_is_off_is_put_right_and_not_along_a_tangent(tiny, calibrate, early):
    """Where road or block has passed a pixel, no tangent reaches so far; the last frame is then of the very end."""
    p = ParameterId(ParameterKind.CLOCK, file="condition1_sidewall.nc")
    base = calibrate(altered(tiny, lambda r: replace(r, time=r.time - early))).base
    assert base.is_converged
    assert base.model.placements[p.file].clock < -0.3 * early  # what is usual draws it back
    assert abs(base.model.placements[p.file].clock + base.solution[p] + early) < 3.0 * base.solution.sd(p)
    assert abs(base.solution.chi2 / base.solution.count - 1.0) < 5.0 * np.sqrt(2.0 / base.solution.count)


def test_a_late_clock_shows_what_an_earlier_stamp_shows(tiny):
    [view], late = tiny.views, 0.03

    def seen(told, model):
        problem = prepare_problem(told, lambda tasks: [prediction.predict_condition(t) for t in tasks])
        [made] = problem.predict(problem.make_tasks(model, prediction.DerivativeRequest(optics=True)))
        return made.observables[view.file]

    p = ParameterId(ParameterKind.CLOCK, file=view.file)
    moved = seen(tiny, ModelPoint().with_step(p, late))
    stamped = seen(altered(tiny, lambda r: replace(r, time=r.time - late)), ModelPoint())
    np.testing.assert_allclose(moved.values, stamped.values, atol=1e-9)
    np.testing.assert_allclose(
        moved.columns[ParameterId(ParameterKind.CLOCK)], stamped.columns[ParameterId(ParameterKind.CLOCK)]
    )


def test_frames_moved_beyond_the_end_show_the_end_in_every_column(tiny):
    """The last frame is of the end of the schedule: moved on, it and all its traces stay."""
    [view], on = tiny.views, prediction.DerivativeRequest(scatter=True)
    problem = prepare_problem(tiny, lambda tasks: [prediction.predict_condition(t) for t in tasks])
    there, beyond, before = (
        problem.predict(
            problem.make_tasks(ModelPoint().with_step(ParameterId(ParameterKind.CLOCK, file=view.file), c), on)
        )[0]
        for c in (0.0, -0.01, 0.01)
    )
    p = ParameterId(ParameterKind.SCATTER, (1,))
    told, moved, earlier = (o.observables[view.file].columns[p][-1] for o in (there, beyond, before))
    whole = np.abs(told).max()
    # steps of sensitivities depend on the time of the first frame: columns agree to 0.01 % of their largest value
    np.testing.assert_allclose(moved, told, rtol=0.0, atol=1e-4 * whole)
    assert np.abs(earlier - told).max() > 10.0 * 1e-4 * whole  # frames that move within the schedule do change


# --- priors that a campaign states ----------------------------------------------------------------------------
def test_a_campaign_states_what_is_known_of_its_free_keys(tiny):
    told = replace(tiny, free=("contact.spot_fraction", "friction.mu"), priors={"contact.spot_fraction": 0.33})
    with open_worker_pool(prediction.predict_condition, 1) as run:
        priors = prepare_problem(told, run).key_priors
    assert priors == {ParameterId.of_key("contact.spot_fraction"): 0.33, ParameterId.of_key("friction.mu"): 0.1}


# --- walls that a film cools --------------------------------------------------------------------------------
@pytest.mark.parametrize("key", ["friction.mu", pytest.param("contact.spot_fraction", marks=pytest.mark.long)])
def test_traces_of_a_wall_that_its_film_cools_are_differences_of_images(tmp_path, key):
    """Neighbours are recorded at few times; what their face was in between shapes the wall all the same."""
    (tmp_path / "case.toml").write_text("")
    given = {"ambient.convection": 60.0, "schedule.repetitions": 3, "schedule.distance": 0.4, "schedule.wait": 6.0}
    case = load_case(tmp_path / "case.toml", {"numerics.mesh": 0.5, "road.track_length": 0.4} | given)
    made = make_synthetic_campaign(case, SyntheticPlan((), 7, 1, ("sidewall",), 1, waiting=0), tmp_path / "lab")
    told = replace(campaign.load(made), forces=(), free=(key,))
    problem = prepare_problem(told, lambda tasks: [prediction.predict_condition(t) for t in tasks])
    p, [view] = ParameterId.of_key(key), told.views

    def seen(model, **derivatives):
        [shown] = problem.predict(problem.make_tasks(model, prediction.DerivativeRequest(**derivatives)))
        return shown.observables[view.file]

    there, step = seen(problem.stated_model, model_parameters=problem.free_keys), 0.02
    ahead, behind = (seen(problem.stated_model.with_step(p, s)).values[:, there.inside] for s in (step, -step))
    slope = (ahead - behind) / (2.0 * step)
    off = there.columns[p] - slope
    assert np.sqrt(np.mean(off**2)) < 0.01 * np.sqrt(np.mean(slope**2))


# --- whole campaigns (long) -----------------------------------------------------------------------------------
SMALL = {
    "schedule.repetitions": 2, "schedule.distance": 0.6, "schedule.wait": 8.0, "road.track_length": 0.6,
    "numerics.mesh": 0.6,
}  # fmt: skip


def made(folder, seed, hidden=(), **more):
    (folder / "case.toml").write_text("")
    given = SMALL | ({"effects": list(hidden)} if hidden else {}) | more
    return make_synthetic_campaign(
        load_case(folder / "case.toml", given),
        SyntheticPlan(tuple(hidden), seed, conditions=2, sliding=3),
        folder / "lab",
    )


def rewritten(lab, change, view="sidewall"):
    for file in lab.glob(f"*_{view}.nc"):
        r = change(Recording_load(file))
        file.unlink()
        r.save(file)


def Recording_load(file):
    from flashtemp.camera import recording

    return recording.load(file)


def judged(lab):
    return engine.discover(campaign.load(lab), workers=1)[0]


def turn_image(degrees):
    """The image as a camera would give it that hangs askew by that much."""

    def change(r):
        a, (U, V) = np.radians(degrees), np.meshgrid(r.u, r.v)
        x = MIDDLE + (U - MIDDLE) * np.cos(a) - V * np.sin(a)
        z = (U - MIDDLE) * np.sin(a) + V * np.cos(a)
        wanted = np.stack([(x - r.u[0]) / r.pitch[0], (z - r.v[0]) / r.pitch[1]], -1)
        return replace(r, temperature=np.stack([_interpolate_image(T, wanted, LONG_WAVE) for T in r.temperature]))

    return change


@pytest.mark.long
def test_a_wrong_scale_or_turn_is_never_taken_for_physics(tmp_path):
    lab = made(tmp_path, 11)
    for n, (change, name, size) in enumerate([
        (lambda r: replace(r, u=r.u * 1.01, v=r.v * 1.01), "pixel_scale", -0.0099),
        (turn_image(1.0), "image_turn", 1.0),
    ]):  # fmt: skip
        other = shutil.copytree(lab, tmp_path / f"lab{n}")
        rewritten(other, change)
        v = judged(other)
        assert v.kind == "none_needed", v.says
        [found] = (f for f in v.laboratory if f.name == name and "all side walls" in f.words)
        assert abs(found.value - size) < 4.0 * found.stderr


@pytest.mark.long
def test_an_error_far_beyond_what_is_usual_is_named(tmp_path):
    lab = made(tmp_path, 11)
    rewritten(lab, lambda r: replace(r, u=r.u * 1.06, v=r.v * 1.06))
    v = judged(lab)
    assert v.kind == "named", v.says
    assert {c.effect for c in v.causes} == {"pixel_scale"}
    assert all(c.laboratory for c in v.causes)
    assert "side walls" in v.says[0] or "sidewall" in v.says[0]
    assert v.as_dict()["extended_case"] is None


@pytest.mark.long
def test_a_shorter_block_is_never_taken_for_physics(tmp_path):
    lab = made(tmp_path, 12, **{"block.length": 0.0248})
    text = (lab / "case.toml").read_text()
    (lab / "case.toml").write_text(text.replace("length = 0.0248", "length = 0.025"))
    v = judged(lab)
    assert v.kind == "none_needed", v.says


@pytest.mark.long
@pytest.mark.parametrize("conditions", [2, 3])
def test_friction_stated_at_a_wrong_value_is_said_first(tmp_path, conditions):
    """The first two conditions have one speed, at which a law of the speed is nothing but another friction."""
    (tmp_path / "case.toml").write_text("")
    stated = load_case(tmp_path / "case.toml", SMALL | {"friction.mu": 1.0})
    lab = make_synthetic_campaign(stated, SyntheticPlan((), 13, conditions=conditions, sliding=3), tmp_path / "lab")
    text = (lab / "case.toml").read_text()
    (lab / "case.toml").write_text(text.replace("mu = 1.0", "mu = 0.8", 1))
    text = (lab / "campaign.toml").read_text()
    (lab / "campaign.toml").write_text(text.replace('    "friction.mu",\n', ""))
    v = judged(lab)
    if conditions == 2:
        assert v.kind == "group", v.says
        assert set(v.group) == {"friction_speed", "friction.mu"}
        assert v.says[0].startswith("Either an effect is missing or a stated input is wrong")
        return
    assert v.kind == "held_key", v.says
    assert v.held_key.key == "friction.mu"
    assert v.says[0].startswith("No effect is missing, but the data contradict a stated input: friction.mu")
    assert v.causes == ()
    assert abs(v.held_key.value / 1.0956 - 1.0) < 0.06  # drawn by seed 13


# --- a world in 3D ------------------------------------------------------------------------------------
@pytest.mark.long
def test_a_campaign_that_3d_made_needs_nothing_in_2d(tmp_path):
    """Walls that the air cools, waits in the air, a wake with edges: what 3D resolves and 2D has to know."""
    (tmp_path / "case.toml").write_text("")
    world = TINY | {
        "schedule.repetitions": 3, "schedule.distance": 1.0, "schedule.wait": 10.0, "ambient.convection": 20.0,
        "road.track_length": 1.0, "numerics.across": 60, "numerics.first_y": 3e-5,
    }  # fmt: skip
    made = make_synthetic_campaign(
        load_case(tmp_path / "case.toml", world), SyntheticPlan((), 61, 2, ("sidewall", "wake"), 4), tmp_path / "lab"
    )
    believed = made / "case.toml"
    flat = re.sub(r"(?m)^across = .*$", "across = 1", believed.read_text())
    believed.write_text(re.sub(r"(?m)^first_y = .*\n", "", flat))
    found = engine.discover(campaign.load(made), workers=1)[0]
    assert found.kind == "none_needed", found.says
    true = json.loads((made / SEALED_TRUTH).read_text())["nuisance"]
    pulls = {p.name: p for p in found.nuisance}
    for key, factor in true.items():
        assert abs(pulls[key].value - factor * load_case(believed)[key]) < 4.0 * pulls[key].stderr, (pulls[key], factor)
