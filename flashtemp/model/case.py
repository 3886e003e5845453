"""A validated case: values with all defaults, read from case.toml, and the scene that they describe."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import BadInput, RenamedAttribute
from flashtemp.model import build, case_file, file_kinds, layers, numerics, schema
from flashtemp.model.case_file import CaseReader, KeyLocations
from flashtemp.model.numerics import SolverSettings
from flashtemp.model.scene import Scene
from flashtemp.model.trust import find_refusal
from flashtemp.physics import user_effects
from flashtemp.physics.effect import Effect, Param, catalogue
from flashtemp.physics.user_effects import UserEffect, find_installed_effects

# overrides for callers that need only block and schedule
NO_EFFECTS: dict[str, Any] = {"effects": [], "candidates": [], "free": []}


@dataclass(frozen=True, repr=False)
class Case(DisplayMixin):
    """A validated case: `values` {table: {key: value}} with all defaults, active `effects`, and its origin.

    Relative file names refer to `folder`.  `own` are the effects defined by files of the case; `trust` tells whether
    the user allows any such file to run.  `priors` are the standard deviations stated in the case, by key.
    """

    title: str
    values: dict[str, dict[str, Any]]
    effects: tuple[str, ...]
    folder: Path
    name: str = "case"
    candidates: tuple[str, ...] | None = None
    free: tuple[str, ...] = ("friction.mu",)
    own: tuple[UserEffect, ...] = ()
    trust: bool = False
    priors: dict[str, float] = field(default_factory=dict)

    @cached_property
    def known_effects(self) -> Mapping[str, type[Effect]]:
        """All effects that this case may use, by name: catalogue, installed packages and its own files."""
        return collect_effects(self.own)

    @cached_property
    def scene(self) -> Scene:
        """Mesh, materials, schedule and active effects.  Raises BadInput for inconsistent values."""
        acting = {n: effect for n, effect in self.known_effects.items() if effect.base or n in self.effects}
        return build.build_scene(self.values, acting, self.folder)

    @property
    def settings(self) -> SolverSettings:
        """Numerical settings.  Raises BadInput when the CVODE binding is not installed."""
        return numerics.read_settings(self.values)

    def __getstate__(self) -> dict[str, Any]:
        """Fields for another process, which builds the scene again."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __getitem__(self, dotted: str) -> Any:
        """The value of "table.key"."""
        table, key = dotted.rsplit(".", 1)
        return self.values[table][key]

    def declared_params(self, table: str) -> dict[str, Param]:
        """All keys of a table with their declarations."""
        return schema.declared_params(table, self.known_effects)

    def with_values(self, changed: Mapping[str, Any]) -> Case:
        """A validated copy of the case with changed values {"table.key": value}.  Raises BadInput."""
        given = case_file.flatten_tables(changed)
        return assemble_case(
            self._to_tables(), given, KeyLocations(self.name), self.folder, self.name, self.trust, self.own
        )

    def named_files(self) -> dict[str, str]:
        """File names in the case, by dotted key."""
        return {
            f"{t}.{k}": v
            for t, table in self.values.items()
            for k, v in table.items()
            if isinstance(v, str) and "text" in self.declared_params(t).get(k, schema.UNDECLARED_PARAM).kinds
        }

    def copy_files(self, folder: Path) -> dict[str, str]:
        """Copy the files that the case names into inputs/ of a folder; returns their new names by key.

        Effect files keep their names, because those name the effects, and are written as they were read.
        """
        renamed: dict[str, str] = {}
        for key, name in self.named_files().items():
            renamed[key] = f"inputs/{key}{Path(name).suffix}"
            (folder / "inputs").mkdir(exist_ok=True)
            shutil.copyfile(self.folder / name, folder / renamed[key])
        for own in self._listed_effects():
            renamed[own.name] = f"inputs/{own.name}.py"
            (folder / "inputs").mkdir(exist_ok=True)
            (folder / renamed[own.name]).write_text(own.source, encoding="utf-8")
        return renamed

    def own_effects(self) -> dict[str, dict[str, str]]:
        """Path within a result folder and SHA-256 digest of each effect file of the case."""
        return {o.name: {"file": f"inputs/{o.name}.py", "sha256": o.sha256} for o in self._listed_effects()}

    def _listed_effects(self) -> list[UserEffect]:
        """User-defined effects listed in `effects` or `candidates`."""
        return [o for o in self.own if o.name in (*self.effects, *(self.candidates or ()))]

    def toml(self, rename: Mapping[str, str] | None = None) -> str:
        """The complete case as TOML that reproduces the run; `rename` maps keys to new file names."""
        import tomli_w

        return tomli_w.dumps(self._to_tables(rename))

    def _to_tables(self, rename: Mapping[str, str] | None = None) -> dict[str, Any]:
        """The complete case as TOML tables, with files under their new names."""
        paths = {o.name: (rename or {}).get(o.name, o.path) for o in self.own}
        out: dict[str, Any] = {
            "title": self.title, "effects": [paths.get(n, n) for n in self.effects], "free": list(self.free),
        }  # fmt: skip
        if self.candidates is not None:
            out["candidates"] = [paths.get(n, n) for n in self.candidates]
        for table, values in self.values.items():
            kept = {k: (rename or {}).get(f"{table}.{k}", v) for k, v in values.items() if v is not None}
            if table == "block" and layers.layer_names(self.values):
                kept = {k: v for k, v in kept.items() if k not in layers.LAYER_DERIVED_KEYS}
            kept |= {
                k: {"value": v, "sd": self.priors[n]} for k, v in kept.items() if (n := f"{table}.{k}") in self.priors
            }
            if kind := schema.named_table_kind(table):
                out.setdefault(kind, {})[table.split(".", 1)[1]] = kept
            elif kept:
                out[table] = kept
        return out

    def __str__(self) -> str:
        return f"Case '{self.title}' ({self.name})\n  effects: {', '.join(self.effects) or 'none added'}\n{self.scene}"

    def to_table(self) -> DisplayTable:
        """Effects and number of cells, with every table of the case as a part that unfolds."""
        rows = [("effects", ", ".join(self.effects) or "none added"), ("cells", self.scene.mesh.n_cells)]
        parts = []
        for table, values in self.values.items():
            units = {k: p.unit for k, p in self.declared_params(table).items()}
            parts.append(DisplayTable(f"[{table}]", [(k, v, units.get(k, "")) for k, v in values.items()]))
        return DisplayTable(f"Case '{self.title}' ({self.name})", rows, parts=parts)

    known = RenamedAttribute("known_effects")
    declared = RenamedAttribute("declared_params")
    files = RenamedAttribute("named_files")


