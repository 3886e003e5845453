"""Discovery on an elastic block: the pressure that elasticity gives is told from a pressure that it does not give."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from flashtemp.comparison import campaign
from flashtemp.comparison.synthetic_campaign import SyntheticPlan, make_synthetic_campaign
from flashtemp.discovery import engine
from flashtemp.model.case import load_case
from flashtemp.solver.time_integration import integrate_schedule

CASE = Path(__file__).parents[2] / "cases" / "uniform_pressure"
SHORT = {
    "schedule.repetitions": 1, "schedule.distance": 0.4, "schedule.wait": 8.0, "road.track_length": 0.4,
    "numerics.mesh": 0.5, "numerics.rtol": 1e-3, "output.profiles": 10,
}  # fmt: skip
CANDIDATES = ["sheared_block", "edge_pressure", "pressure_tilt", "pressure_crown"]


def pressed(*effects: str, **values: float) -> np.ndarray:
    """Pressure over its mean (columns,) while a block slides that has these effects."""
    given = {"effects": list(effects)} | {k.replace("__", "."): v for k, v in values.items()}
    case = load_case(CASE, SHORT | {"schedule.distance": 0.01} | given)
    run = integrate_schedule(case.scene, case.settings, case.title)
    return run.pressure[run.sliding > 0.5][0] / case["contact.pressure"]


def test_a_prescribed_pressure_acts_beside_the_one_of_a_flat_face():
    """A block that touches everywhere answers linearly: the peak adds what it adds to an even pressure."""
    peak = pressed("edge_pressure", edge_pressure__B=0.5) - pressed()
    assert np.ptp(peak) > 0.4
    both = pressed("face_shape", "edge_pressure", edge_pressure__B=0.5)
    np.testing.assert_allclose(both - pressed("face_shape"), peak, atol=1e-6)


def made(folder: Path, effects: list[str], hidden: tuple[str, ...], values: dict) -> Path:
    """A twin of two conditions on the elastic block with these effects and the hidden ones."""
    case = load_case(CASE, SHORT | {"effects": [*effects, *hidden]} | values)
    lab = make_synthetic_campaign(case, SyntheticPlan(hidden, 1, conditions=2), folder / "lab")
    (lab / "campaign.toml").write_text(
        f"candidates = {json.dumps(CANDIDATES)}\n{(lab / 'campaign.toml').read_text(encoding='utf-8')}"
    )
    return lab


@pytest.mark.long
@pytest.mark.parametrize(
    ("effects", "hidden", "values"),
    [
        (["face_shape"], ("edge_pressure",), {"edge_pressure.B": 1.5}),
        (["face_shape"], ("sheared_block",), {"friction.mu": 0.5}),
        (["face_shape", "friction_moment"], (), {"friction_moment.compliance": 0.002}),
    ],
    ids=["another pressure", "elastic pressure", "nothing"],
)
def test_pressure_of_elasticity_is_told_from_another_one(tmp_path, effects, hidden, values):
    """The hidden effect is named, or is in the group that is told; a tilted holder that is stated needs nothing."""
    verdict, _ = engine.discover(campaign.load(made(tmp_path, effects, hidden, values)), workers=1)
    if not hidden:
        assert verdict.kind == "none_needed"
    else:
        assert verdict.kind in ("named", "group")
        assert set(hidden) <= {c.effect for c in verdict.causes} | set(verdict.group)
