"""Design of experiments: which effects planned views and conditions can distinguish, and which experiment to add.

Nothing measured is needed: what a camera would show of every effect, and what calibration would take of it,
follows from the model.  The experiment to add is the one that leaves most of the worst-known effect
(T-optimal design, Atkinson & Fedorov 1975).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flashtemp.camera.prediction import synthetic_recording
from flashtemp.camera.sensors import SensorPositions, positions_from_arrays
from flashtemp.comparison.campaign import Condition, RecordingEntry
from flashtemp.comparison.compare import stated_noise
from flashtemp.comparison.noise import NoiseLevels
from flashtemp.discovery.estimation.camera_error_columns import USUAL_CAMERA_ERRORS
from flashtemp.discovery.estimation.fitting import ProgressCallback
from flashtemp.discovery.estimation.hyperparameters import Hyperparameters
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.model_discrepancy import TYPICAL_DISCREPANCY
from flashtemp.discovery.estimation.nuisance_priors import PRESSURE_MODE_COUNT, nuisance_priors
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.hypotheses.candidates import CandidateEffect, ModelPoint
from flashtemp.discovery.parameters import ParameterId, Priors
from flashtemp.discovery.prediction.prediction import DerivativeRequest, Prediction, PredictionTask
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.selection.scores import MIN_EFFECT_Z, Separability, compute_separability
from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import FlashtempError
from flashtemp.physics.quantities import KELVIN

DETECTION_Z = 5.0  # signal-to-noise ratio at which an effect is distinguished from all others
MIN_SUGGESTED_Z = 2.0  # signal-to-noise ratio from which a condition is suggested to distinguish effects
RIVAL_PRIOR_STRENGTHS = 3.0  # prior width of every other effect, in typical strengths
DEFAULT_WHITE_NOISE_K, DEFAULT_PATTERN_NOISE_K = 0.05, 0.03  # K: noise of a camera without stated noise
CANDIDATE_CONDITIONS: tuple[tuple[str, str, float, float], ...] = (  # words, key, factor or difference
    ("at three times the speed", "schedule.speed", 3.0, 0.0),
    ("at a third of the speed", "schedule.speed", 1 / 3, 0.0),
    ("at twice the pressure", "contact.pressure", 2.0, 0.0),
    ("at half the pressure", "contact.pressure", 0.5, 0.0),
    ("with the laboratory 20 K warmer", "ambient.temperature", 1.0, 20.0),
    ("with ten times the wait between repetitions", "schedule.wait", 10.0, 0.0),
)
HEIGHT_FRACTIONS, LENGTH_FRACTIONS = (
    (0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.98),
    (0.1, 0.5, 0.9),
)  # of height and length


@dataclass(frozen=True)
class Detectability:
    """Detectability of one effect by planned data: signal-to-noise ratio `z` of its typical strength with all nuisances
    free, `z_left` with all other effects free too, `detectable` strength at 5 sigma in `unit`, and the `nearest` other
    effect with correlation `rho`."""

    effect: str
    parameter: str
    unit: str
    z: float
    z_left: float
    detectable: float
    nearest: str
    rho: float

    @property
    def is_separable(self) -> bool:
        return self.z_left >= DETECTION_Z


@dataclass(frozen=True)
class ProposedExperiment:
    """An additional condition: `words`, its overrides, and `z_left` {effect: z} of every effect with it."""

    words: str
    given: dict[str, Any]
    z_left: dict[str, float]
    helps: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class DesignReport(DisplayMixin):
    """The detectability of all effects before a measurement, and suggestions, the most useful first."""

    title: str
    prospects: tuple[Detectability, ...]
    separability: Separability
    experiments: tuple[ProposedExperiment, ...]
    sensors: tuple[ProposedExperiment, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain data for --json and plan.json."""
        return {
            "title": self.title,
            "effects": [vars(p) | {"separable": p.is_separable} for p in self.prospects],
            "separability": {"effects": list(self.separability.names), "rho": self.separability.rho.tolist()},
            "experiments": [vars(e) for e in self.experiments],
            "sensors": [vars(e) for e in self.sensors],
        }

    def to_table(self) -> DisplayTable:
        head = ("effect", "z", "z left", "distinct", "5 sigma at", "unit", "nearest rival", "correlation")
        rows = [
            (p.effect, p.z, p.z_left, p.is_separable, p.detectable, p.unit, p.nearest, p.rho) for p in self.prospects
        ]  # fmt: skip
        added = [f"add one condition {e.words}: separates {', '.join(e.helps) or 'nothing more'}"
                 for e in self.experiments[:3]]  # fmt: skip
        added += [_describe_sensor(e) for e in self.sensors[:1]]
        return DisplayTable(self._heading(), rows, head, added)

    def _heading(self) -> str:
        good = sum(p.is_separable for p in self.prospects)
        return f"Plan '{self.title}': {good} of {len(self.prospects)} effects can be distinguished from all others"

    def __str__(self) -> str:
        lines = [self._heading()]
        lines.append(f"  {'effect':26s} {'z':>8s} {'z left':>8s}  {'5 sigma at':>24s}  nearest rival")
        for p in self.prospects:
            size = f"{p.detectable:.3g} {'' if p.unit == '1' else p.unit}" if np.isfinite(p.detectable) else "never"
            like = f"{p.nearest} ({p.rho:+.2f})" if p.rho else p.nearest
            lines.append(f"  {p.effect:26s} {p.z:8.1f} {p.z_left:8.1f}  {size:>24s}  {like}")
        for e in self.experiments[:3]:
            what = ", ".join(e.helps) or "nothing more"
            lines.append(f"  add one condition {e.words}: separates {what}")
        lines += [f"  {_describe_sensor(e)}" for e in self.sensors[:1]]
        return "\n".join(lines)


