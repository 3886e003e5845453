"""What `run.nc` and `summary.json` of a run hold, in the units of the charts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from flashtemp.errors import BadInput
from flashtemp.lab.result_files import ResultFolder, open_dataset
from flashtemp.lab.result_parts import MainNumber
from flashtemp.lab.workspace import escape_control

MAX_PROFILE_BYTES = 512 * 2**20  # of arrays that the page loads at once
MAX_QUANTITIES = 30
MAX_TIMES, MAX_REPETITIONS = 200_000, 2000  # stored; the plots take a line per repetition
PLACES = ("leading edge", "middle", "trailing edge")
TEMPERATURES = "temperature"
CURVE_LABELS = {  # in the order of the charts
    "T_spot": "in the contact spots", "T_block": "block, averaged across y", "T_road": "road in the lanes",
    "T_wake": "road behind the block", "T_ahead": "road before the block",
}  # fmt: skip
DISPLAY_UNITS = {  # of a unit in the file: factor and unit of the charts
    "degC": (1.0, "°C"), "Pa": (1e-6, "MPa"), "m": (1e6, "µm"), "W/m2": (1e-3, "kW/m²"), "1": (1.0, ""),
}  # fmt: skip
LEDGER_ENTRIES = {  # energy over time: label and sign of the heat that went there
    "friction": ("friction heat", 1.0), "block": ("in the block", 1.0), "into_road": ("into the road", 1.0),
    "holder": ("into the holder", -1.0), "air": ("into the air", -1.0),
}  # fmt: skip

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ProfileQuantity:
    """One quantity over x and time: `unit` of the charts, `curves` {label: (x (n,) mm, values (times, n))}."""

    name: str
    unit: str
    curves: dict[str, tuple[Array, Array]]

    @property
    def axis_label(self) -> str:
        """Name and unit for an axis."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest value over all times rounded outwards."""
        low = min(float(np.nanmin(v)) for _, v in self.curves.values())
        high = max(float(np.nanmax(v)) for _, v in self.curves.values())
        margin = 0.0 if high - low > 1e-9 * abs(high) else 0.5 * abs(high) or 1.0
        return _round_outwards(low - margin, high + margin)


