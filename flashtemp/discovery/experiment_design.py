"""Before measuring: which effects planned views and conditions can tell apart, and which experiment to add.

Nothing measured is needed: what a camera would show of every effect, and what calibration would take of it,
follows from the model.  The experiment to add is the one that leaves most of the worst-known effect
(T-optimal design, Atkinson & Fedorov 1975).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flashtemp.camera import synthetic
from flashtemp.comparison.campaign import Condition, View
from flashtemp.comparison.compare import levels
from flashtemp.comparison.noise import Noise
from flashtemp.discovery import sensor_positions
from flashtemp.discovery.estimation.camera_error_columns import USUAL
from flashtemp.discovery.estimation.fitting import Watch
from flashtemp.discovery.estimation.hyperparameters import Hyperparameters
from flashtemp.discovery.estimation.linear_gaussian import System
from flashtemp.discovery.estimation.linearised_fit import Fit, Status
from flashtemp.discovery.estimation.model_discrepancy import TYPICAL_DISCREPANCY
from flashtemp.discovery.estimation.nuisance_priors import MODES, nuisance_priors
from flashtemp.discovery.estimation.whitening import Data
from flashtemp.discovery.hypotheses.candidates import Candidate, Model
from flashtemp.discovery.parameters import ParameterId, Priors
from flashtemp.discovery.prediction.prediction import Derivatives, Prediction, Task
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.selection.scores import NOTHING, Separability, separability
from flashtemp.errors import FlashtempError
from flashtemp.physics.quantities import KELVIN
from flashtemp.showing import Sheet, Shown

SURE = 5.0  # signal to noise at which an effect is told from all others
RIVALS = 3.0  # typical strengths that every rival may take meanwhile
WHITE, PATTERN = 0.05, 0.03  # K: noise of a camera of which nothing is said
ADDED: tuple[tuple[str, str, float, float], ...] = (  # words, key, factor or difference
    ("at three times the speed", "schedule.speed", 3.0, 0.0),
    ("at a third of the speed", "schedule.speed", 1 / 3, 0.0),
    ("at twice the pressure", "contact.pressure", 2.0, 0.0),
    ("at half the pressure", "contact.pressure", 0.5, 0.0),
    ("with the laboratory 20 K warmer", "ambient.temperature", 1.0, 20.0),
    ("with ten times the wait between repetitions", "schedule.wait", 10.0, 0.0),
)


@dataclass(frozen=True)
class Detectability:
    """What planned data would say of one effect: `z` of its typical strength beside all nuisances, `z_left` beside
    all rivals too, `detectable` strength at 5 sigma in `unit`, and the `nearest` rival with correlation `rho`."""

    effect: str
    parameter: str
    unit: str
    z: float
    z_left: float
    detectable: float
    nearest: str
    rho: float

    @property
    def separable(self) -> bool:
        return self.z_left >= SURE


@dataclass(frozen=True)
class Experiment:
    """One more condition: `words`, its overrides, and what it would leave of every effect `z_left` {effect: z}."""

    words: str
    given: dict[str, Any]
    z_left: dict[str, float]
    helps: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Outlook(Shown):
    """Everything that can be said before measuring; `experiments` the most useful first."""

    title: str
    prospects: tuple[Detectability, ...]
    separability: Separability
    experiments: tuple[Experiment, ...]
    sensors: tuple[Experiment, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain data for --json and plan.json."""
        return {
            "title": self.title,
            "effects": [vars(p) | {"separable": p.separable} for p in self.prospects],
            "separability": {"effects": list(self.separability.names), "rho": self.separability.rho.tolist()},
            "experiments": [vars(e) for e in self.experiments],
            "sensors": [vars(e) for e in self.sensors],
        }

    def sheet(self) -> Sheet:
        head = ("effect", "z", "z left", "told", "5 sigma at", "unit", "nearest rival", "correlation")
        rows = [
            (p.effect, p.z, p.z_left, p.separable, p.detectable, p.unit, p.nearest, p.rho) for p in self.prospects
        ]  # fmt: skip
        added = [f"add one condition {e.words}: separates {', '.join(e.helps) or 'nothing more'}"
                 for e in self.experiments[:3]]  # fmt: skip
        added += [_sensor_words(e) for e in self.sensors[:1]]
        return Sheet(self._heading(), rows, head, added)

    def _heading(self) -> str:
        good = sum(p.separable for p in self.prospects)
        return f"Plan '{self.title}': {good} of {len(self.prospects)} effects can be told from all others"

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
        lines += [f"  {_sensor_words(e)}" for e in self.sensors[:1]]
        return "\n".join(lines)


