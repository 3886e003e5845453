"""Checks of an effect in the heat balance: neutral when off, exact derivatives, conservation of heat."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from flashtemp.errors import FlashtempError, SolverFailure
from flashtemp.model.effect_laws import COMPLEX_STEP
from flashtemp.physics.effect import Deposit
from flashtemp.runs.checks.effect_check import suggestions
from flashtemp.runs.checks.effect_check.findings import Finding
from flashtemp.runs.checks.effect_check.fixtures import ALL_EFFECTS_CASE, CASE_SHAPES, EffectUnderTest, SceneCache
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem, RoadInflow

MAX_HEAT_LEAK = 1e-12  # relative energy imbalance of a run by rounding
PRODUCT_ROUNDING = 1e-13  # relative energy imbalance of one product by rounding
SWELLING_JV_RTOL = 0.1  # error of J v for a swelling elastic block; the largest measured is 0.048
MIN_VISIBLE_CHANGE_K = 1e-3  # K, well above changes by the tolerance of the integrator
CONTACT_PROFILES = ("T_block", "T_spot", "T_road")
TEMPERATURE_ARRAYS = (*CONTACT_PROFILES, "field")
COMPARED_ARRAYS = (
    "time", "repetition", "slid", "T_block", "T_spot", "T_road", "pressure", "friction", "worn", "tilt", "field",
    "frames",
)  # fmt: skip
REPEATABLE_REMEDY = "a law must return the same value for the same arguments"
SHAPE_WORDS = {"lifted": "in 2D, lifted while waiting", "resting": "in 2D, resting on the road", "3D": "in 3D"}


# --- runs ------------------------------------------------------------------------------------------
def differing_arrays(a: Run, b: Run) -> list[str]:
    """Names of the arrays in which two runs differ at all."""
    return [k for k in COMPARED_ARRAYS if not np.array_equal(getattr(a, k), getattr(b, k), equal_nan=True)]


def max_temperature_difference(a: Run, b: Run) -> float:
    """Largest temperature difference of two runs at the saved times, K; for different meshes only on the contact."""
    if np.array_equal(a.x, b.x):
        pairs = [(getattr(a, k), getattr(b, k)) for k in TEMPERATURE_ARRAYS]
    else:
        profiles = ((getattr(a, k), getattr(b, k)) for k in CONTACT_PROFILES)
        pairs = [(one, np.array([np.interp(a.x, b.x, row) for row in other])) for one, other in profiles]
    return max(float(np.nanmax(np.abs(one - other))) for one, other in pairs)


def off(bench: SceneCache, trial: EffectUnderTest, shape: str) -> Finding:
    """Check that the run with all parameters off equals the base, bit for bit."""
    base = bench.run_without(trial, CASE_SHAPES[shape])
    neutral = bench.run(trial, values=CASE_SHAPES[shape] | trial.off_values())
    differing = differing_arrays(neutral, base)
    says = "with all parameters off the run equals the base, bit for bit"
    if differing:
        says = (
            f"with all parameters off {', '.join(differing[:3])} differ from the base, {SHAPE_WORDS[shape]}, "
            f"temperatures by {max_temperature_difference(neutral, base):.2g} K; a factor must then be exactly 1, "
            "a term and a heat 0"
        )
    return Finding("off", not differing, says)


def check_default_change(bench: SceneCache, trial: EffectUnderTest) -> Finding:
    """Check that the effect changes the run at its defaults."""
    hottest, largest = 0.0, 0.0
    for shape in CASE_SHAPES.values():
        base, on = bench.run_without(trial, shape), bench.run(trial, values=shape)
        change, hottest = max_temperature_difference(on, base), max(hottest, float(on.T_spot.max()))
        if change > MIN_VISIBLE_CHANGE_K:
            return Finding("acts", True, f"at its defaults it changes temperatures by up to {change:.2g} K")
        if on.worn[-1].any() and not base.worn[-1].any():
            return Finding("acts", True, "at its defaults the block is worn")
        largest = max(largest, change)
    by = "changes nothing" if largest == 0 else f"changes temperatures by no more than {largest:.1g} K"
    return Finding(
        "acts", False,
        f"at its defaults it {by} in the small case (0.4 m slid at 0.1 m/s, spots up to {hottest:.0f} degC); "
        f"look for a typo in its laws, or give values at which it acts, as {trial.name}.KEY=VALUE",
    )  # fmt: skip


def energy(bench: SceneCache, trial: EffectUnderTest, shape: str) -> Finding:
    """Check that a run with the effect conserves heat."""
    imbalance = bench.run(trial, values=CASE_SHAPES[shape]).energy_imbalance
    says = f"a run conserves heat to {imbalance:.1g} of the heat transferred"
    if not imbalance < MAX_HEAT_LEAK:
        says = f"a run loses {imbalance:.1g} of its heat, {SHAPE_WORDS[shape]}; {REPEATABLE_REMEDY}"
    return Finding("energy", bool(imbalance < MAX_HEAT_LEAK), says)


# --- linear algebra ----------------------------------------------------------------------------------

KINK_CLEARANCE_K = 4.0  # K added to states: the scheme has a kink where the temperature of a road face is bounded


def smooth_temperature_rise(mesh, rng) -> np.ndarray:
    """A smooth random temperature rise (cells,) of 1 to 15 K."""
    x, y, z = mesh.place(np.arange(mesh.n_cells))
    x, z = x / 0.025 + 10.0 * y, z / 2e-3
    a, b = rng.uniform(0, 2 * np.pi, 2)
    return 8 + 4 * np.cos(2 * x + a) * np.exp(-np.abs(z)) + 3 * np.sin(3 * x + z + b)


def values_with_all_effects(bench: SceneCache, trial: EffectUnderTest | None, shape: str) -> dict[str, Any]:
    """Values with which every base effect acts; no volumetric base heat where the effect releases too much itself."""
    values = ALL_EFFECTS_CASE | CASE_SHAPES[shape]
    if trial is not None and not trial.effect.base:
        scene = bench.build_scene(trial, values=CASE_SHAPES[shape] | {"friction.volumetric_share": 0.0})
        parts = next(a for a in scene.acting if a.name == trial.name).contributions(scene)
        if sum(c.share for c in parts if isinstance(c, Deposit)) + ALL_EFFECTS_CASE["friction.volumetric_share"] > 1:
            values["friction.volumetric_share"] = 0.0
    return values


def sample_states(
    scene, added_rise: float = 0.0
) -> Iterator[tuple[HeatBalance, PhaseSystem, float, np.ndarray, np.random.Generator]]:
    """Yield (balance, system, time, state, generator) in the middle of sliding and in the middle of waiting.

    The state is a smooth random temperature rise plus `added_rise` K.
    """
    balance = HeatBalance(scene)
    mesh = scene.mesh
    carried = np.linspace(0.1, 1.0, mesh.n_road * mesh.n_across)
    inflow = (lambda now: RoadInflow(carried)) if balance.laws.has_law("road.inflow") else None
    phases = scene.schedule.phases
    for phase in (next(p for p in phases if p.sliding), next(p for p in phases if not p.sliding)):
        rng = np.random.default_rng(7)
        y = np.zeros(balance.size)
        y[: balance.n] = balance.enthalpy_rise(smooth_temperature_rise(mesh, rng) + added_rise)
        if balance.abrades:  # the pressure varies by 15 % between columns, so that heated lanes begin
            y[balance.worn] = 3 * np.sin(2 * mesh.column_x / 0.025 - 1 + 20 * mesh.column_y)
        yield balance, PhaseSystem(balance, phase, inflow), 0.5 * (phase.begin + phase.end), y, rng


def random_direction(balance: HeatBalance, cells: np.ndarray, rng) -> np.ndarray:
    """A direction in state space: the given `cells`, with random wear depths if the wear depth is a state."""
    v = np.concatenate([cells, np.zeros(balance.size - balance.n)])
    if balance.abrades:
        v[balance.worn] = rng.normal(size=balance.worn.stop - balance.n)
    return v


def state_parts(balance: HeatBalance) -> tuple[slice, slice, slice]:
    """Slices of cells, wear depth and energy ledger of a state."""
    return slice(0, balance.n), balance.worn, balance.ledger_slice


def jacobian_product(balance: HeatBalance, system: PhaseSystem, t: float, y: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Jacobian times v by a complex step."""
    out = np.zeros(balance.size, dtype=complex)
    system.rate(t, y + 1j * COMPLEX_STEP * v, out)
    return out.imag / COMPLEX_STEP


