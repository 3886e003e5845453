"""The theory of friction that a case holds, wherever it comes from: the effect that offers one."""

from __future__ import annotations

from flashtemp.errors import BadInput
from flashtemp.model import case as cases
from flashtemp.model.scene import Acting, Scene
from flashtemp.physics.effect import catalogue


def theory_of(case: cases.Case) -> tuple[Scene, Acting]:
    """The scene of a case, and the effect of it whose `p.theory` computes friction.  Raises BadInput without one."""
    scene = cases.build(case)
    for acting in scene.acting:
        if hasattr(acting.p, "theory"):
            return scene, acting
    able = " or ".join(f'"{name}"' for name, effect in catalogue().items() if "master_curve" in effect.params())
    said = f"{case.name}: effects: {list(case.effects)}; none computes friction from a spectrum and a master curve"
    raise BadInput(f"{said}, add {able}")
