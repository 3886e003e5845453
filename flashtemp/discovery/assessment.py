"""From a search to a verdict: gates, data left out, rivals, and what is missing without any catalogue."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flashtemp.comparison.compare import judge, judge_pull
from flashtemp.discovery import adequacy
from flashtemp.discovery.calibration import Fit
from flashtemp.discovery.linear_gaussian import Solution, System, residual
from flashtemp.discovery.problem import plain
from flashtemp.discovery.scores import Score, separability
from flashtemp.discovery.search import APART, MOST, NAMED, WEAK, Search
from flashtemp.discovery.verdict import Cause, Estimate, Fitness, Pull, Rival
from flashtemp.physics.effect import catalogue

GENERIC, MODAL, EXCESS = 0.0, 25.0, 12.0  # gates: ln Bayes factor, chi2 of pressure modes, standard errors of chi2
ALLOWED = 3.0  # standard deviations of what was known
INFLATED = 1.2  # errors scatter 1.13 times their standard errors (benchmarks/discover.py, seeds below 1000)


def as_known(search: Search, fit: Fit) -> Fit:
    """A fit that may not bend the pressure, the walls or the friction of a repetition: the model as people know it.

    Nothing may go farther than ALLOWED standard deviations from what was known, however badly the model fits.
    """
    own = {n: v for n, v in fit.priors.items() if n.split(".")[0] in fit.model.effects}
    priors = plain(search.study, fit.priors) | own
    return replace(fit, priors=priors, solution=fit.system.bounded(priors, ALLOWED))


# --- data left out -------------------------------------------------------------------------------------
@dataclass(frozen=True)
class LeftOut:
    """How well data are predicted that were left out: `density` (folds,) ln probability of each, root mean square in K
    and in sigma."""

    labels: tuple[str, ...]
    density: np.ndarray
    rmse_K: float
    z: float


def left_out(search: Search, fit: Fit) -> LeftOut:
    """Predict recordings marked held out; where none is, every condition from the others, or every recording."""
    system = fit.system
    folds = _folds(system)
    densities, squares, kelvins, count = [], 0.0, 0.0, 0
    for inside in folds.values():
        everything = system.total(lambda b, inside=inside: not b.held_out or inside(b))
        without = system.total(lambda b, inside=inside: not b.held_out and not inside(b))
        every, rest = system.solve(fit.priors, everything), system.solve(fit.priors, without)
        densities.append(every.ln_evidence - rest.ln_evidence)
        for block in (b for b in system.blocks if inside(b)):
            left = _predicted(system, fit, rest, block)
            sigma = search.data.noises[block.label]
            squares += float(left @ left)
            if not isinstance(sigma, float):
                kelvins += float(left @ left) * sigma.white**2
                count += len(left)
    total = sum(b.count for inside in folds.values() for b in system.blocks if inside(b))
    rmse, z = np.sqrt(kelvins / max(count, 1)), np.sqrt(squares / max(total, 1))
    return LeftOut(tuple(folds), np.array(densities), float(rmse), float(z))


def _folds(system: System) -> dict:
    if any(b.held_out for b in system.blocks):
        return {"held out": lambda b: b.held_out}
    numbers = sorted({b.condition for b in system.blocks})
    if len(numbers) > 1:
        return {f"condition {n + 1}": (lambda b, n=n: b.condition == n) for n in numbers}
    return {b.label: (lambda other, b=b: other is b) for b in system.blocks}


def _predicted(system: System, fit: Fit, rest: Solution, block) -> np.ndarray:
    """Residual (n,) of a block with what others share of the parameters, and its own camera's unknowns fitted."""
    others = {n for b, (at, *_) in zip(system.blocks, system.parts, strict=True) if b is not block
              for n in (system.names[k] for k in at)}  # fmt: skip
    priors = {}
    for i, n in enumerate(rest.names):
        known = float(np.sqrt(rest.covariance[i, i]))
        priors[n] = (float(rest.d[i]), 1e-3 * known) if n in others and "|" not in n else fit.priors[n]
    own = system.total(lambda b: b is block)
    return residual(block, system.solve(priors, own))


