"""Build a Scene from the checked values of a case: materials, schedule, active effects, and the mesh they need."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.meshes import block_on_road
from flashtemp.meshes.mesh import Mesh
from flashtemp.model import layers
from flashtemp.model.effect_laws import EffectLaws, has_pressure_shift, mean_over_columns
from flashtemp.model.scene import ActiveEffect, Scene, SceneOutline
from flashtemp.model.schedule import Schedule, SpeedProfile, TimeSeries
from flashtemp.model.schema import CASE_TABLES, refinement_factor
from flashtemp.physics import contribution_check
from flashtemp.physics.effect import Deposit, Effect, Term
from flashtemp.physics.elastic_block import count_unknowns
from flashtemp.physics.interpolation import read_xy_pairs
from flashtemp.physics.material import Material
from flashtemp.physics.quantities import KELVIN
from flashtemp.physics.tables.column_matching import PRESSURE, SPEED, TIME

MAX_ELASTIC_UNKNOWNS = 200_000  # displacements of an elastic block; 176,000 take 110 s and 4.2 GB
FIRST_CELL_RATIO = 0.0285  # first cell over diffusion length: 3 um of road at 1 m/s

Values = Mapping[str, Mapping[str, Any]]
EffectsByName = Mapping[str, type[Effect]]


def build_scene(values: Values, effects: EffectsByName, folder: Path) -> Scene:
    """The scene of checked values {table: {key: value}} with the active `effects`, by name.

    File names are relative to `folder`.  Raises BadInput for inconsistent values.
    """
    v = SimpleNamespace(**{t: SimpleNamespace(**d) for t, d in values.items() if t in CASE_TABLES})
    acting = _make_active_effects(values, effects, folder)
    profile, pressure = _read_speed_profile(values, folder), _read_series(values, "contact.pressure", folder)
    plan = Schedule(
        profile.speed, pressure, v.schedule.distance, v.schedule.repetitions, v.schedule.wait, v.schedule.lifted,
        heading=profile.heading, turns=profile.turns, turn=v.schedule.turn,
        alone=v.schedule.alone or 0.0,
    )  # fmt: skip
    outline = _make_outline(values, v, plan)
    contributions = [(part, a.p) for a in acting for part in a.contributions(outline)]
    depths = _deposit_depths([part for part, _ in contributions if isinstance(part, Deposit)])
    remembers = _has_track_memory(contributions)
    schedule = _add_lap_events(plan, v, remembers)
    mesh = _build_mesh(v, outline, schedule, remembers, depths, _has_resolved_spots(contributions))
    if remembers and v.road.track_length <= mesh.x[-1] - mesh.x[0]:
        raise BadInput(
            f"road.track_length: {v.road.track_length:g} m is shorter than the road around the block "
            f"({mesh.x[-1] - mesh.x[0]:g} m); give a longer track"
        )
    common = {f.name: getattr(outline, f.name) for f in fields(Scene) if hasattr(outline, f.name)}
    built = Scene(**common | {"mesh": mesh, "schedule": schedule, "acting": acting})
    _check_scene(built)
    return built


def _make_outline(values: Values, v: Any, plan: Schedule) -> SceneOutline:
    """The scene without its mesh, from the values by table and as attributes `v`."""
    materials = {side: layers.find_material(values, f"{side}.material") for side in ("block", "road")}
    return SceneOutline(
        **materials,
        schedule=plan,
        ambient=v.ambient.temperature + KELVIN,
        length=v.block.length,
        width=v.block.width,
        height=v.block.height,
        spot_diameter=v.contact.spot_diameter,
        spot_fraction=v.contact.spot_fraction,
        track_length=v.road.track_length,
        modulus=v.block.modulus,
        modulus_slope=v.block.modulus_slope,
        poisson=v.block.poisson,
        stiffness=v.block.stiffness,
        elastic_3d=v.numerics.elastic_3d,
        resolved=v.numerics.across > 1,
        layers=layers.build_layers(values),
    )


class TheoryCase(Protocol):
    """The part of a case that `find_theory` needs."""

    @property
    def scene(self) -> Scene: ...
    @property
    def known_effects(self) -> EffectsByName: ...
    @property
    def effects(self) -> tuple[str, ...]: ...
    @property
    def name(self) -> str: ...


def find_theory(case: TheoryCase) -> tuple[Scene, ActiveEffect]:
    """The scene of a case and its active effect with a friction theory `p.theory`.  Raises BadInput if none."""
    for acting in case.scene.acting:
        if hasattr(acting.p, "theory"):
            return case.scene, acting
    remedy = " or ".join(
        f'"{name}"' for name, effect in case.known_effects.items() if "master_curve" in effect.params()
    )
    error = f"{case.name}: effects: {list(case.effects)}; none computes friction from a spectrum and a master curve"
    raise BadInput(f"{error}, add {remedy}")


# --- effects -----------------------------------------------------------------------------------------
def _make_active_effects(values: Values, effects: EffectsByName, folder: Path) -> tuple[ActiveEffect, ...]:
    """Every active effect with its parameters and tables; its contributions to the camera are checked."""
    acting = []
    for name, effect in effects.items():
        section = values[str(effect.section) if effect.base else name]
        given = effect.prepare({k: section[k] for k in effect.params()}, folder)
        acting.append(ActiveEffect(name, effect(), SimpleNamespace(**given)))
        contribution_check.check_camera_contributions(name, acting[-1].effect, acting[-1].p)
    return tuple(acting)


def _deposit_depths(deposits: list[Deposit]) -> list[float]:
    """Depths (m) at which heat is released.  Raises BadInput where the fractions add up to more than 1."""
    total = sum(d.share for d in deposits)
    if total > 1 + 1e-12:
        raise BadInput(
            f"friction.volumetric_share: the fractions of heat released inside the rubber add up to {total:g};"
            " give at most 1 in total"
        )
    return [d.depth for d in deposits if d.share > 0]


def _has_track_memory(contributions: list[tuple[Any, Any]]) -> bool:
    """Whether any effect returns heat after a lap of the track, tested with a temperature rise of 1 K."""
    probe = SimpleNamespace(carried=1.0)
    inflow = [(part, p) for part, p in contributions if isinstance(part, Term) and part.target == "road.inflow"]
    return any(part.law(None, probe, p) != 0 for part, p in inflow)


def _has_resolved_spots(contributions: list[Any]) -> bool:
    """Whether any effect resolves contact spots that move with the road."""
    terms = [(part, p) for part, p in contributions if isinstance(part, Term) and part.target == "contact.resolved"]
    return any(part.law(None, None, p) > 0 for part, p in terms)


# --- schedule -------------------------------------------------------------------------------------------
def _read_series(values: Values, key: str, folder: Path) -> TimeSeries:
    """A quantity over time from a number, or from a file of time and value."""
    x, y = _read_time_rows(values, key, folder, 0.0)
    if max(y) <= 0:
        raise BadInput(f"{key}: is zero throughout; give values > 0")
    return TimeSeries(x, y)


def _read_speed_profile(values: Values, folder: Path) -> SpeedProfile:
    """The sliding speed, which may be negative, as a function of time."""
    key = "schedule.speed"
    x, y = _read_time_rows(values, key, folder, -CASE_TABLES["schedule"]["speed"].high)
    if not any(y):
        raise BadInput(f"{key}: is zero throughout; give values > 0, or < 0 for backward sliding")
    return SpeedProfile.from_signed_speeds(x, y)


def _read_time_rows(values: Values, key: str, folder: Path, low: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Times and values: one row for a number, or the rows of a file of time and value."""
    table, last = key.split(".")
    value = values[table][last]
    if isinstance(value, (int, float)):
        return (0.0,), (float(value),)
    quantity = SPEED if key == "schedule.speed" else PRESSURE
    x, y = read_xy_pairs(value, folder, key, low, CASE_TABLES[table][last].high, (TIME, quantity))
    if x[0] < 0:
        raise BadInput(f"{key}: time starts at {x[0]:g} s; count from the start of the repetition, t >= 0")
    return x, y


