"""Numbers, units and names as text for the reports."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flashtemp.discovery.verdict import CandidateReport

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def effect_label(key: str) -> str:
    """The name of an effect in words."""
    return key.replace("_", " ")


def unit_suffix(unit: str) -> str:
    """A unit to append to a number: with a space before it, "" for the unit 1."""
    if unit in ("", "1"):
        return ""
    return " " + unit.replace("m2", "m²").replace("m3", "m³").replace("degC", "°C")


def law_axis_labels(words: str, argument_unit: str, unit: str) -> tuple[str, str]:
    """Labels of the axes of a learned law with these `words`: of its argument, and of its values.

    >>> law_axis_labels("the heat capacity of the block changes with its own temperature", "degC", "1")
    ('its own temperature (°C)', 'factor on the heat capacity of the block (–)')
    """
    quantity, _, argument = words.partition(" changes with ")
    factor = "factor on " if unit == "1" else ""
    x_unit, y_unit = (unit_suffix(u).strip() or "–" for u in (argument_unit, unit))
    return f"{argument or 'argument'} ({x_unit})", f"{factor}{quantity} ({y_unit})"


def format_number(value: float) -> str:
    """A number with three digits and superscript powers of ten; a dash for NaN.

    >>> format_number(1.2345e-10), format_number(-0.5), format_number(999.99), format_number(float("nan"))
    ('1.23 × 10⁻¹⁰', '−0.5', '1000', '–')
    """
    value = float(value)
    if not math.isfinite(value):
        return "–" if math.isnan(value) else f"{'−' if value < 0 else ''}∞"
    if value and not 1e-3 <= abs(value) < 1e6:
        digits, power = f"{value:.2e}".split("e")
        digits = digits.rstrip("0").rstrip(".")
        return f"{digits} × 10{str(int(power)).translate(SUPERSCRIPTS)}".replace("-", "−")
    text = f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"  # 999.9 with three digits is 1e+03
    return text.replace("-", "−")


def format_ratio(value: float) -> str:
    """A ratio with two decimals where it is of the order of one."""
    return f"{value:.2f}" if 0.01 <= value < 10 else format_number(value)


def format_with_error(value: float, error: float, unit: str) -> str:
    """A value with its standard error, to two digits of the error.

    >>> format_with_error(1.7243, 0.0512, "1"), format_with_error(2.1e-6, 1.5e-7, "m")
    ('1.724 ± 0.051', '(2.10 ± 0.15) × 10⁻⁶ m')
    """
    if not (math.isfinite(value) and math.isfinite(error) and error > 0):
        return format_number(value) + unit_suffix(unit)
    size = max(abs(value), error)
    power = math.floor(math.log10(size)) if not 1e-3 <= size < 1e6 else 0
    value, error = value / 10.0**power, error / 10.0**power
    places = min(max(0, 1 - math.floor(math.log10(error))), 6)
    text = f"{value:.{places}f} ± {error:.{places}f}".replace("-", "−")
    return (f"({text}) × 10{str(power).translate(SUPERSCRIPTS)}" if power else text) + unit_suffix(unit)


def needed_amplitude(r: CandidateReport) -> str:
    """The amplitude that a candidate requires, with its standard error and unit."""
    if not r.amplitude and not r.stderr:
        return "–"
    return f"{r.parameter} = {format_with_error(r.amplitude, r.stderr, r.unit)}".removeprefix(" = ")


def score_and_basis(r: CandidateReport) -> tuple[str, str]:
    """The ln Bayes factor of a candidate, and whether it is from a full fit or from sensitivities."""
    if r.refitted or r.stderr > 0:
        return format_number(r.score), "full fit" if r.refitted else "sensitivities"
    return "–", "not tried"


def detectable_amplitude(r: CandidateReport) -> str:
    """The amplitude of a candidate that is detectable at 5 sigma."""
    return format_number(r.detectable) + unit_suffix(r.unit) if math.isfinite(r.detectable) else "not in these data"


def format_probability(p: float) -> str:
    """A probability; simulations do not resolve values below 0.001."""
    return "below 0.001" if p < 1e-3 else format_number(p)


def flatten_dict(nested: dict, prefix: str = "") -> list[tuple[str, object]]:
    """(key, value) pairs of nested dictionaries, keys joined by ": "."""
    items = [(f"{prefix}{k}", v) for k, v in nested.items()]
    return [pair for k, v in items for pair in (flatten_dict(v, f"{k}: ") if isinstance(v, dict) else [(k, v)])]


def format_value(value) -> str:
    """A value of any type: yes or no, a number, a list with commas, or its text."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return format_number(value)
    if isinstance(value, (list, tuple)):
        return ", ".join(format_value(v) for v in value)
    return str(value)
