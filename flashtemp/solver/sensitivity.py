"""Sensitivities of a run: the derivative of everything that it records with respect to parameters.

For every parameter a perturbed run with the parameter changed by `step` is followed by its difference quotient
s = (y_perturbed - y)/step, which obeys ds/dt = [f_perturbed(t, y + step s) - f(t, y)]/step.  Each segment of the run is
integrated first; s follows by BDF2 in sqrt(t), with one Newton correction per step.  All perturbed runs use the run's
linearisation and preconditioner, so one of them costs a fraction of a run.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from flashtemp.model.numerics import SolverSettings
from flashtemp.model.scene import Scene
from flashtemp.solver.circular_track import TRACK_FIELDS
from flashtemp.solver.difference_integration import StateInterpolant, integrate_differences
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.perturbed_run import Perturbation, PerturbedRun
from flashtemp.solver.run import Run
from flashtemp.solver.time_integration import integrate_schedule

ParameterName = TypeVar("ParameterName", bound=Hashable)


@dataclass(frozen=True)
class RunWithSensitivities(Generic[ParameterName]):
    """A run, and one perturbed run per parameter, linear in its step.

    `reference` is the run recorded like the perturbed runs, at the same times: take differences from it.
    """

    run: Run
    reference: Run | None
    perturbed: dict[ParameterName, Run]
    steps: dict[ParameterName, float]

    def derivative_of(self, observe, name: ParameterName) -> np.ndarray:
        """d(observe(run))/d(parameter) for any function of a run that returns an array."""
        return (observe(self.perturbed[name]) - observe(self.reference)) / self.steps[name]


def run_with_sensitivities(
    scene: Scene,
    settings: SolverSettings,
    perturbations: dict[ParameterName, Perturbation],
    title: str = "",
    at=(),
    dense: bool = False,
) -> RunWithSensitivities[ParameterName]:
    """Run a scene together with perturbed runs.

    Perturbed runs are recorded at those times `at` (s) at which `settings` records the run too; with `dense` also at
    every fifth of the other recorded times.  Perturbed scenes need the run's mesh and schedule unless they are
    stretched.  Raises SolverFailure, ValueError.
    """
    integrator = SensitivityIntegrator(scene, perturbations, frozenset(at), dense)
    run = integrate_schedule(scene, settings, title, sensitivities=integrator)
    reference, *perturbed = (one.to_run(title) for one in integrator.perturbed_runs)
    runs = dict(zip(perturbations, perturbed, strict=True))
    return RunWithSensitivities(run, reference, runs, {k: m.step for k, m in perturbations.items()})


class SensitivityIntegrator:
    """All perturbed runs of a run.

    `integrate_schedule` calls `integrate_segment` after each segment, `start_phase` at each repetition or reversal, and
    `remap_road` when road in its own frame is shifted back on the mesh.  The first entry of `perturbed_runs` has the
    step 0: it is the reference, evaluated by the same code as the others.
    """

    def __init__(
        self, scene: Scene, perturbations: Mapping[Any, Perturbation], requested_times: frozenset[float], dense: bool
    ):
        base = HeatBalance(scene)
        self.requested_times, self.dense = requested_times, dense
        self.perturbed_runs = [
            PerturbedRun(base, Perturbation(scene, 0.0)),
            *(PerturbedRun(base, m) for m in perturbations.values()),
        ]

    def start_phase(self, before, phase, old: np.ndarray) -> None:
        """Start a new repetition, or reverse the block, from the run's state `old`."""
        reference, *perturbed = self.perturbed_runs
        zero = reference.start_phase(before, phase, old, reference.s)
        for one in perturbed:
            if one.start_s < before.end:
                one.s[: one.m] = (one.start_phase(before, phase, old, one.s) - zero[: one.m]) / one.step

    def remap_road(self, phase, leg: int, old: np.ndarray) -> None:
        """Shift the road in its own frame back on the mesh, from the run's state `old`."""
        reference, *perturbed = self.perturbed_runs
        zero = reference.remap_road(phase, leg, old, reference.s)
        for one in perturbed:
            if one.start_s < phase.begin:
                one.s[: one.m] = (one.remap_road(phase, leg, old, one.s) - zero[: one.m]) / one.step

    def integrate_segment(self, phase, path, records, leg: int = 0) -> None:
        """Integrate the differences over a segment in which the run took the steps `path`."""
        reference, *perturbed = self.perturbed_runs
        times = self._record_times(phase, records)
        active = [one for one in perturbed if one.start_s < phase.end]
        unchanged = [one for one in perturbed if one.start_s >= phase.end]
        base_track = reference.integration_state.track
        for one in active:  # until its first difference a perturbed run has the track of the reference
            if phase.begin <= one.start_s and one.integration_state.track is not None and base_track is not None:
                stored: dict[str, Any] = {k: list(getattr(base_track, k)) for k in TRACK_FIELDS}
                one.integration_state.track = replace(one.integration_state.track, **stored)
        interpolant, base = StateInterpolant(path), reference.phase_segment(phase, leg)
        for t, frame in times:
            base.record_own(t, interpolant(t), reference.s, frame)
        # road that comes round only in some runs changes them abruptly: their short steps must not hold up the others
        revisiting = {id(one) for one in active if one.has_track and not reference.has_track}
        for group in ([o for o in active if id(o) not in revisiting], [o for o in active if id(o) in revisiting]):
            if not group:
                continue
            S = np.array([one.s for one in group])
            segments = [one.phase_segment(phase, leg) for one in group]
            S = integrate_differences(phase, interpolant, base, segments, S, times)
            for k, one in enumerate(group):
                one.s = S[k]
        for one in unchanged:  # they have the records of the reference
            _copy_records(reference.integration_state, one.integration_state, phase)

    def _record_times(self, phase, records) -> list[tuple[float, bool]]:
        """Times (s) at which perturbed runs are recorded in a segment, and whether with all cells."""
        recorded = [t for t in records["time"] if phase.begin < t <= phase.end or t == phase.begin == 0.0]
        other = [t for t in recorded if t not in self.requested_times]
        extra = set(other[4::5]) if self.dense else set()
        extra |= {recorded[-1]} | ({0.0} & set(recorded))
        return [(t, t in self.requested_times or t == 0.0) for t in recorded if t in self.requested_times or t in extra]


def _copy_records(source: IntegrationState, target: IntegrationState, phase) -> None:
    """Copy the records of a segment in which a perturbed run does not differ from the reference yet."""
    target.records.setdefault("ledger", source.records["ledger"])
    time, frames = source.records["time"], source.records["frames"]
    for i, t in enumerate(time):
        if phase.begin < t <= phase.end or t == phase.begin == 0.0:
            if i in frames:
                target.records.setdefault("frames", []).append(len(target.records.get("time", [])))
                target.frames.append(source.frames.read_row(frames.index(i)))
            for name in source.records.keys() - {"ledger", "frames"}:
                target.records.setdefault(name, []).append(source.records[name][i])
