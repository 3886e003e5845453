"""Friction as the solver needs it: mu over speed, temperatures of face and spots and pressure, interpolated fast.

Every wavenumber of rubber in a spot feels T_q = T_face + s(q) (T_spot - T_face): T_face is the surface averaged over
the passage of spots, s(q) the share of the flash temperature that its depth 1/(2q) feels (theory 1.4, V11).
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
TABLE_VERSION = 1  # to be counted up with every change of what a table holds: older ones are made anew
NODES_K_BELOW, NODES_K_ABOVE, TEMPERATURE_NODES = 10.0, 220.0, 40  # K around the ambient temperature
PRESSURE_NODES, PRESSURE_RANGE_RATIO = (
    10,
    38.0,
)  # nodes; from the power of ten next to the mean pressure over REACH to REACH times it
SPEED_NODES_PER_DECADE = 8  # of speed, where it varies
NOTABLE_TABLE_ERROR = 3e-3  # error of a table, over its largest mu, that is worth a word
MIN_TABLE_PRESSURE_PA = 1.0  # Pa: below, friction is that at this pressure
MIN_TABLE_SPEED_M_S = 1e-7  # m/s: friction at rest is that of creep


def node_temperatures(ambient: float) -> Array:
    """Temperatures (n,) K of face and spots at which friction is computed."""
    found: np.ndarray = np.linspace(ambient - NODES_K_BELOW, ambient + NODES_K_ABOVE, TEMPERATURE_NODES)
    return found


def flash_fraction(q: np.ndarray, rubber: Material, diameter: float, v: float) -> np.ndarray:
    """s(q) (n,): the share of the flash temperature of a surface flux that reaches wavenumbers q (1/m) at v (m/s)."""
    found: np.ndarray = flash_response(2.0 * q * np.sqrt(rubber.diffusivity * diameter / v))
    return found


@njit(cache=True)
def _cubic_weights(x: Value) -> Value:
    """Of four neighbours, for the cubic through them at x = 0..1 between the inner two."""
    return (
        -x * (x - 1.0) * (x - 2.0) / 6.0,
        (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
        -(x + 1.0) * x * (x - 2.0) / 2.0,
        (x + 1.0) * x * (x - 1.0) / 6.0,
    )


@njit(cache=True)
def _locate_cell(value: Value, low: Value, step: Value, count: Value) -> Value:
    """First of the four neighbours and the place between the inner two; held outside the table."""
    at = (value - low) / step
    if at.real < 0.0:
        at = 0.0 * at
    if at.real > count - 1.0:
        at = 0.0 * at + (count - 1.0)
    k = min(max(int(at.real) - 1, 0), count - 4)
    return k, at - (k + 1)


@njit(cache=True)
def _interpolate_tricubic(
    values: Array, lows: Value, steps: Value, face: Value, spot: Value, logp: Value, out: Value
) -> None:
    """Tricubic through 64 neighbours of both fields (2, ...) for every face, spot and logp, real or complex."""
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
        """Both (2, n) at spot and face temperatures (K) and pressures (Pa); complex arguments pass derivatives on."""
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

    `error` is the largest deviation from the theory between the nodes, as a share of the largest mu; `made_of` a mark
    of everything that the table follows from.
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
        """In words: where a run left this table, or the temperatures (K) between which the modulus is `shift_range`."""
        T, p = run.T_spot[np.isfinite(run.T_spot)] + KELVIN, run.pressure.max()
        low, high = max(self.T[0], shift_range[0]), min(self.T[-1], shift_range[1])
        said = []
        for beyond, reached, held in ((T.max() > high, T.max(), high), (T.min() < low, T.min(), low)):
            if beyond:
                said.append(
                    f"spots reached {reached - KELVIN:.0f} degC; friction there is that of {held - KELVIN:.0f} degC"
                )
        if p > np.exp(self.logp[-1]):
            said.append(f"pressure reached {p:.3g} Pa; friction there is that of {np.exp(self.logp[-1]):.3g} Pa")
        if self.error > NOTABLE_TABLE_ERROR:
            said.append(f"the table of friction is off by up to {100 * self.error:.1g} % of its largest value")
        return said

    def slice_at(self, v: float) -> TableSlice:
        """The table at a speed (m/s), held outside its range; the last one asked for is kept."""
        if v not in self._cached_slices:
            self._cached_slices.clear()
            self._cached_slices[v] = TableSlice(
                self.T, self.logp, self._interpolate_speed(np.log(max(v, MIN_TABLE_SPEED_M_S)))
            )
        return self._cached_slices[v]

    def _interpolate_speed(self, logv: float) -> np.ndarray:
        if len(self.logv) == 1:
            found: np.ndarray = self.values[0]
            return found
        k, x = _locate_cell(logv, self.logv[0], self.logv[1] - self.logv[0], len(self.logv))
        return np.tensordot(_cubic_weights(x), self.values[k : k + 4], 1)

    def save(self, folder: Path) -> None:
        """Write friction.nc, from which `tabulate_friction` takes the table up again."""
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
    """What a table says at the spots of a moment; laws that ask for the same, one after the other, share one look."""

    def __init__(self, table: Callable[[], FrictionTable]) -> None:
        self._table = cache(table)
        self._asked: tuple[Value, ...] | None = None
        self._found: tuple[np.ndarray, np.ndarray] = (np.empty(0), np.empty(0))

    def __call__(self, T: Value, now: Any) -> tuple[np.ndarray, np.ndarray]:
        """mu and its part in depth (n,) at spot temperatures T (K) and a scene.Moment."""
        asked = (T, T if now.face is None else now.face, now.local_pressure, now.speed)
        if self._asked is None or any(a is not b for a, b in zip(self._asked, asked, strict=True)):
            pressed = np.where(np.real(asked[2]) > MIN_TABLE_PRESSURE_PA, asked[2], MIN_TABLE_PRESSURE_PA)
            self._asked, self._found = asked, self._table().slice_at(now.speed)(T, asked[1], pressed)
        return self._found


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
    """The friction of a theory at speeds from lowest to highest (m/s), around a mean nominal pressure p (Pa).

    Temperatures reach from a little below `ambient` (K) to far above; heat deeper than `shallow` (m) is in depth.
    Loads of one decade share a table.  One of the same theory in `folder` is taken from there.  Raises BadInput where
    friction is no number.
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
    if (kept := _read_saved_table(folder, made_of)) is not None:
        values, error = kept
        return FrictionTable(logv, T, logp, values, error, made_of)
    values = np.array([_theory_friction(theory, rubber, diameter, x, T, T, logp, shallow) for x in logv])
    if not np.all(np.isfinite(values)):
        raise BadInput("persson_friction: friction is no finite number everywhere; check master curve and spectrum")
    found = FrictionTable(logv, T, logp, values, np.nan, made_of)
    return replace(found, error=_interpolation_error(found, theory, rubber, diameter, shallow))


