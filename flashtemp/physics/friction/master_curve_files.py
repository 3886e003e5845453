"""Read master curves and shift factors as DMA and rheometer programs export them.

Moduli are read as E', E'' or G', G'' (E = 2 (1 + nu) G) or with tan delta, at frequencies in Hz or rad/s.  Raw sweeps
at several temperatures become one curve by time-temperature superposition, E(omega, T) = E(omega a_T, T_ref).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics import interpolation
from flashtemp.physics.friction.instrument_tables import (
    ColumnSpec,
    InstrumentTable,
    read_instrument_table,
    table_of_rows,
)
from flashtemp.physics.friction.rheology import WLF, MeasuredModulus, MeasuredShift
from flashtemp.physics.interpolation import Source
from flashtemp.physics.quantities import KELVIN

SAME_FREQUENCY_DECADES = 1e-3  # decades: frequencies closer than this are averaged
SAME_POINT_DECADES = 0.02  # decades: points of different sweeps closer than this are averaged
SWEEP_GAP_K = 1.5  # smallest temperature difference of two sweeps

ANY = ""  # pattern that matches every name
PRESSURE_UNITS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "N/mm2": 1e6, "dyn/cm2": 0.1}
MODULUS_UNITS = {
    k: (v, 0.0) for k, v in (PRESSURE_UNITS | {"pa": 1.0, "kpa": 1e3, "Mpa": 1e6, "MPA": 1e6, "Gpa": 1e9}).items()
}
DIMENSIONLESS_UNITS = {k: (1.0, 0.0) for k in ("", "-", "1", "delta", "δ")}
TEMPERATURE_UNITS = {k: (1.0, KELVIN) for k in ("degC", "C", "Celsius")} | {k: (1.0, 0.0) for k in ("K", "Kelvin")}
CYCLE_UNITS = {k: (2 * np.pi, 0.0) for k in ("Hz", "hz", "HZ")} | {"kHz": (2e3 * np.pi, 0.0)}
RADIAN_UNITS = {k: (1.0, 0.0) for k in ("rad/s", "rads-1", "1/s", "s-1")}

FREQUENCY_COLUMN = ColumnSpec(
    "frequency",
    r"(?:angular|circular|ang|reduced|red|shifted|test){0,4}(?:frequency|freq|frequenz|omega|f|w|ω){1,4}(?:at|red|reduced)?",
    CYCLE_UNITS | RADIAN_UNITS,
    (("ang|circ|omega|^w|ω", "rad/s"), ("f", "Hz"), (ANY, "rad/s")),
    "f (Hz) or omega (rad/s)",
)


def _modulus_column(name: str, letter: str, primes: str, words: str, usual: str) -> ColumnSpec:
    """A column of E or G (`letter`), identified by primes or by words; G only where the name states it."""
    kind = "(?=g|shear)" if letter == "g" else "(?!g|shear)"
    pattern = rf"{kind}(?=.*(?:{letter}{primes}(?!')|{words}))(?!.*(?:tan|fa[ck]tor|angle|{primes}'))[a-z'*]+"
    return ColumnSpec(name, pattern, MODULUS_UNITS, ((ANY, "Pa"),), usual)


STORAGE_COLUMN = _modulus_column("storage modulus", "e", "'", "stor|speicher", "E' (MPa)")
LOSS_COLUMN = _modulus_column("loss modulus", "e", "''", "loss|verlust", "E'' (MPa)")
SHEAR_STORAGE_COLUMN = _modulus_column("shear storage modulus", "g", "'", "stor|speicher", "G' (MPa)")
SHEAR_LOSS_COLUMN = _modulus_column("shear loss modulus", "g", "''", "loss|verlust", "G'' (MPa)")
TAN_DELTA_COLUMN = ColumnSpec(
    "tan delta", r"tan[a-zδ]*|lossfactor|losstangent|verlustfaktor", DIMENSIONLESS_UNITS, ((ANY, ""),), "tan delta"
)
TEMPERATURE_COLUMN = ColumnSpec("temperature", r"temp|temperature?|T", TEMPERATURE_UNITS, ((ANY, "degC"),), "T (degC)")
SHIFT_COLUMN = ColumnSpec(
    "log10 a_T", r"(?:log10|log|lg)?(?:at|shift|shiftfactors?)", DIMENSIONLESS_UNITS, ((ANY, ""),), "log_aT"
)
MASTER_CURVE_COLUMNS = (
    FREQUENCY_COLUMN,
    SHEAR_STORAGE_COLUMN,
    SHEAR_LOSS_COLUMN,
    STORAGE_COLUMN,
    LOSS_COLUMN,
    TAN_DELTA_COLUMN,
    TEMPERATURE_COLUMN,
)
DEFAULT_COLUMN_ORDER = ("frequency", "storage modulus", "loss modulus")
ANALYTIC_CURVE_TEXT = (
    ", or a table { relaxed = Pa, unrelaxed = Pa, exponent = 1, time = s } or { relaxed = Pa, terms = [[Pa, s], ...] }"
)


@dataclass(frozen=True)
class FrequencySweeps:
    """Rows (n,) of a measurement: omega in rad/s, E' and E'' in Pa, temperatures T in K if the file has them."""

    omega: np.ndarray
    storage: np.ndarray
    loss: np.ndarray
    T: np.ndarray | None = None

    @property
    def temperatures(self) -> tuple[float, ...]:
        """Mean temperature (K) of every sweep, increasing; rows less than 1.5 K apart belong to one sweep."""
        if self.T is None:
            return ()
        T = np.sort(self.T)
        return tuple(float(part.mean()) for part in np.split(T, np.flatnonzero(np.diff(T) > SWEEP_GAP_K) + 1))

    def reduced_frequency(self, shift: WLF | MeasuredShift | None) -> np.ndarray:
        """omega a_T(T) (n,), rad/s."""
        return self.omega if shift is None or self.T is None else self.omega * shift(self.T)

    def to_master_curve(self, shift: WLF | MeasuredShift | None = None) -> MeasuredModulus:
        """One curve over increasing reduced frequency; rows at the same frequency are averaged (log mean)."""
        x = np.log10(self.reduced_frequency(shift))
        order = np.argsort(x, kind="stable")
        x, y = x[order], np.log10([self.storage, self.loss])[:, order]
        group, start, near = (
            np.zeros(len(x), dtype=int),
            x[0],
            SAME_POINT_DECADES if len(self.temperatures) > 1 else SAME_FREQUENCY_DECADES,
        )
        for i in range(1, len(x)):
            new = x[i] - start > near
            group[i] = group[i - 1] + new
            start = x[i] if new else start
        count = np.bincount(group)
        omega, storage, loss = (10.0 ** (np.bincount(group, v) / count) for v in (x, *y))
        return MeasuredModulus(tuple(omega.tolist()), tuple(storage.tolist()), tuple(loss.tolist()))

    def rms_scatter(self, shift: WLF | MeasuredShift | None) -> float:
        """Rms difference of log10 E' of sweeps at neighbouring temperatures where they overlap; nan if nowhere."""
        x, y = np.log10(self.reduced_frequency(shift)), np.log10(self.storage)
        means = np.array(self.temperatures)
        sweep = np.argmin(np.abs(np.asarray(self.T)[:, None] - means), axis=1)
        parts = [np.empty(0)]
        for k in range(len(means) - 1):
            here, there = sweep == k, np.flatnonzero(sweep == k + 1)
            there = there[np.argsort(x[there])]
            inside = here & (x >= x[there[0]]) & (x <= x[there[-1]])
            parts.append(y[inside] - np.interp(x[inside], x[there], y[there]))
        apart = np.concatenate(parts)
        return float(np.sqrt(np.mean(apart**2))) if len(apart) else float("nan")


