"""Usual uncertainties of the stated numbers of a test, by kind, and which numbers are not measured inputs.

The standard deviations are type B evaluations (JCGM 100:2008, section 4.3): from data sheets, handbooks and usual
practice if the measurement was not repeated.  Cases with one number a little larger or smaller give the sensitivity to
it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.comparison.known_inputs import APPROXIMATE_ZEROS
from flashtemp.discovery.hypotheses.candidates import NOTHING_SLIDES
from flashtemp.errors import BadInput
from flashtemp.model import layers
from flashtemp.model.case import Case
from flashtemp.model.priors import USUAL_SD, expand_materials
from flashtemp.model.scene import Scene
from flashtemp.model.schema import CASE_TABLES, COMMAND_TABLES, COMPUTATION_TABLES
from flashtemp.physics.effect import Param
from flashtemp.solver.mesh_mapping import stretch_mesh

TANGENT_STEP_LN = 1e-3  # of the ln of a value; the error of a tangent is the curvature only
TANGENT_STEP_SD = 0.02  # usual standard deviations of a value that moves in its own unit
RUN_STEP_RATIO = 10.0  # times as far where two separate runs are subtracted: their solver errors do not cancel
CAMERA_INPUTS = {  # stated by a recording: effect and parameter that move it, and the step in its own unit
    "emissivity": ("emissivity", "change", -1e-3),
    "reflected_temperature": ("reflection", "excess", 0.1),
}


@dataclass(frozen=True)
class InputKind:
    """A kind of stated number: its usual standard deviation `sd`, relative or in its own unit, and the `reason`."""

    name: str
    sd: float
    relative: bool
    reason: str


LAW_PARAMETER = "law parameter"
INPUT_KINDS: dict[str, InputKind] = {
    k.name: k
    for k in (
        InputKind("geometry", 0.01, True, "ruler or calliper on soft rubber: 0.2 mm of 20 mm"),
        InputKind("load", 0.02, True, "dead weight or load cell, divided by the measured face"),
        InputKind("speed", 0.01, True, "control of the drive, and the radius of the track"),
        InputKind("duration", 0.01, True, "clock of the controller, with the time to start, stop and lift"),
        InputKind("density", 0.02, True, "weighed sample of measured size"),
        InputKind("heat capacity", 0.05, True, "handbook value; calorimetry of one kind of compound scatters by it"),
        InputKind("conductivity", 0.1, True, "handbook value; mixes of one kind differ by it (asphalt: Carlson 2010)"),
        InputKind("conductance", 0.3, True, "correlations for films of air and for contacts scatter by it"),
        InputKind("friction", 0.1, True, "another pair, another day; a load cell knows it better"),
        InputKind("contact fraction", 0.1, True, "prints and microscopy of contact regions"),
        InputKind("spot diameter", 0.2, True, "sizes of stones scatter"),
        InputKind("stiffness", 0.1, True, "modulus of a compound from batch to batch"),
        InputKind("Poisson's ratio", 0.005, False, "rubber between 0.485 and 0.4995"),
        InputKind("temperature", 0.5, False, "thermometer, and drift of a laboratory within an hour"),
        InputKind("emissivity", 0.05, False, "tables for a material, without knowing its finish"),
        InputKind("reflected temperature", 2.0, False, "unmeasured surroundings, such as walls and lamps"),
        InputKind("insulated surface", 5.0, False, "free convection 10 K above the air: 3 to 6 W/m2K (Incropera)"),
        InputKind(LAW_PARAMETER, 0.2, True, "fitted constant of a law, as for a free key"),
    )
}
KIND_OF_KEY = {
    "contact.pressure": "load",
    "contact.alpha": "conductance",
    "contact.gap_coefficient": "conductance",
    "contact.spot_fraction": "contact fraction",
    "contact.spot_diameter": "spot diameter",
    "friction.mu": "friction",
    "schedule.speed": "speed",
    "schedule.distance": "geometry",
    "schedule.wait": "duration",
    "ambient.convection": "conductance",
    "ambient.road_sides": "conductance",
    "block.modulus": "stiffness",
    "block.poisson": "Poisson's ratio",
    "block.stiffness": "stiffness",
}
KIND_OF_ZERO = dict.fromkeys(APPROXIMATE_ZEROS, "insulated surface")
KIND_OF_NAME = {  # where the key itself is not listed: keys of materials, layers and effects
    "conductivity": "conductivity",
    "density": "density",
    "heat_capacity": "heat capacity",
    "thickness": "geometry",
    "contact_resistance": "conductance",
    "speed": "speed",
    "emissivity": "emissivity",
    "absorptivity": "emissivity",
    "reflected_temperature": "reflected temperature",
}
KIND_OF_UNIT = {"degC": "temperature", "W/m2K": "conductance"}  # of what is left
MODEL_CHOICE = "choice of the model, not a measured number"
ROAD_EXTENT = "extent of the road that is simulated, no property of the test"
LAW_DEFINITION = "reference point of a law, a definition"
EXEMPT_KEYS = {
    "road.depth": ROAD_EXTENT,
    "road.upstream": ROAD_EXTENT,
    "road.downstream": ROAD_EXTENT,
    "contact.heat_split": MODEL_CHOICE,
    "contact.flash_factor": MODEL_CHOICE,
    "contact.lane_widening": MODEL_CHOICE,
    "contact.reference_pressure": LAW_DEFINITION,
    "schedule.alone": "ends the run; every frame carries its own time",
}
EXEMPT_NAMES = {"reference": LAW_DEFINITION, "weight": "switch of an effect", "cells": "count of cells"}
SLIDING_TABLES = ("road", "contact", "friction", "schedule")  # no meaning where the block meets no road
TIME_SERIES_KEYS = ("contact.pressure", "schedule.speed")  # may be a file or rows over time, with one common factor


def input_kind(key: str, unit: str, is_zero: bool = False) -> InputKind:
    """The kind of a key of a case, or of `VIEW.emissivity` and `VIEW.reflected_temperature`.

    `is_zero`: the value is zero in all conditions, so that a relative standard deviation would mean nothing.
    Parameters of effects have the standard deviation that `flashtemp sensitivity` uses, where it has one.

    >>> input_kind("materials.steel.density", "kg/m3").sd, input_kind("ambient.temperature", "degC").relative
    (0.02, False)
    >>> input_kind("ambient.convection", "W/m2K", is_zero=True).sd
    5.0
    """
    if is_zero and key in KIND_OF_ZERO:
        return INPUT_KINDS[KIND_OF_ZERO[key]]
    table, name = key.rsplit(".", 1)
    found = KIND_OF_KEY.get(key) or KIND_OF_NAME.get(name)
    if found is None and table in ("block", "road") and unit == "m":
        found = "geometry"
    if found is None and table not in CASE_TABLES and key in USUAL_SD:
        return InputKind(LAW_PARAMETER, *USUAL_SD[key])
    return INPUT_KINDS[found or KIND_OF_UNIT.get(unit, LAW_PARAMETER)]


def exemption_reason(case: Case, key: str) -> str:
    """Why a key of a case is not a measured input; empty if it is one.

    `case` has its ready materials written out (`model.priors.expand_materials`).
    """
    table, name = key.rsplit(".", 1)
    value, param = case.values[table][name], case.declared_params(table)[name]
    if table in COMPUTATION_TABLES or table in COMMAND_TABLES:
        return "belongs to the computation, or to another command"
    if "whole" in param.kinds:
        return "a count"
    if key in EXEMPT_KEYS or name in EXEMPT_NAMES:
        return EXEMPT_KEYS.get(key) or EXEMPT_NAMES[name]
    if case.values["schedule"]["alone"] and (table in SLIDING_TABLES or table == _road_material(case)):
        return NOTHING_SLIDES
    if table == "block" and name in layers.LAYER_DERIVED_KEYS and layers.layer_names(case.values):
        return "follows from the layers"
    return _missing_sd_reason(key, value, param)


def _road_material(case: Case) -> str:
    """The table of the road's material; empty if the block has the same material."""
    names = {d["material"] for t, d in case.values.items() if t == "block" or t.startswith("layers.")}
    road = case.values["road"]["material"]
    return "" if road in names else f"materials.{road}"


