"""The battery that every effect of the catalogue passes; a new file in effects/ gets it for free."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import flashtemp
from flashtemp.errors import SolverFailure
from flashtemp.physics.effect import Param, catalogue
from flashtemp.runs.checks.effect_check import camera_checks, heat_balance_checks, law_checks, source_checks
from flashtemp.runs.checks.effect_check.fixtures import ALL_EFFECTS_CASE, CASE_SHAPES, EffectUnderTest, SceneCache
from flashtemp.runs.checks.effect_check.heat_balance_checks import (
    difference_product,
    jacobian_product,
    random_direction,
    sample_states,
    smooth_temperature_rise,
    state_parts,
)
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.system import PhaseSystem

PACKAGE = Path(flashtemp.__file__).parent
EVERY = sorted(catalogue())
OPTIONAL = [n for n in EVERY if not catalogue()[n].base]
BASE = [n for n in EVERY if catalogue()[n].base]
NEEDS = {
    "pressure_profile": {"pressure_profile.profile": [[0.0, 1.5], [0.025, 0.5]]},
    "driven_faces": {"driven_faces.face": [[0.0, 20.0], [10.0, 60.0]]},
}
TRIALS = {n: EffectUnderTest(n, e, NEEDS.get(n, {})) for n, e in catalogue().items()}
HEATING = [n for n in OPTIONAL if TRIALS[n].has_heat]  # the others act on the picture only
WITH = {"wear": ("edge_pressure",), "evaporation": ("track_memory",)}
IN_EVERY_SHAPE = pytest.mark.parametrize("shape", CASE_SHAPES)
EACH_IN_EVERY_SHAPE = pytest.mark.parametrize(
    ("name", "shape"),
    [
        pytest.param(n, s, id=f"{n or 'base'}-{s}", marks=[pytest.mark.long] if n and s != "lifted" else [])
        for n in ("", *HEATING)
        for s in CASE_SHAPES
    ],
)


@pytest.fixture(scope="session")
def bench():
    return SceneCache()


def check_findings(*findings) -> None:
    """Every finding is good; the sentences of those that are not are shown."""
    assert findings
    assert [f"{f.name}: {f.says}" for f in findings if not f.ok] == []


@IN_EVERY_SHAPE
@pytest.mark.parametrize("name", HEATING)
@pytest.mark.sample("[c-h]*-lifted")
def test_off_is_the_base_bit_for_bit(bench, name, shape):
    check_findings(heat_balance_checks.off(bench, TRIALS[name], shape))


@pytest.mark.parametrize("name", HEATING)
@pytest.mark.sample("[!epr]*", "persson_friction", "radiation")
def test_acts_at_its_defaults(bench, name):
    trial = TRIALS[name]
    check_findings(heat_balance_checks.check_default_change(bench, trial))
    if name == "pressure_roll":  # what leans sideways has a width
        shape = CASE_SHAPES["3D"]
        assert np.ptp(bench.run(trial, values=shape).field[-1] - bench.run(None, values=shape).field[-1]) > 1.0
        return
    beside = WITH.get(name, ())
    on, base = bench.run(trial, beside), bench.run(None, beside)
    rise = [np.interp(0.39, r.slid[r.sliding], r.T_spot[r.sliding].max(axis=1)) for r in (on, base)]
    assert abs(rise[0] - rise[1]) > 5e-4


@pytest.mark.parametrize("name", [n for n in OPTIONAL if n not in HEATING])
def test_camera(bench, name):
    check_findings(*camera_checks.check_camera_effect(bench, TRIALS[name]))


@pytest.mark.parametrize("name", BASE)
@pytest.mark.sample("[a-g]*")
def test_base_effect_differs_from_its_off(bench, name):
    """Defaults that are off already are compared with a value that is not."""
    effect = catalogue()[name]
    for key, off in TRIALS[name].off_values().items():
        param = effect.params()[key.split(".")[1]]
        on = param.value if param.value != off else {np.inf: 2e4}.get(off, min(param.high, 100.0) / 2)
        tilted = ("pressure_tilt",)  # the exponent of phi needs a pressure that is not the reference
        without, acting = (bench.run(None, tilted, {key: value}) for value in (off, on))
        assert heat_balance_checks.differing_arrays(without, acting), key


def test_meaning_of_off_in_the_base(bench):
    """What the base is without each of its effects, for heat released at the interface."""
    cold = bench.run(None, values={"friction.mu": 0.0})
    assert np.all(cold.T_block == cold.ambient_degC)
    assert np.all(cold.field == cold.ambient_degC)
    mild = bench.run(None, values={"contact.flash_factor": 0.0})
    np.testing.assert_allclose(mild.T_spot[mild.sliding], mild.T_block[mild.sliding], rtol=0, atol=1e-9)
    closed = bench.run(None)  # alpha = inf: no jump inside the spots
    np.testing.assert_allclose(closed.T_spot[closed.sliding], closed.T_road[closed.sliding], rtol=0, atol=1e-9)
    still = bench.run(None, values={"ambient.convection": 0.0})
    assert still.energy["air"][-1] == 0.0
    assert closed.energy["air"][-1] < 0.0
    narrow = bench.run(None, values={"contact.lane_widening": 0.0})
    last = closed.last_sliding_index
    assert np.mean(narrow.T_road[last]) > np.mean(closed.T_road[last]) + 0.5


# --- laws and their derivatives --------------------------------------------------------------------
@pytest.mark.parametrize("name", [*BASE, *HEATING])
def test_laws_are_sound(bench, name):
    """Finite, repeatable, pointwise, differentiable, and finite where speed, pressure or a parameter is at its end."""
    check_findings(*law_checks.check_laws(bench, TRIALS[name]))


@pytest.mark.parametrize("shape", CASE_SHAPES)
def test_films_of_the_base_change_with_nothing_but_touch_and_air(bench, shape):
    """So a system asks them once while both stay: `System.films`."""
    b = HeatBalance(bench.build_scene(None, values=CASE_SHAPES[shape]))
    assert b.laws.base_films_only
    rng, kept = np.random.default_rng(0), {}
    for phase in b.scene.schedule.phases:
        for t in rng.uniform(phase.begin, phase.end, 3):
            now = b.scene.law_context(phase, t)
            for other in (now, now._replace(speed=2.0 * now.speed + 1.0, pressure=0.5 * now.pressure, repetition=7)):
                assert kept.setdefault((now.touching, now.ambient), b.boundary.film_coefficients(other).site_films) == (
                    b.boundary.film_coefficients(other).site_films
                )


@EACH_IN_EVERY_SHAPE
def test_jacobian_is_exact(bench, name, shape):
    check_findings(heat_balance_checks.jacobian(bench, TRIALS.get(name), shape))


@pytest.mark.parametrize(
    "names",
    [
        ("friction_softening", "friction_moment", "wear"),
        ("spot_saturation", "wear", "edge_pressure"),
        ("debris_film", "wear", "edge_pressure"),
        ("micro_flash", "friction_softening", "wear"),
    ],
)
def test_jacobian_is_exact_where_effects_meet(bench, names):
    """Friction tilts the holder and answers to the heat of the tilt; spots answer to the pressure that wear leaves."""
    scene = bench.build_scene(None, names, ALL_EFFECTS_CASE)
    b, rng = HeatBalance(scene), np.random.default_rng(3)
    system = PhaseSystem(b, scene.schedule.phases[0])
    y = b.initial_state()
    y[: b.n] = smooth_temperature_rise(scene.mesh, rng)
    y[b.worn] = 3 * np.cos(3 * scene.mesh.column_x / 0.025 + 20 * scene.mesh.column_y)
    v = random_direction(b, smooth_temperature_rise(scene.mesh, rng) - 8, rng)
    J, by = jacobian_product(b, system, 1.0, y, v), difference_product(b, system, 1.0, y, v)
    for part in state_parts(b):
        np.testing.assert_allclose(J[part], by[part], rtol=1e-6, atol=1e-8 * np.abs(J[part]).max())


@EACH_IN_EVERY_SHAPE
def test_linearisation_used_by_the_solver(bench, name, shape):
    """`times` is J v, but for the slope of k(T): that by little."""
    check_findings(heat_balance_checks.linearisation(bench, TRIALS.get(name), shape))


BESIDE_WEAR = [(), ("debris_film",), ("micro_flash", "friction_softening"), ("sheared_block", "friction_softening")]


@pytest.mark.parametrize("beside", BESIDE_WEAR, ids="-".join)
def test_linearisation_of_abrasion_is_exact_where_spots_are_fixed(bench, beside):
    fixed = ALL_EFFECTS_CASE | {"contact.spot_exponent": 0.0, "contact.gap_coefficient": 0.0, "wear.temperature": 0.02}
    for b, system, t, y, rng in sample_states(bench.build_scene(TRIALS["wear"], beside, fixed)):
        if "debris_film" in beside:
            y[b.worn] += 6.0  # a film has no negative thickness
        v = random_direction(b, smooth_temperature_rise(b.scene.mesh, rng) - 8, rng)
        J, out = jacobian_product(b, system, t, y, v), np.zeros(b.size)
        system.linearise(t, y, 1e-2).apply_jacobian(v, out)
        for part in state_parts(b):
            assert np.linalg.norm((out - J)[part]) <= 1e-10 * np.linalg.norm(J[part])


@EACH_IN_EVERY_SHAPE
def test_every_linear_step_conserves_heat(bench, name, shape):
    """The rate, its linearisation and the preconditioner: none makes or loses heat, whatever they approximate."""
    check_findings(heat_balance_checks.conservation(bench, TRIALS.get(name), shape))


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n == "resolved_spots" else n for n in HEATING]
)
@pytest.mark.sample(
    "track_memory", "wear", "thermal_expansion", "conductivity_slope", "radiation", "friction_moment", "debris_film"
)
def test_energy_audit(bench, name):
    check_findings(*(heat_balance_checks.energy(bench, TRIALS[name], shape) for shape in CASE_SHAPES))


@pytest.mark.long
@IN_EVERY_SHAPE
def test_energy_audit_of_all_effects_together(bench, shape):
    values = ALL_EFFECTS_CASE | CASE_SHAPES[shape] | {"friction.volumetric_share": 0.0}
    every = {k: v for need in NEEDS.values() for k, v in need.items()}
    assert bench.run(None, HEATING, values | every).energy_imbalance < heat_balance_checks.MAX_HEAT_LEAK


def test_runaway_is_explained(bench):
    """Friction that rises with temperature without bound: no steady contact, and the message says where."""
    with pytest.raises(SolverFailure, match=r"t = .* cell x = .* largest effect: \w+"):
        bench.run(TRIALS["friction_softening"], values={"friction_softening.b": -0.05, "friction.mu": 2.0})


# --- what the files declare ------------------------------------------------------------------------
@pytest.mark.parametrize("name", EVERY)
def test_declaration(name):
    check_findings(source_checks.check_words(TRIALS[name]), source_checks.check_parameters(TRIALS[name]))
    assert all(isinstance(p, Param) for p in catalogue()[name].params().values())


@pytest.mark.parametrize("name", EVERY)
def test_file(name):
    check_findings(
        *(
            look(TRIALS[name])
            for look in (source_checks.check_file, source_checks.check_imports, source_checks.check_example)
        )
    )


def test_every_file_is_in_the_catalogue():
    files = {f.stem for f in (PACKAGE / "physics" / "effects").glob("*.py")} - {"__init__"}
    assert files == set(EVERY)


ROOT = PACKAGE.parent
EFFECTS = PACKAGE / "physics" / "effects"
ENGINE = [f for f in [*PACKAGE.rglob("*.py"), *(ROOT / "viz").rglob("*.py")] if f.parent != EFFECTS]
WORDS = {  # that are quantities or parts of a camera's image before they are effects, and where they are such
    "emissivity": (
        "camera", "physics/quantities.py", "lab/import_form.py", "comparison/known_inputs.py",
        "discovery/hypotheses", "discovery/prediction/prediction.py", "discovery/diagnostics/stated_inputs.py",
        "discovery/live_evidence.py", "lab/free_keys.py", "lab/page_fields.py", "lab/recording_facts.py",
    ),
    "blur": ("camera", "physics/quantities.py", "lab/recording_facts.py"),
    "radiation": ("camera/radiometry.py",),
    "registration": ("camera", "comparison/compare.py", "api/camera.py"),
}  # fmt: skip
NAMED = {  # modules whose code names an effect, and why it must
    "model/priors.py": {"friction_softening", "edge_pressure", "wear", "persson_friction"},  # how well keys are known
    "discovery/hypotheses/input_kinds.py": {"reflection"},  # moves the reflected temperature that a recording states
    "runs/studies/friction_study.py": {"persson_friction"},  # asks for the table that this effect's theory makes
    "api/templates.py": {"friction_softening", "track_memory", "edge_pressure"},  # examples in texts to begin with
    "cli/friction.py": {"persson_friction", "resolved_spots"},  # helps of commands that serve one effect
    "physics/tables/column_matching.py": {"wear"},  # a word in headers of tables of worn depth
    "physics/friction/friction_table.py": {"persson_friction"},  # the table is that effect's
}


def code_words(file: Path) -> set[str]:
    """Words of a module's code and of its strings; prose in docstrings and comments may use any word."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(node) is not None:
            node.body[0].value.value = ""
    return set(re.findall(r"\w+", ast.unparse(tree)))


def place(file: Path) -> str:
    """Where a module lies in the package."""
    return str(file.relative_to(ROOT if file.is_relative_to(ROOT / "viz") else PACKAGE))


def test_engine_names_no_effect():
    for file in sorted(ENGINE):
        where = place(file)
        words = code_words(file) & set(OPTIONAL)
        words -= {word for word, homes in WORDS.items() if any(where.startswith(home) for home in homes)}
        assert words == NAMED.get(where, set()), where


def test_a_stream_cools_nothing_at_rest_whatever_its_exponent():
    """0^0 is 1: an exponent of 0 would be a film that never rests."""
    exponent = catalogue()["side_cooling"].params()["exponent"]
    assert exponent.find_fault(0.0) is not None
    assert exponent.find_fault(1e-3) is None