def _describe_sensor(e: ProposedExperiment) -> str:
    """A position for an additional thermocouple, and `z_left` of every effect with it."""
    left = ", ".join(f"{name} {z:.1f}" for name, z in sorted(e.z_left.items(), key=lambda item: item[1]))
    return f"next thermocouple {e.words}: signal-to-noise ratio left with all rivals free: {left}"


def assess_design(problem: Problem, watch: ProgressCallback = lambda text: None) -> DesignReport:
    """The design report of a campaign, whose recordings may be empty.  Raises BadInput, SolverFailure."""
    model, began = problem.stated_model, time.monotonic()
    watch(f"sensitivities of all candidates under {len(problem.conditions)} conditions")
    predictions = problem.predict(problem.make_tasks(model, _all_derivatives(problem)))
    fit = _blank_fit(problem, model, predictions)
    separable = compute_separability(fit, problem.candidates)
    prospects = _assess_detectability(problem, fit, separable)
    weak = [p.effect for p in prospects if p.z > MIN_EFFECT_Z and not p.is_separable]
    gone = time.monotonic() - began
    left = gone * len(CANDIDATE_CONDITIONS) / len(problem.conditions) if weak else 0.0
    watch(f"what a further condition or sensor would tell ({gone:.0f} s, about {left:.0f} s left)")
    added = rank_experiments(problem, fit, weak) if weak else ()
    known = [p.effect for p in prospects if p.z > MIN_EFFECT_Z]
    places = rank_sensor_positions(problem, fit, weak or known)
    return DesignReport(problem.campaign.title, prospects, separable, added, places)


def rank_sensor_positions(problem: Problem, fit: LinearisedFit, effects: list[str]) -> tuple[ProposedExperiment, ...]:
    """A thermocouple at every position of a grid in the block of the first condition, the most useful first.

    Only where the campaign has thermocouples; ranked by what each leaves of the worst-known of some effects.
    """
    views = candidate_sensor_recordings(problem)
    if not views or not effects:
        return ()
    task = PredictionTask(
        problem.case, problem.conditions[0].given, problem.mesh_overrides[0], replace(fit.model, shifts={}),
        tuple(views), (), _all_derivatives(problem),
    )  # fmt: skip
    [prediction] = problem.predict([task])
    now, out = _remaining_z(problem, fit, effects), []
    for view in views:
        left = _remaining_z(problem, _extend_fit(problem, fit, replace(task, views=(view,)), prediction), effects)
        helps = tuple(e for e in effects if left.get(e, 0.0) >= DETECTION_Z > now.get(e, 0.0))
        out.append(ProposedExperiment(view.file, task.given, left, helps))
    return tuple(sorted(out, key=lambda e: (-len(e.helps), -min(e.z_left.values(), default=0.0))))


