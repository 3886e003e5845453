"""Thermal properties of rubber and road, with their sources."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Material:
    """Heat conduction properties: `conductivity` W/(m K), `density` kg/m3, `heat_capacity` J/(kg K).

    >>> round(LIBRARY["tread_rubber"].effusivity, 3)
    714.143
    """

    conductivity: float
    density: float
    heat_capacity: float
    source: str = "case file"

    @property
    def volumetric_capacity(self) -> float:
        """rho c in J/(m3 K)."""
        return self.density * self.heat_capacity

    @property
    def diffusivity(self) -> float:
        """D = k/(rho c) in m2/s."""
        return self.conductivity / self.volumetric_capacity

    @property
    def effusivity(self) -> float:
        """e = sqrt(k rho c) in W s^0.5/(m2 K)."""
        return float((self.conductivity * self.volumetric_capacity) ** 0.5)


@dataclass(frozen=True)
class Layer:
    """A layer of the block: its `material`, `thickness` in m, and the `contact_resistance` in m2K/W to the layer above.

    `cells` is the number of cells at mesh = 1; None follows the grading of the block's mesh.
    """

    name: str
    material: Material
    thickness: float
    contact_resistance: float = 0.0
    cells: int | None = None


LIBRARY = {
    "tread_rubber": Material(0.25, 1200.0, 1700.0, "typical filled tread compound"),
    "asphalt": Material(1.0, 2300.0, 950.0, "hot-mix asphalt 0.896 +- 0.023 W/mK, Carlson 2010"),
    "concrete": Material(1.7, 2300.0, 900.0, "Portland cement concrete 1.719 W/mK, Carlson 2010"),
    "granite": Material(2.5, 2650.0, 800.0, "textbook range 2-3.5 W/mK"),
}
