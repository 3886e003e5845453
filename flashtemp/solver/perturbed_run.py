"""A perturbed run: a scene with one parameter changed, followed by its difference quotient to the run.

Its state is y + step s, where y is the state of the run and s = (y_perturbed - y)/step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flashtemp.meshes.mesh import Mesh
from flashtemp.model.scene import Scene
from flashtemp.model.schedule import Phase
from flashtemp.solver.circular_track import build_inflow, build_track, has_road_memory, store_leaving_column
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.mesh_mapping import corresponding_phase, stretch_mesh
from flashtemp.solver.phase_transitions import remap_road, start_phase
from flashtemp.solver.recorder import build_run, record_state
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem


@dataclass(frozen=True)
class Perturbation:
    """A scene with one parameter changed by `step`; nothing differs before the time `start_s` (s).

    With `is_stretched` block and schedule may be longer or shorter than those of the run.  Cells and records then
    correspond by the fraction of the block's length and height, and by the fraction of each repetition and wait.
    """

    scene: Scene
    step: float
    start_s: float = 0.0
    is_stretched: bool = False


class PerturbedRun:
    """One perturbed scene: its difference quotient `s` (cells, worn depth, ledger) per unit of the parameter.

    Only the first `m` entries of `s` count: without the ledger, if the perturbed scene has other ledger entries.
    """

    def __init__(self, base: HeatBalance, perturbation: Perturbation):
        scene, plain = perturbation.scene, base.scene
        mesh = stretch_mesh(plain, scene) if perturbation.is_stretched else _shared_mesh(plain, scene)
        self.scene = replace(scene, mesh=mesh, schedule=replace(scene.schedule, lap=plain.schedule.lap))
        self.base_schedule, self.shares_clock = plain.schedule, not perturbation.is_stretched
        self.balance, self.step, self.start_s = HeatBalance(self.scene), perturbation.step, perturbation.start_s
        start, own, m = base.initial_state(), self.balance.initial_state(), base.worn.stop
        self.m, self.s = base.size if self.balance.ledger == base.ledger else m, np.zeros(m)
        if self.step:
            self.s = (own[:m] - start[:m]) / self.step
        self.s = np.append(self.s, np.zeros(base.size - m))
        self.integration_state = IntegrationState(y=own, removed_heat=np.zeros(2), track=None)
        if has_road_memory(scene):
            self.integration_state.track = build_track(self.balance, scene.schedule.lap)

    @property
    def has_track(self) -> bool:
        """Whether road that leaves the window is stored, to enter it again."""
        return self.integration_state.track is not None

    def own_state(self, y: np.ndarray, s: np.ndarray) -> np.ndarray:
        """State y + step s of the perturbed run; its ledger is zero if it has other entries than the run's."""
        own, m = np.zeros(self.balance.size), self.m
        own[:m] = y[:m] + self.step * s[:m]
        return own

    def own_phase(self, phase: Phase) -> Phase:
        """The phase of the perturbed schedule that corresponds to a phase of the run."""
        return phase if self.shares_clock else corresponding_phase(phase, self.base_schedule, self.scene.schedule)

    def own_system(self, phase: Phase, leg: int) -> PhaseSystem:
        """The perturbed system during a phase of its own schedule, or during one leg of it."""
        return PhaseSystem(self.balance, phase, build_inflow(self.balance, phase, self.integration_state.track), leg)

    def remap_road(self, phase: Phase, leg: int, y, s) -> np.ndarray:
        """State of the perturbed run after its road was shifted back on the mesh."""
        self.integration_state.y = self.own_state(y, s)
        remap_road(self.own_system(self.own_phase(phase), leg), self.integration_state)
        return self.integration_state.y[: self.m]

    def phase_segment(self, phase: Phase, leg: int = 0) -> PhaseSegment:
        """The perturbed run during one phase of the run's schedule, or during one leg of it."""
        own = self.own_phase(phase)
        clock_rate = 1.0 if self.shares_clock else (own.end - own.begin) / (phase.end - phase.begin)
        return PhaseSegment(self, self.own_system(own, leg), np.zeros(self.balance.size), phase.begin, clock_rate)

    def start_phase(self, before: Phase, phase: Phase, y, s) -> np.ndarray:
        """State of the perturbed run after a new repetition began, or the block reversed."""
        self.integration_state.y = self.own_state(y, s)
        start_phase(self.balance, self.own_phase(before), self.own_phase(phase), self.integration_state)
        return self.integration_state.y[: self.m]

    def to_run(self, title: str) -> Run:
        return build_run(self.balance, self.integration_state, title)


def _shared_mesh(plain: Scene, scene: Scene) -> Mesh:
    """The run's mesh, for a perturbed scene with the same mesh and schedule.  Raises ValueError."""
    if not all(np.array_equal(getattr(scene.mesh, k), getattr(plain.mesh, k)) for k in ("x", "thickness")):
        raise ValueError("a perturbed scene needs the mesh of the run")
    if scene.schedule.end_time != plain.schedule.end_time:
        raise ValueError("a perturbed scene needs the schedule of the run")
    return plain.mesh


@dataclass(frozen=True)
class PhaseSegment:
    """A perturbed run during one phase: its clock runs `clock_rate` times as fast as the run's from `begin` (s) on.

    `rate_buffer` (size,) is reused by every evaluation of the rate.
    """

    perturbed_run: PerturbedRun
    system: PhaseSystem
    rate_buffer: np.ndarray
    begin: float
    clock_rate: float

    @cached_property
    def _difference_weights(self) -> np.ndarray:
        """Weights of the differences of cells and worn depth in the step control.

        Heat that comes round is stored in the columns of the lanes; averaged over the width it is a fraction of that.
        """
        b = self.system.b
        out = np.ones(b.worn.stop)
        if b.laws.has_law("road.inflow"):
            out[b.scene.mesh.everywhere(b.scene.mesh.road)] = b.share
        return out

    def largest_difference(self, s: np.ndarray) -> float:
        """Largest weighted difference of cells (K) and worn depth per unit of the parameter."""
        return float(np.abs(self._difference_weights * s[: len(self._difference_weights)]).max())

    def own_time(self, t: float) -> float:
        """Time (s) on the clock of the perturbed run."""
        return t if self.perturbed_run.shares_clock else self.system.phase.begin + self.clock_rate * (t - self.begin)

    def own_rate(self, t: float, y: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Rates of cells, worn depth and ledger per unit of the run's time; valid until the next call."""
        self.system.rate(self.own_time(t), self.perturbed_run.own_state(y, s), self.rate_buffer)
        if not self.perturbed_run.shares_clock:
            self.rate_buffer[:] *= self.clock_rate
        return self.rate_buffer[: self.perturbed_run.m]

    def record_own(self, t, y, s, frame: bool) -> None:
        record_state(
            self.system,
            self.own_time(t),
            self.perturbed_run.own_state(y, s),
            self.perturbed_run.integration_state,
            frame,
            float,
        )

    def store_own_column(self, t, y, s) -> None:
        if self.perturbed_run.integration_state.track is not None:
            store_leaving_column(
                self.system,
                self.own_time(t),
                self.perturbed_run.own_state(y, s),
                self.perturbed_run.integration_state.track,
            )
