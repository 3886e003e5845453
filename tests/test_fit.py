"""Calibration of small synthetic campaigns: certificate, what was drawn, far starts, and bounds of effects."""

from __future__ import annotations

import json
from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.comparison import campaign
from flashtemp.comparison.twin import SEALED, Plan, twin
from flashtemp.discovery import search
from flashtemp.discovery.adequacy import pulls
from flashtemp.discovery.calibration import Descent
from flashtemp.discovery.fit import ENOUGH
from flashtemp.discovery.floor import LARGEST, LEAST
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.linear_gaussian import residual
from flashtemp.discovery.nuisances import GROUPS, MODE, UNSURE, everything, nuisances
from flashtemp.discovery.parameters import Kind, ParameterId
from flashtemp.discovery.prediction import Derivatives, predict
from flashtemp.discovery.problem import _untold, prepare
from flashtemp.discovery.rounds import FAR, _far, _lost, advance, descend
from flashtemp.discovery.scales import solved
from flashtemp.discovery.scores import SEEN, likely, scores
from flashtemp.discovery.searched import calibrate, traced
from flashtemp.discovery.starts import _options, by_runs, dragged, typical
from flashtemp.discovery.wording import taken as taken_words
from flashtemp.errors import BadInput
from flashtemp.model.case import load
from flashtemp.physics.effect import Param, find
from flashtemp.runs.workers import crew

KNOWN_WELL = ("friction.mu", "contact.spot_fraction")  # what shows clearly in a few seconds of sliding
SMALL = {
    "block.height": 0.005, "schedule.distance": 0.3, "numerics.mesh": 0.4, "numerics.rtol": 1e-4, "output.profiles": 20,
}  # fmt: skip
AWAY = {"friction.mu": 0.25, "contact.spot_fraction": -0.25, "ambient.convection": 0.6}  # 2 to 2.5 prior sd away


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    """A campaign calibrated: `hidden` effects in the truth, `believed` line of the case that is held to it."""

    def make(seed, hidden=(), believed=None, free=None, **plan):
        folder = tmp_path_factory.mktemp("fit")
        (folder / "case.toml").write_text("")
        settings = {"conditions": 1, "views": ("sidewall",), "sliding": 3, "nuisance": 0.5} | plan
        out = twin(load(folder / "case.toml", SMALL), Plan(tuple(hidden), seed, **settings), folder / "lab")
        if believed:
            rows = (out / "case.toml").read_text().splitlines()
            [at] = [i for i, row in enumerate(rows) if row.split(" = ")[0] == believed.split(" = ")[0]]
            rows[at] = believed
            (out / "case.toml").write_text("\n".join(rows))
        told = campaign.load(out)
        with crew(predict, 1) as run:
            made = calibrate(prepare(replace(told, free=free or told.free), run))
        return SimpleNamespace(**vars(made), truth=json.loads((out / SEALED).read_text()))

    return make


@pytest.fixture(scope="module")
def two(campaigns):
    """Two conditions, nothing hidden."""
    return campaigns(4, conditions=2, sliding=2)


def value(fit, key):
    """ln of the factor on a free key, last step included."""
    return fit.model.free[key] + fit.solution[ParameterId.of_key(key)]


def candidate(made, name):
    [found] = (c for c in made.problem.tried if c.effect == name)
    return found


def fitted(made, name, start):
    """Full fit of an effect from a start; every value that was looked at on the way."""
    c, seen = candidate(made, name), []

    class Watched(Descent):
        def take(self, predictions):
            seen.append(dict(self.model.effects[name]))
            return super().take(predictions)

    start = Watched(made.problem, made.data, made.base.model.with_effect(name, c.off() | start), (c,))
    [descent] = descend(made.problem, [start])
    assert descent.failed == ""
    return descent, [*seen, descent.model.effects[name]]


