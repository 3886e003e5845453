"""From a search to a verdict: data left out, what is left of each recording, causes, rivals and gates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.comparison.compare import Pulling, Seeing, judge, judge_pull
from flashtemp.discovery import adequacy
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.hypothesis import declaration
from flashtemp.discovery.laboratory import calibrated, found
from flashtemp.discovery.linear_gaussian import Array, Block, Solution, System, change, residual
from flashtemp.discovery.nuisances import is_camera_gain, plain
from flashtemp.discovery.parameters import BEADS, OF_THE_CAMERA, OF_THE_LABORATORY, SHIFTS, Kind, ParameterId
from flashtemp.discovery.scores import Score, Separability, separability
from flashtemp.discovery.search import MOST
from flashtemp.discovery.searched import APART, NAMED, WEAK, Search
from flashtemp.discovery.verdict import Cause, Estimate, Fitness, Pull, Rival
from flashtemp.discovery.whitening import Data
from flashtemp.discovery.wording import called

GENERIC, MODAL, EXCESS = 3.0, 25.0, 12.0  # gates: ln Bayes factor, chi2 of pressure modes, standard errors of chi2
ALLOWED = 3.0  # standard deviations of what was known
HELD = "held out"  # how the fold of recordings and traces is called that are marked so
INFLATED = 1.2  # errors scatter 1.13 times their standard errors (benchmarks/discover.py, seeds below 1000)

Keep = Callable[[Block], bool]


@dataclass(frozen=True)
class LeftOut:
    """How well data are predicted that were left out: `density` (folds,) ln probability of each, root mean square in K
    and in sigma."""

    labels: tuple[str, ...]
    density: Array
    rmse_K: float
    z: float


@dataclass(frozen=True)
class Assessed:
    """A fit with what it says of data left out, and the same as `known` with every recording and trace."""

    fit: Fit
    known: Fit
    left_out: LeftOut
    seeings: tuple[Seeing, ...]
    pullings: tuple[Pulling, ...]
    fitness: Fitness


def assess(search: Search, fit: Fit) -> Assessed:
    """Everything that is asked of the base model and of the extended one alike."""
    known = as_known(fit)
    seeings, pullings = seen(search, known)
    numbers = fitness(known, seeings, left_out(search.data, known))
    return Assessed(fit, known, left_out(search.data, fit), seeings, pullings, numbers)


def as_known(fit: Fit) -> Fit:
    """A fit that may not bend the pressure, the walls or the friction of a repetition: the model as people know it.

    Nothing may go farther than ALLOWED standard deviations from what was known, however badly the model fits.
    """
    priors = plain(fit.priors) | fit.effects
    solution = fit.system.completed(fit.system.bounded(priors, ALLOWED), priors)
    return replace(fit, priors=priors, solution=solution)


# --- data left out -------------------------------------------------------------------------------------
def left_out(data: Data, fit: Fit) -> LeftOut:
    """Predict recordings marked held out; where none is, every condition from the others, or every recording."""
    system = fit.system
    folds = _folds(system)
    densities, squares, kelvins, count, total = [], 0.0, 0.0, 0, 0
    for inside in folds.values():
        every = system.solve(fit.priors, system.total(_with(inside)))
        rest = system.solve(fit.priors, system.total(_without(inside)))
        densities.append(every.ln_evidence - rest.ln_evidence)
        for block in (b for b in system.blocks if inside(b)):
            left = _predicted(system, fit, rest, block)
            squares += float(left @ left)
            total += block.count
            if block.label in data.noises:
                kelvins += float(left @ left) * data.noises[block.label].white ** 2
                count += len(left)
    rmse, z = np.sqrt(kelvins / max(count, 1)), np.sqrt(squares / max(total, 1))
    return LeftOut(tuple(folds), np.array(densities), float(rmse), float(z))


def _folds(system: System) -> dict[str, Keep]:
    if any(b.held_out for b in system.blocks):
        return {HELD: lambda b: b.held_out}
    numbers = sorted({b.condition for b in system.blocks})
    if len(numbers) > 1:
        return {f"condition {n + 1}": _of_condition(n) for n in numbers}
    return {b.label: _only(b) for b in system.blocks}


def _with(fold: Keep) -> Keep:
    return lambda b: not b.held_out or fold(b)


def _without(fold: Keep) -> Keep:
    return lambda b: not b.held_out and not fold(b)


def _of_condition(number: int) -> Keep:
    return lambda b: b.condition == number


def _only(block: Block) -> Keep:
    return lambda b: b is block


def _predicted(system: System, fit: Fit, rest: Solution, block: Block) -> Array:
    """Residual (n,) of a block with what others share of the parameters, and its own camera's unknowns fitted."""
    others = {p for b in system.blocks if b is not block for p, _ in b.names}
    priors = {}
    for i, p in enumerate(rest.names):
        known = float(np.sqrt(rest.covariance[i, i]))
        shared = p in others and p.everywhere
        priors[p] = (float(rest.d[i]), 1e-3 * known) if shared else fit.priors[p]
    return residual(block, system.solve(priors, system.total(_only(block))))


