"""A commented case to begin with: every key with default, unit, range and meaning, made from the declarations."""

from __future__ import annotations

from flashtemp.model.schema import CASE_TABLES, NAMED_TABLES, declared_params
from flashtemp.model.toml_format import value_text
from flashtemp.physics.effect import Param

CASE_TEMPLATE_HEAD = """\
# A case of flashtemp: `flashtemp check FILE`, `flashtemp run FILE`.  SI units, temperatures in degC; or "25 mm".
# Every key stands here with its default.  Take the # away to change one; what is not given keeps its default.
title = "my case"

# effects = ["track_memory", "friction_softening"]   # `flashtemp effects` tells all
# free = ["friction.mu"]                             # what a fit to measured data may move
"""
NAMED_TABLE_MEANINGS = {  # what tables of a name are, for people
    "materials": "a material of your own",
    "layers": "the block in layers, in this order from its face upwards",
}
RARE_TABLES = ("numerics", "output", "limits")  # tables that most do without


def case_text() -> str:
    """The commented case."""
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
    """Meaning, unit and range of a key in words.

    >>> describe_param(Param(0.02, "m", "length", low=1e-4, high=1.0))
    'length; m, 0.0001 to 1'
    """
    unit = "" if param.unit in ("", "1") else param.unit
    low, high = (f"{v:g}" if abs(v) < float("inf") else "" for v in (param.low, param.high))
    span = f"{low} to {high}" if low and high else f"from {low}" if low else ""
    more = ", ".join(t for t in (unit, span if {"number", "amount"} & set(param.kinds) else "") if t)
    return f"{param.about}; {more}" if more else param.about