# --- calibration -------------------------------------------------------------------------------------
def test_calibration_ends_with_its_certificate(two):
    fit = two.base
    assert fit.converged
    assert fit.history[-1] < ENOUGH
    assert fit.history[0] > 10 * ENOUGH
    assert fit.model.effects == {}
    assert len(fit.blocks) == 4
    for key in two.problem.free:
        assert abs(fit.solution[key]) < ENOUGH * two.problem.priors[key]


def test_what_was_drawn_is_found_again(two):
    """Within four standard errors; friction with its jitter from condition to condition."""
    fit = two.base
    for key, factor in two.truth["nuisance"].items():
        p = ParameterId.of_key(key)
        assert abs(value(fit, key) - np.log(factor)) < 4 * fit.solution.sd(p), key
        assert 0 < fit.solution.sd(p) < two.problem.priors[p]
    for number, own in enumerate(two.truth["recordings"].values()):
        level = value(fit, "friction.mu") + fit.solution[ParameterId(Kind.LEVEL, condition=number)]
        drawn = np.log(two.truth["nuisance"]["friction.mu"] * own["friction_jitter"])
        assert level == pytest.approx(drawn, abs=0.01)
    assert fit.solution.chi2 == pytest.approx(fit.solution.count, abs=5 * np.sqrt(2 * fit.solution.count))


def test_predictions_at_the_best_point_leave_noise(two):
    """Each recording by itself, with what its own nuisances explain."""
    from flashtemp.discovery.linear_gaussian import residual

    for block in two.base.blocks:
        left = residual(block, two.base.solution)
        assert np.mean(left**2) == pytest.approx(1.0, abs=5 * np.sqrt(2 / block.count)), block.label


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.long
def test_a_far_start_ends_at_the_same_place(two, sign):
    """Both with exact traces at their ends: those of a few steps before change evidence by a tenth or two."""
    starts = two.base.model, Model({k: sign * v for k, v in AWAY.items()})
    ends = descend(two.problem, [Descent(two.problem, two.data, m, rough=False) for m in starts])
    assert [d.failed for d in ends] == ["", ""]
    best, found = (d.fit for d in ends)
    assert found.history[0] > 1.0
    for key in AWAY:
        far = 0.05 * two.problem.priors[ParameterId.of_key(key)]
        assert abs(value(found, key) - value(best, key)) < far, key
    assert found.ln_evidence == pytest.approx(best.ln_evidence, abs=0.1)


def test_traces_stay_after_a_short_step_and_the_end_is_that_of_exact_ones(two):
    """The last looks of a far start ask for no traces; with all of them (not rough) it ends at the same place."""
    ends, asked = {}, {}
    for rough in (True, False):
        descents = [Descent(two.problem, two.data, Model({k: -0.5 * v for k, v in AWAY.items()}), rough=rough)]
        asked[rough] = 0
        while not descents[0].done:
            asked[rough] += bool(descents[0].tasks()[0].derivatives.own)
            descents = advance(two.problem, descents)
        ends[rough] = descents[0].fit
        assert ends[rough].converged
    assert asked[True] <= asked[False]
    for key in AWAY:
        p = ParameterId.of_key(key)
        assert abs(value(ends[True], key) - value(ends[False], key)) < 0.1 * ends[False].solution.sd(p), key
        assert ends[True].solution.sd(p) == pytest.approx(ends[False].solution.sd(p), rel=0.05)


def test_steps_shrink_until_the_certificate(campaigns):
    """Gauss-Newton close to its end: a few looks, not a walk."""
    fit = campaigns(1).base
    assert fit.converged
    assert len(fit.history) <= 5


