"""Positions of thermocouples and pyrometers, their time constants, and the uncertainties of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, suggest_name
from flashtemp.model.case_file import find_title_fault
from flashtemp.physics import units

# K: type K of class 1 errs by at most 1.5 K (IEC 60584-1); the standard deviation of a uniform distribution over that
TYPICAL_ZERO_SD_K = 0.87
SENSOR_KEYS = {  # of one point: unit, lowest, highest value, default
    "x": ("m", -1.0, 10.0, 0.0),
    "y": ("m", -10.0, 10.0, 0.0),
    "z": ("m", -10.0, 1.0, None),
    "lag_s": ("s", 0.0, 1e4, 0.0),
    "lag_sigma_s": ("s", 0.0, 1e4, 0.0),
    "place_sigma_m": ("m", 0.0, 0.1, 0.0),
    "depth_sigma_m": ("m", 0.0, 0.1, None),
    "gain_sigma": ("1", 0.0, 0.2, 0.0),
    "zero_sigma_K": ("K", 0.0, 20.0, TYPICAL_ZERO_SD_K),
}
REQUIRED_SENSOR_KEYS = ("z",)
FALLBACK_KEYS = {"depth_sigma_m": "place_sigma_m"}  # key whose value replaces a missing one


@dataclass(frozen=True, eq=False)
class SensorPositions:
    """Positions of n sensors, m: `x` from the leading edge, `y` from the centre line, `z` up (< 0: road).

    `lag_s` is the time constant.  Standard deviations: `lag_sigma_s` of the lag, `place_sigma_m` of x and y,
    `depth_sigma_m` of z, `gain_sigma` (relative) of the indicated temperature rise, `zero_sigma_K` of the
    error that a sensor shows at any temperature, also before the test.  `names` are for people.
    """

    names: tuple[str, ...]
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    lag_s: np.ndarray
    lag_sigma_s: np.ndarray
    place_sigma_m: np.ndarray
    depth_sigma_m: np.ndarray
    gain_sigma: np.ndarray
    zero_sigma_K: np.ndarray

    def __len__(self) -> int:
        return len(self.names)

    def __post_init__(self):
        for key, (unit, low, high, _) in SENSOR_KEYS.items():
            values = getattr(self, key)
            if values.shape != (len(self),):
                raise BadInput(
                    f"{key}: {values.shape[0] if values.ndim else 'no'} values for {len(self)} points; one each"
                )
            bad = ~((values >= low) & (values <= high))
            if bad.any():
                raise BadInput(f"{key}: {values[bad][0]:g} of a point; give {low:g} to {high:g} {unit}")

    def place_sigma(self, axis: int) -> np.ndarray:
        """Standard deviation (n,) m of the position along axis 0, 1 or 2 (x, y or z)."""
        return self.depth_sigma_m if axis == 2 else self.place_sigma_m

    def perturb_key(self, key: str, step: float, point: int | None = None) -> SensorPositions:
        """Copy with x, y, z or `lag_s` of one point, or of all, changed by `step`; bounds are not checked."""
        values = getattr(self, key).copy()
        values[slice(None) if point is None else point] += step
        return _build_unchecked({f.name: getattr(self, f.name) for f in fields(self)} | {key: values})

    def select_points(self, points: np.ndarray) -> SensorPositions:
        """Positions of some of the points, by their numbers, which may repeat, or by a mask (n,)."""
        numbers = np.arange(len(self))[points]
        names = tuple(self.names[i] for i in numbers)
        return _build_unchecked({f.name: getattr(self, f.name)[numbers] for f in fields(self)[1:]} | {"names": names})

    def as_rows(self) -> list[dict[str, Any]]:
        """One table per point, as in campaign.toml."""
        return [{"name": n} | {k: float(getattr(self, k)[i]) for k in SENSOR_KEYS} for i, n in enumerate(self.names)]


def _build_unchecked(values: dict[str, Any]) -> SensorPositions:
    made = object.__new__(SensorPositions)
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


def positions_from_rows(rows: Any, key: str = "points") -> SensorPositions:
    """Positions from tables such as { z = 0.00572, lag_s = 0.5 }; `name` is by default a number.  Raises BadInput."""
    if not isinstance(rows, list) or not rows or not all(isinstance(r, dict) for r in rows):
        raise BadInput(f"{key}: {rows!r}; give a table per point, for example [{{ x = 0.01, z = 0.002 }}]")
    known, rows = ["name", *SENSOR_KEYS], [dict(row) for row in rows]
    for number, row in enumerate(rows, 1):
        for name, value in [*row.items()]:
            if name not in known:
                raise BadInput(f"{key}: point {number}: {name}: unknown key{suggest_name(name, known)}")
            if name == "name" and (fault := find_title_fault(value)):
                raise BadInput(f"{key}: point {number}: name: {fault}")
            if name != "name" and units.looks_like_quantity(value):
                row[name] = value = _convert_unit(key, number, name, value)
            if name != "name" and (isinstance(value, bool) or not isinstance(value, (int, float))):
                raise BadInput(f"{key}: point {number}: {name}: {value!r}; give a number ({SENSOR_KEYS[name][0]})")
        if "z" not in row:
            raise BadInput(f"{key}: point {number}: z: missing; give m above the face, below 0 in the road")
    names = tuple(str(row.get("name", n)) for n, row in enumerate(rows, 1))
    try:
        return positions_from_arrays(names, {k: [_row_value(row, k) for row in rows] for k in SENSOR_KEYS})
    except BadInput as fault:
        raise BadInput(*(f"{key}: {line}" for line in fault.lines)) from fault


def _row_value(row: dict[str, Any], key: str) -> float:
    """Value of a key of a point, of its fallback key, or the default."""
    if key not in row and key in FALLBACK_KEYS:
        return _row_value(row, FALLBACK_KEYS[key])
    default = SENSOR_KEYS[key][3]
    return float(row.get(key, 0.0 if default is None else default))


def _convert_unit(key: str, number: int, name: str, value: str) -> float:
    try:
        return units.to_unit(value, SENSOR_KEYS[name][0], difference=True) if name in SENSOR_KEYS else float("nan")
    except BadInput as fault:
        raise BadInput(f"{key}: point {number}: {name}: {fault}") from fault


def positions_from_arrays(names: Sequence[str], given: dict[str, Any]) -> SensorPositions:
    """Positions from one value per point of each key; missing keys take their defaults.

    Raises BadInput.
    """
    n = len(names)
    filled: dict[str, np.ndarray] = {}
    for key, (unit, *_, default) in SENSOR_KEYS.items():
        if key not in given and key in REQUIRED_SENSOR_KEYS:
            raise BadInput(f"{key}: missing; give it for every point, in {unit}")
        other = filled[FALLBACK_KEYS[key]] if key in FALLBACK_KEYS else np.full(n, default)
        filled[key] = np.asarray(given.get(key, other), float)
    return SensorPositions(tuple(names), **filled)