def _add_lap_events(plan: Schedule, v: Any, remembers: bool) -> Schedule:
    """The schedule with laps as events if the track has memory.  Raises BadInput when its distance is never reached."""
    schedule = replace(plan, lap=v.road.track_length if remembers else None)
    if not math.isfinite(schedule.slide_time):
        raise BadInput(
            f"schedule.speed: the block stops before it has slid schedule.distance = {v.schedule.distance:g} m; "
            "give a speed that stays > 0, or < 0"
        )
    return schedule


# --- mesh --------------------------------------------------------------------------------------------
def _build_mesh(
    v: Any, outline: SceneOutline, schedule: Schedule, remembers: bool, depths: list[float], uniform_along: bool
) -> Mesh:
    """The mesh, fine enough for the smallest of the `depths` (m) at which heat is released, and for the speed.

    `uniform_along`: all cells along the road have the same length.
    """
    level, block, road = refinement_factor(v.numerics.mesh), outline.block, outline.road
    refine = tuple(level * f for f in v.numerics.finer)
    first = _check_first_cell(v, refine[1], depths, _first_block_cell(v.numerics.first_block, block, schedule, depths))
    first_road = _first_road_cell(v.numerics.first_road, road, v.block.length, schedule)
    _check_cell_counts(v, level, refine)
    return block_on_road.build(
        length=v.block.length,
        height=v.block.height,
        depth=_road_depth(v, road, schedule, remembers, first_road),
        cells=tuple(v.numerics.cells),
        first_x=v.numerics.first_x,
        last_x=v.numerics.last_x,
        first_block=first,
        first_road=first_road,
        upstream=v.road.upstream,
        downstream=v.road.downstream,
        refine=refine,
        behind=v.numerics.behind,
        above=v.numerics.above,
        width=v.block.width,
        across=v.numerics.across,
        first_y=v.numerics.first_y,
        refine_y=level,
        both=len(schedule.directions) > 1,
        even=uniform_along and len(schedule.directions) == 1,
        layers=tuple((layer.thickness, layer.cells) for layer in outline.layers),
    )