def _sensor_words(e: Experiment) -> str:
    """Where the next thermocouple belongs, and what it would leave of every effect."""
    left = ", ".join(f"{name} {z:.1f}" for name, z in sorted(e.z_left.items(), key=lambda item: item[1]))
    return f"next thermocouple {e.words}: sigma left beside all rivals {left}"


def plan(problem: Problem, watch: Watch = lambda text: None) -> Outlook:
    """The outlook of a campaign whose recordings may be blank.  Raises BadInput, SolverFailure."""
    model, began = problem.start, time.monotonic()
    watch(f"traces of all candidates under {len(problem.conditions)} conditions")
    predictions = problem.predictions(problem.tasks(model, _everything(problem)))
    fit = _blank_fit(problem, model, predictions)
    separable = separability(fit, problem.candidates)
    prospects = _prospects(problem, fit, separable)
    weak = [p.effect for p in prospects if p.z > NOTHING and not p.separable]
    gone = time.monotonic() - began
    left = gone * len(ADDED) / len(problem.conditions) if weak else 0.0
    watch(f"what a further condition or sensor would tell ({gone:.0f} s, about {left:.0f} s left)")
    added = experiments(problem, fit, weak) if weak else ()
    known = [p.effect for p in prospects if p.z > NOTHING]
    places = rank_sensor_positions(problem, fit, weak or known)
    return Outlook(problem.campaign.title, prospects, separable, added, places)


def rank_sensor_positions(problem: Problem, fit: Fit, effects: list[str]) -> tuple[Experiment, ...]:
    """One more thermocouple at every place of a grid in the block of the first condition, the most useful first.

    Only where the campaign has thermocouples; ranked by what each leaves of the worst-known of some effects.
    """
    views = sensor_positions.candidate_sensor_recordings(problem)
    if not views or not effects:
        return ()
    task = Task(
        problem.case, problem.conditions[0].given, problem.pins[0], replace(fit.model, shifts={}), tuple(views), (),
        _everything(problem),
    )  # fmt: skip
    [prediction] = problem.predictions([task])
    now, out = _left(problem, fit, effects), []
    for view in views:
        left = _left(problem, _wider(problem, fit, replace(task, views=(view,)), prediction), effects)
        helps = tuple(e for e in effects if left.get(e, 0.0) >= SURE > now.get(e, 0.0))
        out.append(Experiment(view.file, task.given, left, helps))
    return tuple(sorted(out, key=lambda e: (-len(e.helps), -min(e.z_left.values(), default=0.0))))


def suggest_experiment(problem: Problem, fit: Fit, alike: tuple[str, ...]) -> str:
    """The experiment that would separate effects which explain the same data equally well, in words."""
    found = experiments(problem, fit, list(alike))
    if not found:
        return "no further condition was found that separates them; measure the pressure or the friction directly"
    best = found[0]
    least = min(best.z_left[e] for e in alike if e in best.z_left)
    return f"measure one more condition {best.words}: it would tell {' and '.join(alike)} apart by {least:.0f} sigma"


def experiments(problem: Problem, fit: Fit, effects: list[str]) -> tuple[Experiment, ...]:
    """One more condition of each kind, ranked by what it leaves of the worst of some effects."""
    now = _left(problem, fit, effects)
    asked = [(words, _task(problem, fit.model, key, factor, step)) for words, key, factor, step in ADDED]
    tasks = {words: task for words, task in asked if task is not None}
    out = []
    for (words, task), answer in zip(tasks.items(), problem.run(list(tasks.values())), strict=True):
        if isinstance(answer, Prediction):
            left = _left(problem, _wider(problem, fit, task, answer), effects)
            helps = tuple(e for e in effects if left.get(e, 0.0) >= SURE > now.get(e, 0.0))
            out.append(Experiment(words, task.given, left, helps))
    return tuple(sorted(out, key=lambda e: (-len(e.helps), -min(e.z_left.values(), default=0.0))))


