"""What to look at in the laboratory where no cause explains the data, sorted by how much each would explain.

Geometry, scale, orientation, time and keys that were held: of each the ln Bayes factor of giving it room.
"""

from __future__ import annotations

from collections.abc import Iterator

from flashtemp.discovery.fit import Fit
from flashtemp.discovery.held_keys import HeldKey
from flashtemp.discovery.laboratory import LabError, errors
from flashtemp.discovery.nuisances import LOOSE
from flashtemp.discovery.orientation import other_ways
from flashtemp.discovery.parameters import SHIFTS, Kind
from flashtemp.discovery.searched import Search
from flashtemp.discovery.verdict import Check

SORTS = {Kind.SIZE: "geometry", Kind.SCALE: "scale", Kind.TURN: "orientation", Kind.CLOCK: "time"}


def checklist(search: Search) -> tuple[Check, ...]:
    """Everything that a laboratory can look at again, what would explain most first."""
    fit = search.best
    out = [
        *map(_of_an_error, (*search.laboratory, *errors(search.problem, fit))), *_places(search, fit),
        *_orientations(search), *(_of_a_key(k) for k in search.keys),
    ]  # fmt: skip
    return tuple(sorted(out, key=lambda c: -c.ln_bayes))


def _of_an_error(e: LabError) -> Check:
    return Check(SORTS[e.parameter.kind], str(e.parameter), e.words, max(e.ln_bayes, 0.0), e.value, e.stderr, e.unit)


def _of_a_key(k: HeldKey) -> Check:
    return Check("held key", k.key, k.words, k.ln_bayes, k.value, k.stderr, k.unit)


def _places(search: Search, fit: Fit) -> Iterator[Check]:
    """The origins of the images, each known worse than said."""
    plain = fit.solved(search.problem, fit.effects).solution.ln_evidence
    for p in fit.solution.names:
        if p.kind in SHIFTS:
            mean, sd = fit.priors[p]
            wide = fit.solved(search.problem, fit.effects | {p: (mean, LOOSE * sd)}).solution
            value = fit.model.shift(p.file)[p.axis] + wide[p]
            words = f"the image of {p.file.rpartition('/')[2]} lies {value:.2g} px off along {'uv'[p.axis]}"
            yield Check("geometry", str(p), words, wide.ln_evidence - plain, value, wide.sd(p), "px")


def _orientations(search: Search) -> Iterator[Check]:
    """Images turned over, each by itself against what the model has to say of it."""
    for file, words, gain in other_ways(search.problem, search.data, search.base):
        yield Check("orientation", f"{file} {words}", f"{file.rpartition('/')[2]} is {words}", gain, 0.0, 0.0, "1")
