"""The fit of a model's parameters to a campaign: Gauss-Newton with a certificate that the next step is negligible."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from flashtemp.discovery.fit import ENOUGH, KNOWN, LITTLE, Fit, Reached
from flashtemp.discovery.hypothesis import Candidate, Model
from flashtemp.discovery.linear_gaussian import Solution, System
from flashtemp.discovery.parameters import BEADS, OF_THE_LABORATORY, PLACED, SHIFTS, Kind, ParameterId, Prior, Priors
from flashtemp.discovery.prediction import Derivatives, Prediction, Task
from flashtemp.discovery.problem import Problem
from flashtemp.discovery.scales import Scaled, solved
from flashtemp.discovery.whitening import Data

SHIFTED = 0.2  # of it counts for the place of an image: 0.05 of what is known of it moves no pixel's value
TRIES = 12
LONGEST = 1.5  # step, in prior standard deviations
BACK, WORSE, TIGHT = 3, 2.0, 1e-6  # steps back in a row, the loss that asks for one, and what stands still
ONCE = 1  # step back in a row where a model misfits grossly
CHORD, CONTRACTS = 0.3, 0.5  # step after which traces stay as they are, and how much shorter the next must then be
FLAT = 30.0  # ln evidence that it may promise: of more, the little that traces are wrong by then is much
SHORTER, LONGER = 0.25, 2.0  # of the last step: the next from the best point after a loss, and after a gain
VAIN = 0.25  # ln evidence: what gains less was in vain, where it promised little or where a longer step lost
FEW = 6  # tries that are enough where a model misfits grossly
HELPS = 8.0  # ln evidence gained by the last of them, more than LITTLE of a gross misfit: then twice as many
LEAPS = 0.1  # of a gross misfit gained by the last of them: more may follow than a step promises, which is linear
NEAR = 0.05  # longest step, in prior standard deviations, after which a loss is that of numerics
MOSTLY = 0.7  # of what a step may explain: what physics must explain alone, lest images and clocks move for it
DAMPING = 0.3  # of the width of priors, again and again until a step is short enough
BENDS_LITTLE = (*SHIFTS, Kind.CLOCK)  # traces of images and of what warms slowly stay, as far as they go at a time
# what moves the last of a hundred pixels by a tenth of itself, or road by less than a pixel, is linear
FAINT = {Kind.SCALE: 1e-3, Kind.TURN: 1e-3, Kind.CLOCK: 5e-3, Kind.SIZE: 2e-3}  # relative, rad, s, relative


@dataclass(frozen=True)
class Pointed:
    """Where a fit pointed, `steps` of all that moves, and the `share` of them that was taken."""

    steps: dict[ParameterId, float]
    share: float


@dataclass(frozen=True)
class Descent:
    """One model on its way to its best point: `tasks` ask for the next predictions, `take` gives the next state.

    `effects` candidates that the model holds and moves; `rough`: a model that misfits grossly need not be exact
    (what extends it must).  `fit` at the best point so far, `trust` how long a step may be (in prior standard
    deviations) after one that lost, `back` steps back in a row, `tried` points in all, `gained` ln evidence by the last
    that was no step back; `bent` whether traces are taken anew at the next point (after a short step they are not:
    whoever needs them exact traces the end once more); `failed` says why it ends.  What extends a traced `parent` has
    only what is new traced and borrows the other traces from it, as long as its steps grow shorter.
    """

    problem: Problem
    data: Data
    model: Model
    effects: tuple[Candidate, ...] = ()
    derivatives: Derivatives = field(default_factory=Derivatives)
    rough: bool = True
    history: tuple[float, ...] = ()
    fit: Fit | None = None
    failed: str = ""
    best: Reached | None = None
    trust: float = np.inf
    back: int = 0
    tried: int = 0
    bent: bool = True
    parent: Fit | None = None
    last: Pointed | None = None
    gained: float = 0.0

    @property
    def priors(self) -> Priors:
        """Of the parameters of effects that may move."""
        return {p: v for c in self.effects for p, v in c.priors().items()}

    def tasks(self) -> list[Task]:
        """What to predict next."""
        if not self.bent:
            return self.problem.tasks(self.model, Derivatives())
        if self.parent is not None:
            new = tuple(p for p in self.priors if not self._lends(p))
            return self.problem.tasks(self.model, replace(self.derivatives, own=new))
        own = (*self.problem.free, *self.priors)
        return self.problem.tasks(self.model, replace(self.derivatives, own=own, optics=True, laboratory=True))

    def _lends(self, p: ParameterId) -> bool:
        """Whether the parent has a trace that holds here too: of all but effects and keys that it does not hold."""
        assert self.parent is not None
        if p.kind is Kind.EFFECT:
            return p.effect in self.parent.model.effects
        return p.kind is not Kind.KEY or p in self.problem.free

    @property
    def done(self) -> bool:
        if self.fit is None or self.failed:
            return bool(self.failed)
        short = self.bent or self.history[-1] < ENOUGH  # where traces stay, one look more costs little
        exact = self.rough or self.best is None or self.best.own
        rough = self.rough and self.fit.hopeless
        if (self.fit.converged and self.fit.placed and short and exact) or self.back > (ONCE if rough else BACK):
            return True
        helps = max(HELPS, LITTLE * self.fit.misfit if rough else 0.0)
        most = (FEW if rough else TRIES) * (2 if self.gained > helps else 1)
        little = LEAPS * self.fit.misfit
        calm = len(self.history) > 1 and self.gained < little
        ends = self.fit.usable or (not self.effects and self.fit.promise < little)  # the believed model misfits anyway
        return (rough and calm and ends) or len(self.history) >= most or self.tried >= most + BACK

    def take(self, predictions: Sequence[Prediction]) -> Descent:
        """Linearise at the present point and move to where it points; after a loss, back to the best point and on from
        there by a shorter and more cautious step."""
        if self.fit is not None and not self.bent:
            system = self.fit.system.shown(self.data.residuals(predictions))
        else:
            blocks = self.data.blocks(predictions)
            if self.parent is not None:
                blocks = [b.joined(o, self._lends) for b, o in zip(blocks, self.parent.blocks, strict=True)]
            system = System(blocks)
        return self.linearised(system, [p.bare for p in predictions])

    def linearised(self, system: System, predictions: Sequence[Prediction]) -> Descent:
        """The next state from the columns at the present point."""
        found, bound = self._within_bounds(system)
        steps = self._steps(found.solution, found.priors)
        value, chi2 = self._standing(system, found.priors, steps)
        last = self._comparable
        if last is not None and value < last.ln_evidence - WORSE:
            if not last.own:
                return self._anew(last.fit)
            if not self.bent:  # the traces may be to blame, not the point
                return replace(self, tried=self.tried + 1, bent=True)
            near = self.trust < NEAR or last.fit.promise < KNOWN  # so near that what is lost is no loss
            noisy = replace(last.fit, noisy=near)
            return replace(self, fit=noisy, bent=True) if noisy.converged else self.retreat(last.fit)
        promise = 0.5 * (chi2 - found.solution.chi2)
        sizes = {p: self._size(p, s, found.priors, self.model) for p, s in steps.items()}
        history = (*self.history, _longest(sizes, SHIFTS))
        gained = np.inf if last is None else value - last.ln_evidence
        fit = Fit(
            self.model, tuple(predictions), system, found.solution, found.priors, history, bound, promise,
            vain=gained < VAIN and max(last.fit.promise if last else np.inf, promise) < KNOWN,
            noisy=gained < VAIN and self.back > 0, adrift=self._adrift(system, sizes),
        )  # fmt: skip
        contracts = len(history) < 2 or history[-1] < CONTRACTS * history[-2]
        lent = self.parent if contracts and (self.rough or not fit.converged) else None
        stays = self.rough and (self.bent or contracts) and _longest(sizes, BENDS_LITTLE) < CHORD and promise < FLAT
        now = replace(
            self, history=history, fit=fit, best=Reached(fit, value, self.parent is None), trust=LONGER * self.trust,
            back=0, tried=self.tried + 1, bent=not stays, parent=lent, gained=gained if last is not None else 0.0,
        )  # fmt: skip
        return now if now.done else now._onward(fit)

    def _adrift(self, system: System, sizes: dict[ParameterId, float]) -> float:
        """The longest of steps that only data which are held out ask for."""
        seen = system.seen
        return _longest({p: size for p, size in sizes.items() if p not in seen}, SHIFTS)

    def _standing(self, system: System, priors: Priors, steps: Collection[ParameterId]) -> tuple[float, float]:
        """ln evidence at the point itself, and chi2 before `steps` are taken: what moves stands still, the rest free.

        For evidence errors of the laboratory reach no farther than they are linear, else a point counts for far ones;
        and deviations are as large as they are likeliest here, not at the end of the steps.  Images that were held out
        may lie anywhere.
        """
        seen = system.seen
        priors = self._of_views({p: v for p, v in priors.items() if p in seen})
        near = {p: (0.0, min(sd, FAINT[p.kind])) for p, (_, sd) in priors.items() if p.kind in FAINT}
        moved = {p for p in (*steps, *map(self._of_the_view, steps)) if p in priors}
        still = {p: (0.0, TIGHT * priors[p][1]) for p in moved}
        own = {p: priors[p] for p in self.priors.keys() & priors.keys()}
        here = solved(self.problem, system, self.model, own | still | near).solution
        before = system.solve(priors | still).chi2
        return here.ln_evidence - 0.5 * _pulls(priors, still | near), before + _pulls(priors, still)

    def _of_views(self, priors: Priors) -> Priors:
        """Priors seen from where an error that all recordings of a view may have explains most of where they stand: it
        takes what their own would pay for, and the sum of both, which alone is seen, stays."""
        out = dict(priors)
        for q, (mean, sd) in priors.items():
            if q.kind in PLACED and not q.file:
                files = {p: (m, s**-2) for p, (m, s) in priors.items() if self._of_the_view(p) == q}
                weight = sum(w for _, w in files.values()) + sd**-2
                common = (mean * sd**-2 - sum(m * w for m, w in files.values())) / weight
                out |= {p: (m + common, priors[p][1]) for p, (m, _) in files.items()}
                out[q] = (mean - common, sd)
        return out

    @property
    def _comparable(self) -> Reached | None:
        """The best point so far, where its evidence can be held against the next: traces of a parent flatter."""
        return self.best if self.best is not None and (self.best.own or self.parent is not None) else None

    def _anew(self, best: Fit) -> Descent:
        """Back to the best point with traces of its own: with those of a parent it may look better than it is."""
        return replace(self, model=best.model, best=None, tried=self.tried + 1, bent=True, parent=None, last=None)

    def retreat(self, best: Fit) -> Descent:
        """Back to the best point, and on from there by a shorter step than the one that lost."""
        last = min(LONGEST, self._far(self._steps(best.solution, best.priors), best))
        cautious = replace(
            self, trust=SHORTER * min(self.trust, last), back=self.back + 1, tried=self.tried + 1, bent=True,
            parent=None, last=None,
        )  # fmt: skip
        return cautious._onward(best)

    def _onward(self, fit: Fit) -> Descent:
        """Where a fit points, no farther than is trusted: the nearer, the more along the steepest way."""
        steps = self._physical(fit) or self._steps(fit.solution, fit.priors)
        if self.trust < LONGEST:
            damped, moving = fit.priors, {*steps, *map(self._of_the_view, steps)}
            while self._far(steps, fit) > self.trust:
                damped = {p: self._damped(p, damped[p], p in moving) for p in damped}
                steps = self._steps(fit.system.solve(damped), damped, frozenset(steps))
        steps = {p: self._likely(p, s, fit) for p, s in steps.items()}
        share = min(1.0, LONGEST / max(self._far(steps, fit), 1e-300), self._beyond(steps, fit))
        model = self._moved(fit, {p: share * float(s) for p, s in steps.items()})
        return replace(self, model=model, last=Pointed(steps, share))

    def _physical(self, fit: Fit) -> dict[ParameterId, float]:
        """Steps of effects and keys alone, of a model that misfits grossly, if they explain most of it: images must not
        be dragged, nor clocks put off, by what physics will do.  Else none."""
        if not (fit.hopeless and self.priors):
            return {}
        free = {p: v for p, v in fit.effects.items() if p not in fit.bound}
        found = fit.solved(replace(self.problem, stiff=True), free)
        if 0.5 * (found.solution.chi2 - fit.solution.chi2) > (1.0 - MOSTLY) * fit.promise:
            return {}
        own = (*SHIFTS, *OF_THE_LABORATORY)
        return {p: s for p, s in self._steps(found.solution, found.priors).items() if p.kind not in own}

    def _likely(self, p: ParameterId, step: float, fit: Fit) -> float:
        """A step of an error of the laboratory, no longer than one may be: a clock must not hold up all else."""
        most = LONGEST * fit.priors[p][1] if p.kind in OF_THE_LABORATORY else np.inf
        return float(np.clip(step, -most, most))

    def _beyond(self, steps: dict[ParameterId, float], fit: Fit) -> float:
        """Share of steps to take where they point back: the secant's, so that no shape goes to and fro for ever."""
        if self.last is None:
            return 1.0
        before = self.last.steps
        width = {p: self._size(p, 1.0, fit.priors, fit.model) for p in steps.keys() & before.keys()}
        along, back = (sum(s[p] * before[p] * w**2 for p, w in width.items()) for s in (before, steps))
        return self.last.share * along / (along - back) if back < 0.0 else 1.0

    def _damped(self, p: ParameterId, prior: Prior, moving: bool) -> Prior:
        """A prior drawn to the present point, for what moves."""
        mean, sd = prior
        return (mean * DAMPING**2, sd * DAMPING) if moving else prior

    def _steps(
        self, solution: Solution, priors: Priors, only: frozenset[ParameterId] | None = None
    ) -> dict[ParameterId, float]:
        """What a solution moves, images by what their view shares besides; mere columns left out."""
        found = {p: solution[p] + self._shared(solution, p) for p in solution.names if p in priors}
        return {p: s for p, s in found.items() if (p in only if only is not None else self._moves(p, s))}

    def _shared(self, solution: Solution, p: ParameterId) -> float:
        """What all recordings of the view have besides."""
        both = self._of_the_view(p)
        return solution[both] if both is not None and both in solution.names else 0.0

    def _of_the_view(self, p: ParameterId) -> ParameterId | None:
        """The error of a recording that all recordings of its view may have."""
        if p.kind not in PLACED or not p.file:
            return None
        view = next(v.recording.view for v in self.problem.campaign.views if v.file == p.file)
        return ParameterId(p.kind, name=view)

    def _far(self, steps: dict[ParameterId, float], fit: Fit) -> float:
        """The longest of steps from a fit, images' places left out."""
        sizes = (self._size(p, s, fit.priors, fit.model) for p, s in steps.items() if p.kind not in SHIFTS)
        return max(sizes, default=0.0)

    def _size(self, p: ParameterId, step: float, priors: Priors, model: Model) -> float:
        """A step in prior standard deviations; of a strength far from off, in shares of that strength instead."""
        return abs(step) / max(priors[p][1], abs(self._strength(p, model)))

    def _strength(self, p: ParameterId, model: Model) -> float:
        """How far a model stands from off in a strength, so that one of a wide range moves by factors."""
        if p not in self.priors:
            return 0.0
        off = self.problem.case.known[p.effect].params()[p.name].off
        return 0.0 if off is None else model.value(p) - off

    def _within_bounds(self, system: System) -> tuple[Scaled, frozenset[ParameterId]]:
        """The solution with all parameters left out that lie on a bound and would be pushed beyond."""
        bound: frozenset[ParameterId] = frozenset()
        about = {p: (mean - self.model.value(p), sd) for p, (mean, sd) in self.priors.items()}
        while True:
            more = {p: v for p, v in about.items() if p not in bound}
            found = solved(self.problem, system, self.model, more)
            step = found.solution
            outside = [p for p in more if p in step.names and self._leaves(p, step[p])]
            if not outside:
                return found, bound
            bound |= {max(outside, key=lambda p: abs(step[p]) / found.priors[p][1])}

    def _moves(self, p: ParameterId, step: float) -> bool:
        """Whether a parameter is no mere column: errors of the laboratory are, as long as no pixel goes far."""
        if p.kind in FAINT:
            return bool(p.file or p.kind is Kind.SIZE) and abs(step) > FAINT[p.kind]
        return p.kind in (Kind.KEY, *BEADS) or p.kind in SHIFTS or p in self.priors

    def _moved(self, fit: Fit, steps: dict[ParameterId, float]) -> Model:
        """The model after steps from a fit, none across a bound."""
        model = fit.model
        for p, step in steps.items():
            if p.kind in SHIFTS:
                shift = list(model.shift(p.file))
                shift[p.axis] += float(np.clip(step, -1.0, 1.0))
                model = replace(model, shifts=model.shifts | {p.file: (shift[0], shift[1])})
            elif p.kind in (Kind.KEY, *BEADS, *OF_THE_LABORATORY):
                model = model.moved(p, step)
            else:
                strength = self._strength(p, model)
                if abs(strength) > fit.priors[p][1] and step * strength < 0.0:  # not to off at one stroke
                    step = -float(np.copysign(min(abs(step), (1.0 - SHORTER) * abs(strength)), strength))
                values = model.effects[p.effect] | {p.name: self._bounded(p, model.value(p) + step)}
                model = model.with_effect(p.effect, values)
        return model

    def _bounded(self, p: ParameterId, value: float) -> float:
        param = self.problem.case.known[p.effect].params()[p.name]
        low = param.low + (1e-3 * abs(param.value) if param.open_low else 0.0)
        return float(np.clip(value, low, param.high))

    def _leaves(self, p: ParameterId, step: float) -> bool:
        """Whether a parameter that lies on its bound would be pushed beyond."""
        value = self.model.value(p)
        return value == self._bounded(p, value) and self._bounded(p, value + step) == value and step != 0.0


def _longest(sizes: dict[ParameterId, float], lightly: tuple[Kind, ...]) -> float:
    """The longest of steps, some kinds of which count `lightly`."""
    return float(max((size * (SHIFTED if p.kind in lightly else 1.0) for p, size in sizes.items()), default=0.0))


def _pulls(priors: Priors, still: Collection[ParameterId]) -> float:
    """chi2 of the priors of what stands still."""
    return sum((priors[p][0] / priors[p][1]) ** 2 for p in still)
