"""Friction table for the solver: mu over speed, temperatures of face and spots, and pressure, interpolated fast.

The temperature for wavenumber q of rubber in a spot is T_q = T_face + s(q) (T_spot - T_face).  T_face is the surface
temperature averaged over the passage of spots, s(q) the fraction of the flash temperature at the depth 1/(2q)
(theory.md, section 1.4; V11).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics.arrays import Array, Value
from flashtemp.physics.friction.heat_kernels import flash_response
from flashtemp.physics.friction.persson import PerssonTheory
from flashtemp.physics.just_in_time import njit
from flashtemp.physics.material import Material
from flashtemp.physics.quantities import KELVIN

TABLE_FILE_NAME = "friction.nc"
TABLE_VERSION = 1  # increase with every change of the contents of a table: older tables are then computed again
NODES_K_BELOW, NODES_K_ABOVE, TEMPERATURE_NODES = 10.0, 220.0, 40  # K around the ambient temperature
PRESSURE_NODES, PRESSURE_RANGE_RATIO = 10, 38.0  # range: mean pressure, rounded to a power of ten, over and times it
SPEED_NODES_PER_DECADE = 8  # where the speed varies
NOTABLE_TABLE_ERROR = 3e-3  # interpolation error, over the largest mu, above which a remark is made
MIN_TABLE_PRESSURE_PA = 1.0  # Pa: friction at lower pressures is that at this pressure
MIN_TABLE_SPEED_M_S = 1e-7  # m/s: friction at rest is that of creep


def node_temperatures(ambient: float) -> Array:
    """Temperatures (n,) K of face and spots at which friction is computed."""
    nodes: np.ndarray = np.linspace(ambient - NODES_K_BELOW, ambient + NODES_K_ABOVE, TEMPERATURE_NODES)
    return nodes


def flash_fraction(q: np.ndarray, rubber: Material, diameter: float, v: float) -> np.ndarray:
    """s(q) (n,): fraction of the flash temperature of a surface flux at wavenumbers q (1/m) and speed v (m/s)."""
    fraction: np.ndarray = flash_response(2.0 * q * np.sqrt(rubber.diffusivity * diameter / v))
    return fraction


@njit(cache=True)
def _cubic_weights(x: Value) -> Value:
    """Lagrange weights of four neighbours for the cubic through them, at x = 0..1 between the inner two."""
    return (
        -x * (x - 1.0) * (x - 2.0) / 6.0,
        (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
        -(x + 1.0) * x * (x - 2.0) / 2.0,
        (x + 1.0) * x * (x - 1.0) / 6.0,
    )


@njit(cache=True)
def _locate_cell(value: Value, low: Value, step: Value, count: Value) -> Value:
    """Index of the first of the four neighbours and the position between the inner two; clipped to the table."""
    at = (value - low) / step
    if at.real < 0.0:  # 0.0 * at keeps the type, real or complex, and drops the derivative
        at = 0.0 * at
    if at.real > count - 1.0:
        at = 0.0 * at + (count - 1.0)
    k = min(max(int(at.real) - 1, 0), count - 4)
    return k, at - (k + 1)


@njit(cache=True)
def _interpolate_tricubic(
    values: Array, lows: Value, steps: Value, face: Value, spot: Value, logp: Value, out: Value
) -> None:
    """Tricubic interpolation of both fields (2, ...) through 64 neighbours at face, spot, logp (n,), real or complex.

    Compiled, because the solver calls it at every evaluation of the contact.
    """
    _, a, b, c = values.shape
    for n in range(out.shape[1]):
        i, x = _locate_cell(face[n], lows[0], steps[0], a)
        j, y = _locate_cell(spot[n], lows[1], steps[1], b)
        k, z = _locate_cell(logp[n], lows[2], steps[2], c)
        wx, wy, wz = _cubic_weights(x), _cubic_weights(y), _cubic_weights(z)
        for field in range(2):
            total = 0.0 * x
            for p in range(4):
                for q in range(4):
                    row = values[field, i + p, j + q]
                    total += (
                        wx[p] * wy[q] * (wz[0] * row[k] + wz[1] * row[k + 1] + wz[2] * row[k + 2] + wz[3] * row[k + 3])
                    )
            out[field, n] = total


@dataclass(frozen=True)
class TableSlice:
    """Friction at one speed over temperatures `T` (K) of face and spots, and ln pressure (Pa).

    `values` (2, faces, spots, pressures): mu, and the part of it whose heat is released in depth.
    """

    T: np.ndarray
    logp: np.ndarray
    values: np.ndarray

    @cached_property
    def _grid_origin(self) -> Value:
        axes = (self.T, self.T, self.logp)
        return np.array([x[0] for x in axes]), np.array([x[1] - x[0] for x in axes])

    def __call__(self, T_spot: Value, T_face: Value, p: Value) -> Value:
        """Both fields (2, n) at spot and face temperatures (K) and pressures (Pa); complex for derivatives."""
        kind = complex if any(np.iscomplexobj(v) for v in (T_spot, T_face, p)) else float
        out = np.empty((2, len(T_spot)), dtype=kind)
        face, spot, logp = np.empty((3, len(T_spot)), dtype=kind)
        face[:], spot[:], logp[:] = T_face, T_spot, np.log(p)
        lows, steps = self._grid_origin
        _interpolate_tricubic(self.values, lows, steps, face, spot, logp, out)
        return out


@dataclass(frozen=True)
class FrictionTable:
    """Friction over ln speed, face, spot (both at `T`, K) and ln pressure.

    `values` (speeds, 2, faces, spots, pressures): mu, and the part of it whose heat is released in depth.

    `error` is the largest deviation from the theory between the nodes, over the largest mu; `made_of` is a digest of
    all inputs of the table.
    """

    logv: np.ndarray
    T: np.ndarray
    logp: np.ndarray
    values: np.ndarray
    error: float
    made_of: str

    @cached_property
    def _cached_slices(self) -> dict[float, TableSlice]:
        return {}

    def describe_excursions(self, run: Any, shift_range: tuple[float, float]) -> list[str]:
        """Remarks on a run that left the range of this table or the temperatures `shift_range` (K) of the modulus."""
        T, p = run.T_spot[np.isfinite(run.T_spot)] + KELVIN, run.pressure.max()
        low, high = max(self.T[0], shift_range[0]), min(self.T[-1], shift_range[1])
        remarks = []
        for beyond, reached, limit in ((T.max() > high, T.max(), high), (T.min() < low, T.min(), low)):
            if beyond:
                remarks.append(
                    f"spots reached {reached - KELVIN:.0f} degC; friction there is that of {limit - KELVIN:.0f} degC"
                )
        if p > np.exp(self.logp[-1]):
            remarks.append(f"pressure reached {p:.3g} Pa; friction there is that of {np.exp(self.logp[-1]):.3g} Pa")
        if self.error > NOTABLE_TABLE_ERROR:
            remarks.append(f"the table of friction is off by up to {100 * self.error:.1g} % of its largest value")
        return remarks

    def slice_at(self, v: float) -> TableSlice:
        """The table at a speed (m/s), clipped to its range; the last slice is cached."""
        if v not in self._cached_slices:
            self._cached_slices.clear()
            self._cached_slices[v] = TableSlice(
                self.T, self.logp, self._interpolate_speed(np.log(max(v, MIN_TABLE_SPEED_M_S)))
            )
        return self._cached_slices[v]

    def _interpolate_speed(self, logv: float) -> np.ndarray:
        if len(self.logv) == 1:
            only: np.ndarray = self.values[0]
            return only
        k, x = _locate_cell(logv, self.logv[0], self.logv[1] - self.logv[0], len(self.logv))
        return np.tensordot(_cubic_weights(x), self.values[k : k + 4], 1)

    def save(self, folder: Path) -> None:
        """Write friction.nc, which `tabulate_friction` reads again."""
        self.to_dataset().to_netcdf(Path(folder) / TABLE_FILE_NAME, engine="h5netcdf")

    def to_dataset(self) -> Any:
        """As xarray: mu(speed, T_face, T_spot, pressure) with units."""
        import xarray as xr

        axes = {"speed": (np.exp(self.logv), "m/s"), "T_face": (self.T - KELVIN, "degC"),
                "T_spot": (self.T - KELVIN, "degC"), "pressure": (np.exp(self.logp), "Pa")}  # fmt: skip
        coords = {k: (k, v, {"units": unit}) for k, (v, unit) in axes.items()}
        about = {"units": "1", "long_name": "friction coefficient"}
        part = {"units": "1", "long_name": "part of mu whose heat is released inside the rubber"}
        attrs = {"largest_error_of_interpolation": self.error, "made_of": self.made_of}
        return xr.Dataset(
            {"mu": (tuple(axes), self.values[:, 0], about), "mu_in_depth": (tuple(axes), self.values[:, 1], part)},
            coords, attrs,
        )  # fmt: skip


class TableLookup:
    """Look up a table for laws; successive calls with the same arrays return the same result without evaluation."""

    def __init__(self, table: Callable[[], FrictionTable]) -> None:
        self._table = cache(table)
        self._arguments: tuple[Value, ...] | None = None
        self._result: tuple[np.ndarray, np.ndarray] = (np.empty(0), np.empty(0))

    def __call__(self, T: Value, now: Any) -> tuple[np.ndarray, np.ndarray]:
        """mu and its part in depth (n,) at spot temperatures T (K) and a LawContext `now`."""
        arguments = (T, T if now.face is None else now.face, now.local_pressure, now.speed)
        # compared by identity: friction and its part in depth are separate laws of the same arrays
        if self._arguments is None or any(a is not b for a, b in zip(self._arguments, arguments, strict=True)):
            p = np.where(np.real(arguments[2]) > MIN_TABLE_PRESSURE_PA, arguments[2], MIN_TABLE_PRESSURE_PA)
            self._arguments, self._result = arguments, self._table().slice_at(now.speed)(T, arguments[1], p)
        return self._result


def tabulate_friction(
    theory: PerssonTheory,
    rubber: Material,
    diameter: float,
    speeds: Value,
    p: float,
    ambient: float,
    shallow: float = 0.0,
    folder: Path | None = None,
) -> FrictionTable:
    """Table of a theory's friction at speeds from lowest to highest (m/s), around a mean nominal pressure p (Pa).

    Temperatures cover 10 K below `ambient` (K) to 220 K above; heat deeper than `shallow` (m) counts as in depth.
    Loads of one decade use the same table.  A saved table of the same theory in `folder` is read.  Raises BadInput
    where friction is not a finite number.
    """
    p = 10.0 ** round(np.log10(p))
    return _cached_table(theory, rubber, diameter, tuple(float(v) for v in speeds), p, ambient, shallow, folder)


@lru_cache(maxsize=8)
def _cached_table(
    theory: PerssonTheory,
    rubber: Material,
    diameter: float,
    speeds: Value,
    p: Value,
    ambient: Value,
    shallow: float,
    folder: Path | None,
) -> FrictionTable:
    low, high = (max(v, MIN_TABLE_SPEED_M_S) for v in speeds)
    count = 1 if high < low * (1 + 1e-9) else max(4, round(SPEED_NODES_PER_DECADE * np.log10(high / low)) + 1)
    logv = np.linspace(np.log(low), np.log(high), count)
    logp = np.linspace(np.log(p / PRESSURE_RANGE_RATIO), np.log(p * PRESSURE_RANGE_RATIO), PRESSURE_NODES)
    T = node_temperatures(ambient)
    axes = [a.tolist() for a in (logv, T, logp)]
    made_of = hashlib.sha256(repr((TABLE_VERSION, theory, rubber, diameter, shallow, axes)).encode()).hexdigest()
    if (saved := _read_saved_table(folder, made_of)) is not None:
        values, error = saved
        return FrictionTable(logv, T, logp, values, error, made_of)
    values = np.array([_theory_friction(theory, rubber, diameter, x, T, T, logp, shallow) for x in logv])
    if not np.all(np.isfinite(values)):
        raise BadInput("persson_friction: friction is not finite everywhere; check master curve and spectrum")
    table = FrictionTable(logv, T, logp, values, np.nan, made_of)
    return replace(table, error=_interpolation_error(table, theory, rubber, diameter, shallow))


def _read_saved_table(folder: Path | None, made_of: str) -> Any:
    """Values and error of the saved table in a folder, if it has the same digest `made_of`; else None."""
    if folder is None or not (Path(folder) / TABLE_FILE_NAME).is_file():
        return None
    import xarray as xr

    try:
        with xr.open_dataset(Path(folder) / TABLE_FILE_NAME, engine="h5netcdf") as found:
            same = found.attrs.get("made_of") == made_of
            values = np.stack([found.mu.values, found.mu_in_depth.values], axis=1)
            return (values, float(found.attrs["largest_error_of_interpolation"])) if same else None
    except (OSError, KeyError, AttributeError, ValueError):
        return None  # a damaged file: the table is computed again


def _theory_friction(
    theory: PerssonTheory,
    rubber: Material,
    diameter: float,
    logv: Value,
    face: Value,
    spot: Value,
    logp: Value,
    shallow: float,
) -> np.ndarray:
    """mu and its part in depth (2, faces, spots, pressures) at one speed."""
    v = float(np.exp(logv))
    fraction = flash_fraction(theory.q, rubber, diameter, v)
    T = face[:, None, None] + (spot[:, None] - face[:, None, None]) * fraction
    result = theory(v, T[:, :, None], np.exp(logp), spot[:, None])
    deep = result.weight * (0.5 / result.q >= shallow)
    return np.array([result.mu, result.density @ deep])


def _interpolation_error(
    table: FrictionTable, theory: PerssonTheory, rubber: Material, diameter: float, shallow: float
) -> float:
    """Largest deviation at the centres of a sample of the table's cells, over the largest mu."""
    middle = 0.5 * (table.T[1:] + table.T[:-1])
    sample = np.unique(np.r_[0, 1 : len(middle) : 3, len(middle) - 1])  # with the outer cells, where it is largest
    face, spot, logp = middle[sample], middle[sample], 0.5 * (table.logp[1:] + table.logp[:-1])
    n = len(table.logv)
    speeds = table.logv if n == 1 else (0.5 * (table.logv[1:] + table.logv[:-1]))[:: max(1, n // 4)]
    worst = 0.0
    for logv in speeds:
        exact = _theory_friction(theory, rubber, diameter, logv, face, spot, logp, shallow)
        a, b, c = np.meshgrid(face, spot, np.exp(logp), indexing="ij")
        cut, at = table.slice_at(float(np.exp(logv))), (b.ravel(), a.ravel(), c.ravel())
        near = cut(*at).reshape(exact.shape)
        worst = max(worst, float(np.max(np.abs(near - exact)) / np.max(table.values)))
    return worst
