"""Tread block in the footprint: mass and spring on a road whose friction depends on speed and slid distance.

Per unit area, from the moment the rubber touches the road (u = vs = r = 0):

    m dvs/dt = k_t u - mu(vs, r) p,    du/dt = v_y - vs,    r = int vs dt,    vs = 0 while k_t u < mu p

`u` m is the shear displacement of the tread, `vs` m/s its sliding speed, and `v_y` = slip v_R the speed at which the
road shears it, where v_R is the rolling speed.

>>> import numpy as np
>>> from flashtemp.physics.friction.cold_hot_law import ColdHotLaw, FrictionBranch
>>> even = FrictionBranch(np.array([1e-5, 10.0]), np.array([0.5, 0.5]), np.zeros(2), np.zeros(2))
>>> block = TreadBlock(speed=27.0, footprint=0.1, stiffness=1.5e8, mass=0.1, pressure=3e5)
>>> path = pass_footprint(block, ColdHotLaw(even, even, 2e-3), [0.05])
>>> round(1e3 * float(path.slid[-1, 0] + path.shear[-1, 0]), 6)  # mm, slip times footprint
5.0
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.cold_hot_law import MIN_LAW_SPEED_M_S, ColdHotLaw
from flashtemp.physics.friction.curve_peak import CurvePeak, find_peak
from flashtemp.physics.friction.flash_temperature import ContactSpots, SlidingHistory
from flashtemp.physics.friction.persson import PerssonTheory
from flashtemp.physics.material import Material
from flashtemp.physics.quantities import KELVIN

MIN_KERNEL_STEPS, MAX_KERNEL_STEPS = 200, 800  # steps in the footprint; the cost of the kernel theory is quadratic
MIN_LAW_STEPS, MAX_LAW_STEPS = 800, 3200  # steps of the cold-hot law alone
STEP_DOUBLING_TOLERANCE = 0.02  # relative change of the footprint's friction by twice the steps
MIN_BRANCH_DIFFERENCE = 0.01  # relative difference of the branches below which they count as equal
MAX_SPEED_ITERATIONS, SPEED_TOLERANCE = 80, 1e-8  # solution for the speed in a step; relative
MAX_RINGING_RATIO = 0.1  # largest period of mass and spring over the contact time
SWEPT_SLIPS = np.geomspace(2e-3, 0.5, 49)  # slips among which the maximum of friction is found


@dataclass(frozen=True)
class TreadBlock:
    """Rolling `speed` m/s, length of the `footprint` m, `stiffness` k_t Pa/m, `mass` kg/m2, nominal `pressure` Pa."""

    speed: float
    footprint: float
    stiffness: float
    mass: float
    pressure: float

    @property
    def contact_time(self) -> float:
        """Time from entry to exit, s."""
        return self.footprint / self.speed

    @property
    def ringing_ratio(self) -> float:
        """Period of mass and spring over the contact time; above 0.1 inertia affects the friction."""
        return float(2 * np.pi * np.sqrt(self.mass / self.stiffness) / self.contact_time)


class FootprintPath(NamedTuple):
    """Path in the footprint: `time` (n,) s; for m slips (n, m) `shear` u m, `slid` r m, `speed` vs m/s, friction `mu`.

    `mu` is that of the sliding rubber, mu(vs, r); `traction` k_t u/p is the force on the wheel over load.
    """

    time: np.ndarray
    shear: np.ndarray
    slid: np.ndarray
    speed: np.ndarray
    mu: np.ndarray
    traction: np.ndarray


def pass_footprint(tread: TreadBlock, law: ColdHotLaw, slips: Value, steps: int = MIN_LAW_STEPS) -> FootprintPath:
    """The path of a tread block with the cold-hot law, at all slips (m,) at once.  Raises SolverFailure."""
    return _integrate_path(tread, law, tread.speed * np.asarray(slips, dtype=float), steps)


def pass_with_heat_memory(
    tread: TreadBlock,
    theory: PerssonTheory,
    rubber: Material,
    spots: ContactSpots,
    T0: float,
    slip: float,
    steps: int = MIN_KERNEL_STEPS,
) -> tuple[FootprintPath, np.ndarray]:
    """The path at one slip with the kernel theory and its full heat history, and the highest T_q (n,) K along it.

    The temperatures for the friction of a step are extrapolated from the two previous steps.  Raises SolverFailure.
    """
    slide = SlidingHistory(theory, rubber, spots, T0, tread.pressure, steps)
    before, surface_before, highest = slide.T, slide.surface, [slide.T.max()]

    def friction(v: Value, r: Value) -> Value:
        T = np.maximum(2.0 * slide.T - before, T0)
        if slide.surface is None or surface_before is None:
            surface = None
        else:
            surface = max(2.0 * slide.surface - surface_before, T0)
        return theory(np.maximum(v, MIN_LAW_SPEED_M_S), T, tread.pressure, surface).mu

    def advance_heat(dt: Value, v: Value) -> None:
        nonlocal before, surface_before  # the two previous steps, from which `friction` extrapolates
        before, surface_before = slide.T, slide.surface
        slide.step(dt, float(v[0]))
        highest.append(slide.T.max())

    path = _integrate_path(tread, friction, np.array([tread.speed * slip]), steps, advance_heat)
    return path, np.array(highest)


def _integrate_path(
    tread: TreadBlock,
    friction: Callable[..., Value],
    pull: np.ndarray,
    steps: int,
    after_step: Callable[..., None] = lambda dt, v: None,
) -> FootprintPath:
    """Second-order backward differences over equal steps; the speed is solved implicitly, including sticking."""
    k, m, p = tread.stiffness, tread.mass, tread.pressure
    dt = tread.contact_time / steps
    u, r, v, mu = (np.zeros((steps + 1, len(pull))) for _ in range(4))
    mu[0] = friction(v[0], r[0])
    for n in range(steps):
        b = dt if n == 0 else dt * 2 / 3
        u0, r0, v0 = (x[0] if n == 0 else (4 * x[n] - x[n - 1]) / 3 for x in (u, r, v))
        drive, drag = m * v0 / b + k * (u0 + b * pull), m / b + k * b
        ahead = 2 * v[n] - v[n - 1] if n else v[n]
        v[n + 1], mu[n + 1] = _solve_speed(lambda v, r0=r0, b=b: p * friction(v, r0 + b * v), drive, drag, ahead)
        mu[n + 1] /= p
        u[n + 1], r[n + 1] = u0 + b * (pull - v[n + 1]), r0 + b * v[n + 1]
        after_step(dt, np.maximum(r[n + 1] - r[n], 0.0) / dt)
    return FootprintPath(dt * np.arange(steps + 1), u, r, v, mu, k * u / p)


def _solve_speed(
    stress: Callable[..., Any], drive: np.ndarray, drag: float, guess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds v >= 0 (m,) with drag v + stress(v) = drive, 0 where the block sticks, and the stress (Pa).

    Newton's method safeguarded by bisection.  Raises SolverFailure.
    """
    rest = stress(np.zeros_like(drive))
    free = drive > rest
    if not free.any():
        return np.zeros_like(drive), rest
    low, high = np.zeros_like(drive), np.where(free, drive / drag, 0.0)
    v = np.minimum(np.maximum(guess, 1e-4), high)
    for _ in range(MAX_SPEED_ITERATIONS):
        here = stress(v)
        miss = drag * v + here - drive
        low, high = np.where(miss < 0, v, low), np.where(miss < 0, high, v)
        step = 1e-6 * v + 1e-12
        slope = drag + (stress(v + step) - here) / step
        new = v - miss / np.where(slope > 0, slope, np.inf)
        back = np.where(low > 0, 0.5 * (low + high), 0.1 * v)  # friction is concave: Newton converges fast from below
        new = np.where((slope > 0) & (new >= low) & (new <= high), new, back)
        new = np.where(free, new, 0.0)
        change, v = np.abs(new - v), new
        if np.all(change <= SPEED_TOLERANCE * np.maximum(v, 1e-3)):
            return v, np.where(free, drive - drag * v, rest)
    raise SolverFailure(f"tread block: no sliding speed found, {change.max():.2g} m/s apart")


