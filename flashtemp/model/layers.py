"""Layers of a block in a case: [layers.NAME] in the order of the file, the first one at the face."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

Values = Mapping[str, dict[str, Any]]
FOLLOW = ("height", "material")  # keys of the block that layers give


def names(values: Mapping[str, Any]) -> list[str]:
    """Names of the layers from the face upwards.

    >>> names({"block": {}, "layers.disc": {}, "layers.board": {}})
    ['disc', 'board']
    """
    return [table.split(".", 1)[1] for table in values if table.startswith("layers.")]


def settle(values: Values, told: Any) -> Iterator[tuple[str, str]]:
    """Let height (m) and material of the block follow from its layers; yields keys and what is wrong with them.

    `told` is the table of the block as the case gives it.
    """
    stack = [(name, values[f"layers.{name}"]) for name in names(values)]
    if not stack or any(layer.get(k) is None for _, layer in stack for k in ("material", "thickness")):
        return
    if not all(isinstance(layer["thickness"], (int, float)) for _, layer in stack):
        return
    block, total = values["block"], math.fsum(layer["thickness"] for _, layer in stack)
    if "height" in told and not math.isclose(block["height"], total, rel_tol=1e-9):
        yield "block.height", f"{block['height']:g} m, but the layers are {total:g} m together; leave it out"
    if "material" in told and block["material"] != stack[0][1]["material"]:
        yield "block.material", f"{block['material']!r} beside layers; leave it out, each layer names its own"
    if not 1e-4 <= total <= 1.0:
        yield f"layers.{stack[0][0]}.thickness", f"all layers are {total:g} m together; give 0.0001 to 1 m in all"
    last, top = stack[-1]
    if top["contact_resistance"]:
        yield (
            f"layers.{last}.contact_resistance",
            f"{top['contact_resistance']:g}; no layer is above '{last}': give 0, or holder_sink.coefficient",
        )
    block["height"], block["material"] = total, stack[0][1]["material"]
