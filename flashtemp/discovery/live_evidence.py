"""Evidence from the data so far, while a test is running: which hypothesis leads, and whether the data suffice.

The hypotheses are the stated model and the stated model with one candidate effect.  They are compared as in the first
step of a discovery: by ln Bayes factors of the model that is linearised at the stated case, with all nuisances free.
The thresholds are those of `criteria.Criteria`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flashtemp.comparison.campaign import Campaign, Condition, RecordingEntry
from flashtemp.comparison.compare import screen_campaign
from flashtemp.comparison.line_noise import NO_LINES
from flashtemp.discovery.criteria import CRITERIA, Criteria
from flashtemp.discovery.estimation.hyperparameters import maximise_evidence
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem, whitened_residual
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import nuisance_priors
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.kept_prediction import Array, KeptCondition, predict_foreseen
from flashtemp.discovery.prediction.prediction import Prediction
from flashtemp.discovery.prediction.problem import (
    Problem,
    TaskRunner,
    assume_camera_facts,
    prepare_problem,
    replace_views,
)
from flashtemp.discovery.selection.scores import CandidateScore, score_candidates

STATED_MODEL = "stated model"  # name of the hypothesis without any candidate effect
FRAMES_TO_PREPARE = 2  # frames with which a problem is prepared: enough for all but the temperatures


@dataclass(frozen=True)
class HypothesisEvidence:
    """The evidence for the stated model with one `effect`.

    `ln_bayes`: ln Bayes factor against the stated model.  `expected_now` and `expected_in_the_end`: what this factor
    is expected to be if the effect acts with its typical strength, for the data so far and for all foreseen frames.
    `reason`: why the effect is impossible or cannot be tested; empty if it can.
    """

    effect: str
    ln_bayes: float
    expected_now: float
    expected_in_the_end: float
    reason: str = ""


@dataclass(frozen=True)
class LiveDecision:
    """The `leader` among the hypotheses, its `ln_bayes` against the stated model, and the `runner_up` with the `margin`
    of ln evidence by which the leader exceeds it.

    `is_decided`: the data suffice to tell the leader from the others; `words` say why, or what is missing.
    """

    leader: str
    ln_bayes: float
    runner_up: str
    margin: float
    is_decided: bool
    words: str


@dataclass(frozen=True, eq=False)
class ComparedRecording:
    """A recording with the frames that are compared, (frames, nv, nu): `predicted` by the stated model in degC, its
    `residual` in K, and the `calibrated_residual` with all nuisances estimated; NaN where not compared."""

    entry: RecordingEntry
    predicted: Array
    residual: Array
    calibrated_residual: Array

    @property
    def rmse_K(self) -> float:
        return root_mean_square(self.residual)

    @property
    def calibrated_rmse_K(self) -> float:
        return root_mean_square(self.calibrated_residual)


@dataclass(frozen=True, eq=False)
class LiveAssessment:
    """All hypotheses, the most probable first, the decision between them, and the compared recordings by file."""

    hypotheses: tuple[HypothesisEvidence, ...]
    decision: LiveDecision
    recordings: dict[str, ComparedRecording]


def root_mean_square(values: Array) -> float:
    """Root mean square of the finite values; NaN if there are none.

    >>> root_mean_square(np.array([3.0, -3.0, np.nan]))
    3.0
    """
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else float("nan")


def expected_ln_bayes(z: float) -> float:
    """Expected ln Bayes factor of an effect that acts with its typical strength, at signal-to-noise ratio `z` of it.

    With the typical strength a as its prior standard deviation, the factor is (x^2 z^2/(1 + z^2) - ln(1 + z^2))/2 for
    an estimate of x standard errors, and x^2 has the mean 1 + z^2.

    >>> round(expected_ln_bayes(5.0), 2), expected_ln_bayes(0.0)
    (10.87, 0.0)
    """
    return 0.5 * (z * z - float(np.log1p(z * z)))


def decide_leader(
    hypotheses: tuple[HypothesisEvidence, ...], ln_bayes_discrepancy: float, criteria: Criteria = CRITERIA
) -> LiveDecision:
    """The leading hypothesis, and whether the data suffice to tell it from the others.

    An effect must exceed the stated model by `ln_bayes_named`, also with the model discrepancy as large as it may be
    (`ln_bayes_discrepancy` of the best effect), and every other effect by `ln_bayes_distinct`.  The stated model leads
    where no effect reaches `ln_bayes_hint`: it is then at least as probable as any of them.  It is told from the
    effects that would exceed it by `ln_bayes_named` in the end, once they would do so with the data so far.
    """
    ranked = sorted(hypotheses, key=lambda h: -h.ln_bayes)
    best = ranked[0] if ranked else None
    if best is None or best.ln_bayes < criteria.ln_bayes_hint:
        return _decide_for_stated_model(ranked, criteria)
    rival = next((h for h in ranked[1:] if h.ln_bayes > 0.0), None)
    margin = best.ln_bayes - (rival.ln_bayes if rival else 0.0)
    secured = min(best.ln_bayes, ln_bayes_discrepancy)
    is_named, is_distinct = secured >= criteria.ln_bayes_named, margin >= criteria.ln_bayes_distinct
    runner_up = rival.effect if rival else STATED_MODEL
    if is_named and is_distinct:
        words = f"the data suffice: {best.effect} explains them better than the stated model and every other effect"
    elif not is_named:
        words = (
            f"not yet: the ln Bayes factor of {best.effect} must reach {criteria.ln_bayes_named:g}; it is {secured:.1f}"
            f"{' with a smooth error of the model' if secured < best.ln_bayes else ''}"
        )
    else:
        words = f"not yet: {best.effect} must exceed {runner_up} by {criteria.ln_bayes_distinct:g} of ln Bayes factor"
    return LiveDecision(best.effect, best.ln_bayes, runner_up, margin, is_named and is_distinct, words)


def _decide_for_stated_model(ranked: list[HypothesisEvidence], criteria: Criteria) -> LiveDecision:
    testable = [h for h in ranked if h.expected_in_the_end >= criteria.ln_bayes_named]
    hidden = [h.effect for h in testable if h.expected_now < criteria.ln_bayes_named]
    rival = next((h for h in testable or ranked if not h.reason), None)
    is_decided = False
    if not testable:
        words = "not yet: these recordings show none of the candidate effects clearly enough, even in the end"
    elif hidden:
        more = f" and {len(hidden) - 3} more" if len(hidden) > 3 else ""
        words = f"not yet: the data so far would not show {', '.join(hidden[:3])}{more}"
    elif rival is not None and rival.ln_bayes > 0.0:
        words = f"not yet: {rival.effect} explains the data a little better, ln Bayes factor {rival.ln_bayes:.1f}"
    else:
        words = f"the data suffice: none of {len(testable)} effects acts with its typical strength; all would show"
        is_decided = True
    runner_up, margin = (rival.effect, 0.0 - rival.ln_bayes) if rival else ("none", 0.0)
    return LiveDecision(STATED_MODEL, 0.0, runner_up, margin, is_decided, words)


class LiveEvidence:
    """The evidence of a running test; predictions are kept from one assessment to the next.

    `run` simulates tasks, `watch` receives progress messages.
    """

    def __init__(self, run: TaskRunner, watch: Callable[[str], Any] = lambda text: None):
        self._run, self._watch = run, watch
        self._problem: Problem | None = None
        self._entries: tuple[Any, ...] = ()
        self._kept: dict[str, KeptCondition] = {}
        self._expected: dict[str, float] | None = None
        self.simulations = 0  # conditions that were simulated

    def assess(self, campaign: Campaign, stated_times: Mapping[str, Array]) -> LiveAssessment:
        """Compare the recordings of a campaign as far as they have got, and score all hypotheses.

        Load-cell series count for conditions with a recording.  `stated_times` {recording: s} as in `predict_foreseen`.
        Raises BadInput, SolverFailure.
        """
        problem = self._prepare(campaign)
        views = self._present_views(campaign)
        self._predict(problem, views, stated_times)
        chosen: list[RecordingEntry] = []
        by_mesh: list[list[Prediction]] = []
        for condition in problem.conditions:
            own = tuple(views[v.file] for v in condition.views)
            selected, predictions = self._kept[_condition_key(condition)].select_frames(own)
            chosen += selected
            by_mesh.append(predictions)
        problem = replace_views(problem, chosen)
        fine, *coarser = (list(mesh) for mesh in zip(*by_mesh, strict=True))
        return self._score(problem, fine, coarser)

    def _prepare(self, campaign: Campaign) -> Problem:
        """The problem of all entries so far; prepared anew only when an entry is added or its pixels change."""
        begun = {_given_key(v.given) for v in campaign.views}
        forces = tuple(f for f in campaign.forces if _given_key(f.given) in begun)
        entries = (*(_view_key(v) for v in campaign.views), *(repr(f) for f in forces))
        if self._problem is None or entries != self._entries:
            few = tuple(
                replace(v, recording=v.recording.select_frames(np.arange(min(v.recording.frames, FRAMES_TO_PREPARE))))
                for v in campaign.views
            )
            self._problem = prepare_problem(replace(campaign, views=few, forces=forces), self._run)
            self._entries = entries
        return self._problem

    def _present_views(self, campaign: Campaign) -> dict[str, RecordingEntry]:
        screened, _ = screen_campaign(campaign)
        return {v.file: assume_camera_facts(v) for v in screened.views}

    def _predict(
        self, problem: Problem, views: Mapping[str, RecordingEntry], stated_times: Mapping[str, Array]
    ) -> None:
        """Simulate the conditions of which frames are not predicted yet, and forget those that are gone."""
        keys = [_condition_key(c) for c in problem.conditions]
        missing = [
            n for n, (key, c) in enumerate(zip(keys, problem.conditions, strict=True))
            if key not in self._kept or not self._kept[key].covers(tuple(views[v.file] for v in c.views))
        ]  # fmt: skip
        if not missing:
            return
        for n in missing:
            self._watch(f"predicting condition {n + 1} of {len(keys)}: {problem.conditions[n].words}")
        found = predict_foreseen(replace_views(problem, list(views.values())), missing, stated_times)
        kept = self._kept | {keys[n]: prediction for n, prediction in found.items()}
        self._kept = {key: kept[key] for key in keys}
        self._expected = None
        self.simulations += len(missing)

    def _score(self, problem: Problem, fine: list[Prediction], coarser: list[list[Prediction]]) -> LiveAssessment:
        data = WhitenedData.from_predictions(problem, fine, coarser)
        model, system = problem.stated_model, LinearSystem(data.make_blocks(fine))
        found = maximise_evidence(problem, system, model, {})
        fit = LinearisedFit(
            model, tuple(fine), system, found.solution, found.priors, found.hyper, FitStatus.CONVERGED, promise=0.0
        )
        now = _expected_factors(problem, system)
        if self._expected is None:
            self._expected = self._expected_in_the_end(problem, data)
        end = self._expected
        scores = score_candidates(problem, fit, problem.candidates)
        hypotheses = tuple(
            HypothesisEvidence(
                s.effect, s.ln_bayes, now.get(s.effect, 0.0), max(end.get(s.effect, 0.0), now.get(s.effect, 0.0)),
                s.reason,
            )
            for s in scores
        )  # fmt: skip
        decision = decide_leader(hypotheses, _ln_bayes_with_discrepancy(problem, fit, scores))
        return LiveAssessment(hypotheses, decision, _compare_recordings(problem, data, fit))

    def _expected_in_the_end(self, problem: Problem, data: WhitenedData) -> dict[str, float]:
        """Expected ln Bayes factors for all foreseen frames, with the noise of the data so far."""
        kept = [self._kept[_condition_key(c)] for c in problem.conditions]
        whole = replace_views(problem, [v for k in kept for v in k.views.values()])
        noises = {file: replace(n, lines=NO_LINES, renewed_pattern=0.0, renewals=()) for file, n in data.noises.items()}
        fine = [k.fine for k in kept]
        coarser = [list(mesh) for mesh in zip(*(k.coarser for k in kept), strict=True)]
        blank = WhitenedData.from_predictions(whole, fine, coarser, noises)
        return _expected_factors(whole, LinearSystem(blank.make_blocks(fine)))


def _ln_bayes_with_discrepancy(problem: Problem, fit: LinearisedFit, scores: Sequence[CandidateScore]) -> float:
    """The ln Bayes factor of the best effect with the model discrepancy as large as it may be; 0 without one."""
    if not scores or scores[0].ln_bayes <= 0.0:
        return 0.0
    priors = {p: (0.0, abs(a)) for p, a in scores[0].typical_strengths.items()}
    return fit.evidence_at_max_discrepancy(problem, priors) - fit.evidence_at_max_discrepancy(problem, {})


def _expected_factors(problem: Problem, system: LinearSystem) -> dict[str, float]:
    """{effect: expected ln Bayes factor} of typical strengths, with the nuisances at their usual sizes as in `plan`."""
    priors, total = nuisance_priors(problem, system.names, problem.stated_model), system.normal_equations()
    sizes = {}
    for c in problem.candidates:
        k, a = c.leading_strength
        if (column := c.strength_column(k)) in system.index:
            sizes[column] = abs(a)
    if not sizes:
        return {}
    information = system.project_out(priors, list(sizes), total).information
    z = np.sqrt(np.maximum(np.diag(information), 0.0)) * np.array(list(sizes.values()))
    return {p.effect: expected_ln_bayes(float(ratio)) for p, ratio in zip(sizes, z, strict=True)}


def _compare_recordings(problem: Problem, data: WhitenedData, fit: LinearisedFit) -> dict[str, ComparedRecording]:
    blocks = {b.label: b for b in fit.blocks}
    observables = {file: o for p in fit.predictions for file, o in p.observables.items()}
    out = {}
    for view in problem.campaign.views:
        o, known = observables[view.file], data.is_compared[view.file]
        residual = np.where(o.inside, view.recording.temperature - o.values, np.nan)
        rest = np.full(residual.shape, np.nan)
        left = data.to_kelvin(view.file, whitened_residual(blocks[view.file], fit.solution))
        rest[:, o.inside] = np.where(known, left, np.nan)
        out[view.file] = ComparedRecording(view, o.values, residual, rest)
    return out


def _given_key(given: Mapping[str, Any]) -> str:
    return repr(
        sorted((k, float(v) if isinstance(v, int) and not isinstance(v, bool) else v) for k, v in given.items())
    )


def _view_key(view: RecordingEntry) -> str:
    """What a prediction of a recording depends on, apart from its frames."""
    r = view.recording
    facts = (r.emissivity, r.reflected_degC, r.netd_K, r.fixed_pattern_K, r.psf_sigma_px, r.exposure_s,
             r.registration_sigma_px, r.camera, r.places)  # fmt: skip
    return repr(
        (view.file, _given_key(view.given), view.sigma_K, view.held_out, r.view, r.u.tolist(), r.v.tolist(), facts)
    )


def _condition_key(condition: Condition) -> str:
    forces = tuple((f.file, f.time) for f in condition.forces)
    return repr((_given_key(condition.given), tuple(map(_view_key, condition.views)), forces))
