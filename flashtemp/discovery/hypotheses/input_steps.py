"""A case with one stated number a little larger or smaller, from which the sensitivity to it is computed."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from flashtemp.discovery.hypotheses.input_kinds import input_kind, scale_value
from flashtemp.errors import BadInput
from flashtemp.model.case import Case
from flashtemp.model.priors import expand_materials
from flashtemp.model.scene import Scene
from flashtemp.solver.mesh_mapping import stretch_mesh

TANGENT_STEP_LN = 1e-3  # of the ln of a value; the error of a tangent is the curvature only
TANGENT_STEP_SD = 0.02  # usual standard deviations of a value that moves in its own unit
RUN_STEP_RATIO = 10.0  # times as far where two separate runs are subtracted: their solver errors do not cancel
CAMERA_INPUTS = {  # stated by a recording: effect and parameter that move it, and the step in its own unit
    "emissivity": ("emissivity", "change", -1e-3),
    "reflected_temperature": ("reflection", "excess", 0.1),
}


def iter_stepped_cases(case: Case, key: str, scale: float = 1.0) -> Iterator[tuple[Case, float]]:
    """The case with a key moved up, then down, each with its step; a step that the case refuses is left out.

    Steps are in ln of the value, or in the key's own unit where its kind is absolute; `scale` multiplies them.
    """
    full = expand_materials(case)
    table, name = key.rsplit(".", 1)
    kind = input_kind(key, full.declared_params(table)[name].unit)
    size = scale * (TANGENT_STEP_LN if kind.relative else TANGENT_STEP_SD * kind.sd)
    for step in (size, -size):
        try:
            value = scale_value(full, key, math.exp(step)) if kind.relative else full[key] + step
            moved = full.with_values({key: value})
        except BadInput:
            continue
        yield moved, step


def is_neighbour(plain: Scene, moved: Scene) -> bool:
    """Whether a tangent run is possible: the same schedule, and the same cells except for their size."""
    if _phase_times(plain) != _phase_times(moved):
        return False
    try:
        stretch_mesh(plain, moved)
    except ValueError:
        return False
    return True


def has_same_mesh(plain: Scene, moved: Scene) -> bool:
    """Whether two scenes have the same cells."""
    return all(np.array_equal(getattr(plain.mesh, k), getattr(moved.mesh, k)) for k in ("x", "thickness", "y"))


def _phase_times(scene: Scene) -> list[tuple[bool, float, float]]:
    """Beginning and end of all phases of a scene, s."""
    return [(p.sliding, p.begin, p.end) for p in scene.schedule.phases]
