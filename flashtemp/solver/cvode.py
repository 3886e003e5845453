"""The integrator: CVODE of SUNDIALS by one of two bindings, scikits-odes or scikit-sundae (theory.md, section 8)."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from flashtemp.errors import SolverFailure


@dataclass(frozen=True)
class IntegratorSettings:
    """Tolerances `rtol` (relative) and `atol` (K, J/m), highest BDF `order`, longest step `max_step` (s, 0: none)."""

    rtol: float
    atol: float
    order: int = 3
    max_step: float = 0.0


class LinearOperator(Protocol):
    """A linearised system: `apply_jacobian` writes J v, `solve` writes P^-1 r to the second argument."""

    def apply_jacobian(self, v: np.ndarray, out: np.ndarray) -> None: ...

    def solve(self, r: np.ndarray, z: np.ndarray) -> None: ...


class OdeSystem(Protocol):
    """A system dy/dt = f(t, y): `rate` writes f to `out`, `linearise` returns J and P ~ I - gamma J at (t, y)."""

    def rate(self, t: float, y: np.ndarray, out: np.ndarray) -> None: ...

    def linearise(self, t: float, y: np.ndarray, gamma: float) -> LinearOperator: ...


class _CvodeCallbacks(NamedTuple):
    """The functions that CVODE calls."""

    rate: Callable[..., None]
    times: Callable[..., None]
    setup: Callable[..., None]
    solve: Callable[..., None]


class BdfIntegrator:
    """BDF integration of one segment: `step` advances by one internal step, `interpolate` looks back within it.

    `calls` counts the calls by CVODE.  If a callback fails, its own exception is raised instead of CVODE's message.
    """

    def __init__(self, binding: str, system: OdeSystem, tol: IntegratorSettings):
        self._system = system
        self._linearised: LinearOperator | None = None  # until the first set-up
        self._fault: Exception | None = None
        self.steps, self.t = 0, 0.0
        self.calls = {"rate": 0, "times": 0, "setup": 0, "solve": 0}
        make = _bind_scikits_odes if binding == "scikits-odes" else _bind_scikit_sundae
        callbacks = _CvodeCallbacks(
            self._guard_callback("rate", system.rate),
            self._guard_callback("times", self._apply_jacobian),
            self._guard_callback("setup", self._setup_preconditioner),
            self._guard_callback("solve", self._solve_preconditioner),
        )
        self._start, self._advance, self._interpolate, self._close = make(callbacks, tol)

    def _setup_preconditioner(self, t: float, y: np.ndarray, gamma: float) -> None:
        self._linearised = self._system.linearise(t, y, gamma)

    def _apply_jacobian(self, v: np.ndarray, out: np.ndarray) -> None:
        assert self._linearised is not None
        self._linearised.apply_jacobian(v, out)

    def _solve_preconditioner(self, r: np.ndarray, z: np.ndarray) -> None:
        assert self._linearised is not None
        self._linearised.solve(r, z)

    def _guard_callback(self, name: str, callback: Callable[..., None]) -> Callable[..., None]:
        # an exception must not unwind through C code: keep it, let the binding stop, and raise it in `step`
        def guarded_call(*args):
            if self._fault is not None:
                raise self._fault
            self.calls[name] += 1
            try:
                return callback(*args)
            except Exception as fault:
                self._fault = fault
                raise

        return guarded_call

    def start(self, t: float, y: np.ndarray, stop: float) -> None:
        """Begin at (t, y); the integration never passes `stop`."""
        self.t = t
        self._start(t, y, stop)

    def step(self) -> tuple[float, np.ndarray]:
        """One internal step; returns (t, y) with y a new array.  Raises SolverFailure with CVODE's message."""
        try:
            t, y, reason = self._advance()
        except Exception:
            if self._fault is None:
                raise
        # raised outside the handler: the binding's own error has the fault as its cause, so a link back is a circle
        if self._fault is not None:
            raise self._fault
        if reason:
            raise SolverFailure(reason)
        if t > self.t:  # after an interpolation CVODE first returns the time it had reached
            self.steps += 1
        self.t = t
        return t, y

    def interpolate(self, t: float) -> np.ndarray:
        """Solution at a time within the last step."""
        return self._interpolate(t)

    def close(self) -> None:
        """Release CVODE's memory, for the next start or to the system; the integrator cannot be used afterwards."""
        self._close()
        self._linearised = None