def read_master_curve(
    source: Source, folder: Path, key: str, shift: WLF | MeasuredShift | None = None, poisson: float = 0.5
) -> MeasuredModulus:
    """The master curve of a file or of rows [omega rad/s, E' Pa, E'' Pa]; raw sweeps are reduced by `shift`.

    Raises BadInput naming key, file and line where numbers or units are implausible, for sweeps at several
    temperatures without a shift, and for reduced frequencies in a file that also has a column of temperatures.
    """
    sweeps = read_sweeps(source, folder, key, poisson)
    name = f"{key}: {source}" if isinstance(source, str) else key
    temperatures = sweeps.temperatures
    if len(temperatures) > 1:
        span = f"{temperatures[0] - KELVIN:.0f} to {temperatures[-1] - KELVIN:.0f} degC"
        if shift is None:
            raise BadInput(f"{name}: sweeps from {span} without a shift; give WLF constants or shift factors")
        before, after = sweeps.rms_scatter(None), sweeps.rms_scatter(shift)
        if after > 0.1 and not after < before:
            raise BadInput(
                f"{name}: sweeps from {span} differ by {after:.2g} decades after the shift, {before:.2g} before; "
                "give the shift of this rubber, or leave out the temperatures if the frequencies are reduced already"
            )
    curve = sweeps.to_master_curve(shift)
    if len(curve.omega) < 3:
        raise BadInput(f"{name}: {len(curve.omega)} different frequencies; give 3 or more")
    return curve


