"""The area in contact over nominal pressure: Persson's elastic A(p/E), its linear law, and where the two part."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.display import DisplayMixin, DisplayTable, write_json
from flashtemp.model.build import find_theory
from flashtemp.model.case import Case
from flashtemp.physics.friction.persson import PerssonTheory
from flashtemp.physics.friction.rheology import WLF, PronySeries, Rubber

PRESSURE_RATIOS = np.geomspace(1e-4, 10.0, 201)  # nominal pressure over Young's modulus
SATURATION_PRESSURE_RATIO = 0.1  # p/E from which the source says that A saturates
LINEAR_LAW_EXCESS, SATURATED_AREA_FRACTION = (
    0.025,
    0.9,
)  # share by which the linear law is too large where it ends; A/A0 of a saturated contact
EXPERIMENT_PRESSURES_PA = (5e4, 3e5)  # Pa, of friction experiments


@dataclass(frozen=True, eq=False, repr=False)
class AreaStudy(DisplayMixin):
    """A/A0 (n,) of elastic rubber over p/E (n,) on the road of a `case`, and `linear`, the law of light contact.

    `slope` rms of the road, `modulus` E of the case's rubber at rest (Pa), `poisson` its Poisson's ratio.
    """

    case: Case
    ratio: np.ndarray
    area: np.ndarray
    linear: np.ndarray
    slope: float
    modulus: float
    poisson: float

    def interpolate_area(self, ratio: float) -> tuple[float, float]:
        """A/A0 at a p/E, and by which share the linear law is too large there."""
        area, linear = (float(np.exp(np.interp(np.log(ratio), np.log(self.ratio), np.log(y))))
                        for y in (self.area, self.linear))  # fmt: skip
        return area, linear / area - 1.0

    @property
    def linear_up_to(self) -> float:
        """p/E at which the linear law is 2.5 % too large."""
        return float(np.exp(np.interp(LINEAR_LAW_EXCESS, self.linear / self.area - 1.0, np.log(self.ratio))))

    @property
    def saturated_from(self) -> float:
        """p/E at which nine tenths are in contact."""
        return float(np.exp(np.interp(SATURATED_AREA_FRACTION, self.area, np.log(self.ratio))))

    def as_dict(self) -> dict[str, Any]:
        """For --json and area.json."""
        area, off = self.interpolate_area(SATURATION_PRESSURE_RATIO)
        return {
            "title": self.case.title, "rms_slope": self.slope, "modulus_Pa": self.modulus, "poisson": self.poisson,
            "linear_up_to_p_over_E": self.linear_up_to, "area_there": self.interpolate_area(self.linear_up_to)[0],
            "saturated_from_p_over_E": self.saturated_from,
            "at_p_over_E_0.1": {"area": area, "linear_too_large_by": off},
            "p_over_E": self.ratio.tolist(), "area": self.area.tolist(), "linear": self.linear.tolist(),
        }  # fmt: skip

    def save(self, folder: Path, out: Path) -> None:
        """Write the effective case with its files, the curve and numbers into a folder that will be called `out`."""
        (folder / "case.toml").write_text(self.case.toml(self.case.copy_files(folder)), encoding="utf-8")
        rows = [f"{x:.8g},{a:.8g},{b:.8g}" for x, a, b in zip(self.ratio, self.area, self.linear, strict=True)]
        (folder / "area.csv").write_text("\n".join(["p_over_E,area,linear", *rows]) + "\n", encoding="utf-8")
        write_json(self.as_dict() | {"out": str(out)}, folder / "area.json")

    def summary_lines(self) -> list[str]:
        """What was found, in words."""
        area, off = self.interpolate_area(SATURATION_PRESSURE_RATIO)
        low, high = (p / self.modulus for p in EXPERIMENT_PRESSURES_PA)
        end = self.linear_up_to
        return [
            f"A/A0 grows with the load up to p/E = {end:.3g} ({100 * self.interpolate_area(end)[0]:.0f} % in contact; there "
            f"the linear law is {100 * LINEAR_LAW_EXCESS:.1f} % too large) and saturates: {100 * SATURATED_AREA_FRACTION:.0f} % at "
            f"{self.saturated_from:.3g}",
            f"at p/E = {SATURATION_PRESSURE_RATIO:g} {100 * area:.2g} % are in contact, and the linear law is {100 * off:.2g} % too large",
            f"{EXPERIMENT_PRESSURES_PA[0] / 1e6:g} to {EXPERIMENT_PRESSURES_PA[1] / 1e6:g} MPa on this rubber at rest, E = {self.modulus / 1e6:.3g} MPa, "
            f"are p/E = {low:.2g} to {high:.2g}",
        ]

    def __str__(self) -> str:
        head = f"{self.case.title}: elastic contact, rms slope {self.slope:.3g}, Poisson's ratio {self.poisson:g}"
        rows = [f"  {x:9.3g}   {a:8.4f}   {b:8.4f}" for x, a, b in self._sampled_rows()]
        return "\n".join(
            [head, "        p/E       A/A0   linear law", *rows, *(f"  {line}" for line in self.summary_lines())]
        )

    def _sampled_rows(self) -> list[tuple[float, float, float]]:
        some = range(0, len(self.ratio), 20)
        return [(float(self.ratio[i]), float(self.area[i]), float(self.linear[i])) for i in some]

    def to_table(self) -> DisplayTable:
        title = f"{self.case.title}: area in contact, rms slope {self.slope:.3g}"
        return DisplayTable(title, self._sampled_rows(), ("p/E", "A/A0", "linear law"), self.summary_lines())


def study_contact_area(case: Case) -> AreaStudy:
    """Area in contact of elastic rubber on the road of a case over p/E.  Raises BadInput."""
    _, acting = find_theory(case)
    theory, rest = acting.p.theory, acting.p.theory.rubber
    elastic = Rubber(PronySeries(1.0, (), ()), WLF(1.0, 1e3, 293.15), rest.poisson)
    full = PerssonTheory(elastic, theory.road)
    light = PerssonTheory(elastic, theory.road, saturation=False)
    contact = 1.0 / (1.0 - rest.poisson**2)
    found = full(1.0, 293.15, PRESSURE_RATIOS)
    slope = float(np.sqrt(8.0 * found.G_at_q1[0]) * PRESSURE_RATIOS[0] / contact)
    modulus = float(abs(rest.modulus(0.0)))
    return AreaStudy(
        case, PRESSURE_RATIOS, found.area, light(1.0, 293.15, PRESSURE_RATIOS).area, slope, modulus, rest.poisson
    )
