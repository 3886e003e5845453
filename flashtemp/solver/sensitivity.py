"""What a small change of each parameter does to everything that a run records.

The difference s = (y_moved - y)/step of a neighbouring run obeys ds/dt = [f_moved(t, y + step s) - f(t, y)]/step.
It is integrated behind the run by BDF2 in sqrt(t) with one Newton correction a step; all neighbours share
the run's linearisation and preconditioner, so that one costs a fraction of a run.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from flashtemp.meshes.mesh import Mesh
from flashtemp.model.numerics import Settings
from flashtemp.model.scene import Scene
from flashtemp.model.schedule import Phase
from flashtemp.solver.balance import Balance
from flashtemp.solver.between import States, between
from flashtemp.solver.circular_track import COLUMNS, inflow, leave, remembers, track_of
from flashtemp.solver.conjugate_residuals import solve
from flashtemp.solver.march import march
from flashtemp.solver.progress import Progress
from flashtemp.solver.recorder import finish, record
from flashtemp.solver.run import Run
from flashtemp.solver.stretching import phase_of, stretched
from flashtemp.solver.system import System
from flashtemp.solver.turning import pass_on, renew

FIRST, MOST = 0.03, 0.1  # first and longest step, in roots of the share of a stretch
CLOSE = 0.2  # change by the correction over the change in the stretch, from which the next step follows
CLOSELY, SOON = 0.03, 4.0  # the same as long as what slid first may be seen, and for how many windows of sliding it may
GROWTH = 2.0  # BDF2 is stable up to 2.4
TINY = 1e-7  # K: a change that need not be followed


@dataclass(frozen=True)
class Move:
    """A scene with one parameter moved by `step`; nothing differs before the time `since` (s).

    `stretched`: block and schedule may be longer or shorter than the run's; cells and records are then those at the
    same share of the block's length and height, and of each repetition and wait.
    """

    scene: Scene
    step: float
    since: float = 0.0
    stretched: bool = False


Name = TypeVar("Name", bound=Hashable)


@dataclass(frozen=True)
class Neighbourhood(Generic[Name]):
    """A run, and runs (linear in their `steps`) with one parameter moved each.

    `level` is the run as the neighbours see it, on their own times: take differences against it.
    """

    run: Run
    level: Run | None
    moved: dict[Name, Run]
    steps: dict[Name, float]

    def slope(self, see, name: Name) -> np.ndarray:
        """d(see(run))/d(parameter) for any function of a run that returns an array."""
        return (see(self.moved[name]) - see(self.level)) / self.steps[name]


def explore(
    scene: Scene, settings: Settings, moves: dict[Name, Move], title: str = "", at=(), dense: bool = False
) -> Neighbourhood[Name]:
    """March a scene with neighbours beside it.

    Neighbours are recorded at the times `at` (s) that `settings` asks for too, with `dense` at every fifth of
    the others besides.  Moves share mesh and schedule with the scene.  Raises SolverFailure, ValueError.
    """
    beside = Neighbours(scene, moves, frozenset(at), dense)
    run = march(scene, settings, title, beside=beside)
    level, *moved = (one.run(title) for one in beside.all)
    runs = dict(zip(moves, moved, strict=True))
    return Neighbourhood(run, level, runs, {k: m.step for k, m in moves.items()})


class _Neighbour:
    """One moved scene beside the run: its difference `s` (cells, worn depth, ledger) per unit of the parameter."""

    def __init__(self, base: Balance, move: Move):
        scene, plain = move.scene, base.scene
        mesh = stretched(plain, scene) if move.stretched else _same(plain, scene)
        self.scene = replace(scene, mesh=mesh, schedule=replace(scene.schedule, lap=plain.schedule.lap))
        self.plain, self.as_one = plain.schedule, not move.stretched
        self.balance, self.step, self.since = Balance(self.scene), move.step, move.since
        start, own, m = base.initial(), self.balance.initial(), base.worn.stop
        self.m, self.s = base.size if self.balance.ledger == base.ledger else m, np.zeros(m)
        if self.step:
            self.s = (own[:m] - start[:m]) / self.step
        self.s = np.append(self.s, np.zeros(base.size - m))
        self.now = Progress(y=own, left=np.zeros(2), track=None)
        if remembers(scene):
            self.now.track = track_of(self.balance, scene.schedule.lap)

    def state(self, y: np.ndarray, s: np.ndarray) -> np.ndarray:
        """The neighbour's own state beside a state of the run; a ledger of other entries than the run's is not kept."""
        own, m = np.zeros(self.balance.size), self.m
        own[:m] = y[:m] + self.step * s[:m]
        return own

    def phase(self, phase: Phase) -> Phase:
        """The neighbour's own phase at the time of one of the run."""
        return phase if self.as_one else phase_of(phase, self.plain, self.scene.schedule)

    def system(self, phase: Phase, leg: int) -> System:
        """The neighbour's own system during a phase of its own, or one leg of it."""
        return System(self.balance, phase, inflow(self.balance, phase, self.now.track), leg)

    def pass_on(self, phase: Phase, leg: int, y, s) -> np.ndarray:
        """The state after the road was put back on the mesh."""
        self.now.y = self.state(y, s)
        pass_on(self.system(self.phase(phase), leg), self.now)
        return self.now.y[: self.m]

    def during(self, phase: Phase, leg: int = 0) -> _During:
        """The neighbour during one phase of the run's schedule, or one leg of it."""
        own = self.phase(phase)
        pace = 1.0 if self.as_one else (own.end - own.begin) / (phase.end - phase.begin)
        return _During(self, self.system(own, leg), np.zeros(self.balance.size), phase.begin, pace)

    def renew(self, before: Phase, phase: Phase, y, s) -> np.ndarray:
        """The state after the road was made new, or the block turned to slide back."""
        self.now.y = self.state(y, s)
        renew(self.balance, self.phase(before), self.phase(phase), self.now)
        return self.now.y[: self.m]

    def run(self, title: str) -> Run:
        return finish(self.balance, self.now, title)


