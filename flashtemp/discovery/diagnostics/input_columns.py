"""Columns of stated inputs, predicted on a coarser mesh than the data are compared with, which halves their cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flashtemp.discovery.diagnostics.stated_inputs import StatedInput
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.prediction.prediction import DerivativeRequest, Observable, Prediction, Single
from flashtemp.discovery.prediction.problem import Problem

INPUT_CELL_FACTORS = (
    0.5,
    0.5,
    0.5,
)  # times the cells along, up and down: columns differ by 1 to 8 %, a prior's sd as little


def add_input_columns(
    problem: Problem, model: ModelPoint, predictions: Sequence[Prediction], inputs: Sequence[StatedInput],
    cells: tuple[float, ...] | None = INPUT_CELL_FACTORS,
) -> list[Prediction]:  # fmt: skip
    """Predictions of all conditions at a point with columns of `inputs` besides their own, on a mesh of so many times
    the `cells` along, up and down; None: the mesh that data are compared with.

    Raises BadInput, SolverFailure.
    """
    asked = DerivativeRequest(inputs=tuple(i.column_id for i in inputs))
    coarse = problem.predict(problem.make_tasks(model, asked, cells))
    return [merge_columns(fine, other) for fine, other in zip(predictions, coarse, strict=True)]


def merge_columns(fine: Prediction, coarse: Prediction) -> Prediction:
    """A prediction with the columns of another that it lacks."""
    shown = {file: _with_columns(seen, coarse.observables[file]) for file, seen in fine.observables.items()}
    return replace(fine, observables=shown)


def _with_columns(fine: Observable, coarse: Observable) -> Observable:
    columns = {p: _map_to_pixels(fine, coarse, c) for p, c in coarse.columns.items() if p not in fine.columns}
    return replace(fine, columns=fine.columns | columns)


def _map_to_pixels(fine: Observable, coarse: Observable, column: Single) -> Single:
    """A column of the pixels inside one observable, for those inside another; 0 where only the other has one."""
    if fine.values.ndim == 1 or np.array_equal(fine.inside, coarse.inside):
        return column
    images = np.zeros(coarse.values.shape, np.float32)
    images[:, coarse.inside] = column
    return images[:, fine.inside]