def test_what_extends_a_traced_model_asks_only_for_what_is_new(resistive):
    """With the traces that it borrows it ends where exact ones end, within what the certificate leaves open."""
    name = ParameterId.of_effect("interface_resistance", "resistance")
    c, ends = candidate(resistive, "interface_resistance"), {}
    model = resistive.base.model.with_effect("interface_resistance", c.off() | {"resistance": 1e-5})
    for parent in (None, resistive.base):
        descent = Descent(resistive.problem, resistive.data, model, (c,), parent=parent)
        asked = descent.tasks()[0].derivatives
        assert asked.own == ((name,) if parent else (*resistive.problem.free, name))
        assert asked.optics is (parent is None)
        [end] = descend(resistive.problem, [descent])
        assert end.fit.converged
        ends[parent is None] = end.fit
    exact, lent = ends[True], ends[False]
    values = [f.model.value(name) + f.solution[name] for f in (exact, lent)]
    assert abs(values[1] - values[0]) < ENOUGH * exact.priors[name][1]
    assert lent.solution.sd(name) == pytest.approx(exact.solution.sd(name), rel=0.02)
    assert lent.ln_evidence == pytest.approx(exact.ln_evidence, abs=0.5)
    assert set(lent.system.names) == set(exact.system.names)


def test_a_law_ends_with_traces_of_its_own(resistive):
    """What must be exact (not rough) ends only where nothing is borrowed any more, as without a parent."""
    c, ends = candidate(resistive, "interface_resistance"), {}
    model = resistive.base.model.with_effect("interface_resistance", c.off() | {"resistance": 1e-5})
    for parent in (None, resistive.base):
        start = Descent(resistive.problem, resistive.data, model, (c,), rough=False, parent=parent)
        [ends[parent is None]] = descend(resistive.problem, [start])
    assert ends[False].best.own
    assert ends[False].fit.ln_evidence == pytest.approx(ends[True].fit.ln_evidence, abs=0.05)


@pytest.mark.parametrize("promise", [0.1, 100.0])
def test_the_evidence_of_borrowed_traces_is_held_against_nothing_else(resistive, promise):
    """A point that a parent flatters is looked at again with traces of its own when the next one seems worse; one that
    promised little is no end either: such a fit once asked for the same for ever."""
    c = candidate(resistive, "interface_resistance")
    model = resistive.base.model.with_effect("interface_resistance", c.off() | {"resistance": 1e-5})
    begun = Descent(resistive.problem, resistive.data, model, (c,), rough=False, parent=resistive.base)
    [once] = advance(resistive.problem, [begun])
    assert not once.best.own
    best = replace(once.best, ln_evidence=once.best.ln_evidence + 1e4, fit=replace(once.best.fit, promise=promise))
    flattered = replace(once, best=best)
    [again] = advance(resistive.problem, [flattered])
    assert again.model is best.fit.model
    assert (again.best, again.parent, again.back) == (None, None, 0)
    [end] = descend(resistive.problem, [again])
    assert end.fit.converged


@pytest.mark.parametrize(
    ("rounds", "lost", "ln_evidence", "far"),
    [
        (1, 0, -1e6, False), (2, 0, -141.0, True), (2, 0, -139.0, False), (3, 0, -91.0, True),
        (1, 1, -1e6, False), (1, 2, -141.0, True), (1, 2, -139.0, False), (1, 3, -139.0, False),
    ],
)  # fmt: skip
def test_what_goes_no_further(rounds, lost, ln_evidence, far):
    """40 behind what the best has after two rounds, or behind what it promises after three; two steps that lose in a row
    are two rounds, more of them no third."""
    best = SimpleNamespace(history=(1.0, 1.0, 1.0), back=0, fit=SimpleNamespace(ln_evidence=-50.0, promise=50.0))
    fit = SimpleNamespace(ln_evidence=ln_evidence, promise=1e3)
    other = SimpleNamespace(history=(1.0,) * rounds, back=lost, fit=fit)
    assert _far(other, [best, other], 40.0) is far


