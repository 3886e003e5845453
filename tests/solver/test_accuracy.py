"""Error against tolerance, and against the reference solution of the benchmark slide2d."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from flashtemp.model.case import load_case
from flashtemp.model.effect_laws import COMPLEX_STEP
from flashtemp.model.numerics import installed_bindings
from flashtemp.runs.studies.convergence import Convergence
from flashtemp.solver import cvode
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.system import PhaseSystem

L = 0.025
BARE = {"ambient__convection": 0.0, "contact__lane_widening": 0.0}

# --- time -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("order", "most", "decade"), [(3, 0.8, 4.5), (5, 0.5, 6.0)])
def test_error_in_time_follows_the_tolerance(lab, order, most, decade):
    """A method of order p that keeps the error of each step gives 10^(p/(p+1)) a decade: 5.6 and 6.8."""

    def run(rtol, order=order):
        return lab.case(numerics__mesh="coarse", numerics__rtol=rtol, numerics__order=order, **BARE).T_block

    true = run(1e-8, 5)
    errors = [np.sqrt(np.square(run(rtol) - true).mean()) for rtol in (1e-3, 1e-4, 1e-5)]
    print("time errors, K", errors)
    for rtol, error in zip((1e-3, 1e-4, 1e-5), errors, strict=True):
        lab.check(
            f"time, rtol = {rtol:g}: rms error over rtol times the largest rise", error / rtol / np.ptp(true), most
        )
    assert errors[0] / errors[1] > decade
    assert errors[1] / errors[2] > decade


# --- the benchmark ----------------------------------------------------------------------------------

SLIDE = {
    "block.material": "rubber", "road.material": "stone", "road.depth": 0.01, "road.upstream": 0.005,
    "road.downstream": 0.01, "contact.pressure": 1e6, "contact.spot_fraction": 1.0, "contact.alpha": 2e5,
    "contact.heat_split": 0.5, "contact.lane_widening": 0.0, "friction.volumetric_share": 0.5, "friction.depth": 1e-4,
    "ambient.convection": 20.0, "effects": ["holder_sink"], "holder_sink.coefficient": 20.0,
    "materials.rubber.conductivity": 0.23, "materials.rubber.density": 1200.0, "materials.rubber.heat_capacity": 1700.0,
    "materials.stone.conductivity": 1.2, "materials.stone.density": 2400.0, "materials.stone.heat_capacity": 900.0,
}  # fmt: skip


@pytest.mark.parametrize(
    ("cells", "first", "most", "along", "middle"),
    [
        ([60, 30, 60], (4e-5, 4e-5, 5e-6, 5e-6), 12000, 0.1, 0.07),
        ([30, 16, 51], (1.56e-4, 6.1e-4, 1.3e-5, 1.5e-5), 2500, 0.1, 0.12),
        ([24, 16, 26], (1e-4, 1e-4, 1e-5, 1e-5), 1500, 0.8, 0.35),
        ([14, 9, 18], (3e-4, 1.5e-3, 3e-5, 1.6e-5), 500, 1.0, 0.45),
    ],
)
def test_slide2d_agrees_with_the_reference(lab, cells, first, most, along, middle):
    reference = json.loads((Path(__file__).parents[1] / "data" / "slide2d_reference.json").read_text(encoding="utf-8"))
    names = ("first_x", "last_x", "first_block", "first_road")
    mesh = {f"numerics.{k}": v for k, v in zip(names, first, strict=True)} | {
        "numerics.cells": cells,
        "numerics.rtol": 1e-3,
    }
    run = lab.case(**SLIDE, **mesh)
    assert run.mesh.n_cells <= most
    rise = run.T_block - 20.0
    line = PchipInterpolator(run.x, rise[-1])(np.array(reference["x"])) - reference["TR_rise"]
    history = PchipInterpolator(run.time, PchipInterpolator(run.x, rise, axis=1)(L / 2))(reference["t_mid"])
    scale = 100 / reference["max_rise_TR"]
    label = f"slide2d {run.mesh.n_cells} cells"
    lab.check(f"{label}, along x at 35 s, %", scale * np.abs(line).max(), along)
    lab.check(f"{label}, middle in time, %", scale * np.abs(history - reference["TR_mid_rise"]).max(), middle)


def test_an_order_that_cannot_be_told_is_none_and_errors_have_their_unit():
    found = Convergence([1, 2, 4], [[0.0] * 4] * 3, [1.0, 2.0, 2.0, float("nan")], [0.1] * 4, [0.2] * 4, 0.1)
    lines = str(found).splitlines()
    assert lines[1].startswith("  rise at the leading edge, K ")
    assert "order     -" in lines[4]
    assert "nan" not in str(found)


# --- the integrator's memory ------------------------------------------------------------------------


class Decay:
    """dy/dt = -y."""

    def rate(self, t, y, out):
        out[:] = -y

    def linearise(self, t, y, gamma):
        self.gamma = gamma
        return self

    def apply_jacobian(self, v, out):
        out[:] = -v

    def solve(self, r, z):
        z[:] = r / (1.0 + self.gamma)


def decayed(binding, size=4):
    """Every step of a start, to the bit."""
    solver = cvode.BdfIntegrator(binding, Decay(), cvode.IntegratorSettings(1e-4, 1e-6))
    solver.start(0.0, np.linspace(1.0, 2.0, size), 1.0)
    path = []
    while not path or path[-1][0] < 1.0:
        t, y = solver.step()
        path.append((t, y.tobytes()))
    solver.close()
    return path, solver.calls


@pytest.mark.parametrize("binding", installed_bindings())
def test_a_start_keeps_no_memory_of_the_starts_before(binding):
    """Less than half a vector of the problem's size per start; a CVODE object that is left alone keeps 14 of them."""
    psutil = pytest.importorskip("psutil")
    size, starts = 20_000, 30
    for _ in range(5):
        decayed(binding, size)
    before = psutil.Process().memory_info().rss
    for _ in range(starts):
        decayed(binding, size)
    assert psutil.Process().memory_info().rss - before < 0.5 * 8 * size * starts