def _same(plain: Scene, scene: Scene) -> Mesh:
    """The mesh of the run for a neighbour that has the same, and its schedule.  Raises ValueError."""
    if not all(np.array_equal(getattr(scene.mesh, k), getattr(plain.mesh, k)) for k in ("x", "thickness")):
        raise ValueError("a neighbour needs the mesh of the run")
    if scene.schedule.end != plain.schedule.end:
        raise ValueError("a neighbour needs the schedule of the run")
    return plain.mesh


@dataclass(frozen=True)
class _During:
    """A neighbour `of` a run in one phase, with room `out` for rates; its clock goes at `pace` since `begin`."""

    of: _Neighbour
    system: System
    out: np.ndarray
    begin: float
    pace: float

    @cached_property
    def _weights(self) -> np.ndarray:
        """How differences of cells and worn depth count: heat that comes round lies in the columns of lanes, over the
        width it is a share of that."""
        b = self.system.b
        out = np.ones(b.worn.stop)
        if b.laws.has("road.inflow"):
            out[b.scene.mesh.everywhere(b.scene.mesh.road)] = b.share
        return out

    def largest(self, s: np.ndarray) -> float:
        """Largest difference (K) of cells and worn depth `s`."""
        return float(np.abs(self._weights * s[: len(self._weights)]).max())

    def clock(self, t: float) -> float:
        """The neighbour's own time (s)."""
        return t if self.of.as_one else self.system.phase.begin + self.pace * (t - self.begin)

    def rate(self, t: float, y: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Rates of cells, worn depth and ledger, per time of the run."""
        self.system.rate(self.clock(t), self.of.state(y, s), self.out)
        if not self.of.as_one:
            self.out[:] *= self.pace
        return self.out[: self.of.m]

    def record(self, t, y, s, frame: bool) -> None:
        record(self.system, self.clock(t), self.of.state(y, s), self.of.now, frame, float)

    def leave(self, t, y, s) -> None:
        if self.of.now.track is not None:
            leave(self.system, self.clock(t), self.of.state(y, s), self.of.now.track)


class Neighbours:
    """All neighbours of a run; `march` calls `stretch` after each stretch and `renew` at each new start or turn."""

    def __init__(self, scene: Scene, moves: Mapping[Any, Move], asked: frozenset[float], dense: bool):
        base = Balance(scene)
        self.asked, self.dense = asked, dense
        self.all = [_Neighbour(base, Move(scene, 0.0)), *(_Neighbour(base, m) for m in moves.values())]

    def renew(self, before, phase, old: np.ndarray) -> None:
        """A new repetition begins or the block turns, out of the run's state `old`."""
        level, *moved = self.all
        zero = level.renew(before, phase, old, level.s)
        for one in moved:
            if one.since < before.end:
                one.s[: one.m] = (one.renew(before, phase, old, one.s) - zero[: one.m]) / one.step

    def pass_on(self, phase, leg: int, old: np.ndarray) -> None:
        """The road in its own frame is put back on the mesh, out of the run's state `old`."""
        level, *moved = self.all
        zero = level.pass_on(phase, leg, old, level.s)
        for one in moved:
            if one.since < phase.begin:
                one.s[: one.m] = (one.pass_on(phase, leg, old, one.s) - zero[: one.m]) / one.step

    def stretch(self, phase, path, records, leg: int = 0) -> None:
        """Integrate the differences over a stretch of which the run took the steps `path`."""
        level, *moved = self.all
        times = self._times(phase, records)
        live = [one for one in moved if one.since < phase.end]
        idle = [one for one in moved if one.since >= phase.end]
        for one in live:
            if phase.begin <= one.since and one.now.track is not None and level.now.track is not None:
                kept: dict[str, Any] = {k: list(getattr(level.now.track, k)) for k in COLUMNS}
                one.now.track = replace(one.now.track, **kept)
        S = np.array([one.s for one in live]).reshape(len(live), len(level.s))
        S = _integrate(
            phase, States(path), level.during(phase, leg), [one.during(phase, leg) for one in live], S, times
        )
        for k, one in enumerate(live):
            one.s = S[k]
        for one in idle:  # what the run recorded holds for them too
            _copy(level.now, one.now, phase)

    def _times(self, phase, records) -> list[tuple[float, bool]]:
        """When neighbours are recorded in a stretch, and whether with all cells."""
        own = [t for t in records["time"] if phase.begin < t <= phase.end or t == phase.begin == 0.0]
        other = [t for t in own if t not in self.asked]
        kept = set(other[4::5]) if self.dense else set()
        kept |= {own[-1]} | ({0.0} & set(own))
        return [(t, t in self.asked or t == 0.0) for t in own if t in self.asked or t in kept]


def _integrate(phase, path: States, level: _During, live: list[_During], S, times) -> np.ndarray:
    """Differences (k, cells, worn depth, ledger) of live neighbours at the end of a stretch; S those at its start.

    Steps are taken in u, with t = begin + span u^2: heat that begins to flow goes as sqrt(t), and BDF2 is exact for
    parabolas of u.  The ledger follows the rest and has no say in the length of steps.
    """
    m = level.system.b.worn.stop
    longest = 0.5 * MOST if level.system.b.laws.has("road.inflow") else MOST  # what comes round changes all the time
    begin, size = S, np.array([0.05 * one.largest(s) for one, s in zip(live, S, strict=True)])
    size = np.maximum(size, [TINY / abs(one.of.step) for one in live])
    old, before = S, 0.0
    span, soon = phase.end - phase.begin, _soon(phase, level, times)
    u, h, times = 0.0, FIRST, list(times)
    if times and times[0][0] <= phase.begin:
        _record(path, level, live, times.pop(0), S)
    while u < 1.0:
        new = 1.0 if 1.0 - u < 1.5 * h else u + h
        h = new - u
        t = phase.end if new == 1.0 else phase.begin + span * new**2
        after, change = _step(path(t), t, 2.0 * new * span, (h, before), (old, S), level, live)
        while times and times[0][0] <= t * (1 + 1e-12):
            at = times.pop(0)
            reached = float(np.sqrt((at[0] - phase.begin) / span))
            _record(path, level, live, at, between(reached, (u - before, u, new), (old, S, after)))
        old, S, before, u = S, after, h, new
        if phase.sliding:
            y = path(t)
            level.leave(t, y, level.of.s)
            for one, s in zip(live, S, strict=True):
                one.leave(t, y, s)
        size = np.maximum(size, [one.largest(s) for one, s in zip(live, S - begin, strict=True)])
        moved = np.abs(change[:, :m]).max(axis=1, initial=0.0) / size
        error = float(np.sqrt(np.mean(moved**2))) if live else 0.0
        close = CLOSELY if soon and level.system.moment(t).slid < soon else CLOSE
        h = min(h * float(np.clip(np.sqrt(close / max(error, 1e-12)), 0.5, GROWTH)), longest)
    return S


def _soon(phase, level: _During, times) -> float:
    """How far (m) the block slides while the front of the road that it met first is in the window, or smeared by long
    steps, where one of the `times` asked for with all cells falls in; else 0."""
    reach = SOON * float(level.system.b.scene.mesh.x[-1])
    seen = phase.sliding and any(frame and level.system.moment(t).slid < reach for t, frame in times)
    return reach if seen else 0.0


def _step(y, t: float, pace: float, steps: tuple[float, float], last, level: _During, live: list[_During]):
    """Differences after a step of BDF2 to the time t (s), where the run is at y, and Newton's correction.

    `steps` in u, this one and that before, of which the latter is 0 for the first: that is Euler's; `pace` dt/du.
    `last` differences before and after the step before.
    """
    (h, before), (old, S) = steps, last
    w = h / before if before else 0.0
    gamma = pace * h * (1 + w) / (1 + 2 * w)
    guess = S + w * (S - old) if before else S
    known = ((1 + w) ** 2 * S - w * w * old) / (1 + 2 * w) if before else S
    start = level.rate(t, y, level.of.s)
    R = np.empty_like(S)
    for k, one in enumerate(live):
        n = one.of.m
        R[k] = known[k] - guess[k]
        R[k, :n] = known[k, :n] + gamma * (one.rate(t, y, guess[k]) - start[:n]) / one.of.step - guess[k, :n]
    b = level.system.b
    change = solve(level.system.linearised(t, level.of.state(y, level.of.s), gamma), b.size, b.worn.stop, R)
    return guess + change, change


def _record(path: States, level: _During, live: list[_During], at, S) -> None:
    t, frame = at
    y = path(t)
    level.record(t, y, level.of.s, frame)
    for one, s in zip(live, S, strict=True):
        one.record(t, y, s, frame)


def _copy(source: Progress, target: Progress, phase) -> None:
    """Records of a stretch in which nothing differs yet."""
    target.records.setdefault("ledger", source.records["ledger"])
    time, frames = source.records["time"], source.records["frames"]
    for i, t in enumerate(time):
        if phase.begin < t <= phase.end or t == phase.begin == 0.0:
            if i in frames:
                target.records.setdefault("frames", []).append(len(target.records.get("time", [])))
                target.frames.append(source.frames.row(frames.index(i)))
            for name in source.records.keys() - {"ledger", "frames"}:
                target.records.setdefault(name, []).append(source.records[name][i])
