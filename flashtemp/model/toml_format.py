"""Values as short, readable TOML on one line."""

from __future__ import annotations

import math
from typing import Any

import tomli_w


def value_text(value: Any) -> str:
    """A number, text, list or table as TOML on one line; large numbers with an exponent.

    >>> print(value_text([1.4e9, 0.02, 3, {"a": "b"}]), value_text(150000.0), value_text(float("inf")))
    [1.4e9, 0.02, 3, { a = "b" }] 1.5e5 inf
    """
    if isinstance(value, list):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_quote_key(k)} = {value_text(v)}" for k, v in value.items()) + " }"
    if isinstance(value, float) and math.isfinite(value) and abs(value) >= 1e5:
        short = f"{value:e}".split("e")
        mantissa, power = short[0].rstrip("0").rstrip("."), int(short[1])
        if float(f"{mantissa}e{power}") == value:
            return f"{mantissa}e{power}"
    return tomli_w.dumps({"v": value}).removeprefix("v = ").strip()


def _quote_key(name: str) -> str:
    """A key of a table, in quotes where TOML requires them."""
    return name if name.replace("_", "").replace("-", "").isalnum() else f'"{name}"'
