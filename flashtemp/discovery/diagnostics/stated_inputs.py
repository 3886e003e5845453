"""The stated inputs of a campaign: every number of case and set-up that the data can check, and sensitivities to it.

The standard deviation is stated by the campaign (`known`) or by the case (`{ value, sd }`); otherwise the kind of the
input has one (`hypotheses/input_kinds.py`).  Sensitivities are computed on a coarser mesh than the predictions, which
halves their cost.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr

from flashtemp.camera.prediction.camera_model import TYPICAL_EMISSIVITY
from flashtemp.camera.recording import Recording
from flashtemp.comparison.known_inputs import VIEW_KEYS, StatedUncertainty
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.hypotheses.input_kinds import (
    KIND_OF_ZERO,
    MODEL_CHOICE,
    exemption_reason,
    input_kind,
    physical_keys,
    time_series_values,
)
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.prediction import DerivativeRequest, Observable, Prediction, Single
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.errors import BadInput
from flashtemp.model.case import Case
from flashtemp.model.priors import expand_materials

SOURCE_STATED, SOURCE_BY_KIND = "stated", "by kind"
VIEW_PLURALS = {"sidewall": "the side walls", "wake": "the wakes", "profile": "the profiles"}
CAMERA_INPUT_WORDS = {"emissivity": "emissivity", "reflected_temperature": "reflected temperature"}
OPAQUE_VIEWS = ("sidewall", "wake")  # views whose emissivity is assumed where a recording does not state it
# of the cells along, up and down; the columns differ from those of the fine mesh by 1 to 8 %
INPUT_CELL_FACTORS = (0.5, 0.5, 0.5)


MAX_INPUT_LN_FACTOR = 100.0  # limit of an estimate: without information in the data it may be any number


@dataclass(frozen=True)
class StatedInput:
    """A stated number: its `key`, a description in `words`, `value` in `unit` and its standard deviation `sd`.

    `sd` is that of ln value if the input is `relative`, else in its unit (K for degC).  `source`: "stated" or "by
    kind", with the `reason`.  `values`: all values that the conditions state.  The input changes them together, by a
    common factor or by a common difference.  `from_zero`: all state zero, and no value can be negative.
    """

    key: str
    words: str
    value: float
    unit: str
    sd: float
    relative: bool
    source: str
    reason: str
    values: tuple[float, ...] = ()
    from_zero: bool = False

    @property
    def column_id(self) -> ParameterId:
        """Its column in predictions: derivative per ln of the value, or per unit."""
        return ParameterId.of_input(self.key)

    def changed_value(self, change: float, sd: float) -> tuple[float, float]:
        """The value after a `change` of standard deviation `sd`, both in ln or in the unit, and its standard error."""
        if not self.relative:
            return self.value + change, sd
        value = self.value * math.exp(min(change, MAX_INPUT_LN_FACTOR))
        return value, abs(value) * sd

    def ln_bound_factor(self, change: float, sd: float) -> float:
        """What the bound at zero adds to ln evidence, for a posterior `change` +- `sd` without it.

        The half-normal prior is twice as dense as the normal one, and only the part of the posterior above zero counts.
        """
        return float(log_ndtr(change / sd)) + math.log(2.0) if self.from_zero else 0.0


def list_stated_inputs(problem: Problem) -> tuple[StatedInput, ...]:
    """Every stated number of case and set-up that is physical and not free, or free only since the data contradict it.

    Raises BadInput for a key of `known` that is not a measured input of this campaign.
    """
    campaign = problem.campaign
    cases = [expand_materials(problem.case.with_values(c.given)) for c in problem.conditions]
    inputs = [*_case_inputs(problem, cases), *_camera_inputs(problem, cases)]
    for key in campaign.known.keys() - {i.key for i in inputs}:
        raise BadInput(f"campaign: known: {key}: {_refusal_reason(problem, cases, key)}; leave it out")
    return tuple(inputs)


def _case_inputs(problem: Problem, cases: list[Case]) -> Iterator[StatedInput]:
    units: dict[str, str] = {}
    for case in cases:
        units |= physical_keys(case)
        units |= {k: case.declared_params(t)[n].unit for t, n, k in _uncertain_choices(case, problem.campaign.known)}
    for key, unit in units.items():
        if key not in problem.campaign.free or key in problem.freed_inputs:
            values = [v for case in cases if (v := time_series_values(case, key))]
            largest = tuple(dict.fromkeys(max(v, key=abs) for v in values))
            if key in KIND_OF_ZERO and any(largest):  # a factor leaves the zeros of other conditions as they are
                largest = tuple(v for v in largest if v)
            about = cases[0].declared_params(key.rpartition(".")[0])[key.rpartition(".")[2]].about
            yield _make_input(problem, key, _describe_key(key, about), unit, largest)


def _uncertain_choices(case: Case, known: Mapping[str, StatedUncertainty]) -> Iterator[tuple[str, str, str]]:
    """Table, name and key of model choices to which a campaign assigns an uncertainty."""
    for key in known:
        table, _, name = key.rpartition(".")
        if name in case.values.get(table, {}) and exemption_reason(case, key) == MODEL_CHOICE:
            yield table, name, key


def _camera_inputs(problem: Problem, cases: list[Case]) -> Iterator[StatedInput]:
    ambient = float(cases[0]["ambient.temperature"])
    recordings = [v.recording for v in problem.campaign.views]
    for view, words in VIEW_PLURALS.items():
        own = [r for r in recordings if r.view == view and (view in OPAQUE_VIEWS or r.emissivity is not None)]
        for name, unit in VIEW_KEYS.items() if own else ():
            values = tuple(dict.fromkeys(_recorded_value(r, name, ambient) for r in own))
            yield _make_input(problem, f"{view}.{name}", f"{CAMERA_INPUT_WORDS[name]} of {words}", unit, values)


def _recorded_value(recording: Recording, name: str, ambient: float) -> float:
    """The value that a recording states, else the one that the camera model assumes."""
    if name == "emissivity":
        return TYPICAL_EMISSIVITY if recording.emissivity is None else recording.emissivity
    return ambient if recording.reflected_degC is None else recording.reflected_degC


def _make_input(problem: Problem, key: str, words: str, unit: str, values: tuple[float, ...]) -> StatedInput:
    value = values[0]
    from_zero = key in KIND_OF_ZERO and value == 0.0
    kind = input_kind(key, unit, from_zero)
    own = problem.campaign.known.get(key)
    sd, source, reason = kind.sd, SOURCE_BY_KIND, kind.reason
    if own is not None:
        sd, source, reason = own.sd_of(value), SOURCE_STATED, "the campaign"
    elif key in problem.case.priors:
        sd, source, reason = problem.case.priors[key], SOURCE_STATED, "the case"
    if source == SOURCE_STATED and kind.relative:
        sd /= abs(value)
    return StatedInput(key, words, value, unit, sd, kind.relative, source, reason, values, from_zero)


def _describe_key(key: str, about: str) -> str:
    """A key in words, with its material or layer.

    >>> _describe_key("materials.asphalt.density", "density")
    'density of asphalt'
    >>> _describe_key("friction.mu", "friction coefficient; or a table")
    'friction coefficient'
    """
    kind, *names, _ = key.split(".")
    return about.split(";")[0].split(", mean")[0] + (f" of {names[0]}" if names else "")


def _refusal_reason(problem: Problem, cases: list[Case], key: str) -> str:
    """Why a key is not a checkable input of a campaign."""
    table, _, name = key.rpartition(".")
    reasons = [exemption_reason(case, key) for case in cases if name in case.values.get(table, {})]
    if reasons:
        return reasons[0]
    shown = ", ".join(sorted({v.recording.view for v in problem.campaign.views})) or "none"
    return f"no recording shows it; views are {shown}"


def add_input_columns(
    problem: Problem, model: ModelPoint, predictions: Sequence[Prediction], inputs: Sequence[StatedInput],
    cells: tuple[float, ...] | None = INPUT_CELL_FACTORS,
) -> list[Prediction]:  # fmt: skip
    """Add the columns of `inputs` to the predictions of all conditions at a point.

    `cells`: cell factors of the mesh on which the columns are computed; None for the mesh of the predictions.
    Raises BadInput, SolverFailure.
    """
    zeros = frozenset(i.column_id for i in inputs if i.from_zero)
    request = DerivativeRequest(inputs=tuple(i.column_id for i in inputs), zero_inputs=zeros)
    coarse = problem.predict(problem.make_tasks(model, request, cells))
    return [merge_columns(fine, other) for fine, other in zip(predictions, coarse, strict=True)]


def merge_columns(fine: Prediction, coarse: Prediction) -> Prediction:
    """A prediction with those columns of another that it lacks."""
    observables = {file: _with_columns(o, coarse.observables[file]) for file, o in fine.observables.items()}
    return replace(fine, observables=observables)


def _with_columns(fine: Observable, coarse: Observable) -> Observable:
    columns = {p: _map_to_pixels(fine, coarse, c) for p, c in coarse.columns.items() if p not in fine.columns}
    return replace(fine, columns=fine.columns | columns)


def _map_to_pixels(fine: Observable, coarse: Observable, column: Single) -> Single:
    """A column of `coarse` for the valid pixels of `fine`; 0 at pixels that are valid in `fine` only."""
    if fine.values.ndim == 1 or np.array_equal(fine.inside, coarse.inside):
        return column
    images = np.zeros(coarse.values.shape, np.float32)
    images[:, coarse.inside] = column
    return images[:, fine.inside]
