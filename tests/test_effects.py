"""The battery that every effect of the catalogue passes; a new file in effects/ gets it for free."""

from __future__ import annotations

import ast
import inspect
import math
import re
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import flashtemp
from flashtemp import load
from flashtemp.errors import SolverFailure
from flashtemp.physics.effect import Effect, Param, catalogue
from flashtemp.solver.balance import Balance
from flashtemp.solver.march import march
from flashtemp.solver.system import Stage

PACKAGE = Path(flashtemp.__file__).parent
EVERY = sorted(catalogue())
OPTIONAL = [n for n in EVERY if not catalogue()[n].base]
BASE = [n for n in EVERY if catalogue()[n].base]
HEATING = [n for n in OPTIONAL if catalogue()[n].heat is not Effect.heat]  # the others act on the picture only
NEEDS = {"pressure_profile": {"pressure_profile.profile": [[0.0, 1.5], [0.025, 0.5]]}}
SHAPES = {  # of the case: how the block waits, and whether it has a width
    "lifted": {},
    "resting": {"schedule.lifted": False},
    "3D": {"numerics.across": 3, "ambient.road_sides": 30.0},
}
WITH = {"wear": ("edge_pressure",), "evaporation": ("track_memory",)}
ARRAYS = (
    "time",
    "repetition",
    "slid",
    "T_block",
    "T_spot",
    "T_road",
    "pressure",
    "friction",
    "worn",
    "tilt",
    "field",
    "frames",
)
SMALL = {  # a thin block, so that its back is reached; two repetitions of 0.2 m, longer than one lap together
    "block.height": 0.002,
    "road.track_length": 0.15,
    "schedule.distance": 0.2,
    "schedule.repetitions": 2,
    "schedule.wait": 1.0,
    "numerics.cells": [8, 8, 8],
    "output.profiles": 6,
}
RICH = {  # every base effect acts
    "contact.alpha": 2e4,
    "contact.heat_split": 0.7,
    "contact.spot_exponent": 0.7,
    "contact.gap_coefficient": 30.0,
    "friction.volumetric_share": 0.3,
}


