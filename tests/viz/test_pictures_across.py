"""Pictures of runs with cells across, where something that they show is missing."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from flashtemp.viz.run import spots, width_maps

SMALL = {
    "numerics__mesh": 0.25, "block__height": 0.004, "block__width": 0.02, "schedule__distance": 0.03,
    "output__profiles": 4, "output__fields": 2,
}  # fmt: skip


@pytest.mark.parametrize("downstream", [0.0, 0.01])
def test_width_shows_the_wake_where_there_is_one(lab, downstream):
    fig = width_maps.draw(lab.case(**SMALL, numerics__across=8, road__downstream=downstream))
    above = fig.axes[0]
    fig.canvas.draw()
    assert len(above.images) == (2 if downstream else 1)
    assert ("wake" in "".join(t.get_text() for t in above.texts)) == (downstream > 0)
    assert ("the wake" in above.get_title("left")) == (downstream > 0)
    far = 1e3 * (0.025 + downstream)
    assert above.get_xlim()[1] == pytest.approx(far, abs=0.5)


@pytest.mark.parametrize("across", [4, 80])
def test_spots_are_drawn_on_cells_of_any_size(lab, across):
    """Cells of 10 mm hold spots of 3 mm in part only, and the hottest of them set the scale all the same."""
    given = {"effects": ["resolved_spots"], "resolved_spots__repeat": 0.02, "numerics__rtol": 1e-2}
    fine = {"numerics__cells": [60, 8, 8]} if across > 4 else {}
    run = lab.case(**SMALL | {"schedule__distance": 0.004}, **given, **fine, numerics__across=across)
    cover = run.maps["cover"]
    assert (cover.max() > 0.9) == (across > 4)
    fig = spots.draw(run)
    fig.canvas.draw()
    face, along = fig.axes[:2]
    shown = along.lines[0].get_ydata()
    best = cover[-1] >= 0.9 * cover[-1].max()
    np.testing.assert_array_equal(np.sort(shown), np.sort(run.maps["T_spot"][-1][best]))
    assert best.any()
    assert along.get_ylim()[1] >= shown.max()
    assert any(isinstance(c, QuadMesh) for c in face.collections)
