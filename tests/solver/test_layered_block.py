"""Blocks made of layers with contacts between them: against composite walls in closed form, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from flashtemp.camera.prediction.sensor_observation import sensor_temperatures
from flashtemp.camera.sensors import positions_from_rows
from flashtemp.comparison import campaign
from flashtemp.comparison.compare import compare
from flashtemp.errors import BadInput
from flashtemp.model import priors
from flashtemp.model.case import load_case
from flashtemp.runs.results import vtk
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.perturbed_run import Perturbation
from flashtemp.solver.sensitivity import run_with_sensitivities
from flashtemp.solver.system import PhaseSystem
from flashtemp.solver.time_integration import integrate_schedule
from flashtemp.viz.run import case_sketch

STACK = (("disc", 15.0, 3.9e6, 0.002), ("glue", 0.2, 1.8e6, 2e-4), ("board", 1.1, 2.0e6, 0.006))  # W/mK, J/m3K, m
CONTACT = (4e-4, 1.5e-3)  # m2K/W
HOT, COLD = 120.0, 20.0


def text(stack=STACK, contact=CONTACT, effects=("driven_faces",), more="", back=True, schedule="alone = 3000.0"):
    """A case of layers between a hot face and a cold back (insulated without `back`), alone."""
    named = ", ".join(f'"{e}"' for e in effects)
    out = f"effects = [{named}]\n"
    for name, k, rc, _ in stack:
        out += f"[materials.{name}]\nconductivity = {k}\ndensity = 1000.0\nheat_capacity = {rc / 1000.0}\n"
    for (name, *_, thickness), R in zip(stack, (*contact, 0.0), strict=True):
        out += f'[layers.{name}]\nmaterial = "{name}"\nthickness = {thickness}\ncontact_resistance = {R}\n'
    return (
        out
        + f"""
