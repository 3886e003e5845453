"""Sensitivities to stated inputs, computed on a coarser mesh than the predictions to halve their cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flashtemp.discovery.diagnostics.stated_inputs import StatedInput
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.prediction.prediction import DerivativeRequest, Observable, Prediction, Single
from flashtemp.discovery.prediction.problem import Problem

# of the cells along, up and down; the columns differ from those of the fine mesh by 1 to 8 %
INPUT_CELL_FACTORS = (0.5, 0.5, 0.5)


def add_input_columns(
    problem: Problem, model: ModelPoint, predictions: Sequence[Prediction], inputs: Sequence[StatedInput],
    cells: tuple[float, ...] | None = INPUT_CELL_FACTORS,
) -> list[Prediction]:  # fmt: skip
    """Add the columns of `inputs` to the predictions of all conditions at a point.

    `cells`: cell factors of the mesh on which the columns are computed; None for the mesh of the predictions.
    Raises BadInput, SolverFailure.
    """
    request = DerivativeRequest(inputs=tuple(i.column_id for i in inputs))
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
