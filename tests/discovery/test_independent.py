"""The fixed set of the independent benchmark: campaigns with every laboratory error, nothing named that is not there."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

FILE = Path(__file__).parents[2] / "benchmarks" / "independent.py"
SEEN, FAINT = {"right", "weak", "group"}, {"right", "weak", "group", "none_needed"}
FIXED = dict.fromkeys((900, 906, 908, 913, 919), {"none_needed"}) | dict.fromkeys((901, 903, 909, 937), {"laboratory"})
FIXED |= {911: {"learned"}}  # laws take five times as long: the others are long tests
FIXED |= dict.fromkeys((916, 918, 928, 931, 942), SEEN) | dict.fromkeys((927, 950, 910, 930), FAINT)  # z below 5
FIXED |= {936: FAINT}  # changes 0.09 % of the rise, less than the model may err
CALLED = {"length": "block_length", "larger": "pixel_scale", "turned": "image_turn", "mirrored": "mirrored"}
OTHERS = (902, 904, 905, 907, 912, 914, 915, 917)
LAWS = (925, 949)


@pytest.fixture(scope="module")
def benchmark():
    spec = importlib.util.spec_from_file_location("independent", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_kind_of_campaign_is_drawn(benchmark):
    drawn = [benchmark.draw_hidden(seed, True) for seed in FIXED]
    assert len(drawn) == 20
    assert {d["kind"] for d in drawn} == set(benchmark.KINDS)
    assert {d["hidden"] for d in drawn} == {"", "polishing", *benchmark.FEW, *benchmark.LABORATORY}
    assert {benchmark.draw_hidden(seed, True)["hidden"] for seed in (911, *LAWS)} == set(benchmark.FOREIGN)
    assert [benchmark.draw_hidden(seed, True) for seed in FIXED] == drawn


def test_outcomes_are_counted_as_they_are(benchmark):
    def ended(kind, verdict, *named, hidden="pressure_tilt", group=(), laboratory=False):
        causes = [{"effect": n, "laboratory": laboratory} for n in named]
        return benchmark.classify_record(
            {"kind": kind, "hidden": hidden, "verdict": verdict, "causes": causes, "group": list(group)}
        )

    assert ended("single", "named", "pressure_tilt") == "right"
    assert ended("single", "named", "pressure_tilt", "time_lag") == "extra"
    assert ended("single", "named", "time_lag") == "wrong"
    assert ended("null", "named", "time_lag", hidden="") == "wrong"
    assert ended("single", "weak", "time_lag") == "weak wrong"
    assert ended("single", "group", group=("pressure_tilt", "time_lag")) == "group"
    assert ended("single", "group", group=("blur", "time_lag")) == "wrong"
    assert ended("laboratory", "named", "scale", hidden="larger", laboratory=True) == "laboratory"
    assert ended("foreign", "unexplained", hidden="waves") == "unexplained"
    assert ended("foreign", "named", "side_cooling", hidden="waves") == "wrong"
    assert ended("foreign", "named", "side_cooling", hidden="laminar_cooling") == "right"
    assert ended("foreign", "named", "edge_pressure", hidden="laminar_cooling") == "wrong"


@pytest.mark.sample("900-1")  # of one repetition, which takes half of the time of two
@pytest.mark.parametrize(("seed", "repetitions"), [(900, 1), *((seed, 2) for seed in FIXED)])
def test_campaigns_of_another_laboratory_end_as_they_are(benchmark, seed, repetitions):
    """10 to 25 CPU seconds each, 60 where a law is learned."""
    found = benchmark.run_seed(seed, small=True, repetitions=repetitions)
    assert benchmark.classify_record(found) in FIXED[seed], found["says"]
    if found["kind"] == "laboratory":
        assert {c["effect"] for c in found["causes"]} == {CALLED[found["hidden"]]}


BEYOND_THE_MODEL = pytest.mark.xfail(
    reason="a rotated wall looks like conductivity_slope or a shorter distance, for a reason that is not known: ln Bayes "
    "factor 16 on this mesh, 13 on one of 1; 0.6 without the rotation",
    strict=True,
)
WORLDS = {  # seeds with a block, a road, a schedule and cameras of their own, and how they end
    20018: "none_needed",  # 48 mm long, a wall turned by half a degree
    20052: "laboratory",  # mirrored, faint: two causes and a bent pressure came near enough, yet not quite
    20063: "laboratory",  # one clear mirrored wall, two faint ones that went astray
    20101: "laboratory",  # two mirrored walls of a block of 12 mm, each explained well enough by itself
}


def test_worlds_differ_and_are_drawn_again_alike(benchmark):
    drawn = [benchmark.draw_programme(seed) for seed in WORLDS]
    assert [benchmark.draw_programme(seed) for seed in WORLDS] == drawn
    assert len({p.pair.length for p in drawn}) == len({p.fraction for p in drawn}) == len(drawn)


@pytest.mark.long
@pytest.mark.parametrize("seed", [pytest.param(20018, marks=BEYOND_THE_MODEL), *[s for s in WORLDS if s != 20018]])
def test_campaigns_of_other_worlds_end_as_they_are(benchmark, seed):
    found = benchmark.run_seed(seed, varied=True)
    assert benchmark.classify_record(found) == WORLDS[seed], found["says"]
    assert {c["effect"] for c in found["causes"]} <= {CALLED.get(found["hidden"])}


@pytest.mark.parametrize(
    ("hidden", "setup_errors", "is_registered"),
    [
        pytest.param(
            {}, {"turned": 0.035, "fixed": (1.0, 1.0)}, True, marks=pytest.mark.long
        ),  # its marked corner is off by 4 px; test_recording_errors.py registers a turned image
        pytest.param({}, {"turned": -0.035, "fixed": (0.0, 1.0)}, True, marks=pytest.mark.long),
        pytest.param({}, {}, False, marks=pytest.mark.long),  # test_recording_errors.py leaves images as stated
        pytest.param(
            {"edge_pressure": 3.9}, {}, False, marks=pytest.mark.long
        ),  # an image may hide most of it, and has to be strange for that
        pytest.param(
            {"pressure_tilt": 0.45}, {}, False, marks=pytest.mark.long
        ),  # an image turned by one degree more would leave a tenth of it
        ({"pressure_tilt": 1.2}, {}, False),
    ],
)
def test_images_are_moved_far_where_nothing_else_is_wrong(tmp_path, calibrate, hidden, setup_errors, is_registered):
    from reference import laboratory

    from flashtemp.comparison import campaign
    from flashtemp.discovery.estimation.nuisance_priors import all_derivatives
    from flashtemp.discovery.measurement_errors.initial_registration import register_images
    from flashtemp.discovery.prediction.prediction import predict_condition
    from flashtemp.discovery.prediction.problem import prepare_problem

    test = laboratory.MeasurementProgramme(0.4, wait=4.0, columns=100, mesh=0.5, conditions=((2e5, 0.2),))
    laboratory.write_campaign(tmp_path, hidden, 908, test=test, setup_errors=setup_errors, views=("sidewall",))
    stated = campaign.load(tmp_path)
    if is_registered:  # dead frames, and pixels that fail now and then, say nothing of where it lies
        [view] = stated.views
        T = view.recording.temperature.copy()
        T[1] = np.nan
        T[np.random.default_rng(1).uniform(size=T.shape) < 0.3] = np.nan
        stated = replace(stated, views=(replace(view, recording=replace(view.recording, temperature=T)),))
    problem = prepare_problem(stated, lambda tasks: [predict_condition(t) for t in tasks])
    first = problem.predict(problem.make_tasks(problem.stated_model, replace(all_derivatives(problem), fields=True)))
    found = register_images(problem, first)
    if is_registered:  # at first, or by the alignment of the fit
        base = calibrate(replace(stated, candidates=())).base
        for view in stated.views:
            turn = base.model.image_placement(view.file).turn
            assert turn == pytest.approx(setup_errors["turned"], abs=2e-3)
    else:
        assert found.stated_model.placements == {}
    held = replace(problem, conditions=tuple(_held_out(c) for c in problem.conditions))
    assert register_images(held, first).placements == found.placements  # how a camera stood is no claim about heat


def _held_out(condition):
    return replace(condition, views=tuple(replace(v, held_out=True) for v in condition.views))


TURNED = ("condition2_sidewall.nc", {}, {"turned": 0.035})
WHOLE_CONDITION = pytest.mark.xfail(
    reason="a condition that is left out whole is predicted to 1.11 times its noise since its own friction and cameras stay "
    "within three usual sizes; its level of friction ends at that limit, for a reason that is not known",
    strict=True,
)


@pytest.mark.long
@pytest.mark.parametrize(
    ("held", "hidden", "setup_errors"),
    [
        TURNED,
        pytest.param("condition1", {}, {}, marks=WHOLE_CONDITION),
        ("condition1_sidewall.nc", {"pressure_tilt": 0.4}, {}),
    ],
)
def test_recordings_that_are_held_out_have_cameras_of_their_own(benchmark, tmp_path, held, hidden, setup_errors):
    """Images that lie a usual way off, or are turned by two degrees, left any model unexplained."""
    verdict = _without(benchmark, tmp_path, held, hidden, setup_errors)
    assert [c.effect for c in verdict.causes] == (["image_turn"] if setup_errors else [*hidden]), verdict.says
    assert all(value <= limit for value, limit in verdict.gates.values())
    assert (verdict.extended or verdict.base).held_out_z == pytest.approx(1.0, abs=0.1)
    if setup_errors:
        [turn] = verdict.causes[0].parameters
        assert turn.name == f"image_turn.{held}"
        assert turn.value == pytest.approx(np.degrees(setup_errors["turned"]), abs=0.1)


@pytest.mark.long
def test_an_image_that_is_held_out_is_followed_to_where_it_is(benchmark, tmp_path):
    """Frames stamped 0.15 s early: the rest is at its best point long before, and half of it was told as a scale."""
    verdict = _without(benchmark, tmp_path, "condition2_wake.nc", {}, {}, early=0.15)
    assert [c.effect for c in verdict.causes] == ["clock"], verdict.says
    [clock] = verdict.causes[0].parameters
    assert clock.value == pytest.approx(-0.15, abs=0.02)  # the clock itself is late by as much, and not told
    assert "pixel scale of condition2_wake.nc" not in " ".join(verdict.says)


@pytest.mark.long
@pytest.mark.parametrize("hidden", [{}, {"pressure_tilt": 0.4}])
def test_cameras_of_which_nothing_is_said_do_for_a_verdict(benchmark, tmp_path, hidden):
    from reference import laboratory

    from flashtemp.comparison import campaign
    from flashtemp.discovery.engine import discover

    test = laboratory.MeasurementProgramme(0.4, wait=4.0, columns=100, mesh=0.5)
    laboratory.write_campaign(tmp_path, hidden, 84, test=test)
    told = replace(campaign.load(tmp_path), candidates=benchmark.FEW)
    facts = ("netd_K", "fixed_pattern_K", "psf_sigma_px", "registration_sigma_px", "emissivity", "reflected_degC")
    nothing = dict.fromkeys(facts)
    views = [replace(v, sigma_K=None, recording=replace(v.recording, **nothing)) for v in told.views]
    verdict, _ = discover(replace(told, views=tuple(views)), workers=1)
    assert [c.effect for c in verdict.causes] == [*hidden], verdict.says
    assert sum("0.5 px and 0.7 px are assumed" in w for w in verdict.warnings) == len(views)


@pytest.mark.long
def test_what_only_data_show_that_are_held_out_is_not_explained(benchmark, tmp_path):
    """A resistance of the contact that falls with speed, seen at one speed alone."""
    verdict = _without(benchmark, tmp_path, "condition2", {"conductance_speed": 1e-4}, {})
    assert verdict.kind in ("unexplained", "learned", "weak"), verdict.says


def _without(benchmark, folder, held, hidden, setup_errors, early=0.0):
    """The verdict on a campaign, files whose names begin with `held` being held out; `setup_errors` for its images alone,
    whose frames are stamped `early` (s)."""
    from reference import laboratory

    from flashtemp.comparison import campaign
    from flashtemp.discovery.engine import discover

    test = laboratory.MeasurementProgramme(0.4, wait=4.0, columns=100, mesh=0.5)
    laboratory.write_campaign(folder / "told", hidden, 71, test=test)
    laboratory.write_campaign(folder / "other", hidden, 71, test=test, setup_errors=setup_errors)
    told, other = (replace(campaign.load(folder / name), candidates=benchmark.FEW) for name in ("told", "other"))
    views = []
    for plain, odd in zip(told.views, other.views, strict=True):
        apart = replace(odd, recording=replace(odd.recording, time=odd.recording.time - early), held_out=True)
        views.append(apart if plain.file.startswith(held) else plain)
    forces = [replace(f, held_out=f.file.startswith(held)) for f in told.forces]
    return discover(replace(told, views=tuple(views), forces=tuple(forces)), workers=1)[0]


@pytest.mark.long
@pytest.mark.parametrize("seed", LAWS)
def test_laws_of_another_laboratory_are_learned(benchmark, seed):
    found = benchmark.run_seed(seed, small=True)
    assert found["verdict"] == "learned", found["says"]


@pytest.mark.long
@pytest.mark.parametrize(("seed", "varied"), [(8541, False), (20027, True)])
def test_walls_say_how_their_cooling_grows_with_speed(benchmark, seed, varied):
    """Cooled as 60 sqrt(v) W/m2K, where a turbulent stream would cool as v^0.8; 20027 in a block that is 5.8 mm high."""
    found = benchmark.run_seed(seed, varied=varied)
    assert benchmark.classify_record(found) == "right", found["says"]
    parameters = found["causes"][0]["parameters"]
    for name, true, sd in (("side_cooling.gain", 60.0, 6.0), ("side_cooling.exponent", 0.5, 0.06)):
        value, stderr, low, high = parameters[name]
        assert low <= true <= high, (name, value, stderr)
        assert stderr < sd
    assert parameters["side_cooling.exponent"][3] < 0.8


@pytest.mark.long
def test_a_tilt_that_no_candidate_knows_is_learned(benchmark, tmp_path):
    """Deviations of unknown shape take most of it, a turned image some: fits that compared points by where traces lead
    went on for ever."""
    from reference import laboratory

    from flashtemp.comparison import campaign
    from flashtemp.discovery.engine import discover

    test = laboratory.MeasurementProgramme(0.4, wait=4.0, columns=100, mesh=0.5, conditions=((2e5, 0.2), (1e5, 0.3)))
    laboratory.write_campaign(tmp_path, {"pressure_tilt": 0.45}, 11, test=test, views=("sidewall", "wake"))
    names = tuple(n for n in benchmark.FEW if n not in ("pressure_tilt", "edge_pressure"))
    verdict, _ = discover(replace(campaign.load(tmp_path), candidates=names), workers=1)
    assert verdict.kind == "learned", verdict.says
    assert (verdict.law.quantity, verdict.law.argument) == ("pressure", "place"), verdict.says
    truth = 1.45 - 0.9 * np.asarray(verdict.law.at) / 0.025
    assert np.all((verdict.law.low < truth + 0.03) & (truth - 0.03 < verdict.law.high)), verdict.says


@pytest.mark.long
@pytest.mark.parametrize(("seed", "end"), [(8657, "right"), (8991, "none_needed"), (9083, "right")])
def test_what_campaigns_once_got_wrong(benchmark, seed, end):
    """Scale and floor that were chosen one after the other (8657 unexplained, 8991 a hint of nothing), and a pair of
    which one alone had no full fit (9083: z = 10, a second cause beside it)."""
    found = benchmark.run_seed(seed)
    assert benchmark.classify_record(found) == end, found["says"]


@pytest.mark.long
def test_a_clock_that_all_side_walls_share_is_named(tmp_path, benchmark):
    """Fifteen standard errors early, whatever each recording's own clock would pay for it."""
    from reference import laboratory

    from flashtemp.comparison import campaign
    from flashtemp.discovery.engine import discover

    test = laboratory.MeasurementProgramme(
        0.4, wait=4.0, columns=100, mesh=0.5, conditions=((1.5e5, 0.1), (0.75e5, 0.2))
    )
    laboratory.write_campaign(tmp_path, {}, 8801, test=test)
    told = replace(campaign.load(tmp_path), candidates=benchmark.FEW)
    views = [replace(v, recording=replace(v.recording, time=v.recording.time - early(v))) for v in told.views]
    verdict, search = discover(replace(told, views=tuple(views)), workers=1)
    assert verdict.kind == "named", verdict.says
    [found] = [p for c in verdict.causes for p in c.parameters]
    assert found.name == "clock.sidewall"
    assert abs(found.value + 0.15) < 3.0 * found.stderr
    assert search.best.promise < 1.0


