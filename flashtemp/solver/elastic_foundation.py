"""Nominal contact pressure of an elastic block that a holder presses on a rigid road.

The tractions on the face move it (`physics.elastic_block`).  It cannot enter the road, and nothing pulls it down.
A and B are the compliances by pressure and by traction along the face, E is Young's modulus, a are the areas of the
columns, xi = 1 - 2x/L and s is the share of the friction that shears the block:

    u = (A p + s B mu p)/E + g,     p >= 0,   u - c - t xi >= 0,   p (u - c - t xi) = 0,
    sum a p = P,                    approach c of the holder, m,
    sum a p (L xi/2 - h mu) + 2 t/(C W L) = 0    tilt t of the holder at the leading edge, m; a guided one has t = 0.

g is by how far each column would stand off the road without load.  C is the compliance of the holder (rad per N m), W
the width of the block and h the height of the pivot.  Friction mu follows the local pressure and temperature.

The inequalities are solved by the primal-dual active set method, a semismooth Newton method (Hintermüller, Ito and
Kunisch 2003, SIAM J. Optim. 13, 865).  It may cycle.  After MAX_FREE_SET_CHANGES changes of the set one column at a
time changes, that of the least index (Murty 1974, Math. Program. 7, 138): finite for a positive definite compliance.
Friction that falls with the spots' heat makes it cycle too; then the tilt is bracketed (`_settle_by_bracketing`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from flashtemp.errors import SolverFailure
from flashtemp.model.effect_laws import COMPLEX_STEP
from flashtemp.physics.elastic_block import FaceCompliance
from flashtemp.solver.winkler_foundation import PressureSolution

Array = npt.NDArray[Any]
FrictionLaw = Callable[[Array], Array]  # friction coefficient (columns,) at a local pressure (columns,) Pa

PRESSURE_RTOL = 1e-12  # share of the load that a step of Newton's method may still move
# at half or double: flux evaluations 1048 to 1023 and 1043, CPU unchanged, error in time 5.7e-4 to 4.5e-4 and 8.7e-4
RENEWAL_STEP_RATIO = 0.02  # a step that is more than this share of the one before asks for a new Jacobian
MAX_NEWTON_STEPS = 200
# at half, double or without bound friction and CPU of two soft holders stay: kept as the bound that makes it finite
MAX_FREE_SET_CHANGES = 20  # steps with changes of the set, after which the least index alone changes
FIRST_TILT_STEP = 1e-3  # of the tilt, with which its bracket begins, but no less than the mean pressure
# run-in map: the next balance is 0.1 % away where runs go on, 2 to 10 % where they snap
SNAP_TILT_FRACTION = 0.01  # of the tilt: where the next balance is farther, the holder does not get there steadily
TILT_JUMP_RTOL = 10.0  # times `rtol`, of load times length: more is left where the moments jump over their balance
TIPPING_MESSAGE = "the friction moment tips the block over its edge: no pressure carries it"
SNAPS = (
    "the holder snaps over: friction falls with the spots' heat faster than the holder resists, and no tilt nearby "
    "balances the moments; stiffen the holder or lower its pivot"
)
NO_PRESSURE_MESSAGE = "no contact pressure of the elastic block was found"


class HolderSupport(NamedTuple):
    """What the holder does: share `shear` of the friction that shears the block, `arm` h (m), and what resists a tilt.

    `resistance` 2/(C W L) (1/m per N/m of moment), inf where the holder is guided.
    """

    shear: float = 0.0
    arm: float = 0.0
    resistance: float = np.inf

    @property
    def is_guided(self) -> bool:
        return self.resistance == np.inf


class ContactJacobian(NamedTuple):
    """Jacobian for a set of columns in contact, slopes (columns,) of mu p in p, and a holder.

    `inverse` (planes, n, n) of the equations of the columns; `lifted` (columns, 2) what an approach and a tilt do to
    the pressure; `carried_load` (2, columns) load and moment by pressure; `holding` (2, 2) the reverse for the holder.
    """

    touching: npt.NDArray[np.bool_]
    slopes: Array
    holder: HolderSupport
    inverse: Array
    lifted: Array
    carried: Array
    holding: Array

    def solve_columns(self, r: Array) -> Array:
        """Change of pressure by r (columns,) while the holder stays; column = line times planes + plane."""
        planes = len(self.inverse)
        changed: Array = (self.inverse @ r.reshape(-1, planes).T[..., None])[..., 0].T.ravel()
        return changed

    def solve(self, r: Array, carry: Array) -> tuple[Array, Array]:
        """Changes of pressure (columns,) and of approach and tilt (2,) by r of the columns and of load and moment."""
        alone = self.solve_columns(r)
        held = self.holding @ (carry - self.carried @ alone)
        return alone + self.lifted @ held, held


class ContactSolution(NamedTuple):
    """An answer: pressure (columns,) Pa, approach and tilt (Pa), the Jacobian that led to it and hardness E/E_0."""

    pressure: Array
    approach: float
    tilt: float
    jacobian: ContactJacobian
    hardness: Any = 1.0


@dataclass(frozen=True)
class ElasticFoundation:
    """Columns of area `dx` (m2 per m across) at `x` (m) under a block of `length` (m) and Young's `modulus` (Pa).

    `stiffness` (Pa/m) turns lengths into pressures, so that all unknowns are alike in size; no answer depends on it.
    Newton's method ends with a step that moves less than the share `rtol` of the load.

    A `compliance` of n columns for more columns than that stands for planes side by side, each in plane strain.
    """

    x: Array
    dx: Array
    length: float
    modulus: float
    stiffness: float
    compliance: FaceCompliance
    rtol: float = PRESSURE_RTOL

    @cached_property
    def _scaled_normal(self) -> Array:
        scaled: Array = np.ascontiguousarray(self.compliance.normal * (self.stiffness / self.modulus))
        return scaled

    @cached_property
    def _scaled_shear(self) -> Array:
        scaled: Array = np.ascontiguousarray(self.compliance.shear * (self.stiffness / self.modulus))
        return scaled

    @cached_property
    def _edge_coordinate(self) -> Array:
        """1 at the leading edge (columns,), -1 at the trailing one."""
        xi: Array = 1.0 - 2.0 * self.x / self.length
        return xi

    @property
    def _plane_count(self) -> int:
        return len(self.x) // len(self._scaled_normal)

    def _scaled_motion(self, compliance: Array, traction: Array) -> Array:
        """Motion times stiffness (columns,) Pa by a traction (columns,) Pa."""
        moved: Array = (compliance @ traction.reshape(-1, self._plane_count)).ravel()
        return moved

    def displace_face(self, pressure: Array) -> Array:
        """Motion (columns,) m of the face towards the holder by a pressure (columns,) Pa."""
        return self._scaled_motion(self._scaled_normal, pressure) / self.stiffness

    def solve_equilibrium(
        self,
        gap: Array,
        mean: float,
        holder: HolderSupport,
        friction: FrictionLaw | None,
        start: ContactSolution | None,
        hardness: float = 1.0,
    ) -> ContactSolution:
        """Pressure that carries the `mean` (Pa), over a `gap` g (columns,) m, by a block `hardness` times as stiff.

        `friction` is asked where it shears or tips the block, else None.  `start` is an answer nearby.  The answer's
        pressure is one at which friction was asked last.  Raises SolverFailure when the block tips over.

        Where Newton's method fails under a holder that resists, its tilt is bracketed.
        """
        try:
            return self._settle_by_newton(gap, mean, holder, friction, start, hardness)
        except SolverFailure:
            if friction is None or holder.is_guided or holder.resistance == 0.0:
                raise
            return self._settle_by_bracketing(gap, mean, holder, friction, start, hardness)

    def _settle_by_newton(
        self,
        gap: Array,
        mean: float,
        holder: HolderSupport,
        friction: FrictionLaw | None,
        start: ContactSolution | None,
        hardness: float,
    ) -> ContactSolution:
        """The answer of `solve_equilibrium` by the primal-dual active set method."""
        n, g = len(self.x), hardness * self.stiffness * gap
        if start is None:
            on = np.ones(n, dtype=np.bool_)
            start = ContactSolution(np.full(n, mean), 0.0, 0.0, self._build_jacobian(on, 0.0 * self.x, holder))
        p, c, t, J, _ = start
        if J.holder != holder:
            J = self._build_jacobian(J.touching, J.slopes, holder)
        last, changes, fresh = np.inf, 0, friction is None
        for _ in range(MAX_NEWTON_STEPS):
            p = np.where(J.touching, p, 0.0)
            # a trial may pull on columns; friction heat below zero has no consistent temperature where mu falls with it
            mu = None if friction is None else friction(np.maximum(p, 0.0))
            step, (dc, dt) = J.solve(*self._equation_residual(p, c, t, g, mean, mu, J, hardness))
            size = np.abs(step) @ self.dx / (mean * self.dx.sum())
            if not np.isfinite(size):
                raise SolverFailure(NO_PRESSURE_MESSAGE if holder.is_guided else TIPPING_MESSAGE)
            moved = p - step, c - dc, t - dt
            on = self._find_contact(p, moved, g, mu, J)
            if np.array_equal(on, J.touching):
                balanced = abs(p @ self.dx - mean * self.dx.sum()) <= 1e-12 * mean * self.dx.sum()
                if size <= self.rtol and balanced:
                    return ContactSolution(
                        p, moved[1], self._balanced_tilt(holder, p, mu, moved[2], hardness), J, hardness
                    )
                if friction is not None and size > RENEWAL_STEP_RATIO * last:
                    if not fresh:
                        slopes = self._traction_slopes(np.maximum(p, 0.0), friction)
                        J, fresh = self._build_jacobian(J.touching, slopes, holder), True
                        continue  # the same point once more, with its own slopes
                    fresh = False
                last = size
            else:
                changes += 1
                if changes > MAX_FREE_SET_CHANGES:
                    least = int(np.argmax(on != J.touching))
                    on = J.touching.copy()
                    on[least] = not on[least]
                if not on.any():
                    raise SolverFailure(NO_PRESSURE_MESSAGE if holder.is_guided else TIPPING_MESSAGE)
                J, last = self._build_jacobian(on, J.slopes, holder), np.inf
            p, c, t = moved
        raise SolverFailure(f"{NO_PRESSURE_MESSAGE} in {MAX_NEWTON_STEPS} steps")

    def _settle_by_bracketing(
        self,
        gap: Array,
        mean: float,
        holder: HolderSupport,
        friction: FrictionLaw,
        start: ContactSolution | None,
        hardness: float,
    ) -> ContactSolution:
        """The answer of `solve_equilibrium` whose tilt is next to that of `start`, to the side to which the moments push.

        Moments at a given tilt are continuous in it, and a holder that resists wins at a large one: Brent's method
        (1973, Algorithms for Minimization without Derivatives, chapter 4) finds their balance wherever Newton's cycles
        or has left a branch that ended, where the holder snaps over.
        """
        fixed, last = HolderSupport(holder.shear), start
        first = 0.0 if start is None else start.tilt

        def unbalance(t: float) -> float:
            nonlocal last
            tilted = gap - t * self._edge_coordinate / (hardness * self.stiffness)
            last = self._settle_by_newton(tilted, mean, fixed, friction, last, hardness)
            levers = 0.5 * self.length * self._edge_coordinate - holder.arm * friction(last.pressure)
            return float(self._moment_balance(holder, t / hardness, levers * last.pressure))

        at, left = first, unbalance(first)
        step = -np.sign(left) * max(FIRST_TILT_STEP * abs(first), mean)
        for _ in range(MAX_NEWTON_STEPS):
            beyond = unbalance(at + step)
            if beyond * left <= 0.0:
                break
            at, step = at + step, 2.0 * step
            if start is not None and abs(at - first) > SNAP_TILT_FRACTION * abs(first):
                raise SolverFailure(SNAPS)
        else:
            raise SolverFailure(TIPPING_MESSAGE)
        tilt = brentq(unbalance, *sorted((at, at + step)), xtol=self.rtol * mean, rtol=self.rtol)
        if abs(unbalance(tilt)) > TILT_JUMP_RTOL * self.rtol * mean:
            raise SolverFailure(NO_PRESSURE_MESSAGE)
        assert last is not None
        p = last.pressure
        J = self._build_jacobian(last.jacobian.touching, self._traction_slopes(p, friction), holder)
        mu = friction(p)  # asked last at the answer, without the step of the slopes
        return ContactSolution(p, last.approach, self._balanced_tilt(holder, p, mu, tilt, hardness), J, hardness)

    def derive_solution(
        self, solution: ContactSolution, gap: Array, mean: float, friction: FrictionLaw | None, hardness: Any
    ) -> ContactSolution:
        """The answer with the derivative that a complex step in `gap`, `hardness` or what friction sees passes on."""
        J, g = solution.jacobian, hardness * self.stiffness * gap
        p: Array = solution.pressure + 0j
        c: Any = solution.approach
        t: Any = solution.tilt
        for _ in range(MAX_NEWTON_STEPS):
            mu = None if friction is None else friction(p)
            step, (dc, dt) = J.solve(*(np.imag(r) for r in self._equation_residual(p, c, t, g, mean, mu, J, hardness)))
            p, c, t = p - 1j * step, c - 1j * dc, t - 1j * dt
            if np.abs(step).max() <= 1e-13 * np.abs(p.imag).max():
                return ContactSolution(p, c, t, J, hardness)
        raise SolverFailure("the derivative of the contact pressure was not found")

    def to_pressure_solution(self, solution: ContactSolution) -> PressureSolution:
        """The answer as the contact sees it."""
        J, tilt = solution.jacobian, solution.tilt / (solution.hardness * self.stiffness)
        return PressureSolution(solution.pressure, tilt, J.touching, J.holder.resistance)

    def renew_jacobian(self, solution: ContactSolution, slopes: Array) -> ContactSolution:
        """The same answer with other slopes (columns,) of mu p in p, of which its Jacobian is made anew."""
        J = solution.jacobian
        if not J.holder.shear and J.holder.is_guided:
            return solution
        return solution._replace(jacobian=self._build_jacobian(J.touching, slopes, J.holder))

    def pressure_response(self, solution: ContactSolution) -> ElasticResponse:
        """How pressure follows worn depth and friction around an answer, by its Jacobian."""
        J = solution.jacobian
        return ElasticResponse(self, J, -float(np.real(solution.hardness)) * self.stiffness * J.touching)

    def _equation_residual(
        self, p: Array, c: Any, t: Any, g: Array, mean: float, mu: Array | None, J: ContactJacobian, hardness: Any
    ) -> tuple[Array, Array]:
        """What is left of the equations: gaps of columns in contact and pressure of the others, load and moment."""
        holder = J.holder
        pull = 0.0 * p if mu is None else mu * p
        gap = self._scaled_gap(p, pull, c, t, g, holder)
        moments = 0.5 * self.length * self._edge_coordinate * p - holder.arm * pull
        tilts = t if holder.is_guided else self._moment_balance(holder, t / hardness, moments)
        return np.where(J.touching, gap, p), np.array([p @ self.dx / self.dx.sum() - mean, tilts])

    def _scaled_gap(self, p: Array, pull: Array, c: Any, t: Any, g: Array, holder: HolderSupport) -> Array:
        """Distance of the columns from the road times stiffness (columns,) Pa."""
        gap = self._scaled_motion(self._scaled_normal, p) + g - c - t * self._edge_coordinate
        return gap + holder.shear * self._scaled_motion(self._scaled_shear, pull) if holder.shear else gap

    def _balanced_tilt(self, holder: HolderSupport, p: Array, mu: Array | None, found: float, hardness: float) -> float:
        """Tilt (Pa) of a holder that resists: that which balances the moments to rounding; else as `found`."""
        if holder.is_guided or holder.resistance == 0.0 or mu is None:
            return found
        moments = (0.5 * self.length * self._edge_coordinate - holder.arm * mu) * p
        return float(-hardness * self.stiffness * (moments @ self.dx) / holder.resistance)

    def _moment_balance(self, holder: HolderSupport, t: Any, moments: Array) -> Any:
        return moments @ self.dx / self.length + holder.resistance * t / (self.stiffness * self.length)

    def _build_jacobian(self, touching: npt.NDArray[np.bool_], slopes: Array, holder: HolderSupport) -> ContactJacobian:
        planes, n = self._plane_count, len(self._scaled_normal)
        on, slope = touching.reshape(n, planes).T, slopes.reshape(n, planes).T
        K = np.broadcast_to(self._scaled_normal, (planes, n, n))
        if holder.shear:
            K = K + holder.shear * self._scaled_shear * slope[:, None, :]
        K = np.where(on[..., None], K, np.eye(n))
        lift = touching[:, None] * np.stack([np.ones(len(self.x)), self._edge_coordinate], axis=1)
        carried, own = np.zeros((2, len(self.x))), np.zeros((2, 2))
        carried[0], own[1, 1] = self.dx / self.dx.sum(), 1.0
        if not holder.is_guided:
            carried[1] = (0.5 * self.length * self._edge_coordinate - holder.arm * slopes) * self.dx / self.length
            own[1, 1] = holder.resistance / (self.stiffness * self.length)
        J = ContactJacobian(touching, slopes, holder, _invert_matrix(K), lift, carried, own)
        lifted = np.stack([J.solve_columns(lift[:, k]) for k in (0, 1)], axis=1)
        return J._replace(lifted=lifted, holding=_invert_matrix(own + carried @ lifted))

    def _find_contact(
        self, p: Array, moved: tuple[Array, float, float], g: Array, mu: Array | None, J: ContactJacobian
    ) -> Array:
        """Columns in contact after a step: those still pressed, and those that would sink into the road."""
        pressed, c, t = moved
        on = J.touching & (pressed > 0.0)
        if on.all():
            return on
        pull = 0.0 * p if mu is None else mu * p + J.slopes * (pressed - p)
        return np.where(J.touching, on, self._scaled_gap(pressed, pull, c, t, g, J.holder) < 0.0)

    @staticmethod
    def _traction_slopes(p: Array, friction: FrictionLaw) -> Array:
        """d(mu p)/dp (columns,), as if every column's friction followed its own pressure alone."""
        pulled: Array = np.imag((p + 1j * COMPLEX_STEP) * friction(p + 1j * COMPLEX_STEP)) / COMPLEX_STEP
        return pulled