def difference_product(balance: HeatBalance, system: PhaseSystem, t: float, y: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Jacobian times v by central differences with steps of 1 and 0.5 mK and Richardson extrapolation.

    The rate is strongly curved where heated lanes begin or end: a single step of 1 mK has an error of 2e-5, which
    decreases with the square of the step.
    """

    def central_difference(step: float) -> np.ndarray:
        up, down = np.zeros(balance.size), np.zeros(balance.size)
        system.rate(t, y + step * v, up)
        system.rate(t, y - step * v, down)
        return (up - down) / (2.0 * step)

    extrapolated: np.ndarray = (4.0 * central_difference(5e-4) - central_difference(1e-3)) / 3.0
    return extrapolated


def heat_weights(balance: HeatBalance, share: float) -> np.ndarray:
    """Weights w: w . y is the heat in block and lanes (times contact fraction) minus the heat input of the ledger."""
    w = np.zeros(balance.size)
    mesh = balance.scene.mesh
    w[: balance.n] = np.outer(balance.capacity, mesh.share).ravel()
    w[mesh.everywhere(mesh.road)] *= share
    signs = {"friction": -1.0, "into_road": 0.0, "lane_out": share, "lane_air": -share}
    for entry, i in balance.ledger_index.items():
        w[i] = signs.get(entry, -1.0)
    return w


def jacobian(bench: SceneCache, trial: EffectUnderTest | None, shape: str) -> Finding:
    """Check that derivatives of the whole balance by complex step agree with finite differences."""
    worst = 0.0
    for balance, system, t, y, rng in sample_states(
        bench.build_scene(trial, values=values_with_all_effects(bench, trial, shape)), KINK_CLEARANCE_K
    ):
        for cells in (smooth_temperature_rise(balance.scene.mesh, rng) - 8, rng.normal(size=balance.n)):
            v = random_direction(balance, cells, rng)
            Jv, difference = jacobian_product(balance, system, t, y, v), difference_product(balance, system, t, y, v)
            for part in state_parts(balance):
                bound = 1e-9 * np.abs(Jv[part]).max() + 1e-6 * np.abs(difference[part])
                worst = max(worst, _max_error_ratio(np.abs(Jv[part] - difference[part]), bound))
    says = "derivatives of the whole balance by complex step agree with finite differences to 1e-6"
    if not worst <= 1.0:
        says = (
            f"derivatives of the whole balance by complex step and by finite differences differ, {SHAPE_WORDS[shape]}"
        )
    return Finding("jacobian", worst <= 1.0, says)


def linearisation(bench: SceneCache, trial: EffectUnderTest | None, shape: str) -> Finding:
    """Check the approximate Jacobian product of the solver.

    It neglects only the derivatives of k(T), wear and thermal expansion, which contribute little.
    """
    worst = 0.0
    for balance, system, t, y, rng in sample_states(
        bench.build_scene(trial, values=values_with_all_effects(bench, trial, shape))
    ):
        neglects = balance.nonlinear_conductivity or balance.abrades or balance.expansion
        v = random_direction(balance, smooth_temperature_rise(balance.scene.mesh, rng) - 8, rng)
        Jv, out = jacobian_product(balance, system, t, y, v), np.zeros(balance.size)
        system.linearise(t, y, 1e-2).apply_jacobian(v, out)
        for part in state_parts(balance):
            # lanes and gaps depend on the mean contact fraction; the solver neglects that heat changes it, which
            # matters more in an elastic block
            loose = SWELLING_JV_RTOL if balance.elastic_block and balance.expansion else 0.03
            bound = (loose if neglects else 1e-10) * np.linalg.norm(Jv[part])
            worst = max(worst, _max_error_ratio(np.linalg.norm((out - Jv)[part]), bound))
    says = "the linearisation of the solver is accurate with it"
    if not worst <= 1.0:
        says = (
            f"the linearisation of the solver is wrong with it, {SHAPE_WORDS[shape]}; a law may use its own point only"
        )
    return Finding("linearisation", worst <= 1.0, says)


def conservation(bench: SceneCache, trial: EffectUnderTest | None, shape: str) -> Finding:
    """Check that the rate, its linearisation and the preconditioner conserve heat exactly, even if approximate."""
    worst = 0.0
    for balance, system, t, y, rng in sample_states(
        bench.build_scene(trial, values=values_with_all_effects(bench, trial, shape))
    ):
        out, r = np.zeros(balance.size), rng.normal(size=balance.size)
        w = heat_weights(balance, balance.share)
        system.rate(t, y, out)
        worst = max(worst, _max_error_ratio(abs(w @ out), PRODUCT_ROUNDING * np.abs(w * out).sum()))
        for gamma in (1e-4, 1e-2, 1.0):
            at = system.linearise(t, y, gamma)
            at.apply_jacobian(r, out)
            worst = max(worst, _max_error_ratio(abs(w @ out), PRODUCT_ROUNDING * np.abs(w * out).sum()))
            at.solve(r, out)
            worst = max(worst, _max_error_ratio(abs(w @ out - w @ r), PRODUCT_ROUNDING * np.abs(w * r).sum()))
    says = "every linear step conserves heat to rounding"
    if not worst <= 1.0:
        says = f"a linear step does not conserve heat, {SHAPE_WORDS[shape]}; {REPEATABLE_REMEDY}"
    return Finding("conservation", worst <= 1.0, says)


def _max_error_ratio(error, bound) -> float:
    """Largest ratio of error to bound; infinite where an error is not finite."""
    error, bound = np.atleast_1d(error), np.atleast_1d(bound)
    if not len(error):
        return 0.0
    if not np.all(np.isfinite(error)):
        return np.inf
    ratio = np.where(error > 0, error / np.maximum(bound, 1e-300), 0.0)
    return float(ratio.max())


def check_every_shape(check, bench: SceneCache, trial: EffectUnderTest) -> Finding:
    """The finding of a check for the first case shape where it fails, or for the last one."""
    for shape in CASE_SHAPES:
        finding = catch_failures(check.__name__, trial, partial(check, bench, trial, shape))
        if not finding.ok:
            break
    return finding


def catch_failures(name: str, trial: EffectUnderTest, check: Callable[[], Finding]) -> Finding:
    """The finding of a check; a failing computation or law is a failed check."""
    try:
        return check()
    except SolverFailure as fault:
        return Finding(name, False, f"the computation fails with the effect: {fault}")
    except FlashtempError:
        raise
    except Exception as fault:
        return Finding(name, False, suggestions.explain_exception(trial.file, fault))
