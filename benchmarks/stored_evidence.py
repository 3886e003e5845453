"""Evidence of a finished discovery, stored so that its verdict can be decided again with other criteria.

A file has, for every full fit of the search, the numbers that the selection of effects and `decide` compare: a few
kilobytes for each campaign in place of 100 MB of sensitivities.  Fits that another criterion would require but that
were not made are not in it; `criteria_replay.py` counts them.
"""

from __future__ import annotations

import lzma
import pickle
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flashtemp.discovery import engine
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.decision import EffectSize
from flashtemp.discovery.diagnostics import setup_errors as setup_module
from flashtemp.discovery.diagnostics.adequacy_tests import refit_all_data, run_adequacy_tests
from flashtemp.discovery.diagnostics.cross_validation import cross_validate, heldout_excess
from flashtemp.discovery.diagnostics.setup_errors import ReducedFit
from flashtemp.discovery.diagnostics.stated_inputs import StatedInput
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.model_discrepancy import LARGEST_DISCREPANCY
from flashtemp.discovery.estimation.per_condition import estimate_effect_by_condition
from flashtemp.discovery.law_identification import IdentifiedLaw, ln_choice_odds
from flashtemp.discovery.parameters import PLACEMENT_KINDS, ParameterId, ParameterKind
from flashtemp.discovery.selection import forward_selection
from flashtemp.discovery.selection.forward_selection import EffectSearch, InputAlternative

Names = frozenset[str]
RECORDING_CRITERIA = ("ln_bayes_distinct", "law_excess_left", "adequacy_standard_errors", "noise_sd_uncertainty")


@contextmanager
def criteria_changed(**values: float) -> Iterator[None]:
    """All of discovery with other values of some criteria.  The one instance that all modules share is changed."""
    before = {name: getattr(CRITERIA, name) for name in values}
    try:
        for name, value in values.items():
            object.__setattr__(CRITERIA, name, value)
        yield
    finally:
        for name, value in before.items():
            object.__setattr__(CRITERIA, name, value)


@dataclass(frozen=True)
class StoredModel:
    """Names of the effects of a model, as the keys of `effects`."""

    effects: dict[str, None]


@dataclass(frozen=True)
class StoredSolution:
    """The number of data of a solution."""

    count: int


@dataclass(frozen=True)
class StoredScore:
    """The ln Bayes factor of a candidate by its sensitivities."""

    effect: str
    ln_bayes: float


@dataclass(frozen=True)
class StoredPair:
    """The best pair at the calibrated base, as in `scores.EffectPair`."""

    ln_bayes: float
    more: float
    effects: tuple[str, ...]


@dataclass(frozen=True)
class StoredSetup:
    """Errors of the set-up before any is judged: reduced systems with the estimated and with the `largest` discrepancy.

    `rise_squares` {error: sum of squares of the rise, in standard deviations of the noise, of the recordings on which
    it acts}; `changes` {input or size: largest relative change of a recording per unit}."""

    system: ReducedFit | None
    largest: ReducedFit | None
    rise_squares: dict[ParameterId, float]
    changes: dict[ParameterId, float] = field(default_factory=dict)


@dataclass(frozen=True)
class StoredFit:
    """The numbers of a `LinearisedFit` that selection and verdict compare, under the same names.

    `largest` {free parameters: ln evidence with the largest allowed model discrepancy}; `probabilities` of the
    scatter between conditions {effect: of fitted, of all data}; `adequacy` {test: value}; `misfits` (chi2, count) of
    every block; `heldout` ln probability of each fold left out.
    """

    model: StoredModel
    status: FitStatus
    ln_evidence: float
    promise: float
    chi2: float
    count: int
    effect_priors: dict[ParameterId, Any]
    bound: frozenset[ParameterId]
    largest: dict[frozenset[ParameterId], float]
    probabilities: dict[str, tuple[tuple[float, ...], tuple[float, ...]]]
    adequacy: dict[str, float]
    misfits: tuple[tuple[float, int], ...]
    heldout: tuple[float, ...]
    is_held_out: bool
    size: EffectSize | None
    setup: StoredSetup

    is_comparable = LinearisedFit.is_comparable
    is_converged = LinearisedFit.is_converged
    secured_evidence = LinearisedFit.secured_evidence

    @property
    def solution(self) -> StoredSolution:
        return StoredSolution(self.count)

    def evidence_at_max_discrepancy(self, problem: Any, free: Mapping[ParameterId, Any]) -> float:
        return self.largest[frozenset(free)]