def _missing_sd_reason(key: str, value: Any, param: Param) -> str:
    """Why the value of a key has no standard deviation; empty if it has one."""
    if value is None:
        return "not given; follows from the other numbers"
    if isinstance(value, bool) or "number" not in param.kinds:
        return "no number"
    if not isinstance(value, (int, float)):
        return "" if key in TIME_SERIES_KEYS else "a table, not one number"
    if not math.isfinite(value):
        return "infinite: an ideal limit"
    is_switched_off = value == 0 and param.unit != "degC" and key not in KIND_OF_ZERO
    return "zero: switched off" if is_switched_off else ""


def physical_keys(case: Case) -> dict[str, str]:
    """Every key of a case that is a measured input, with its unit."""
    out = {}
    for table, own in case.values.items():
        declared: Mapping[str, Param] = case.declared_params(table)
        for name in own:
            if name in declared and not exemption_reason(case, f"{table}.{name}"):
                out[f"{table}.{name}"] = declared[name].unit
    return out


def time_series_values(case: Case, key: str) -> tuple[float, ...]:
    """The value of a key, or all values of its time series; empty if it is not an input of the case."""
    table, name = key.rsplit(".", 1)
    if name not in case.values.get(table, {}) or exemption_reason(case, key) not in ("", MODEL_CHOICE):
        return ()
    value = case.values[table][name]
    return (float(value),) if isinstance(value, (int, float)) else _read_time_series(value, key, case.folder)[1]