@pytest.mark.parametrize(
    ("reached", "usable", "gross", "spare", "lost"),
    [
        (-200.0, True, False, 0.0, True), (-341.0, True, False, 0.0, False), (-200.0, False, False, 0.0, False),
        (-200.0, True, True, 0.0, False), (-200.0, True, False, 200.0, False),
    ],
)  # fmt: skip
def test_a_rival_of_what_leaves_nothing_over_goes_no_further(reached, usable, gross, spare, lost):
    """It promises -500 and a quarter of 480 besides, and would have to be within 40 of what another one has."""
    end = SimpleNamespace(ln_evidence=reached, usable=usable, hopeless=gross, spare=spare)
    fit = SimpleNamespace(ln_evidence=-500.0, promise=480.0)
    ended, other = SimpleNamespace(fit=end), SimpleNamespace(fit=fit)
    assert _lost(other, [ended, SimpleNamespace(fit=None)], 40.0) is lost


# --- gross misfits -----------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def peaked(campaigns):
    """The pressure peaks fivefold at the leading edge, and nobody knows."""
    return campaigns(6, hidden=("edge_pressure",), free=KNOWN_WELL, conditions=2)


@pytest.mark.parametrize(
    ("pull", "gross", "expected"),
    [(0.0, False, False), (0.0, True, False), (3.5, False, False), (3.5, True, True), (4.5, False, True)],
)
def test_images_are_dragged_where_they_cannot_be_whatever_is_left_over(two, pull, gross, expected):
    """Beyond 3 sd by a model that misfits grossly, beyond 4 by any: moved images and a longer block can hide a peak."""
    solution = two.base.solution
    at = next(i for i, p in enumerate(solution.names) if p.kind is Kind.SHIFT_U)
    moved, (mean, sd) = solution.d.copy(), two.base.priors[solution.names[at]]
    moved[at] = mean + pull * sd
    chi2 = (1.5 if gross else 1.0) * solution.count
    assert dragged(replace(two.base, solution=replace(solution, d=moved, chi2=chi2))) is expected


@pytest.mark.parametrize(("share", "promise", "usable"), [(1.5, 0.9, True), (1.5, 1.1, False), (3.0, 1.1, True)])
def test_a_gross_misfit_is_compared_before_its_best_point_is_near(two, share, promise, usable):
    """`promise` in percent of what the misfit of 1.5 costs; without a gross misfit none of them would be near enough."""
    solution = two.base.solution
    gross = replace(solution, chi2=share * solution.count)
    fit = replace(two.base, history=(1.0,), noisy=False, promise=0.01 * promise * 0.25 * solution.count, solution=gross)
    assert fit.usable is usable
    assert not fit.near
    assert not fit.converged
    assert not replace(fit, solution=replace(solution, chi2=1.0 * solution.count)).usable


@pytest.mark.parametrize(
    ("history", "gained", "done"), [((5.0,), 0.0, False), ((5.0, 5.0), 0.05, True), ((5.0, 5.0), 0.2, False)]
)
def test_a_gross_misfit_is_left_no_sooner_than_a_step_was_taken_and_gained_little(two, history, gained, done):
    """Of an image that is turned by 2 degrees a step promises 1 % of what it gains; `gained` over the misfit."""
    solution = replace(two.base.solution, chi2=1.5 * two.base.solution.count)
    fit = replace(two.base, history=history, noisy=False, solution=solution)
    fit = replace(fit, promise=0.009 * fit.misfit)
    assert fit.usable
    descent = Descent(two.problem, two.data, fit.model, history=history, fit=fit, gained=gained * fit.misfit)
    assert descent.done is done


@pytest.mark.parametrize(("share", "done"), [(0.05, True), (0.15, False)])
def test_the_believed_model_need_not_be_exact_where_it_misfits_grossly(two, share, done):
    """What extends it must; `share` of the misfit that a step still promises."""
    solution = replace(two.base.solution, chi2=1.5 * two.base.solution.count)
    fit = replace(two.base, history=(1.0, 1.0), noisy=False, solution=solution)
    fit = replace(fit, promise=share * fit.misfit)
    descent = Descent(two.problem, two.data, fit.model, history=fit.history, fit=fit, gained=0.05 * fit.misfit)
    assert descent.done is done
    assert not replace(descent, effects=(candidate(two, "pressure_tilt"),)).done


