"""Theoretical friction over speed and temperature, and the part of it that a slope tester can measure.

>>> from flashtemp.physics.friction import flash_temperature, persson, rheology, roughness_spectrum
>>> from flashtemp.physics.material import LIBRARY
>>> theory = persson.PerssonTheory(rheology.READY_RUBBERS["A"], roughness_spectrum.READY_ROADS["asphalt A"])
>>> spots = flash_temperature.ContactSpots(3e-3)
>>> curves = compute_curves(theory, LIBRARY["tread_rubber"], spots, np.geomspace(1e-3, 1e1, 17), 293.15, 1.5e5)
>>> print(" ".join(f"{1e6 * d:.2g}" for d in curves.depths.depths_at_speed(0.1)), "um")
76 1.7 0.29 um
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.physics.arrays import Value
from flashtemp.physics.friction import theory_inputs
from flashtemp.physics.friction.curve_peak import find_peak
from flashtemp.physics.friction.flash_temperature import ContactSpots, FrictionBranch, compute_branches
from flashtemp.physics.friction.persson import PerssonTheory
from flashtemp.physics.material import Material
from flashtemp.physics.quantities import KELVIN

CURVE_SPEEDS_M_S = np.geomspace(1e-6, 10.0, 60)  # m/s
TABLE_K_BELOW, TABLE_K_ABOVE, TABLE_ROWS = 20.0, 100.0, 40  # K around the background temperature; rows of the table
SHIFT_STEP_K = 40.0  # temperature step for which the shift of the curves is reported
DEPTH_HEAT_FRACTIONS = (0.1, 0.5, 0.9)  # fractions of the viscoelastic heat whose depths are reported
MAX_SPOT_FRACTION = 0.3  # contact fraction up to which contact regions are separate spots
CURVES_CSV_NAME, CURVES_TABLE_NAME = "friction.csv", "mu_table.nc"
CSV_COLUMN_PATHS = {
    "speed_m_s": "speed", "mu_cold": "cold.mu", "viscous_cold": "cold.viscous", "adhesive_cold": "cold.adhesive",
    "mu_hot": "hot.mu", "viscous_hot": "hot.viscous", "adhesive_hot": "hot.adhesive", "T_hot_degC": "highest",
    "area_cold": "area", "spot_fraction": "phi",
}  # fmt: skip


def is_steady_in_slope_tester(mu: np.ndarray) -> np.ndarray:
    """Points of mu(v), in order of increasing speed, at which a tester with prescribed force slides steadily.

    These are the points with at least the friction of all slower ones: where friction falls with speed, a constant
    force accelerates the block (C9).
    """
    return mu >= np.maximum.accumulate(mu)


@dataclass(frozen=True, eq=False)
class HeatDepths:
    """Depth of the viscoelastic heat: `deeper` (m, n) is the fraction released over depths 1/(2q) >= `depth` (n,) m.

    At `speed` (m,) m/s and the background temperature.
    """

    speed: np.ndarray
    depth: np.ndarray
    deeper: np.ndarray

    def depths_at_speed(self, v: float) -> tuple[float, ...]:
        """Depths (m) below which 10, 50 and 90 % of the heat are released, at the speed closest to v (m/s)."""
        row = self.deeper[int(np.argmin(np.abs(np.log(self.speed / v))))]
        return tuple(float(np.exp(np.interp(s, row, np.log(self.depth)))) for s in DEPTH_HEAT_FRACTIONS)


@dataclass(frozen=True, eq=False)
class FrictionCurves:
    """Friction at nominal pressure `p` (Pa), background `T0` (K) and over the speeds (n,) of both branches.

    `area` A/A0 and contact fraction `phi` (n,) of `spots` without flash temperature; `mu` (n, m) over temperatures
    `T` (m,) K; `shift`: factors by which SHIFT_STEP_K raises the speeds of the viscoelastic part and the shear stress.
    """

    cold: FrictionBranch
    hot: FrictionBranch
    area: np.ndarray
    phi: np.ndarray
    T: np.ndarray
    mu: np.ndarray
    depths: HeatDepths
    spots: ContactSpots
    T0: float
    p: float
    shift: tuple[float, float | None]
    remarks: tuple[str, ...] = ()

    @property
    def speed(self) -> np.ndarray:
        """Speeds (n,) m/s."""
        return self.cold.speed

    @property
    def highest(self) -> np.ndarray:
        """Highest temperature T_q (n,) of all wavenumbers on the hot branch, degC."""
        return self.hot.T - KELVIN

    @property
    def branches(self) -> dict[str, FrictionBranch]:
        return {"cold": self.cold, "hot": self.hot}

    def peak_speeds(self) -> np.ndarray:
        """Speed (m,) m/s of the maximum of mu at every temperature of the table, nan where it is at an end."""
        peaks = [find_peak(self.speed, column) for column in self.mu.T]
        return np.array([np.nan if peak.is_at_edge else peak.at for peak in peaks])

    def as_dict(self) -> dict[str, Any]:
        """Numbers for JSON: m/s, degC, m; a maximum at an end of the curve is null."""
        tops = {name: find_peak(self.speed, b.mu) for name, b in self.branches.items()}
        return {
            "T0_degC": self.T0 - KELVIN,
            "pressure_Pa": self.p,
            "spot_diameter_m": self.spots.diameter,
            "maximum": {k: None if t.is_at_edge else {"speed": t.at, "mu": t.value} for k, t in tops.items()},
            "held_by_slope_tester": {k: is_steady_in_slope_tester(b.mu).tolist() for k, b in self.branches.items()},
            "heat_deeper_m": [
                {"speed": float(v)}
                | {
                    f"{100 * s:.0f} %": d
                    for s, d in zip(DEPTH_HEAT_FRACTIONS, self.depths.depths_at_speed(v), strict=True)
                }
                for v in self.depths.speed
            ],
            "shift": {"warmer_K": SHIFT_STEP_K, "viscous": self.shift[0], "shear_stress": self.shift[1]},
            "remarks": list(self.remarks),
            "curves": {name: column.tolist() for name, column in self.columns().items()},
        }

    def columns(self) -> dict[str, np.ndarray]:
        """The curves (n,) by their column names in friction.csv."""
        out = {}
        for name, path in CSV_COLUMN_PATHS.items():
            value: Any = self
            for part in path.split("."):
                value = getattr(value, part)
            out[name] = value
        return out

    def save(self, folder: Path) -> None:
        """Write friction.csv, a row per speed, and mu_table.nc, mu over speed and temperature."""
        data = self.columns() | {f"held_{name}": is_steady_in_slope_tester(b.mu) for name, b in self.branches.items()}
        lines = [",".join(data), *(",".join(f"{x:.8g}" for x in row) for row in zip(*data.values(), strict=True))]
        (Path(folder) / CURVES_CSV_NAME).write_text("\n".join(lines) + "\n", encoding="utf-8")
        self.to_dataset().to_netcdf(Path(folder) / CURVES_TABLE_NAME, engine="h5netcdf")

    def to_dataset(self) -> Any:
        """As xarray: mu(speed, temperature) with units."""
        import xarray as xr

        about = {"units": "1", "long_name": "friction coefficient without flash temperature"}
        coords = {
            "speed": ("speed", self.speed, {"units": "m/s", "long_name": "sliding speed"}),
            "temperature": ("temperature", self.T - KELVIN, {"units": "degC", "long_name": "temperature"}),
        }
        attrs = {"pressure_Pa": self.p, "Conventions": "CF-1.11"}
        return xr.Dataset({"mu": (("speed", "temperature"), self.mu, about)}, coords, attrs)

    def __str__(self) -> str:
        lines = [
            f"{self.T0 - KELVIN:g} degC, {self.p / 1e6:g} MPa, contact regions of {1e3 * self.spots.diameter:g} mm",
            "       v m/s   mu cold = visc + adh      hot = visc + adh   highest T     A/A0    phi",
            *(self._format_row(i) for i in _rows_per_decade(self.speed)),
            *(self._describe_maximum(name) for name in self.branches),
        ]
        v = self.depths.speed[1]
        deep, half, near = (f"{1e6 * d:.2g}" for d in self.depths.depths_at_speed(v))
        if half != "nan":
            lines.append(
                f"  viscoelastic heat at {v:.3g} m/s: a tenth is released deeper than {deep} um, "
                f"half deeper than {half} um, nine tenths deeper than {near} um"
            )
        words = [f"the viscoelastic part to {self.shift[0]:.3g}-fold speed"]
        if self.shift[1] is not None:
            words.append(f"the shear stress of the real contact to {self.shift[1]:.3g}-fold")
        lines.append(f"  {SHIFT_STEP_K:g} K more move {', '.join(words)}")
        return "\n".join([*lines, *(f"  remark: {r}" for r in self.remarks)])

    def _format_row(self, i: int) -> str:
        c, h = self.cold, self.hot
        return (
            f"  {self.speed[i]:10.3g}   {c.mu[i]:7.4f} {c.viscous[i]:6.4f} {c.adhesive[i]:6.4f}   "
            f"{h.mu[i]:7.4f} {h.viscous[i]:6.4f} {h.adhesive[i]:6.4f}   {self.highest[i]:6.1f} degC  "
            f"{self.area[i]:7.2g} {self.phi[i]:6.3f}"
        )

    def _describe_maximum(self, name: str) -> str:
        mu = self.branches[name].mu
        top = find_peak(self.speed, mu)
        if not top.is_at_edge:
            return (
                f"  {name}: highest {top.value:.4f} at {top.at:.3g} m/s; a slope tester, which sets the force, "
                "holds no faster sliding"
            )
        if top.first:
            return f"  {name}: highest at the slowest speed; a slope tester, which sets the force, holds none of it"
        if is_steady_in_slope_tester(mu).all():
            return f"  {name}: rises throughout; a slope tester reaches all of it"
        return f"  {name}: highest at the fastest speed; a slope tester skips what falls before"


def compute_curves(
    theory: PerssonTheory,
    rubber_material: Material,
    spots: ContactSpots,
    speeds: Value = CURVE_SPEEDS_M_S,
    T0: float = 293.15,
    p: float = 1.5e5,
) -> FrictionCurves:
    """Friction over `speeds` (n,) m/s, rising, at background T0 (K) and nominal pressure p (Pa).

    Raises BadInput where the road has no waves as long as the spots, SolverFailure where friction and flash temperature
    do not agree.
    """
    speeds = np.asarray(speeds, dtype=float)
    cold, hot = compute_branches(theory, rubber_material, spots, speeds, T0, p)
    phi = np.array([spots.contact_fraction(theory, v, T0, p) for v in speeds])
    T = _table_temperatures(theory, T0)
    slow_and_fast = speeds[0], speeds[-1]
    return FrictionCurves(
        cold, hot, theory(speeds, T0, p).area, phi, T, theory(speeds[:, None], T, p).mu,
        _heat_depths(theory, speeds, T0, p), spots, T0, p, _speed_shifts(theory, T0),
        tuple(_curve_remarks(theory, slow_and_fast, T0, p, hot.T.max(), phi.max())),
    )  # fmt: skip


def _table_temperatures(theory: PerssonTheory, T0: float) -> np.ndarray:
    """Temperatures (m,) K of the table: around T0, as far as the shift factors reach."""
    low, high = theory.rubber.shift.valid_range
    low, high = max(T0 - TABLE_K_BELOW, min(low, T0)), min(T0 + TABLE_K_ABOVE, max(high, T0 + 1.0))
    return np.linspace(low, high, TABLE_ROWS)


def _speed_shifts(theory: PerssonTheory, T0: float) -> tuple[float, float | None]:
    """Factors by which the speeds of viscoelastic loss and shear stress increase over SHIFT_STEP_K above T0."""
    parts = [theory.rubber.shift_factor] + ([] if theory.shear is None else [theory.shear.shift_factor])
    factors = [float(f(T0) / f(T0 + SHIFT_STEP_K)) for f in parts]
    return factors[0], factors[1] if len(factors) > 1 else None


def _heat_depths(theory: PerssonTheory, speeds: np.ndarray, T0: float, p: float) -> HeatDepths:
    """Depths at the highest speed and two and four decades below, or at both ends and in the middle."""
    top = np.log10(speeds[-1])
    v = 10.0 ** (top - min(2.0, 0.5 * (top - np.log10(speeds[0]))) * np.arange(2, -1, -1))
    result = theory(v, T0, p)
    viscous = np.where(result.viscous > 0, result.viscous, np.nan)[:, None]
    fraction = theory.cumulative_integral(result.density) / viscous
    return HeatDepths(v, 0.5 / theory.q, np.maximum.accumulate(fraction, axis=1))


def _curve_remarks(theory: PerssonTheory, speeds: Value, T0: float, p: float, hottest: float, phi: float) -> list[str]:
    """Warnings about the validity of the curves; temperatures in K."""
    remarks = theory_inputs.describe_extrapolation(theory, speeds, T0, p)
    low, high = theory.rubber.shift.valid_range
    if low <= T0 <= high < hottest:
        remarks.append(
            f"the hot branch reaches {hottest - KELVIN:.0f} degC, beyond the shift factors "
            f"({low - KELVIN:.0f} to {high - KELVIN:.0f} degC)"
        )
    if phi > MAX_SPOT_FRACTION:
        remarks.append(
            f"contact fractions reach {phi:.2g}: contact regions are hardly separate, and their heat is spread out"
        )
    return remarks


def _rows_per_decade(speed: np.ndarray) -> list[int]:
    """Indices of the speeds in the printed table: about one per decade."""
    wanted = np.arange(np.log10(speed[0]), np.log10(speed[-1]) + 1e-9, 1.0)
    return sorted({int(np.argmin(np.abs(np.log10(speed) - x))) for x in wanted} | {len(speed) - 1})
