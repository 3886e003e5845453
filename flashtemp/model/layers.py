"""Materials of a case and layers of its block: [layers.NAME] in the order of the file, the first at the face."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from flashtemp.errors import BadInput, suggest_name
from flashtemp.meshes.grading import LEAST
from flashtemp.model.schema import refinement_factor
from flashtemp.physics.material import LIBRARY, Layer, Material

if TYPE_CHECKING:
    from flashtemp.model.scene import Scene

Values = Mapping[str, Mapping[str, Any]]
LAYER_DERIVED_KEYS = ("height", "material")  # keys of [block] that follow from its layers


def layer_names(values: Mapping[str, Any]) -> list[str]:
    """Names of the layers from the face upwards.

    >>> layer_names({"block": {}, "layers.disc": {}, "layers.board": {}})
    ['disc', 'board']
    """
    return [table.split(".", 1)[1] for table in values if table.startswith("layers.")]


def derive_block_keys(values: dict[str, dict[str, Any]], block_table: Any) -> Iterator[tuple[str, str]]:
    """Set height (m) and material of the block from its layers; yields (key, error) for contradictions.

    `block_table` is the [block] table as written in the case.
    """
    stack = [(name, values[f"layers.{name}"]) for name in layer_names(values)]
    if not stack or any(layer.get(k) is None for _, layer in stack for k in ("material", "thickness")):
        return
    if not all(isinstance(layer["thickness"], (int, float)) for _, layer in stack):
        return
    block, total = values["block"], math.fsum(layer["thickness"] for _, layer in stack)
    if "height" in block_table and not math.isclose(block["height"], total, rel_tol=1e-9):
        yield "block.height", f"{block['height']:g} m, but the layers add up to {total:g} m; leave it out"
    if "material" in block_table and block["material"] != stack[0][1]["material"]:
        yield "block.material", f"{block['material']!r} in addition to layers; leave it out, each layer has its own"
    if not 1e-4 <= total <= 1.0:
        yield f"layers.{stack[0][0]}.thickness", f"the layers add up to {total:g} m; give 0.0001 to 1 m in total"
    last, top = stack[-1]
    if top["contact_resistance"]:
        yield (
            f"layers.{last}.contact_resistance",
            f"{top['contact_resistance']:g}; no layer is above '{last}'; give 0, or add the body behind it as a layer",
        )
    block["height"], block["material"] = total, stack[0][1]["material"]


def find_material(values: Values, key: str) -> Material:
    """The material that a key names, from [materials.NAME] of the case or the library.  Raises BadInput."""
    table, last = key.rsplit(".", 1)
    name = values[table][last]
    own = {t.split(".", 1)[1]: d for t, d in values.items() if t.startswith("materials.")}
    if name in own:
        return Material(**{k: own[name][k] for k in ("conductivity", "density", "heat_capacity")})
    if name in LIBRARY:
        return LIBRARY[name]
    raise BadInput(f"{key}: no material '{name}'{suggest_name(name, [*own, *LIBRARY])}; or add [materials.{name}]")


def build_layers(values: Values) -> tuple[Layer, ...]:
    """Layers of the block from the face upwards; empty for a block of one material.  Raises BadInput."""
    tables = {name: values[f"layers.{name}"] for name in layer_names(values)}
    return tuple(
        Layer(
            name,
            find_material(values, f"layers.{name}.material"),
            float(d["thickness"]),
            float(d["contact_resistance"]),
            d["cells"],
        )
        for name, d in tables.items()
    )


def layer_cells(built: Scene, numerics: Mapping[str, Any]) -> dict[str, int]:
    """Cells of every layer at mesh = 1, as keys of a case; empty for a block of one material."""
    refine = refinement_factor(numerics["mesh"]) * numerics["finer"][1]
    counts = {layer.name: rows.stop - rows.start for layer, rows in zip(built.layers, built.mesh.layers, strict=False)}
    return {f"layers.{name}.cells": max(LEAST, round(n / refine)) for name, n in counts.items()}
