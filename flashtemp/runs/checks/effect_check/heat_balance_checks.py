"""What the heat balance says of an effect: off is the base, exact derivatives, no heat made or lost."""

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

MAX_HEAT_LEAK = 1e-12  # relative heat imbalance of a run that rounding may leave
PRODUCT_ROUNDING = 1e-13  # the same of one product
SWELLING_JV_RTOL = 0.1  # error of J v of an elastic block that swells: at most 0.048 measured, half would do, 0.03 not
MIN_VISIBLE_CHANGE_K = 1e-3  # K: a change of the temperatures that is not for the tolerance of the integrator to make
CONTACT_PROFILES = ("T_block", "T_spot", "T_road")
TEMPERATURE_ARRAYS = (*CONTACT_PROFILES, "field")
COMPARED_ARRAYS = (
    "time", "repetition", "slid", "T_block", "T_spot", "T_road", "pressure", "friction", "worn", "tilt", "field",
    "frames",
)  # fmt: skip
REPEATABLE_REMEDY = "a law must give the same answer to the same question"
SHAPE_WORDS = {"lifted": "in 2D, lifted while waiting", "resting": "in 2D, resting on the road", "3D": "in 3D"}


# --- runs ------------------------------------------------------------------------------------------
def differing_arrays(a: Run, b: Run) -> list[str]:
    """Names of the arrays in which two runs differ by a bit."""
    return [k for k in COMPARED_ARRAYS if not np.array_equal(getattr(a, k), getattr(b, k), equal_nan=True)]


def max_temperature_difference(a: Run, b: Run) -> float:
    """Largest difference of any temperature at any time that both runs kept, K; between meshes of the contact's."""
    if np.array_equal(a.x, b.x):
        pairs = [(getattr(a, k), getattr(b, k)) for k in TEMPERATURE_ARRAYS]
    else:
        profiles = ((getattr(a, k), getattr(b, k)) for k in CONTACT_PROFILES)
        pairs = [(one, np.array([np.interp(a.x, b.x, row) for row in other])) for one, other in profiles]
    return max(float(np.nanmax(np.abs(one - other))) for one, other in pairs)


def off(bench: SceneCache, trial: EffectUnderTest, shape: str) -> Finding:
    """With all parameters off the run is the base, bit for bit."""
    base = bench.run_without(trial, CASE_SHAPES[shape])
    bare = bench.run(trial, values=CASE_SHAPES[shape] | trial.off_values())
    found = differing_arrays(bare, base)
    says = "with all parameters off the run is the base, bit for bit"
    if found:
        says = (
            f"with all parameters off {', '.join(found[:3])} differ from the base, {SHAPE_WORDS[shape]}, temperatures by "
            f"{max_temperature_difference(bare, base):.2g} K; at off a factor is exactly 1, a term and a heat exactly 0"
        )
    return Finding("off", not found, says)


def check_default_change(bench: SceneCache, trial: EffectUnderTest) -> Finding:
    """At its defaults the effect changes something."""
    hottest, most = 0.0, 0.0
    for shape in CASE_SHAPES.values():
        base, on = bench.run_without(trial, shape), bench.run(trial, values=shape)
        change, hottest = max_temperature_difference(on, base), max(hottest, float(on.T_spot.max()))
        if change > MIN_VISIBLE_CHANGE_K:
            return Finding("acts", True, f"at its defaults it changes temperatures by up to {change:.2g} K")
        if on.worn[-1].any() and not base.worn[-1].any():
            return Finding("acts", True, "at its defaults the block is worn")
        most = max(most, change)
    by = "changes nothing" if most == 0 else f"changes temperatures by no more than {most:.1g} K"
    return Finding(
        "acts", False,
        f"at its defaults it {by} in the small case (0.4 m slid at 0.1 m/s, spots up to {hottest:.0f} degC); "
        f"look for a typo in its laws, or give values at which it shows, as {trial.name}.KEY=VALUE",
    )  # fmt: skip


def energy(bench: SceneCache, trial: EffectUnderTest, shape: str) -> Finding:
    """A run with the effect neither makes nor loses heat."""
    left = bench.run(trial, values=CASE_SHAPES[shape]).energy_imbalance
    says = f"a run conserves heat to {left:.1g} of all that moved"
    if not left < MAX_HEAT_LEAK:
        says = f"a run loses {left:.1g} of its heat, {SHAPE_WORDS[shape]}; {REPEATABLE_REMEDY}"
    return Finding("energy", bool(left < MAX_HEAT_LEAK), says)


