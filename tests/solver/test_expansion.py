"""Thermal expansion of the block into its pressure: springs and the elastic block, each against another solution."""

from __future__ import annotations

import numpy as np
import pytest
from reference.elasticity import ElasticBlock
from scipy.interpolate import CubicSpline, RegularGridInterpolator
from scipy.optimize import brentq

K_N, L = 1.4e9, 0.025
GIVEN = {"schedule__distance": 1.0, "numerics__mesh": 0.6, "numerics__rtol": 1e-5}
SPRINGS = GIVEN | {"block__stiffness": K_N}


def springs(run, worn, shape, mean, strain, k):
    """Pressure (lines,) of springs under a block that is as hot as in frame k, by bisection on how far it sinks."""
    mesh, rise = run.mesh, run.section(k)[run.mesh.block].astype(float) - run.ambient_degC
    z = 0.5 * (mesh.height[1:] + mesh.height[:-1])
    z, face = np.concatenate([[0.0], z, mesh.height[-1:]]), run.T_block[run.frames[k]] - run.ambient_degC
    rise = np.concatenate([face[:, None], rise, rise[:, -1:]], axis=1)
    up = strain * CubicSpline(z, rise, axis=1).integrate(0.0, z[-1])
    dx = np.diff(mesh.x)[mesh.first : mesh.last]

    def pressure(sunk):
        return np.maximum(0.0, mean * shape + K_N * (sunk + up - worn))

    sunk = brentq(lambda s: pressure(s) @ dx - mean * dx.sum(), -1e-3, 1e-3, xtol=1e-15)
    return pressure(sunk)


@pytest.mark.parametrize("speed", [0.1, -0.1, 1.0])
def test_pressure_is_that_of_springs_on_which_a_hot_block_stands(lab, speed):
    run = lab.case(**SPRINGS, effects=["thermal_expansion"], schedule__speed=speed)
    strain = 1.6e-4 * 1.49 / 0.51
    k = len(run.frames) - 1
    expected = springs(run, run.worn[run.frames[k]], 1.0, 1.5e5, strain, k)
    change = np.ptp(expected)
    print(f"pressure changes by {100 * change / 1.5e5:.1f} % of its mean along the block")
    assert change > 5e3
    np.testing.assert_allclose(run.pressure[run.frames[k]], expected, atol=0.01 * change)
    assert run.pressure[-1] @ run.mesh.dx_block == pytest.approx(1.5e5 * L, rel=1e-12)


def test_swelling_and_wear_act_together(lab):
    given = SPRINGS | {"wear__rate": 4e-10, "edge_pressure__B": 3.0, "edge_pressure__length": 4e-3}
    run = lab.case(**given, effects=["edge_pressure", "wear", "thermal_expansion"])
    k, x = len(run.frames) - 1, run.x
    edges = run.mesh.x[run.mesh.first : run.mesh.last + 1]
    whole = np.exp(-edges / 4e-3) * -4e-3
    peak = np.diff(whole) / np.diff(edges)
    shape = 1 + 3.0 * (peak - (whole[-1] - whole[0]) / L)
    expected = springs(run, run.worn[run.frames[k]], shape, 1.5e5, 1.6e-4 * 1.49 / 0.51, k)
    np.testing.assert_allclose(run.pressure[run.frames[k]], expected, atol=0.01 * np.ptp(expected))
    assert x[np.argmax(run.worn[-1])] < 2e-3


def test_a_hotter_end_takes_load_in_proportion(lab):
    """To first order the change of pressure is that of the rise, and the expansion's sign decides where it goes."""
    weak, double = (
        lab.case(**SPRINGS, effects=["thermal_expansion"], thermal_expansion__coefficient=a) for a in (1e-6, 2e-6)
    )
    np.testing.assert_allclose(double.pressure[-1] - 1.5e5, 2.0 * (weak.pressure[-1] - 1.5e5), rtol=0.01, atol=0.2)
    assert weak.pressure[-1][-5] > 1.5e5 > weak.pressure[-1][5]


def test_pressure_is_that_of_an_elastic_block_that_is_hot(lab):
    """Independent finite elements, heated as the run is: to 2 % of the mean, but for the outermost 1 % of the length."""
    run = lab.case(**GIVEN, effects=["thermal_expansion"], thermal_expansion__coefficient=5e-4)
    k, mesh, height = len(run.frames) - 1, run.mesh, 7e-3
    z = np.concatenate([[0.0], 0.5 * (mesh.height[1:] + mesh.height[:-1]), mesh.height[-1:]])
    rise = run.section(k)[mesh.block].astype(float) - run.ambient_degC
    face = run.T_block[run.frames[k]] - run.ambient_degC
    rise = np.concatenate([face[:, None], rise, rise[:, -1:]], axis=1)
    x = np.concatenate([[0.0], run.x, [L]])
    field = RegularGridInterpolator((x, z), rise[[0, *range(len(rise)), -1]])
    block = ElasticBlock.with_graded_mesh(L, height)
    even = block.displace_face(lambda x: 1.5e5 + 0.0 * x)[:, 1]  # a new block has the profile that is pressed evenly
    contact = block.solve_contact(
        1.5e5 * L,
        worn_depth=lambda x: -(block.interpolation(x) @ even),
        expansion=lambda x, z: 5e-4 * field(np.stack([np.clip(x, 0, L), np.clip(z, 0, height)], axis=-1)),
    )
    edges = mesh.x[mesh.first : mesh.last + 1]
    expected, inner = contact.column_means(edges), (run.x > 0.01 * L) & (run.x < 0.99 * L)
    assert np.ptp(expected[inner]) > 0.3 * 1.5e5
    np.testing.assert_allclose(run.pressure[run.frames[k]][inner], expected[inner], atol=0.02 * 1.5e5)