@pytest.mark.parametrize("binding", installed_bindings())
def test_a_start_is_the_same_to_the_bit_whether_its_integrator_served_before_or_not(binding):
    cvode._idle_solvers.cache_clear()
    first = decayed(binding)
    assert decayed(binding) == first
    cvode._idle_solvers.cache_clear()
    assert decayed(binding) == first


# --- fronts -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("across", [1, 3])
@pytest.mark.parametrize("speed", [0.1, 5.0])
def test_no_road_is_colder_than_everything_around_where_a_front_passes(lab, speed, across):
    """Nothing here cools below 20 degC; the second-order scheme by itself falls short by 1 to 9 % of the rise."""
    run = lab.case(
        numerics__cells=[14, 8, 10], numerics__across=across, schedule__speed=speed, schedule__distance=0.05,
        output__profiles=30, output__fields=10,
    )  # fmt: skip
    rise = np.max(run.T_spot) - 20.0
    for name in ("T_block", "T_road", "T_wake", "field"):
        lab.check(
            f"fall below 20 degC of {name} over the rise at {speed} m/s", (20.0 - getattr(run, name).min()) / rise, 1e-3
        )
    assert run.energy_imbalance < 1e-12


@pytest.mark.parametrize("diameter", [5e-4, 3e-3, 1e-2])
def test_heat_in_depth_cools_no_face_while_the_first_spots_build_up(lab, diameter):
    """Nothing here cools below 20 degC.  Had the flash of heat in depth grown as the root of time, like that of a flux, the
    road would draw more than there is: 2 to 9 % of the rise."""
    run = lab.case(
        numerics__cells=[10, 7, 8], schedule__distance=0.0075, output__profiles=12, contact__spot_diameter=diameter,
        friction__volumetric_share=0.75,
    )  # fmt: skip
    for name in ("T_block", "T_spot", "T_road"):
        assert getattr(run, name).min() > 20.0 - 1e-3 * (np.max(run.T_spot) - 20.0), name


@pytest.mark.parametrize("across", [1, 3])
def test_bounded_faces_conserve_heat_and_their_derivative_is_exact(across):
    """A random field around zero has many of them; of its heat the bound moves some and loses none."""
    given = {"numerics.cells": [14, 8, 10], "numerics.across": across, "schedule.distance": 0.05, "schedule.speed": 5.0}
    scene = load_case(Path(__file__).parents[2] / "cases" / "uniform_pressure", given).scene
    b, rng = HeatBalance(scene), np.random.default_rng(5)
    system, y, v = PhaseSystem(b, scene.schedule.phases[0]), np.zeros(b.size), np.zeros(b.size)
    y[: b.n], v[: b.n] = rng.normal(size=b.n), rng.normal(size=b.n)
    now = system.law_context(1e-3)
    bounded = system.solid.limit_undershoots(
        y[: b.n],
        system.incoming_enthalpy(system.incoming_rise(now)),
        b.advection_coefficient(now),
        system.undershoot_floor,
    )
    assert len(bounded.faces) > 0.1 * b.n / 2
    moved, step, product = np.zeros(b.n), np.zeros(b.size, dtype=complex), np.zeros(b.size)
    bounded.add_rate(moved)
    heat = np.outer(b.capacity, scene.mesh.share).ravel() * moved
    assert abs(heat.sum()) < 1e-12 * np.abs(heat).sum()
    system.linearise(1e-3, y, 1e-2).apply_jacobian(v, product)
    system.rate(1e-3, y + 1j * COMPLEX_STEP * v, step)
    np.testing.assert_allclose(
        product[: b.n], step.imag[: b.n] / COMPLEX_STEP, rtol=1e-9, atol=1e-9 * np.abs(product).max()
    )