@pytest.mark.parametrize(("adrift", "done"), [(0.1, True), (1.6, False)])
def test_a_fit_is_not_done_while_an_image_held_out_still_moves(two, adrift, done):
    """All else is at its best point: what steps promise counts data that are fitted alone."""
    fit = replace(two.base, adrift=adrift)
    assert fit.converged
    descent = Descent(two.problem, two.data, fit.model, history=fit.history, fit=fit)
    assert descent.done is done


def test_what_an_image_does_not_say_of_its_camera_is_taken_as_usual_and_told(two):
    """As exact, an origin that nobody stated left a null unexplained, and optics without blur asked for a late clock."""
    first, second = two.problem.campaign.views
    mute = replace(first, recording=replace(first.recording, registration_sigma_px=None, psf_sigma_px=None))
    exact = replace(second, recording=replace(second.recording, registration_sigma_px=0.0))
    found = prepare(replace(two.problem.campaign, views=(mute, exact)), two.problem.run)
    assert found.untold == {mute.file: ("registration_sigma_px", "psf_sigma_px")}
    taken, told = (v.recording for v in found.campaign.views)
    assert (taken.registration_sigma_px, taken.psf_sigma_px, told.registration_sigma_px) == (0.5, 0.7, 0.0)
    spread = [ParameterId(Kind.SPREAD, file=v.file) for v in found.campaign.views]
    shift = ParameterId(Kind.SHIFT_U, file=mute.file)
    priors = nuisances(found, [*spread, shift], found.start)
    assert [priors[p][1] for p in (*spread, shift)] == [UNSURE, GROUPS[Kind.SPREAD], 0.5]
    solution = replace(two.base.solution, names=tuple(spread), d=np.array([0.4, 0.1]))
    far = pulls(replace(two.base, priors=priors, solution=solution))
    assert [far[p] for p in spread] == pytest.approx([1.0, 2.0])
    said = taken_words(mute.file, found.untold[mute.file])
    assert said.endswith("its registration_sigma_px and psf_sigma_px (flashtemp import); 0.5 px and 0.7 px were taken")
    assert not _untold(
        SimpleNamespace(
            recording=replace(
                mute.recording, view="profile", temperature=mute.recording.temperature[:, :1], v=mute.recording.v[:1]
            )
        )
    )


def test_something_has_to_be_fitted(two):
    told = two.problem.campaign
    views = tuple(replace(v, held_out=True) for v in told.views)
    prepare(replace(told, views=views), two.problem.run)  # load cells are left
    forces = tuple(replace(f, held_out=True) for f in told.forces)
    with pytest.raises(BadInput, match="leave at least one to be fitted"):
        prepare(replace(told, views=views, forces=forces), two.problem.run)


@pytest.mark.parametrize("gross", [False, True])
def test_a_first_fit_that_ends_well_lends_its_traces_to_the_others(two, monkeypatch, gross):
    solution = replace(two.base.solution, chi2=1.5 * two.base.solution.count)
    end = replace(two.base, solution=solution) if gross else two.base
    rounds = []

    def ended(problem, descents, watch=None, hopeless=np.inf):
        rounds.append(list(descents))
        return [replace(d, fit=end) for d in descents]

    monkeypatch.setattr(search, "descend", ended)
    begun = search.Search(two.problem, two.data, {}, two.base, two.base, {frozenset(): two.base})
    others = [begun.start(two.base.model, ()) for _ in range(3)]
    search._run(begun, others, lambda text: None, first=True)
    assert rounds[0] == others[:1]
    assert [d.parent for d in rounds[1][1:]] == [None if gross else end] * 2