def suggest_experiment(
    problem: Problem, fit: LinearisedFit, alike: tuple[str, ...], strengths: Mapping[str, float]
) -> str:
    """The experiment that best distinguishes effects that explain the data equally well, in words.

    `strengths` {effect: strength}: what each of them needs to explain the data, as a change from its neutral value.
    """
    # only the group and the effects that are certain compete: the data rejected all others
    rivals = frozenset({*alike, *fit.model.effects})
    kept = replace(
        problem, candidates=tuple(_with_strength(c, strengths) for c in problem.candidates if c.effect in rivals)
    )
    found = rank_experiments(kept, fit, list(alike))
    direct = "measure the pressure, the friction or the temperature in the contact directly"
    if not found:
        return f"no further condition could be simulated; {direct}"
    best = max(found, key=lambda e: (len(_distinct_members(e, alike)), min(e.z_left.values(), default=0.0)))
    apart = _distinct_members(best, alike)
    if not apart:
        tried = ", ".join(e.words for e in found)
        largest = max((z for e in found for z in e.z_left.values()), default=0.0)
        return f"none of the conditions that were tried would do ({tried}): at most {largest:.1f} sigma; {direct}"
    least = min(best.z_left[e] for e in apart)
    rest = [e for e in alike if e not in apart]
    others = f" from {' and '.join(rest)}" if rest else ""
    alone = ", but not these from each other" if len(rest) > 1 else ""
    told = f"it would tell {' and '.join(apart)} apart{others} by {least:.0f} sigma{alone}"
    return f"measure one more condition {best.words}: {told}"


def _distinct_members(e: ProposedExperiment, alike: Sequence[str]) -> list[str]:
    """The effects of a group that an experiment distinguishes from all others of it."""
    return [name for name in alike if e.z_left.get(name, 0.0) >= MIN_SUGGESTED_Z]


def _with_strength(c: CandidateEffect, strengths: Mapping[str, float]) -> CandidateEffect:
    """A candidate whose typical strength is the one that it needs, if that is known."""
    needed = strengths.get(c.effect, 0.0)
    return replace(c, strengths=c.strengths | {c.leading_strength[0]: needed}) if needed else c


def rank_experiments(problem: Problem, fit: LinearisedFit, effects: list[str]) -> tuple[ProposedExperiment, ...]:
    """An additional condition of each kind, ranked by the smallest z of some effects with it."""
    now = _remaining_z(problem, fit, effects)
    asked = [
        (words, _condition_task(problem, fit.model, key, factor, step))
        for words, key, factor, step in CANDIDATE_CONDITIONS
    ]
    tasks = {words: task for words, task in asked if task is not None}
    out = []
    for (words, task), answer in zip(tasks.items(), problem.run(list(tasks.values())), strict=True):
        if isinstance(answer, Prediction):
            left = _remaining_z(problem, _extend_fit(problem, fit, task, answer), effects)
            helps = tuple(e for e in effects if left.get(e, 0.0) >= DETECTION_Z > now.get(e, 0.0))
            out.append(ProposedExperiment(words, task.given, left, helps))
    return tuple(sorted(out, key=lambda e: (-len(e.helps), -min(e.z_left.values(), default=0.0))))


def _extend_fit(problem: Problem, fit: LinearisedFit, task: PredictionTask, prediction: Prediction) -> LinearisedFit:
    """A fit with the data of an additional condition, of which only the noise is known."""
    campaign = replace(problem.campaign, views=task.views, forces=())
    more = replace(problem, campaign=campaign, conditions=(Condition(task.given, task.views, ()),))
    data = WhitenedData.from_predictions(more, [prediction], noises=_assume_noise(more))
    system = LinearSystem([*fit.blocks, *data.make_blocks([prediction], first=len(problem.conditions))])
    fresh = [p for p in system.names if p not in fit.system.index]
    return replace(fit, system=system, priors=fit.priors | nuisance_priors(more, fresh, fit.model))


def _all_derivatives(problem: Problem) -> DerivativeRequest:
    return DerivativeRequest(problem.free_keys, True, PRESSURE_MODE_COUNT, False, problem.candidates, True, True)


def _assume_noise(problem: Problem) -> dict[str, NoiseLevels]:
    out = {}
    for v in problem.campaign.views:
        white, pattern = stated_noise(v)
        out[v.file] = NoiseLevels(
            white or DEFAULT_WHITE_NOISE_K, DEFAULT_PATTERN_NOISE_K if pattern is None else pattern
        )
    return out


def _blank_fit(problem: Problem, model: ModelPoint, predictions: list[Prediction]) -> LinearisedFit:
    """A fit without measured values: priors and products only."""
    system = LinearSystem(
        WhitenedData.from_predictions(problem, predictions, noises=_assume_noise(problem)).make_blocks(predictions)
    )
    priors = nuisance_priors(problem, system.names, model)
    usual = Hyperparameters(1.0, TYPICAL_DISCREPANCY, USUAL_CAMERA_ERRORS)
    return LinearisedFit(model, tuple(predictions), system, system.solve(priors), priors, usual, FitStatus.CONVERGED)


def _typical_strengths(tried: Sequence[CandidateEffect]) -> dict[str, tuple[ParameterId, float]]:
    """{effect: (column, typical strength)} of every candidate's first strength."""
    return {c.effect: (c.strength_column(c.leading_strength[0]), abs(c.leading_strength[1])) for c in tried}


