"""case.toml -> Case: every key declared, every fault named with file, line, value and remedy."""

from __future__ import annotations

import math
import shutil
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, nearest
from flashtemp.meshes import block_on_road
from flashtemp.model import schema
from flashtemp.model.laws import Laws, laws_mean
from flashtemp.model.numerics import Settings, choose
from flashtemp.model.scene import Acting, Scene
from flashtemp.model.schedule import Schedule, Series, constant
from flashtemp.physics import contributions
from flashtemp.physics.effect import Deposit, Effect, Term, catalogue
from flashtemp.physics.interpolation import pairs
from flashtemp.physics.material import LIBRARY, Material
from flashtemp.physics.quantities import KELVIN


@dataclass(frozen=True)
class Case:
    """A validated case: `values` {table: {key: value}} with every default, and where it came from.

    `folder` is where relative file names are looked up.
    """

    title: str
    values: dict[str, dict[str, Any]]
    effects: tuple[str, ...]
    folder: Path
    name: str = "case"
    candidates: tuple[str, ...] | None = None
    free: tuple[str, ...] = ("friction.mu",)

    @property
    def known(self) -> Mapping[str, type[Effect]]:
        """Effects by name that this case may use, whether it does or not."""
        return catalogue()

    def __getitem__(self, dotted: str) -> Any:
        """Value of "table.key"."""
        table, key = dotted.rsplit(".", 1)
        return self.values[table][key]

    def files(self) -> dict[str, str]:
        """Dotted keys whose value is the name of a file, with that name."""
        return {
            f"{t}.{k}": v
            for t, table in self.values.items()
            for k, v in table.items()
            if isinstance(v, str) and "text" in schema.declared(t).get(k, schema.NOTHING).kinds
        }

    def copy_files(self, folder: Path) -> dict[str, str]:
        """Copy the files that the case names into a folder's inputs/; returns their new names by key."""
        renamed: dict[str, str] = {}
        for key, name in self.files().items():
            renamed[key] = f"inputs/{key}{Path(name).suffix}"
            (folder / "inputs").mkdir(exist_ok=True)
            shutil.copyfile(self.folder / name, folder / renamed[key])
        return renamed

    def toml(self, rename: dict[str, str] | None = None) -> str:
        """The effective case as TOML that gives the same run again."""
        import tomli_w

        out: dict[str, Any] = {"title": self.title, "effects": list(self.effects), "free": list(self.free)}
        if self.candidates is not None:
            out["candidates"] = list(self.candidates)
        for table, values in self.values.items():
            kept = {k: v for k, v in values.items() if v is not None}
            for k in kept:
                kept[k] = (rename or {}).get(f"{table}.{k}", kept[k])
            if table.startswith("materials."):
                out.setdefault("materials", {})[table.split(".", 1)[1]] = kept
            elif kept:
                out[table] = kept
        return tomli_w.dumps(out)

    def __str__(self) -> str:
        return f"Case '{self.title}' ({self.name})\n  effects: {', '.join(self.effects) or 'bare base'}\n{build(self)}"


def load(path, overrides: dict[str, Any] | list[str] | None = None, by: str = "command line") -> Case:
    """Read a case folder or .toml file, with overrides {"table.key": value} or ["table.key=value"].

    Raises BadInput with all faults at once, one line each; `by` says there where overrides come from.
    """
    path = Path(path)
    file = path / "case.toml" if path.is_dir() else path
    if not file.is_file():
        raise BadInput(f"{path}: no such case; give a folder with a case.toml or a .toml file")
    text, raw = schema.read_toml(file)
    given = schema.parse_overrides(overrides)
    real = file.resolve()
    name = real.parent.name if real.name == "case.toml" else real.stem
    return assemble(raw, given, schema.Places(str(file), text, set(given), by), file.parent, name)


def load_with(case: Case, overrides: dict[str, Any]) -> Case:
    """A case with other values of some keys, checked anew.  Raises BadInput."""
    return assemble(tomllib.loads(case.toml()), overrides, schema.Places(case.name), case.folder, case.name)