def test_what_one_recording_alone_leaves_over_may_be_gross(two):
    """Half as much again in one trace, which among all data is lost; `excess` is what residuals say."""
    least = min(two.base.blocks, key=lambda b: b.count)
    assert not two.base.hopeless
    larger = {b.label: b.r + (30.0**0.5 * (2.0 / b.count) ** 0.25 if b is least else 0.0) for b in two.base.blocks}
    fit = replace(two.base, system=two.base.system.shown(larger))
    for b in fit.blocks:
        left = np.mean(residual(b, fit.solution) ** 2)
        assert fit.excess[b.label] == pytest.approx((left - 1.0) * np.sqrt(0.5 * b.count), abs=1e-6 * b.count)
    assert fit.hopeless
    assert fit.misfit == pytest.approx(fit.excess[least.label] * np.sqrt(0.5 * least.count))
    unseen = copy(fit.system)
    unseen.blocks = [replace(b, held_out=b.label == least.label) for b in fit.blocks]
    assert not replace(fit, system=unseen).hopeless  # no fit may see what is held out


def test_a_full_fit_begins_where_runs_leave_least_and_ends_at_the_truth(peaked):
    """From where the traces of a base that misfits grossly point, no step leads there."""
    problem, truth = peaked.problem, peaked.truth["hidden"]["edge_pressure"]
    c = candidate(peaked, "edge_pressure")
    base = traced(problem, peaked.data, peaked.base, lambda text: None)
    [score] = (s for s in scores(replace(problem, stiff=True), base, [c]) if s.effect == c.effect)
    start = by_runs(problem, peaked.data, base, score)

    def misfit(values):
        seen = problem.predictions(problem.tasks(problem.start.with_effect(c.effect, values), Derivatives()))
        return sum(float(r @ r) for r in peaked.data.residuals(seen).values())

    least, *others = sorted(_options(score), key=misfit)
    assert start == least
    assert misfit(least) < 0.9 * min(map(misfit, others))
    told = problem.start.with_effect(c.effect, start)
    [end] = descend(problem, [Descent(problem, peaked.data, told, (c,))])
    assert end.fit.usable
    p = ParameterId.of_effect(c.effect, "B")
    assert abs(end.fit.model.value(p) + end.fit.solution[p] - truth["B"]) < 4.0 * end.fit.solution.sd(p)


def standing(made, model, effects=(), traces=1.0):
    """A first look at a point; its own evidence, and what all may explain that its traces show.  The traces of effects
    are taken `traces` times."""
    descent = Descent(made.problem, made.data, model, effects, everything(made.problem))
    seen = []
    for s in made.problem.predictions(descent.tasks()):
        columns = {
            k: {p: (traces if p.effect else 1.0) * v for p, v in o.columns.items()} for k, o in s.observables.items()
        }
        seen.append(replace(s, observables={k: replace(o, columns=columns[k]) for k, o in s.observables.items()}))
    found = descent.take(seen)
    return found.best.ln_evidence, found.fit.ln_evidence


def test_a_point_does_not_count_for_a_turn_that_its_image_still_needs(two):
    """Turned by a third of a degree a side wall is explained by the column of the turn as if it were not; that column
    is no better than its tangent, and steps along it would lose what it had promised."""
    best, file = two.base.model, next(v.file for v in two.problem.campaign.views if v.recording.view == "sidewall")
    place = best.place(file)
    turned = replace(best, places=best.places | {file: replace(place, turn=place.turn + 0.006)})
    (here, all_here), (there, all_there) = (standing(two, m) for m in (best, turned))
    assert all_there > all_here - 1.0
    assert there < here - 5.0


def test_the_evidence_of_a_point_does_not_depend_on_traces_of_what_moves(peaked):
    """Not even by how large deviations of unknown shape are where they lead: one of 1 % of its size changed it by 200
    to 230."""
    c = candidate(peaked, "edge_pressure")
    for values in ({"B": 1.3, "length": 0.00125}, {"B": 1.5, "length": 0.004}):
        model = peaked.problem.start.with_effect(c.effect, values)
        found = [standing(peaked, model, (c,), traces) for traces in (1.0, 0.01)]
        assert found[0][0] == pytest.approx(found[1][0], abs=1e-3)
        assert abs(found[0][1] - found[1][1]) > 10.0  # the end to which they lead does


