"""The verdict in a tribologist's words."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from flashtemp.discovery.adequacy import PULL
from flashtemp.discovery.fit import ENOUGH, Fit
from flashtemp.discovery.laboratory import UNUSUAL
from flashtemp.discovery.parameters import ALL, OF_A_POINT, Kind, ParameterId
from flashtemp.discovery.problem import UNSAID
from flashtemp.discovery.searched import NAMED, WEAK
from flashtemp.discovery.verdict import Cause, LearnedLaw, Verdict
from flashtemp.physics.effect import Effect

MOST = 3  # of each kind in the text
SHOWS = 5.0  # standard deviations of a typical strength, below which a cause would hardly be named
CALLED = {
    Kind.SHIFT_U: "shift along u of", Kind.SHIFT_V: "shift along v of", Kind.GAIN: "camera gain of",
    Kind.SPREAD: "optics of", Kind.MAP: "gain map of", Kind.OFFSET: "offset of",
    Kind.STATIC: "static offset map of", Kind.OPTICS: "smear and stray light of", Kind.WALL: "cooler wall of",
    Kind.SCATTER: "friction of a repetition in", Kind.LEVEL: "friction of", Kind.TREND: "drifting pressure in",
    Kind.MESH: "coarser mesh in", Kind.CELL: "load cell's gain", Kind.SCALE: "pixel scale of",
    Kind.PLACE: "place of a point of", Kind.LAG: "time constant of a point of", Kind.SENSOR: "gain of a point of",
    Kind.TURN: "turn of the image of", Kind.CLOCK: "clock of",
    Kind.SIZE: "size of the block,", Kind.FLOOR: "the model's own error in",
}  # fmt: skip

GATES = {  # what was asked, what it is measured by, and what it means if it does not pass
    "a third cause (ln Bayes factor)": (
        "Two causes are enough", "ln Bayes factor of the best third one", "two causes are not enough"),
    "amplitude differs between conditions (-log10 of its probability)": (
        "A cause is as strong in every condition", "-log10 of the probability of so much scatter",
        "the strength of the cause differs from condition to condition more than its errors allow"),
    "heat of any shape (ln Bayes factor)": (
        "No other heat along the contact is asked for", "ln Bayes factor of heat of any shape",
        "heat of another shape along the contact is asked for"),
    "pressure of any shape (chi2 of modes)": (
        "The pressure need not be bent to fit", "chi2 of six cosines of the pressure",
        "the pressure would have to be bent to fit"),
    "calibrated parameters (standard deviations)": (
        "The free keys agree with what was known", "standard deviations of the farthest",
        "a calibrated key would have to be far from what was known"),
    "camera and friction scatter (standard deviations)": (
        "Camera and friction behave as usual", "standard deviations of the farthest",
        "camera or friction would have to be far from what is usual"),
    "noise left over (standard errors of chi2)": (
        "What is left is as small as noise", "standard errors of chi2 of the worst recording",
        "more than noise is left of a recording"),
}  # fmt: skip


def gate(key: str) -> tuple[str, str, str]:
    """A check for adequacy in plain words: what holds if it passes, what it is measured by, what is wrong if not."""
    return GATES.get(key, (key, "", f"{key} beyond what fits"))


def called(p: ParameterId) -> str:
    """A nuisance in words.

    >>> called(ParameterId(Kind.MAP, (1, 0), file="day 2/wall.nc")), called(ParameterId(Kind.LEVEL, condition=1))
    ('gain map of wall.nc (1, 0)', 'friction of condition 2')
    """
    if p.kind in OF_A_POINT:
        point = p.name or f"{p.index[0] + 1} of {p.file.rpartition('/')[2]}"
        along = f" along {'xyz'[p.index[-1]]}" if p.kind is Kind.PLACE else ""
        return f"{CALLED[p.kind].removesuffix('a point of')}point {point}{along}"
    where = p.name or p.file.rpartition("/")[2] if p.condition == ALL else f"condition {p.condition + 1}"
    number = f" ({', '.join(map(str, p.index))})" if p.index else ""
    return f"{CALLED.get(p.kind, p.kind)} {where}{number}".strip()


def says(v: Verdict, known: Mapping[str, type[Effect]]) -> tuple[str, ...]:
    """A whole verdict in sentences; `known` effects by name."""
    lines = [*_first(v), *_what(v, known), *v.not_named, *_gain(v), *_laboratory(v), *_look(v)]
    rival = next((r for r in v.rivals if r.left is not None and r.score > WEAK), None)
    if v.kind == "named" and rival is not None:
        about = "" if rival.refitted else "about "  # what falls far behind is not followed to its end
        lines.append(f"The best rival, {rival.effect}, leaves ln Bayes factor {about}{rival.left:.0f}.")
    for name, before, after, error in v.shifts:
        if error and abs(after - before) > 2.0 * error:
            lines.append(
                f"Without it, {name} would have come out as {before:.4g} instead of {after:.4g} +- {error:.2g}."
            )
    return tuple(lines)


def _first(v: Verdict) -> list[str]:
    """A key that was held, before any cause."""
    if v.held_key is None:
        return []
    h = v.held_key
    line = f"A key that was held explains what a cause would: {h.words}; ln Bayes factor {h.ln_bayes:.0f}."
    return [f"{line} All else here was found with it free." if h.freed else f"{line} Put it right, or free it, first."]


def _laboratory(v: Verdict) -> list[str]:
    """What calibration found of the laboratory, within what is usual or beyond."""
    usual, odd = "within what is usual, and allowed for", "far beyond what is usual: what is missing may ask for it"
    more = "more than is usual, and allowed for"
    return [
        f"Calibration found that {f.words} (+- {_sized(f.stderr, f.unit)}): "
        f"{odd if abs(f.pull) > PULL else more if abs(f.pull) > UNUSUAL else usual}."
        for f in v.laboratory[:MOST]
    ]


def _sized(value: float, unit: str) -> str:
    return (
        f"{100.0 * value:.2g} %"
        if unit == "1"
        else f"{value:.2g} {unit}s"
        if unit == "degree"
        else f"{value:.2g} {unit}"
    )


def _look(v: Verdict) -> list[str]:
    """What to look at again, where nothing explains the data."""
    some = [c for c in v.checklist if c.ln_bayes > WEAK][:MOST]
    if not v.checklist:
        return []
    if not some:
        return ["Nothing in geometry, scale, orientation, time or the keys that were held would explain it."]
    listed = "; ".join(f"{c.sort}: {c.words} (ln Bayes factor {c.ln_bayes:.0f})" for c in some)
    return [f"Look at this first: {listed}."]


def _what(v: Verdict, known: Mapping[str, type[Effect]]) -> list[str]:
    """What is missing, if anything."""
    found = [_sentence(c) for c in v.causes if c.laboratory]
    causes = [c for c in v.causes if not c.laboratory]
    if v.kind == "no_verdict":
        return _known(v)
    if v.kind == "held_key":
        return found
    if v.kind == "named":
        against = "against the model without it."
        told = [[f"{_sentence(c)} ln Bayes factor {c.ln_bayes:.0f} {against}", *_doubt(c)] for c in causes]
        return [*found, *(line for lines in told for line in lines)]
    if v.kind == "learned" and v.law is not None:
        return [*found, *_law(v.law, causes[0].ln_bayes)]
    if v.kind == "weak":
        c = causes[0]
        needed = f"; {NAMED:g} names a cause" if c.ln_bayes < NAMED else ""
        return [*found, f"A hint, no proof: {_sentence(c)} ln Bayes factor {c.ln_bayes:.1f}{needed}."]
    if v.kind == "group":
        words = " or ".join(f"{known[e].cause} ({e})" if e in known else e for e in v.group)
        sure = [f"Certain: {_sentence(c)[7:]}" for c in causes if c.effect in v.certain]
        more = "Beside it something" if sure else "Something"
        return [*found, *sure, f"{more} is missing, and these data cannot tell which of these it is: {words}."]
    if v.kind == "unexplained":
        odd = [
            f"{gate(k)[2]} ({value:.3g}, at most {limit:g})" for k, (value, limit) in v.gates.items() if value > limit
        ]
        lines = [*found]
        if odd:
            lines.append(f"Something is missing that is not in the catalogue: {'; '.join(odd)}.")
        if causes:
            lines.append(f"The nearest member is {causes[0].effect}, but it does not explain the data.")
        return [*lines, *_open(v)]
    lines = ["No extension is needed: the calibrated model explains the data within their noise."]
    tried = [r for r in v.rivals if math.isfinite(r.score) and r.seen > 0.0]
    best = max(tried, key=lambda r: r.score, default=None)
    clear = [r.effect for r in sorted(tried, key=lambda r: -r.seen) if r.seen >= SHOWS]
    if tried and len(clear) < 0.5 * len(tried):
        seen = f"{', '.join(clear)} alone" if clear else "none of them"
        lines.append(
            f"But these data would hardly have shown most causes: of {len(tried)} candidates at their typical strength "
            f"{seen} would stand out by {SHOWS:g} standard deviations; `flashtemp plan` tells what would show more."
        )
    if best is not None:
        lines.append(
            f"The strongest of {len(tried)} candidates, {best.effect}, has ln Bayes factor {best.score:.1f}; "
            f"{NAMED:g} would name a cause."
        )
    return lines


def _law(law: LearnedLaw, ln_bayes: float) -> list[str]:
    """What was learned, as what, and what else it could be."""
    unit, over = ("" if u == "1" else f" {u}" for u in (law.unit, law.argument_unit))
    rows = ", ".join(
        f"{np.interp(n, law.at, law.curve):.3g} ({np.interp(n, law.at, law.low):.3g} to "
        f"{np.interp(n, law.at, law.high):.3g}){unit} at {n:.4g}{over}"
        for n in law.nodes
    )
    kind = "factor" if law.unit == "1" else "value"
    lines = [
        f"Learned, since nothing in the catalogue explains the data as well: {law.words}; {kind} {rows}. ln Bayes "
        f"factor {ln_bayes:.0f} against the model without it."
    ]
    lines.append(f"As a formula: {law.formula}." if law.formula else "No formula of the family fits the curve.")
    if law.beside:
        others = "; ".join(f"{words} ({gain:.0f})" for words, gain in list(law.beside.items())[:MOST])
        lines.append(f"It could also be, by ln Bayes factors of their traces: {others}.")
    return lines


def _open(v: Verdict) -> list[str]:
    """What speaks for an effect and was not judged."""
    return [
        f"The trace of {names} has ln Bayes factor {gain:.0f}, but no full fit of it came to an end."
        for names, gain in sorted(v.open_ends.items(), key=lambda item: -item[1])[:MOST]
    ]


def _known(v: Verdict) -> list[str]:
    """What is known without a certificate."""
    best = [r for r in v.rivals if math.isfinite(r.score)][:MOST]
    tried = ", ".join(f"{r.effect} ({r.score:.0f})" for r in sorted(best, key=lambda r: -r.score))
    return [f"So far, with that said, the strongest traces (ln Bayes factor) are {tried}.", *_open(v)] if best else []


def _gain(v: Verdict) -> list[str]:
    """What the extension gains."""
    if v.extended is None or v.base is None:
        return []
    seen = v.gain or {}
    changes = f"{seen['file']} is predicted otherwise by {_kelvin(seen['changed_K'])} rms, " if seen else ""
    return [
        f"With it, and everything calibrated again, {changes}chi2/dof goes from {v.base.chi2_per_dof:.4g} to "
        f"{v.extended.chi2_per_dof:.4g}; data left out are predicted to {v.extended.held_out_z:.3g} sigma instead of "
        f"{v.base.held_out_z:.3g}."
    ]


def _kelvin(T: float) -> str:
    """A difference in kelvin, or below one in millikelvin.

    >>> _kelvin(1.132), _kelvin(0.0131)
    ('1.13 K', '13.1 mK')
    """
    return f"{T:.3g} K" if T >= 1.0 else f"{1e3 * T:.3g} mK"


def _sentence(c: Cause) -> str:
    numbers = ", ".join(
        f"{p.name} = {p.value:.4g} ({p.ci95[0]:.4g} to {p.ci95[1]:.4g}){'' if p.unit == '1' else ' ' + p.unit}"
        for p in c.parameters
    )
    if c.laboratory:
        size = "; ".join(f"{_sized(abs(p.value), p.unit)} +- {_sized(p.stderr, p.unit)}" for p in c.parameters)
        line = f"An error of the laboratory, put right here: {c.words}"
        return f"{line}{f' ({size})' if size else ''}; ln Bayes factor {c.ln_bayes:.0f}."
    return f"Cause: {c.words}; {numbers}."


def _doubt(c: Cause) -> list[str]:
    """That its law need not be the one of its name."""
    if not c.doubted:
        return []
    unit = "" if c.parameters[0].unit == "1" else f" {c.parameters[0].unit}"
    wanted = "; ".join(f"{own.value:.4g} +- {own.stderr:.2g}{unit} ({own.condition})" for own in c.per_condition)
    return [
        f"How it grows with what differs between the conditions is in doubt: each alone would have "
        f"{c.parameters[0].name} = {wanted}; by chance so with a probability of {c.consistent:.1g}. What is missing is "
        f"sure, its law is not: measure a condition in between, or beyond."
    ]


def instead(c: Cause, gain: float) -> str:
    """Why a law was learned though the catalogue has a cause."""
    return (
        f"The catalogue's best, {c.effect}, explains less (by a ln Bayes factor of {gain:.0f}), and conditions do not "
        f"agree on its strength (by chance so with a probability of {c.consistent:.1g})."
    )


def taken(file: str, names: tuple[str, ...]) -> str:
    """What was taken for what a recording does not say of its camera."""
    values, verb = " and ".join(f"{UNSAID[name]:g} px" for name in names), "was" if len(names) == 1 else "were"
    return f"{file}: it does not say its {' and '.join(names)} (flashtemp import); {values} {verb} taken"


def not_settled(names: frozenset[str], gain: float) -> str:
    """Why there is no verdict though a fit came to its end."""
    return (
        f"The full fit of {' with '.join(sorted(names))} did not come to an end and yet explains more than the best"
        f" that did (ln Bayes factor {gain:.3g}): nothing is named."
    )


def not_converged(fit: Fit) -> tuple[str, ...]:
    """Why there is no verdict."""
    return (
        f"The calibration did not converge: after {len(fit.history)} steps the next one would still move "
        f"a parameter by {fit.history[-1]:.2g} of its prior standard deviation ({ENOUGH} is the limit).",
        "Check the values of the case and the conditions of the recordings before anything is concluded.",
    )
