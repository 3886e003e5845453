"""The command on friction alone: friction, over speed and temperature by theory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from flashtemp.cli.terminal import DONE, Json, emit, finite
from flashtemp.errors import BadInput
from flashtemp.physics.quantities import KELVIN

COUNT, LIMITS = 60, (1e-12, 1e3)  # speeds; m/s
NOT_MODELLED = (
    "on the hot branch: heat of the adhesive part, heat that flows into the road; stick-slip between contact regions"
)


def friction(
    case: str,
    /,
    *overrides: str,
    out: Path | None = None,
    slowest: float = 1e-6,
    fastest: float = 10.0,
    json: Json = False,
) -> int:
    """Friction over speed and temperature from a master curve and a power spectrum, and what a slope tester reaches.

    Parameters
    ----------
    case
        A case folder or a .toml file with the effect persson_friction.
    overrides
        Keys of the case to change, as table.key=value.
    out
        Result folder; results/CASE-friction when not given.
    slowest
        Lowest sliding speed, m/s.
    fastest
        Highest sliding speed, m/s.
    """
    low, high = LIMITS
    if not low <= slowest < fastest <= high:
        raise BadInput(
            f"--slowest, --fastest: {slowest:g}, {fastest:g}; give {low:g} <= slowest < fastest <= {high:g} m/s"
        )
    from flashtemp.model.case import load
    from flashtemp.runs.folders import free_name, whole

    asked = load(case, list(overrides))
    final = out or free_name(Path("results") / f"{asked.name}-friction")
    with whole(final) as work:
        found = _curves(asked, slowest, fastest)
        told = found.as_dict() | {"title": asked.title, "not_modelled": NOT_MODELLED, "out": str(final)}
        _save(asked, found, told, work)
    text = f"{asked.title}: {found}\n  not modelled: {NOT_MODELLED}\n  results in {final}/"
    emit(told, json, text)
    return DONE


def _curves(asked, slowest: float, fastest: float):
    """The curves of a case.  Raises BadInput, SolverFailure."""
    import numpy as np

    from flashtemp.model.build import theory_of
    from flashtemp.physics.friction import friction_curves, theory_inputs
    from flashtemp.physics.friction.flash_temperature import Spots

    scene, acting = theory_of(asked)
    theory, spots = acting.p.theory, Spots(scene.spot_diameter)
    speeds = np.geomspace(slowest, fastest, COUNT)
    found = friction_curves.curves(theory, scene.block, spots, speeds, scene.ambient, scene.load)
    if not all(np.all((mu >= 0) & np.isfinite(mu)) for mu in (found.mu, found.cold.viscous, found.hot.viscous)):
        raise BadInput(
            f"persson_friction: friction is no number >= 0 everywhere around {scene.ambient - KELVIN:g} degC; "
            "check master curve, spectrum and ambient.temperature"
        )
    if not acting.p.extrapolate and (outside := theory_inputs.beyond(theory, speeds, scene.ambient, scene.load)):
        raise BadInput(
            f"persson_friction.extrapolate: false, but {outside[0]}; choose other --slowest and --fastest, or allow it"
        )
    return replace(found, remarks=(*_own(asked, acting), *acting.p.assumed, *found.remarks))


def _own(asked, acting) -> list[str]:
    """Keys of the case that the theory does not look at."""
    if asked["friction.mu"] == 1.0 and acting.p.weight == 1.0:
        return []
    return ["friction is the theory's alone: friction.mu and persson_friction.weight are not used here"]


def _save(asked, found, told: dict, work: Path) -> None:
    """Write the effective case with its files, curves, numbers and picture."""
    import json

    from flashtemp.viz import friction_curves as picture

    (work / "case.toml").write_text(asked.toml(asked.copy_files(work)), encoding="utf-8")
    found.save(work)
    (work / "friction.json").write_text(json.dumps(finite(told), indent=2) + "\n", encoding="utf-8")
    picture.draw(found, asked.title).savefig(work / "friction.png")
