"""Stated uncertainties of fixed inputs: the table `known` of campaign.toml."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from flashtemp.camera.recording import VIEW_DESCRIPTIONS
from flashtemp.errors import BadInput, shorten_text, suggest_name
from flashtemp.model.case import Case
from flashtemp.model.case_file import flatten_tables
from flashtemp.model.priors import expand_materials
from flashtemp.model.schema import is_physical_number
from flashtemp.physics import units

MAX_RELATIVE_SD = 3.0  # a factor of 20
VIEW_KEYS = {"emissivity": "1", "reflected_temperature": "degC"}  # shared by all recordings of a view, with unit
PERCENT = "%"
SD_REMEDY = 'give a relative standard deviation, such as 0.02, or one with its unit, such as "0.3 K"'


APPROXIMATE_ZEROS = ("ambient.convection",)  # keys whose zero, an insulated surface, data may refute


@dataclass(frozen=True)
class StatedUncertainty:
    """Standard deviation `sd` that a campaign states for an input, relative to its value or in its unit."""

    sd: float
    relative: bool

    def sd_of(self, value: float) -> float:
        """The standard deviation in the unit of a `value`."""
        return self.sd * abs(value) if self.relative else self.sd


def known_keys(case: Case) -> dict[str, str]:
    """Keys whose uncertainty a campaign may state, with their units: numbers of the physics and of the cameras."""
    full = expand_materials(case)
    out = {
        f"{table}.{name}": param.unit
        for table in full.values
        for name, param in full.declared_params(table).items()
        if name in full.values[table] and is_physical_number(table, param)
    }
    return out | {
        f"{view}.{name}": unit for view in VIEW_DESCRIPTIONS if view != "points" for name, unit in VIEW_KEYS.items()
    }


def read_known(
    given: Any, case: Case, free: tuple[str, ...], overrides: Sequence[Any] = ()
) -> tuple[dict[str, StatedUncertainty], tuple[str, ...]]:
    """Uncertainties by key from a table `known`, and its faults, one line each.

    The uncertainty of a `free` key belongs to the table `free`.  `overrides`: the tables `with` of all entries; a
    number that is 0 under all of them is switched off and has no uncertainty, unless its zero is an approximation.
    """
    if not isinstance(given, dict):
        return {}, (f'{shorten_text(repr(given))}; write known = {{ "contact.pressure" = 0.02 }}',)
    uncertainties: dict[str, StatedUncertainty] = {}
    faults = []
    for key, value in flatten_tables(given).items():
        try:
            uncertainties[key] = _read_uncertainty(key, value, case, free)
            _check_zero(key, uncertainties[key], case, overrides)
        except BadInput as fault:
            faults.append(f"{key}: {fault}")
    return uncertainties, tuple(faults)


def _read_uncertainty(key: str, value: Any, case: Case, free: tuple[str, ...]) -> StatedUncertainty:
    """Uncertainty of a key from its value in the table.  Raises BadInput."""
    keys = known_keys(case)
    if key not in keys:
        raise BadInput(f"is no number of this case or its cameras{suggest_name(key, keys)}")
    if key in free:
        raise BadInput(f'is free; say there how well it is known: free = {{ "{key}" = 0.1 }}')
    out = _read_sd(value, keys[key])
    if not out.sd > 0 or (out.relative and out.sd > MAX_RELATIVE_SD):
        raise BadInput(f"{value!r}; {SD_REMEDY}, above 0 and at most {MAX_RELATIVE_SD:g} of the value")
    if out.relative and keys[key] == "degC":
        raise BadInput(f'{value!r}; a fraction of a temperature in degC means nothing: give it with its unit, "0.5 K"')
    return out


def is_zero(value: Any) -> bool:
    """Whether a value of a case is the number 0, which switches off what it measures unless it is a temperature."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and value == 0


def _check_zero(key: str, known: StatedUncertainty, case: Case, overrides: Sequence[Any]) -> None:
    """Raise BadInput for a number that is 0 in the case and under all overrides, unless it is a temperature.

    A zero that is an approximation may have an uncertainty in its unit.
    """
    table, _, name = key.rpartition(".")
    full = expand_materials(case)
    if table not in full.values or full.declared_params(table)[name].unit == "degC":
        return
    stated = full.values[table][name]
    changed = [flatten_tables(o).get(key, stated) if isinstance(o, dict) else stated for o in overrides] or [stated]
    if not all(is_zero(v) for v in changed):
        return
    if key in APPROXIMATE_ZEROS:
        if known.relative:
            unit = full.declared_params(table)[name].unit
            raise BadInput(f'a fraction of zero means nothing; give it with its unit, "2 {unit}"')
    else:
        raise BadInput(
            f"{case.name} states 0, which switches it off; leave it out of known, or state a value above 0 in the case"
        )


def _read_sd(value: Any, unit: str) -> StatedUncertainty:
    """A number or "2 %" as a relative standard deviation, a number with a unit as an absolute one.  Raises BadInput."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return StatedUncertainty(float(value), True)
    if not units.looks_like_quantity(value):
        raise BadInput(f"{shorten_text(repr(value))}; {SD_REMEDY}")
    if value.strip().endswith(PERCENT):
        return StatedUncertainty(units.to_unit(value, "1"), True)
    return StatedUncertainty(units.to_unit(value, unit, difference=True), False)
