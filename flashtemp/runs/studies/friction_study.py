"""Friction of a case over speed and temperature from the theory alone, without the heating of a block."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.display import DisplayMixin, DisplayTable, write_json
from flashtemp.errors import BadInput
from flashtemp.model.build import find_theory
from flashtemp.model.case import Case
from flashtemp.model.priors import find_uncertain_inputs
from flashtemp.model.scene import ActiveEffect
from flashtemp.physics.friction import friction_curves, theory_inputs
from flashtemp.physics.friction.flash_temperature import ContactSpots
from flashtemp.physics.quantities import KELVIN
from flashtemp.runs.studies.friction_trends import FrictionTrend, find_trends

SPEED_COUNT, SPEED_LIMITS_M_S = 60, (1e-12, 1e3)  # speeds; m/s
NOT_MODELLED = (
    "on the hot branch: heat of the adhesive part, heat that flows into the road; stick-slip between contact regions"
)


@dataclass(frozen=True, eq=False, repr=False)
class FrictionStudy(DisplayMixin):
    """Friction `curves` over speed and temperature by the theory of a `case`; `signs` are its trends."""

    case: Case
    curves: friction_curves.FrictionCurves
    signs: tuple[FrictionTrend, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """All numbers as plain data, as in friction.json."""
        return self.curves.as_dict() | {
            "title": self.case.title, "not_modelled": NOT_MODELLED, "signs": [s.as_dict() for s in self.signs],
        }  # fmt: skip

    def save(self, folder: Path, out: Path) -> None:
        """Write the complete case with its files, curves and numbers to `folder`, later renamed to `out`."""
        (folder / "case.toml").write_text(self.case.toml(self.case.copy_files(folder)), encoding="utf-8")
        self.curves.save(folder)
        write_json(self.as_dict() | {"out": str(out)}, folder / "friction.json")

    def __str__(self) -> str:
        signs = "".join(f"\n  {s}" for s in self.signs)
        return f"{self.case.title}: {self.curves}{signs}\n  not modelled: {NOT_MODELLED}"

    def to_table(self) -> DisplayTable:
        c, speeds = self.curves, self.curves.speed
        indices = np.unique(np.linspace(0, len(speeds) - 1, 12).round().astype(int))
        head = ("speed, m/s", "mu cold", "mu hot", "highest T, degC", "area in contact")
        rows = [
            tuple(float(v[i]) for v in (speeds, c.cold.mu, c.hot.mu, c.highest, c.area)) for i in indices
        ]  # fmt: skip
        title = f"{self.case.title}: {c.T0 - KELVIN:g} degC, {c.p / 1e6:g} MPa"
        return DisplayTable(title, rows, head, [*c.remarks, *map(str, self.signs), f"not modelled: {NOT_MODELLED}"])


def refuse_speeds(slowest: float, fastest: float) -> None:
    """Raise BadInput unless slowest < fastest (m/s) within the limits of the theory."""
    low, high = SPEED_LIMITS_M_S
    if not low <= slowest < fastest <= high:
        raise BadInput(
            f"--slowest, --fastest: {slowest:g}, {fastest:g}; give {low:g} <= slowest < fastest <= {high:g} m/s"
        )


def study_friction(case: Case, slowest: float = 1e-6, fastest: float = 10.0) -> FrictionStudy:
    """Compute the friction curves of a case from the slowest to the fastest speed, m/s.

    Raises BadInput, SolverFailure.
    """
    refuse_speeds(slowest, fastest)
    scene, acting = find_theory(case)
    theory, spots = acting.p.theory, ContactSpots(scene.spot_diameter)
    speeds = np.geomspace(slowest, fastest, SPEED_COUNT)
    found = friction_curves.compute_curves(theory, scene.block, spots, speeds, scene.ambient, scene.load)
    if not all(np.all((mu >= 0) & np.isfinite(mu)) for mu in (found.mu, found.cold.viscous, found.hot.viscous)):
        raise BadInput(
            f"persson_friction: friction is negative or not finite around {scene.ambient - KELVIN:g} degC; "
            "check master curve, spectrum and ambient.temperature"
        )
    if not acting.p.extrapolate and (
        outside := theory_inputs.describe_extrapolation(theory, speeds, scene.ambient, scene.load)
    ):
        raise BadInput(
            f"persson_friction.extrapolate: false, but {outside[0]}; choose other --slowest and --fastest, or allow it"
        )
    return FrictionStudy(
        case, replace(found, remarks=(*_ignored_keys(case, acting), *acting.p.assumed, *found.remarks)),
        find_trends(case, find_uncertain_inputs(case)[0]),
    )  # fmt: skip


def _ignored_keys(case: Case, acting: ActiveEffect) -> list[str]:
    """A remark where the theory ignores keys of the case."""
    if case["friction.mu"] == 1.0 and acting.p.weight == 1.0:
        return []
    return ["friction is that of the theory alone: friction.mu and persson_friction.weight are not used"]