[block]
length = 0.02
width = 0.01
[road]
depth = 0.001
upstream = 0.0
downstream = 0.0
[schedule]
{schedule}
[ambient]
convection = 0.0
{f"[driven_faces]{chr(10)}face = [[0.0, {HOT}]]" if effects else ""}
{f"back = [[0.0, {COLD}]]" if back and effects else ""}
[numerics]
cells = [3, 24, 3]
first_x = 0.005
last_x = 0.005
first_block = 1e-4
"""
        + more
    )


def case(folder, given=None, **how):
    (folder / "case.toml").write_text(text(**how))
    return load_case(folder / "case.toml", given)


def up(run):
    """Heights (n,) m and temperatures (n,) degC of the last field, one line of the middle plane."""
    mesh = run.mesh
    cells = mesh.everywhere(mesh.block)[1, :, mesh.n_across // 2]
    return 0.5 * (mesh.height[1:] + mesh.height[:-1]), run.field[-1][cells]


# --- against closed forms -------------------------------------------------------------------------------
def wall(z):
    """Steady temperature (n,) degC of the composite wall: the flux through resistances in series."""
    flux = (HOT - COLD) / (sum(t / k for _, k, _, t in STACK) + sum(CONTACT))
    T, low, out = HOT, 0.0, np.empty_like(z)
    for (_, k, _, thick), R in zip(STACK, (*CONTACT, 0.0), strict=True):
        here = (z >= low) & (z <= low + thick)
        out[here] = T - flux * (z[here] - low) / k
        T, low = T - flux * (thick / k + R), low + thick
    return out


@pytest.mark.parametrize("across", [1, 3])
def test_a_composite_wall_with_contacts_is_exact_when_steady(tmp_path, lab, across):
    """Linear in every layer, a jump at every contact: half cells in series are exact, what is left is float32."""
    run = integrate_schedule(*parts(case(tmp_path, {"numerics.across": across, "numerics.rtol": 1e-7})))
    z, T = up(run)
    assert len(run.mesh.joints) == 2
    assert abs(run.energy_imbalance) < 1e-13
    lab.check(f"composite wall, {across} planes, K of 100", float(np.abs(T - wall(z)).max()), 3e-5)


def parts(made):
    return made.scene, made.settings


@pytest.mark.parametrize("across", [1, 3])
def test_conductivity_may_change_in_one_layer_alone(tmp_path, lab, across):
    """k = k0 [1 + s (T - T0)] in the board: the integral of k over T gives its flux, the others stay linear."""
    s = 0.004
    more = f'[conductivity_slope]\nblock = {s}\nlayer = "board"\n'
    given = {"numerics.across": across, "numerics.rtol": 1e-6, "numerics.finer": [1, 2, 1]}
    effects = ("driven_faces", "conductivity_slope")
    z, T = up(integrate_schedule(*parts(case(tmp_path, given, effects=effects, more=more))))
    (_, _, _, thick) = STACK[-1]
    before = sum(t / k for _, k, _, t in STACK[:-1]) + sum(CONTACT)

    def potential(T):
        return 1.1 * ((T - 20.0) + 0.5 * s * (T - 20.0) ** 2)

    top = brentq(lambda T: potential(T) / thick - (HOT - T) / before, COLD, HOT)  # board's lower face
    flux = (HOT - top) / before
    low = sum(t for *_, t in STACK[:-1])
    left = potential(top) - flux * (z[z > low] - low)
    exact = 20.0 + (np.sqrt(1.0 + 2.0 * s * left / 1.1) - 1.0) / s
    lab.check(f"board with k(T), {across} planes, K", float(np.abs(T[z > low] - exact).max()), 0.02)
    assert abs(T[0] - (HOT - flux * z[0] / 15.0)) < 0.02


TWO, R2 = (("disc", 2.0, 3e6, 0.004), ("board", 0.3, 1.5e6, 0.006)), (2e-3,)


def inverted(transform, t, terms=32):
    """f(t) of a Laplace transform by Talbot's contour with Weideman's parameters: shares nothing with finite volumes."""
    theta = (2.0 * np.arange(terms) + 1.0) * np.pi / terms - np.pi
    s = terms / t * (0.5017 * theta / np.tan(0.6407 * theta) - 0.6122 + 0.2645j * theta)
    slope = (
        terms / t * (0.5017 / np.tan(0.6407 * theta) - 0.5017 * 0.6407 * theta / np.sin(0.6407 * theta) ** 2 + 0.2645j)
    )
    return float(np.real(np.sum(np.exp(s * t) * np.array([transform(a) for a in s]) * slope) / (1j * terms)))


def slab(z, t):
    """Rise (n,) over that of the face, stepped at t = 0, of two layers and their contact; the back is insulated."""
    (_, k1, c1, L1), (_, k2, c2, L2) = TWO

    def at(height, p):
        q1, q2 = np.sqrt(p * c1 / k1), np.sqrt(p * c2 / k2)
        T, flux = np.cosh(q2 * L2), k2 * q2 * np.sinh(q2 * L2)  # at the joint, per rise of the back
        below = T + R2[0] * flux
        face = below * np.cosh(q1 * L1) + flux * np.sinh(q1 * L1) / (k1 * q1)
        if height > L1:
            return np.cosh(q2 * (L1 + L2 - height)) / face / p
        y = L1 - height
        return (below * np.cosh(q1 * y) + flux * np.sinh(q1 * y) / (k1 * q1)) / face / p

    return np.array([inverted(lambda p, height=height: at(height, p), t) for height in z])


def test_the_inversion_gives_a_slab_of_one_material_its_series():
    """The closed form itself: with one material and no contact it is the series of a slab."""
    z, t, L = 0.3, 0.2, 1.0
    n = np.arange(60) + 0.5
    series = 1.0 - np.sum(2.0 * np.sin(n * np.pi * z) / (n * np.pi) * np.exp(-((n * np.pi) ** 2) * t))
    found = inverted(lambda p: np.cosh(np.sqrt(p) * (L - z)) / np.cosh(np.sqrt(p) * L) / p, t)
    assert found == pytest.approx(series, abs=1e-10)


def test_two_layers_that_warm_follow_the_laplace_transform_in_second_order(tmp_path, lab):
    """Face stepped by 100 K: at 10 s errors fall by 4 with the cells' size, to 5 mK; energy to rounding."""
    errors = []
    for mesh in (1.0, 2.0, 4.0):
        given = {"numerics.mesh": mesh, "numerics.finer": [1 / mesh, 1, 1 / mesh], "numerics.rtol": 1e-8}
        given |= {"schedule.alone": 10.0, "numerics.cells": [3, 32, 3], "numerics.first_block": 2e-4}
        made = case(tmp_path, given, stack=TWO, contact=R2, back=False)
        run = integrate_schedule(*parts(made))
        z, T = up(run)
        errors.append(float(np.abs(T - COLD - (HOT - COLD) * slab(z, 10.0)).max()))
        assert abs(run.energy_imbalance) < 1e-13
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    assert order == pytest.approx(2.0, abs=0.25), errors
    lab.check("two layers and their contact after 10 s, K of 100", errors[-1], 0.01)


# --- the rest of the solver -----------------------------------------------------------------------------
SLIDES = {"schedule": "distance = 0.2\nspeed = 0.1", "effects": ()}
SLIDING = {
    "numerics.first_block": 4e-6,
    "numerics.cells": [12, 16, 10], "numerics.first_x": 2e-4, "numerics.last_x": 2e-4, "ambient.convection": 20.0,
    "contact.pressure": 1e5,
}  # fmt: skip


