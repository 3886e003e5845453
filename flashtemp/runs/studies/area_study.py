"""Contact area over nominal pressure: Persson's elastic A(p/E), its linear law, and where they deviate."""

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
SATURATION_PRESSURE_RATIO = 0.1  # p/E at which A saturates according to the source
LINEAR_LAW_EXCESS = 0.025  # relative excess of the linear law at the end of its range
SATURATED_AREA_FRACTION = 0.9  # A/A0 of a saturated contact
EXPERIMENT_PRESSURES_PA = (5e4, 3e5)  # range of friction experiments


@dataclass(frozen=True, eq=False, repr=False)
class AreaStudy(DisplayMixin):
    """Contact area A/A0 (n,) of elastic rubber over p/E (n,) on the road of a `case`, theory.md, eq. (16).

    `linear` (n,) is the law of light contact.  `slope`: rms slope of the road; `modulus`: E of the rubber at rest, Pa;
    `poisson`: its Poisson's ratio.
    """

    case: Case
    ratio: np.ndarray
    area: np.ndarray
    linear: np.ndarray
    slope: float
    modulus: float
    poisson: float

    def interpolate_area(self, ratio: float) -> tuple[float, float]:
        """A/A0 at a ratio p/E, and the relative excess of the linear law there."""
        area, linear = (float(np.exp(np.interp(np.log(ratio), np.log(self.ratio), np.log(y))))
                        for y in (self.area, self.linear))  # fmt: skip
        return area, linear / area - 1.0

    @property
    def linear_up_to(self) -> float:
        """p/E at which the linear law is 2.5 % too large."""
        return float(np.exp(np.interp(LINEAR_LAW_EXCESS, self.linear / self.area - 1.0, np.log(self.ratio))))

    @property
    def saturated_from(self) -> float:
        """p/E at which 90 % of the nominal area is in contact."""
        return float(np.exp(np.interp(SATURATED_AREA_FRACTION, self.area, np.log(self.ratio))))

    def as_dict(self) -> dict[str, Any]:
        """All numbers as plain data, as in area.json."""
        area, off = self.interpolate_area(SATURATION_PRESSURE_RATIO)
        return {
            "title": self.case.title, "rms_slope": self.slope, "modulus_Pa": self.modulus, "poisson": self.poisson,
            "linear_up_to_p_over_E": self.linear_up_to, "area_there": self.interpolate_area(self.linear_up_to)[0],
            "saturated_from_p_over_E": self.saturated_from,
            "at_p_over_E_0.1": {"area": area, "linear_too_large_by": off},
            "p_over_E": self.ratio.tolist(), "area": self.area.tolist(), "linear": self.linear.tolist(),
        }  # fmt: skip

    def save(self, folder: Path, out: Path) -> None:
        """Write the complete case with its files, the curve and the numbers to `folder`, later renamed to `out`."""
        (folder / "case.toml").write_text(self.case.toml(self.case.copy_files(folder)), encoding="utf-8")
        rows = [f"{x:.8g},{a:.8g},{b:.8g}" for x, a, b in zip(self.ratio, self.area, self.linear, strict=True)]
        (folder / "area.csv").write_text("\n".join(["p_over_E,area,linear", *rows]) + "\n", encoding="utf-8")
        write_json(self.as_dict() | {"out": str(out)}, folder / "area.json")

    def summary_lines(self) -> list[str]:
        """The conclusions, one line each."""
        area, off = self.interpolate_area(SATURATION_PRESSURE_RATIO)
        low, high = (p / self.modulus for p in EXPERIMENT_PRESSURES_PA)
        end = self.linear_up_to
        return [
            f"A/A0 is proportional to the load up to p/E = {end:.3g} ({100 * self.interpolate_area(end)[0]:.0f} % in "
            f"contact; the linear law is {100 * LINEAR_LAW_EXCESS:.1f} % too large there); "
            f"{100 * SATURATED_AREA_FRACTION:.0f} % are in contact at p/E = {self.saturated_from:.3g}",
            f"at p/E = {SATURATION_PRESSURE_RATIO:g}, {100 * area:.2g} % are in contact, and the linear law is "
            f"{100 * off:.2g} % too large",
            f"{EXPERIMENT_PRESSURES_PA[0] / 1e6:g} to {EXPERIMENT_PRESSURES_PA[1] / 1e6:g} MPa on this rubber at rest, "
            f"E = {self.modulus / 1e6:.3g} MPa, correspond to p/E = {low:.2g} to {high:.2g}",
        ]

    def __str__(self) -> str:
        head = f"{self.case.title}: elastic contact, rms slope {self.slope:.3g}, Poisson's ratio {self.poisson:g}"
        rows = [f"  {x:9.3g}   {a:8.4f}   {b:8.4f}" for x, a, b in self._sampled_rows()]
        return "\n".join(
            [head, "        p/E       A/A0   linear law", *rows, *(f"  {line}" for line in self.summary_lines())]
        )

    def _sampled_rows(self) -> list[tuple[float, float, float]]:
        indices = range(0, len(self.ratio), 20)
        return [(float(self.ratio[i]), float(self.area[i]), float(self.linear[i])) for i in indices]

    def to_table(self) -> DisplayTable:
        title = f"{self.case.title}: area in contact, rms slope {self.slope:.3g}"
        return DisplayTable(title, self._sampled_rows(), ("p/E", "A/A0", "linear law"), self.summary_lines())


def study_contact_area(case: Case) -> AreaStudy:
    """Compute the contact area of elastic rubber on the road of a case over p/E.  Raises BadInput."""
    _, acting = find_theory(case)
    theory, rest = acting.p.theory, acting.p.theory.rubber
    elastic = Rubber(PronySeries(1.0, (), ()), WLF(1.0, 1e3, 293.15), rest.poisson)
    full = PerssonTheory(elastic, theory.road)
    light = PerssonTheory(elastic, theory.road, saturation=False)
    contact = 1.0 / (1.0 - rest.poisson**2)  # contact modulus of a rubber with E = 1 Pa
    result = full(1.0, 293.15, PRESSURE_RATIOS)
    slope = float(np.sqrt(8.0 * result.G_at_q1[0]) * PRESSURE_RATIOS[0] / contact)
    modulus = float(abs(rest.modulus(0.0)))
    return AreaStudy(
        case, PRESSURE_RATIOS, result.area, light(1.0, 293.15, PRESSURE_RATIOS).area, slope, modulus, rest.poisson
    )