def law_deviation(path: FootprintPath, law: ColdHotLaw) -> float:
    """Largest relative deviation of the law from the friction along a path, at the path's speed and slid distance."""
    on = path.speed > 0
    return float(np.max(np.abs(law(path.speed, path.slid)[on] / path.mu[on] - 1.0))) if on.any() else 0.0


def mean_traction(path: FootprintPath) -> np.ndarray:
    """Mean over the footprint of k_t u/p (m,): the friction of the whole block at every slip."""
    mean: np.ndarray = np.trapezoid(path.traction, path.time, axis=0) / path.time[-1]
    return mean


def is_chattering(path: FootprintPath, pull: Value) -> np.ndarray:
    """Paths (m,) that stop again after sliding at half of `pull` (m/s): stick-slip by friction falling with speed."""
    pull = np.asarray(pull, dtype=float)
    fast = np.maximum.accumulate(path.speed > 0.5 * pull, axis=0)
    stops: np.ndarray = np.any(fast & (path.speed < 0.1 * pull), axis=0)
    return stops


def refine_steps(
    tread: TreadBlock, law: ColdHotLaw, slips: Value, first_steps: int, max_steps: int
) -> tuple[FootprintPath, float]:
    """The law's path at slips (m,), and the relative change of the footprint's friction by twice its steps.

    Starting from `first_steps`, steps are doubled until the change is below STEP_DOUBLING_TOLERANCE, twice in a row if
    the block chatters, or up to `max_steps`.  Raises SolverFailure.
    """
    pull, before = tread.speed * np.asarray(slips, dtype=float), 1.0
    path = pass_footprint(tread, law, slips, first_steps)
    while True:
        twice = pass_footprint(tread, law, slips, 2 * (len(path.time) - 1))
        change = float(np.max(np.abs(mean_traction(twice) / mean_traction(path) - 1.0)))
        is_reliable = before < STEP_DOUBLING_TOLERANCE or not is_chattering(twice, pull).any()
        if (change < STEP_DOUBLING_TOLERANCE and is_reliable) or len(twice.time) - 1 > max_steps:
            return path, change
        path, before = twice, change