@pytest.fixture(scope="session")
def empty(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("case") / "case.toml"
    file.write_text("effects = []\n")
    return file


@pytest.fixture(scope="session")
def case(empty):
    def make(*effects, **given):
        needs = {k: v for n in effects for k, v in NEEDS.get(n, {}).items()}
        return load(empty, SMALL | {"effects": list(effects)} | needs | given.pop("values", {}))

    return make


@pytest.fixture(scope="session")
def run(case):
    @cache
    def go(effects: tuple, values: tuple = ()):
        made = case(*effects, values=dict(values))
        return march(made.scene, made.settings)

    return go


def offs(name: str, section: str | None = None) -> tuple:
    """All parameters of an effect that can be off, off."""
    declared = catalogue()[name].params()
    return tuple((f"{section or name}.{k}", p.off) for k, p in declared.items() if p.off is not None)


def differences(a, b) -> list[str]:
    """Names of the arrays in which two runs differ by a bit."""
    return [k for k in ARRAYS if not np.array_equal(getattr(a, k), getattr(b, k), equal_nan=True)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", HEATING)
def test_off_is_the_base_bit_for_bit(run, name, shape):
    wait = tuple(SHAPES[shape].items())
    assert differences(run((name,), wait + offs(name)), run((), wait)) == []


@pytest.mark.parametrize("name", HEATING)
def test_acts_at_its_defaults(run, name):
    if name == "pressure_roll":  # what leans sideways has a width
        shape = tuple(SHAPES["3D"].items())
        assert np.ptp(run((name,), shape).field[-1] - run((), shape).field[-1]) > 1.0
        return
    on, base = run((*WITH.get(name, ()), name)), run(WITH.get(name, ()))
    rise = [np.interp(0.39, r.slid[r.sliding], r.T_spot[r.sliding].max(axis=1)) for r in (on, base)]
    assert abs(rise[0] - rise[1]) > 1e-3


@pytest.mark.parametrize("name", BASE)
def test_base_effect_differs_from_its_off(run, name):
    """Defaults that are off already are compared with a value that is not."""
    effect = catalogue()[name]
    for key, off in offs(name, effect.section):
        param = effect.params()[key.split(".")[1]]
        on = param.value if param.value != off else {math.inf: 2e4}.get(off, min(param.high, 100.0) / 2)
        tilted = ("pressure_tilt",)  # the exponent of phi needs a pressure that is not the reference
        assert differences(run(tilted, ((key, off),)), run(tilted, ((key, on),))), key


def test_meaning_of_off_in_the_base(run):
    """What the base is without each of its effects, for heat released at the interface."""
    cold = run((), (("friction.mu", 0.0),))
    assert np.all(cold.T_block == cold.ambient_degC)
    assert np.all(cold.field == cold.ambient_degC)
    mild = run((), (("contact.flash_factor", 0.0),))
    np.testing.assert_allclose(mild.T_spot[mild.sliding], mild.T_block[mild.sliding], rtol=0, atol=1e-9)
    closed = run(())  # alpha = inf: no jump inside the spots
    np.testing.assert_allclose(closed.T_spot[closed.sliding], closed.T_road[closed.sliding], rtol=0, atol=1e-9)
    still = run((), (("ambient.convection", 0.0),))
    assert still.energy["air"][-1] == 0.0
    assert closed.energy["air"][-1] < 0.0
    narrow = run((), (("contact.lane_widening", 0.0),))
    last = closed.last
    assert np.mean(narrow.T_road[last]) > np.mean(closed.T_road[last]) + 0.5


# --- the exact Jacobian --------------------------------------------------------------------------
def smooth(mesh, rng) -> np.ndarray:
    """A smooth random temperature rise (cells,), 1-15 K."""
    x, y, z = mesh.place(np.arange(mesh.n_cells))
    x, z = x / 0.025 + 10.0 * y, z / 2e-3
    a, b = rng.uniform(0, 2 * np.pi, 2)
    return 8 + 4 * np.cos(2 * x + a) * np.exp(-np.abs(z)) + 3 * np.sin(3 * x + z + b)


def stages(case, name, shape, **given):
    """Balance with a stage in the middle of sliding and of waiting, at a random smooth state."""
    values = RICH | SHAPES[shape] | given
    if name == "heat_depth":
        values |= {"friction.volumetric_share": 0.0}
    scene = case(*([name] if name else []), values=values).scene
    balance = Balance(scene)
    carried = np.linspace(0.1, 1.0, scene.mesh.n_road * scene.mesh.n_across)
    inflow = (lambda now: carried) if balance.laws.has("road.inflow") else None
    phases = scene.schedule.phases
    for phase in (next(p for p in phases if p.sliding), next(p for p in phases if not p.sliding)):
        rng = np.random.default_rng(7)
        y = np.zeros(balance.size)
        y[: balance.n] = balance.enthalpy(smooth(scene.mesh, rng))
        if balance.abrades:
            y[balance.worn] = 3 * np.cos(
                3 * scene.mesh.column_x / 0.025 + 20 * scene.mesh.column_y
            )  # the pressure varies by 15 %
        yield balance, Stage(balance, phase, inflow), 0.5 * (phase.begin + phase.end), y, rng


def direction(balance, cells, rng) -> np.ndarray:
    """A direction of the state: cells as given and, where the worn depth acts, random depths."""
    v = np.concatenate([cells, np.zeros(balance.size - balance.n)])
    if balance.abrades:
        v[balance.worn] = rng.normal(size=balance.worn.stop - balance.n)
    return v


def parts(balance) -> tuple[slice, slice, slice]:
    """Cells, worn depth and ledger of a state."""
    return slice(0, balance.n), balance.worn, balance.books


def product(balance, stage, t, y, v) -> np.ndarray:
    """J v by one complex step."""
    out = np.zeros(balance.size, dtype=complex)
    stage.rate(t, y + 1e-30j * v, out)
    return out.imag / 1e-30


def heat_weights(balance, share) -> np.ndarray:
    """w with w . y = heat in block and phi x lanes, minus all that the ledger says came in."""
    w = np.zeros(balance.size)
    mesh = balance.scene.mesh
    w[: balance.n] = np.outer(balance.capacity, mesh.share).ravel()
    w[mesh.everywhere(mesh.road)] *= share
    signs = {"friction": -1.0, "into_road": 1.0, "lane_in": -share, "lane_out": share, "lane_air": -share}
    for entry, i in balance.entry.items():
        w[i] = signs.get(entry, -1.0)
    return w


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["", *HEATING], ids=["base", *HEATING])
def test_jacobian_is_exact(case, name, shape):
    for balance, stage, t, y, rng in stages(case, name, shape):
        for v in (smooth(balance.scene.mesh, rng) - 8, rng.normal(size=balance.n)):
            v = direction(balance, v, rng)
            J = product(balance, stage, t, y, v)
            up, down = np.zeros(balance.size), np.zeros(balance.size)
            stage.rate(t, y + 1e-3 * v, up)
            stage.rate(t, y - 1e-3 * v, down)
            for part in parts(balance):
                noise = 1e-9 * np.abs(J[part]).max()
                np.testing.assert_allclose(J[part], ((up - down) / 2e-3)[part], rtol=1e-6, atol=noise)


@pytest.mark.parametrize(
    "names", [("friction_softening", "friction_moment", "wear"), ("spot_saturation", "wear", "edge_pressure")]
)
def test_jacobian_is_exact_where_effects_meet(case, names):
    """Friction tilts the holder and answers to the heat of the tilt; spots answer to the pressure that wear leaves."""
    scene = case(*names, values=RICH).scene
    balance, rng = Balance(scene), np.random.default_rng(3)
    stage = Stage(balance, scene.schedule.phases[0])
    y = balance.initial()
    y[: balance.n] = smooth(scene.mesh, rng)
    y[balance.worn] = 3 * np.cos(3 * scene.mesh.column_x / 0.025 + 20 * scene.mesh.column_y)
    v = direction(balance, smooth(scene.mesh, rng) - 8, rng)
    J, up, down = product(balance, stage, 1.0, y, v), np.zeros(balance.size), np.zeros(balance.size)
    stage.rate(1.0, y + 1e-3 * v, up)
    stage.rate(1.0, y - 1e-3 * v, down)
    for part in parts(balance):
        np.testing.assert_allclose(J[part], ((up - down) / 2e-3)[part], rtol=1e-6, atol=1e-8 * np.abs(J[part]).max())


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["", *HEATING], ids=["base", *HEATING])
def test_linearisation_used_by_the_solver(case, name, shape):
    """`times` is J v, but for the slope of k(T): that by little."""
    for balance, stage, t, y, rng in stages(case, name, shape):
        bent = balance.nonlinear_conductivity
        bent |= balance.abrades  # lanes and gaps follow the mean contact fraction, which is left out
        v = direction(balance, smooth(balance.scene.mesh, rng) - 8, rng)
        J, out = product(balance, stage, t, y, v), np.zeros(balance.size)
        stage.setup(t, y, 1e-2)
        stage.times(v, out)
        for part in parts(balance):
            assert np.linalg.norm((out - J)[part]) <= (0.03 if bent else 1e-10) * np.linalg.norm(J[part])


