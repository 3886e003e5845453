"""Errors of the set-up that the data show: scale, rotation and clock of images, block sizes, and stated inputs.

All of them have priors.  With all other unknowns eliminated, only these few remain.  Stepwise regression (Efroymson, in
Ralston and Wilf, Mathematical Methods for Digital Computers, 1960) finds a set in which each error is needed: errors
without evidence are removed one by one, and each of the others is then tried in place of those that it makes needless.
Several sets may explain the data equally well, such as the length of the block and the pixel scale.  They are reported
as alternatives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.criteria import Criteria
from flashtemp.discovery.diagnostics.effect_size import change_per_unit
from flashtemp.discovery.diagnostics.stated_inputs import StatedInput
from flashtemp.discovery.estimation.linear_gaussian import Array, LinearSystem
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.estimation.model_discrepancy import LARGEST_DISCREPANCY
from flashtemp.discovery.estimation.nuisance_priors import NUISANCE_SD
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.hypotheses.heavy_tails import INPUT_TAIL, MAX_WIDTH_SWEEPS, WIDTH_TOLERANCE, local_width
from flashtemp.discovery.parameters import PLACEMENT_KINDS, ParameterId, ParameterKind, Priors
from flashtemp.discovery.prediction.problem import Problem

MAX_LISTED_ALTERNATIVES = 3  # in one sentence
SETUP_ERROR_NAMES = {ParameterKind.SCALE: "pixel_scale", ParameterKind.TURN: "image_turn", ParameterKind.CLOCK: "clock"}
BLOCK_SIZE_NAMES = {"block.length": "block_length", "block.width": "block_width"}
SETUP_ERROR_UNITS = {
    ParameterKind.SCALE: "1",
    ParameterKind.TURN: "degree",
    ParameterKind.CLOCK: "s",
    ParameterKind.SIZE: "1",
}
ALL_IMAGES_WORDS = {
    "sidewall": "all side walls",
    "wake": "all wakes",
    "profile": "all profiles",
    "points": "all points",
}


@dataclass(frozen=True)
class SetupError:
    """An error of the set-up: `value` with `stderr` in `unit`, and `pull` in prior standard deviations.

    `ln_bayes`: against no error.  `words`: a sentence for reports.  `alternatives`: name and words of other errors that
    explain the data as well.  `is_freed`: it is a stated input that explains the data better than an effect does.
    """

    name: str
    parameter: ParameterId
    value: float
    stderr: float
    unit: str
    pull: float
    ln_bayes: float
    words: str
    alternatives: tuple[tuple[str, str], ...] = ()  # name and words of each
    is_freed: bool = False

    @property
    def is_input(self) -> bool:
        """Whether it is a stated number of the case, not the placement of an image or a size of the block."""
        return self.parameter.kind is ParameterKind.INPUT

    def is_unusual(self, criteria: Criteria) -> bool:
        """Whether it exceeds the limit of its kind; for placements and block sizes less two standard errors."""
        if self.is_input:
            return self.is_freed or abs(self.pull) > criteria.pull_input
        return abs(self.pull) * (1.0 - 2.0 * self.stderr / abs(self.value)) > criteria.pull_setup


@dataclass(frozen=True)
class ReducedFit:
    """The fit as a quadratic function of set-up errors alone, with all nuisances eliminated.

    ln probability of the data is x.g - x.I.x / 2 up to a constant, with the errors x (k,), the `gradient` g (k,) and
    the `information` I (k, k); `sd` (k,) are prior standard deviations.  The errors of the numbers
    `positive` cannot be negative.
    """

    names: tuple[ParameterId, ...]
    gradient: Array
    information: Array
    sd: Array
    positive: frozenset[int] = frozenset()

    def solve(self, free: tuple[int, ...]) -> tuple[float, Array, Array]:
        """ln evidence with some errors free and the others zero; values and standard errors of the free ones.

        An error that would be negative and cannot be is zero.
        """
        ln_evidence, values, stderr = self._solve_unbounded(free)
        is_impossible = np.array([k in self.positive for k in free], bool) & (values < 0.0)
        if np.any(is_impossible):
            possible = tuple(k for k, bad in zip(free, is_impossible, strict=True) if not bad)
            ln_evidence, kept, kept_stderr = self.solve(possible)
            values[is_impossible] = 0.0
            values[~is_impossible], stderr[~is_impossible] = kept, kept_stderr
        return ln_evidence, values, stderr

    def with_local_widths(self, free: tuple[int, ...]) -> ReducedFit:
        """The same with priors of heavy tails for the errors that are `free`, as wide as they are at their estimates.

        An error of many usual sizes that the data determine is then not shrunk towards zero.
        """
        usual, wide = np.array(self.sd), self
        for _ in range(MAX_WIDTH_SWEEPS):
            sd = usual.copy()
            for k, value in zip(free, wide.solve(free)[1].tolist(), strict=True):
                sd[k] = local_width(usual[k], value, INPUT_TAIL)
            is_settled = np.all(np.abs(np.log(sd / wide.sd)) < np.log(WIDTH_TOLERANCE))
            wide = replace(self, sd=sd)
            if is_settled:
                break
        return wide

    def _solve_unbounded(self, free: tuple[int, ...]) -> tuple[float, Array, Array]:
        at = list(free)
        precision = self.information[np.ix_(at, at)] + np.diag(self.sd[at] ** -2.0)
        lower = np.linalg.cholesky(precision)
        half = np.linalg.solve(lower, self.gradient[at])
        ln_det = 2.0 * float(np.sum(np.log(np.diag(lower)))) + 2.0 * float(np.sum(np.log(self.sd[at])))
        covariance = np.linalg.inv(precision)
        return 0.5 * float(half @ half) - 0.5 * ln_det, covariance @ self.gradient[at], np.sqrt(np.diag(covariance))


def find_setup_errors(
    problem: Problem,
    data: WhitenedData,
    fit: LinearisedFit,
    with_inputs: LinearSystem,
    inputs: Sequence[StatedInput],
    criteria: Criteria,
) -> tuple[SetupError, ...]:
    """Errors of the set-up and of stated inputs that the data show at a fit, the most certain first.

    `with_inputs`: the system of the fit with columns of all stated inputs.
    """
    known = {i.column_id: i for i in inputs}
    system, largest = (_reduce_fit(problem, fit, with_inputs, known, sd) for sd in (None, LARGEST_DISCREPANCY))
    if system is None or largest is None:
        return ()
    sets = _select_stepwise(system, criteria.ln_bayes_named)
    free = max(sets, key=lambda s: sets[s])
    equivalent = sorted((s for s in sets if sets[free] - sets[s] < criteria.ln_bayes_distinct), key=lambda s: -sets[s])
    ln_evidence, (_, values, stderr) = system.solve(free)[0], system.with_local_widths(free).solve(free)
    errors = []
    for place, k in enumerate(free):
        rest = tuple(q for q in free if q != k)
        # the gain must remain with the largest model discrepancy, which may explain the data as well
        gain = min(ln_evidence - system.solve(rest)[0], largest.solve(free)[0] - largest.solve(rest)[0])
        value, sd = float(values[place]), float(stderr[place])
        is_certain = gain > criteria.ln_bayes_named and abs(value) > criteria.setup_standard_errors * sd
        p = system.names[k]
        # an error that changes the data by less than the model may err is not reported, such as the height of a block
        # whose upper half is still cold
        if is_certain and _visible_fraction(data, fit, with_inputs, p, value, gain) > criteria.visible_fraction:
            others = _list_alternatives(problem, known, system, free, [s for s in equivalent if k not in s])
            errors.append(_make_error(problem, known, system.names[k], value, sd, gain, others))
    return tuple(sorted(errors, key=lambda e: -e.ln_bayes))


def _select_stepwise(system: ReducedFit, price: float) -> dict[tuple[int, ...], float]:
    """{set of errors: ln evidence less `price` for each} of sets in which every error is worth its price."""
    sets: dict[tuple[int, ...], float] = {}
    every = tuple(range(len(system.names)))

    def eliminate_and_store(free: tuple[int, ...], kept: tuple[int, ...] = ()) -> tuple[int, ...]:
        needed = _eliminate_backward(system, free, kept, price)
        sets[needed] = system.solve(needed)[0] - price * len(needed)
        return needed

    best = eliminate_and_store(every)
    while True:
        tried = [eliminate_and_store(tuple(sorted((*best, q))), (q,)) for q in every if q not in best]
        better = max(tried, key=lambda s: sets[s], default=best)
        if sets[better] <= sets[best]:
            return sets
        best = better


def _eliminate_backward(
    system: ReducedFit, free: tuple[int, ...], kept: tuple[int, ...], price: float
) -> tuple[int, ...]:
    """Remove the least needed error until each is worth `price`; errors in `kept` stay."""
    while set(free) - set(kept):
        now = system.solve(free)[0]
        without = {k: system.solve(tuple(q for q in free if q != k))[0] for k in free if k not in kept}
        k = max(without, key=lambda k: without[k])
        if now - without[k] > price:
            break
        free = tuple(q for q in free if q != k)
    return free


def _list_alternatives(
    problem: Problem, known: Mapping[ParameterId, StatedInput], system: ReducedFit, free: tuple[int, ...],
    others: Sequence[tuple[int, ...]],
) -> tuple[tuple[str, str], ...]:  # fmt: skip
    """Name and words of the errors that other sets have in place of one error; of these only the smallest sets."""
    new: dict[tuple[int, ...], tuple[int, ...]] = {}
    for other in others:  # the best first
        new.setdefault(tuple(q for q in other if q not in free), other)
    fewest = min((len(instead) for instead in new if instead), default=0)
    out = []
    for instead, other in new.items():
        if instead and len(instead) == fewest:
            values = dict(zip(other, system.solve(other)[1].tolist(), strict=True))
            named = [_name_and_words(problem, known, system.names[q], values[q]) for q in instead]
            out.append((named[0][0], " and ".join(words for _, words in named)))
    return tuple(out[:MAX_LISTED_ALTERNATIVES])


def _reduce_fit(
    problem: Problem,
    fit: LinearisedFit,
    system: LinearSystem,
    known: Mapping[ParameterId, StatedInput],
    discrepancy_sd: float | None,
) -> ReducedFit | None:
    """Reduce a fit to set-up errors: block sizes, placements common to a view or of one of several recordings, inputs.

    `discrepancy_sd`: prior width of the model discrepancy; None for that of the fit.  Returns None without any.
    """
    views = {v.file: v.recording.view for v in problem.campaign.views}
    count = {view: sum(v == view for v in views.values()) for view in views.values()}
    names = tuple(
        p for p in fit.solution.names
        if p.kind is ParameterKind.SIZE or (p.kind in PLACEMENT_KINDS and (not p.file or count[views[p.file]] > 1))
    )  # fmt: skip
    sizes = {p.name for p in names if p.kind is ParameterKind.SIZE}
    names = (*names, *(p for p in known if p in system.index and p.name not in sizes))
    if not names:
        return None
    free_inputs = {ParameterId.of_key(p.name) for p in known}  # the columns of the inputs take their place
    priors: Priors = {
        p: v for p, v in fit.free_priors.items()
        if p.kind not in PLACEMENT_KINDS and p.kind is not ParameterKind.SIZE and p not in free_inputs
    }  # fmt: skip
    if discrepancy_sd is not None:
        priors |= {
            p: (mean, discrepancy_sd) for p, (mean, _) in priors.items() if p.kind is ParameterKind.MODEL_DISCREPANCY
        }
    # for the only recording of a view, its placement and that of the view are the same unknown
    alone = {
        views[p.file]: p
        for p in fit.solution.names
        if p.kind in PLACEMENT_KINDS and p.file and count[views[p.file]] == 1
    }
    # held-out data are included, because their cameras may have errors too
    projection = system.project_out(priors, list(names), system.normal_equations(lambda b: True, fit.hyper.variances))
    places = []
    for p in names:
        single = alone.get(p.name) if p.kind in PLACEMENT_KINDS and not p.file else None
        value = fit.model.free.get(p.name, 0.0) if p in known else 0.0
        places.append(value or fit.model.setup_value(replace(p, name="", file=single.file) if single else p))
    # the quadratic is about the fitted placements; its gradient is needed about zero error
    gradient = projection.score + projection.information @ np.array(places)
    sd = np.array([known[p].sd if p in known else NUISANCE_SD[p.kind] for p in names])
    positive = frozenset(k for k, p in enumerate(names) if p in known and known[p].from_zero)
    return ReducedFit(names, gradient, projection.information, sd, positive)


def _name_and_words(
    problem: Problem, known: Mapping[ParameterId, StatedInput], p: ParameterId, value: float
) -> tuple[str, str]:
    """Name and words of an error."""
    if p not in known:
        return setup_error_name(p), describe_setup_error(problem, p, value)
    i = known[p]
    corrected = i.value * float(np.exp(value)) if i.relative else i.value + value
    unit = "" if i.unit == "1" else f" {i.unit}"
    return i.key, f"{i.key} is {corrected:.4g}{unit}, not {i.value:.4g}{unit}"


def _make_error(
    problem: Problem, known: Mapping[ParameterId, StatedInput], p: ParameterId, value: float, sd: float, gain: float,
    others: tuple[tuple[str, str], ...],
) -> SetupError:  # fmt: skip
    key, sentence = _name_and_words(problem, known, p, value)
    factor = 180.0 / np.pi if p.kind is ParameterKind.TURN else 1.0
    usual, unit = (known[p].sd, "1") if p in known else (NUISANCE_SD[p.kind], SETUP_ERROR_UNITS[p.kind])
    is_freed = p in known and p.name in problem.freed_inputs
    return SetupError(key, p, factor * value, factor * sd, unit, value / usual, gain, sentence, others, is_freed)


def _visible_fraction(
    data: WhitenedData, fit: LinearisedFit, system: LinearSystem, p: ParameterId, value: float, gain: float
) -> float:
    """Relative change of the recordings' temperature rise, or of the friction of a load-cell record, by an error.

    For the placement of an image: the change that no other unknown can imitate, rms over all recordings that it acts
    on.  For an input or a block size: the whole change, in the recording where it is largest.
    """
    if p.kind not in PLACEMENT_KINDS:
        return abs(value) * change_per_unit(data, fit.predictions, system, p)
    shown = {file: o for prediction in fit.predictions for file, o in prediction.observables.items()}
    squares = 0.0
    for b in fit.blocks:
        if b.label in data.noises and any(q == p for q, _ in b.names):
            o = shown[b.label]
            rise = o.values[:, o.inside] - float(np.nanmin(o.values))
            squares += b.count * float(np.nanmean(rise**2)) / data.noises[b.label].white ** 2
    return float(np.sqrt(2.0 * gain / squares)) if squares else 1.0


def setup_error_name(p: ParameterId) -> str:
    """The name of a set-up error in files, as a cause.

    >>> setup_error_name(ParameterId(ParameterKind.SCALE, file="wall.nc"))
    'pixel_scale'
    >>> setup_error_name(ParameterId(ParameterKind.SIZE, name="block.length"))
    'block_length'
    """
    return BLOCK_SIZE_NAMES[p.name] if p.kind is ParameterKind.SIZE else SETUP_ERROR_NAMES[p.kind]


def describe_setup_error(problem: Problem, p: ParameterId, value: float) -> str:
    """A set-up error in words; its `value` is relative for scales and sizes, else in rad or s."""
    where = ALL_IMAGES_WORDS.get(p.name, p.name) if p.name else p.file.rpartition("/")[2]
    if p.kind is ParameterKind.SCALE:
        return f"the pixel scale of {where} is {100.0 * abs(value):.2g} % too {'small' if value > 0 else 'large'}"
    if p.kind is ParameterKind.TURN:
        way = "anticlockwise" if value > 0 else "clockwise"
        return f"the image of {where} has to be rotated {way} by {np.degrees(abs(value)):.2g} degrees"
    if p.kind is ParameterKind.CLOCK:
        return f"the time stamps of {where} are {abs(value):.2g} s too {'late' if value > 0 else 'early'}"
    stated = problem.case[p.name]
    side = p.name.rpartition(".")[2]
    return (
        f"the block's {side} is {1e3 * stated * (1.0 + value):.4g} mm, {100.0 * abs(value):.2g} % "
        f"{'larger' if value > 0 else 'smaller'} than stated"
    )
