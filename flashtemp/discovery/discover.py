"""The whole way from a campaign to a Verdict, and what it says in words."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from flashtemp.comparison.campaign import Campaign
from flashtemp.discovery import adequacy, assessment, experiment_design, missing_heat
from flashtemp.discovery.calibration import ENOUGH, Fit
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.linear_gaussian import residual
from flashtemp.discovery.prediction import look
from flashtemp.discovery.problem import GROUPS, Data, prepare
from flashtemp.discovery.scores import separability
from flashtemp.discovery.search import NAMED, WEAK, Search
from flashtemp.discovery.verdict import Verdict
from flashtemp.errors import SolverFailure
from flashtemp.model.case import load_with
from flashtemp.physics.effect import catalogue
from flashtemp.runs.workers import crew

SHOWN = 20  # candidates in the separability matrix
SHARES = {"traces": 0.3, "fitting": 0.5, "judging": 0.95}  # of the work that is done when a stage begins, as a rule


def discover(
    campaign: Campaign,
    watch: Callable[[str], Any] = lambda text: None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> tuple[Verdict, Search]:
    """Everything: calibrate, search, judge.  Raises BadInput, SolverFailure."""
    began, watch = time.monotonic(), _timed(watch)
    with crew(look, workers, scheduler) as run:
        study = prepare(campaign, run)
        search = Search(study, Data(study), watch)
        search.calibrate()
        if search.base is None:
            raise SolverFailure(search.failed)
        search.extend()
        search.settle()
        if not search.best.converged:
            return _no_verdict(search, time.monotonic() - began), search
        watch("judging")
        verdict = _verdict(search, time.monotonic() - began)
    return verdict, search


def _timed(watch: Callable[[str], Any]) -> Callable[[str], Any]:
    """The same with the time gone, and from the second stage on an estimate of the time left."""
    began, done = time.monotonic(), 0.0

    def say(text: str) -> None:
        nonlocal done
        share = SHARES.get(text.split()[0], 0.0)
        if share:  # a stage that comes again takes half of what was left
            done = share if share > done else 0.5 * (1.0 + done)
        gone = time.monotonic() - began
        left = f", about {gone * (1.0 / done - 1.0):.0f} s left" if done else ""
        watch(f"{text} ({gone:.0f} s{left})")

    return say


def _no_verdict(search: Search, seconds: float) -> Verdict:
    fit = search.best or search.base
    last = fit.history[-1]
    return Verdict(
        title=search.study.campaign.title, kind="no_verdict",
        says=(f"The calibration did not converge: after {len(fit.history)} steps the next one would still move "
              f"a parameter by {last:.2g} of its prior standard deviation ({ENOUGH} is the limit).",
              "Check the values of the case and the conditions of the recordings before anything is concluded."),
        certificate=_certificate(search), warnings=(search.failed,) if search.failed else (), seconds=seconds,
    )  # fmt: skip


def _certificate(search: Search) -> dict[str, Any]:
    fits = {" + ".join(sorted(k)) or "base": f for k, f in search.fits.items()} or {"base": search.base}
    return {
        "converged": (search.best or search.base).converged,
        "limit": ENOUGH,
        "steps_over_prior": {k: list(f.history) for k, f in fits.items()},
    }


def _verdict(search: Search, seconds: float) -> Verdict:
    study, base, best = search.study, search.base, search.best
    accepted = list(best.model.effects)
    hint = None
    if not accepted:
        hint = _hint(search)
    final = hint or best
    effects = list(final.model.effects)
    out_base = assessment.left_out(search, base)
    out_final = assessment.left_out(search, final) if effects else out_base
    plain_base = assessment.as_known(search, base)
    plain_final = assessment.as_known(search, final) if effects else plain_base
    before, pulled_before = assessment.seen(search, plain_base)
    after, pulled_after = assessment.seen(search, plain_final) if effects else (before, pulled_before)
    plain_out = assessment.left_out(search, plain_base)
    causes = tuple(assessment.cause(search, e, final, out_base, out_final) for e in effects)
    shut = assessment.gates(search, final)
    alike = assessment.group(search) if accepted else ()
    kind = _kind(search, accepted, hint, shut, alike, out_base, out_final)
    sep = separability(base, list(study.tried))
    order = np.argsort(-sep.z)[:SHOWN]
    advice = experiment_design.advise(study, best, alike) if kind == "group" else ""
    if kind in ("none_needed", "unexplained") and not accepted:
        causes, after, pulled_after = (), before, pulled_before
    verdict = Verdict(
        title=study.campaign.title,
        kind=kind,
        says=(),
        causes=causes,
        group=alike if kind == "group" else (),
        next_experiment=advice,
        base=assessment.fitness(plain_base, before, plain_out),
        extended=assessment.fitness(plain_final, after, assessment.left_out(search, plain_final)) if causes else None,
        rivals=assessment.rivals(search, accepted),
        nuisance=assessment.pulls(search, final),
        tests=(*adequacy.structure(base, 1, "before"), *(adequacy.structure(final, 2, "after") if causes else ())),
        missing=missing_heat.missing(study, base),
        separability=(tuple(sep.names[i] for i in order), sep.rho[np.ix_(order, order)]),
        shifts=_moved(search, plain_base, final) if causes else (),
        before=before,
        after=after,
        pulled=(pulled_before, pulled_after),
        gates=shut,
        certificate=_certificate(search),
        assumed=study.priors | {f"{assessment.CALLED.get(k, k)} anything": v for k, v in GROUPS.items()},
        warnings=_warnings(search, final),
        seconds=seconds,
    )
    return replace(verdict, says=says(verdict))


def _hint(search: Search) -> Fit | None:
    """The best single effect where it is more than chance but less than proof."""
    single = [f for k, f in search.fits.items() if len(k) == 1 and f.converged]
    if not single:
        return None
    best = max(single, key=lambda f: f.ln_evidence)
    return best if best.ln_evidence - search.base.ln_evidence > WEAK else None


def _kind(search: Search, accepted, hint, shut, alike, out_base, out_final) -> str:
    open_gate = any(value > limit for value, limit in shut.values())
    if open_gate:
        return "unexplained"
    if accepted:
        gained = out_final.density.sum() - out_base.density.sum()
        if len(alike) > 1:
            return "group"
        return "named" if gained > 0 or len(out_base.density) == 1 else "weak"
    return "weak" if hint is not None else "none_needed"


def _moved(search: Search, base: Fit, final: Fit) -> tuple[tuple[str, float, float, float], ...]:
    out = []
    for key in search.study.campaign.free:
        before, after = (search.study.case[key] * math.exp(f.model.free[key] + f.solution[key]) for f in (base, final))
        out.append((key, before, after, after * final.solution.sd(key)))
    return tuple(out)


def _warnings(search: Search, final: Fit) -> tuple[str, ...]:
    out = [f"{file}: left out, it {why}" for file, why in search.refused.items()]
    for file, level in search.data.noises.items():
        if not isinstance(level, float) and "white" in level.estimated:
            out.append(
                f"{file}: the noise of a pixel was not stated; {level.white:.3g} K was estimated from its frames"
            )
    for view in search.study.campaign.views:
        dead = np.isnan(view.recording.temperature).all(axis=0).mean()
        gaps = np.isnan(view.recording.temperature).all(axis=(1, 2)).sum()
        if dead > 0.05:
            out.append(f"{view.file}: {100 * dead:.0f} % of its pixels are dead")
        if gaps:
            out.append(f"{view.file}: {gaps} frames hold no values")
        out += _strange(final, view)
    if len(search.study.conditions) == 1:
        out.append("all data are of one condition: effects that differ in speed or load only cannot be told apart")
    return tuple(out)


def _strange(fit: Fit, view) -> list[str]:
    """A recording that does not belong: of another condition, or upside down."""
    block = next(b for b in fit.blocks if b.label == view.file)
    level = float(np.mean(residual(block, fit.solution) ** 2))
    if level < 4.0:
        return []
    return [
        f"{view.file}: differs by {math.sqrt(level):.0f} sigma rms from every model: check its condition and its way up"
    ]


# --- words -------------------------------------------------------------------------------------------------
def says(v: Verdict) -> tuple[str, ...]:
    """The verdict in a tribologist's words."""
    lines = []
    if v.kind == "named":
        for c in v.causes:
            lines.append(f"{_sentence(c)} ln Bayes factor {c.ln_bayes:.0f} against the model without it.")
    elif v.kind == "weak":
        c = v.causes[0]
        lines.append(f"A hint, no proof: {_sentence(c)} ln Bayes factor {c.ln_bayes:.1f}; {NAMED:g} names a cause.")
    elif v.kind == "group":
        words = " or ".join(f"{catalogue()[e].cause} ({e})" for e in v.group)
        lines.append(f"Something is missing, and these data cannot tell which of these it is: {words}.")
    elif v.kind == "unexplained":
        odd = [k for k, (value, limit) in v.gates.items() if value > limit]
        lines.append(f"Something is missing that is not in the catalogue: {'; '.join(odd)} beyond what fits.")
        if v.causes:
            lines.append(f"The nearest member is {v.causes[0].effect}, but it does not explain the data.")
    else:
        best = max((r for r in v.rivals if math.isfinite(r.score)), key=lambda r: r.score, default=None)
        lines.append("No extension is needed: the calibrated model explains the data within their noise.")
        if best is not None:
            lines.append(
                f"The strongest of {len(v.rivals)} candidates, {best.effect}, has ln Bayes factor {best.score:.1f}; "
                f"{NAMED:g} would name a cause."
            )
    if v.extended is not None and v.base is not None:
        lines.append(
            f"With it, chi2/dof goes from {v.base.chi2_per_dof:.4g} to {v.extended.chi2_per_dof:.4g}; data left out "
            f"are predicted to {v.extended.held_out_z:.3g} sigma instead of {v.base.held_out_z:.3g}."
        )
    rival = next((r for r in v.rivals if r.left is not None and r.score > WEAK), None)
    if v.kind == "named" and rival is not None:
        lines.append(f"The best rival, {rival.effect}, leaves ln Bayes factor {rival.left:.0f}.")
    for name, before, after, error in v.shifts:
        if error and abs(after - before) > 2.0 * error:
            lines.append(
                f"Without it, {name} would have come out as {before:.4g} instead of {after:.4g} +- {error:.2g}."
            )
    return tuple(lines)


def _sentence(c) -> str:
    numbers = ", ".join(
        f"{p.name} = {p.value:.4g} ({p.ci95[0]:.4g} to {p.ci95[1]:.4g}){'' if p.unit == '1' else ' ' + p.unit}"
        for p in c.parameters
    )
    return f"Cause: {c.words}; {numbers}."


def write_extended(search: Search, verdict: Verdict, folder) -> None:
    """extended.toml (and the files it names): the case with calibrated parameters and accepted effects."""
    if not verdict.causes:
        return
    study, best = search.study, search.best if search.best.model.effects else _hint(search)
    free = {k: best.model.free[k] + best.solution[k] for k in best.model.free}
    effects = {c.effect: {p.name.split(".")[1]: p.value for p in c.parameters} for c in verdict.causes}
    effects = {e: best.model.effects[e] | v for e, v in effects.items()}
    case = load_with(study.case, Model(free, effects).overrides(study.case))
    (folder / "extended.toml").write_text(case.toml(case.copy_files(folder)), encoding="utf-8")
