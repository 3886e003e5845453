"""Remarks on a case that can run, each with its key and a remedy: memory, unusual values, walls that 2D leaves out."""

from __future__ import annotations

import os
from dataclasses import dataclass

from flashtemp.model.case import Case
from flashtemp.physics import units
from flashtemp.runs.checks import mesh_error

BASE_MEMORY_BYTES = 2.2e8  # of a run with few cells
CELL_MEMORY_BYTES = 550.0  # per cell: peak of runs with 78,000 to 314,000 cells, in 2D and 3D
MAX_MEMORY_FRACTION = 0.5  # of the memory of the computer, above which a remark is made
USUAL_RANGES = {  # key: lowest and highest value, in its unit, of rubber on a road; a wrong unit is beyond them
    "contact.pressure": (2e3, 2e7),
    "schedule.speed": (1e-4, 100.0),
    "friction.mu": (0.02, 4.0),
    "ambient.temperature": (-60.0, 120.0),
}
MIN_SIDE_WALL_RATIO = 0.3  # area of the side walls over that of the cooled walls, from which their cooling counts
MIN_SIDE_WALL_LOSS = 0.1  # fraction of the heat in the block that the side walls would lose in the test
LIKELY_UNITS = {"Pa": ("MPa", "kPa", "bar"), "m/s": ("mm/s", "km/h"), "degC": ("K", "degF")}


@dataclass(frozen=True)
class CaseRemark:
    """A remark on the value of a `key`, and what to do."""

    key: str
    text: str

    def __str__(self) -> str:
        return f"{self.key}: {self.text}"


def remark_on_values(case: Case) -> list[CaseRemark]:
    """Remarks on values that are unusual, as with a wrong unit, and the likely unit; values in files are not judged."""
    out = []
    for key, (low, high) in USUAL_RANGES.items():
        table, _, name = key.partition(".")
        value, unit = case.values[table].get(name), case.declared_params(table)[name].unit
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            continue
        if not low <= (abs(value) if key == "schedule.speed" else value) <= high:  # a negative speed is backward
            suffix = "" if unit == "1" else f" {unit}"
            text = f"{value:g}{suffix} is unusual, {low:g} to {high:g}{suffix} is usual; check the value and its unit"
            if likely := _likely_unit(value, unit, low, high):
                text += f', or write "{value:g} {likely}" if that is meant'
            out.append(CaseRemark(key, text))
    return out


def _likely_unit(value: float, unit: str, low: float, high: float) -> str:
    """The first unit in which a value lies in the usual range `low` to `high` of `unit`; "" where there is none."""
    for other in LIKELY_UNITS.get(unit, ()):
        factor, offset = units.find_conversion(other, unit)
        if low <= (abs(value) * factor if unit == "m/s" else value * factor + offset) <= high:
            return other
    return ""


def remark_on_side_walls(case: Case) -> list[CaseRemark]:
    """A remark where a 2D run leaves out side walls (across y) that would lose a noticeable part of the heat.

    `ambient.convection` cools the leading and the trailing wall in 2D.  A coefficient that is fitted to a measurement
    then makes up for the side walls: with length = width it doubles.
    """
    scene, h = case.scene, case["ambient.convection"]
    ratio = scene.length / scene.width
    stored = scene.block.density * scene.block.heat_capacity * scene.width  # J/m2K, between the two side walls
    loss = 2 * h * scene.schedule.end_time / stored
    if scene.resolved or ratio < MIN_SIDE_WALL_RATIO or loss < MIN_SIDE_WALL_LOSS:
        return []
    text = (
        f"in 2D (numerics.across = 1) it leaves out the walls at the sides, {100 * ratio:.0f} % of the area of the"
        " walls that it cools; give numerics.across = 3 to cool them too"
    )
    return [CaseRemark("ambient.convection", text)]


def remark_on_memory(case: Case) -> list[CaseRemark]:
    """A remark where a run takes much of the memory of this computer."""
    cells = case.scene.mesh.n_cells
    needed, there = BASE_MEMORY_BYTES + CELL_MEMORY_BYTES * cells, _memory_bytes()
    if there is None or needed <= MAX_MEMORY_FRACTION * there:
        return []
    key = "numerics.across" if case["numerics.across"] > 1 else "numerics.mesh"
    memory = f"about {needed / 1e9:.2g} of the {there / 1e9:.2g} GB of memory here"
    return [CaseRemark(key, f"{cells:,} cells take {memory}; give a smaller {key}")]


def remark_on_resolution(case: Case) -> list[CaseRemark]:
    """The warning of a coarse mesh, in one line."""
    factor = mesh_error.find_coarse_factor(case)
    if factor is None:
        return []
    verified = mesh_error.COARSEST_VERIFIED_FACTOR
    percent, verified_percent = (f"{mesh_error.estimate_face_error(f):.2g} %" for f in (factor, verified))
    return [
        CaseRemark(
            "numerics.mesh",
            f"coarse: the face temperature errs by about {percent} of the largest rise; {verified:g} gives "
            f"{verified_percent}",
        )
    ]


def _memory_bytes() -> float | None:
    """Memory of this computer; None where the system does not say."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):  # not a POSIX system
        return None