# --- linear algebra ----------------------------------------------------------------------------------

KINK_CLEARANCE_K = 4.0  # for differences: the scheme has a kink where a face of the road is bounded


def smooth_temperature_rise(mesh, rng) -> np.ndarray:
    """A smooth random temperature rise (cells,), 1-15 K."""
    x, y, z = mesh.place(np.arange(mesh.n_cells))
    x, z = x / 0.025 + 10.0 * y, z / 2e-3
    a, b = rng.uniform(0, 2 * np.pi, 2)
    return 8 + 4 * np.cos(2 * x + a) * np.exp(-np.abs(z)) + 3 * np.sin(3 * x + z + b)


def values_with_all_effects(bench: SceneCache, trial: EffectUnderTest | None, shape: str) -> dict[str, Any]:
    """Values with which every base effect acts; heat in depth is the effect's own where there would be too much."""
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
    """Balance with a system in the middle of sliding and of waiting, at a random smooth state, hotter by `added_rise` K."""
    balance = HeatBalance(scene)
    mesh = scene.mesh
    carried = np.linspace(0.1, 1.0, mesh.n_road * mesh.n_across)
    inflow = (lambda now: RoadInflow(carried)) if balance.laws.has_law("road.inflow") else None
    phases = scene.schedule.phases
    for phase in (next(p for p in phases if p.sliding), next(p for p in phases if not p.sliding)):
        rng = np.random.default_rng(7)
        y = np.zeros(balance.size)
        y[: balance.n] = balance.enthalpy_rise(smooth_temperature_rise(mesh, rng) + added_rise)
        if balance.abrades:  # the pressure varies by 15 %, from column to column: lanes begin where it grows
            y[balance.worn] = 3 * np.sin(2 * mesh.column_x / 0.025 - 1 + 20 * mesh.column_y)
        yield balance, PhaseSystem(balance, phase, inflow), 0.5 * (phase.begin + phase.end), y, rng


def random_direction(balance: HeatBalance, cells: np.ndarray, rng) -> np.ndarray:
    """A direction of the state: cells as given and, where the worn depth acts, random depths."""
    v = np.concatenate([cells, np.zeros(balance.size - balance.n)])
    if balance.abrades:
        v[balance.worn] = rng.normal(size=balance.worn.stop - balance.n)
    return v


def state_parts(balance: HeatBalance) -> tuple[slice, slice, slice]:
    """Cells, worn depth and ledger of a state."""
    return slice(0, balance.n), balance.worn, balance.ledger_slice


def jacobian_product(balance: HeatBalance, system: PhaseSystem, t: float, y: np.ndarray, v: np.ndarray) -> np.ndarray:
    """J v by one complex step."""
    out = np.zeros(balance.size, dtype=complex)
    system.rate(t, y + 1j * COMPLEX_STEP * v, out)
    return out.imag / COMPLEX_STEP


def difference_product(balance: HeatBalance, system: PhaseSystem, t: float, y: np.ndarray, v: np.ndarray) -> np.ndarray:
    """J v by central differences of 1 and 0.5 mK, extrapolated to none (Richardson).

    Lanes that begin and end bend the rate so much that one of 1 mK is 2e-5 off, and the rest falls with its square.
    """

    def central_difference(step: float) -> np.ndarray:
        up, down = np.zeros(balance.size), np.zeros(balance.size)
        system.rate(t, y + step * v, up)
        system.rate(t, y - step * v, down)
        return (up - down) / (2.0 * step)

    extrapolated: np.ndarray = (4.0 * central_difference(5e-4) - central_difference(1e-3)) / 3.0
    return extrapolated


def heat_weights(balance: HeatBalance, share: float) -> np.ndarray:
    """w with w . y = heat in block and phi x lanes, minus all that the ledger says came in."""
    w = np.zeros(balance.size)
    mesh = balance.scene.mesh
    w[: balance.n] = np.outer(balance.capacity, mesh.share).ravel()
    w[mesh.everywhere(mesh.road)] *= share
    signs = {"friction": -1.0, "into_road": 0.0, "lane_out": share, "lane_air": -share}
    for entry, i in balance.ledger_index.items():
        w[i] = signs.get(entry, -1.0)
    return w


