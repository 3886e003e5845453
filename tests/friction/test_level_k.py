"""Memory kernels (Level K) against finite volumes (Level H): two ways to the same temperatures and friction."""

from __future__ import annotations

import numpy as np
import pytest
from reference.kernel_block import KernelBlock
from scipy.interpolate import PchipInterpolator

from flashtemp import load
from flashtemp.model.build import find_theory
from flashtemp.physics.friction import flash_temperature, friction_table
from flashtemp.solver.time_integration import integrate_schedule

CALM = {  # what Level K leaves out: conduction along the block, cooling by air
    "conductivity_anisotropy.excess": -0.9,
    "ambient.convection": 0.0,
    "numerics.mesh": 1.4,
    "output.fields": 2,
}
P, AIR = 1.5e5, 293.15


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    file = tmp_path_factory.mktemp("case") / "case.toml"
    file.write_text("effects = []\n")

    def make(*effects, **given):
        return load(file, {"effects": list(effects)} | given.pop("values", {}))

    return make


def both(case, speed, effects=(), friction=None, widening=True, **values):
    """Run of Level H and result of Level K for the same block after 3.5 m."""
    values = CALM | {"schedule.speed": speed, "contact.lane_widening": float(widening)} | values
    made = case("conductivity_anisotropy", *effects, values=values)
    scene = made.scene
    block = KernelBlock(scene.block, scene.road, scene.length, speed, P, scene.spot_fraction, 3e-3, AIR, widening)
    law = friction(scene) if friction else lambda spot, face: np.ones_like(spot)
    return integrate_schedule(scene, made.settings), block.march(3.5 / speed, law, 50, 40)


def at(x, values, places):
    return PchipInterpolator(x, values)(places)


@pytest.mark.parametrize("speed", [0.1, 1.0])
@pytest.mark.parametrize("widening", [False, True])
def test_block_and_road(case, speed, widening):
    """Spot and face along the block after 3.5 m, with and without the widening of the lanes."""
    run, kernel = both(case, speed, widening=widening)
    places = np.array([0.2, 0.5, 0.8]) * 0.025
    for ours, theirs in ((run.T_spot, kernel.spot), (run.T_block, kernel.face)):
        rise = at(kernel.x, theirs[-1], places) - AIR
        bound = 1e-3 if widening else 8e-4
        np.testing.assert_allclose(at(run.x, ours[run.last_sliding_index], places) - 20.0, rise, rtol=bound)


@pytest.mark.parametrize("speed", [0.1, 1.0])
@pytest.mark.sample("1.0")
def test_friction_of_the_theory(case, speed):
    """The solver's table of friction against the theory itself in Level K, all heat at the contact."""

    def exact(scene):
        theory = find_theory(case("persson_friction"))[1].p.theory
        felt = friction_table.flash_fraction(theory.q, scene.block, 3e-3, speed)
        return lambda spot, face: theory(speed, face[:, None] + (spot - face)[:, None] * felt, P, spot).mu

    run, kernel = both(case, speed, ("persson_friction",), exact, **{"persson_friction.in_depth": False})
    x = np.concatenate([[0.0], kernel.x])
    mean = np.trapezoid(np.concatenate([kernel.mu[-1][:1], kernel.mu[-1]]), x) / x[-1]
    assert run.friction[run.last_sliding_index] == pytest.approx(mean, rel=3e-4)
    cold = find_theory(case("persson_friction"))[1].p.theory(speed, AIR, P).mu
    assert mean < 0.95 * cold  # so that the agreement says something


@pytest.mark.parametrize("speed", [0.1, 1.0, 3.0])
def test_hot_branch(case, speed):
    """On a road that takes no heat the solver's friction lies on the kernel theory's hot branch."""
    values = {
        "schedule.speed": speed, "schedule.distance": 0.1, "contact.alpha": 1e-2, "ambient.convection": 0.0,
        "persson_friction.spots": "theory", "persson_friction.shear_stress": 0.0,
    }  # fmt: skip
    made = case("persson_friction", values=values)
    scene, acting = find_theory(made)
    run = integrate_schedule(scene, made.settings)
    face = run.T_block[-1][len(run.x) // 2] + 273.15
    theory = acting.p.theory
    phi = float(theory.contact_fraction(2 * np.pi / 3e-3, speed, face, P))
    spots = flash_temperature.ContactSpots(
        3e-3, phi / (1.0 - phi)
    )  # what the passing of spots has left is in the face's temperature
    found, T = flash_temperature.solve_hot_branch(theory, scene.block, spots, speed, face, P)
    assert run.friction[-1] == pytest.approx(float(found.mu), rel=8e-3)
    assert found.mu < 0.8 * theory(speed, face, P).mu
    # heat nearer than 4 um counts as released at the contact, which warms it a little more
    assert run.T_spot[-1][len(run.x) // 2] - 20.0 == pytest.approx(T.max() - AIR, rel=0.08)
