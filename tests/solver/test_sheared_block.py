"""The elastic block under friction: where it presses, lifts off, and what a face of another shape does."""

from __future__ import annotations

import numpy as np
import pytest

from flashtemp.errors import BadInput

SMALL = {"numerics__cells": [40, 12, 14], "output__profiles": 5, "schedule__distance": 0.2}
SHEARED = ["face_shape", "sheared_block"]


def relative(run, k=-1):
    """Pressure over its mean at record k."""
    return run.pressure[k] / (run.pressure[k] @ run.mesh.dx_block / run.mesh.dx_block.sum())


def mean_between(run, low, high, k=-1):
    """Mean relative pressure between two shares of the length."""
    edges = np.append(0.0, np.cumsum(run.mesh.dx_block))
    carried = np.append(0.0, np.cumsum(relative(run, k) * run.mesh.dx_block))
    at = np.array([low, high]) * edges[-1]
    return float(np.diff(np.interp(at, edges, carried))[0] / np.diff(at)[0])


@pytest.mark.parametrize(
    ("mu", "tenths"), [(1e-9, [0.523, 0.911, 1.106, 1.207, 1.253]), (0.9, [2.275, 0.850, 0.964, 1.071, 1.120])]
)
def test_a_flat_face_is_pressed_as_finite_elements_say(lab, mu, tenths):
    """Tenths of the length, from a program of other elements and another contact method (`reference.elasticity`)."""
    run = lab.case(effects=SHEARED, friction__mu=mu, **SMALL)
    ours = [mean_between(run, 0.1 * k, 0.1 * (k + 1)) for k in range(5)]
    np.testing.assert_allclose(ours, tenths, atol=0.02, rtol=0.01)


def test_the_load_is_carried_and_what_lifts_off_carries_nothing(lab):
    run = lab.case(effects=SHEARED, friction__mu=1.2, **SMALL)
    assert run.pressure.min() == 0.0
    assert run.pressure[-1, -1] == 0.0
    assert run.pressure[-1] @ run.mesh.dx_block / run.mesh.dx_block.sum() == pytest.approx(1.5e5, rel=1e-9)


def test_the_peak_follows_the_friction(lab):
    """To first order in friction the change of the pressure is friction times one shape."""
    runs = [lab.case(effects=["sheared_block"], friction__mu=mu, **SMALL) for mu in (1e-4, 2e-4)]
    once, twice = (relative(run) - 1.0 for run in runs)
    np.testing.assert_allclose(twice, 2.0 * once, atol=2e-3 * np.abs(once).max())
    assert once[0] > 0.0 > once[-1]


def test_pressure_does_not_depend_on_the_modulus_of_a_flat_sheared_block(lab):
    soft, hard = (lab.case(effects=SHEARED, block__modulus=E, **SMALL) for E in (2e6, 2e7))
    np.testing.assert_allclose(soft.pressure, hard.pressure, rtol=1e-6, atol=1e-3)


def test_a_block_that_slides_back_is_pressed_at_its_other_edge(lab):
    ahead, back = (lab.case(effects=SHEARED, schedule__speed=v, **SMALL) for v in (0.1, -0.1))
    np.testing.assert_allclose(back.pressure[:, ::-1], ahead.pressure, rtol=1e-6, atol=1.0)


@pytest.mark.parametrize("shape", ["edge_radius", "chamfer"])
def test_an_edge_that_is_taken_off_carries_nothing_there(lab, shape):
    run = lab.case(effects=["face_shape"], **{f"face_shape__{shape}": 1e-3}, **SMALL)
    assert run.pressure[-1, 0] == run.pressure[-1, -1] == 0.0
    assert mean_between(run, 0.45, 0.55) > 1.25


def test_a_measured_profile_is_the_same_as_the_worn_face_it_describes(lab):
    rows = [[0.0, 1e-4], [0.0125, 0.0], [0.025, 1e-4]]
    shaped = lab.case(effects=["face_shape"], face_shape__profile=rows, **SMALL)
    worn = lab.case(effects=["face_shape", "wear"], wear__profile=rows, wear__rate=0.0, **SMALL)
    np.testing.assert_allclose(shaped.pressure, worn.pressure, rtol=1e-9)


@pytest.mark.parametrize("effect", SHEARED)
def test_springs_refuse_what_only_an_elastic_block_can_do(lab, effect):
    with pytest.raises(BadInput, match=rf"block.stiffness: .*'{effect}'"):
        lab.case(effects=[effect], block__stiffness=1.4e9, **SMALL)


def test_an_edge_is_rounded_or_chamfered(lab):
    with pytest.raises(BadInput, match=r"face_shape\.chamfer"):
        lab.case(effects=["face_shape"], face_shape__edge_radius=1e-3, face_shape__chamfer=1e-3, **SMALL)


def test_a_softer_block_is_pressed_less_unevenly_by_its_profile(lab):
    """The modulus is that at the block's mean temperature."""
    worn = {"effects": ["face_shape"], "face_shape__profile": [[0.0, 2e-5], [0.025, 0.0]], **SMALL}
    softened = lab.case(block__modulus_slope=-0.02, **worn)
    mesh = softened.mesh
    cells = mesh.volume[mesh.block]
    mean = (softened.section(-1)[mesh.block] - softened.ambient_degC).ravel() @ cells.ravel() / cells.sum()
    same = lab.case(block__modulus=5e6 * (1.0 - 0.02 * mean), **worn)
    assert mean > 0.1
    np.testing.assert_allclose(softened.pressure[-1], same.pressure[-1], rtol=1e-4)
    assert softened.pressure[-1, 0] > softened.pressure[0, 0] + 100.0  # the worn edge


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ({"block__height": 1e-4, "block__length": 0.2}, "block.height"),
        ({"block__height": 1e-3, "numerics__across": 4, "numerics__elastic_3d": True}, "numerics.elastic_3d"),
    ],
)
def test_a_block_that_needs_too_many_elements_is_refused(lab, given, key):
    with pytest.raises(BadInput, match=rf"{key}: .* displacements, at most 200000"):
        lab.case(effects=["face_shape"], **SMALL | given)