def _remaining_z(problem: Problem, fit: LinearisedFit, effects: list[str]) -> dict[str, float]:
    """Signal-to-noise ratio of typical strengths with all nuisances and other effects free."""
    sizes = {e: v for e, v in _typical_strengths(problem.candidates).items() if v[0] in fit.system.index}
    own = {p: v for p, v in fit.priors.items() if p not in {column for column, _ in sizes.values()}}
    out = {}
    for effect in effects:
        if effect not in sizes:
            continue
        rivals: Priors = {column: (0.0, RIVAL_PRIOR_STRENGTHS * a) for e, (column, a) in sizes.items() if e != effect}
        column, a = sizes[effect]
        found = fit.system.project_out(own | rivals, [column], fit.equations)
        out[effect] = a * float(np.sqrt(max(found.information[0, 0], 0.0)))
    return out


def _assess_detectability(problem: Problem, fit: LinearisedFit, separable: Separability) -> tuple[Detectability, ...]:
    left = _remaining_z(problem, fit, list(separable.names))
    by_name: dict[str, CandidateEffect] = {c.effect: c for c in problem.candidates}
    out = []
    for i, effect in enumerate(separable.names):
        c, z = by_name[effect], float(separable.z[i])
        k, a = c.leading_strength
        nearest, rho = separable.nearest_rival(effect)
        size = DETECTION_Z * abs(a) / z if z > MIN_EFFECT_Z else float("inf")
        unit = c.params[k].unit
        out.append(Detectability(effect, str(c.strength_column(k)), unit, z, left.get(effect, 0.0), size, nearest, rho))
    return tuple(sorted(out, key=lambda p: -p.z_left))


def _condition_task(problem: Problem, model: ModelPoint, key: str, factor: float, step: float) -> PredictionTask | None:
    """The first condition with one key changed and the same cameras; None if that is impossible."""
    first = problem.conditions[0]
    case = problem.campaign.load(first.given)
    value = case[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value * factor + step == value:
        return None
    if case["schedule.alone"] and not key.startswith("ambient."):  # nothing slides
        return None
    changed = first.given | {key: float(f"{value * factor + step:.6g}")}
    pins = dict(problem.mesh_overrides[0])
    pins.pop("road.depth", None)
    try:
        scene = problem.campaign.load(changed | pins).scene
    except FlashtempError:
        return None
    pins["road.depth"] = max(float(problem.mesh_overrides[0].get("road.depth", 0.0)), float(scene.mesh.depth[-1]))
    times, repetition = synthetic_recording.frame_schedule(scene.schedule, 4, 1)
    planned = []
    for v in first.views:
        shape = (len(times), len(v.recording.v), len(v.recording.u))
        blank = np.full(shape, scene.ambient - KELVIN)
        recording = replace(v.recording, temperature=blank, time=times, repetition=repetition)
        planned.append(RecordingEntry(f"planned {v.file}", recording, changed, v.sigma_K))
    unshifted = replace(model, shifts={})
    more = _all_derivatives(problem)
    return PredictionTask(problem.case, changed, pins, unshifted, tuple(planned), (), more)


def candidate_sensor_recordings(problem: Problem) -> list[RecordingEntry]:
    """One empty recording for every position, named after it; none if the campaign has no thermocouples.

    Each is read, and its place known, like the first recording of points of the first condition.
    """
    first = problem.conditions[0]
    like = next((v for v in first.views if v.recording.places is not None), None)
    if like is None or like.recording.places is None:
        return []
    scene, r = problem.campaign.load(first.given | problem.mesh_overrides[0]).scene, like.recording
    out = []
    for words, places in _iter_positions(scene.length, scene.height, like.recording.places):
        blank = synthetic_recording.empty_sensor_recording(places, scene, r.time, r.repetition, r.netd_K or 0.05)
        out.append(RecordingEntry(words, blank, first.given, like.sigma_K))
    return out


def _iter_positions(length: float, height: float, like: SensorPositions) -> Iterator[tuple[str, SensorPositions]]:
    """Words and position of every node; one column if all existing thermocouples are at one x."""
    alone = np.ptp(like.x) == 0.0
    for x in (float(like.x[0]),) if alone else tuple(length * a for a in LENGTH_FRACTIONS):
        for z in (height * u for u in HEIGHT_FRACTIONS):
            alike = ("lag_s", "lag_sigma_s", "place_sigma_m", "depth_sigma_m", "gain_sigma", "zero_sigma_K")
            known = {k: [float(getattr(like, k).max())] for k in alike}
            words = f"at x = {1e3 * x:.3g} mm, z = {1e3 * z:.3g} mm"
            yield words, positions_from_arrays((words,), {"x": [x], "z": [z]} | known)