def first_cells(built: Scene, numerics: Mapping[str, Any]) -> dict[str, Any]:
    """First cells (m) of block and road and cells of every layer at mesh = 1, as keys of a case.

    A case with these keys keeps its mesh when speed, diffusivity or source depth change, on which the default first
    cells depend.  Derivatives by finite differences need such a fixed mesh.
    """
    contributions = [part for acting in built.acting for part in acting.contributions(built)]
    depths = _deposit_depths([part for part in contributions if isinstance(part, Deposit)])
    return {
        "numerics.first_block": _first_block_cell(numerics["first_block"], built.block, built.schedule, depths),
        "numerics.first_road": _first_road_cell(numerics["first_road"], built.road, built.length, built.schedule),
    } | layers.layer_cells(built, numerics)


def _first_block_cell(given: float | None, block: Material, schedule: Schedule, depths: list[float]) -> float:
    """First cell (m) of the block at the interface; default: resolves the source depths and the heated layer."""
    if given is not None:
        return given
    layer = FIRST_CELL_RATIO * math.sqrt(block.diffusivity * schedule.slide_time)
    return float(max(2e-7, min([4e-6, layer] + [d / 2 for d in depths])))


def _first_road_cell(given: float | None, road: Material, length: float, schedule: Schedule) -> float:
    """First cell (m) of the road at the interface; default: resolves the layer heated during one passage."""
    if given is not None:
        return given
    return float(min(3e-6, FIRST_CELL_RATIO * math.sqrt(road.diffusivity * length / max(schedule.speed.value))))


def _check_first_cell(v: Any, refine: float, depths: list[float], first: float) -> float:
    """The first cell (m) of the block at the interface.  Raises BadInput where it is too coarse."""
    if depths and first / max(refine, 1e-9) > 4 * min(depths):
        raise BadInput(
            f"numerics.first_block: first cell of {first / refine:.3g} m is too coarse for a source depth of "
            f"{min(depths):.3g} m; give <= {2 * min(depths):.3g} m or release that fraction at the interface"
        )
    if first > v.block.height / 4:
        raise BadInput(
            f"numerics.first_block: {first:g} m is more than a quarter of block.height; give a smaller first cell"
        )
    return float(first)


