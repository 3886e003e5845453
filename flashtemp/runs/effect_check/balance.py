"""What the heat balance says of an effect: off is the base, exact derivatives, no heat made or lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from flashtemp.errors import FlashtempError, SolverFailure
from flashtemp.model.laws import STEP
from flashtemp.physics.effect import Deposit
from flashtemp.runs.effect_check import remedies
from flashtemp.runs.effect_check.findings import Finding
from flashtemp.runs.effect_check.scenes import RICH, SHAPES, Bench, Trial
from flashtemp.solver.balance import Balance
from flashtemp.solver.run import Run
from flashtemp.solver.system import Incoming, System

LEAK = 1e-12  # relative heat imbalance of a run that rounding may leave
ROUNDING = 1e-13  # the same of one product
SWELLING_JV_RTOL = 0.1  # error of J v of an elastic block that swells: at most 0.048 measured, half would do, 0.03 not
SHOWS = 1e-3  # K: a change of the temperatures that is not for the tolerance of the integrator to make
CONTACT = ("T_block", "T_spot", "T_road")
TEMPERATURES = (*CONTACT, "field")
ARRAYS = (
    "time", "repetition", "slid", "T_block", "T_spot", "T_road", "pressure", "friction", "worn", "tilt", "field",
    "frames",
)  # fmt: skip
AGAIN = "a law must give the same answer to the same question"
WAITS = {"lifted": "in 2D, lifted while waiting", "resting": "in 2D, resting on the road", "3D": "in 3D"}


# --- runs ------------------------------------------------------------------------------------------
def differences(a: Run, b: Run) -> list[str]:
    """Names of the arrays in which two runs differ by a bit."""
    return [k for k in ARRAYS if not np.array_equal(getattr(a, k), getattr(b, k), equal_nan=True)]


def largest(a: Run, b: Run) -> float:
    """Largest difference of any temperature at any time that both runs kept, K; between meshes of the contact's."""
    if np.array_equal(a.x, b.x):
        pairs = [(getattr(a, k), getattr(b, k)) for k in TEMPERATURES]
    else:
        profiles = ((getattr(a, k), getattr(b, k)) for k in CONTACT)
        pairs = [(one, np.array([np.interp(a.x, b.x, row) for row in other])) for one, other in profiles]
    return max(float(np.nanmax(np.abs(one - other))) for one, other in pairs)


def off(bench: Bench, trial: Trial, shape: str) -> Finding:
    """With all parameters off the run is the base, bit for bit."""
    base = bench.without(trial, SHAPES[shape])
    bare = bench.run(trial, values=SHAPES[shape] | trial.off())
    found = differences(bare, base)
    says = "with all parameters off the run is the base, bit for bit"
    if found:
        says = (
            f"with all parameters off {', '.join(found[:3])} differ from the base, {WAITS[shape]}, temperatures by "
            f"{largest(bare, base):.2g} K; at off a factor is exactly 1, a term and a heat exactly 0"
        )
    return Finding("off", not found, says)


def acts(bench: Bench, trial: Trial) -> Finding:
    """At its defaults the effect changes something."""
    hottest, most = 0.0, 0.0
    for shape in SHAPES.values():
        base, on = bench.without(trial, shape), bench.run(trial, values=shape)
        change, hottest = largest(on, base), max(hottest, float(on.T_spot.max()))
        if change > SHOWS:
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


def energy(bench: Bench, trial: Trial, shape: str) -> Finding:
    """A run with the effect neither makes nor loses heat."""
    left = bench.run(trial, values=SHAPES[shape]).energy_imbalance
    says = f"a run conserves heat to {left:.1g} of all that moved"
    if not left < LEAK:
        says = f"a run loses {left:.1g} of its heat, {WAITS[shape]}; {AGAIN}"
    return Finding("energy", bool(left < LEAK), says)


# --- linear algebra ----------------------------------------------------------------------------------

CLEAR_K = 4.0  # for differences: the scheme has a kink where a face of the road is bounded


def smooth(mesh, rng) -> np.ndarray:
    """A smooth random temperature rise (cells,), 1-15 K."""
    x, y, z = mesh.place(np.arange(mesh.n_cells))
    x, z = x / 0.025 + 10.0 * y, z / 2e-3
    a, b = rng.uniform(0, 2 * np.pi, 2)
    return 8 + 4 * np.cos(2 * x + a) * np.exp(-np.abs(z)) + 3 * np.sin(3 * x + z + b)


