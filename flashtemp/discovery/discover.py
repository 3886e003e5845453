"""From a campaign to a verdict: calibrate, explore, judge.  Discovery starts here, in `discover`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.comparison.campaign import Campaign, View
from flashtemp.comparison.noise import RAISED
from flashtemp.discovery import adequacy, assessment, experiment_design, mesh_errors, missing_heat, wording
from flashtemp.discovery.assessment import HELD, Assessed
from flashtemp.discovery.camera_sizes import camera_sizes
from flashtemp.discovery.checklist import checklist
from flashtemp.discovery.fit import ENOUGH, Fit
from flashtemp.discovery.hypotheses.piecewise_linear_law import EFFECT_NAME
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.laboratory import calibrated
from flashtemp.discovery.learning import learn
from flashtemp.discovery.linear_gaussian import residual
from flashtemp.discovery.nuisances import GROUPS
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction import predict
from flashtemp.discovery.problem import prepare
from flashtemp.discovery.rounds import Watch
from flashtemp.discovery.scores import separability
from flashtemp.discovery.search import explore, settled
from flashtemp.discovery.searched import APART, MORE, NAMED, WEAK, Search, all_traces, calibrate
from flashtemp.discovery.verdict import Cause, Found, Held, Verdict
from flashtemp.discovery.visible import Gain, gain
from flashtemp.errors import SolverFailure
from flashtemp.runs.workers import crew

SHOWN = 20  # candidates in the separability matrix
# of the work that is done when a stage begins, as a rule
SHARES = {"going": 0.15, "traces": 0.3, "fitting": 0.5, "judging": 0.95}
LAW = 0.4  # where a law is looked for, which no other stage foresees


def discover(
    campaign: Campaign,
    watch: Watch = lambda text: None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> tuple[Verdict, Search]:
    """Everything: calibrate, search, judge.  Raises BadInput, SolverFailure."""
    began, watch = time.monotonic(), _timed(watch)
    with crew(predict, workers, scheduler) as run:
        believed = calibrate(prepare(campaign, run), watch)
        for told in mesh_errors.across(believed.data, believed.base):
            watch(told)
        found = explore(believed, watch)
        search = found if adequacy.beyond_doubt(found.best) else _certain(found, watch)
        watch("judging")
        verdict = _verdict(search)
        if verdict.kind == "unexplained" or _doubted(verdict) is not None:
            verdict, search = _learned(verdict, search, watch)
        if verdict.kind == "unexplained" and search is found:  # no law was learned
            certain = _certain(settled(found, watch), watch)
            verdict, search = (verdict, found) if certain is found else (_verdict(certain), certain)
    return replace(verdict, seconds=time.monotonic() - began), search


def _certain(search: Search, watch: Watch) -> Search:
    """The search judged by its base, where what extends it came to no end and the base leaves something over for sure:
    that data are unexplained is known then, whatever the effect would have come to."""
    base, best = search.base, search.best
    if best.converged or not best.model.effects:
        return search
    if not any(value > limit for value, limit in assessment.gates(search, base).values()):
        return search
    fits = {names: f for names, f in search.fits.items() if names != frozenset(best.model.effects)}
    lesser = settled(replace(search, best=base, fits=fits), watch)
    return lesser if lesser.best.converged else search


def _timed(watch: Watch) -> Callable[[str], Any]:
    """The same with the time gone and, as soon as everything was simulated once, an estimate of the time left."""
    began, done, ends = time.monotonic(), 0.0, 0.0

    def say(text: str) -> None:
        nonlocal done, ends
        gone, share = time.monotonic() - began, SHARES.get(text.split()[0], 0.0)
        if text.startswith("looking"):
            done, ends = LAW, gone / LAW
        elif share:  # a stage that comes again takes half of what was left
            done = share if share > done else 0.5 * (1.0 + done)
            ends = gone / done
        after = min((s for s in SHARES.values() if s > done), default=0.5 * (1.0 + done))
        left = max(ends - gone, gone * (1.0 / after - 1.0))  # a stage that takes longer has the next ones after it
        watch(f"{text} ({gone:.0f} s{f', about {left:.0f} s left' if done else ''})")

    return say


def _certificate(search: Search) -> dict[str, Any]:
    return {
        "converged": search.best.converged,
        "limit": ENOUGH,
        "steps_over_prior": {" + ".join(sorted(k)) or "base": list(f.history) for k, f in search.fits.items()},
    }


def _verdict(search: Search) -> Verdict:
    """What a search amounts to; without its certificate no cause is given, but all that it knows."""
    problem, accepted = search.problem, list(search.best.model.effects)
    found = assessment.laboratory_causes(search, search.best)
    hint = None if accepted or found else _hint(search)  # beside an error of the laboratory a hint is less than that
    final = hint or search.best
    base = assessment.assess(search, search.base)
    extended = assessment.assess(search, final) if final.model.effects else base
    causes = tuple(assessment.cause(search, e, base, extended) for e in final.model.effects)
    shut = assessment.gates(search, final)
    alike = assessment.group(search) if accepted else ()
    kind = _kind(hint is not None, shut, alike, base, extended, bool(accepted))
    gained = gain(search.data, base, extended) if final.model.effects else None
    kind = gained.allowed(kind) if gained is not None else kind
    kind = _honest(kind, search, bool(found))
    if kind == "unexplained":  # what leaves the data unexplained is named no more than an effect is
        found = tuple(c for c in found if not c.parameters)
    if kind == "no_verdict" or (kind != "weak" and not accepted):
        causes, extended = (), base
    named = () if kind == "no_verdict" else [c.words for c in found]
    separable = separability(search.base, problem.tried)
    order = np.argsort(-separable.z)[:SHOWN]
    verdict = Verdict(
        title=problem.campaign.title,
        kind=kind,
        says=(),
        causes=() if kind == "no_verdict" else (*found, *causes),
        group=alike if kind == "group" else (),
        next_experiment=experiment_design.advise(problem, all_traces(search), alike) if kind == "group" else "",
        base=base.fitness,
        extended=extended.fitness if causes else None,
        rivals=assessment.rivals(search, accepted),
        nuisance=assessment.pulls(search, final),
        tests=_tests(base.known, extended.known if causes else None),
        missing=missing_heat.missing(problem, search.base),
        separability=(tuple(separable.names[i] for i in order), separable.rho[np.ix_(order, order)]),
        shifts=_moved(search, base.known, final) if causes else (),
        before=base.seeings,
        after=extended.seeings,
        pulled=(base.pullings, extended.pullings),
        gates=shut,
        certificate=_certificate(search),
        assumed=_assumed(search),
        warnings=_warnings(search, final),
        gain=None if gained is None else asdict(gained),
        not_named=() if gained is None or kind not in ("weak", "none_needed") else gained.says,
        certain=tuple(c.effect for c in causes if c.effect not in alike) if kind == "group" else (),
        laboratory=tuple(
            Found(e.name, e.value, e.stderr, e.unit, e.pull, e.words)
            for e in calibrated(problem, final)
            if e.words not in named
        ),
        held_key=_held(search),
        checklist=checklist(search) if kind in ("unexplained", "no_verdict") else (),
        open_ends={" with ".join(sorted(names)): gain for names, gain in search.open_ends.items()},
    )
    says = wording.says(verdict, problem.case.known)
    open_end = kind == "no_verdict" or (kind == "unexplained" and (not search.best.converged or search.unsettled))
    return replace(verdict, says=(*_why_none(search), *says) if open_end else says)


def _learned(verdict: Verdict, search: Search, watch: Watch) -> tuple[Verdict, Search]:
    """A law that explains what the catalogue does not, or does better than a cause whose own law is in doubt, judged
    like any cause; else the verdict as it was."""
    rival = _doubted(verdict)
    try:
        found = learn(search, watch, 0.0 if rival is None else search.best.ln_evidence - search.base.ln_evidence)
    except SolverFailure:  # a law that cannot be followed is none; what is known already is not lost
        return verdict, search
    if found is None:
        return verdict, search
    more = found.search.best.ln_evidence - search.best.ln_evidence
    if rival is not None and more < NAMED:  # its fit in full came to less than its first one
        return verdict, search
    again = _verdict(found.search)
    if again.kind != "named" and not (again.kind == "weak" and _foretells(again)):
        return verdict, search
    again = replace(again, kind="learned", law=found.told, not_named=())
    says = wording.says(again, found.search.problem.case.known)
    if rival is not None:
        says = (*says, wording.instead(rival, more))
    return replace(again, says=says), found.search


def _doubted(verdict: Verdict) -> Cause | None:
    """The one effect that was named, if its own law is in doubt."""
    effects = [c for c in verdict.causes if not c.laboratory]
    return effects[0] if verdict.kind == "named" and len(effects) == 1 and effects[0].doubted else None


def _foretells(verdict: Verdict) -> bool:
    """Whether a law is seen and makes data left out likelier, load cells among them, though images are no nearer: left
    out with a condition is that part of the law which only it reaches."""
    seen = Gain(**verdict.gain) if verdict.gain is not None else None
    sure = seen is not None and seen.visible and seen.above
    return sure and all(c.held_out_gain > NAMED for c in verdict.causes)


def _honest(kind: str, search: Search, found: bool) -> str:
    """A kind of verdict that says no more than was done: without certificate none, with open ends not that none is
    needed; errors of the laboratory and held keys count as named."""
    if not search.best.converged or (search.unsettled and kind != "unexplained"):
        return "unexplained" if adequacy.beyond_doubt(search.best) else "no_verdict"
    if kind != "none_needed":
        return kind
    if search.open_ends:
        return "unexplained"
    if search.held_key is not None:
        return "held_key"
    return "named" if found else kind


def _why_none(search: Search) -> tuple[str, ...]:
    """Why there is no verdict."""
    if search.best.converged:
        return tuple(wording.not_settled(names, gain) for names, gain in search.unsettled.items())
    return wording.not_converged(search.best)


def _held(search: Search) -> Held | None:
    """The key that was freed, or one that would explain as much as what was accepted."""
    key, gained = search.held_key, search.best.ln_evidence - search.base.ln_evidence
    if key is None:
        likely = [k for k in search.keys if k.fit is not None and k.ln_bayes > max(NAMED, gained - APART)]
        if not likely:
            return None
        key = likely[0]
    freed = search.held_key is not None
    return Held(key.key, key.told, key.value, key.stderr, key.unit, key.ln_bayes, freed, key.words)


def _hint(search: Search) -> Fit | None:
    """The best single effect where it is more than chance but less than proof."""
    single = [f for k, f in search.fits.items() if len(k) == 1 and f.converged]
    if not single:
        return None
    best = max(single, key=lambda f: f.ln_evidence)
    return best if best.ln_evidence - search.base.ln_evidence > WEAK else None


def _kind(
    hinted: bool, shut: dict[str, tuple[float, float]], alike: tuple[str, ...], base: Assessed, extended: Assessed,
    accepted: bool,
) -> str:  # fmt: skip
    if any(value > limit for value, limit in shut.values()):
        return "unexplained"
    if not accepted:
        return "weak" if hinted else "none_needed"
    if len(alike) > 1:
        return "group"
    gained = extended.left_out.density.sum() - base.left_out.density.sum()
    if extended.left_out.labels == (HELD,):  # they need not show it, but may not speak against it
        return "named" if gained > -MORE else "weak"
    return "named" if gained > 0 or len(base.left_out.density) == 1 else "weak"


def _tests(base: Fit, extended: Fit | None) -> tuple[Any, ...]:
    """Structure in what is left before and after, by the models that the recordings are shown against."""
    after = adequacy.structure(extended, 2, "after") if extended is not None else []
    return (*adequacy.structure(base, 1, "before"), *after)


def _assumed(search: Search) -> dict[str, float]:
    """Priors, in words: standard deviations of free keys and of each kind of nuisance."""
    known = {str(p): sd for p, sd in search.problem.priors.items()}
    return known | {f"{wording.CALLED[kind]} anything": sd for kind, sd in GROUPS.items()}


def _moved(search: Search, base: Fit, final: Fit) -> tuple[tuple[str, float, float, float], ...]:
    out = []
    for p in search.problem.free:
        now = search.problem.case[p.name]
        before, after = (now * math.exp(f.model.free[p.name] + f.solution[p]) for f in (base, final))
        out.append((p.name, before, after, after * final.solution.sd(p)))
    return tuple(out)


def _warnings(search: Search, final: Fit) -> tuple[str, ...]:
    out = [f"{file}: left out, it {why}" for file, why in search.refused.items()]
    out += [f"{file}: {found}" for file, found in search.problem.screening.items()]
    out += [wording.taken(file, names) for file, names in search.problem.untold.items()]
    for file, noise in search.data.noises.items():
        if "white" in noise.estimated:
            out.append(
                f"{file}: the noise of a pixel was not stated; {noise.white:.3g} K was estimated from its frames"
            )
        if RAISED in noise.estimated:
            out.append(f"{file}: its frames show {noise.white:.3g} K of noise of a pixel, more than was stated")
    for view in search.problem.campaign.views:
        dead = np.isnan(view.recording.temperature).all(axis=0).mean()
        gaps = np.isnan(view.recording.temperature).all(axis=(1, 2)).sum()
        if dead > 0.05:
            out.append(f"{view.file}: {100 * dead:.0f} % of its pixels are dead")
        if gaps:
            out.append(f"{view.file}: {gaps} frames hold no values")
        out += _strange(final, view)
    out += camera_sizes(search.data, final)
    if len(search.problem.conditions) == 1:
        out.append("all data are of one condition: effects that differ in speed or load only cannot be told apart")
    return (*out, *mesh_errors.across(search.data, search.base), *mesh_errors.ends(search))


def _strange(fit: Fit, view: View) -> list[str]:
    """A recording that does not belong: of another condition, or upside down."""
    block = next(b for b in fit.blocks if b.label == view.file)
    level = float(np.mean(residual(block, fit.solution) ** 2))
    if level < 4.0:
        return []
    return [
        f"{view.file}: differs by {math.sqrt(level):.0f} sigma rms from every model: check its condition and its way up"
    ]


def write_extended(search: Search, verdict: Verdict, folder: Path) -> None:
    """extended.toml (and the files it names): the case with calibrated parameters and accepted effects."""
    best = search.best if search.best.model.effects else _hint(search)
    best = search.best if best is None else best
    if not verdict.extends:
        return
    free = {p.name: best.model.free[p.name] + best.solution[p] for p in search.problem.free}
    found = {e.name: e.value for c in verdict.causes for e in c.parameters}
    effects = {
        c.effect: {k: found.get(str(ParameterId.of_effect(c.effect, k)), v) for k, v in own.items()}
        for c in verdict.causes
        if not c.laboratory and (own := best.model.effects[c.effect])
    }
    case = Model(free, effects).on(search.problem.case)
    files = case.copy_files(folder)
    if EFFECT_NAME in files:  # what was learned lies beside the case, to be read
        (folder / files[EFFECT_NAME]).rename(folder / f"{EFFECT_NAME}.py")
        files[EFFECT_NAME] = f"./{EFFECT_NAME}.py"
        if not any((folder / "inputs").iterdir()):
            (folder / "inputs").rmdir()
    (folder / "extended.toml").write_text(case.toml(files), encoding="utf-8")