def jacobian(bench: SceneCache, trial: EffectUnderTest | None, shape: str) -> Finding:
    """The complex step gives the derivative that differences give, in the whole balance."""
    worst = 0.0
    for balance, system, t, y, rng in sample_states(
        bench.build_scene(trial, values=values_with_all_effects(bench, trial, shape)), KINK_CLEARANCE_K
    ):
        for cells in (smooth_temperature_rise(balance.scene.mesh, rng) - 8, rng.normal(size=balance.n)):
            v = random_direction(balance, cells, rng)
            J, by = jacobian_product(balance, system, t, y, v), difference_product(balance, system, t, y, v)
            for part in state_parts(balance):
                bound = 1e-9 * np.abs(J[part]).max() + 1e-6 * np.abs(by[part])
                worst = max(worst, _max_error_ratio(np.abs(J[part] - by[part]), bound))
    says = "the derivative of the whole balance by complex step is that by differences, to 1e-6"
    if not worst <= 1.0:
        says = f"the derivative of the whole balance by complex step is not that by differences, {SHAPE_WORDS[shape]}"
    return Finding("jacobian", worst <= 1.0, says)


def linearisation(bench: SceneCache, trial: EffectUnderTest | None, shape: str) -> Finding:
    """What the solver takes for J v is J v, but for the slope of k(T), of abrasion and of swelling: those by little."""
    worst = 0.0
    for balance, system, t, y, rng in sample_states(
        bench.build_scene(trial, values=values_with_all_effects(bench, trial, shape))
    ):
        # lanes and gaps follow the mean contact fraction
        bent = balance.nonlinear_conductivity or balance.abrades or balance.expansion
        v = random_direction(balance, smooth_temperature_rise(balance.scene.mesh, rng) - 8, rng)
        J, out = jacobian_product(balance, system, t, y, v), np.zeros(balance.size)
        system.linearise(t, y, 1e-2).apply_jacobian(v, out)
        for part in state_parts(balance):
            # left out: lanes and gaps follow the mean contact fraction, which heat moves more in an elastic block
            loosely = SWELLING_JV_RTOL if balance.elastic_block and balance.expansion else 0.03
            bound = (loosely if bent else 1e-10) * np.linalg.norm(J[part])
            worst = max(worst, _max_error_ratio(np.linalg.norm((out - J)[part]), bound))
    says = "the solver's own linearisation holds with it"
    if not worst <= 1.0:
        says = f"the solver's linearisation fails with it, {SHAPE_WORDS[shape]}; a law sees its own point and no other"
    return Finding("linearisation", worst <= 1.0, says)


def conservation(bench: SceneCache, trial: EffectUnderTest | None, shape: str) -> Finding:
    """The rate, its linearisation and the preconditioner: none makes or loses heat, whatever they approximate."""
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
        says = f"a linear step makes or loses heat, {SHAPE_WORDS[shape]}; {REPEATABLE_REMEDY}"
    return Finding("conservation", worst <= 1.0, says)


def _max_error_ratio(error, bound) -> float:
    """Largest error over its bound; beyond any bound where it is not a number."""
    error, bound = np.atleast_1d(error), np.atleast_1d(bound)
    if not len(error):
        return 0.0
    if not np.all(np.isfinite(error)):
        return np.inf
    ratio = np.where(error > 0, error / np.maximum(bound, 1e-300), 0.0)
    return float(ratio.max())


def check_every_shape(check, bench: SceneCache, trial: EffectUnderTest) -> Finding:
    """The finding of a check in the first shape where it fails, or else in the last."""
    for shape in CASE_SHAPES:
        finding = catch_failures(check.__name__, trial, partial(check, bench, trial, shape))
        if not finding.ok:
            break
    return finding


def catch_failures(name: str, trial: EffectUnderTest, check: Callable[[], Finding]) -> Finding:
    """The finding of a look; a computation or a law that fails is a finding too."""
    try:
        return check()
    except SolverFailure as fault:
        return Finding(name, False, f"the computation fails with it: {fault}")
    except FlashtempError:
        raise
    except Exception as fault:
        return Finding(name, False, suggestions.explain_exception(trial.file, fault))
