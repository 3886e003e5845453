"""The verdict in a tribologist's words."""

from __future__ import annotations

import math
from collections.abc import Mapping

from flashtemp.discovery.calibration import ENOUGH, Fit
from flashtemp.discovery.parameters import ALL, Kind, ParameterId
from flashtemp.discovery.search import NAMED, WEAK
from flashtemp.discovery.verdict import Cause, Verdict
from flashtemp.physics.effect import Effect

CALLED = {
    Kind.SHIFT_U: "shift along u of", Kind.SHIFT_V: "shift along v of", Kind.GAIN: "camera gain of",
    Kind.SPREAD: "optics of", Kind.MAP: "gain map of", Kind.WALL: "cooler wall of",
    Kind.SCATTER: "friction of a repetition in", Kind.LEVEL: "friction of", Kind.TREND: "drifting pressure in",
    Kind.MESH: "coarser mesh in", Kind.CELL: "load cell's gain", Kind.FLOOR: "the model's own error in",
    Kind.PLACE: "place of a point of",
}  # fmt: skip


def called(p: ParameterId) -> str:
    """A nuisance in words.

    >>> called(ParameterId(Kind.MAP, (1, 0), file="day 2/wall.nc")), called(ParameterId(Kind.LEVEL, condition=1))
    ('gain map of wall.nc (1, 0)', 'friction of condition 2')
    """
    where = p.file.rpartition("/")[2] if p.condition == ALL else f"condition {p.condition + 1}"
    number = f" ({', '.join(map(str, p.index))})" if p.index else ""
    return f"{CALLED.get(p.kind, p.kind)} {where}{number}".strip()


def says(v: Verdict, known: Mapping[str, type[Effect]]) -> tuple[str, ...]:
    """A whole verdict in sentences; `known` effects by name."""
    lines = [*_what(v, known), *v.not_named, *_gain(v)]
    rival = next((r for r in v.rivals if r.left is not None and r.score > WEAK), None)
    if v.kind == "named" and rival is not None:
        lines.append(f"The best rival, {rival.effect}, leaves ln Bayes factor {rival.left:.0f}.")
    for name, before, after, error in v.shifts:
        if error and abs(after - before) > 2.0 * error:
            lines.append(
                f"Without it, {name} would have come out as {before:.4g} instead of {after:.4g} +- {error:.2g}."
            )
    return tuple(lines)


def _what(v: Verdict, known: Mapping[str, type[Effect]]) -> list[str]:
    """What is missing, if anything."""
    if v.kind == "named":
        return [f"{_sentence(c)} ln Bayes factor {c.ln_bayes:.0f} against the model without it." for c in v.causes]
    if v.kind == "weak":
        c = v.causes[0]
        needed = f"; {NAMED:g} names a cause" if c.ln_bayes < NAMED else ""
        return [f"A hint, no proof: {_sentence(c)} ln Bayes factor {c.ln_bayes:.1f}{needed}."]
    if v.kind == "group":
        words = " or ".join(f"{known[e].cause} ({e})" for e in v.group)
        return [f"Something is missing, and these data cannot tell which of these it is: {words}."]
    if v.kind == "unexplained":
        odd = [k for k, (value, limit) in v.gates.items() if value > limit]
        lines = [f"Something is missing that is not in the catalogue: {'; '.join(odd)} beyond what fits."]
        if v.causes:
            lines.append(f"The nearest member is {v.causes[0].effect}, but it does not explain the data.")
        return lines
    lines = ["No extension is needed: the calibrated model explains the data within their noise."]
    best = max((r for r in v.rivals if math.isfinite(r.score)), key=lambda r: r.score, default=None)
    if best is not None:
        lines.append(
            f"The strongest of {len(v.rivals)} candidates, {best.effect}, has ln Bayes factor {best.score:.1f}; "
            f"{NAMED:g} would name a cause."
        )
    return lines


def _gain(v: Verdict) -> list[str]:
    """What the extension gains."""
    if v.extended is None or v.base is None:
        return []
    seen = v.gain or {}
    changes = f"it changes {seen['file']} by {1e3 * seen['changed_K']:.3g} mK rms, calibrated again; " if seen else ""
    return [
        f"With it, {changes}chi2/dof goes from {v.base.chi2_per_dof:.4g} to {v.extended.chi2_per_dof:.4g}; data left "
        f"out are predicted to {v.extended.held_out_z:.3g} sigma instead of {v.base.held_out_z:.3g}."
    ]


def _sentence(c: Cause) -> str:
    numbers = ", ".join(
        f"{p.name} = {p.value:.4g} ({p.ci95[0]:.4g} to {p.ci95[1]:.4g}){'' if p.unit == '1' else ' ' + p.unit}"
        for p in c.parameters
    )
    return f"Cause: {c.words}; {numbers}."


def not_converged(fit: Fit) -> tuple[str, ...]:
    """Why there is no verdict."""
    return (
        f"The calibration did not converge: after {len(fit.history)} steps the next one would still move "
        f"a parameter by {fit.history[-1]:.2g} of its prior standard deviation ({ENOUGH} is the limit).",
        "Check the values of the case and the conditions of the recordings before anything is concluded.",
    )