def test_only_candidates_that_may_explain_what_is_left_are_traced_anew(peaked):
    """None of the others would be told by its own trace; one that is there at 6 standard deviations is kept."""
    problem, data, truth = peaked.problem, peaked.data, peaked.truth["hidden"]["edge_pressure"]
    c = candidate(peaked, "edge_pressure")
    base = traced(problem, data, peaked.base, lambda text: None)
    [end] = descend(problem, [Descent(problem, data, problem.start.with_effect(c.effect, truth), (c,))])
    ranked = scores(problem, base, problem.tried)
    kept = likely(problem, base, end.fit, ranked)
    asleep = {s.effect for s in ranked if s.seen < SEEN}
    assert c not in kept
    assert "wear" in asleep  # does nothing where the pressure is even, and may where it is not
    assert asleep < {k.effect for k in kept}
    assert len(kept) - len(asleep) < 0.5 * len(problem.tried)
    best = traced(problem, data, end.fit, lambda text: None)
    own = {s.effect: s for s in scores(problem, best, problem.tried) if s.candidate not in kept}
    assert all(s.ln_bayes < 5.0 for s in own.values())

    hidden = max(own.values(), key=lambda s: s.seen)
    p, a = hidden.candidate.column(hidden.candidate.first[0]), hidden.candidate.first[1]
    size = 6.0 * abs(a) / hidden.seen
    seen = {b.label: b.r + sum(size * b.C[:, k] for n, k in b.names if n == p) for b in best.blocks}
    found = replace(end.fit, system=end.fit.system.shown(seen))
    assert hidden.candidate in likely(problem, base, found, ranked)


def test_scale_and_floor_are_chosen_together(two):
    """As a null had it: with the larger floor a smaller scale is likelier by a trifle, with the smaller floor another
    one by 13."""
    told = {(0.3, LEAST): 0.0, (1.0, LEAST): 13.0, (0.3, LARGEST): -1.8, (1.0, LARGEST): -2.0}
    mode, floor = ParameterId(Kind.MODE, (1,)), ParameterId(Kind.FLOOR, (0,), file="condition1_sidewall.nc")

    class Told:
        names = (mode, floor)

        def known(self, priors):
            return self.names

        def evidence(self, priors, equations):
            return lambda sd: told.get((round(sd[0] / MODE, 6), sd[1]), -99.0)

        def solve(self, priors, equations):
            return priors

    found = solved(two.problem, Told(), two.base.model, {}, object())
    assert (found.scale, found.floor) == (1.0, LEAST)
    assert found.solution[mode][1] == pytest.approx(MODE)


def test_where_all_images_of_a_view_are_off_alike_each_pays_for_what_is_its_own(two):
    """The sum of both errors alone is seen: standing where it is, the cheapest split counts."""
    walls = [v for v in two.problem.campaign.views if v.recording.view == "sidewall"]
    own = [ParameterId(Kind.CLOCK, file=v.file) for v in walls]
    view, other = ParameterId(Kind.CLOCK, name="sidewall"), ParameterId.of_key("friction.mu")
    priors = dict.fromkeys(own, (0.15, 0.02)) | {view: (0.0, 0.2), other: (0.3, 0.1)}
    split = Descent(two.problem, two.data, two.base.model)._of_views(priors)
    assert len(own) == 2
    assert split[other] == priors[other]
    assert all(split[p][0] + split[view][0] == pytest.approx(0.15) for p in own)

    def cost(common):  # of all files at once, that of the view taking the rest
        return sum(((0.15 + common) / 0.02) ** 2 for _ in own) + (common / 0.2) ** 2

    paid = sum((split[p][0] / split[p][1]) ** 2 for p in (*own, view))
    assert paid == pytest.approx(min(cost(c) for c in np.linspace(-0.2, 0.0, 20001)), rel=1e-6)
    assert paid < 0.01 * cost(0.0)