@dataclass(frozen=True, eq=False)
class RollingResult:
    """A tread block at `slips` (m,): `path` with the law, `kernel` paths and highest T_q (K), one per slip.

    Both use the same steps; twice as many change the law's friction of the footprint by the fraction `step_error`.
    `friction` is that of the whole footprint at `SWEPT_SLIPS`, with its maximum `peak`; `chatter_swept` marks slips
    with chatter; T0 in K.
    """

    tread: TreadBlock
    law: ColdHotLaw
    spots: ContactSpots
    T0: float
    slips: np.ndarray
    path: FootprintPath
    kernel: tuple[tuple[FootprintPath, np.ndarray], ...]
    friction: np.ndarray
    peak: CurvePeak
    chatter_swept: np.ndarray
    step_error: float

    @property
    def has_chatter(self) -> np.ndarray:
        """Slips (m,) with stick-slip, by the law or by the kernel theory."""
        pull = self.tread.speed * self.slips
        kernel = [is_chattering(path, v)[0] for (path, _), v in zip(self.kernel, pull, strict=True)]
        either: np.ndarray = is_chattering(self.path, pull) | np.array(kernel)
        return either

    @property
    def hot_fraction_at_exit(self) -> np.ndarray:
        """Position (m,) of the kernel theory's friction at the exit, from the cold (0) to the hot branch (1).

        Nan where the branches differ by less than 1 %.
        """
        ends = ((self.law.branch_friction(p.speed[-1, 0]), p.mu[-1, 0]) for p, _ in self.kernel)
        return np.array(
            [
                (cold - mu) / (cold - hot) if abs(cold - hot) >= MIN_BRANCH_DIFFERENCE * abs(cold) else np.nan
                for (cold, hot), mu in ends
            ]
        )

    def as_dict(self) -> dict[str, Any]:
        """Numbers for JSON; lengths in m, speeds in m/s, temperatures in degC."""
        rows = []
        each = zip(self.slips, self.kernel, self.hot_fraction_at_exit, self.has_chatter, strict=True)
        for i, (slip, (path, T), hot_fraction, chatter) in enumerate(each):
            rows.append({
                "slip": float(slip), "slid_m": float(path.slid[-1, 0]), "sheared_m": float(path.shear[-1, 0]),
                "slip_distance_m": float(slip * self.tread.footprint), "speed_at_exit_m_s": float(path.speed[-1, 0]),
                "mu_at_exit": float(path.mu[-1, 0]), "from_cold_to_hot": float(hot_fraction),
                "T_max_degC": float(T.max() - KELVIN),
                "friction": float(mean_traction(path)[0]), "friction_law": float(mean_traction(self.path)[i]),
                "law_deviates": law_deviation(path, self.law), "chatter": bool(chatter),
            })  # fmt: skip
        return {
            "slips": rows,
            "maximum": {"slip": self.peak.at, "friction": self.peak.value, "at_edge": self.peak.is_at_edge,
                        "at_first": self.peak.first, "at_last": self.peak.last,
                        "slip_over_D_per_l": self.peak.at * self.tread.footprint / self.spots.diameter},
            "curve": {"slip": SWEPT_SLIPS.tolist(), "friction": self.friction.tolist(),
                      "chatter": self.chatter_swept.tolist()},
            "steps": len(self.path.time) - 1, "moved_by_twice_the_steps": self.step_error,
            "memory_m": float(self.law.memory_distance(self.tread.speed * self.peak.at)),
            "contact_time_s": self.tread.contact_time, "ringing": self.tread.ringing_ratio,
        }  # fmt: skip

    def csv_rows(self) -> Iterator[str]:
        """Columns and rows of the paths: law and kernel theory at every slip."""
        yield "slip,theory,time_s,slid_m,shear_m,speed_m_s,mu,traction"
        for i, slip in enumerate(self.slips):
            for name, path, j in (("law", self.path, i), ("kernel", self.kernel[i][0], 0)):
                shear, slid, speed, mu, traction = (a[:, j] for a in path[1:])
                for row in zip(path.time, slid, shear, speed, mu, traction, strict=True):
                    yield f"{slip:g},{name}," + ",".join(f"{x:.8g}" for x in row)


