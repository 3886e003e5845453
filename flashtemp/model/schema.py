"""Declarations of all keys of a case: default, unit, bounds and kind of value; effects declare their own keys."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from flashtemp.errors import shorten_text, suggest_name
from flashtemp.physics.effect import Effect, Param, catalogue

MESH_LEVEL_FACTORS = {"coarse": 0.5, "medium": 1.0, "fine": 2.0}
UNDECLARED_PARAM = Param(None, "", "")
NAME_KINDS, CURVE_KINDS, FLAG_KINDS = ("name",), ("number", "text", "table"), ("flag",)
AMOUNT_KINDS, AMOUNT_LIST_KINDS = ("amount",), ("amounts",)  # a number or list of numbers that is never a fit parameter
CASE_TABLES: dict[str, dict[str, Param]] = {
    "block": {
        "length": Param(0.025, "m", "length in the direction of sliding", low=1e-4, high=1.0),
        "width": Param(0.05, "m", "width across the direction of sliding", low=1e-4, high=10.0),
        "height": Param(0.007, "m", "height from the face to the holder", low=1e-4, high=1.0),
        "material": Param("tread_rubber", "", "name of a material", kinds=NAME_KINDS),
        "modulus": Param(5e6, "Pa", "Young's modulus of the block under compression", low=1e3, high=1e12),
        "modulus_slope": Param(
            0.0, "1/K", "relative slope of the modulus with the block's mean temperature; rubber: -0.003 to -0.01",
            low=-0.05, high=0.05,
        ),
        "poisson": Param(0.49, "1", "Poisson's ratio of the block", low=0.0, high=0.4999),
        "stiffness": Param(
            None, "Pa/m", "pressure per compression of a block on springs, E_c/height; elastic if not given",
            low=1e3, high=1e14,
        ),
    },
    "road": {
        "material": Param("asphalt", "", "name of a material", kinds=NAME_KINDS),
        "track_length": Param(3.5, "m", "length of one lap of the circular track", low=0.01, high=1e5),
        "depth": Param(None, "m", "depth of road simulated; by diffusion length if not given", low=1e-5, high=10.0),
        "upstream": Param(0.003, "m", "length of road simulated in front of the block", low=0.0, high=10.0),
        "downstream": Param(0.01, "m", "length of road simulated behind the block", low=0.0, high=10.0),
    },
    "contact": {
        "pressure": Param(
            1.5e5, "Pa", "mean nominal contact pressure; or a file of time and value",
            low=0.0, open_low=True, high=1e9, kinds=CURVE_KINDS,
        ),
    },
    "friction": {},
    "schedule": {
        "speed": Param(
            0.1, "m/s", "sliding speed, < 0 for backward sliding: the edge at x = L leads; or a file of time and value",
            low=0.0, open_low=True, high=1000.0, signed=True, kinds=CURVE_KINDS,
        ),
        "distance": Param(3.5, "m", "distance slid in one repetition", low=1e-6, high=1e7),
        "repetitions": Param(1, "1", "number of repetitions", low=1, high=100000, kinds=("whole",)),
        "turn": Param(
            0, "1", "number of repetitions after which the direction reverses; 0 for never",
            low=0, high=100000, kinds=("whole",),
        ),
        "wait": Param(0.0, "s", "waiting time between repetitions", low=0.0, high=1e7),
        "alone": Param(
            None, "s", "time that the block is off the road, instead of sliding",
            low=1e-6, high=1e9, kinds=AMOUNT_KINDS,
        ),
        "lifted": Param(True, "", "block lifted off the road while waiting", kinds=FLAG_KINDS),
    },
    "ambient": {
        "temperature": Param(20.0, "degC", "air, initial and road temperature", low=-100.0, high=500.0),
    },
    "limits": {
        "temperature": Param(
            600.0, "degC", "a run that exceeds it fails; rubber chars above 300",
            low=-100.0, high=1e5, kinds=AMOUNT_KINDS,
        ),
    },
    "numerics": {
        "mesh": Param(
            "medium", "1", '"coarse", "medium", "fine" or a factor on the number of cells',
            low=0.05, high=32.0, kinds=("level", "number"),
        ),
        "cells": Param(
            [56, 34, 40], "1", "cells along the block, up the block, down the road at mesh = 1", kinds=("cells",)
        ),
        "across": Param(
            1, "1", "cells across the width at mesh = 1; 1 for 2D", low=1, high=5000, kinds=("whole",)
        ),
        "first_y": Param(None, "m", "first cell at both side walls; even cells if not given", low=1e-7, high=1.0),
        "finer": Param(
            [1, 1, 1], "1", "factors on mesh along the block, up the block, down the road", kinds=("factors",)
        ),
        "first_x": Param(3e-5, "m", "first cell at the leading edge", low=1e-8, high=0.1),
        "last_x": Param(6e-5, "m", "last cell at the trailing edge", low=1e-8, high=0.1),
        "first_block": Param(
            None, "m", "first cell of the block at the interface; 4 um or less, by source depth and time, if not given",
            low=1e-9, high=0.1,
        ),
        "first_road": Param(
            None, "m", "first cell of the road at the interface; 3 um or less, by the speed, if not given",
            low=1e-9, high=0.1,
        ),
        "behind": Param(
            1.35, "1", "growth ratio of cells behind the block; comparisons with a wake need 1.1",
            low=1.01, high=2.0,
        ),
        "above": Param(
            0, "1", "uniform cells up the block, in addition to graded ones; comparisons with a side wall need 10",
            low=0, high=1000, kinds=("whole",),
        ),
        "elastic_3d": Param(
            False, "", "with cells across: one elastic block in 3D instead of plane strain in each plane; "
            "takes minutes once per shape", kinds=FLAG_KINDS,
        ),
        "rtol": Param(1e-4, "1", "relative tolerance of the time integration", low=1e-10, high=0.05),
        "atol": Param(None, "K", "absolute tolerance; 10 rtol kelvin if not given", low=1e-12, high=10.0),
        "order": Param(3, "1", "highest BDF order; 4 and 5 may need many more steps", low=1, high=5, kinds=("whole",)),
        "integrator": Param("auto", "", '"scikits-odes", "scikit-sundae" or "auto"', kinds=("binding",)),
    },
    "output": {
        "profiles": Param(40, "1", "profiles saved per repetition", low=2, high=100000, kinds=("whole",)),
        "fields": Param(6, "1", "cell fields saved per repetition", low=2, high=10000, kinds=("whole",)),
        "pictures": Param(True, "", "draw pictures", kinds=FLAG_KINDS),
        "animation": Param(True, "", "animate repetitions or resolved spots, with the pictures", kinds=FLAG_KINDS),
        "vtk": Param(True, "", "write the VTK file", kinds=FLAG_KINDS),
    },
}  # fmt: skip
BRISTLE_KEYS = {
    "speed": Param(27.0, "m/s", "rolling speed", low=0.1, high=200.0, kinds=AMOUNT_KINDS),
    "stiffness": Param(
        1.5e8, "Pa/m", "shear stress of the tread per sideways displacement, G/height",
        low=1e3, high=1e13, kinds=AMOUNT_KINDS,
    ),
    "mass": Param(
        0.1, "kg/m2", "mass per area of a bristle; a much larger mass oscillates visibly in the friction",
        low=0.0, open_low=True, high=1e3, kinds=AMOUNT_KINDS,
    ),
    "memory": Param(
        None, "1", "distance r0 between cold and hot friction over contact.spot_diameter; fitted to the kernel theory "
        "if not given", low=0.0, open_low=True, high=10.0, kinds=AMOUNT_KINDS,
    ),
    "road_heat": Param(
        True, "", "the road takes heat from the spots, and adhesive friction heats too", kinds=FLAG_KINDS
    ),
    "fraction": Param(
        None, "1", "contact fraction of the spots; P(2 pi/spot_diameter) from the theory if not given",
        low=0.0, open_low=True, high=1.0, kinds=AMOUNT_KINDS,
    ),
}  # fmt: skip
SLIP_ANGLES_DEG = "0.1 0.14 0.2 0.28 0.4 0.5 0.6 0.7 0.85 1 1.2 1.4 1.7 2 2.4 2.8 3.3 4 4.7 5.5 6.5 7.7 9 10.5 12.5 15"
# tables of single commands, which a case has only if it names them
COMMAND_TABLES: dict[str, dict[str, Param]] = {
    "tread": BRISTLE_KEYS | {
        "slip": Param(
            [0.005, 0.0075, 0.01, 0.03, 0.05, 0.07, 0.09], "1", "slips of the wheel",
            low=0.0, open_low=True, high=1.0, kinds=AMOUNT_LIST_KINDS,
        ),
        "footprint": Param(0.1, "m", "length of the footprint", low=1e-3, high=10.0, kinds=AMOUNT_KINDS),
        "mass": replace(BRISTLE_KEYS["mass"], value=0.02),
    },
    "tyre": BRISTLE_KEYS | {
        "loads": Param([3e3, 5e3, 7e3], "N", "wheel loads", low=0.0, open_low=True, high=1e7, kinds=AMOUNT_LIST_KINDS),
        "width": Param(0.14, "m", "width of the elliptic footprint", low=1e-3, high=10.0, kinds=AMOUNT_KINDS),
        "angles": Param(
            [float(a) for a in SLIP_ANGLES_DEG.split()], "deg", "slip angles",
            low=0.0, open_low=True, high=45.0, kinds=AMOUNT_LIST_KINDS,
        ),
    },
}  # fmt: skip
MATERIAL_KEYS = {
    "conductivity": Param(None, "W/mK", "thermal conductivity", low=0.0, high=1e4, open_low=True),
    "density": Param(None, "kg/m3", "density", low=0.0, high=1e5, open_low=True),
    "heat_capacity": Param(None, "J/kgK", "specific heat capacity", low=0.0, high=1e6, open_low=True),
}

LAYER_KEYS = {
    "material": Param(None, "", "name of a material", kinds=NAME_KINDS),
    "thickness": Param(None, "m", "thickness; the sum of all layers is block.height", low=1e-6, high=1.0),
    "contact_resistance": Param(
        0.0, "m2K/W", "thermal resistance of the contact with the layer above, away from the face", low=0.0, high=1e3
    ),
    "cells": Param(
        None, "1", "cells of the layer at mesh = 1; from the grading of the block if not given",
        low=3, high=5000, kinds=("whole",),
    ),
}  # fmt: skip
NAMED_TABLES = {"materials": MATERIAL_KEYS, "layers": LAYER_KEYS}  # tables with a name: [materials.NAME]
COMPUTATION_TABLES = ("numerics", "output", "limits")  # tables that describe how a run is computed and saved
REQUIRED_PARAMS = (
    *MATERIAL_KEYS.values(),
    LAYER_KEYS["material"],
    LAYER_KEYS["thickness"],
)  # without a useful default


def named_table_kind(table: str) -> str:
    """The kind of NAMED_TABLES that a table belongs to; "" for other tables.

    >>> named_table_kind("layers.copper"), named_table_kind("block")
    ('layers', '')
    """
    kind, dot, _ = table.partition(".")
    return kind if dot and kind in NAMED_TABLES else ""


def is_physical_number(table: str, param: Param) -> bool:
    """Whether a key is a physical parameter of a run, which may be uncertain and may be fitted.

    Numerical settings, keys of single commands, choices, texts and whole numbers are not.
    """
    return "number" in param.kinds and table not in COMPUTATION_TABLES and table not in COMMAND_TABLES


def find_free_key_fault(
    key: Any, values: Mapping[str, Mapping[str, Any]], known: Mapping[str, type[Effect]]
) -> str | None:
    """The error of a key of `free` in a case with `values` by table, or None."""
    params = {f"{table}.{name}": (table, p) for table in values for name, p in declared_params(table, known).items()}
    fittable = [name for name, (table, p) in params.items() if is_physical_number(table, p)]
    if not isinstance(key, str) or key not in params:
        return f"{shorten_text(repr(key))} is not a parameter of this case{suggest_name(str(key), fittable)}"
    if key in fittable:
        return None
    table, param = params[key]
    why = "belongs to the computation" if "number" in param.kinds else "is not a physical parameter"
    return f"{key!r} {why} and cannot be fitted; leave it out, or name a number of block, road, contact or an effect"


def refinement_factor(level: str | float) -> float:
    """Factor on the number of cells per direction for a value of numerics.mesh."""
    return MESH_LEVEL_FACTORS[level] if isinstance(level, str) else level


def declared_params(table: str, known: Mapping[str, type[Effect]] | None = None) -> dict[str, Param]:
    """All keys of a table with their declarations; effects are those of `known`, or of the catalogue."""
    if kind := named_table_kind(table):
        return NAMED_TABLES[kind]
    out = dict(CASE_TABLES.get(table) or COMMAND_TABLES.get(table, {}))
    for name, effect in (catalogue() if known is None else known).items():
        if (effect.section if effect.base else name) == table:
            out |= effect.params()
    return out


# --- kinds of values --------------------------------------------------------------------------------
@dataclass(frozen=True)
class ValueKind:
    """A kind of value: `is_meant` tells whether a value is of this kind, `find_fault` returns its error or None."""

    is_meant: Callable[[Any], bool]
    find_fault: Callable[[Param, Any], str | None]


def _is_anything(value: Any) -> bool:
    return True


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_table(value: Any) -> bool:
    return isinstance(value, (list, dict))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _is_triple(value: Any, is_entry: Callable[[Any], bool]) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(is_entry(v) for v in value)


def _find_whole_number_fault(param: Param, value: Any) -> str | None:
    if isinstance(value, int) and not isinstance(value, bool):
        return param.find_fault(value)
    return f"give a whole number >= {param.low:g}"


def _find_cells_fault(param: Param, value: Any) -> str | None:
    good = _is_triple(value, lambda v: isinstance(v, int) and 3 <= v <= 5000)
    return None if good else "give three whole numbers from 3 to 5000: along the block, up the block, down the road"


def _find_factors_fault(param: Param, value: Any) -> str | None:
    good = _is_triple(value, lambda v: _is_number(v) and 0.1 <= v <= 10)
    return None if good else "give three factors from 0.1 to 10: along the block, up the block, down the road"


def _find_amounts_fault(param: Param, value: Any) -> str | None:
    if not isinstance(value, list) or not value:
        return f"give a list of numbers ({param.unit}), at least one"
    fault = next((f for f in map(param.find_fault, value) if f), None)
    if fault is None and len(set(value)) < len(value):
        return "give every number once"
    return fault and fault.replace("a number", "numbers", 1)


def _find_file_name_fault(param: Param, value: str) -> str | None:
    longest = max(len(os.fsencode(part)) for part in value.split("/"))
    return None if value and longest < 256 and "\0" not in value else "give a file name, of at most 255 letters"


def _find_overflow_fault(value: Any) -> str | None:
    """The error of nested numbers that exceed the range of a double, or None."""
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    if isinstance(value, int) and abs(value) > sys.float_info.max:
        return f"give numbers of at most {sys.float_info.max:.2g}"
    return next((fault for fault in map(_find_overflow_fault, inside) if fault), None)


def _choice_check(names: tuple[str, ...], remedy: str) -> Callable[[Param, Any], str | None]:
    return lambda param, value: None if value in names else remedy


# where a key accepts several kinds, the first kind that fits the value checks it
VALUE_KINDS: dict[str, ValueKind] = {
    "flag": ValueKind(_is_anything, lambda param, value: None if isinstance(value, bool) else "give true or false"),
    "whole": ValueKind(_is_anything, _find_whole_number_fault),
    "name": ValueKind(_is_text, lambda param, value: None if value else "give a name in quotes"),
    "binding": ValueKind(
        _is_anything,
        _choice_check(("auto", "scikits-odes", "scikit-sundae"), 'give "auto", "scikits-odes" or "scikit-sundae"'),
    ),
    "level": ValueKind(
        _is_text, _choice_check(tuple(MESH_LEVEL_FACTORS), 'give "coarse", "medium", "fine" or a number')
    ),
    "cells": ValueKind(_is_anything, _find_cells_fault),
    "factors": ValueKind(_is_anything, _find_factors_fault),
    "amounts": ValueKind(_is_anything, _find_amounts_fault),
    "text": ValueKind(_is_text, _find_file_name_fault),
    "table": ValueKind(
        _is_table, lambda param, value: "give at least one row" if not value else _find_overflow_fault(value)
    ),
}


VALUE_KIND_REMEDIES = {
    "name": "give a name in quotes",
    "text": "give the name of a file in quotes",
    "table": "give a list of numbers or rows",
}


def find_value_fault(param: Param, value: Any) -> str | None:
    """The error of a value according to its declaration, or None."""
    kinds = (kind for name, kind in VALUE_KINDS.items() if name in param.kinds)
    find_fault = next((kind.find_fault for kind in kinds if kind.is_meant(value)), None)
    if find_fault is None and not {"number", "amount"} & set(param.kinds):
        return " or ".join(VALUE_KIND_REMEDIES[name] for name in param.kinds)
    return (find_fault or Param.find_fault)(param, value)