def _check_cell_counts(v: Any, level: float, refine: tuple[float, ...]) -> None:
    """Raise BadInput for too many cells, and for end cells that do not fit."""
    along, up, down = (n * f for n, f in zip(v.numerics.cells, refine, strict=True))
    across = 1 if v.numerics.across == 1 else v.numerics.across * level
    cells = along * (up + v.numerics.above * refine[1] + down) * across
    if cells > 2e7:
        raise BadInput(
            f"numerics.mesh: {v.numerics.mesh} gives about {cells:.2g} cells; at most 2e7, give a coarser mesh"
        )
    for key, which in (("last_x", "last"), ("first_x", "first")):
        size = getattr(v.numerics, key)
        if size > v.block.length / 4:
            raise BadInput(
                f"numerics.{key}: {size:g} m is more than a quarter of block.length; give a smaller {which} cell"
            )


def _road_depth(v: Any, road: Material, schedule: Schedule, remembers: bool, first: float) -> float:
    """Depth (m) of road simulated; default: six diffusion lengths of the heating and cooling time."""
    depth = v.road.depth
    if depth is None:
        v0 = min(s for s in schedule.speed.value if s > 0)
        rest = schedule.end_time if remembers or schedule.has_return_pass or not schedule.lifted else schedule.wait
        depth = 6 * math.sqrt(road.diffusivity * ((v.block.length + v.road.downstream) / v0 + rest))
        depth = np.clip(depth, 1e-3, 0.2)
    if first > depth / 4:
        raise BadInput(
            f"numerics.first_road: {first:g} m is more than a quarter of the road's depth; give a smaller first cell"
        )
    return float(depth)


def _check_elastic_block(built: Scene) -> None:
    """Raise BadInput for an elastic block with too many unknowns."""
    mesh, whole = built.mesh, built.elastic_3d and built.resolved
    unknowns = count_unknowns(mesh.x[mesh.first : mesh.last + 1], mesh.height, mesh.y if whole else None)
    if unknowns > MAX_ELASTIC_UNKNOWNS:
        key = "numerics.elastic_3d: this block" if whole else "block.height: a block of these proportions"
        remedy = (
            "leave it out for plane strain in each plane" if whole else "give block.stiffness for independent springs"
        )
        raise BadInput(f"{key} needs {unknowns} displacements, at most {MAX_ELASTIC_UNKNOWNS} are possible; {remedy}")


# --- checks of the whole scene -----------------------------------------------------------------------
def _check_scene(built: Scene) -> None:
    """Raise BadInput where block, effects, spots and pressure of a scene are inconsistent."""
    for acting in built.acting if built.layers else ():
        if acting.effect.uniform:
            raise BadInput(f"effects: '{acting.name}' assumes a block of one material; leave it out, or the layers")
    laws, now, mesh = EffectLaws(built), built.law_context(built.schedule.phases[0], 0.0), built.mesh
    worn = mean_over_columns(laws, "block.worn", mesh, now, 0.0, has_kinks=True).max()
    key, most = ("block.height", built.height)
    if built.layers:
        key, most = f"layers.{built.layers[0].name}.thickness", built.layers[0].thickness
    if worn >= most:
        raise BadInput(
            f"{key}: {most:g} m is not more than the {worn:g} m worn off its face at the start; give that profile in m"
        )
    if built.stiffness is None and has_pressure_shift(laws):
        _check_elastic_block(built)
    for target in ("contact.flat_face", "contact.shear_traction") if built.stiffness is not None else ():
        for _, _, name in laws.terms.get(target, ()):
            raise BadInput(f"block.stiffness: '{name}' needs an elastic block, not springs; leave out one of the two")
    laws("contact.cover", 0.0, None, now)  # raises BadInput now, and not during the run, where spots cannot be placed
    mean = mean_over_columns(laws, "contact.pressure", mesh, now) @ mesh.column_area / built.length
    if not mean > 0:
        raise BadInput(
            f"contact.pressure: its profile is {mean:g} on average under the block; give a profile > 0 on average"
        )
