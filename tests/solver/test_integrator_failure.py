"""A callback that fails: its own exception is raised, and nothing that the binding made of it."""

from __future__ import annotations

import numpy as np
import pytest

from flashtemp.errors import SolverFailure
from flashtemp.model.numerics import installed_bindings
from flashtemp.solver.cvode import BdfIntegrator, IntegratorSettings

FAILS_AT = 0.5


class Decay:
    """dy/dt = -y (1/s) up to the time `FAILS_AT`; one named callback fails afterwards."""

    def __init__(self, failing: str):
        self.failing, self.t = failing, 0.0

    def check(self, name: str) -> None:
        if name == self.failing and self.t > FAILS_AT:
            raise SolverFailure(f"{name} fails")

    def rate(self, t, y, out):
        self.t = t
        self.check("rate")
        out[:] = -y

    def linearise(self, t, y, gamma):
        self.check("linearise")
        self.gamma = gamma
        return self

    def apply_jacobian(self, v, out):
        self.check("apply_jacobian")
        out[:] = -v

    def solve(self, r, z):
        self.check("solve")
        z[:] = r / (1.0 + self.gamma)


def integrate_to_failure(solver: BdfIntegrator) -> None:
    while True:
        solver.step()


@pytest.mark.parametrize("failing", ["rate", "linearise", "apply_jacobian", "solve"])
@pytest.mark.parametrize("binding", installed_bindings())
def test_failed_callback_raises_its_own_exception_without_a_circle(binding, failing):
    solver = BdfIntegrator(binding, Decay(failing), IntegratorSettings(1e-6, 1e-9))
    solver.start(0.0, np.linspace(1.0, 2.0, 5), 20.0)
    with pytest.raises(SolverFailure, match=f"{failing} fails") as caught:
        integrate_to_failure(solver)
    chain = [caught.value]
    while (before := chain[-1].__cause__ or chain[-1].__context__) is not None:
        assert before not in chain
        chain.append(before)