@dataclass(frozen=True)
class StoredLaw:
    """A law that was identified: its `fit`, ln evidence `gain` against the base, that of the best fit of the catalogue,
    the price of the choice among all laws, and chi2 beyond expectation of left-out data before and after."""

    fit: StoredFit
    gain: float
    known_gain: float
    price: float
    excess: tuple[float, float]


@dataclass(frozen=True)
class StoredSearch:
    """A search as far as criteria act on it, with the `record` of its verdict as campaigns.py describes it.

    `rankings` at the base and at every extension; `law_was_tried` even where `law` is None; `recordings` {(criterion,
    factor): errors of recordings that are found with it}, with key ("", 1) as found, by images alone.
    """

    record: dict[str, Any]
    base: Names
    fits: dict[Names, StoredFit]
    rankings: tuple[tuple[StoredScore, ...], ...]
    pair: StoredPair | None
    unfitted: dict[Names, str]
    recording_errors: tuple[str, ...]
    recordings: dict[tuple[str, float], tuple[str, ...]]
    inputs: tuple[StatedInput, ...]
    law_was_tried: bool = False
    law: StoredLaw | None = None
    input_alternatives: tuple[InputAlternative, ...] = ()
    freed_inputs: tuple[str, ...] = ()


# --- recording --------------------------------------------------------------------------------------------------
@dataclass
class Recorder:
    """Results of a running discovery that its search does not contain: checks of stated inputs, the identification of a
    law, and recordings against the first predictions."""

    systems: list[tuple[EffectSearch, LinearSystem]] = field(default_factory=list)
    searches: list[EffectSearch] = field(default_factory=list)
    laws: list[IdentifiedLaw | None] = field(default_factory=list)
    recordings: list[tuple[tuple[Any, ...], Any]] = field(default_factory=list)
    inputs: list[StatedInput] = field(default_factory=list)

    @contextmanager
    def record_calls(self) -> Iterator[Recorder]:
        """The engine with its calls recorded."""
        kept = {name: getattr(engine, name) for name in ("assess_inputs", "identify_law", "find_recording_errors")}

        def assess_inputs(search: EffectSearch, final: LinearisedFit, watch: Any) -> Any:
            found = kept["assess_inputs"](search, final, watch)
            self.systems.append((search, found.system))
            self.inputs = [c.input for c in found.checks]
            return found

        def identify_law(search: EffectSearch, watch: Any) -> IdentifiedLaw | None:
            self.laws.append(None)
            self.laws[-1] = kept["identify_law"](search, watch)
            return self.laws[-1]

        def find_recording_errors(*args: Any) -> Any:
            found = kept["find_recording_errors"](*args)
            self.recordings.append((args, found))
            return found

        try:
            for function in (assess_inputs, identify_law, find_recording_errors):
                setattr(engine, function.__name__, function)
            yield self
        finally:
            for name, function in kept.items():
                setattr(engine, name, function)

    def to_stored_search(self, record: dict[str, Any]) -> StoredSearch:
        """All that was recorded, reduced to numbers."""
        search, system = self.systems[0]
        base, law = search.base, self.laws[0] if self.laws else None
        stored_law = None
        if law is not None and len(self.systems) > 1:
            known = max((f.ln_evidence for f in search.fits.values() if f.is_comparable), default=base.ln_evidence)
            stored_law = StoredLaw(
                store_fit(law.search, law.search.best, self.systems[1][1], self.inputs),
                law.search.best.ln_evidence - base.ln_evidence, known - base.ln_evidence, ln_choice_odds(law.scored),
                heldout_excess(law.search.data, law.search.base, law.search.best),
            )  # fmt: skip
        return StoredSearch(
            record=record,
            base=frozenset(base.model.effects),
            fits={names: store_fit(search, f, system, self.inputs) for names, f in search.fits.items()},
            rankings=tuple(tuple(StoredScore(s.effect, float(s.ln_bayes)) for s in r) for r in search.ranking),
            pair=_best_pair(search),
            unfitted=dict(search.unfitted),
            recording_errors=tuple(str(e.kind) for e in search.recording_errors),
            recordings=self._recordings(),
            inputs=tuple(self.inputs),
            law_was_tried=bool(self.laws),
            input_alternatives=search.input_alternatives,
            freed_inputs=search.problem.freed_inputs,
            law=stored_law,
        )

    def _recordings(self) -> dict[tuple[str, float], tuple[str, ...]]:
        from flashtemp.discovery.measurement_errors.recording_errors import find_recording_errors

        out: dict[tuple[str, float], tuple[str, ...]] = {}
        for args, found in self.recordings:
            out[("", 1.0)] = tuple(str(e.kind) for e in found)
            for name in RECORDING_CRITERIA:
                for factor in (0.5, 2.0):
                    with criteria_changed(**{name: factor * getattr(CRITERIA, name)}):
                        out[(name, factor)] = tuple(str(e.kind) for e in find_recording_errors(*args))
        return out