def scale_value(case: Case, key: str, factor: float) -> Any:
    """The value of a key times a factor, or the rows of its time series with their values times the factor.

    Raises BadInput for a value that is neither.
    """
    table, name = key.rsplit(".", 1)
    value = case.values[table][name]
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return value * factor
    if key not in TIME_SERIES_KEYS:
        raise BadInput(f"{key}: {value!r} is no number")
    times, values = _read_time_series(value, key, case.folder)
    return [[t, v * factor] for t, v in zip(times, values, strict=True)]


def _read_time_series(value: Any, key: str, folder: Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Times and values of a file or list of rows.  Raises BadInput."""
    from flashtemp.physics.interpolation import read_xy_pairs
    from flashtemp.physics.tables.column_matching import PRESSURE, SPEED, TIME

    return read_xy_pairs(value, folder, key, columns=(TIME, SPEED if key == "schedule.speed" else PRESSURE))


def iter_stepped_cases(case: Case, key: str, scale: float = 1.0, is_zero: bool = False) -> Iterator[tuple[Case, float]]:
    """The case with a key moved up, then down, each with its step; a step that the case refuses is left out.

    Steps are in ln of the value, or in the key's own unit where its kind is absolute; `scale` multiplies them.
    `is_zero`: all conditions state the key as zero.
    """
    full = expand_materials(case)
    table, name = key.rsplit(".", 1)
    kind = input_kind(key, full.declared_params(table)[name].unit, is_zero)
    size = scale * (TANGENT_STEP_LN if kind.relative else TANGENT_STEP_SD * kind.sd)
    for step in (size, -size):
        try:
            value = scale_value(full, key, math.exp(step)) if kind.relative else full[key] + step
            moved = full.with_values({key: value})
        except BadInput:
            continue
        yield moved, step


def allows_tangent_run(plain: Scene, moved: Scene) -> bool:
    """Whether a tangent run is possible: the same schedule, and the same cells except for their size."""
    if _phase_times(plain) != _phase_times(moved):
        return False
    try:
        stretch_mesh(plain, moved)
    except ValueError:
        return False
    return True


def has_same_mesh(plain: Scene, moved: Scene) -> bool:
    """Whether two scenes have the same cells."""
    return all(np.array_equal(getattr(plain.mesh, k), getattr(moved.mesh, k)) for k in ("x", "thickness", "y"))


def _phase_times(scene: Scene) -> list[tuple[bool, float, float]]:
    """Beginning and end of all phases of a scene, s."""
    return [(p.sliding, p.begin, p.end) for p in scene.schedule.phases]