def _wider(problem: Problem, fit: Fit, task: Task, prediction: Prediction) -> Fit:
    """A fit with the data of one more condition, of which nothing but their noise is known."""
    campaign = replace(problem.campaign, views=task.views, forces=())
    more = replace(problem, campaign=campaign, conditions=(Condition(task.given, task.views, ()),))
    data = Data.begin(more, [prediction], noises=_noises(more))
    system = System([*fit.blocks, *data.blocks([prediction], first=len(problem.conditions))])
    fresh = [p for p in system.names if p not in fit.system.index]
    return replace(fit, system=system, priors=fit.priors | nuisance_priors(more, fresh, fit.model))


def _everything(problem: Problem) -> Derivatives:
    return Derivatives(problem.free, True, MODES, False, problem.candidates, True, True)


def _noises(problem: Problem) -> dict[str, Noise]:
    out = {}
    for v in problem.campaign.views:
        white, pattern = levels(v)
        out[v.file] = Noise(white or WHITE, PATTERN if pattern is None else pattern)
    return out


def _blank_fit(problem: Problem, model: Model, predictions: list[Prediction]) -> Fit:
    """A fit of nothing: priors and products only."""
    system = System(Data.begin(problem, predictions, noises=_noises(problem)).blocks(predictions))
    priors = nuisance_priors(problem, system.names, model)
    usual = Hyperparameters(1.0, TYPICAL_DISCREPANCY, USUAL)
    return Fit(model, tuple(predictions), system, system.solve(priors), priors, usual, Status.CONVERGED)


def _sizes(tried: Sequence[Candidate]) -> dict[str, tuple[ParameterId, float]]:
    """{effect: (column, typical strength)} of every candidate's first strength."""
    return {c.effect: (c.column(c.first[0]), abs(c.first[1])) for c in tried}


def _left(problem: Problem, fit: Fit, effects: list[str]) -> dict[str, float]:
    """Signal to noise that is left of typical strengths while all nuisances and rivals are free."""
    sizes = {e: v for e, v in _sizes(problem.candidates).items() if v[0] in fit.system.index}
    own = {p: v for p, v in fit.priors.items() if p not in {column for column, _ in sizes.values()}}
    out = {}
    for effect in effects:
        if effect not in sizes:
            continue
        rivals: Priors = {column: (0.0, RIVALS * a) for e, (column, a) in sizes.items() if e != effect}
        column, a = sizes[effect]
        found = fit.system.projected(own | rivals, [column], fit.equations)
        out[effect] = a * float(np.sqrt(max(found.information[0, 0], 0.0)))
    return out


def _prospects(problem: Problem, fit: Fit, separable: Separability) -> tuple[Detectability, ...]:
    left = _left(problem, fit, list(separable.names))
    by_name: dict[str, Candidate] = {c.effect: c for c in problem.candidates}
    out = []
    for i, effect in enumerate(separable.names):
        c, z = by_name[effect], float(separable.z[i])
        k, a = c.first
        nearest, rho = separable.nearest(effect)
        size = SURE * abs(a) / z if z > NOTHING else float("inf")
        unit = c.params[k].unit
        out.append(Detectability(effect, str(c.column(k)), unit, z, left.get(effect, 0.0), size, nearest, rho))
    return tuple(sorted(out, key=lambda p: -p.z_left))


def _task(problem: Problem, model: Model, key: str, factor: float, step: float) -> Task | None:
    """The first condition with one key changed, seen by the same cameras; None where that cannot be."""
    first = problem.conditions[0]
    case = problem.campaign.load(first.given)
    value = case[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value * factor + step == value:
        return None
    if case["schedule.alone"] and not key.startswith("ambient."):  # nothing slides
        return None
    changed = first.given | {key: float(f"{value * factor + step:.6g}")}
    pins = dict(problem.pins[0])
    pins.pop("road.depth", None)
    try:
        scene = problem.campaign.load(changed | pins).scene
    except FlashtempError:
        return None
    pins["road.depth"] = max(float(problem.pins[0].get("road.depth", 0.0)), float(scene.mesh.depth[-1]))
    times, repetition = synthetic.moments(scene.schedule, 4, 1)
    planned = []
    for v in first.views:
        shape = (len(times), len(v.recording.v), len(v.recording.u))
        blank = np.full(shape, scene.ambient - KELVIN)
        recording = replace(v.recording, temperature=blank, time=times, repetition=repetition)
        planned.append(View(f"planned {v.file}", recording, changed, v.sigma_K))
    unshifted = replace(model, shifts={})
    more = _everything(problem)
    return Task(problem.case, changed, pins, unshifted, tuple(planned), (), more)
