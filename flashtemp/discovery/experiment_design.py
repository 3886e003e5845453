"""Before measuring: which effects planned views and conditions can tell apart, and which experiment to add.

Nothing measured is needed: what a camera would show of every effect, and what calibration would take of it,
follows from the model.  The experiment to add is the one that leaves most of the worst-known effect
(T-optimal design, Atkinson & Fedorov 1975).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flashtemp.camera import synthetic
from flashtemp.comparison.campaign import View
from flashtemp.comparison.noise import Noise
from flashtemp.discovery.calibration import Fit
from flashtemp.discovery.hypothesis import Candidate, Model
from flashtemp.discovery.linear_gaussian import System
from flashtemp.discovery.prediction import Look, Task, Wanted
from flashtemp.discovery.problem import MODES, Data, Study, nuisances
from flashtemp.discovery.scores import NOTHING, Separability, separability
from flashtemp.errors import FlashtempError
from flashtemp.model import case as cases
from flashtemp.physics.quantities import KELVIN

SURE = 5.0  # signal to noise at which an effect is told from all others
RIVALS = 3.0  # typical strengths that every rival may take meanwhile
WHITE, PATTERN = 0.05, 0.03  # K: noise of a camera of which nothing is said
ADDED = (  # words, key, factor or difference
    ("at three times the speed", "schedule.speed", 3.0, 0.0),
    ("at a third of the speed", "schedule.speed", 1 / 3, 0.0),
    ("at twice the pressure", "contact.pressure", 2.0, 0.0),
    ("at half the pressure", "contact.pressure", 0.5, 0.0),
    ("with the laboratory 20 K warmer", "ambient.temperature", 1.0, 20.0),
    ("with ten times the wait between repetitions", "schedule.wait", 10.0, 0.0),
)


@dataclass(frozen=True)
class Prospect:
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


@dataclass(frozen=True)
class Outlook:
    """Everything that can be said before measuring; `experiments` the most useful first."""

    title: str
    prospects: tuple[Prospect, ...]
    separability: Separability
    experiments: tuple[Experiment, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain data for --json and plan.json."""
        return {
            "title": self.title,
            "effects": [vars(p) | {"separable": p.separable} for p in self.prospects],
            "separability": {"effects": list(self.separability.names), "rho": self.separability.rho.tolist()},
            "experiments": [vars(e) for e in self.experiments],
        }

    def __str__(self) -> str:
        good = sum(p.separable for p in self.prospects)
        lines = [f"Plan '{self.title}': {good} of {len(self.prospects)} effects can be told from all others"]
        lines.append(f"  {'effect':26s} {'z':>8s} {'z left':>8s}  {'5 sigma at':>24s}  nearest rival")
        for p in self.prospects:
            size = f"{p.detectable:.3g} {'' if p.unit == '1' else p.unit}" if np.isfinite(p.detectable) else "never"
            lines.append(f"  {p.effect:26s} {p.z:8.1f} {p.z_left:8.1f}  {size:>24s}  {p.nearest} ({p.rho:+.2f})")
        for e in self.experiments[:3]:
            what = ", ".join(e.helps) or "nothing more"
            lines.append(f"  add one condition {e.words}: separates {what}")
        return "\n".join(lines)


def plan(study: Study) -> Outlook:
    """The outlook of a campaign whose recordings may be blank.  Raises BadInput, SolverFailure."""
    data = Data(study, noises=_noises(study))
    model = Model({k: 0.0 for k in study.campaign.free})
    looks = _checked(study.run(study.tasks(model, _everything(study), {})))
    fit = _blank_fit(study, data, model, looks)
    sep = separability(fit, list(study.tried))
    prospects = _prospects(study, fit, sep)
    weak = [p.effect for p in prospects if p.z > NOTHING and not p.separable]
    added = experiments(study, fit, weak) if weak else ()
    return Outlook(study.campaign.title, prospects, sep, added)


def advise(study: Study, fit: Fit, alike: tuple[str, ...]) -> str:
    """The experiment that would separate effects which explain the same data equally well, in words."""
    found = experiments(study, fit, list(alike))
    if not found:
        return "no further condition was found that separates them; measure the pressure or the friction directly"
    best = found[0]
    least = min(best.z_left[e] for e in alike if e in best.z_left)
    return f"measure one more condition {best.words}: it would tell {' and '.join(alike)} apart by {least:.0f} sigma"


def experiments(study: Study, fit: Fit, effects: list[str]) -> tuple[Experiment, ...]:
    """One more condition of each kind, ranked by what it leaves of the worst of some effects."""
    now = _left(study, fit, effects)
    tasks = {words: _task(study, fit.model, *change) for words, *change in ADDED}
    tasks = {words: task for words, task in tasks.items() if task is not None}
    out = []
    for (words, task), look in zip(tasks.items(), study.run(list(tasks.values())), strict=True):
        if isinstance(look, Exception):
            continue
        more = replace(study, conditions=((task.given, task.views, ()),))
        extra = Data(more, noises={v.file: Noise(WHITE, PATTERN) for v in task.views})
        extra.fix([look], [])
        number = len(study.conditions)
        blocks = [replace(b, condition=number, names=_renumbered(b.names, number)) for b in extra.blocks([look])]
        system = System([*fit.blocks, *blocks])
        wider = replace(fit, system=system, blocks=system.blocks, priors=fit.priors | _priors(study, system, fit))
        left = _left(study, wider, effects)
        helps = tuple(e for e in effects if left.get(e, 0.0) >= SURE > now.get(e, 0.0))
        out.append(Experiment(words, task.given, left, helps))
    return tuple(sorted(out, key=lambda e: (-len(e.helps), -min(e.z_left.values(), default=0.0))))


