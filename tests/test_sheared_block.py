"""The pressure that friction causes by shearing the block: beam theory, resolution, and friction that changes."""

from __future__ import annotations

import numpy as np
import pytest

from flashtemp.physics import sheared_block
from flashtemp.physics.sheared_block import pressure_by_friction

SMALL = {"numerics__cells": [40, 12, 14], "output__profiles": 5, "schedule__distance": 0.2}


@pytest.mark.parametrize(("slenderness", "bound"), [(1.5, 0.03), (3.0, 0.02)])
def test_a_tall_block_carries_half_the_moment_of_the_friction_force_at_its_face(slenderness, bound):
    """A beam held at one end and guided at the other: M = V H/2 at both."""
    x, change = pressure_by_friction(slenderness, 0.49)
    assert np.trapezoid(change * (0.5 - x), x) == pytest.approx(slenderness / 2, rel=bound)


def test_the_edge_is_resolved(monkeypatch):
    """Of the mean over a twentieth of the length at the edge, twice the elements change 2 % at most."""
    edge = np.linspace(0.0, 0.05, 41)
    means = []
    for finer in (1, 2):
        monkeypatch.setattr(sheared_block, "ALONG", 40 * finer)
        monkeypatch.setattr(sheared_block, "UP", 12 * finer)
        means.append(np.interp(edge, *pressure_by_friction.__wrapped__(0.3, 0.49)).mean())
    assert means[0] == pytest.approx(means[1], rel=0.02)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.499])
def test_it_is_odd_and_carries_no_load(poisson):
    x, change = pressure_by_friction(0.5, poisson)
    assert np.trapezoid(change, x) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(change, -change[::-1])
    assert change[0] == change.max() > 1.0


def test_the_peak_follows_the_friction(lab):
    """What is over the mean, at every moment, is the load-weighted friction times one shape."""
    run = lab.case(
        effects=["sheared_block", "friction_softening"],
        sheared_block__strength=0.2,
        friction_softening__b=0.006,
        **SMALL,
    )
    over = run.pressure / (run.pressure @ run.mesh.dx_block / run.mesh.dx_block.sum())[:, None] - 1.0
    assert run.friction[1] - run.friction[-1] > 0.02
    np.testing.assert_allclose(over, np.outer(run.friction, over[-1] / run.friction[-1]), atol=1e-6)
    assert over[-1, 0] == pytest.approx(0.2 * run.friction[-1] * 3.3, rel=0.15)


def test_what_lifts_off_carries_nothing(lab):
    run = lab.case(effects=["sheared_block"], friction__mu=1.2, **SMALL)
    assert run.pressure.min() == 0.0
    assert run.pressure[-1] @ run.mesh.dx_block / run.mesh.dx_block.sum() == pytest.approx(1.5e5, rel=1e-9)