class _ReusableSolver:
    """A CVODE object of scikits-odes with exchangeable callbacks; one object serves many starts of one size.

    The binding never frees the linear solver of an object that ends: 15 to 25 vectors of the size of the problem
    (SUNLinSolFree is not called).  SUNDIALS' own way to integrate a further problem of the same size is CVodeReInit.
    """

    def __init__(self, tol: IntegratorSettings):
        self._tol = tol
        self._solver: Any = None
        self.callbacks: _CvodeCallbacks | None = None

    def start(self, t: float, y: np.ndarray, stop: float) -> None:
        """Begin at (t, y); never pass `stop`."""
        # the binding stores tstop in single precision: rounded up, CVODE never stops before `stop`
        tstop = float(np.nextafter(np.float32(stop), np.float32(np.inf)))
        if self._solver is None:
            self._solver = self._create_solver(tstop)
            self._solver.init_step(t, y)
            return
        for values in gc.get_referents(self._solver):  # the binding also keeps results of earlier stop times
            if isinstance(values, list):
                values.clear()
        assert self.callbacks is not None
        self.callbacks.rate(t, y, np.empty_like(y))  # as init_step does
        self._solver.reinit_IC(t, y)
        self._solver.set_options(tstop=tstop)

    def _create_solver(self, tstop: float) -> Any:
        from scikits_odes_sundials.cvode import CVODE

        def evaluate_rate(t, y, ydot):
            self.callbacks.rate(t, y, ydot)
            return 0

        def setup_preconditioner(t, y, jok, jcur, gamma):
            self.callbacks.setup(t, y, gamma)
            jcur.value = True
            return 0

        def solve_preconditioner(t, y, r, z, gamma, delta, lr):
            self.callbacks.solve(r, z)
            return 0

        def apply_jacobian(v, jv, t, y):
            self.callbacks.times(v, jv)
            return 0

        tol = self._tol
        return CVODE(
            evaluate_rate, lmm_type="BDF", rtol=tol.rtol, atol=tol.atol, order=tol.order, linsolver="spgmr",
            precond_type="left", prec_setupfn=setup_preconditioner, prec_solvefn=solve_preconditioner,
            jac_times_vecfn=apply_jacobian,
            max_steps=100000, max_step_size=tol.max_step, one_step_compute=True,
            err_handler=lambda *report: None, tstop=tstop, old_api=False, maxl=20,
        )  # fmt: skip

    def step(self, t: float, one: bool) -> Any:
        """Advance by one internal step towards t if `one`, else up to t; returns the binding's result."""
        if one:
            return self._solver.step(t)
        self._solver.set_options(one_step_compute=False)
        out = self._solver.step(t)
        self._solver.set_options(one_step_compute=True)
        return out


@cache
def _idle_solvers(size: int, tol: IntegratorSettings) -> list[_ReusableSolver]:
    """Solvers of a size and tolerance that are free for another start."""
    return []


def _bind_scikits_odes(call: _CvodeCallbacks, tol: IntegratorSettings):
    """Functions start, advance, interpolate, close over scikits-odes, whose callbacks get copies of CVODE's vectors."""
    from scikits_odes_sundials.cvode import StatusEnum

    box: dict[str, Any] = {}

    def start(t, y, stop):
        close()
        idle = _idle_solvers(len(y), tol)
        box["idle"], box["stop"] = idle, stop
        box["solver"] = idle.pop() if idle else _ReusableSolver(tol)
        box["solver"].callbacks = call
        box["solver"].start(t, y, stop)

    def advance():
        out = box["solver"].step(box["stop"], one=True)
        bad = out.flag not in (StatusEnum.SUCCESS, StatusEnum.TSTOP_RETURN)
        if bad:
            return 0.0, None, f"CVODE: {out.message or out.flag.name}"
        if out.values.t >= box["stop"]:
            return box["stop"], interpolate(box["stop"]), ""
        return float(out.values.t), out.values.y, ""

    def interpolate(t):
        return box["solver"].step(t, one=False).values.y

    def close():
        if box:
            box["solver"].callbacks = None
            box["idle"].append(box["solver"])
            box.clear()

    return start, advance, interpolate, close


def _bind_scikit_sundae(call: _CvodeCallbacks, tol: IntegratorSettings):
    """Functions start, advance, interpolate, close over scikit-sundae, whose callbacks share CVODE's memory."""
    from sksundae.cvode import CVODE, CVODEJacTimes, CVODEPrecond

    def evaluate_rate(t, y, ydot):
        call.rate(t, y, ydot)

    def setup_preconditioner(t, y, yp, jok, jnew, gamma):
        call.setup(t, y, gamma)
        jnew[0] = 1

    def solve_preconditioner(t, y, yp, r, z, gamma, delta, lr):
        call.solve(r, z)

    def apply_jacobian(t, y, yp, v, jv):
        call.times(v, jv)

    box: dict[str, Any] = {}

    def start(t, y, stop):
        box["stop"] = stop
        box["solver"] = CVODE(
            evaluate_rate, method="BDF", rtol=tol.rtol, atol=tol.atol, max_order=tol.order, linsolver="gmres",
            precond=CVODEPrecond(setup_preconditioner, solve_preconditioner, "left"),
            jactimes=CVODEJacTimes(None, apply_jacobian),
            krylov_dim=20, max_num_steps=100000, max_step=tol.max_step,
        )  # fmt: skip
        box["solver"].init_step(t, y)

    def advance():
        out = box["solver"].step(box["stop"], method="onestep", tstop=box["stop"])
        if not out.success:
            return 0.0, None, f"CVODE: {out.message}"
        return float(out.t), out.y, ""

    def interpolate(t):
        return box["solver"].step(t, method="normal", tstop=box["stop"]).y

    return start, advance, interpolate, box.clear