def collect_effects(own: Iterable[UserEffect] = ()) -> dict[str, type[Effect]]:
    """Effects by name: the catalogue with base effects first, then installed packages, then user-defined effects."""
    return dict(catalogue()) | find_installed_effects() | {o.name: o.effect for o in own}


def load_case(
    path: str | Path,
    overrides: Mapping[str, Any] | Iterable[str] | None = None,
    by: str = "command line",
    trust: bool = False,
) -> Case:
    """Read a case folder or .toml file, with overrides {"table.key": value} or ["table.key=value"].

    `trust` runs effect files of the case even if another user may have written them.  Raises BadInput with all errors
    at once, one line each; `by` is the origin of the overrides in these messages.
    """
    path = Path(path)
    file = path / "case.toml" if path.is_dir() else path
    if not file.is_file():
        raise BadInput(case_file.describe_missing_file(path, file_kinds.CASE_KIND))
    text, raw = case_file.read_toml(file)
    file_kinds.require_kind(file_kinds.CASE_KIND, raw, file, file.name)
    given = case_file.parse_overrides(overrides)
    real = file.resolve()
    name = real.parent.name if real.name == "case.toml" else real.stem
    return assemble_case(raw, given, KeyLocations(str(file), text, set(given), by), file.parent, name, trust)


def assemble_case(
    raw: dict[str, Any],
    overrides: dict[str, Any],
    locations: KeyLocations,
    folder: Path,
    name: str,
    trust: bool = False,
    effects_read: tuple[UserEffect, ...] = (),
) -> Case:
    """Check raw tables and overrides against the declared keys, fill in the defaults and build the scene.

    `effects_read` are effects whose files have been read before.  Raises BadInput with all errors.
    """
    files_before, raw = case_file.list_effect_files(raw), case_file.merge_overrides(raw, overrides, locations.by)
    own = _read_user_effects(raw, locations, folder, trust, effects_read)
    known = collect_effects(own)
    reader = CaseReader(known, locations)
    effects = reader.read_effect_names(raw, "effects", [n for n, e in known.items() if not e.base]) or ()
    candidates = reader.read_effect_names(raw, "candidates", known)
    # where an override sets `effects`, tables of other effects in the file are ignored instead of refused
    overridden = {key.split(".")[0] for key in overrides if "." in key}
    unused = {*known, *(Path(f).stem for f in files_before)} - overridden if "effects" in overrides else set()
    values = reader.read_values(raw, effects, unused)
    free, title = reader.read_free_keys(raw, values), reader.read_title(raw, name)
    if reader.faults:
        raise BadInput(*reader.faults)
    case = Case(title, values, effects, folder, name, candidates, free, own, trust, reader.priors)
    try:
        _ = case.scene, case.settings
    except BadInput as fault:
        raise BadInput(*(locations.add_location(line) for line in fault.lines)) from fault
    return case


def _read_user_effects(
    raw: dict[str, Any], locations: KeyLocations, folder: Path, trust: bool, effects_read: tuple[UserEffect, ...]
) -> tuple[UserEffect, ...]:
    """The user-defined effects of a case; files in `effects_read` are not read again.  Raises BadInput."""
    found, faults = {o.path: o for o in effects_read}, []
    for path in case_file.list_effect_files(raw):
        if path in found:
            continue
        key = "effects" if path in (case_file.split_names(raw.get("effects", [])) or ()) else "candidates"
        file, name = folder / path, Path(path).stem
        if name in (*schema.CASE_TABLES, *schema.COMMAND_TABLES, *case_file.TOP_LEVEL_KEYS, *schema.NAMED_TABLES):
            faults.append(f"{locations(key)}: {path!r}: '{name}' is a key of every case; give the file another name")
        elif twin := next((o.path for o in found.values() if o.name == name), None):
            faults.append(f"{locations(key)}: {path!r} and {twin!r} are both named '{name}'; give one another name")
        elif not file.is_file():
            faults.append(f"{locations(key)}: {path!r}: no such file in {folder}; give a Python file with one effect")
        elif not trust and (why := find_refusal(Path(locations.file), folder, file)):
            faults.append(f"{locations(key)}: {why}")
        else:
            found[path] = user_effects.read_user_effect(path, folder)
    if faults:
        raise BadInput(*faults)
    return tuple(found.values())
