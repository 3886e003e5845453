"""Find effects that change nothing in a case, by evaluating the heat balance with and without each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, FlashtempError
from flashtemp.model.case import Case
from flashtemp.model.scene import ActiveEffect, Scene
from flashtemp.solver.circular_track import has_road_memory
from flashtemp.solver.heat_balance import MEAN_PRESSURE_EFFECT_K, HeatBalance
from flashtemp.solver.system import PhaseSystem, RoadInflow
from flashtemp.solver.time_integration import find_failing_law

MAX_STATE_RISE_K = 120.0  # K above ambient, highest temperature of the random states
SAMPLED_PHASES = 6  # phases of the schedule at which the balance is evaluated, including the first and the last
LARGE_MESH_CELLS = 50_000  # cells above which a coarser mesh is used
STATE_SEED = 1


def describe_inactive_effects(case: Case) -> list[str]:
    """One sentence for every listed effect that cannot act in this case."""
    return [f"{name} {why}" for name, why in find_inactive_effects(case).items()]


def find_inactive_effects(case: Case) -> dict[str, str]:
    """{listed effect that cannot act in this case: why}."""
    if not case.effects:
        return {}
    scene = _coarse_scene(case)
    listed = [a for a in scene.acting if a.name in case.effects]
    return {a.name: why for a in listed if (why := _reason_inactive(scene, a)) is not None}


def _reason_inactive(scene: Scene, acting: ActiveEffect) -> str | None:
    """Why an effect cannot act, or None where it does."""
    if not list(acting.contributions(scene)) and list(acting.effect.see(acting.p)):
        return "acts on what a camera shows, not on this run"
    try:
        if not _has_same_rates(replace(scene, acting=tuple(a for a in scene.acting if a is not acting)), scene):
            return None
    except FlashtempError:  # the random state is impossible, so it decides nothing
        return None
    except Exception as fault:
        if (message := find_failing_law(scene, fault)) is not None:
            raise BadInput(message) from fault
        raise
    params = acting.effect.params()
    off = [f"{k} = {p.off:g}" for k, p in params.items() if p.off is not None and getattr(acting.p, k) == p.off]
    if off:
        return f"changes nothing: {', '.join(off)} switches it off"
    needs = type(acting.effect).needs
    return (
        f"changes nothing in this case{f': it needs {needs}' if needs else ''}; leave it out or check what it acts on"
    )


def _coarse_scene(case: Case) -> Scene:
    """The scene of a case; for a large mesh, one with a coarser mesh of the same number of dimensions."""
    if case.scene.mesh.n_cells <= LARGE_MESH_CELLS:
        return case.scene
    across = min(8, case["numerics.across"])
    try:
        return case.with_values({"numerics.mesh": "coarse", "numerics.across": across}).scene
    except FlashtempError:  # a coarser mesh is not possible
        return case.scene


def _has_same_rates(base: Scene, extended: Scene) -> bool:
    """Whether the heat balances of two scenes with one mesh agree bit by bit at all sampled states and times."""
    one, other = HeatBalance(base), HeatBalance(extended)
    if not np.array_equal(one.initial_state(), other.initial_state()):
        return False
    rng = np.random.default_rng(STATE_SEED)
    for phase, t in _sample_times(base):
        y = _random_state(one, rng)
        pair = [PhaseSystem(b, phase, _warm_inflow(b.scene, phase)) for b in (one, other)]
        now = pair[0].law_context(t)
        if one.laws("march.rate", 0.0, None, now) != other.laws("march.rate", 0.0, None, now):
            return False
        rates = [np.zeros(b.size) for b in (one, other)]
        for system, out in zip(pair, rates, strict=True):
            system.rate(t, y[: system.b.size] if system.b is one else _copy_state(y, one, other), out)
        if not np.array_equal(rates[0][: one.worn.stop], rates[1][: one.worn.stop]):
            return False
    return True


def _sample_times(scene: Scene) -> Iterator[tuple[Any, float]]:
    """(phase, time) of some phases: soon after the beginning, in the middle, at the end."""
    phases = scene.schedule.phases
    chosen = sorted({round(k) for k in np.linspace(0, len(phases) - 1, min(SAMPLED_PHASES, len(phases)))})
    waits = [k for k, p in enumerate(phases) if not p.sliding][:1]
    for k in sorted({*chosen, *waits}):
        p = phases[k]
        yield from ((p, p.begin + f * (p.end - p.begin)) for f in (0.01, 0.5, 1.0))


def _random_state(balance: HeatBalance, rng) -> np.ndarray:
    """A random state of a hot run: all cells different, wear uneven."""
    y = np.zeros(balance.size)
    y[: balance.n] = balance.enthalpy_rise(MAX_STATE_RISE_K * rng.uniform(0.0, 1.0, balance.n))
    if balance.abrades:  # up to a tenth of the mean pressure, in the unit of the state (K)
        y[balance.worn] = rng.uniform(0.0, 0.1 * MEAN_PRESSURE_EFFECT_K, len(balance.cell_block))
    return y


def _copy_state(y: np.ndarray, one: HeatBalance, other: HeatBalance) -> np.ndarray:
    """The same temperatures and wear depths as a state of another balance, whose energy ledger may be longer."""
    out = np.zeros(other.size)
    out[: one.worn.stop] = y[: one.worn.stop]
    return out


def _warm_inflow(scene: Scene, phase: Any):
    """An inflow of road 1 K above ambient wherever the block meets its own road again; None without road memory.

    That is after one lap of the track, or in every repetition but the first where the block slides back and forth.
    """
    mesh, schedule = scene.mesh, scene.schedule
    if not has_road_memory(scene):
        return None
    cold = np.zeros(mesh.n_road * mesh.n_across)
    again = len(schedule.directions) > 1 and phase.slid_before > 0.0
    lap = schedule.lap or np.inf
    return lambda now: RoadInflow(cold + (1.0 if again or phase.slid_before + now.slid > lap else 0.0))