def assemble(raw: dict, given: dict[str, Any], where: schema.Places, folder: Path, name: str) -> Case:
    """Check raw tables and overrides against the declared keys and fill in the defaults."""
    faults: list[str] = []
    raw = schema.merge(raw, given, where.by)
    effects = schema.names(raw, "effects", [n for n, e in catalogue().items() if not e.base], where, faults) or ()
    candidates = schema.names(raw, "candidates", catalogue(), where, faults)
    tables = schema.tables(raw, effects, where, faults)
    for table in raw:
        if table not in tables and table not in ("title", "effects", "candidates", "free"):
            if table in catalogue() and "effects" in given and not any(g.startswith(f"{table}.") for g in given):
                continue  # effects were chosen on the command line: the file's other tables rest
            if table in catalogue() and not catalogue()[table].base:
                faults.append(f'{where(table)}: table of an effect that is not listed; add "{table}" to effects')
            else:
                faults.append(
                    f"{where(table)}: unknown key{nearest(table, list(tables) + ['title', 'effects', 'free'])}"
                )
    values = {t: schema.check(t, declared, raw.get(t, {}), where, faults) for t, declared in tables.items()}
    free = raw.get("free", ["friction.mu"])
    known = [f"{t}.{k}" for t, d in tables.items() for k, p in d.items() if "number" in p.kinds]
    if not isinstance(free, list):
        faults.append(f'{where("free")}: {free!r}; give a list, for example ["friction.mu"]')
        free = []
    for n, key in enumerate(free):
        if key not in known:
            faults.append(f"{where('free')}: {key!r} is not a parameter of this case{nearest(str(key), known)}")
        elif key in free[:n]:
            faults.append(f"{where('free')}: '{key}' is listed twice; once is enough")
    if not isinstance(raw.get("title", ""), str):
        faults.append(f"{where('title')}: {raw['title']!r}; give text in quotes")
    if faults:
        raise BadInput(*faults)
    case = Case(raw.get("title", name), values, tuple(effects), folder, name, candidates, tuple(free))
    try:
        build(case)
        settings(case)
    except BadInput as fault:
        raise BadInput(*(where.prefix(line) for line in fault.lines)) from fault
    return case


def build(case: Case) -> Scene:
    """The scene of a case: mesh, materials, schedule and acting effects.  Raises BadInput."""
    v = SimpleNamespace(
        **{
            t: SimpleNamespace(**d)
            for t, d in case.values.items()
            if t in schema.TABLES or t in ("contact", "friction", "ambient")
        }
    )
    materials = {side: _material(case, f"{side}.material", getattr(v, side).material) for side in ("block", "road")}
    acting = []
    for name, effect in catalogue().items():
        if effect.base or name in case.effects:
            section = case.values[effect.section if effect.base else name]
            mine = {k: section[k] for k in effect.params()}
            acting.append(Acting(name, effect(), SimpleNamespace(**effect.prepare(mine, case.folder))))
    speed, pressure = _series(case, "schedule.speed"), _series(case, "contact.pressure")
    known = materials | {"speeds": speed.range, "load": max(pressure.value)}
    for a in acting:
        contributions.of_camera(a.name, a.effect, a.p)
    parts = [c for a in acting for c in _probe(a, v, known)]
    total = sum(c.share for c in parts if isinstance(c, Deposit))
    if total > 1 + 1e-12:
        raise BadInput(
            f"friction.volumetric_share: all shares released inside the rubber sum to {total:g}; give at most 1 in all"
        )
    remembers = _remembers(acting, v, known)
    schedule = Schedule(
        speed, pressure, v.schedule.distance, v.schedule.repetitions, v.schedule.wait, v.schedule.lifted,
        lap=v.road.track_length if remembers else None,
    )  # fmt: skip
    if not math.isfinite(schedule.slide_time):
        raise BadInput(
            f"schedule.speed: the block stops before it has slid schedule.distance = {v.schedule.distance:g} m; "
            "give a speed that stays > 0"
        )
    depths = [c.depth for c in parts if isinstance(c, Deposit) and c.share > 0]
    mesh = _mesh(v, materials["road"], schedule, remembers, depths)
    if remembers and v.road.track_length <= mesh.x[-1] - mesh.x[0]:
        raise BadInput(
            f"road.track_length: {v.road.track_length:g} m is shorter than the road around the block "
            f"({mesh.x[-1] - mesh.x[0]:g} m); give a longer track"
        )
    scene = Scene(
        mesh=mesh,
        block=materials["block"],
        road=materials["road"],
        schedule=schedule,
        acting=tuple(acting),
        ambient=v.ambient.temperature + KELVIN,
        length=v.block.length,
        height=v.block.height,
        spot_diameter=v.contact.spot_diameter,
        spot_fraction=v.contact.spot_fraction,
        track_length=v.road.track_length,
        stiffness=v.block.stiffness,
    )
    laws, now = Laws(scene), scene.moment(schedule.phases[0], 0.0)
    worn = laws_mean(laws, "block.worn", mesh, now, 0.0).max()
    if worn >= v.block.height:
        raise BadInput(
            f"block.height: {v.block.height:g} m is not more than the {worn:g} m worn off its face at the start; "
            "give that profile in m"
        )
    laws("contact.cover", 0.0, None, now)  # where spots cannot be placed, say so before anything runs
    mean = laws_mean(laws, "contact.pressure", mesh, now) @ mesh.column_area / v.block.length
    if not mean > 0:
        raise BadInput(
            f"contact.pressure: its profile is {mean:g} on average under the block; give a profile > 0 on average"
        )
    return scene