@dataclass(frozen=True)
class ElasticResponse:
    """Change of pressure (columns,) Pa by small changes, around an answer with this Jacobian.

    `depth_stiffness` (columns,) Pa/m turns worn depth into what is left of the equations.
    """

    foundation: ElasticFoundation
    jacobian: ContactJacobian
    depth_stiffness: Array

    def __call__(self, worn: Array) -> Array:
        """By a change of worn depth (columns,) m."""
        return self.jacobian.solve(self.depth_stiffness * worn, np.zeros(2))[0]

    def respond_to_traction(self, traction: Array) -> Array:
        """By a change of the friction traction (columns,) Pa at the same pressure."""
        J, bed = self.jacobian, self.foundation
        r = -J.holder.shear * J.touching * bed._scaled_motion(bed._scaled_shear, traction)
        moment = 0.0 if J.holder.is_guided else J.holder.arm * (traction @ bed.dx) / bed.length
        return J.solve(r, np.array([0.0, moment]))[0]

    def build_inverse(self, gain: Array) -> Callable[[Array], Array]:
        """r -> (1 - diag(gain) dp/dw)^-1 r by the Woodbury identity; `gain` (columns,) m/Pa."""
        J, planes = self.jacobian, len(self.jacobian.inverse)
        give = self.depth_stiffness.reshape(-1, planes).T
        alone = np.eye(give.shape[1]) - gain.reshape(-1, planes).T[..., None] * J.inverse * give[:, None, :]
        undone = J._replace(inverse=_invert_matrix(alone))
        spread = gain[:, None] * (J.lifted @ J.holding)  # what comes back by way of the holder, times what is carried
        X = np.stack([undone.solve_columns(spread[:, k]) for k in (0, 1)], axis=1)

        def carried_load(r: Array) -> Array:
            taken: Array = J.carried @ J.solve_columns(self.depth_stiffness * r)
            return taken

        inner = _invert_matrix(np.eye(2) + np.stack([carried_load(X[:, k]) for k in (0, 1)], axis=1))

        def apply_inverse(r: Array) -> Array:
            z = undone.solve_columns(r)
            changed: Array = z - X @ (inner @ carried_load(z))
            return changed

        return apply_inverse


def _invert_matrix(matrix: Array) -> Array:
    """The inverse, not a number where there is none; a product costs less than two triangular solves."""
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.nan)
