"""Standard deviations of the inputs of a case: stated as { value, sd }, or a default for this kind of input."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from flashtemp.errors import BadInput, suggest_name
from flashtemp.model import layers
from flashtemp.model.schema import is_physical_number, named_table_kind
from flashtemp.physics.effect import Param
from flashtemp.physics.material import LIBRARY

Array = npt.NDArray[np.float64]
RELATIVE, ABSOLUTE = True, False
CALIPER_REASON = "soft rubber under a caliper"
USUAL_SD: dict[str, tuple[float, bool, str]] = {  # sd, RELATIVE or ABSOLUTE, reason
    "block.length": (2e-4, ABSOLUTE, CALIPER_REASON),
    "block.width": (2e-4, ABSOLUTE, CALIPER_REASON),
    "block.height": (2e-4, ABSOLUTE, CALIPER_REASON),
    "block.modulus": (0.1, RELATIVE, "modulus of a compound from batch to batch"),
    "block.modulus_slope": (0.003, ABSOLUTE, "tread rubber: -0.003 to -0.01/K"),
    "block.poisson": (0.005, ABSOLUTE, "rubber between 0.485 and 0.4995"),
    "block.stiffness": (0.1, RELATIVE, "modulus of a compound from batch to batch"),
    "contact.pressure": (0.02, RELATIVE, "dead weight over the measured face"),
    "contact.spot_fraction": (0.1, RELATIVE, "range that calibration covers"),
    "contact.spot_diameter": (0.2, RELATIVE, "sizes of stones scatter"),
    "contact.flash_factor": (0.1, RELATIVE, "calibrations on resolved spots"),
    "friction.mu": (0.05, RELATIVE, "load cell, and scatter from run to run"),
    "schedule.speed": (0.01, RELATIVE, "control of the drive"),
    "ambient.temperature": (0.5, ABSOLUTE, "thermometer, and drift of a laboratory within an hour"),
    "ambient.convection": (0.3, RELATIVE, "correlations for convection in air"),
    "friction_softening.b": (0.2, RELATIVE, "fits to friction over temperature"),
    "edge_pressure.B": (0.3, RELATIVE, "pressure-sensitive film at an edge"),
    "wear.rate": (0.3, RELATIVE, "wear from test to test"),
    "persson_friction.rms_slope": (
        0.1,
        RELATIVE,
        "chosen cut-off of the spectrum; 1.2 to 1.4 are in use",
    ),
    "persson_friction.shear_stress": (0.4, RELATIVE, "4 to 6.5 MPa are in use for tread compounds"),
    "persson_friction.activation": (0.1, ABSOLUTE, "fits to the shift of the shear stress"),
    "persson_friction.gamma": (0.1, ABSOLUTE, "0.4 to 0.6 in comparisons with exact contact"),
}
USUAL_MATERIAL_SD: dict[str, tuple[float, bool, str]] = {
    "conductivity": (0.1, RELATIVE, "scatter between compounds and mixes of one kind (asphalt: Carlson 2010)"),
    "density": (0.02, RELATIVE, "weighed samples"),
    "heat_capacity": (0.05, RELATIVE, "calorimetry of compounds of one kind"),
}
USUAL_LAYER_SD: dict[str, tuple[float, bool, str]] = {
    "thickness": (0.01, RELATIVE, "gauge of sheets and boards"),
    "contact_resistance": (0.3, RELATIVE, "scatter between similar contacts with pressure and finish"),
}
USUAL_NAMED_TABLE_SD = {"materials": USUAL_MATERIAL_SD, "layers": USUAL_LAYER_SD}


class PriorSource(Protocol):
    """The part of a case that `find_uncertain_inputs` needs."""

    @property
    def values(self) -> dict[str, dict[str, Any]]: ...
    @property
    def priors(self) -> Mapping[str, float]: ...
    @property
    def name(self) -> str: ...
    def declared_params(self, table: str) -> dict[str, Param]: ...


@dataclass(frozen=True)
class UncertainInput:
    """An input with the prior `value` +- `sd`: a normal distribution truncated at the bounds `low` and `high`.

    `reason`: the origin of `sd`, either the case or the reason for the default.
    """

    key: str
    value: float
    sd: float
    unit: str
    low: float
    high: float
    reason: str

    @property
    def is_near_bound(self) -> bool:
        """Whether a bound lies within 1.5 sd, so that the truncated prior is clearly asymmetric."""
        return min(self.value - self.low, self.high - self.value) < 1.5 * self.sd

    def value_at(self, z: Array | float) -> Any:
        """Values of the truncated normal distribution at the quantiles of standard normal deviates `z`."""
        from scipy.special import ndtr, ndtri

        a, b = ndtr((self.low - self.value) / self.sd), ndtr((self.high - self.value) / self.sd)
        inside = ndtri(a + (b - a) * ndtr(z)) if self.is_near_bound or b - a < 1.0 else z
        return np.clip(self.value + self.sd * inside, self.low, self.high)


def expand_materials(case: Any) -> Any:
    """The case with library materials written out as [materials.NAME], so that their properties are keys."""
    written: dict[str, float] = {}
    stack = [case[f"layers.{n}.material"] for n in layers.layer_names(case.values)]
    for name in dict.fromkeys([case["block.material"], case["road.material"], *stack]):
        if f"materials.{name}" not in case.values:
            written |= {f"materials.{name}.{k}": getattr(LIBRARY[name], k) for k in USUAL_MATERIAL_SD}
    return case.with_values(written) if written else case


def find_uncertain_inputs(
    case: PriorSource, keys: tuple[str, ...] | None = None
) -> tuple[tuple[UncertainInput, ...], tuple[str, ...]]:
    """Uncertain inputs of a case, and the keys of its other physical numbers, which have no standard deviation.

    `keys`: only these inputs.  Raises BadInput for a key without a stated or default standard deviation.
    """
    numbers = {f"{t}.{k}": v for t, k, v in _physical_numbers(case)}
    if keys is not None:
        for n, key in enumerate(keys):
            _check_key(case, key, numbers, keys[:n])
    found = {key: _make_input(case, key, value) for key, value in numbers.items() if keys is None or key in keys}
    known = tuple(i for i in found.values() if i is not None)
    if not known:
        raise BadInput(f"{case.name}: no input has a standard deviation; write key = {{ value = ..., sd = ... }}")
    return known, tuple(key for key, i in found.items() if i is None)


def _physical_numbers(case: PriorSource) -> list[tuple[str, str, float]]:
    """Table, key and value of all physical numbers of a case."""
    out = []
    for table, values in case.values.items():
        declared = case.declared_params(table)
        for key, param in declared.items():
            value = values.get(key)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                continue
            follows = table == "block" and key in layers.LAYER_DERIVED_KEYS and bool(layers.layer_names(case.values))
            if is_physical_number(table, param) and not follows:
                out.append((table, key, float(value)))
    return out


def _check_key(case: PriorSource, key: str, numbers: Mapping[str, float], earlier_keys: tuple[str, ...]) -> None:
    if key not in numbers:
        raise BadInput(f"{key} (command line): not a number of this case{suggest_name(key, numbers)}")
    if key in earlier_keys:
        raise BadInput(f"{key} (command line): listed twice; once is enough")
    if _make_input(case, key, numbers[key]) is None:
        error = "has no standard deviation" if numbers[key] else "is 0 and has no standard deviation"
        raise BadInput(f"{key} (command line): {error}; give {key}='{{ value = {numbers[key]:g}, sd = ... }}'")


def _make_input(case: PriorSource, key: str, value: float) -> UncertainInput | None:
    """The prior of a key; None without a standard deviation."""
    table, name = key.rsplit(".", 1)
    param = case.declared_params(table)[name]
    stated = case.priors.get(key)
    usual = USUAL_NAMED_TABLE_SD[kind].get(name) if (kind := named_table_kind(table)) else USUAL_SD.get(key)
    if stated is None and usual is None:
        return None
    sd, reason = (stated, "the case") if stated is not None else (0.0, "")
    if stated is None and usual is not None:
        sd, reason = usual[0] * (abs(value) if usual[1] else 1.0), usual[2]
        if (
            value == 0 and key != "ambient.temperature"
        ):  # a relative sd of zero is zero: an inactive effect stays inactive
            return None
    low, high = math.nextafter(param.low, math.inf) if param.open_low else param.low, param.high
    if param.signed and value < 0:  # its sign is a direction, which is certain
        low, high = -high, -low
    return UncertainInput(key, value, float(sd), param.unit, low, high, reason) if sd else None


def has_stated_sd(value: Any) -> bool:
    """Whether a value of a case has the form { value, sd }."""
    return isinstance(value, dict) and "sd" in value


def find_sd_fault(param: Param, table: str, stated_value: Mapping[str, Any]) -> str | None:
    """The error in { value, sd } of a key, apart from the value itself; None when it is valid."""
    if not is_physical_number(table, param):
        return "has no sd; only numbers of block, road, contact and test can be uncertain: give the value alone"
    if set(stated_value) != {"value", "sd"}:
        return "give { value = ..., sd = ... }"
    value, sd = stated_value["value"], stated_value["sd"]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return "only a number has an sd; give the value alone"
    if isinstance(sd, bool) or not isinstance(sd, (int, float)) or not 0 < sd < math.inf:
        return f"sd = {sd!r}; give a standard deviation > 0" + (
            f" ({param.unit})" if param.unit not in ("", "1") else ""
        )
    return None
