"""The believed mesh: graded cells, cells spread evenly beside them, and factors for each direction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flashtemp.camera.prediction.observation import SIDE_WALL_CELLS, WAKE_CELL_GROWTH
from flashtemp.camera.prediction.synthetic_recording import empty_recording
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.comparison.compare import view_overrides
from flashtemp.meshes.grading import geometric
from flashtemp.model.case import assemble_case
from flashtemp.model.case_file import KeyLocations


def case(tmp_path, **given):
    return assemble_case({}, given, KeyLocations("none"), tmp_path, "mesh")


@pytest.mark.parametrize("even", [3, 10, 40])
def test_even_cells_bound_the_largest_and_leave_the_first(even):
    """34 graded cells of 4 um to 7 mm, and some more: none above length/even, the first within its share."""
    plain, edges = geometric(7e-3, 4e-6, 34), geometric(7e-3, 4e-6, 34, even=even)
    assert len(edges) == len(plain) + even
    assert (edges[0], edges[-1]) == (0.0, 7e-3)
    assert np.diff(edges).max() < 7e-3 / even
    assert np.diff(edges)[0] == pytest.approx(4e-6, rel=0.05)
    growth = np.diff(edges)[1:] / np.diff(edges)[:-1]
    assert growth.min() > 1.0
    assert np.all(np.diff(growth) < 1e-9)  # growth only slows down: the map is smooth


def test_refinement_keeps_the_map():
    """Every second edge of twice the cells is an edge."""
    np.testing.assert_allclose(
        geometric(7e-3, 4e-6, 34, 2, even=10)[::2], geometric(7e-3, 4e-6, 34, even=10), rtol=1e-9, atol=1e-15
    )


@pytest.mark.parametrize("direction", [0, 1, 2])
def test_a_factor_refines_one_direction(direction, tmp_path):
    factors = [1, 1, 1]
    factors[direction] = 2
    plain, finer = (case(tmp_path, **{"numerics.finer": f}).scene.mesh for f in ([1, 1, 1], factors))
    for k, edges in enumerate(("x", "height", "depth")):
        counts = len(getattr(plain, edges)) - 1, len(getattr(finer, edges)) - 1
        assert counts[1] == (2 if k == direction else 1) * counts[0], edges


def test_what_recordings_see_asks_for_cells(tmp_path):
    """A side wall for even cells up the block, a wake for road behind it; more that a case has already is kept."""
    base = case(tmp_path)
    scene = base.scene
    side, wake = (
        RecordingEntry(v, empty_recording(v, scene, np.array([1.0]), np.array([1]), 0.05)) for v in ("sidewall", "wake")
    )
    assert view_overrides(base, [side]) == {"numerics.above": SIDE_WALL_CELLS}
    assert view_overrides(base, [wake]).keys() == {"road.downstream", "numerics.behind"}
    assert view_overrides(base, [side, wake]) == view_overrides(base, [side]) | view_overrides(base, [wake])
    assert view_overrides(base, [wake])["numerics.behind"] == WAKE_CELL_GROWTH
    assert view_overrides(case(tmp_path, **{"numerics.above": 25}), [replace(side, held_out=True)]) == {
        "numerics.above": 25
    }
    assert view_overrides(base, []) == {}