# --- what is left of every recording -----------------------------------------------------------------------
def seen(search: Search, fit: Fit) -> tuple[tuple[Seeing, ...], tuple[Pulling, ...]]:
    """Every recording and trace against a fit, its nuisances included."""
    seeings, pullings = {}, {}
    blocks = {b.label: b for b in fit.blocks}
    for condition, prediction in zip(search.problem.conditions, fit.predictions, strict=True):
        for view in condition.views:
            observable = prediction.observables[view.file]
            predicted = np.array(observable.values, dtype=float)
            predicted[:, observable.inside] += _change(search.data, fit, blocks[view.file])
            left = np.where(observable.inside, view.recording.temperature - predicted, np.nan)
            u, v = (_sd(fit.solution, ParameterId(axis, file=view.file)) for axis in SHIFTS)
            noise, shift = search.data.noises[view.file], fit.model.shift(view.file)
            seeings[view.file] = judge(view, predicted, left, noise, shift, (u, v))
        for force in condition.forces:
            observable = prediction.observables[force.file]
            predicted = observable.values + _change(search.data, fit, blocks[force.file])
            left = np.where(observable.inside, np.array(force.mu) - predicted, np.nan)
            pullings[force.file] = judge_pull(force, predicted, left)
    campaign = search.problem.campaign
    return tuple(seeings[v.file] for v in campaign.views), tuple(pullings[f.file] for f in campaign.forces)


def _change(data: Data, fit: Fit, block: Block) -> Array:
    """What the fit adds to an observable, (frames, pixels inside) or (n,)."""
    return data.kelvin(block.label, change(block, fit.solution))


def _sd(solution: Solution, p: ParameterId) -> float:
    return solution.sd(p) if p in solution.names else 0.0


def fitness(fit: Fit, seeings: Sequence[Seeing], out: LeftOut) -> Fitness:
    """The numbers of a model for people."""
    fitted = [s for s in seeings if not s.view.held_out] or list(seeings)
    squares = sum(s.rmse_K**2 * s.pixels for s in fitted)
    count = sum(s.pixels for s in fitted)
    maps = [adequacy.mean_map(s.residual) for s in fitted]
    near = [adequacy.near_contact(s.view, s.residual) for s in fitted if s.view.recording.view != "wake"]
    return Fitness(
        rmse_K=float(np.sqrt(squares / max(count, 1))) if count else float("nan"),
        chi2_per_dof=fit.solution.chi2 / max(fit.solution.count, 1),
        held_out_rmse_K=out.rmse_K,
        held_out_z=out.z,
        mean_map_rmse_K=float(np.sqrt(np.mean(np.square(maps)))) if maps else float("nan"),
        near_contact_rmse_K=float(np.sqrt(np.nanmean(np.square(near)))) if near else float("nan"),
    )


# --- causes and rivals ----------------------------------------------------------------------------------
def cause(search: Search, effect: str, base: Assessed, extended: Assessed) -> Cause:
    """One accepted effect against the best model without it."""
    fit = extended.fit
    without = search.fits.get(frozenset(fit.model.effects) - {effect}, search.base)
    score = next((s for ranking in search.ranking for s in ranking if s.effect == effect), None)
    own = [p for p in fit.solution.names if p.effect == effect]
    bound = sorted(p for p in fit.bound if p.effect == effect)
    sizes = adequacy.sizes_per_condition(search.problem, fit, effect, every=True)
    return Cause(
        effect=effect,
        words=search.problem.case.known[effect].cause,
        parameters=tuple(_estimate(search, fit, p) for p in (*own, *bound)),
        delta_chi2=_alike(without, fit).chi2 - fit.solution.chi2,
        held_out_gain=float(extended.left_out.density.sum() - base.left_out.density.sum()),
        distinctness=separability(search.base, search.problem.tried).distinctness(effect),
        ln_bayes=fit.ln_evidence - without.ln_evidence,
        z=score.z if score else 0.0,
        raw_share=score.raw_share if score else 0.0,
        per_condition=sizes[0].conditions if sizes else (),
        consistent=sizes[0].consistent if sizes else 1.0,
    )


