"""Candidates that cannot be tried are left out with the reason; texts of campaigns in which nothing slides."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.discovery.diagnostics.missing_heat import estimate_missing_heat
from flashtemp.discovery.hypotheses.candidates import NEEDS_OTHER_MESH, find_candidates
from flashtemp.discovery.verdict_assembly import describe_single_condition
from flashtemp.model.case import load_case
from flashtemp.solver.time_integration import integrate_schedule

COARSE = {"numerics.first_block": 2e-4}  # m: fits heat at the default depth of 1e-4 m, not at a third of it
ALONE = {"schedule.alone": 60.0}


@pytest.fixture
def case(tmp_path):
    (tmp_path / "case.toml").write_text("")
    return load_case(tmp_path / "case.toml")


def names_of(found) -> set[str]:
    return {c.effect for c in found}


def test_candidate_whose_shape_variant_does_not_fit_the_mesh_is_left_out(case):
    assert "heat_depth" in names_of(find_candidates(case, None)[0])
    found, left = find_candidates(case.with_values(COARSE), None)
    assert "heat_depth" not in names_of(found)
    assert left["heat_depth"].startswith("cannot be built with heat_depth.depth = 3.33e-05: ")
    assert "numerics.first_block" in left["heat_depth"]


def test_a_candidate_that_refines_the_mesh_is_left_out_with_a_reason(case):
    """Sensitivities are differences of runs on one mesh; listed in `candidates`, it ended with a traceback."""
    found, left = find_candidates(case, ("resolved_spots", "pressure_tilt"))
    assert [c.effect for c in found] == ["pressure_tilt"]
    assert left == {"resolved_spots": NEEDS_OTHER_MESH}


def test_candidate_must_be_possible_in_every_condition(case):
    found, left = find_candidates(case, None, (case, case.with_values(COARSE)))
    assert "heat_depth" not in names_of(found)
    assert "numerics.first_block" in left["heat_depth"]


def test_candidates_of_the_contact_are_left_out_where_nothing_slides(case):
    alone = case.with_values(ALONE | COARSE)
    found, left = find_candidates(alone, None)
    for name in ("heat_depth", "friction_speed", "interface_resistance", "wear"):
        assert left[name] == "nothing slides: the block is by itself", name
    assert {"radiation", "conductivity_slope", "holder_sink", "camera_offset"} <= names_of(found)
    assert find_candidates(alone, ("friction_speed",)) == ([], {"friction_speed": left["friction_speed"]})


def test_one_sliding_condition_keeps_the_candidates_of_the_contact(case):
    found, _ = find_candidates(case.with_values(ALONE), None, (case, case.with_values(ALONE)))
    assert {"heat_depth", "friction_speed"} <= names_of(found)


def test_no_heat_is_missing_along_a_contact_that_does_not_exist(case):
    """The inversion needs the pressure modes of the contact; without them its picture is empty."""
    still = case.with_values(ALONE | {"numerics.mesh": 0.3})
    alone = SimpleNamespace(run=integrate_schedule(still.scene, still.settings))
    assert np.ptp(alone.run.slid) == 0.0
    assert estimate_missing_heat(None, SimpleNamespace(predictions=(alone, alone))) == ()


def test_warning_of_a_single_condition_speaks_of_speed_only_where_the_block_slides():
    assert "speed or load" in describe_single_condition(alone=False)
    assert "speed" not in describe_single_condition(alone=True)
