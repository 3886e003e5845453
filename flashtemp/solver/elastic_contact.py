"""Nominal contact pressure of an elastic block that a holder presses on a rigid road (theory.md, eqs. (21) to (24)).

The tractions on the face displace it (`physics.elastic_block`).  The face cannot enter the road, and the contact does
not pull.  A and B are the compliances of the face under pressure and under traction, E is Young's modulus, a are the
areas of the columns, xi = 1 - 2x/L, and s is the fraction of the friction that shears the block:

    u = (A p + s B mu p)/E + g,     p >= 0,   u - c - t xi >= 0,   p (u - c - t xi) = 0,
    sum a p = P,                    c approach of the holder, m,
    sum a p (L xi/2 - h mu) + 2 t/(C W L) = 0    t tilt of the holder at the leading edge, m; t = 0 if it is guided.

g is the gap of each column without load: profile, wear and thermal expansion.  C is the compliance of the holder
(rad per N m), W the width of the block and h the height of the pivot.  Friction mu follows the local pressure and
temperature.

The inequalities are solved by the primal-dual active set method, a semismooth Newton method (Hintermüller, Ito and
Kunisch 2003, SIAM J. Optim. 13, 865).  It may cycle.  After MAX_FREE_SET_CHANGES changes of the set only the column of
least index changes (Murty 1974, Math. Program. 7, 138), which is finite for a positive definite compliance.  Friction
that falls with the temperature of the spots may make it cycle too; then the tilt is bracketed
(`_settle_by_bracketing`).
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

PRESSURE_RTOL = 1e-12  # change by the last Newton step, as a fraction of the load
# at half or double: flux evaluations 1048 to 1023 and 1043, CPU unchanged, error in time 5.7e-4 to 4.5e-4 and 8.7e-4
RENEWAL_STEP_RATIO = 0.02  # a Newton step larger than this fraction of the previous one requires a new Jacobian
MAX_NEWTON_STEPS = 200
# at half, double or infinity friction and CPU of two soft holders are unchanged: it only makes the method finite
MAX_FREE_SET_CHANGES = 20  # changes of the active set after which only the column of least index changes
FIRST_TILT_STEP = 1e-3  # first step of the bracket as a fraction of the tilt, at least the mean pressure
# run-in map: the next balance is 0.1 % away where runs continue, 2 to 10 % where the holder snaps over
SNAP_TILT_FRACTION = 0.01  # of the tilt: the holder does not reach a balance farther away continuously
TILT_JUMP_RTOL = 10.0  # times `rtol`: a larger unbalanced moment means that the moments jump across zero
TIPPING_MESSAGE = "the friction moment tips the block over its edge: no contact pressure balances it"
SNAP_OVER_MESSAGE = (
    "the holder snaps over: friction falls with the temperature of the spots faster than the holder resists, and no "
    "tilt nearby balances the moments; use a stiffer holder or a lower pivot"
)
NO_PRESSURE_MESSAGE = "no contact pressure of the elastic block was found"


class HolderSupport(NamedTuple):
    """The holder: fraction `shear` s of the friction that shears the block, and height `arm` h (m) of its pivot.

    `resistance` against a tilt is 2/(C W L) (1/m per N/m of moment), inf for a guided holder.
    """

    shear: float = 0.0
    arm: float = 0.0
    resistance: float = np.inf

    @property
    def is_guided(self) -> bool:
        return self.resistance == np.inf


class ContactJacobian(NamedTuple):
    """Jacobian for a set of columns in contact, derivatives d(mu p)/dp (columns,) and a holder, in block form.

    `inverse` (planes, n, n) solves the equations of the columns for a fixed holder.  `lifted` (columns, 2) is the
    change of pressure by approach and tilt, `carried` (2, columns) that of load and moment by pressure, and `holding`
    (2, 2) the inverse of the Schur complement of the holder's two equations.
    """

    touching: npt.NDArray[np.bool_]
    slopes: Array
    holder: HolderSupport
    inverse: Array
    lifted: Array
    carried: Array
    holding: Array

    def solve_columns(self, r: Array) -> Array:
        """Change of pressure by a residual r (columns,) for a fixed holder; column = line times planes + plane."""
        planes = len(self.inverse)
        changed: Array = (self.inverse @ r.reshape(-1, planes).T[..., None])[..., 0].T.ravel()
        return changed

    def solve(self, r: Array, balance: Array) -> tuple[Array, Array]:
        """Changes of pressure (columns,), and of approach and tilt (2,), by residuals of columns and holder."""
        fixed_holder = self.solve_columns(r)
        holder_change = self.holding @ (balance - self.carried @ fixed_holder)
        return fixed_holder + self.lifted @ holder_change, holder_change


class ContactSolution(NamedTuple):
    """A solution: pressure (columns,) Pa, approach and tilt (times stiffness, Pa), its Jacobian and hardness E/E_0."""

    pressure: Array
    approach: float
    tilt: float
    jacobian: ContactJacobian
    hardness: Any = 1.0


@dataclass(frozen=True)
class ElasticFoundation:
    """Columns of area `dx` (m2 per m across) at `x` (m) under a block of `length` (m) and Young's `modulus` (Pa).

    `stiffness` (Pa/m) scales lengths to pressures, so that all unknowns are of similar size; results do not depend on
    it.  Newton's method ends with a step that changes less than the fraction `rtol` of the load.  If there are more
    columns than `compliance` has, the block is computed as planes next to each other, each in plane strain.
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
        """Displacement times stiffness (columns,) Pa by a traction (columns,) Pa."""
        moved: Array = (compliance @ traction.reshape(-1, self._plane_count)).ravel()
        return moved

    def displace_face(self, pressure: Array) -> Array:
        """Displacement (columns,) m of the face towards the holder by a pressure (columns,) Pa."""
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
        """Pressure with the given `mean` (Pa) over a `gap` g (columns,) m, for a block `hardness` times as stiff.

        `friction` is needed only where friction shears or tilts the block, else None.  `start` is a nearby solution.
        The last evaluation of `friction` is at the pressure returned, so that callers can use its by-products.  If
        Newton's method fails for a holder that resists tilt, the tilt is bracketed.  Raises SolverFailure if the block
        tips over.
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
        """The solution of `solve_equilibrium` by the primal-dual active set method."""
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
            # an iterate may have p < 0, and with negative heat the spots may have no consistent temperature
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
                        continue  # repeat the step from this point with its own derivatives
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
        """The solution of `solve_equilibrium` with the tilt next to that of `start`, in the direction of the moments.

        The moments at a given tilt are continuous in the tilt, and a holder that resists dominates at a large tilt.  So
        Brent's method (1973, Algorithms for Minimization without Derivatives, chapter 4) finds their balance where
        Newton's method cycles, or where its branch of solutions has ended because the holder snaps over.
        """
        fixed, last = HolderSupport(holder.shear), start
        first = 0.0 if start is None else start.tilt

        def unbalance(t: float) -> float:
            nonlocal last
            tilted = gap - t * self._edge_coordinate / (hardness * self.stiffness)
            last = self._settle_by_newton(tilted, mean, fixed, friction, last, hardness)
            levers = 0.5 * self.length * self._edge_coordinate - holder.arm * friction(last.pressure)
            return float(self._moment_balance(holder, t / hardness, levers * last.pressure))

        at, initial = first, unbalance(first)
        step = -np.sign(initial) * max(FIRST_TILT_STEP * abs(first), mean)
        for _ in range(MAX_NEWTON_STEPS):
            beyond = unbalance(at + step)
            if beyond * initial <= 0.0:
                break
            at, step = at + step, 2.0 * step
            if start is not None and abs(at - first) > SNAP_TILT_FRACTION * abs(first):
                raise SolverFailure(SNAP_OVER_MESSAGE)
        else:
            raise SolverFailure(TIPPING_MESSAGE)
        tilt = brentq(unbalance, *sorted((at, at + step)), xtol=self.rtol * mean, rtol=self.rtol)
        if abs(unbalance(tilt)) > TILT_JUMP_RTOL * self.rtol * mean:
            raise SolverFailure(NO_PRESSURE_MESSAGE)
        assert last is not None
        p = last.pressure
        J = self._build_jacobian(last.jacobian.touching, self._traction_slopes(p, friction), holder)
        mu = friction(p)  # the last evaluation must be at the solution, without the complex step of the derivatives
        return ContactSolution(p, last.approach, self._balanced_tilt(holder, p, mu, tilt, hardness), J, hardness)

    def derive_solution(
        self, solution: ContactSolution, gap: Array, mean: float, friction: FrictionLaw | None, hardness: Any
    ) -> ContactSolution:
        """The solution with the derivative that a complex step in `gap`, `hardness` or the friction law carries.

        The active set is fixed.  The Jacobian of the real solution is only approximate, so the imaginary parts are
        iterated to convergence.
        """
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
        """The solution as a `PressureSolution`, which both foundations share."""
        J, tilt = solution.jacobian, solution.tilt / (solution.hardness * self.stiffness)
        return PressureSolution(solution.pressure, tilt, J.touching, J.holder.resistance)

    def renew_jacobian(self, solution: ContactSolution, slopes: Array) -> ContactSolution:
        """The same solution with a Jacobian for other derivatives d(mu p)/dp (columns,)."""
        J = solution.jacobian
        if not J.holder.shear and J.holder.is_guided:
            return solution
        return solution._replace(jacobian=self._build_jacobian(J.touching, slopes, J.holder))

    def pressure_response(self, solution: ContactSolution) -> ElasticResponse:
        """Linear response of the pressure to worn depth and friction around a solution."""
        J = solution.jacobian
        return ElasticResponse(self, J, -float(np.real(solution.hardness)) * self.stiffness * J.touching)

    def _equation_residual(
        self, p: Array, c: Any, t: Any, g: Array, mean: float, mu: Array | None, J: ContactJacobian, hardness: Any
    ) -> tuple[Array, Array]:
        """Residuals: the gap of columns in contact or the pressure of the others, then load and moment (2,)."""
        holder = J.holder
        pull = 0.0 * p if mu is None else mu * p
        gap = self._scaled_gap(p, pull, c, t, g, holder)
        moments = 0.5 * self.length * self._edge_coordinate * p - holder.arm * pull
        tilts = t if holder.is_guided else self._moment_balance(holder, t / hardness, moments)
        return np.where(J.touching, gap, p), np.array([p @ self.dx / self.dx.sum() - mean, tilts])

    def _scaled_gap(self, p: Array, pull: Array, c: Any, t: Any, g: Array, holder: HolderSupport) -> Array:
        """Gap between face and road times stiffness (columns,) Pa, eq. (22)."""
        gap = self._scaled_motion(self._scaled_normal, p) + g - c - t * self._edge_coordinate
        return gap + holder.shear * self._scaled_motion(self._scaled_shear, pull) if holder.shear else gap

    def _balanced_tilt(self, holder: HolderSupport, p: Array, mu: Array | None, tilt: float, hardness: float) -> float:
        """Tilt (Pa) that balances the moments to rounding, eq. (24), for a holder that resists; else `tilt` itself."""
        if holder.is_guided or holder.resistance == 0.0 or mu is None:
            return tilt
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
        K = np.where(on[..., None], K, np.eye(n))  # a column out of contact has the equation p = 0
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
        """Columns in contact after a Newton step: those with p > 0, and those that would enter the road."""
        pressed, c, t = moved
        on = J.touching & (pressed > 0.0)
        if on.all():
            return on
        pull = 0.0 * p if mu is None else mu * p + J.slopes * (pressed - p)
        return np.where(J.touching, on, self._scaled_gap(pressed, pull, c, t, g, J.holder) < 0.0)

    @staticmethod
    def _traction_slopes(p: Array, friction: FrictionLaw) -> Array:
        """d(mu p)/dp (columns,), with the friction of a column taken as a function of its own pressure only."""
        slopes: Array = np.imag((p + 1j * COMPLEX_STEP) * friction(p + 1j * COMPLEX_STEP)) / COMPLEX_STEP
        return slopes


@dataclass(frozen=True)
class ElasticResponse:
    """Linear response of the pressure (columns,) Pa around a solution with this Jacobian.

    `depth_stiffness` (columns,) Pa/m is the derivative of the residual of the columns by worn depth, negative.
    """

    foundation: ElasticFoundation
    jacobian: ContactJacobian
    depth_stiffness: Array

    def __call__(self, worn: Array) -> Array:
        """Change of pressure (columns,) Pa by a change of worn depth (columns,) m."""
        return self.jacobian.solve(self.depth_stiffness * worn, np.zeros(2))[0]

    def respond_to_traction(self, traction: Array) -> Array:
        """Change of pressure (columns,) Pa by a change of the friction traction (columns,) Pa."""
        J, bed = self.jacobian, self.foundation
        r = -J.holder.shear * J.touching * bed._scaled_motion(bed._scaled_shear, traction)
        moment = 0.0 if J.holder.is_guided else J.holder.arm * (traction @ bed.dx) / bed.length
        return J.solve(r, np.array([0.0, moment]))[0]

    def build_wear_inverse(self, depth_per_pressure: Array) -> Callable[[Array], Array]:
        """The implicit step of the worn depth: solves (1 - diag(g) dp/dw) dw = r for any r.

        `depth_per_pressure` g (columns,) m/Pa is the worn depth of the step per pressure.
        """
        # with the holder fixed the matrix has one block for each plane; the holder's answer to load and moment is of
        # rank 2, so Woodbury's identity leaves one inverse of (2, 2)
        J, planes = self.jacobian, len(self.jacobian.inverse)
        give = self.depth_stiffness.reshape(-1, planes).T
        alone = (
            np.eye(give.shape[1]) - depth_per_pressure.reshape(-1, planes).T[..., None] * J.inverse * give[:, None, :]
        )
        fixed_holder = J._replace(inverse=_invert_matrix(alone))
        spread = depth_per_pressure[:, None] * (J.lifted @ J.holding)
        X = np.stack([fixed_holder.solve_columns(spread[:, k]) for k in (0, 1)], axis=1)

        def carried_load(r: Array) -> Array:
            load_and_moment: Array = J.carried @ J.solve_columns(self.depth_stiffness * r)
            return load_and_moment

        inner = _invert_matrix(np.eye(2) + np.stack([carried_load(X[:, k]) for k in (0, 1)], axis=1))

        def apply_inverse(r: Array) -> Array:
            z = fixed_holder.solve_columns(r)
            changed: Array = z - X @ (inner @ carried_load(z))
            return changed

        return apply_inverse


def _invert_matrix(matrix: Array) -> Array:
    """The inverse, or nan for a singular matrix; it is applied often, and a product is cheaper than two solves."""
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.nan)