def _best_pair(search: EffectSearch) -> StoredPair | None:
    ranked = search.ranking[0] if search.ranking else ()
    found = forward_selection.score_pairs(search.problem, search.base, ranked)[:1] if len(ranked) > 1 else []
    return next((StoredPair(p.ln_bayes, p.more, tuple(s.effect for s in p.scores)) for p in found), None)


def store_fit(search: EffectSearch, fit: LinearisedFit, with_inputs: LinearSystem, inputs: Any) -> StoredFit:
    """A fit as numbers; `with_inputs` a system of any fit of these data with columns of all stated inputs.

    Sensitivities to stated inputs hardly depend on the model: those of the final one serve for all.
    """
    problem = search.problem
    free = {p: v for p, v in fit.effect_priors.items() if p not in fit.bound}
    base, own = engine.assess_model(search, search.base), engine.assess_model(search, fit)
    change = engine.size_of_change(search, base, own)
    blocks = [
        b.with_columns_of(o, lambda p: p.kind is ParameterKind.INPUT)
        for b, o in zip(fit.blocks, with_inputs.blocks, strict=True)
    ]
    every = refit_all_data(fit)
    pairs = (f.system.block_chi2(f.solution) for f in (fit, every))
    misfits = [(float(u if b.held_out else s), b.count) for b, s, u in zip(fit.blocks, *pairs, strict=True)]
    left_out = cross_validate(search.data, fit)
    scatter = {
        e: tuple(
            tuple(s.probability for s in estimate_effect_by_condition(problem, fit, e, every=every_datum))
            for every_datum in (False, True)
        )
        for e in fit.model.effects
    }
    return StoredFit(
        model=StoredModel(dict.fromkeys(fit.model.effects)),
        status=fit.status,
        ln_evidence=float(fit.ln_evidence),
        promise=float(fit.promise),
        chi2=float(fit.chi2),
        count=int(fit.solution.count),
        effect_priors=fit.effect_priors,
        bound=fit.bound,
        largest={
            frozenset(f): float(fit.evidence_at_max_discrepancy(problem, f)) for f in (free, fit.effect_priors, {})
        },
        probabilities=scatter,  # type: ignore[arg-type]
        adequacy={t.name: float(t.value) for t in run_adequacy_tests(problem, fit, CRITERIA)},
        misfits=tuple(misfits),
        heldout=tuple(map(float, left_out.density)),
        is_held_out=left_out.is_held_out,
        size=change.size if fit.model.effects else None,
        setup=_store_setup(search, fit, LinearSystem(blocks), inputs),
    )


def _store_setup(search: EffectSearch, fit: LinearisedFit, system: LinearSystem, inputs: Any) -> StoredSetup:
    known = {i.column_id: i for i in inputs}
    problem = search.problem
    discrepancy_sds = (None, LARGEST_DISCREPANCY)
    found, largest = (setup_module._reduce_fit(problem, fit, system, known, sd) for sd in discrepancy_sds)
    squares, changes = {}, {}
    for p in () if found is None else found.names:
        if p.kind in PLACEMENT_KINDS:
            share = setup_module._visible_fraction(search.data, fit, system, p, 1.0, 1.0)
            squares[p] = 2.0 / share**2
        else:
            changes[p] = setup_module._visible_fraction(search.data, fit, system, p, 1.0, 1.0)
    return StoredSetup(found, largest, squares, changes)


# --- files ------------------------------------------------------------------------------------------------------
def write_evidence(stored: StoredSearch, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(lzma.compress(pickle.dumps(stored, protocol=5)))


def read_evidence(file: Path) -> StoredSearch:
    """Evidence of a file that `write_evidence` made.  Only read files of your own: a pickle runs code."""
    found = pickle.loads(lzma.decompress(file.read_bytes()))
    assert isinstance(found, StoredSearch)
    return found