@pytest.mark.parametrize("across", [1, 4])
def test_a_sliding_block_of_layers_conserves_heat(tmp_path, across):
    """Rubber on a plate with a contact between, in 2D and 3D: the ledger closes to rounding."""
    stack = (("rubber", 0.25, 2.04e6, 0.003), ("plate", 45.0, 3.7e6, 0.004))
    run = integrate_schedule(
        *parts(case(tmp_path, SLIDING | {"numerics.across": across}, stack=stack, contact=(1e-4,), **SLIDES))
    )
    assert abs(run.energy_imbalance) < 1e-13
    assert run.T_block[-1].max() > 22.0


@pytest.mark.parametrize("across", [1, 4])
def test_layers_of_one_material_without_contact_are_one_block(tmp_path, across):
    """Only the cells lie differently: faces agree within what meshes and steps differ by, 1 % of the rise."""
    given = SLIDING | {"numerics.across": across, "numerics.rtol": 1e-5}
    stack = (("rubber", 0.25, 2.04e6, 0.002), ("same", 0.25, 2.04e6, 0.005))
    whole = case(tmp_path, given, stack=stack, contact=(0.0,), **SLIDES)
    plain = (tmp_path / "case.toml").read_text().split("[layers.rubber]")
    (tmp_path / "plain.toml").write_text(
        plain[0] + '[block]\nmaterial = "rubber"\nheight = 0.007' + plain[1].split("[block]")[1]
    )
    one = integrate_schedule(*parts(load_case(tmp_path / "plain.toml", given))).T_block[-1] - 20.0
    many = integrate_schedule(*parts(whole)).T_block[-1] - 20.0
    assert np.abs(many - one).max() < 0.01 * one.max()


def test_the_linearisation_knows_the_contacts(tmp_path):
    """J v of the linearised balance is the difference of rates: all is linear here."""
    b = HeatBalance(case(tmp_path).scene)
    system = PhaseSystem(b, b.scene.schedule.phases[0])
    rng = np.random.default_rng(3)
    y, v = np.zeros(b.size), np.zeros(b.size)
    y[: b.n], v[: b.n] = rng.normal(size=b.n), rng.normal(size=b.n)
    rates = np.zeros((2, b.size))
    system.rate(1.0, y, rates[0])
    system.rate(1.0, y + v, rates[1])
    out, z = np.zeros(b.size), np.zeros(b.size)
    at = system.linearise(1.0, y, 0.7)
    at.apply_jacobian(v, out)
    assert out[: b.n] == pytest.approx(np.diff(rates, axis=0)[0, : b.n], abs=1e-9 * np.abs(out).max())
    at.solve(v, z)  # P^-1 hands on no more heat than it is given
    held = b.capacity * system.solid.lines.weight
    booked = sum(b.ledger_weight(name) * z[i] for name, i in b.ledger_index.items())
    assert held @ z[: b.n] - booked == pytest.approx(held @ v[: b.n], rel=1e-11)


@pytest.mark.parametrize(
    ("key", "value"),
    [("layers.disc.contact_resistance", 4e-4), ("layers.board.thickness", 0.006), ("materials.glue.conductivity", 0.2)],
)
def test_traces_of_layers_are_differences_of_runs(tmp_path, key, value):
    """A neighbour beside the run gives what two whole runs differ by, within 2 %."""
    own = {"schedule.alone": 30.0, "numerics.rtol": 1e-7} | {f"layers.{n}.cells": 8 for n, *_ in STACK}
    made = case(tmp_path, own, back=False)
    step = 0.01 * value
    moved = made.with_values({key: value + step})
    near = run_with_sensitivities(
        made.scene, made.settings, {key: Perturbation(moved.scene, step, is_stretched=True)}, at=(30.0,)
    )

    def back(run):
        return up(run)[1][-1]

    exact = (back(integrate_schedule(*parts(moved))) - back(integrate_schedule(*parts(made)))) / step
    assert abs(exact) * step > 2e-3  # far above float32
    assert near.derivative_of(back, key) == pytest.approx(exact, rel=0.02)


def test_a_thermocouple_reads_its_own_side_of_a_contact(tmp_path):
    """No spline runs over the jump; a bead at the joint is in the layer nearer the face."""
    run = integrate_schedule(*parts(case(tmp_path)))
    flux = (HOT - COLD) / (sum(t / k for _, k, _, t in STACK) + sum(CONTACT))
    below = HOT - flux * 0.002 / 15.0
    places = positions_from_rows([{"x": 0.01, "z": z} for z in (0.002, 0.0020001, 0.0001, 0.0075)])
    found = sensor_temperatures(run, places, run.time[-1:])[0]
    above = below - flux * CONTACT[0]
    inside = wall(np.array([0.0001, 0.0075]))
    assert found == pytest.approx([below, above, *inside], abs=1e-2)
    assert above < below - 4.0


