"""What the pictures of a verdict show, in words, for those who cannot see them."""

from __future__ import annotations

import numpy as np

from flashtemp.viz import before_after, candidates, verdict_parts
from flashtemp.viz.numbers import number, spoken

MOST = 4  # things told of a picture


def alt(verdict, name: str) -> str:
    """One picture of a verdict in a sentence, with its own numbers; its heading first."""
    told = {
        "what_is_wrong": _wrong, "not_noise": _noise, "missing": _missing, "why": _why, "else": _else,
        "gained": _gained,
    }  # fmt: skip
    return f"{verdict_parts.head(verdict, name)}: {told[name](verdict)}."


def _shown(verdict) -> list:
    return [p for group in verdict_parts.shown(verdict) for p in group]


def _wrong(verdict) -> str:
    some = sorted((p for p in _shown(verdict) if verdict_parts.stands_out(p.before)), key=verdict_parts.difference)
    if not some:
        return "measured, computed and their difference; no difference stands out from noise"
    lines = []
    for p in some[::-1][:MOST]:
        at = p.before.largest
        where = f"x = {number(1e3 * at.u)} mm" if p.recording.places is None else "one of its points"
        lines.append(f"{p.before.view.file} by {number(at.K)} K at {where}, t = {number(at.time)} s")
    return f"measured less computed is largest in {'; '.join(lines)}"


def _noise(verdict) -> str:
    lines = []
    for p in [p for p in _shown(verdict) if p.recording.places is None][:MOST]:
        share = f"{number(100 * verdict_parts.beyond(p.before))} % with the base"
        share += f", {number(100 * verdict_parts.beyond(p.after))} % extended" if p.after is not None else ""
        lines.append(f"{p.before.view.file} {share}")
    return f"pixels whose mean over frames is beyond 3 sigma: {'; '.join(lines)}"


def _missing(verdict) -> str:
    lines = []
    for m in verdict.missing[:MOST]:
        i = np.unravel_index(np.argmax(np.abs(m.flux)), m.flux.shape)
        flux, error = 1e-3 * m.flux[i], 1e-3 * m.flux_sd[i]
        at = f"x = {number(1e3 * m.x[i[1]])} mm, repetition {m.repetition[i[0]]}"
        lines.append(f"{verdict_parts.told(m.condition)} {number(flux)} ± {number(error)} kW/m² at {at}")
    return f"the heat flux to be added is largest at {'; '.join(lines)}"


def _why(verdict) -> str:
    best = [f"{spoken(name)} {number(score)}" for name, score, *_ in candidates.scores(verdict)[:MOST]]
    return f"ln Bayes factors of all candidates, the best {', '.join(best)}; {candidates.ALARM:g} is the alarm level"


def _else(verdict) -> str:
    lines = []
    if verdict.separability is not None:
        names, matrix = verdict.separability
        alike = np.tril(np.abs(np.asarray(matrix, float)), -1)
        if alike.size and alike.max() > 0:
            i, j = np.unravel_index(np.argmax(alike), alike.shape)
            lines.append(f"most alike are {spoken(names[i])} and {spoken(names[j])}, correlation {number(alike[i, j])}")
    if verdict.nuisance:
        p = max(verdict.nuisance, key=lambda p: abs(p.pull))
        lines.append(f"farthest from what was known is {p.name}, by {number(p.pull)} sigma")
    return "; ".join(lines) or "no two effects are alike"


def _gained(verdict) -> str:
    lines = [f"{words} {number(b)} K to {number(a)} K" for words, b, a in before_after.sizes(verdict)]
    lines += [f"{name} moved by {number(change)} %" for name, change, _ in before_after.moved(verdict)[:MOST]]
    return f"root mean square differences from base to extended: {'; '.join(lines)}"