@pytest.mark.long
def test_several_descents_share_their_rounds(two):
    """Side by side they take the steps that each takes alone; one that is far behind one that ended goes no further."""
    best = two.base
    rounds = []
    pair = [Descent(two.problem, two.data, replace(best.model, free=dict(m))) for m in (best.model.free, AWAY)]
    pair = descend(two.problem, pair, rounds.append, hopeless=-1e9)
    assert pair[0].fit.converged
    assert len(pair[0].history) == 1  # it stands where it should
    assert pair[1].failed == FAR
    assert len(pair[1].history) == len(rounds) == 1


# --- effects -----------------------------------------------------------------------------------------
def inside(name, seen):
    for values in seen:
        for k, v in values.items():
            param = find(name).params()[k]
            assert param.low <= v <= param.high, (name, k, v)


@pytest.fixture(scope="module")
def resistive(campaigns):
    """A film resists in the truth, and nobody knows."""
    return campaigns(5, hidden=("interface_resistance",), free=KNOWN_WELL)


def test_a_hidden_strength_is_found(resistive):
    base = resistive.base
    truth = resistive.truth["hidden"]["interface_resistance"]["resistance"]
    found = []
    for start in (2e-6, 2e-4):
        descent, seen = fitted(resistive, "interface_resistance", {"resistance": start})
        inside("interface_resistance", seen)
        assert descent.fit.converged
        fit, name = descent.fit, ParameterId.of_effect("interface_resistance", "resistance")
        assert not fit.bound
        assert fit.ln_evidence > base.ln_evidence + 8.0
        found.append(fit.model.effects["interface_resistance"]["resistance"] + fit.solution[name])
        assert abs(found[-1] - truth) < 4 * fit.solution.sd(name)
    assert found[0] == pytest.approx(found[1], abs=0.05 * 2e-5)


@pytest.fixture(scope="module")
def perfect(campaigns):
    """The case believes in a resistance that the truth has not: an additional one would have to be negative."""
    return campaigns(6, believed="alpha = 100000.0", free=KNOWN_WELL)


@pytest.mark.parametrize("start", [1e-6, 1e-4])
@pytest.mark.sample("1e-06")
@pytest.mark.long
def test_a_strength_that_ought_to_be_negative_ends_at_off(perfect, start):
    name = "interface_resistance"
    strength = ParameterId.of_effect(name, "resistance")
    descent, seen = fitted(perfect, name, {"resistance": start})
    inside(name, seen)
    assert descent.fit.model.effects[name]["resistance"] == 0.0
    assert descent.fit.bound == {strength}
    assert strength not in descent.fit.solution.names
    assert descent.fit.converged
    assert descent.fit.ln_evidence == pytest.approx(perfect.base.ln_evidence, abs=0.5)


@pytest.mark.long
def test_a_shape_stays_within_its_bounds(resistive):
    """Share and depth of heat released in the rubber: neither acts in this truth."""
    descent, seen = fitted(resistive, "heat_depth", {"share": 0.9, "depth": 4e-3})
    inside("heat_depth", seen)
    assert len(seen) == len(descent.history) + 1


@pytest.mark.parametrize(("change", "value"), [(0.2, 0.5), (-0.2, -0.5), (-4.0, -0.5)])
def test_a_typical_strength_has_the_sign_of_the_trace(change, value):
    """Where that is possible: a law with a bound at `off` goes the only way there is."""
    free, bound = Param(0.0, "1", "", low=-1.0, high=1.0, off=0.0), Param(0.0, "1", "", low=0.0, high=1.0, off=0.0)
    for param, expected in ((free, value), (bound, 0.5)):
        candidate = SimpleNamespace(params={"a": param}, strengths={"a": 0.5})
        assert typical(SimpleNamespace(candidate=candidate, values={"a": 0.0}, amplitude=[change])) == {"a": expected}
