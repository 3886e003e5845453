"""Content of the title page: what was run, the conditions of the test, the method, and what reproduces the result."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.comparison.campaign import Campaign
from flashtemp.display import format_count
from flashtemp.model.case import Case
from flashtemp.model.schema import refinement_factor
from flashtemp.physics.material import Material
from flashtemp.runs.checks import mesh_error
from flashtemp.runs.results.provenance import digest_file, package_versions, source_commit
from flashtemp.viz.html.page import ReportSubject
from flashtemp.viz.key_labels import describe_key
from flashtemp.viz.number_format import effect_label, format_number

CONDITION_KEYS = (
    "contact.pressure", "schedule.speed", "schedule.distance", "schedule.repetitions", "schedule.wait",
    "ambient.temperature",
)  # fmt: skip
MATERIAL_UNITS = {"conductivity": "W/(m K)", "density": "kg/m³", "heat_capacity": "J/(kg K)"}
MAX_VALUES_LISTED = 6  # different values of a key; more are given as a range


def describe_campaign(campaign: Campaign, case: Case, command: str, method: str) -> ReportSubject:
    """The subject of a report on a campaign, with its stated case; `method` precedes that of the simulations."""
    held_out = sum(entry.held_out for entry in campaign.entries)
    files = [format_count(len(campaign.views), "recording"), format_count(len(campaign.forces), "load-cell file")]
    conditions = campaign.conditions
    measured = f"{', '.join(files)}; {format_count(len(conditions), 'condition')}"
    facts = [
        *_common_facts(command, source_commit()),
        ("case", f"{case.title} ({campaign.case})"),
        ("measurements", measured + (f"; {format_count(held_out, 'file')} held out" if held_out else "")),
    ]
    inputs = {campaign.file_name: campaign.folder / campaign.file_name, "case.toml": _case_file(campaign.case)}
    inputs |= {name: case.folder / name for name in case.named_files().values()}
    inputs |= {entry.file: campaign.folder / entry.file for entry in campaign.entries}
    versions = package_versions(case.settings.binding)
    return ReportSubject(
        tuple(facts),
        tuple(list_conditions(case, [c.given for c in conditions])),
        f"{method} {describe_simulation(case, versions)}",
        _digest_files(inputs),
        tuple(versions.items()),
    )


def describe_run(case: Case, run: Any, folder: Path) -> ReportSubject:
    """The subject of a report on a finished run in its result folder."""
    made = datetime.fromtimestamp((folder / "run.nc").stat().st_mtime).astimezone()
    facts = _common_facts(f"flashtemp run {folder / 'case.toml'}", run.statistics.get("commit"), made)
    inputs = {name: folder / name for name in ("case.toml", *case.named_files().values(), "run.nc")}
    versions = run.statistics.get("versions", {})
    steps, imbalance = run.statistics.get("steps"), format_number(run.energy_imbalance)
    took = f"{steps} time steps; the" if steps else "The"
    balance = f"The run took {took} energy imbalance is {imbalance} of the heat exchanged."
    return ReportSubject(
        (*facts, ("case", case.title)),
        tuple(list_conditions(case, [{}])),
        f"{describe_simulation(case, versions)} {balance}",
        _digest_files(inputs),
        tuple((name, str(version)) for name, version in versions.items()),
    )


def describe_study(
    case: Case, command: str, points: Sequence[dict[str, Any]], method: str, inputs: dict[str, Path], result: Path
) -> ReportSubject:
    """The subject of a report on a study of a `case` at `points`; `result` is the file that the study wrote."""
    made = datetime.fromtimestamp(result.stat().st_mtime).astimezone()
    versions = package_versions(case.settings.binding)
    own = "The versions of programs are those at the time of this report."
    return ReportSubject(
        (*_common_facts(command, source_commit(), made), ("case", case.title)),
        tuple(list_conditions(case, points)),
        f"{method} {describe_simulation(case, versions)} {own}",
        _digest_files(inputs),
        tuple(versions.items()),
    )


def _common_facts(command: str, commit: str | None, made: datetime | None = None) -> list[tuple[str, str]]:
    when = (made or datetime.now().astimezone()).strftime("%Y-%m-%d %H:%M %z")
    program = f"flashtemp {package_version()}" + (f", commit {commit}" if commit else "")
    return [("command", command), ("date", when), ("program", program)]


def package_version() -> str:
    """The version of flashtemp that writes the report."""
    from importlib.metadata import version

    return version("flashtemp")


def _case_file(path: Path) -> Path:
    return path / "case.toml" if path.is_dir() else path


def _digest_files(inputs: dict[str, Path]) -> tuple[tuple[str, str], ...]:
    return tuple((name, digest_file(path)) for name, path in inputs.items() if path.is_file())


def list_conditions(case: Case, overrides: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """Load, speed, schedule, sizes and materials of a test, with units; `overrides` of each of its conditions."""
    slides = not case.scene.schedule.alone
    keys = [k for k in CONDITION_KEYS if slides or not k.startswith(("schedule", "contact"))]
    keys += sorted({k for given in overrides for k in given} - set(keys))
    rows = [(describe_key(k).words, _list_values(k, [g.get(k, _case_value(case, k)) for g in overrides])) for k in keys]
    size = " × ".join(format_number(1e3 * case[f"block.{side}"]) for side in ("length", "width", "height"))
    rows.append(("block, length × width × height", f"{size} mm"))
    scene = case.scene
    materials = {f"layer {layer.name}": layer.material for layer in scene.layers}
    materials = materials or {f"block, {effect_label(case['block.material'])}": scene.block}
    if slides:
        materials[f"road, {effect_label(case['road.material'])}"] = scene.road
    rows += [(name, _describe_material(material)) for name, material in materials.items()]
    effects = ", ".join(effect_label(name) for name in case.effects)
    return [*rows, ("effects beyond the base model", effects or "none")]


def _case_value(case: Case, key: str) -> Any:
    """The value of a key; a dash where the table belongs to an effect that the case does not contain."""
    table, _, name = key.rpartition(".")
    return case.values.get(table, {}).get(name, "–")


def _list_values(key: str, values: list[Any]) -> str:
    """The different values of a key with their unit; a range where there are many."""
    label, unique = describe_key(key), list({repr(v): v for v in values}.values())
    is_numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in unique)
    if is_numeric:
        unique.sort()
    texts = [label.format_value(v) for v in unique]
    if is_numeric and len(texts) > MAX_VALUES_LISTED:
        texts = [f"{len(texts)} values from {texts[0]} to {texts[-1]}"]
    return f"{', '.join(texts)} {label.unit if is_numeric else ''}".rstrip()


def _describe_material(material: Material) -> str:
    numbers = {name: format_number(getattr(material, name)) for name in MATERIAL_UNITS}
    return ", ".join(f"{name.replace('_', ' ')} {numbers[name]} {unit}" for name, unit in MATERIAL_UNITS.items())


def describe_simulation(case: Case, versions: dict[str, str]) -> str:
    """Mesh, integrator, tolerance and error estimate of the simulations of a case, in sentences."""
    mesh, settings = case.scene.mesh, case.settings
    first = format_number(1e6 * min(np.diff(mesh.height[:2])[0], np.diff(mesh.depth[:2])[0]))
    binding = next((f"{name} {v}" for name, v in versions.items() if name.startswith("scikit")), settings.binding)
    sentences = [
        f"The heat balance of block and road is solved by finite volumes on {mesh.n_cells} cells in "
        f"{3 if mesh.n_across > 1 else 2} dimensions, {first} µm deep at the contact.",
        f"Time is integrated by CVODE (backward differentiation up to order {settings.order}) through {binding}, with "
        f"a relative tolerance of {settings.rtol:g}.",
    ]
    if not case.scene.schedule.alone:
        error = mesh_error.estimate_face_error(refinement_factor(case["numerics.mesh"]) * min(case["numerics.finer"]))
        sentences.append(
            f"The error of the surface temperature by this mesh is about {format_number(error)} % of the largest "
            "temperature rise, as measured on standard cases."
        )
    return " ".join(sentences)
