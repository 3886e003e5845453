"""Effects of a case that change nothing in it: found by asking the heat balance with and without each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, FlashtempError
from flashtemp.model.case import Case
from flashtemp.model.scene import Acting, Scene
from flashtemp.solver.balance import FEEL, Balance
from flashtemp.solver.circular_track import remembers
from flashtemp.solver.march import law_at_fault
from flashtemp.solver.system import Incoming, System

HOTTEST = 120.0  # K that a state is above the air at most
PHASES = 6  # stretches of the schedule that are asked, the first and the last among them
LARGE = 50_000  # cells: a mesh beyond is asked at a coarser one
SEED = 1


def remarks(case: Case) -> list[str]:
    """A sentence for every listed effect that cannot act in this case; none where all do."""
    if not case.effects:
        return []
    scene = _coarse(case)
    listed = [a for a in scene.acting if a.name in case.effects]
    return [f"{a.name} {why}" for a in listed if (why := _inert(scene, a)) is not None]


def _inert(scene: Scene, acting: Acting) -> str | None:
    """Why an effect cannot act, or None where it does."""
    if not list(acting.contributions(scene)) and list(acting.effect.see(acting.p)):
        return "acts on what a camera shows, not on this run"
    try:
        if not _same_answers(replace(scene, acting=tuple(a for a in scene.acting if a is not acting)), scene):
            return None
    except FlashtempError:  # a state that cannot be says nothing
        return None
    except Exception as fault:
        if (said := law_at_fault(scene, fault)) is not None:
            raise BadInput(said) from fault
        raise
    params = acting.effect.params()
    off = [f"{k} = {p.off:g}" for k, p in params.items() if p.off is not None and getattr(acting.p, k) == p.off]
    if off:
        return f"changes nothing: {', '.join(off)} switches it off"
    needs = type(acting.effect).needs
    return f"changes nothing in this case{f': it needs {needs}' if needs else ''}; leave it out or see what it acts on"


def _coarse(case: Case) -> Scene:
    """The scene of a case, or where that is large one of a coarser mesh with the same dimensions."""
    if case.scene.mesh.n_cells <= LARGE:
        return case.scene
    across = min(8, case["numerics.across"])
    try:
        return case.with_values({"numerics.mesh": "coarse", "numerics.across": across}).scene
    except FlashtempError:  # nothing coarser can be
        return case.scene


def _same_answers(base: Scene, extended: Scene) -> bool:
    """Whether the heat balances of two scenes of one mesh agree to the last bit wherever they are asked."""
    one, other = Balance(base), Balance(extended)
    if not np.array_equal(one.initial(), other.initial()):
        return False
    rng = np.random.default_rng(SEED)
    for phase, t in _moments(base):
        y = _state(one, rng)
        pair = [System(b, phase, _returning(b.scene, phase)) for b in (one, other)]
        now = pair[0].moment(t)
        if one.laws("march.rate", 0.0, None, now) != other.laws("march.rate", 0.0, None, now):
            return False
        rates = [np.zeros(b.size) for b in (one, other)]
        for system, out in zip(pair, rates, strict=True):
            system.rate(t, y[: system.b.size] if system.b is one else _moved(y, one, other), out)
        if not np.array_equal(rates[0][: one.worn.stop], rates[1][: one.worn.stop]):
            return False
    return True


def _moments(scene: Scene) -> Iterator[tuple[Any, float]]:
    """(phase, time) of some stretches: soon after their beginning, in the middle, at their end."""
    phases = scene.schedule.phases
    picked = sorted({round(k) for k in np.linspace(0, len(phases) - 1, min(PHASES, len(phases)))})
    waits = [k for k, p in enumerate(phases) if not p.sliding][:1]
    for k in sorted({*picked, *waits}):
        p = phases[k]
        yield from ((p, p.begin + f * (p.end - p.begin)) for f in (0.01, 0.5, 1.0))


def _state(b: Balance, rng) -> np.ndarray:
    """A state as a hot run may have it: no two cells alike, worn unevenly."""
    y = np.zeros(b.size)
    y[: b.n] = b.enthalpy(HOTTEST * rng.uniform(0.0, 1.0, b.n))
    if b.abrades:  # a tenth of the mean pressure, in the state's own unit
        y[b.worn] = rng.uniform(0.0, 0.1 * FEEL, len(b.cell_block))
    return y


def _moved(y: np.ndarray, one: Balance, other: Balance) -> np.ndarray:
    """The same cells and worn depth as a state of another balance, whose ledger may be longer."""
    out = np.zeros(other.size)
    out[: one.worn.stop] = y[: one.worn.stop]
    return out


def _returning(scene: Scene, phase: Any):
    """Road that returns a kelvin warmer: once it has been round the track, or, where the block slides to and fro, in
    every repetition but the first.  None where none is remembered."""
    mesh, schedule = scene.mesh, scene.schedule
    if not remembers(scene):
        return None
    cold = np.zeros(mesh.n_road * mesh.n_across)
    again = len(schedule.directions) > 1 and phase.slid_before > 0.0
    lap = schedule.lap or np.inf
    return lambda now: Incoming(cold + (1.0 if again or phase.slid_before + now.slid > lap else 0.0))