def _alike(without: Fit, fit: Fit) -> Solution:
    """A model without an effect, its unknowns of no shape as tightly known as in the fit that has it."""
    priors = {p: (mean, fit.priors[p][1] if p in fit.priors else sd) for p, (mean, sd) in without.priors.items()}
    return without.system.solve(priors)


def _estimate(search: Search, fit: Fit, p: ParameterId) -> Estimate:
    param, value = search.problem.case.known[p.effect].params()[p.name], fit.model.value(p)
    if p not in fit.solution.names:
        return Estimate(str(p), value, 0.0, (value, value), param.unit, True)
    value, sd = value + fit.solution[p], INFLATED * fit.solution.sd(p)
    low, high = (float(np.clip(value + s * 1.96 * sd, param.low, param.high)) for s in (-1, 1))
    return Estimate(str(p), float(np.clip(value, param.low, param.high)), sd, (low, high), param.unit)


def rivals(search: Search, accepted: list[str]) -> tuple[Rival, ...]:
    """Every candidate with the reason why it was not chosen."""
    single = separability(search.base, search.problem.tried)
    out = [_rival(search, s, single, accepted) for s in (search.ranking[0] if search.ranking else ())]
    out += [Rival(e, 0.0, 0.0, f"not tried: {why}", seen=0.0) for e, why in search.problem.left.items()]
    return tuple(sorted(out, key=lambda r: -r.score))


def _rival(search: Search, s: Score, single: Separability, accepted: list[str]) -> Rival:
    """A candidate by its full fit where it had one, by its trace otherwise."""
    k, a = s.candidate.first
    param, name = s.candidate.params[k], s.candidate.column(k)
    refit, left = search.fits.get(frozenset({s.effect})), None
    score, amplitude, sd = s.ln_bayes, (param.off or 0.0) + s.amplitude[0], s.sd[0]
    if refit is not None:
        score, e = refit.ln_evidence - search.base.ln_evidence, _estimate(search, refit, name)
        amplitude, sd = e.value, e.stderr
        if accepted and s.effect not in accepted:
            left = search.best.ln_evidence - refit.ln_evidence
    return Rival(
        effect=s.effect, score=score, distinctness=single.distinctness(s.effect),
        reason=_why_not(s, score, left, accepted, refit), parameter=str(name), amplitude=amplitude, stderr=sd,
        unit=param.unit, z=s.z, raw_share=s.raw_share, seen=s.seen,
        detectable=5.0 * abs(a) / s.seen if s.seen > 1e-9 else float("inf"), left=left,
        refitted=refit is not None and refit.usable,
    )  # fmt: skip


def _why_not(s: Score, score: float, left: float | None, accepted: list[str], refit: Fit | None) -> str:
    if s.effect in accepted:
        return "accepted"
    if s.reason:
        return s.reason
    if left is not None and score > WEAK:
        about = "" if refit is not None and refit.usable else "about "
        return f"explains part of it, but leaves ln Bayes factor {about}{left:.0f} to {' and '.join(accepted)}"
    if score > NAMED and accepted:
        return f"its trace resembles that of {accepted[0]}; nothing is left for it beside that"
    if s.seen < 3.0:
        return "calibration absorbs it: even at its typical strength these data would hardly show it"
    return "the data do not ask for it"


def group(search: Search) -> tuple[str, ...]:
    """Effects that explain the data as well as one of the accepted ones."""
    best = search.best
    accepted = frozenset(best.model.effects)
    out: list[str] = []
    for names, fit in search.fits.items():
        swapped = len(names) == len(accepted) and len(names - accepted) == 1
        if swapped and fit.converged and fit.ln_evidence > best.ln_evidence - APART:
            out += [*(accepted - names), *(names - accepted)]
    return tuple(dict.fromkeys(out))


