"""The declared keys of a case and the checks on them; effects declare their own."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from flashtemp.errors import BadInput, nearest
from flashtemp.physics.effect import Param, catalogue

LEVELS = {"coarse": 0.5, "medium": 1.0, "fine": 2.0}
NOTHING = Param(None, "", "")
TEXT, CURVE, FLAG = ("name",), ("number", "text", "table"), ("flag",)
TABLES: dict[str, dict[str, Param]] = {
    "block": {
        "length": Param(0.025, "m", "length in the direction of sliding", low=1e-4, high=1.0),
        "width": Param(0.05, "m", "width across the direction of sliding", low=1e-4, high=10.0),
        "height": Param(0.007, "m", "height from the face to the holder", low=1e-4, high=1.0),
        "material": Param("tread_rubber", "", "name of a material", kinds=TEXT),
        "stiffness": Param(
            1.4e9, "Pa/m", "pressure per compression of the block between holder and road, E_c/height",
            low=1e3, high=1e14,
        ),
    },
    "road": {
        "material": Param("asphalt", "", "name of a material", kinds=TEXT),
        "track_length": Param(3.5, "m", "length of one lap of the circular track", low=0.01, high=1e5),
        "depth": Param(None, "m", "depth of road simulated; from the heat's reach if not given", low=1e-5, high=10.0),
        "upstream": Param(0.003, "m", "road shown before the block", low=0.0, high=10.0),
        "downstream": Param(0.01, "m", "road shown behind the block", low=0.0, high=10.0),
    },
    "contact": {
        "pressure": Param(
            1.5e5, "Pa", "nominal contact pressure, mean; or a file of time against value",
            low=0.0, open_low=True, high=1e9, kinds=CURVE,
        ),
    },
    "friction": {},
    "schedule": {
        "speed": Param(
            0.1, "m/s", "sliding speed; or a file of time against value",
            low=0.0, open_low=True, high=1000.0, kinds=CURVE,
        ),
        "distance": Param(3.5, "m", "distance slid in one repetition", low=1e-6, high=1e7),
        "repetitions": Param(1, "1", "number of repetitions", low=1, high=100000, kinds=("whole",)),
        "wait": Param(0.0, "s", "waiting time between repetitions", low=0.0, high=1e7),
        "lifted": Param(True, "", "block lifted off the road while waiting", kinds=FLAG),
    },
    "ambient": {
        "temperature": Param(20.0, "degC", "air, initial and road temperature", low=-100.0, high=500.0),
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
            1, "1", "cells across the width at mesh = 1; 1 leaves the width out: 2D", low=1, high=5000, kinds=("whole",)
        ),
        "first_y": Param(None, "m", "first cell at both side walls; even cells if not given", low=1e-7, high=1.0),
        "finer": Param(
            [1, 1, 1], "1", "factors on mesh along the block, up the block, down the road", kinds=("factors",)
        ),
        "first_x": Param(3e-5, "m", "first cell at the leading edge", low=1e-8, high=0.1),
        "last_x": Param(6e-5, "m", "last cell at the trailing edge", low=1e-8, high=0.1),
        "first_block": Param(None, "m", "first cell of the block at the interface", low=1e-9, high=0.1),
        "first_road": Param(3e-6, "m", "first cell of the road at the interface", low=1e-9, high=0.1),
        "behind": Param(
            1.35, "1", "growth of cells behind the block from one to the next; comparisons with a wake need 1.1",
            low=1.01, high=2.0,
        ),
        "above": Param(
            0, "1", "cells spread evenly up the block, beside the graded ones; comparisons with a side wall need 10",
            low=0, high=1000, kinds=("whole",),
        ),
        "rtol": Param(1e-4, "1", "relative tolerance of the time integration", low=1e-10, high=0.05),
        "atol": Param(None, "K", "absolute tolerance; 10 rtol kelvin if not given", low=1e-12, high=10.0),
        "order": Param(3, "1", "highest BDF order; 4 and 5 may need many more steps", low=1, high=5, kinds=("whole",)),
        "integrator": Param("auto", "", '"scikits-odes", "scikit-sundae" or "auto"', kinds=("binding",)),
    },
    "output": {
        "profiles": Param(40, "1", "profiles kept per repetition", low=2, high=100000, kinds=("whole",)),
        "fields": Param(6, "1", "cell fields kept per repetition", low=2, high=10000, kinds=("whole",)),
        "pictures": Param(True, "", "draw pictures", kinds=FLAG),
        "animation": Param(True, "", "animate several repetitions or resolved spots, with the pictures", kinds=FLAG),
        "vtk": Param(True, "", "write the VTK file", kinds=FLAG),
    },
}  # fmt: skip
AMOUNT, AMOUNTS = ("amount",), ("amounts",)  # a number, or a list of them, that no fit moves
BRISTLES = {
    "speed": Param(27.0, "m/s", "rolling speed", low=0.1, high=200.0, kinds=AMOUNT),
    "stiffness": Param(
        1.5e8, "Pa/m", "shear stress of the tread per sideways shift, G/height",
        low=1e3, high=1e13, kinds=AMOUNT,
    ),
    "mass": Param(
        0.1, "kg/m2", "mass per area that a bristle moves; much more rings and is seen in the friction",
        low=0.0, open_low=True, high=1e3, kinds=AMOUNT,
    ),
    "memory": Param(
        0.2, "1", "distance r0 between cold and hot friction over contact.spot_diameter",
        low=0.0, open_low=True, high=10.0, kinds=AMOUNT,
    ),
    "fraction": Param(
        None, "1", "contact fraction of the spots; P(2 pi/spot_diameter) by theory if not given",
        low=0.0, open_low=True, high=1.0, kinds=AMOUNT,
    ),
}  # fmt: skip
ANGLES = "0.1 0.14 0.2 0.28 0.4 0.5 0.6 0.7 0.85 1 1.2 1.4 1.7 2 2.4 2.8 3.3 4 4.7 5.5 6.5 7.7 9 10.5 12.5 15"
APART: dict[str, dict[str, Param]] = {  # tables that a case has only where it names them, for commands of their own
    "tread": BRISTLES | {
        "slip": Param(
            [0.005, 0.01, 0.03, 0.05, 0.07, 0.09], "1", "slips of the wheel",
            low=0.0, open_low=True, high=1.0, kinds=AMOUNTS,
        ),
        "footprint": Param(0.1, "m", "length of the footprint", low=1e-3, high=10.0, kinds=AMOUNT),
        "mass": replace(BRISTLES["mass"], value=0.02),
    },
    "tyre": BRISTLES | {
        "loads": Param([3e3, 5e3, 7e3], "N", "wheel loads", low=0.0, open_low=True, high=1e7, kinds=AMOUNTS),
        "width": Param(0.14, "m", "width of the elliptic footprint", low=1e-3, high=10.0, kinds=AMOUNT),
        "angles": Param(
            [float(a) for a in ANGLES.split()], "deg", "slip angles", low=0.0, open_low=True, high=45.0, kinds=AMOUNTS
        ),
    },
}  # fmt: skip
MATERIAL = {
    "conductivity": Param(None, "W/mK", "thermal conductivity", low=0.0, high=1e4, open_low=True),
    "density": Param(None, "kg/m3", "density", low=0.0, high=1e5, open_low=True),
    "heat_capacity": Param(None, "J/kgK", "specific heat capacity", low=0.0, high=1e6, open_low=True),
}


@dataclass(frozen=True)
class Places:
    """Where a key stands: file and line, or what overrode it."""

    file: str
    text: str = ""
    overridden: set[str] = field(default_factory=set)
    by: str = "command line"

    def __call__(self, dotted: str) -> str:
        if any(dotted == o or o.startswith(dotted + ".") for o in self.overridden):
            return f"{dotted} ({self.by})"
        line = self.line(dotted)
        return f"{self.file}:{line}: {dotted}" if line else f"{self.file}: {dotted}"

    def line(self, dotted: str) -> int | None:
        """1-based line of a dotted key, or None for one that is not written there."""
        prefix = ""
        for number, raw in enumerate(self.text.splitlines(), 1):
            line = raw.split("#", 1)[0].strip()
            if header := re.fullmatch(r"\[+\s*([^\]]+?)\s*\]+", line):
                prefix = header[1] + "."
                if header[1] == dotted:
                    return number
            elif (found := re.match(r"([\w\.\"'-]+)\s*=", line)) and prefix + found[1].strip("\"'") == dotted:
                return number
        return None

    def prefix(self, line: str) -> str:
        """An error line that begins with its key, completed by where the key stands."""
        key = line.split(":", 1)[0]
        return self(key) + line[len(key) :] if re.fullmatch(r"[\w.]+", key) else f"{self.file}: {line}"


def read_toml(file: Path) -> tuple[str, dict]:
    """Text and tables of a TOML file that exists.  Raises BadInput."""
    try:
        text = file.read_text(encoding="utf-8")
        return text, tomllib.loads(text)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as fault:
        raise BadInput(f"{file}: not valid TOML: {' '.join(str(fault).split())}; repair that place") from fault


def refinement(level: str | float) -> float:
    """Factor on the number of cells per direction of a numerics.mesh."""
    return LEVELS.get(level, level)


def declared(table: str) -> dict[str, Param]:
    """All keys of a table of the case with their declarations."""
    if table.startswith("materials."):
        return MATERIAL
    out = dict(TABLES.get(table) or APART.get(table, {}))
    for name, effect in catalogue().items():
        if (effect.section if effect.base else name) == table:
            out |= effect.params()
    return out


def tables(raw: dict, effects, where: Places, faults: list[str]) -> dict[str, dict[str, Param]]:
    """Tables this case may have: the base ones, those apart that it names, its materials, its effects."""
    own = raw.get("materials", {})
    if not isinstance(own, dict):
        faults.append(f"{where('materials')}: {own!r}; write [materials.NAME] and its properties below it")
        own = {}
    names = [f"materials.{n}" for n in own]
    out = {t: declared(t) for t in [*TABLES, *(t for t in APART if t in raw), *names, *effects]}
    for n in names:
        raw[n] = own[n.split(".", 1)[1]]
    raw.pop("materials", None)
    return out


def parse_overrides(overrides) -> dict[str, Any]:
    """["a.b=1"] or {"a.b": 1} -> {"a.b": 1}; values are TOML, bare words are text."""
    if not overrides:
        return {}
    if isinstance(overrides, dict):
        return dict(overrides)
    out = {}
    for item in overrides:
        key, eq, text = item.partition("=")
        if not eq or not key.strip():
            raise BadInput(
                f"{item} (command line): not an override; write table.key=value, for example friction.mu=0.8"
            )
        try:
            out[key.strip()] = tomllib.loads(f"v = {text}")["v"]
        except tomllib.TOMLDecodeError:
            out[key.strip()] = text.strip()
    return out


def merge(raw: dict, given: dict[str, Any], by: str) -> dict:
    """Overrides, given `by` somebody, laid over the tables of a file; neither is changed."""
    out = {k: dict(v) if isinstance(v, dict) else v for k, v in raw.items()}
    if isinstance(out.get("materials"), dict):
        out["materials"] = {k: dict(v) if isinstance(v, dict) else v for k, v in out["materials"].items()}
    for dotted, value in given.items():
        *path, last = dotted.split(".")
        at = out
        for step in path:
            at = at.setdefault(step, {})
            if not isinstance(at, dict):
                raise BadInput(f"{dotted} ({by}): '{step}' is not a table")
        at[last] = value
    return out


def names(raw: dict, key: str, known, where: Places, faults: list[str]) -> tuple[str, ...] | None:
    """A list of effect names, each checked against the catalogue; None when not given."""
    if key not in raw:
        return None
    value = raw[key]
    if isinstance(value, str):
        value = [v.strip() for v in value.split(",") if v.strip()]
    if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
        faults.append(f"{where(key)}: {value!r}; give a list of names that `flashtemp effects` prints")
        return ()
    for name in value:
        if name not in known:
            why = (
                "always acts; leave it out" if name in catalogue() else f"is not in the catalogue{nearest(name, known)}"
            )
            faults.append(f"{where(key)}: effect '{name}' {why}")
    for name in {v for v in value if value.count(v) > 1}:
        faults.append(f"{where(key)}: effect '{name}' is listed twice; once is enough")
    return tuple(v for v in value if v in known)


def check(table: str, declared: dict[str, Param], given, where: Places, faults: list[str]) -> dict[str, Any]:
    """Values of one table with defaults; every fault is appended to `faults`."""
    if not isinstance(given, dict):
        faults.append(f"{where(table)}: {given!r} is not a table; write [{table}] and its keys below it")
        return {}
    for key in given:
        if key not in declared:
            faults.append(f"{where(f'{table}.{key}')}: unknown key{nearest(key, declared)}")
    out = {}
    for key, param in declared.items():
        if key not in given:
            out[key] = param.value
            if param.value is None and declared is MATERIAL:
                faults.append(f"{where(table)}: {key} is missing; give it in {param.unit}")
            continue
        value = given[key]
        if value == "inf" and param.high == float("inf") and "number" in param.kinds:
            value = float("inf")
        if fault := wrong(param, value):
            faults.append(f"{where(f'{table}.{key}')}: {value!r}; {fault}")
        out[key] = value
    return out


def wrong(param: Param, value: Any) -> str | None:
    """What is wrong with a value under its declaration, or None."""
    kinds = param.kinds
    if "flag" in kinds:
        return None if isinstance(value, bool) else "give true or false"
    if "whole" in kinds and not isinstance(value, bool) and isinstance(value, int):
        return param.fault(value)
    if "whole" in kinds:
        return f"give a whole number >= {param.low:g}"
    if "name" in kinds:
        return None if isinstance(value, str) and value else "give a name in quotes"
    if "binding" in kinds:
        return (
            None
            if value in ("auto", "scikits-odes", "scikit-sundae")
            else 'give "auto", "scikits-odes" or "scikit-sundae"'
        )
    if "level" in kinds and isinstance(value, str):
        return None if value in LEVELS else 'give "coarse", "medium", "fine" or a number'
    if "cells" in kinds:
        good = isinstance(value, list) and len(value) == 3 and all(isinstance(v, int) and 3 <= v <= 5000 for v in value)
        return None if good else "give three whole numbers from 3 to 5000: along the block, up the block, down the road"
    if "factors" in kinds:
        good = (
            isinstance(value, list)
            and len(value) == 3
            and all(isinstance(v, (int, float)) and not isinstance(v, bool) and 0.1 <= v <= 10 for v in value)
        )
        return None if good else "give three factors from 0.1 to 10: along the block, up the block, down the road"
    if "amounts" in kinds:
        if not isinstance(value, list) or not value:
            return f"give a list of numbers ({param.unit}), at least one"
        fault = next((f for f in map(param.fault, value) if f), None)
        if fault is None and len(set(value)) < len(value):
            return "give every number once"
        return fault and fault.replace("a number", "numbers", 1)
    if isinstance(value, str) and "text" in kinds:
        return None if value else "give a file name"
    if isinstance(value, (list, dict)) and "table" in kinds:
        return None if value else "give at least one row"
    return param.fault(value)
