"""A verdict in sentences: the verdict itself first, then why, then what else the data say."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.decision import NOISE_TEST
from flashtemp.discovery.diagnostics.cross_validation import MAX_RIGID_PULL, is_at_limit
from flashtemp.discovery.diagnostics.quantity_format import (
    correction_words,
    format_digits,
    format_error,
    format_kelvin,
    is_within_noise,
    unit_suffix,
    wrong_input_words,
)
from flashtemp.discovery.diagnostics.rule_sentences import LAW_RULES, describe_failure
from flashtemp.discovery.parameters import ALL_CONDITIONS, POINT_KINDS, ParameterId, ParameterKind
from flashtemp.discovery.prediction.problem import ASSUMED_CAMERA_VALUES
from flashtemp.discovery.verdict import (
    Cause,
    InputResult,
    LearnedLaw,
    NormalisedDeviation,
    ParameterEstimate,
    Verdict,
)
from flashtemp.physics.effect import Effect

MAX_LISTED_ITEMS = 3  # of each kind in the text; the report lists all
CLEARLY_VISIBLE_SIGMA = 5.0  # signal-to-noise ratio of a typical amplitude; below it, data say little of a candidate
SHIFT_STANDARD_ERRORS = 2.0  # by which a calibrated parameter must change to be mentioned
LN_BAYES_IMPOSSIBLE = 1e6  # what the engine reports of recordings that cannot be as stated
NUISANCE_WORDS = {
    ParameterKind.SHIFT_U: "shift along u of",
    ParameterKind.SHIFT_V: "shift along v of",
    ParameterKind.GAIN: "camera gain of",
    ParameterKind.SPREAD: "optics of",
    ParameterKind.MAP: "gain map of",
    ParameterKind.OFFSET: "offset of",
    ParameterKind.STATIC: "static offset map of",
    ParameterKind.OPTICS: "smear and stray light of",
    ParameterKind.WALL: "cooler wall of",
    ParameterKind.SCATTER: "friction of a repetition in",
    ParameterKind.LEVEL: "friction of",
    ParameterKind.TREND: "drifting pressure in",
    ParameterKind.MESH: "coarser mesh in",
    ParameterKind.CELL: "load cell's gain",
    ParameterKind.SCALE: "pixel scale of",
    ParameterKind.PLACE: "place of a point of",
    ParameterKind.LAG: "time constant of a point of",
    ParameterKind.SENSOR: "gain of a point of",
    ParameterKind.ZERO: "zero of a point of",
    ParameterKind.COLD_JUNCTION: "cold junction of",
    ParameterKind.TURN: "turn of the image of",
    ParameterKind.CLOCK: "clock of",
    ParameterKind.SIZE: "size of the block,",
    ParameterKind.MODEL_DISCREPANCY: "model discrepancy in",
}
NOISE_HINT = (
    "A noise that is stated too small or a constant offset of this recording may be the cause, or else an effect that "
    "the catalogue does not contain."
)


def describe_nuisance(p: ParameterId) -> str:
    """A nuisance parameter in words.

    >>> describe_nuisance(ParameterId(ParameterKind.MAP, (1, 0), file="day 2/wall.nc"))
    'gain map of wall.nc (1, 0)'
    >>> describe_nuisance(ParameterId(ParameterKind.LEVEL, condition=1))
    'friction of condition 2'
    """
    if p.kind in POINT_KINDS and p.kind is not ParameterKind.COLD_JUNCTION:
        point = p.name or f"{p.index[0] + 1} of {p.file.rpartition('/')[2]}"
        along = f" along {'xyz'[p.index[-1]]}" if p.kind is ParameterKind.PLACE else ""
        return f"{NUISANCE_WORDS[p.kind].removesuffix('a point of')}point {point}{along}"
    where = p.name or p.file.rpartition("/")[2] if p.condition == ALL_CONDITIONS else f"condition {p.condition + 1}"
    number = f" ({', '.join(map(str, p.index))})" if p.index else ""
    return f"{NUISANCE_WORDS.get(p.kind, p.kind)} {where}{number}".strip()


def describe_assumed_optics(file: str, names: tuple[str, ...]) -> str:
    """Which camera values were assumed because a recording does not state them."""
    values, verb = " and ".join(f"{ASSUMED_CAMERA_VALUES[n]:g} px" for n in names), "is" if len(names) == 1 else "are"
    return f"{file} does not state its {' and '.join(names)} (see flashtemp import); {values} {verb} assumed"


# --- the whole verdict -----------------------------------------------------------------------------------------
def describe_verdict(v: Verdict, known: Mapping[str, type[Effect]]) -> tuple[str, ...]:
    """A whole verdict in sentences, the verdict itself first; `known` effects by name."""
    answers: dict[str, Callable[[Verdict], Iterator[str]]] = {
        "named": _answer_named, "learned": _answer_learned, "held_key": _answer_input_wrong, "weak": _answer_weak,
        "none_needed": _answer_none_needed, "no_verdict": _answer_no_verdict,
        "group": partial(_answer_group, known=known), "unexplained": partial(_answer_unexplained, known=known),
    }  # fmt: skip
    answer = list(answers[v.kind](v))
    if v.kind == "named" and (own := _physical_causes(v)) and all(_acts_in_camera(c, known) for c in own):
        lead = "No effect on heat is missing from the model, but the measurement has an error"
        answer[0] = f"{lead}: {' and '.join(map(_cause_words, own))}."
    is_setup_in_answer = (v.kind == "named" and not _physical_causes(v)) or (
        v.kind == "group" and _is_setup_group(v, known)
    )
    setup = [] if is_setup_in_answer else [_setup_difference(c) for c in v.causes if c.laboratory]
    return (
        *answer,
        *setup,
        *_describe_contradictions(v),
        *_describe_gain(v),
        *_describe_alternative(v),
        *_describe_shifts(v),
        *_describe_friction(v),
        *_describe_usual_errors(v),
    )


def _physical_causes(v: Verdict) -> list[Cause]:
    """Causes that are physical effects, not errors of the set-up or of a recording."""
    return [c for c in v.causes if not c.laboratory]


def _acts_in_camera(c: Cause, known: Mapping[str, type[Effect]]) -> bool:
    """Whether an effect acts in the camera only and changes no heat."""
    return c.effect in known and known[c.effect].heat is Effect.heat


# --- the answer of each kind of verdict ------------------------------------------------------------------------
def _answer_named(v: Verdict) -> Iterator[str]:
    effects = _physical_causes(v)
    if not effects:
        yield from (_setup_difference(c) for c in v.causes)
        yield "No effect is missing from the model."
        return
    count = "one effect" if len(effects) == 1 else f"{len(effects)} effects"
    yield f"The model lacks {count}: {' and '.join(map(_cause_words, effects))}."
    for c in effects:
        yield f"{_parameter_words(c)}ln Bayes factor {c.ln_bayes:.0f} against the model without {c.effect}."
        yield from _describe_doubt(c)


def _answer_learned(v: Verdict) -> Iterator[str]:
    law, effects = v.law, _physical_causes(v)
    if law is None:
        yield "A law outside the catalogue was learned from the data."
        return
    gain = f"; ln Bayes factor {effects[0].ln_bayes:.0f} against the model without it" if effects else ""
    yield f"A law outside the catalogue was learned from the data: {law.words}{gain}."
    if law.beside:
        others = "; ".join(f"{words} ({gain:.0f})" for words, gain in list(law.beside.items())[:MAX_LISTED_ITEMS])
        yield f"Other laws that may explain the data, with their ln Bayes factors: {others}."
    yield _law_words(law)
    yield f"As a formula: {law.formula}." if law.formula else "No formula of the family fits the curve."


def _answer_input_wrong(v: Verdict) -> Iterator[str]:
    if v.held_key is None:
        yield "No effect is missing, but the data contradict a stated input."
        return
    yield f"No effect is missing, but the data contradict a stated input: {correction_words(v.held_key)}."
    yield f"Correct {v.held_key.key}, or let the campaign calibrate it (`free`)."


def _answer_weak(v: Verdict) -> Iterator[str]:
    effects = _physical_causes(v)
    if effects:
        parts = f"{_parameter_words(effects[0])}ln Bayes factor {effects[0].ln_bayes:.1f}"
        yield f"A missing effect is likely, but not established: {_cause_words(effects[0])}; {parts}."
    else:
        yield "A missing effect is likely, but not established."
    if v.not_named:
        yield f"Not more certain because: {'; '.join(v.not_named)}."


def _answer_group(v: Verdict, known: Mapping[str, type[Effect]]) -> Iterator[str]:
    words = _group_words(v, known)
    if _is_setup_group(v, known):
        yield f"The set-up differs from what is stated, and these data cannot distinguish how: {words}."
        yield "An independent measurement of one of these decides between them."
        return
    if stated := " and ".join(name for name in v.group if name not in known):
        yield (
            f"Either an effect is missing or a stated input is wrong, and these data cannot distinguish which: {words}."
        )
        effects = " or ".join(name for name in v.group if name in known)
        yield (
            f"To decide, measure {stated} in a separate test in which {effects} does not act; a measurement under the "
            "conditions of these recordings cannot decide. State the result with its uncertainty (`known`) and repeat."
        )
        yield "Recordings under other conditions, such as another speed or load, may distinguish them too."
        return
    confirmed = [c for c in _physical_causes(v) if c.effect in v.certain]
    yield f"One {'more ' * bool(confirmed)}effect is missing, and these data cannot distinguish which: {words}."
    if needed := _needed_amplitudes(v):
        yield f"Each of them alone would need: {'; '.join(needed)}."
    yield from (f"Confirmed: {_cause_words(c)}; {_parameter_words(c)}".removesuffix("; ") + "." for c in confirmed)
    if v.next_experiment:
        yield f"To distinguish them: {v.next_experiment}."


def _needed_amplitudes(v: Verdict) -> list[str]:
    """The amplitude that each effect of a group needs to explain the data, as far as it was estimated."""
    reports = {r.effect: r for r in v.rivals}
    out = []
    for r in (reports[name] for name in v.group if name in reports and reports[name].parameter):
        error = f" +- {r.stderr:.2g}" if r.stderr > 0.0 else ""
        at_bound = "" if error else " (at its bound)"
        out.append(f"{r.parameter} = {r.amplitude:.4g}{error}{unit_suffix(r.unit)}{at_bound}")
    return out


def _is_setup_group(v: Verdict, known: Mapping[str, type[Effect]]) -> bool:
    """Whether a group consists of errors of the set-up and of stated inputs, without an effect."""
    return not any(name in known for name in v.group)


def _group_words(v: Verdict, known: Mapping[str, type[Effect]]) -> str:
    """Members of a group in words; the words of a set-up error contain its alternatives already."""
    setup = [c.words for c in v.causes if c.laboratory and c.effect in v.group]
    if setup and _is_setup_group(v, known):
        return "; ".join(setup)
    if v.held_key is not None and v.held_key.key in v.group:
        others = [name.replace("_", " ") for name in v.group if name != v.held_key.key]
        return f"{correction_words(v.held_key)}; or {' or '.join(others)} is wrong"
    needed = {h.key: wrong_input_words(h) for h in v.alternative_inputs}
    words = {name: f"{known[name].cause} ({name})" for name in v.group if name in known} | needed
    return " or ".join(words.get(name, f"{name} is wrong") for name in v.group)


def _answer_unexplained(v: Verdict, known: Mapping[str, type[Effect]]) -> Iterator[str]:
    failed = [r for r in v.rules if not r.passed and r.name not in LAW_RULES]
    is_only_noise = bool(failed) and all(r.name == NOISE_TEST for r in failed)
    if is_only_noise:
        sentence = describe_failure(failed[0])
        yield f"{sentence[:1].upper()}{sentence[1:]}; the model passes all other tests."
        yield NOISE_HINT
    elif (wrong := _likeliest_input(v)) is not None:
        yield f"The model does not explain the data, and the likeliest reason is that {wrong} is stated wrongly."
        yield f"Correct {wrong}, or state how well it is known (`known`), and repeat before you look for an effect."
    elif _is_catalogue_tried(v, known):
        yield "Something is missing that the catalogue does not contain."
    else:
        count = sum(not r.reason.startswith("not tried") for r in v.rivals)
        yield f"Something is missing that none of the {count} `candidates` of this campaign describes."
        yield "The catalogue has more effects; leave out `candidates` to try them."
    if failed and not is_only_noise:
        yield f"What was tested and failed: {'; '.join(map(describe_failure, failed))}."
    effects = _physical_causes(v)
    if effects:
        names = " with ".join(c.effect for c in effects)
        yield f"The closest explanation in the catalogue is {names}, but the model is not adequate with it."
    if v.law is not None:
        left = [r.consequence for r in v.rules if r.name in LAW_RULES and not r.passed]
        reason = left[0] if left else "the model is not adequate with it"
        yield f"The closest law is only a hint, because {reason}: {v.law.words}. {_law_words(v.law)}"
    if v.missing:
        yield "The missing heat flux in the report shows where along the contact the model errs."


def _likeliest_input(v: Verdict) -> str | None:
    """The stated input that the data contradict more clearly than the closest effect is required, if there is one."""
    required = max((c.ln_bayes for c in _physical_causes(v)), default=CRITERIA.ln_bayes_named)
    return next((i.key for i in select_contradicted(v.inputs) if i.ln_bayes > required), None)


def _is_catalogue_tried(v: Verdict, known: Mapping[str, type[Effect]]) -> bool:
    """Whether a verdict lists all candidates of the catalogue, tried or with a reason why not, or none at all."""
    listed = {r.effect for r in v.rivals}
    return not listed or all(name in listed for name, e in known.items() if e.candidate and not (e.base or e.alike))


def _answer_none_needed(v: Verdict) -> Iterator[str]:
    yield "No extension is needed: the calibrated model explains the data within their noise."
    tried = [r for r in v.rivals if math.isfinite(r.score) and r.seen > 0.0]
    clear = [r.effect for r in sorted(tried, key=lambda r: -r.seen) if r.seen >= CLEARLY_VISIBLE_SIGMA]
    if tried and len(clear) < 0.5 * len(tried):
        listed = ", ".join(clear)
        yield (
            f"These data would hardly show most effects: at typical strength, {len(clear) or 'none'} of {len(tried)} "
            f"candidates would exceed {CLEARLY_VISIBLE_SIGMA:g} sigma{f' ({listed})' if clear else ''}. "
            "`flashtemp plan` suggests measurements that show more."
        )
    if v.not_named:
        yield f"The best candidate is not reported because: {'; '.join(v.not_named)}."
    elif tried:
        best = max(tried, key=lambda r: r.score)
        yield (
            f"The strongest of {len(tried)} candidates, {best.effect}, has a ln Bayes factor of {best.score:.1f}; "
            f"a cause needs {CRITERIA.ln_bayes_named:g}."
        )


def _answer_no_verdict(v: Verdict) -> Iterator[str]:
    reasons = "; ".join(v.not_named) or "the fit of the final model did not converge"
    yield f"There is no verdict: {reasons}."
    best = sorted((r for r in v.rivals if math.isfinite(r.score)), key=lambda r: -r.score)[:MAX_LISTED_ITEMS]
    if best:
        listed = ", ".join(f"{r.effect} ({r.score:.0f})" for r in best)
        yield f"The strongest candidates so far, with their ln Bayes factors: {listed}."
    yield "Check the values of the case and the conditions of the recordings first."


# --- what else the data say ------------------------------------------------------------------------------------
def select_contradicted(inputs: Sequence[InputResult]) -> list[InputResult]:
    """Stated inputs that the data contradict with at least the evidence of a hint, the most certain first."""
    some = [i for i in inputs if i.verdict == "contradicted" and i.ln_bayes > CRITERIA.ln_bayes_hint]
    return sorted(some, key=lambda i: -i.ln_bayes)


def _describe_contradictions(v: Verdict) -> Iterator[str]:
    """Stated inputs that the data contradict, without the one in the answer."""
    in_answer = v.held_key.key if v.held_key is not None and v.kind in ("held_key", "group") else ""
    some = [i for i in select_contradicted(v.inputs) if i.key != in_answer]
    if v.held_key is not None and not in_answer and v.held_key.key not in {i.key for i in some}:
        yield f"The data contradict a stated input: {correction_words(v.held_key)}."
    for i in some[:MAX_LISTED_ITEMS]:
        unit, sd_unit = unit_suffix(i.unit), unit_suffix("K" if i.unit == "degC" else i.unit)
        sd = f"{100.0 * i.sd:.2g} %" if i.relative else f"{i.sd:.2g}{sd_unit}"
        yield (
            f"The data contradict a stated input: {i.key} is stated as {format_digits(i.stated)}{unit} +- {sd}; "
            f"the data require {format_digits(i.estimate)} +- {format_digits(i.stderr, 2)}{unit}, {abs(i.pull):.1f} "
            f"standard deviations away (ln Bayes factor {i.ln_bayes:.0f})."
        )
    if len(some) > MAX_LISTED_ITEMS:
        yield f"The report lists {len(some) - MAX_LISTED_ITEMS} more."


def _describe_gain(v: Verdict) -> Iterator[str]:
    """What the extension gains."""
    if v.extended is None or v.base is None:
        return
    size = v.gain or {}
    changes = f"{size['file']} changes by {format_kelvin(size['changed_K'])} rms; " if size.get("file") else ""
    # in a group the extension is only one of the possible causes
    extension = " and ".join(c.effect for c in _physical_causes(v)) if v.kind == "group" else ""
    yield (
        f"With {extension or 'the extension'}, and everything calibrated again, {changes}chi2/dof of all fitted data "
        f"goes from {v.base.chi2_per_dof:.4g} to {v.extended.chi2_per_dof:.4g}."
    )
    before, after = f"{v.base.held_out_z:.3g}", f"{v.extended.held_out_z:.3g}"
    if is_within_noise(v.base.held_out_z, v.extended.held_out_z, v.extended.held_out_z_change_error):
        yield f"Left-out data are predicted as well as before ({before} and {after} sigma, within noise)."
    elif before != after:
        yield f"Left-out data are predicted to {after} sigma instead of {before}."


def _describe_alternative(v: Verdict) -> Iterator[str]:
    """The best alternative to a named cause."""
    some = [r for r in v.rivals if r.left is not None and r.score > CRITERIA.ln_bayes_hint]
    if v.kind == "named" and some:
        best = min(some, key=lambda r: r.left or 0.0)
        about = "" if best.refitted else "about "  # without a completed fit the number is an estimate
        yield f"The best alternative, {best.effect}, is less probable by a ln Bayes factor of {about}{best.left:.0f}."


def _describe_shifts(v: Verdict) -> Iterator[str]:
    """Calibrated parameters that were biased without the extension."""
    found = {p.name: p for p in v.nuisance}
    references = {key: at for c in v.causes for key, at in c.references.items()}
    for name, before, after, error in () if v.kind == "unexplained" else v.shifts:
        if error and abs(after - before) > SHIFT_STANDARD_ERRORS * error:
            now, limit = found.get(name, NormalisedDeviation(name, after, error, 0.0)), ""
            if is_at_limit(before, now.value, now.pull, v.assumed.get(name, math.inf)):
                limit = f" (the limit of {MAX_RIGID_PULL:g} prior standard deviations)"
            instead = f"{after:.4g} +- {error:.2g}{unit_suffix(now.unit)}"
            instead += f" (at {references[name]})" if name in references else ""
            yield f"Without it, {name} would be estimated as {before:.4g}{limit} instead of {instead}."


def _describe_friction(v: Verdict) -> Iterator[str]:
    """Friction that differs by more than usual scatter, which calibration absorbs without naming a cause."""
    for d in () if v.kind in ("no_verdict", "unexplained") else v.friction_differences:
        error = f"(+- {format_error(d.stderr, '1')}), higher in {d.higher} than in {d.lower}"
        size = f"by {format_error(d.value, '1')} {error}"
        if d.is_between_conditions:
            yield (
                f"Friction differs between conditions {size}: a law of load or speed, an error of the stated load, or "
                "scatter from test to test. Repeat one condition to tell."
            )
        else:
            yield (
                f"Friction differs between repetitions {size}: running-in, warming, or scatter from repetition to "
                "repetition."
            )


def _describe_usual_errors(v: Verdict) -> Iterator[str]:
    """Errors of the set-up within usual limits; not for a fit without a valid model, where they mean little."""
    absolute = {i.key: unit_suffix("K" if i.unit == "degC" else i.unit) for i in v.inputs if not i.relative}
    found = []
    for f in () if v.kind in ("no_verdict", "unexplained") else v.laboratory[:MAX_LISTED_ITEMS]:
        error = f"{f.stderr:.2g}{absolute[f.name]}" if f.name in absolute else format_error(f.stderr, f.unit)
        found.append(f"{f.words} (+- {error})")
    if found:
        yield f"Within usual limits, and calibrated: {'; '.join(found)}."


# --- parts of sentences ----------------------------------------------------------------------------------------
def _cause_words(c: Cause) -> str:
    return f"{c.words or c.effect.replace('_', ' ')} ({c.effect})"


def _parameter_words(c: Cause) -> str:
    """Parameters with their intervals, each followed by a semicolon; empty without any."""
    return "".join(f"{_estimate_words(p)}; " for p in c.parameters)


def _estimate_words(p: ParameterEstimate) -> str:
    if p.bound or p.ci95[1] <= p.ci95[0]:
        return f"{p.name} = {p.value:.4g}{unit_suffix(p.unit)} (at its bound)"
    return f"{p.name} = {p.value:.4g}{unit_suffix(p.unit)} (95 % interval {p.ci95[0]:.4g} to {p.ci95[1]:.4g})"


def _setup_difference(c: Cause) -> str:
    """An error of the set-up or of a recording, with its size and evidence."""
    size = "; ".join(f"{format_error(abs(p.value), p.unit)} +- {format_error(p.stderr, p.unit)}" for p in c.parameters)
    line = f"The set-up differs from what is stated: {c.words}{f' ({size})' if size else ''}"
    if c.ln_bayes >= LN_BAYES_IMPOSSIBLE:
        return f"{line}; as stated it is impossible."
    return f"{line}; ln Bayes factor {c.ln_bayes:.0f}."


def _law_words(law: LearnedLaw) -> str:
    """A law at its nodes, with 95 % bands."""
    kind = "Factor" if law.unit == "1" else "Value"
    rows = ", ".join(
        f"{np.interp(n, law.at, law.curve):.3g} ({np.interp(n, law.at, law.low):.3g} to "
        f"{np.interp(n, law.at, law.high):.3g}){unit_suffix(law.unit)} at {n:.4g}{unit_suffix(law.argument_unit)}"
        for n in law.nodes
    )
    return f"{kind}, with 95 % band: {rows}."


def _describe_doubt(c: Cause) -> Iterator[str]:
    """That a cause is certain but its law is not, if the conditions hardly agree on its amplitude."""
    if not c.is_doubtful:
        return
    unit = unit_suffix(c.parameters[0].unit)
    each = "; ".join(f"{own.value:.4g} +- {own.stderr:.2g}{unit} ({own.condition})" for own in c.per_condition)
    yield (
        f"The conditions hardly agree on {c.parameters[0].name}: {each}; the probability of such scatter is "
        f"{c.consistent:.1g}."
    )
    yield "The cause is certain, its law is not: measure a condition in between, or beyond."