def _remembers(acting, v, known) -> bool:
    """Whether any effect lets heat on the track come round: tried with one kelvin."""
    probe = SimpleNamespace(carried=1.0)
    laws = ((c, a.p) for a in acting for c in _probe(a, v, known) if isinstance(c, Term))
    return any(c.law(None, probe, p) != 0 for c, p in laws if c.target == "road.inflow")


def settings(case: Case) -> Settings:
    """Numerics of a case; BadInput when its CVODE binding is not installed."""
    n, out = case.values["numerics"], case.values["output"]
    return Settings(choose(n["integrator"]), n["rtol"], n["atol"], n["order"], out["profiles"], out["fields"])


def _probe(acting, v, known):
    """Contributions of one effect on a scene without mesh, to ask what it speaks about."""
    scene = SimpleNamespace(
        length=v.block.length, width=v.block.width, height=v.block.height, spot_diameter=v.contact.spot_diameter,
        spot_fraction=v.contact.spot_fraction,
        ambient=v.ambient.temperature + KELVIN, resolved=v.numerics.across > 1, **known,
    )  # fmt: skip
    return acting.contributions(scene)


def _material(case: Case, key: str, name: str) -> Material:
    own = {t.split(".", 1)[1]: d for t, d in case.values.items() if t.startswith("materials.")}
    if name in own:
        return Material(**{k: own[name][k] for k in ("conductivity", "density", "heat_capacity")})
    if name in LIBRARY:
        return LIBRARY[name]
    known = list(own) + list(LIBRARY)
    raise BadInput(f"{key}: no material '{name}'{nearest(name, known)}; or add [materials.{name}]")


def _series(case: Case, key: str) -> Series:
    value = case[key]
    if isinstance(value, (int, float)):
        return constant(value)
    x, y = pairs(value, case.folder, key, 0.0, schema.TABLES[key.split(".")[0]][key.split(".")[1]].high)
    if x[0] < 0:
        raise BadInput(f"{key}: time starts at {x[0]:g} s; count from the start of the repetition, t >= 0")
    if max(y) <= 0:
        raise BadInput(f"{key}: is zero throughout; give values > 0")
    return Series(x, y)


def _mesh(v, road: Material, schedule: Schedule, remembers: bool, shallow: list[float]):
    level = v.numerics.mesh
    refine = tuple(schema.refinement(level) * f for f in v.numerics.finer)
    first = v.numerics.first_block
    if first is None:
        first = max(2e-7, min([4e-6] + [d / 2 for d in shallow]))
    if shallow and first / max(refine[1], 1e-9) > 4 * min(shallow):
        raise BadInput(
            f"numerics.first_block: first cell of {first / refine[1]:.3g} m is too coarse for a source depth of "
            f"{min(shallow):.3g} m; give <= {2 * min(shallow):.3g} m or count that share as interfacial"
        )
    if first > v.block.height / 4:
        raise BadInput(
            f"numerics.first_block: {first:g} m is more than a quarter of block.height; give a smaller first cell"
        )
    along, up, down = (n * f for n, f in zip(v.numerics.cells, refine, strict=True))
    across = 1 if v.numerics.across == 1 else v.numerics.across * schema.refinement(level)
    cells = along * (up + v.numerics.above * refine[1] + down) * across
    if cells > 2e7:
        raise BadInput(f"numerics.mesh: {level} gives about {cells:.2g} cells; at most 2e7, give a coarser mesh")
    if v.numerics.last_x > v.block.length / 4:
        raise BadInput(
            f"numerics.last_x: {v.numerics.last_x:g} m is more than a quarter of block.length; give a smaller last cell"
        )
    if v.numerics.first_x > v.block.length / 4:
        raise BadInput(
            f"numerics.first_x: {v.numerics.first_x:g} m is more than a quarter of block.length; "
            "give a smaller first cell"
        )
    depth = v.road.depth
    if depth is None:
        v0 = min(s for s in schedule.speed.value if s > 0)
        rest = schedule.end if remembers or not schedule.lifted else schedule.wait
        depth = 6 * math.sqrt(road.diffusivity * ((v.block.length + v.road.downstream) / v0 + rest))
        depth = float(np.clip(depth, 1e-3, 0.2))
    if v.numerics.first_road > depth / 4:
        raise BadInput(
            f"numerics.first_road: {v.numerics.first_road:g} m is more than a quarter of the road's depth; "
            "give a smaller first cell"
        )
    return block_on_road.build(
        length=v.block.length,
        height=v.block.height,
        depth=depth,
        cells=tuple(v.numerics.cells),
        first_x=v.numerics.first_x,
        last_x=v.numerics.last_x,
        first_block=first,
        first_road=v.numerics.first_road,
        upstream=v.road.upstream,
        downstream=v.road.downstream,
        refine=refine,
        behind=v.numerics.behind,
        above=v.numerics.above,
        width=v.block.width,
        across=v.numerics.across,
        first_y=v.numerics.first_y,
        refine_y=schema.refinement(level),
    )