@dataclass(frozen=True)
class RunData:
    """A run: `time` (n,) s, `repetition` (n,), `slid` (n,) m, whether it is `sliding` (n,), `friction` (n,).

    `quantities` over x and time, the temperatures first; `ledger` {label: heat (n,) kJ/m}; `ambient_degC`.
    """

    name: str
    title: str
    time: Array
    repetition: npt.NDArray[np.int64]
    slid: Array
    sliding: npt.NDArray[np.bool_]
    friction: Array
    quantities: tuple[ProfileQuantity, ...]
    ledger: dict[str, Array]
    ambient_degC: float

    @property
    def repetitions(self) -> list[int]:
        """The numbers of the repetitions."""
        return [int(r) for r in np.unique(self.repetition)]

    def last_index(self, repetition: int) -> int:
        """Index of the last stored time of sliding in a repetition, or of the repetition if it has no sliding."""
        inside = self.repetition == repetition
        at = np.flatnonzero(inside & self.sliding)
        return int((at if len(at) else np.flatnonzero(inside))[-1])

    def mean_friction(self, repetition: int) -> float:
        """Mean of the stored friction while sliding in a repetition; NaN where none is stored."""
        values = self.friction[(self.repetition == repetition) & self.sliding]
        values = values[np.isfinite(values)]
        return float(values.mean()) if len(values) else math.nan

    def first_times(self) -> list[tuple[int, float]]:
        """(repetition, time in s at which it begins)."""
        return [(r, float(self.time[self.repetition == r][0])) for r in self.repetitions]

    def waits(self) -> list[tuple[float, float]]:
        """Intervals (begin, end) in s without sliding, between stored times."""
        out, edges = [], np.flatnonzero(np.diff(np.r_[True, self.sliding, True].astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=False):
            low, high = self.time[max(begin - 1, 0)], self.time[end - 1]
            out.append((float(low), float(high)))
        return out

    def find_quantity(self, name: str) -> ProfileQuantity | None:
        """The quantity of that name."""
        return next((q for q in self.quantities if q.name == name), None)

    def curve_at_places(self, label: str) -> dict[str, Array]:
        """{place of PLACES: temperature (n,)} of one temperature curve along the block."""
        temperatures = self.find_quantity(TEMPERATURES)
        if temperatures is None or label not in temperatures.curves:
            return {}
        x, values = temperatures.curves[label]
        middle = 0.5 * (x[0] + x[-1])
        at_middle = np.array([np.interp(middle, x, row) for row in values])
        return dict(zip(PLACES, (values[:, 0], at_middle, values[:, -1]), strict=True))


def read_run(result: ResultFolder) -> RunData:
    """The content of `run.nc`.  Raises BadInput for a damaged file or one without temperatures."""
    file = result.find_file("run.nc")
    if file is None:
        raise BadInput(f"{result.name}: has no run.nc")
    with open_dataset(file, MAX_PROFILE_BYTES, left_out="_map") as data:
        return _collect_data(result, file, data)


def _collect_data(result: ResultFolder, file: Path, data: Any) -> RunData:
    time = data["time"].values.astype(float)
    quantities = _collect_quantities(data)
    if not len(time) or not quantities or quantities[0].name != TEMPERATURES:
        raise BadInput(f"{file}: has no temperatures over time and x; it is not a run of flashtemp")

    if len(time) > MAX_TIMES:
        raise BadInput(f"{file}: holds {len(time)} times, at most {MAX_TIMES} are shown; open it with xarray")

    def over_time(name: str, otherwise: float) -> Array:
        values = np.asarray(data[name].values, float) if name in data else np.zeros(0)
        return values if values.shape == time.shape else np.full(len(time), otherwise)

    ledger = {
        label: 1e-3 * sign * np.asarray(data[f"energy_{name}"].values, float)
        for name, (label, sign) in LEDGER_ENTRIES.items()
        if f"energy_{name}" in data and data[f"energy_{name}"].shape == time.shape
    }
    repetition = over_time("repetition", 1.0).astype(np.int64)
    if len(np.unique(repetition)) > MAX_REPETITIONS:
        raise BadInput(f"{file}: holds more than {MAX_REPETITIONS} repetitions; open it with xarray")
    return RunData(
        result.name, escape_control(str(data.attrs.get("title", ""))), time,
        repetition, over_time("slid", math.nan),
        over_time("sliding", 1.0) > 0.5, over_time("friction", math.nan), quantities, ledger,
        float(data.attrs.get("ambient_degC", math.nan)),
    )  # fmt: skip


def _collect_quantities(data: Any) -> tuple[ProfileQuantity, ...]:
    """All quantities over time and a position x, temperatures together, then those that are not zero everywhere."""
    temperatures: dict[str, tuple[Array, Array]] = {}
    bands: dict[str, tuple[Array, Array]] = {}
    others: list[ProfileQuantity] = []
    for name in [*CURVE_LABELS, *(str(k) for k in data.data_vars if str(k) not in CURVE_LABELS)]:
        if name not in data or len(data[name].dims) != 2 or data[name].dims[0] != "time":
            continue
        values = np.asarray(data[name].values, float)
        if not np.isfinite(values).any() or (name not in CURVE_LABELS and not values.any()):
            continue
        x = 1e3 * np.asarray(data[data[name].dims[1]].values, float)
        factor, unit = _display_unit(data[name])
        if name in CURVE_LABELS:
            temperatures[CURVE_LABELS[name]] = (x, values)
        elif name.endswith(("_low", "_high")):
            bands[_long_name(data[name], name)] = (x, factor * values)
        else:
            label = _long_name(data[name], name)
            others.append(ProfileQuantity(label, unit, {label: (x, factor * values)}))
    out = [ProfileQuantity(TEMPERATURES, "°C", temperatures)] if temperatures else []
    out += [ProfileQuantity("95 % band of the temperature", "°C", bands)] if bands else []
    return (*out, *others[:MAX_QUANTITIES])


def _display_unit(values: Any) -> tuple[float, str]:
    unit = str(values.attrs.get("units", ""))
    return DISPLAY_UNITS.get(unit, (1.0, escape_control(unit)[:20]))


def _long_name(values: Any, name: str) -> str:
    return escape_control(str(values.attrs.get("long_name", name)))[:60]


def _round_outwards(low: float, high: float) -> tuple[float, float]:
    """Limits at multiples of a fifth of their distance, rounded up to 1, 2 or 5 times a power of ten.

    >>> _round_outwards(19.1, 44.3), _round_outwards(0.148, 0.152)
    ((10.0, 50.0), (0.148, 0.152))
    """
    raw = (high - low) / 5.0
    power = 10.0 ** math.floor(math.log10(max(raw, 1e-30)))
    step = next(s * power for s in (1.0, 2.0, 5.0, 10.0) if s * power >= 0.999999 * raw)
    digits = max(0, -math.floor(math.log10(step)))
    return round(math.floor(low / step + 1e-9) * step, digits), round(math.ceil(high / step - 1e-9) * step, digits)


def main_numbers(summary: dict[str, Any]) -> list[MainNumber]:
    """The main numbers of `summary.json` in the order of the page."""
    from flashtemp.viz.number_format import format_number

    def text_of(key: str) -> str:
        return format_number(_finite_float(summary.get(key)))

    friction = [_finite_float(v) for v in _as_list(summary.get("friction_per_repetition"))]
    change = f"first {friction[0]:.3g}, last {friction[-1]:.3g}" if len(friction) > 1 else ""
    rise = f"leading edge {text_of('rise_leading_K')} K, middle {text_of('rise_middle_K')} K"
    cells, steps = (_finite_float(summary.get(k)) for k in ("cells", "steps"))
    size = f"{cells:.0f} cells, {steps:.0f} steps" if math.isfinite(cells) and math.isfinite(steps) else ""
    return [
        MainNumber("Highest temperature", text_of("T_max_degC"), "°C"),
        MainNumber("Rise at the trailing edge", text_of("rise_trailing_K"), "K", rise),
        MainNumber("Mean friction", format_number(_mean_of(friction)), "", change),
        MainNumber("Energy error", text_of("energy_imbalance"), "", "of all heat that moved"),
        MainNumber("Run time", text_of("wall_s"), "s", size),
    ]


def heat_shares(summary: dict[str, Any]) -> dict[str, float]:
    """{where the friction heat went: J} of `summary.json`."""
    labels = {"block": "in the block", "road": "into the road", "holder": "into the holder", "air": "into the air"}
    heat = summary.get("energy_J")
    return {words: _finite_float(heat.get(k)) for k, words in labels.items()} if isinstance(heat, dict) else {}


def _as_list(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list) else []


def _finite_float(value: Any) -> float:
    """A number of a JSON file; NaN for anything else."""
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan


def _mean_of(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else math.nan
