"""Derivatives of recordings by every candidate effect, against recordings of separate simulations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flashtemp.comparison import campaign
from flashtemp.comparison.synthetic_campaign import SyntheticPlan, make_synthetic_campaign
from flashtemp.discovery.prediction.prediction import DerivativeRequest, predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.model.case import load_case
from flashtemp.runs.results.worker_pool import open_worker_pool

SHORT = {
    "schedule.distance": 0.4, "schedule.repetitions": 2, "schedule.wait": 4.0, "road.track_length": 0.4,
    "numerics.mesh": 0.5,
}  # fmt: skip
SMALL_SHARE = 0.05  # of a typical strength: a law is nearly linear over it
FAINT_K = 1e-3  # of a change at typical strength, below which numerical noise is as large
TIGHT = {"numerics.rtol": 1e-6}  # separate runs are subtracted


@pytest.mark.long  # of single effects: tests/solver/test_tangent.py, tests/camera/test_operator.py
def test_the_derivative_by_every_candidate_is_the_difference_of_two_simulations(tmp_path):
    """That of a drifting room was wrong by its own size in a side wall, that of stick-slip by half."""
    (tmp_path / "case.toml").write_text("")
    plan = SyntheticPlan((), 3, conditions=1, views=("sidewall", "wake"))
    lab = make_synthetic_campaign(load_case(tmp_path / "case.toml", SHORT), plan, tmp_path / "lab")
    wrong, compared = [], set()
    with open_worker_pool(predict_condition, 1) as run:
        problem = prepare_problem(campaign.load(lab), run)
        model = problem.stated_model

        def predict(at, derivatives, overrides):
            tasks = problem.make_tasks(at, derivatives)
            return problem.predict([replace(t, mesh_overrides=t.mesh_overrides | overrides) for t in tasks])[
                0
            ].observables

        with_columns = predict(model, DerivativeRequest(candidates=problem.candidates), {})
        before = predict(model, DerivativeRequest(), TIGHT)
        for c in problem.candidates:
            if c.is_optical:  # its derivative is the difference of two images of one simulation
                continue
            for k, typical in c.strengths.items():
                # a curved law is flat at its neutral value: its derivative is a secant up to the typical strength
                step = typical * (1.0 if c.params[k].curved else SMALL_SHARE)
                off = c.neutral_values()
                after = predict(model.with_effect(c.effect, off | {k: off[k] + step}), DerivativeRequest(), TIGHT)
                for file, shown in with_columns.items():
                    if shown.values.ndim < 3 or (column := shown.columns.get(c.strength_column(k))) is None:
                        continue
                    change = (after[file].values - before[file].values)[:, shown.inside] / step
                    size = max(np.sqrt(np.mean(v**2)) for v in (change, column))
                    if size * typical < FAINT_K:
                        continue
                    compared.add(c.effect)
                    if (error := float(np.sqrt(np.mean((column - change) ** 2)) / size)) > 0.1:
                        wrong.append((c.effect, k, file, round(error, 2)))
    assert not wrong
    assert {"ambient_drift", "track_memory", "stick_slip", "pressure_tilt", "friction_softening"} <= compared