def early(view):
    return 0.15 if view.recording.view == "sidewall" else 0.0


@pytest.mark.long
@pytest.mark.parametrize("seed", OTHERS)
def test_nothing_is_named_that_is_not_there(benchmark, seed):
    found = benchmark.run_seed(seed, small=True)
    print(seed, found["kind"], found["hidden"], f"z {found['z']:.1f}", found["verdict"], found["says"])
    assert benchmark.classify_record(found) not in ("wrong", "weak wrong"), found["says"]


@pytest.mark.long
def test_a_length_that_is_held_by_the_wrong_end_is_found(tmp_path, calibrate):
    """Block 2.0 % longer than told: Gauss-Newton from there rests at 0.8 %, 290 nats below the best point."""
    from reference import laboratory

    from flashtemp.comparison import campaign
    from flashtemp.discovery.parameters import ParameterId, ParameterKind

    truth = laboratory.write_campaign(
        tmp_path, {}, 7635, test=laboratory.MeasurementProgramme(), setup_errors={"length": 6e-4}
    )
    base = calibrate(campaign.load(tmp_path)).base
    p = ParameterId(ParameterKind.SIZE, name="block.length")
    found = base.model.sizes[p.name] + base.solution[p]
    assert abs(found - (truth["length"] / 0.025 - 1.0)) < 3.0 * base.solution.sd(p)