def _read_saved_table(folder: Path | None, made_of: str) -> Any:
    """Values and error of the table in a folder, if it is of the same making."""
    if folder is None or not (Path(folder) / TABLE_FILE_NAME).is_file():
        return None
    import xarray as xr

    try:
        with xr.open_dataset(Path(folder) / TABLE_FILE_NAME, engine="h5netcdf") as found:
            same = found.attrs.get("made_of") == made_of
            values = np.stack([found.mu.values, found.mu_in_depth.values], axis=1)
            return (values, float(found.attrs["largest_error_of_interpolation"])) if same else None
    except (OSError, KeyError, AttributeError, ValueError):
        return None  # damaged: made anew


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
    share = flash_fraction(theory.q, rubber, diameter, v)
    T = face[:, None, None] + (spot[:, None] - face[:, None, None]) * share
    found = theory(v, T[:, :, None], np.exp(logp), spot[:, None])
    deep = found.weight * (0.5 / found.q >= shallow)
    return np.array([found.mu, found.density @ deep])


def _interpolation_error(
    table: FrictionTable, theory: PerssonTheory, rubber: Material, diameter: float, shallow: float
) -> float:
    """Largest deviation at the middles of the table's cells, some of them, over the largest mu."""
    middle = 0.5 * (table.T[1:] + table.T[:-1])
    some = np.unique(np.r_[0, 1 : len(middle) : 3, len(middle) - 1])  # the outermost are the worst
    face, spot, logp = middle[some], middle[some], 0.5 * (table.logp[1:] + table.logp[:-1])
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
