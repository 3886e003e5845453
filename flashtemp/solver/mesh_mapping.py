"""Map the mesh and the phases of a run to a perturbed scene with another length of the block or of the schedule."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flashtemp.meshes.mesh import Mesh
from flashtemp.model.scene import Scene
from flashtemp.model.schedule import Phase, Schedule


def stretch_mesh(plain: Scene, scene: Scene) -> Mesh:
    """The mesh of a `plain` scene with its block stretched to length, height, layers and width of another `scene`.

    The road before, behind and below the block keeps its cells.  Raises ValueError if the other scene has a different
    number of cells, layers, repetitions or waits, because states then do not correspond.
    """
    mesh, other = plain.mesh, scene.mesh
    counts = [(len(m.x), len(m.depth), len(m.height), len(m.y), m.first, m.last) for m in (mesh, other)]
    if counts[0] != counts[1]:
        raise ValueError("a perturbed scene needs the mesh of the run, or that mesh stretched")
    if scene.schedule.repetitions != plain.schedule.repetitions or _has_waits(scene.schedule) != _has_waits(
        plain.schedule
    ):
        raise ValueError("a perturbed scene needs the schedule of the run, or that schedule stretched")
    if mesh.joints != other.joints:
        raise ValueError("a perturbed scene needs the layers of the run, or those layers stretched")
    L, sizes = plain.length, [(s.length, s.height, s.width) for s in (plain, scene)]
    ends, after = (np.cumsum([0.0, *(layer.thickness for layer in s.layers)]) for s in (plain, scene))
    if sizes[0] == sizes[1] and np.array_equal(ends, after):
        return mesh
    along, up, across = (b / a for a, b in zip(*sizes, strict=True))
    height = np.interp(mesh.height, ends, after) if mesh.joints else mesh.height * up
    behind = np.maximum(mesh.x - L, 0.0)
    # the road behind the block moves with the trailing edge, so its cells keep their lengths
    x = np.where(mesh.x <= 0.0, mesh.x, np.minimum(mesh.x, L) * along + behind)
    return replace(mesh, x=x, height=height, y=mesh.y * across)


def _has_waits(schedule: Schedule) -> bool:
    """Whether there is a wait between repetitions."""
    return schedule.wait > 0


def corresponding_phase(phase: Phase, plain: Schedule, other: Schedule) -> Phase:
    """The phase of another schedule at the same fraction of the repetition or wait as a phase of a `plain` schedule.

    >>> from flashtemp.model.schedule import constant_series
    >>> slow = Schedule(constant_series(0.1), constant_series(1e5), distance=1.0, repetitions=2, wait=5.0)
    >>> fast = Schedule(constant_series(0.2), constant_series(1e5), distance=1.0, repetitions=2, wait=10.0)
    >>> [(p.begin, p.end) for p in (corresponding_phase(q, slow, fast) for q in slow.phases)]
    [(0.0, 5.0), (5.0, 15.0), (15.0, 20.0)]
    """
    before = phase.repetition - 1
    start = before * (other.slide_time + other.wait)

    def mapped_time(t: float) -> float:
        """The time (s) of the other schedule at the same fraction of the repetition or wait."""
        since = t - phase.start
        if phase.sliding:
            return start + since * (other.slide_time / plain.slide_time)
        return start + other.slide_time + (since - plain.slide_time) * (other.wait / plain.wait)

    return replace(
        phase,
        begin=mapped_time(phase.begin),
        end=mapped_time(phase.end),
        start=start,
        slid_before=before * other.distance,
        leg_before=phase.leg_before * (other.distance / plain.distance),
        turned=mapped_time(phase.turned),
    )