# --- pictures of what is left ------------------------------------------------------------------------
def seen(search: Search, fit: Fit):
    """Every recording and trace against a fit, its nuisances included."""
    found = fit.solution.as_dict()
    seeings, pullings = {}, {}
    blocks = {b.label: b for b in fit.blocks}
    for (_, views, forces), look in zip(search.study.conditions, fit.looks, strict=True):
        for entry in (*views, *forces):
            sight, block = look.sights[entry.file], blocks[entry.file]
            names: dict[int, float] = {}
            for name, column in block.names:
                names[column] = names.get(column, 0.0) + found.get(name, 0.0)
            fixed = search.data.fixed[entry.file]
            own = [k for k in sight.columns if k not in fixed]
            columns = [sight.columns[k] for k in own] + list(fixed.values())
            change = sum(names[i] * columns[i].astype(float) for i in names if names[i])
            predicted = np.array(sight.predicted, dtype=float)
            if predicted.ndim == 3:
                predicted[:, sight.inside] += change
                left = np.where(sight.inside, entry.recording.temperature - predicted, np.nan)
                shift = fit.shifts.get(entry.file, (0.0, 0.0))
                error = tuple(_sd(fit.solution, f"shift_{a}|{entry.file}") for a in "uv")
                seeings[entry.file] = judge(entry, predicted, left, search.data.noises[entry.file], shift, error)
            else:
                predicted = predicted + change
                left = np.where(sight.inside, np.array(entry.mu) - predicted, np.nan)
                pullings[entry.file] = judge_pull(entry, predicted, left)
    campaign = search.study.campaign
    return tuple(seeings[v.file] for v in campaign.views), tuple(pullings[f.file] for f in campaign.forces)


def _sd(solution: Solution, name: str) -> float:
    return solution.sd(name) if name in solution.names else 0.0


def fitness(fit: Fit, seeings, out: LeftOut) -> Fitness:
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
def cause(search: Search, effect: str, fit: Fit, base: LeftOut, extended: LeftOut) -> Cause:
    """One accepted effect against the best model without it."""
    without = search.fits.get(frozenset(fit.model.effects) - {effect}, search.base)
    score = _scored(search, effect)
    own = [n for n in fit.solution.names if n.split(".")[0] == effect]
    bound = sorted(n for n in fit.bound if n.startswith(f"{effect}."))
    estimates = tuple(_estimate(fit, n) for n in (*own, *bound))
    single = separability(search.base, list(search.study.tried))
    conditions = adequacy.per_condition(search.study, fit, own[0]) if own else ()
    return Cause(
        effect=effect,
        words=catalogue()[effect].cause,
        parameters=estimates,
        delta_chi2=without.solution.chi2 - fit.solution.chi2,
        held_out_gain=float(extended.density.sum() - base.density.sum()),
        distinctness=single.distinctness(effect),
        ln_bayes=fit.ln_evidence - without.ln_evidence,
        z=score.z if score else 0.0,
        raw_share=score.raw_share if score else 0.0,
        per_condition=conditions,
        consistent=adequacy.consistent(conditions),
    )


def _scored(search: Search, effect: str) -> Score | None:
    for ranking in search.ranking:
        for s in ranking:
            if s.effect == effect:
                return s
    return None


def _estimate(fit: Fit, name: str) -> Estimate:
    effect, k = name.split(".")
    param = catalogue()[effect].params()[k]
    value = fit.model.effects[effect][k]
    if name not in fit.solution.names:
        return Estimate(name, value, 0.0, (value, value), param.unit, True)
    value, sd = value + fit.solution[name], INFLATED * fit.solution.sd(name)
    low, high = (float(np.clip(value + s * 1.96 * sd, param.low, param.high)) for s in (-1, 1))
    return Estimate(name, float(np.clip(value, param.low, param.high)), sd, (low, high), param.unit)


def rivals(search: Search, accepted: list[str]) -> tuple[Rival, ...]:
    """Every candidate with the reason why it was not chosen."""
    single, out = separability(search.base, list(search.study.tried)), []
    for s in search.ranking[0] if search.ranking else ():
        k, a = next(iter(s.candidate.strengths.items()))
        param = s.candidate.kind.params()[k]
        refit = search.fits.get(frozenset({s.effect}))
        score = refit.ln_evidence - search.base.ln_evidence if refit is not None else s.ln_bayes
        amplitude, sd = param.off + s.amplitude[0], s.sd[0]
        if refit is not None:
            e = _estimate(refit, f"{s.effect}.{k}")
            amplitude, sd = e.value, e.stderr
        left = None
        if refit is not None and accepted and search.best is not None and s.effect not in accepted:
            left = search.best.ln_evidence - refit.ln_evidence
        out.append(Rival(
            effect=s.effect, score=score, distinctness=single.distinctness(s.effect),
            reason=_why_not(s, score, left, accepted), parameter=f"{s.effect}.{k}", amplitude=amplitude, stderr=sd,
            unit=param.unit, z=s.z, raw_share=s.raw_share,
            detectable=5.0 * abs(a) / s.seen if s.seen > 1e-9 else float("inf"), left=left, refitted=refit is not None,
        ))  # fmt: skip
    out += [Rival(e, 0.0, 0.0, f"not tried: {why}") for e, why in search.study.left.items()]
    return tuple(sorted(out, key=lambda r: -r.score))