def _everything(study: Study) -> Wanted:
    return Wanted(study.campaign.free, True, MODES, False, study.tried, True)


def _noises(study: Study) -> dict:
    out = {}
    for v in study.campaign.views:
        r = v.recording
        white = v.sigma_K or r.netd_K or WHITE
        out[v.file] = Noise(white, PATTERN if r.fixed_pattern_K is None else r.fixed_pattern_K)
    return out


def _checked(looks: list) -> list[Look]:
    for answer in looks:
        if isinstance(answer, FlashtempError):
            raise answer
    return looks


def _blank_fit(study: Study, data: Data, model: Model, looks: list[Look]) -> Fit:
    """A fit of nothing: priors and products only."""
    data.fix(looks, [])
    blocks = data.blocks(looks)
    system = System(blocks)
    priors = nuisances(study, system.names, model, {})
    return Fit(model, {}, looks, blocks, system, system.solve(priors), priors, 1.0, (0.0,))


def _sizes(tried) -> dict[str, tuple[str, float]]:
    """{effect: (column, typical strength)} of every candidate's first strength."""
    out = {}
    for c in tried:
        k, a = next(iter(c.strengths.items()))
        out[c.effect] = (c.column(k), abs(a))
    return out


def _left(study: Study, fit: Fit, effects: list[str]) -> dict[str, float]:
    """Signal to noise that is left of typical strengths while all nuisances and rivals are free."""
    sizes = {e: v for e, v in _sizes(study.tried).items() if v[0] in fit.system.index}
    own = {n: v for n, v in fit.priors.items() if n not in {c for c, _ in sizes.values()}}
    products = fit.system.total()
    out = {}
    for effect in effects:
        if effect not in sizes:
            continue
        rivals = {c: (0.0, RIVALS * a) for e, (c, a) in sizes.items() if e != effect}
        column, a = sizes[effect]
        _, info, _ = fit.system.projected(own | rivals, [column], products)
        out[effect] = a * float(np.sqrt(max(info[0, 0], 0.0)))
    return out


def _prospects(study: Study, fit: Fit, sep: Separability) -> tuple[Prospect, ...]:
    left = _left(study, fit, list(sep.names))
    by_name: dict[str, Candidate] = {c.effect: c for c in study.tried}
    out = []
    for i, effect in enumerate(sep.names):
        c, z = by_name[effect], float(sep.z[i])
        k, a = next(iter(c.strengths.items()))
        nearest, rho = sep.nearest(effect) if len(sep.names) > 1 else ("none", 0.0)
        size = SURE * abs(a) / z if z > NOTHING else float("inf")
        unit = c.kind.params()[k].unit
        out.append(Prospect(effect, f"{effect}.{k}", unit, z, left.get(effect, 0.0), size, nearest, rho))
    return tuple(sorted(out, key=lambda p: -p.z_left))


def _task(study: Study, model: Model, key: str, factor: float, step: float) -> Task | None:
    """The first condition with one key changed, seen by the same cameras; None where that cannot be."""
    given, views, _ = study.conditions[0]
    case = study.campaign.load(given)
    value = case[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value * factor + step == value:
        return None
    changed = given | {key: float(f"{value * factor + step:.6g}")}
    pins = dict(study.pins[0])
    pins.pop("road.depth", None)
    try:
        scene = cases.build(cases.load(study.campaign.case, changed | pins))
    except FlashtempError:
        return None
    pins["road.depth"] = max(float(study.pins[0].get("road.depth", 0.0)), float(scene.mesh.depth[-1]))
    times, repetition = synthetic.moments(scene.schedule, 4, 1)
    planned = []
    for v in views:
        shape = (len(times), len(v.recording.v), len(v.recording.u))
        blank = np.full(shape, scene.ambient - KELVIN)
        recording = replace(v.recording, temperature=blank, time=times, repetition=repetition)
        planned.append(View(f"planned {v.file}", recording, changed, v.sigma_K))
    return Task(study.campaign.case, changed, pins, model, tuple(planned), (), _everything(study), {})


def _renumbered(names, number: int):
    return tuple((n.rsplit("|", 1)[0] + f"|{number}" if n.endswith("|0") else n, c) for n, c in names)


def _priors(study: Study, system: System, fit: Fit) -> dict[str, tuple[float, float]]:
    """Priors of the nuisances that only the added condition has."""
    fresh = [n for n in system.names if n not in fit.system.index]
    planned = replace(study.campaign, views=tuple(
        replace(v, file=f"planned {v.file}") for v in study.campaign.views))  # fmt: skip
    return nuisances(replace(study, campaign=planned), fresh, fit.model, {})