def rich(bench: Bench, trial: Trial | None, shape: str) -> dict[str, Any]:
    """Values with which every base effect acts; heat in depth is the effect's own where there would be too much."""
    values = RICH | SHAPES[shape]
    if trial is not None and not trial.effect.base:
        scene = bench.scene(trial, values=SHAPES[shape] | {"friction.volumetric_share": 0.0})
        parts = next(a for a in scene.acting if a.name == trial.name).contributions(scene)
        if sum(c.share for c in parts if isinstance(c, Deposit)) + RICH["friction.volumetric_share"] > 1:
            values["friction.volumetric_share"] = 0.0
    return values


def states(scene, above: float = 0.0) -> Iterator[tuple[Balance, System, float, np.ndarray, np.random.Generator]]:
    """Balance with a system in the middle of sliding and of waiting, at a random smooth state, hotter by `above` K."""
    balance = Balance(scene)
    mesh = scene.mesh
    carried = np.linspace(0.1, 1.0, mesh.n_road * mesh.n_across)
    inflow = (lambda now: Incoming(carried)) if balance.laws.has("road.inflow") else None
    phases = scene.schedule.phases
    for phase in (next(p for p in phases if p.sliding), next(p for p in phases if not p.sliding)):
        rng = np.random.default_rng(7)
        y = np.zeros(balance.size)
        y[: balance.n] = balance.enthalpy(smooth(mesh, rng) + above)
        if balance.abrades:  # the pressure varies by 15 %, from column to column: lanes begin where it grows
            y[balance.worn] = 3 * np.sin(2 * mesh.column_x / 0.025 - 1 + 20 * mesh.column_y)
        yield balance, System(balance, phase, inflow), 0.5 * (phase.begin + phase.end), y, rng


def direction(balance: Balance, cells: np.ndarray, rng) -> np.ndarray:
    """A direction of the state: cells as given and, where the worn depth acts, random depths."""
    v = np.concatenate([cells, np.zeros(balance.size - balance.n)])
    if balance.abrades:
        v[balance.worn] = rng.normal(size=balance.worn.stop - balance.n)
    return v


def parts(balance: Balance) -> tuple[slice, slice, slice]:
    """Cells, worn depth and ledger of a state."""
    return slice(0, balance.n), balance.worn, balance.books


def product(balance: Balance, system: System, t: float, y: np.ndarray, v: np.ndarray) -> np.ndarray:
    """J v by one complex step."""
    out = np.zeros(balance.size, dtype=complex)
    system.rate(t, y + 1j * STEP * v, out)
    return out.imag / STEP


def by_differences(balance: Balance, system: System, t: float, y: np.ndarray, v: np.ndarray) -> np.ndarray:
    """J v by central differences of 1 and 0.5 mK, extrapolated to none (Richardson).

    Lanes that begin and end bend the rate so much that one of 1 mK is 2e-5 off, and the rest falls with its square.
    """

    def central(step: float) -> np.ndarray:
        up, down = np.zeros(balance.size), np.zeros(balance.size)
        system.rate(t, y + step * v, up)
        system.rate(t, y - step * v, down)
        return (up - down) / (2.0 * step)

    extrapolated: np.ndarray = (4.0 * central(5e-4) - central(1e-3)) / 3.0
    return extrapolated


def heat_weights(balance: Balance, share: float) -> np.ndarray:
    """w with w . y = heat in block and phi x lanes, minus all that the ledger says came in."""
    w = np.zeros(balance.size)
    mesh = balance.scene.mesh
    w[: balance.n] = np.outer(balance.capacity, mesh.share).ravel()
    w[mesh.everywhere(mesh.road)] *= share
    signs = {"friction": -1.0, "into_road": 0.0, "lane_out": share, "lane_air": -share}
    for entry, i in balance.entry.items():
        w[i] = signs.get(entry, -1.0)
    return w