def test_linearisation_of_abrasion_is_exact_where_spots_are_fixed(case):
    fixed = {"contact.spot_exponent": 0.0, "contact.gap_coefficient": 0.0}
    for balance, stage, t, y, rng in stages(case, "wear", "lifted", **fixed):
        v = direction(balance, smooth(balance.scene.mesh, rng) - 8, rng)
        J, out = product(balance, stage, t, y, v), np.zeros(balance.size)
        stage.setup(t, y, 1e-2)
        stage.times(v, out)
        for part in parts(balance):
            assert np.linalg.norm((out - J)[part]) <= 1e-10 * np.linalg.norm(J[part])


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["", *HEATING], ids=["base", *HEATING])
def test_every_linear_step_conserves_heat(case, name, shape):
    """The rate, its linearisation and the preconditioner: none makes or loses heat, whatever they approximate."""
    for balance, stage, t, y, rng in stages(case, name, shape):
        out, r = np.zeros(balance.size), rng.normal(size=balance.size)
        w = heat_weights(balance, balance.share)
        stage.rate(t, y, out)
        assert abs(w @ out) <= 1e-13 * np.abs(w * out).sum()
        for gamma in (1e-4, 1e-2, 1.0):
            stage.setup(t, y, gamma)
            stage.times(r, out)
            assert abs(w @ out) <= 1e-13 * np.abs(w * out).sum()
            stage.solve(r, out)
            assert abs(w @ out - w @ r) <= 1e-13 * np.abs(w * r).sum()