def read_sweeps(source: Source, folder: Path, key: str, poisson: float = 0.5) -> FrequencySweeps:
    """Measured rows of a file or of a case, checked.  Raises BadInput as `read_master_curve` does."""
    if isinstance(source, (list, tuple)):
        table = table_of_rows(
            interpolation.read_rows(source, folder, key, 3), key, (FREQUENCY_COLUMN, STORAGE_COLUMN, LOSS_COLUMN)
        )
    else:
        table = read_instrument_table(
            source, folder, key, MASTER_CURVE_COLUMNS, DEFAULT_COLUMN_ORDER, ANALYTIC_CURVE_TEXT
        )
    storage, loss = _young_moduli(table, key, poisson)
    T = None
    if "temperature" in table:
        T = table["temperature"]
        wrong = ~((T > 120.0) & (T < 700.0))
        table.require_rows(wrong, "temperature", "-150 to 420 degC", "are they in K? say so in a units line")
    return FrequencySweeps(table["frequency"], storage, loss, T)


def _young_moduli(table: InstrumentTable, key: str, poisson: float) -> tuple[np.ndarray, np.ndarray]:
    """E' and E'' (Pa) from the moduli or the loss factor in the table, each checked for plausibility."""
    shear = "shear storage modulus" in table and "storage modulus" not in table
    storage, loss = ("shear storage modulus", "shear loss modulus") if shear else DEFAULT_COLUMN_ORDER[1:]
    _require_column(table, "frequency", FREQUENCY_COLUMN.usual)
    _require_column(table, storage, f"{STORAGE_COLUMN.usual} or {SHEAR_STORAGE_COLUMN.usual}")
    if loss not in table:
        _require_column(table, "tan delta", f"{SHEAR_LOSS_COLUMN.usual if shear else LOSS_COLUMN.usual} or tan delta")
    _require_range(table, "frequency", 0.0, np.inf, "a frequency > 0")
    megapascal = "is the modulus in MPa? say so in a units line"
    factor = 2 * (1 + poisson) if shear else 1.0
    _require_range(table, storage, 1e3 / factor, 1e12 / factor, "a modulus from 1e3 to 1e12 Pa", megapascal)
    if loss in table:
        _require_range(table, loss, 0.0, 1e12, "a loss modulus > 0, up to 1e12 Pa")
        return factor * table[storage], factor * table[loss]
    _require_range(table, "tan delta", 0.0, 100.0, "a loss factor > 0, up to 100")
    return factor * table[storage], factor * table[storage] * table["tan delta"]


def _require_column(table: InstrumentTable, name: str, usual: str) -> None:
    if name not in table:
        found = ", ".join(repr(c.name) for c in table.columns.values())
        raise BadInput(f"{table.prefix} no column of {name}, only {found}; name it {usual}")


def _require_range(table: InstrumentTable, name: str, low: float, high: float, right: str, hint: str = "") -> None:
    values = table[name]
    table.require_rows(~((values > low) & (values < high)), name, right, hint)


def read_shift(source: Source, folder: Path, key: str) -> MeasuredShift:
    """Shift factors of a file or of rows [T degC, log10 a_T]; rows at the same temperature are averaged.

    Raises BadInput where temperatures or factors are implausible: log10 a_T must fall with temperature.
    """
    if isinstance(source, (list, tuple)):
        table = table_of_rows(interpolation.read_rows(source, folder, key, 2), key, (TEMPERATURE_COLUMN, SHIFT_COLUMN))
    else:
        table = read_instrument_table(
            source, folder, key, (TEMPERATURE_COLUMN, SHIFT_COLUMN), ("temperature", "log10 a_T")
        )
    for quantity in (TEMPERATURE_COLUMN, SHIFT_COLUMN):
        _require_column(table, quantity.name, quantity.usual)
    T, decades = table["temperature"], table["log10 a_T"]
    right = "-150 to 420 degC"
    table.require_rows(~((T > 120.0) & (T < 700.0)), "temperature", right, "are they in K? say so in a units line")
    table.require_rows(~(np.abs(decades) < 40.0), "log10 a_T", "log10 of the shift factor, between -40 and 40")
    if "log" not in (name := table.columns["log10 a_T"].name).lower() and "lg" not in name.lower():
        _require_logarithm(table, decades)
    places, back = np.unique(T, return_inverse=True)
    decades = np.bincount(back, decades) / np.bincount(back)
    if len(places) < 2 or decades[-1] >= decades[0]:
        wrong = f"{len(places)} temperatures" if len(places) < 2 else "log10 a_T increases with temperature"
        raise BadInput(f"{table.name}: {wrong}; give 2 or more, a_T falling with temperature")
    return MeasuredShift(tuple(places.tolist()), tuple(decades.tolist()))


def _require_logarithm(table: InstrumentTable, decades: np.ndarray) -> None:
    """Raise BadInput for values that are a_T and not log10 a_T: all positive, over more than two decades."""
    if np.all(decades > 0) and decades.max() > 1e2 * decades.min():
        table.require_rows(decades > 0, "log10 a_T", "log10 a_T: these look like a_T itself")
