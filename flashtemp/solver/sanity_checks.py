"""Checks of every run: temperatures within physical bounds, and an energy balance that closes."""

from __future__ import annotations

import numpy as np

from flashtemp.errors import EnergyBalanceError, SolverFailure
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem

RUBBER_AGEING_DEGC = 200.0  # degC from which rubber ages while it slides
MAX_ENERGY_IMBALANCE = 1e-6  # heat created or lost, relative to all heat that moved; rounding gives 1e-15
MAX_PARTITION_ERROR = 1e-3  # error of the split between block and road, relative to the same; usually 1e-6
MIN_RISE_PER_ATOL = 1e3  # times atol: smallest rise for which the split between block and road is checked
MAX_UNDERSHOOT_RATIO, MAX_UNDERSHOOT_K = 0.05, 1.0  # of the largest rise, plus K: undershoot at a sharp front


def check_temperatures(system: PhaseSystem, t: float, T, *, hottest: float, atol: float) -> None:
    """Raise SolverFailure for rises T (K) at time t (s) above `hottest` (K), or below everything that could cool them.

    `T` may be of cells or of any profile.  The integrator limits the root mean square of its local error over all n
    cells (Hindmarsh et al. 2005, ACM TOMS 31, 363), so a single cell may err by sqrt(n) times `atol` (K).  That happens
    at the front of the road that the start has heated, where BDF above order 1 is not monotone.
    """
    ambient = system.b.scene.ambient
    high, low = float(T.max()), float(T.min())
    if high + ambient > hottest:
        raise SolverFailure(
            f"{high + ambient - KELVIN:.4g} degC is above limits.temperature = {hottest - KELVIN:g} degC, and rubber "
            "chars above 300 degC; reduce load, speed or friction, or raise that limit"
        )
    allowed = MAX_UNDERSHOOT_RATIO * max(high, 0.0) + MAX_UNDERSHOOT_K + float(np.sqrt(system.b.n)) * atol
    if low < -allowed and low < (coldest := system.coldest_rise(t)) - allowed:
        raise SolverFailure(
            f"{low + ambient - KELVIN:.4g} degC is below everything that cools, {coldest + ambient - KELVIN:.4g} degC; "
            "use a smaller numerics.rtol or a finer mesh"
        )


def check_energy_balance(run: Run, atol: float) -> Run:
    """Return the run if its energy balance closes.  Raises EnergyBalanceError.

    The split between block and road is checked only if temperature rises are well above the integrator's `atol` (K).
    """
    is_resolved = np.ptp(np.concatenate([run.T_block, run.T_spot])) > MIN_RISE_PER_ATOL * atol
    partition = run.partition_error if is_resolved else 0.0
    checks = (
        ("energy_imbalance", run.energy_imbalance, MAX_ENERGY_IMBALANCE),
        ("partition_error", partition, MAX_PARTITION_ERROR),
    )
    for name, value, limit in checks:
        if not value <= limit:
            raise EnergyBalanceError(
                f"{name} {value:.2g} is above {limit:g}: heat was created or lost, so the result is not valid; use a "
                "smaller numerics.rtol, and report it if that does not help",
                run,
            )
    return run


def overheating_remarks(run: Run) -> list[str]:
    """Remarks on temperatures at which rubber ages or chars, which no model here describes."""
    hottest = run.summary["T_max_degC"]
    if hottest < RUBBER_AGEING_DEGC:
        return []
    return [f"{hottest:.0f} degC: rubber ages above 200 degC and chars above 300 degC; neither is modelled"]
