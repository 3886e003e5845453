"""CF conventions of a recording's variables: conversion of units, packed data and missing values.

Climate and Forecast (CF) metadata conventions 1.11, sections 2.5 (missing data), 3.1 (units), 4.3 (vertical
coordinate) and 8.1 (packed data).  The library that opens a file has replaced `_FillValue` and `missing_value`, and
applied `scale_factor` and `add_offset`, before a variable comes here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics import units

VARIABLE_UNITS = {
    "temperature": "degC",
    "time": "s",
    "repetition": "1",
    "u": "m",
    "v": "m",
}  # those of points: SENSOR_KEYS
UPWARD_COORDINATES = ("v", "z")  # increase upwards from the interface
STANDARD_NAME_WORDS = {"temperature": "temperature", "time": "time"}  # word that a standard name contains


def read_variable(name: str, variable: Any, unit: str) -> np.ndarray:
    """Values of an xarray variable as floats in `unit`; values outside its valid range are NaN.

    A variable without units is taken to be in `unit`.  Raises BadInput naming variable, unit and remedy.
    """
    values = _mask_outside_valid_range(name, variable)
    _refuse_other_meaning(name, variable.attrs)
    text = variable.attrs.get("units")
    if text is None:
        return values
    shown = shorten_text(repr(text if isinstance(text, str) else np.asarray(text).tolist()))
    if not isinstance(text, str):
        raise BadInput(f"{name}: units = {shown}; give text, such as {unit!r}")
    if unit == "1" and text in ("", "1"):
        return values
    if " since " in f" {text.lower()} ":
        raise BadInput(
            f"{name}: units = {shown} is a date; give s from the first start of sliding, units = {unit!r}"
            if unit == "s"
            else f"{name}: units = {shown} is a date; give units = {unit!r}"
        )
    try:
        factor, offset = units.find_conversion(text, unit)
    except BadInput as fault:
        target = "a number without a unit" if unit == "1" else unit
        raise BadInput(f"{name}: units = {shown} cannot be converted to {target}; give units = {unit!r}") from fault
    return values if (factor, offset) == (1.0, 0.0) else values * factor + offset


def _refuse_other_meaning(name: str, attrs: dict[str, Any]) -> None:
    """BadInput where attributes state another quantity than the variable's name."""
    standard = attrs.get("standard_name")
    if isinstance(standard, str) and standard and STANDARD_NAME_WORDS.get(name, "") not in standard.lower():
        raise BadInput(
            f"{name}: standard_name = {shorten_text(repr(standard))}; give the variable that holds"
            f" {STANDARD_NAME_WORDS[name]}"
        )
    about = attrs.get("units_metadata")
    if name == "temperature" and isinstance(about, str) and "difference" in about.lower():
        raise BadInput(f"{name}: units_metadata = {shorten_text(repr(about))}; give temperatures, not differences")
    positive = attrs.get("positive")
    if name in UPWARD_COORDINATES and isinstance(positive, str) and positive.lower() == "down":
        raise BadInput(f"{name}: positive = 'down'; change its sign, since it increases upwards from the interface")


def _mask_outside_valid_range(name: str, variable: Any) -> np.ndarray:
    """Values as floats, NaN outside the valid range that the file states.  Raises BadInput."""
    values = np.asarray(variable.values)
    if values.dtype.kind not in "uif":
        raise BadInput(f"{name}: holds {values.dtype} values; give numbers")
    _refuse_packing(name, variable.encoding)
    values = values.astype(float)
    low, high = _valid_range(name, variable)
    if low > -np.inf or high < np.inf:
        values = np.where((values >= low) & (values <= high), values, np.nan)
    return values


def _refuse_packing(name: str, encoding: dict[str, Any]) -> None:
    """BadInput where scale or offset of packed values is not a number, or the scale is 0."""
    for key in ("scale_factor", "add_offset"):
        given = np.asarray(encoding.get(key, 1.0))
        is_number = given.dtype.kind in "uif" and given.size == 1 and bool(np.isfinite(given).all())
        if not is_number or (key == "scale_factor" and not given.any()):
            raise BadInput(
                f"{name}: {key} = {shorten_text(repr(given.tolist()))}; give one finite number, a scale_factor other"
                " than 0"
            )


def _valid_range(name: str, variable: Any) -> tuple[float, float]:
    """Lowest and highest valid value; limits that are whole numbers are packed like the values.  Raises BadInput."""
    attrs, encoding = variable.attrs, variable.encoding
    limits = [attrs.get("valid_min", -np.inf), attrs.get("valid_max", np.inf)]
    ends = list(np.atleast_1d(attrs["valid_range"])) if "valid_range" in attrs else limits
    found = [np.asarray(end) for end in ends]
    if len(found) != 2 or any(end.dtype.kind not in "uif" or end.size != 1 for end in found):
        raise BadInput(f"{name}: valid_range = {shorten_text(repr(ends))}; give two numbers, or leave it out")
    scale, offset = encoding.get("scale_factor", 1.0), encoding.get("add_offset", 0.0)
    given = [end for key in ("valid_range", "valid_min", "valid_max") for end in np.atleast_1d(attrs.get(key, []))]
    is_packed = bool(given) and all(np.asarray(end).dtype.kind in "ui" for end in given)
    low, high = sorted(float(end) * float(scale) + float(offset) if is_packed else float(end) for end in found)
    return low, high
