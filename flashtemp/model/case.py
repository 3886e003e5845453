"""case.toml -> Case: checked values with every default, every fault named with file, line, value and remedy."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.model import build as building
from flashtemp.model import case_file, numerics, schema
from flashtemp.model.case_file import Places, Reader
from flashtemp.model.numerics import Settings
from flashtemp.model.scene import Scene
from flashtemp.physics.effect import Effect, Param, catalogue


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

    @cached_property
    def known(self) -> Mapping[str, type[Effect]]:
        """Effects by name that this case may use, whether it does or not."""
        return catalogue()

    @cached_property
    def scene(self) -> Scene:
        """Mesh, materials, schedule and acting effects.  Raises BadInput for values that do not go together."""
        acting = {n: effect for n, effect in self.known.items() if effect.base or n in self.effects}
        return building.scene(self.values, acting, self.folder)

    @property
    def settings(self) -> Settings:
        """Numerics; BadInput when the CVODE binding is not installed."""
        return numerics.settings(self.values)

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs: the scene is built there anew."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __getitem__(self, dotted: str) -> Any:
        """Value of "table.key"."""
        table, key = dotted.rsplit(".", 1)
        return self.values[table][key]

    def declared(self, table: str) -> dict[str, Param]:
        """All keys that a table may have, with their declarations."""
        return schema.declared(table, self.known)

    def with_values(self, changed: Mapping[str, Any]) -> Case:
        """The case with other values {"table.key": value} of some keys, checked anew.  Raises BadInput."""
        return assemble(self._raw(), dict(changed), Places(self.name), self.folder, self.name)

    def files(self) -> dict[str, str]:
        """Dotted keys whose value is the name of a file, with that name."""
        return {
            f"{t}.{k}": v
            for t, table in self.values.items()
            for k, v in table.items()
            if isinstance(v, str) and "text" in self.declared(t).get(k, schema.NOTHING).kinds
        }

    def copy_files(self, folder: Path) -> dict[str, str]:
        """Copy the files that the case names into a folder's inputs/; returns their new names by key."""
        renamed: dict[str, str] = {}
        for key, name in self.files().items():
            renamed[key] = f"inputs/{key}{Path(name).suffix}"
            (folder / "inputs").mkdir(exist_ok=True)
            shutil.copyfile(self.folder / name, folder / renamed[key])
        return renamed

    def toml(self, rename: Mapping[str, str] | None = None) -> str:
        """The effective case as TOML that gives the same run again."""
        import tomli_w

        return tomli_w.dumps(self._raw(rename))

    def _raw(self, rename: Mapping[str, str] | None = None) -> dict[str, Any]:
        """The effective case as the tables of a file, files under their new names."""
        out: dict[str, Any] = {"title": self.title, "effects": list(self.effects), "free": list(self.free)}
        if self.candidates is not None:
            out["candidates"] = list(self.candidates)
        for table, values in self.values.items():
            kept = {k: (rename or {}).get(f"{table}.{k}", v) for k, v in values.items() if v is not None}
            if table.startswith("materials."):
                out.setdefault("materials", {})[table.split(".", 1)[1]] = kept
            elif kept:
                out[table] = kept
        return out

    def __str__(self) -> str:
        return f"Case '{self.title}' ({self.name})\n  effects: {', '.join(self.effects) or 'bare base'}\n{self.scene}"


def load(
    path: str | Path, overrides: Mapping[str, Any] | Iterable[str] | None = None, by: str = "command line"
) -> Case:
    """Read a case folder or .toml file, with overrides {"table.key": value} or ["table.key=value"].

    Raises BadInput with all faults at once, one line each; `by` says there where overrides come from.
    """
    path = Path(path)
    file = path / "case.toml" if path.is_dir() else path
    if not file.is_file():
        raise BadInput(f"{path}: no such case; give a folder with a case.toml or a .toml file")
    text, raw = case_file.read_toml(file)
    given = case_file.parse_overrides(overrides)
    real = file.resolve()
    name = real.parent.name if real.name == "case.toml" else real.stem
    return assemble(raw, given, Places(str(file), text, set(given), by), file.parent, name)


def assemble(raw: dict[str, Any], given: dict[str, Any], where: Places, folder: Path, name: str) -> Case:
    """Check raw tables and overrides against the declared keys, fill in the defaults and build the scene."""
    known = catalogue()
    reader = Reader(known, where)
    raw = case_file.merge(raw, given, where.by)
    effects = reader.names(raw, "effects", [n for n, e in known.items() if not e.base]) or ()
    candidates = reader.names(raw, "candidates", known)
    # effects chosen on the command line: the file's tables of other effects rest
    asked = {g.split(".")[0] for g in given if "." in g}
    resting = known.keys() - asked if "effects" in given else ()
    values = reader.values(raw, effects, resting)
    free, title = reader.free(raw, values), reader.title(raw, name)
    if reader.faults:
        raise BadInput(*reader.faults)
    case = Case(title, values, effects, folder, name, candidates, free)
    try:
        _ = case.scene, case.settings
    except BadInput as fault:
        raise BadInput(*(where.prefix(line) for line in fault.lines)) from fault
    return case


# names of before, until every caller has changed
def build(case: Case) -> Scene:
    return case.scene


def settings(case: Case) -> Settings:
    return case.settings


def load_with(case: Case, overrides: dict[str, Any]) -> Case:
    return case.with_values(overrides)
