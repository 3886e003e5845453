"""What no result may pass: temperatures beyond sense, and books that do not balance."""

from __future__ import annotations

import numpy as np

from flashtemp.errors import EnergyBalanceError, SolverFailure
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem

RUBBER_AGEING_DEGC = 200.0  # degC from which rubber ages while it slides
MAX_ENERGY_IMBALANCE = 1e-6  # heat that may appear or vanish, relative to all that moved: rounding leaves 1e-15
MAX_PARTITION_ERROR = (
    1e-3  # error of the split between block and road, relative to the same: the integrator leaves 1e-6
)
MIN_RISE_PER_ATOL = 1e3  # times atol: rises whose heat the integrator divides well
MAX_UNDERSHOOT_RATIO, MAX_UNDERSHOOT_K = (
    0.05,
    1.0,
)  # of the largest rise, and K: what a scheme of second order leaves at a sharp front


def check_temperatures(system: PhaseSystem, t: float, T, *, hottest: float, atol: float) -> None:
    """Raise SolverFailure for rises T (K) at time t (s) above `hottest` (K), or below all that could have cooled them.

    `T` may be of cells or of any profile.  The integrator holds the root mean square over all n cells of its local
    error within its tolerance (Hindmarsh et al. 2005, ACM TOMS 31, 363): one cell may err by sqrt(n) times `atol` (K),
    as at the front of road that the start has heated, where BDF above order 1 is not monotone.
    """
    ambient = system.b.scene.ambient
    high, low = float(T.max()), float(T.min())
    if high + ambient > hottest:
        raise SolverFailure(
            f"{high + ambient - KELVIN:.4g} degC is above limits.temperature = {hottest - KELVIN:g} degC, and rubber "
            "chars above 300 degC; give less load, speed or friction, or raise that limit"
        )
    allowed = MAX_UNDERSHOOT_RATIO * max(high, 0.0) + MAX_UNDERSHOOT_K + float(np.sqrt(system.b.n)) * atol
    if low < -allowed and low < (coldest := system.coldest_rise(t)) - allowed:
        raise SolverFailure(
            f"{low + ambient - KELVIN:.4g} degC is below everything that cools, {coldest + ambient - KELVIN:.4g} degC; "
            "give a smaller numerics.rtol or a finer mesh"
        )


def check_energy_balance(run: Run, atol: float) -> Run:
    """The run; AuditFailure where its books do not balance.

    Where no rise is well above the integrator's `atol` (K), nothing is promised of the split between block and road.
    """
    seen = np.ptp(np.concatenate([run.T_block, run.T_spot])) > MIN_RISE_PER_ATOL * atol
    partition = run.partition_error if seen else 0.0
    found = (
        ("energy_imbalance", run.energy_imbalance, MAX_ENERGY_IMBALANCE),
        ("partition_error", partition, MAX_PARTITION_ERROR),
    )
    for name, value, limit in found:
        if not value <= limit:
            raise EnergyBalanceError(
                f"{name} {value:.2g} is above {limit:g}: heat was made or lost on the way, the result is not to be "
                "believed; give a smaller numerics.rtol, and report it if that does not help",
                run,
            )
    return run


def overheating_remarks(run: Run) -> list[str]:
    """What a user should know of temperatures that rubber does not bear for long."""
    hottest = run.summary["T_max_degC"]
    if hottest < RUBBER_AGEING_DEGC:
        return []
    return [f"{hottest:.0f} degC: rubber ages above 200 and chars above 300 degC, none of which is modelled"]