def jacobian(bench: Bench, trial: Trial | None, shape: str) -> Finding:
    """The complex step gives the derivative that differences give, in the whole balance."""
    worst = 0.0
    for balance, system, t, y, rng in states(bench.scene(trial, values=rich(bench, trial, shape)), CLEAR_K):
        for cells in (smooth(balance.scene.mesh, rng) - 8, rng.normal(size=balance.n)):
            v = direction(balance, cells, rng)
            J, by = product(balance, system, t, y, v), by_differences(balance, system, t, y, v)
            for part in parts(balance):
                bound = 1e-9 * np.abs(J[part]).max() + 1e-6 * np.abs(by[part])
                worst = max(worst, _over(np.abs(J[part] - by[part]), bound))
    says = "the derivative of the whole balance by complex step is that by differences, to 1e-6"
    if not worst <= 1.0:
        says = f"the derivative of the whole balance by complex step is not that by differences, {WAITS[shape]}"
    return Finding("jacobian", worst <= 1.0, says)


def linearisation(bench: Bench, trial: Trial | None, shape: str) -> Finding:
    """What the solver takes for J v is J v, but for the slope of k(T), of abrasion and of swelling: those by little."""
    worst = 0.0
    for balance, system, t, y, rng in states(bench.scene(trial, values=rich(bench, trial, shape))):
        # lanes and gaps follow the mean contact fraction
        bent = balance.nonlinear_conductivity or balance.abrades or balance.expansion
        v = direction(balance, smooth(balance.scene.mesh, rng) - 8, rng)
        J, out = product(balance, system, t, y, v), np.zeros(balance.size)
        system.linearised(t, y, 1e-2).times(v, out)
        for part in parts(balance):
            # left out: lanes and gaps follow the mean contact fraction, which heat moves more in an elastic block
            loosely = SWELLING_JV_RTOL if balance.elastic and balance.expansion else 0.03
            bound = (loosely if bent else 1e-10) * np.linalg.norm(J[part])
            worst = max(worst, _over(np.linalg.norm((out - J)[part]), bound))
    says = "the solver's own linearisation holds with it"
    if not worst <= 1.0:
        says = f"the solver's linearisation fails with it, {WAITS[shape]}; a law sees its own point and no other"
    return Finding("linearisation", worst <= 1.0, says)


def conservation(bench: Bench, trial: Trial | None, shape: str) -> Finding:
    """The rate, its linearisation and the preconditioner: none makes or loses heat, whatever they approximate."""
    worst = 0.0
    for balance, system, t, y, rng in states(bench.scene(trial, values=rich(bench, trial, shape))):
        out, r = np.zeros(balance.size), rng.normal(size=balance.size)
        w = heat_weights(balance, balance.share)
        system.rate(t, y, out)
        worst = max(worst, _over(abs(w @ out), ROUNDING * np.abs(w * out).sum()))
        for gamma in (1e-4, 1e-2, 1.0):
            at = system.linearised(t, y, gamma)
            at.times(r, out)
            worst = max(worst, _over(abs(w @ out), ROUNDING * np.abs(w * out).sum()))
            at.solve(r, out)
            worst = max(worst, _over(abs(w @ out - w @ r), ROUNDING * np.abs(w * r).sum()))
    says = "every linear step conserves heat to rounding"
    if not worst <= 1.0:
        says = f"a linear step makes or loses heat, {WAITS[shape]}; {AGAIN}"
    return Finding("conservation", worst <= 1.0, says)


def _over(error, bound) -> float:
    """Largest error over its bound; beyond any bound where it is not a number."""
    error, bound = np.atleast_1d(error), np.atleast_1d(bound)
    if not len(error):
        return 0.0
    if not np.all(np.isfinite(error)):
        return np.inf
    ratio = np.where(error > 0, error / np.maximum(bound, 1e-300), 0.0)
    return float(ratio.max())


def in_every_shape(check, bench: Bench, trial: Trial) -> Finding:
    """The finding of a check in the first shape where it fails, or else in the last."""
    for shape in SHAPES:
        finding = sound(check.__name__, trial, partial(check, bench, trial, shape))
        if not finding.ok:
            break
    return finding


def sound(name: str, trial: Trial, look: Callable[[], Finding]) -> Finding:
    """The finding of a look; a computation or a law that fails is a finding too."""
    try:
        return look()
    except SolverFailure as fault:
        return Finding(name, False, f"the computation fails with it: {fault}")
    except FlashtempError:
        raise
    except Exception as fault:
        return Finding(name, False, remedies.of_exception(trial.file, fault))