def _why_not(s: Score, score: float, left: float | None, accepted: list[str]) -> str:
    if s.effect in accepted:
        return "accepted"
    if s.reason:
        return s.reason
    if left is not None and score > WEAK:
        return f"explains part of it, but leaves ln Bayes factor {left:.0f} to {' and '.join(accepted)}"
    if score > NAMED and accepted:
        return f"its trace resembles that of {accepted[0]}; nothing is left for it beside that"
    if s.seen < 3.0:
        return "calibration absorbs it: even at its typical strength these data would hardly show it"
    return "the data do not ask for it"


def group(search: Search) -> tuple[str, ...]:
    """Effects that explain the data as well as one of the accepted ones."""
    best, out = search.best, []
    accepted = frozenset(best.model.effects)
    for names, fit in search.fits.items():
        swapped = len(names) == len(accepted) and len(names - accepted) == 1
        if swapped and fit.converged and fit.ln_evidence > best.ln_evidence - APART:
            out += [*(accepted - names), *(names - accepted)]
    return tuple(dict.fromkeys(out))


# --- what was calibrated, and gates ------------------------------------------------------------------
def pulls(search: Search, fit: Fit) -> tuple[Pull, ...]:
    """Calibrated nuisances, those farthest from what was known first."""
    out, away = [], adequacy.pulls(fit)
    for n in fit.solution.names:
        if n in search.study.priors:
            value = search.study.case[n] * float(np.exp(fit.model.free[n] + fit.solution[n]))
            out.append(Pull(n, value, value * fit.solution.sd(n), away[n], _unit(n)))
        elif n.split(".")[0] not in fit.model.effects and not n.startswith("mode:"):
            moved = n.startswith("shift_")
            now = fit.shifts.get(n.partition("|")[2], (0.0, 0.0))[n[6] == "v"] if moved else 0.0
            unit = "px" if moved else "1"
            out.append(Pull(_called(n), now + fit.solution[n], fit.solution.sd(n), away[n], unit))
    first = [p for p in out if p.name in search.study.priors]
    return (*first, *sorted((p for p in out if p.name not in search.study.priors), key=lambda p: -abs(p.pull)))


def _unit(key: str) -> str:
    from flashtemp.model.schema import declared

    return declared(key.rsplit(".", 1)[0])[key.rsplit(".", 1)[1]].unit


CALLED = {
    "shift_u": "shift along u of", "shift_v": "shift along v of", "gain": "camera gain of", "spread": "optics of",
    "map": "gain map of", "wall": "cooler wall of", "scatter": "friction of a repetition in",
    "level": "friction of", "trend": "drifting pressure in", "mesh": "coarser mesh in", "cell": "load cell's gain",
}  # fmt: skip


def _called(name: str) -> str:
    """A nuisance in words."""
    kind, _, where = name.partition("|")
    kind, *which = kind.split(":")
    if where.isdigit():
        where = f"condition {int(where) + 1}"
    number = f" ({', '.join(which)})" if which else ""
    where = where.rpartition("/")[2]
    return f"{CALLED.get(kind, kind)} {where}{number}".strip()


def gates(search: Search, fit: Fit) -> dict[str, tuple[float, float]]:
    """What was checked for adequacy, with its limit: beyond it something is left that has no name."""
    away = adequacy.pulls(fit)
    theta = max((abs(v) for n, v in away.items() if n in search.study.priors), default=0.0)
    camera = max((abs(v) for n, v in away.items() if n not in search.study.priors), default=0.0)
    conditions = [
        adequacy.per_condition(search.study, fit, n) for n in fit.solution.names if n.split(".")[0] in fit.model.effects
    ]
    scatter = max((-np.log10(max(adequacy.consistent(c), 1e-99)) for c in conditions), default=0.0)
    third = search.ranking[-1][0].ln_bayes if len(fit.model.effects) >= MOST and search.ranking[-1] else 0.0
    return {
        "a third cause (ln Bayes factor)": (third, NAMED),
        "amplitude differs between conditions (-log10 of its probability)": (scatter, adequacy.SCATTERED),
        "heat of any shape (ln Bayes factor)": (adequacy.generic(search.study, fit), GENERIC),
        "pressure of any shape (chi2 of modes)": (adequacy.mode_pulls(fit), MODAL),
        "calibrated parameters (standard deviations)": (theta, adequacy.PULL),
        "camera and friction scatter (standard deviations)": (camera, 2.0 * adequacy.PULL),
        "noise left over (standard errors of chi2)": (max(adequacy.excess(fit).values(), default=0.0), EXCESS),
    }