def compute_rolling(
    tread: TreadBlock,
    law: ColdHotLaw,
    theory: PerssonTheory,
    rubber: Material,
    spots: ContactSpots,
    T0: float,
    slips: Value,
    watch: Callable[..., Any] | None = None,
) -> RollingResult:
    """Pass a tread block through its footprint at every slip, with the law and with the kernel theory.

    `watch(done, total)` is called after every slip.  Raises SolverFailure.
    """
    slips = np.asarray(slips, dtype=float)
    path, step_error = refine_steps(tread, law, slips, MIN_KERNEL_STEPS, MAX_KERNEL_STEPS)
    kernel = []
    for n, slip in enumerate(slips):
        kernel.append(pass_with_heat_memory(tread, theory, rubber, spots, T0, slip, len(path.time) - 1))
        if watch:
            watch(n + 1, len(slips))
    swept, _ = refine_steps(tread, law, SWEPT_SLIPS, MIN_LAW_STEPS, MAX_LAW_STEPS)
    friction = mean_traction(swept)
    return RollingResult(
        tread, law, spots, T0, slips, path, tuple(kernel), friction, find_peak(SWEPT_SLIPS, friction),
        is_chattering(swept, tread.speed * SWEPT_SLIPS), step_error,
    )  # fmt: skip