def laboratory_causes(search: Search, fit: Fit) -> tuple[Cause, ...]:
    """Errors of the laboratory beyond what is usual, as causes; one that was freed and came to nothing is none."""
    out = [
        Cause("mirrored", t.words, (), 2.0 * t.ln_bayes, 0.0, 1.0, ln_bayes=t.ln_bayes, laboratory=True)
        for t in search.mirrored
    ]  # fmt: skip
    usual = [e for e in calibrated(search.problem, fit) if e.unusual]
    freed = [(found(search.problem, fit, e), e) for e in search.laboratory]
    for now, e in [*((now, e) for now, e in freed if now.clear), *((e, e) for e in usual)]:
        sd = INFLATED * now.stderr
        ends = (now.value - 1.96 * sd, now.value + 1.96 * sd)
        where = e.parameter.file or e.parameter.name
        estimate = Estimate(f"{now.name}.{where}", now.value, sd, ends, now.unit)
        cause = Cause(now.name, now.words, (estimate,), now.pull**2, 0.0, 1.0, ln_bayes=e.ln_bayes, laboratory=True)
        out.append(cause)
    return tuple(out)


# --- what was calibrated, and gates ------------------------------------------------------------------
def pulls(search: Search, fit: Fit) -> tuple[Pull, ...]:
    """Calibrated nuisances, free keys first, then those farthest from what was known."""
    free, other, away = [], [], adequacy.pulls(fit)
    for p in fit.solution.names:
        step, sd = fit.solution[p], fit.solution.sd(p)
        if p.kind is Kind.KEY:
            value = search.problem.case[p.name] * float(np.exp(fit.model.free[p.name] + step))
            free.append(Pull(str(p), value, value * sd, away[p], _unit(search, p.name)))
        elif p.kind in SHIFTS:
            other.append(Pull(called(p), fit.model.shift(p.file)[p.axis] + step, sd, away[p], "px"))
        elif p.kind in OF_THE_LABORATORY:
            unit = {Kind.TURN: "rad", Kind.CLOCK: "s"}.get(p.kind, "1")
            other.append(Pull(called(p), fit.model.placed(p) + step, sd, away[p], unit))
        elif p.kind in BEADS:
            unit = "m" if p.kind is Kind.PLACE else "s"
            other.append(Pull(called(p), fit.model.beads.get(p, 0.0) + step, sd, away[p], unit))
        elif p.kind not in (Kind.EFFECT, Kind.MODE, Kind.FLOOR, *OF_THE_CAMERA) and not is_camera_gain(p):
            other.append(Pull(called(p), 0.0 + step, sd, away[p], "1"))
    return (*free, *sorted(other, key=lambda p: -abs(p.pull)))


def _third(search: Search, fit: Fit) -> float:
    """ln Bayes factor of the likeliest further cause by its trace, also where the model errs as much as it may."""
    best, problem = search.ranking[-1][0], search.problem
    more = {p: (0.0, abs(a)) for p, a in best.traces.items() if p in fit.system.index}
    beyond = fit.at_largest(problem, fit.effects | more) - fit.at_largest(problem, fit.effects)
    return min(best.ln_bayes, beyond)


def _unit(search: Search, key: str) -> str:
    return declaration(search.problem.case, key).unit


def gates(search: Search, fit: Fit) -> dict[str, tuple[float, float]]:
    """What was checked for adequacy, with its limit: beyond it something is left that has no name."""
    seen, every = fit.system.seen, adequacy.with_all(fit)
    pulled = adequacy.pulls(every) | {p: v for p, v in adequacy.pulls(fit).items() if p in seen}
    away = {p: v for p, v in pulled.items() if p not in search.problem.loose}
    theta = max((abs(v) for p, v in away.items() if p.kind is Kind.KEY), default=0.0)
    camera = max((abs(v) for p, v in away.items() if p.kind is not Kind.KEY), default=0.0)
    sizes = [s for e in fit.model.effects for s in adequacy.sizes_per_condition(search.problem, fit, e, every=True)]
    scatter = max((-np.log10(max(s.consistent, 1e-99)) for s in sizes), default=0.0)
    third = _third(search, fit) if len(fit.model.effects) >= MOST and search.ranking[-1] else 0.0
    return {
        "a third cause (ln Bayes factor)": (third, NAMED),
        "amplitude differs between conditions (-log10 of its probability)": (scatter, adequacy.SCATTERED),
        "heat of any shape (ln Bayes factor)": (adequacy.generic(search.problem, fit), GENERIC),
        "pressure of any shape (chi2 of modes)": (adequacy.mode_pulls(fit), MODAL),
        "calibrated parameters (standard deviations)": (theta, adequacy.PULL),
        "camera and friction scatter (standard deviations)": (camera, 2.0 * adequacy.PULL),
        "noise left over (standard errors of chi2)": (adequacy.left_over(fit, every), EXCESS),
    }