def test_heat_flux_in_the_file_for_paraview_is_even_through_the_wall(tmp_path):
    run = integrate_schedule(*parts(case(tmp_path)))
    mesh, body = run.mesh, vtk.body_grids(run)["block"]
    flux = body.heat_flux(run.field[-1][body.cells]).reshape(mesh.last - mesh.first, -1, 3)[..., 2]
    even = (HOT - COLD) / (sum(t / k for _, k, _, t in STACK) + sum(CONTACT))
    assert flux == pytest.approx(np.full_like(flux, even), rel=5e-3)


# --- what a case says -----------------------------------------------------------------------------------
def test_a_case_of_layers_goes_through_its_file_and_back(tmp_path):
    """Height and material follow from layers; a number of a layer is a key like others."""
    made = case(tmp_path, {"layers.disc.thickness": "3 mm"})
    (tmp_path / "again.toml").write_text(made.toml())
    again = load_case(tmp_path / "again.toml", {"layers.glue.thickness": 3e-4})
    assert made["block.height"] == pytest.approx(0.0092)
    assert again["block.height"] == pytest.approx(0.0093)
    assert again.scene.block.conductivity == 15.0
    assert "layer 'disc', 3 mm, 0.0004 m2K/W to 'glue'" in str(again.scene)
    known, _ = priors.find_uncertain_inputs(priors.expand_materials(again))
    keys = {i.key for i in known}
    assert {"layers.disc.contact_resistance", "layers.board.thickness", "materials.glue.density"} <= keys
    assert "block.height" not in keys


def test_the_sketch_shows_the_layers(tmp_path):
    figure = case_sketch.draw(case(tmp_path))
    said = {t.get_text() for t in figure.axes[0].texts}
    assert {"disc", "glue", "board"} <= said


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"block.height": 0.02}, "block.height (command line): 0.02 m, but the layers add up to 0.0082 m"),
        ({"block.material": "granite"}, "block.material (command line): 'granite' in addition to layers; leave it out"),
        (
            {"layers.board.contact_resistance": 1e-3},
            "no layer is above 'board'; give 0, or add the body behind it as a layer",
        ),
        (
            {"layers.glue.material": "glu"},
            "layers.glue.material (command line): no material 'glu'; did you mean 'glue'",
        ),
        ({"layers.glue.thickness": -1e-4}, "layers.glue.thickness (command line): -0.0001; give a number"),
        (
            {"layers.glue.thicknes": 1e-4},
            "layers.glue.thicknes (command line): unknown key; did you mean 'layers.glue.thickness'",
        ),
        ({"layers.top.material": "glue"}, "thickness is missing; give it in m"),
        ({"layers": 3}, "layers (command line): 3; write [layers.NAME] and its keys below it"),
        ({"layers.board.thickness": 1.0}, "add up to 1.0022 m; give 0.0001 to 1 m in total"),
        (
            {"effects": ["internal_heat"]},
            "'internal_heat' assumes a block of one material; leave it out, or the layers",
        ),
        (
            {"effects": ["conductivity_slope"], "conductivity_slope.layer": "bord"},
            "conductivity_slope.layer (command line): the block has no layer 'bord'; did you mean 'board'",
        ),
    ],
)
def test_layers_that_cannot_be_are_refused_in_one_line(tmp_path, given, said):
    with pytest.raises(BadInput) as fault:
        case(tmp_path, given)
    assert any(said in line for line in fault.value.lines), fault.value.lines
    assert all("\n" not in line for line in fault.value.lines)


def test_a_camera_on_the_side_wall_of_layers_is_refused(tmp_path, recorded_side):
    case(tmp_path)
    recorded_side.save(tmp_path / "side.nc")
    (tmp_path / "campaign.toml").write_text('case = "case.toml"\n[[recording]]\nfile = "side.nc"\n')
    with pytest.raises(BadInput, match="side wall of a block with layers is not modelled"):
        compare(campaign.load(tmp_path))


@pytest.fixture
def recorded_side():
    from flashtemp.camera.recording import Recording

    u, v = 1e-3 * np.arange(1.0, 19.0), 1e-3 * np.arange(1.0, 8.0)
    T = np.full((2, len(v), len(u)), 21.0)
    return Recording("sidewall", T, np.array([1.0, 2.0]), np.array([1, 1]), u, v, emissivity=0.95)
