"""Errors of the laboratory: what calibration found of them, and those far beyond what is usual, named like causes.

Scale, turn and clock of an image, one alone or all of a view alike, and length and width of the block: each has its
prior among the nuisances; here it is asked whether the data want it wider by far.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.fit import Fit
from flashtemp.discovery.nuisances import GROUPS, LOOSE
from flashtemp.discovery.parameters import Kind, ParameterId
from flashtemp.discovery.problem import Problem

FOUND, WORTH = 4.0, 0.25  # standard errors, and prior standard deviations, from which what was found is told
UNUSUAL = 1.8  # prior standard deviations from which it is named, though calibration has put it right
CALLED = {Kind.SCALE: "pixel_scale", Kind.TURN: "image_turn", Kind.CLOCK: "clock"}
SIZES = {"block.length": "block_length", "block.width": "block_width"}
UNITS = {Kind.SCALE: "1", Kind.TURN: "degree", Kind.CLOCK: "s", Kind.SIZE: "1"}
VIEWS = {"sidewall": "all side walls", "wake": "all wakes", "profile": "all profiles", "points": "all points"}


@dataclass(frozen=True)
class LabError:
    """One error of the laboratory: its `value` with `stderr` in `unit`, `pull` in standard deviations of what is usual,
    `ln_bayes` of a prior that is LOOSE times as wide, also where the model errs most, and `words` for people."""

    name: str
    parameter: ParameterId
    value: float
    stderr: float
    unit: str
    pull: float
    ln_bayes: float
    words: str

    @property
    def clear(self) -> bool:
        """Whether it is more than chance and more than a trifle."""
        return abs(self.value) > FOUND * self.stderr and abs(self.pull) > WORTH

    @property
    def unusual(self) -> bool:
        """Whether it lies, two standard errors allowed for, where few laboratories do."""
        return self.clear and abs(self.pull) * (1.0 - 2.0 * self.stderr / abs(self.value)) > UNUSUAL


def parameters(fit: Fit) -> list[ParameterId]:
    """All that stands for an error of the laboratory in a fit, shared ones last."""
    asked = [p for p in fit.system.names if p.kind in CALLED or p.kind is Kind.SIZE]
    return sorted(asked, key=lambda p: (bool(p.name) and p.kind is not Kind.SIZE, p))


def errors(problem: Problem, fit: Fit) -> tuple[LabError, ...]:
    """Every error of the laboratory at a fit, the one that the data want most first."""
    plain = fit.solved(problem, fit.effects).solution.ln_evidence
    found = [_error(problem, fit, p, plain) for p in parameters(fit)]
    return tuple(sorted(found, key=lambda e: -e.ln_bayes))


def _error(problem: Problem, fit: Fit, p: ParameterId, plain: float) -> LabError:
    own = {p: (-fit.model.placed(p), LOOSE * GROUPS[p.kind])}
    wide = fit.solved(problem, fit.effects | own).solution
    gain = wide.ln_evidence - plain if p not in problem.loose else float("-inf")
    if gain > 0.0:  # what a smooth error of the model explains as well is none of the laboratory
        gain = min(gain, fit.at_largest(problem, fit.effects | own) - fit.at_largest(problem, fit.effects))
    return _stated(problem, p, fit.model.placed(p) + wide[p], wide.sd(p), gain)


def found(problem: Problem, fit: Fit, e: LabError) -> LabError:
    """An error that was named, as a later fit has it."""
    p = e.parameter
    return _stated(problem, p, fit.model.placed(p) + fit.solution[p], fit.solution.sd(p), e.ln_bayes)


def calibrated(problem: Problem, fit: Fit) -> Iterator[LabError]:
    """What calibration took of errors that are usual, where it is clear and no trifle; the largest first."""
    own = [p for p in parameters(fit) if p in fit.solution.names and p not in problem.loose]
    all_ = [_stated(problem, p, fit.model.placed(p) + fit.solution[p], fit.solution.sd(p), 0.0) for p in own]
    all_ = [replace(e, ln_bayes=_against_none(e)) for e in all_ if e.clear]
    yield from sorted(all_, key=lambda e: -abs(e.pull))


def _against_none(e: LabError) -> float:
    """ln Bayes factor of what is usual against no error at all (Savage and Dickey's ratio)."""
    usual = abs(e.value / e.pull)
    return 0.5 * (e.value / e.stderr) ** 2 + float(np.log(e.stderr / usual))


def _stated(problem: Problem, p: ParameterId, value: float, sd: float, gain: float) -> LabError:
    factor = 180.0 / np.pi if p.kind is Kind.TURN else 1.0
    usual = GROUPS[p.kind]
    return LabError(
        name(p), p, factor * value, factor * sd, UNITS[p.kind], value / usual, gain, words(problem, p, value)
    )


def name(p: ParameterId) -> str:
    """As a cause is called in files.

    >>> name(ParameterId(Kind.SCALE, file="wall.nc")), name(ParameterId(Kind.SIZE, name="block.length"))
    ('pixel_scale', 'block_length')
    """
    return SIZES[p.name] if p.kind is Kind.SIZE else CALLED[p.kind]


def words(problem: Problem, p: ParameterId, value: float) -> str:
    """An error in plain words; `value` relative, in rad or in s."""
    where = VIEWS.get(p.name, p.name) if p.name else p.file.rpartition("/")[2]
    if p.kind is Kind.SCALE:
        return f"the pixel scale of {where} is {100.0 * abs(value):.2g} % too {'small' if value > 0 else 'large'}"
    if p.kind is Kind.TURN:
        way = "anticlockwise" if value > 0 else "clockwise"
        return f"the image of {where} has to be turned {way} by {np.degrees(abs(value)):.2g} degrees"
    if p.kind is Kind.CLOCK:
        return f"the frames of {where} are stamped {abs(value):.2g} s too {'late' if value > 0 else 'early'}"
    told = problem.case[p.name]
    side = p.name.rpartition(".")[2]
    return (
        f"the block's {side} is {1e3 * told * (1.0 + value):.4g} mm, {100.0 * abs(value):.2g} % "
        f"{'more' if value > 0 else 'less'} than stated"
    )