@pytest.mark.parametrize("name", HEATING)
def test_energy_audit(run, name):
    for shape in SHAPES.values():
        assert run((name,), tuple(shape.items())).energy_imbalance < 1e-10


@pytest.mark.parametrize("shape", SHAPES)
def test_energy_audit_of_all_effects_together(run, shape):
    values = RICH | SHAPES[shape] | {"friction.volumetric_share": 0.0}
    assert run(tuple(HEATING), tuple(values.items())).energy_imbalance < 1e-10


def test_runaway_is_explained(case):
    """Friction that rises with temperature without bound: no steady contact, and the message says where."""
    made = case("friction_softening", values={"friction_softening.b": -0.05, "friction.mu": 2.0})
    with pytest.raises(SolverFailure, match=r"t = .* cell x = .* largest effect: \w+"):
        march(made.scene, made.settings)


# --- what the files declare ------------------------------------------------------------------------
@pytest.mark.parametrize("name", EVERY)
def test_declaration(name):
    effect = catalogue()[name]
    assert effect.cause
    assert effect.source
    assert effect.tells
    assert all(isinstance(t, str) and t for t in effect.tells)
    assert isinstance(effect.tells, tuple)
    assert effect.__doc__
    params = effect.params()
    for key, p in params.items():
        assert isinstance(p, Param)
        assert p.unit, f"{key} has no unit"
        assert p.about, f"{key} is not explained"
        if p.value is not None and "number" in p.kinds:
            assert p.fault(p.value) is None, f"default of {key} is out of bounds"
        if p.off is not None:
            assert p.fault(p.off) is None, f"off of {key} is out of bounds"
    assert any(p.off is not None for p in params.values()), "no parameter can switch the effect off"
    if effect.base:
        assert effect.section, "a base effect names its table"


@pytest.mark.parametrize("name", EVERY)
def test_file(name):
    module = inspect.getmodule(catalogue()[name])
    text = Path(module.__file__).read_text()
    assert ">>> " in module.__doc__, "no doctest"
    assert len(text.splitlines()) < 120
    effects = [c for c in vars(module).values() if inspect.isclass(c) and c.__module__ == module.__name__]
    assert [c for c in effects if issubclass(c, Effect)] == [catalogue()[name]]
    allowed = sys.stdlib_module_names | {"numpy", "scipy"}
    for node in ast.walk(ast.parse(text)):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        names += [node.module] if isinstance(node, ast.ImportFrom) else []
        for found in names:
            own = found == "flashtemp.errors" or found.split(".")[:2] == ["flashtemp", "physics"]
            assert own or found.split(".")[0] in allowed, f"imports {found}"


def test_every_file_is_in_the_catalogue():
    files = {f.stem for f in (PACKAGE / "effects").glob("*.py")} - {"__init__"}
    assert files == set(EVERY)


@pytest.mark.parametrize("file", sorted(PACKAGE.glob("*.py")), ids=lambda f: f.stem)
def test_engine_names_no_effect(file):
    words = set(re.findall(r"\w+", file.read_text()))
    assert words & set(OPTIONAL) == set()
