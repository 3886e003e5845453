"""The commented template of a case, made from the declarations: every key with default, unit, range, meaning."""

from __future__ import annotations

from flashtemp.model.schema import CASE_TABLES, NAMED_TABLES, declared_params
from flashtemp.model.toml_format import value_text
from flashtemp.physics.effect import Param

CASE_TEMPLATE_HEAD = """\
# A case of flashtemp: `flashtemp check FILE`, `flashtemp run FILE`.  SI units, temperatures in degC; or "25 mm".
# Every key is listed with its default.  Remove the # to change one; keys that are not given keep their defaults.
title = "my case"

# effects = ["track_memory", "friction_softening"]   # `flashtemp effects` lists all
# free = ["friction.mu"]                             # parameters to fit to measured data
"""
NAMED_TABLE_MEANINGS = {
    "materials": "a user-defined material",
    "layers": "a layer of the block; layers are listed from the face upwards",
}
RARE_TABLES = ("numerics", "output", "limits")  # listed last


def case_text() -> str:
    """The text of the commented case."""
    ordered = [t for t in CASE_TABLES if t not in RARE_TABLES] + [t for t in CASE_TABLES if t in RARE_TABLES]
    out = CASE_TEMPLATE_HEAD + "".join(f"\n[{table}]\n{_key_lines(declared_params(table))}" for table in ordered)
    return out + "".join(
        f"\n# [{kind}.NAME]   # {NAMED_TABLE_MEANINGS[kind]}\n{_key_lines(keys)}" for kind, keys in NAMED_TABLES.items()
    )


def _key_lines(keys: dict[str, Param]) -> str:
    return "".join(f"# {example_line(name, param)}  # {describe_param(param)}\n" for name, param in keys.items())


def example_line(name: str, param: Param) -> str:
    return f"{name} = {value_text(param.value)}" if param.value is not None else f"{name} ="


def describe_param(param: Param) -> str:
    """Meaning, unit and range of a key as text.

    >>> describe_param(Param(0.02, "m", "length", low=1e-4, high=1.0))
    'length; m, 0.0001 to 1'
    """
    unit = "" if param.unit in ("", "1") else param.unit
    low, high = (f"{v:g}" if abs(v) < float("inf") else "" for v in (param.low, param.high))
    span = f"{low} to {high}" if low and high else f"from {low}" if low else ""
    more = ", ".join(t for t in (unit, span if {"number", "amount"} & set(param.kinds) else "") if t)
    return f"{param.about}; {more}" if more else param.about
