"""The catalogue of effects, and a check of a user-defined effect."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import BadInput
from flashtemp.model.case_file import parse_overrides
from flashtemp.physics.effect import Effect, catalogue, find_effect
from flashtemp.physics.user_effects import find_installed_effects, read_effect

if TYPE_CHECKING:
    from flashtemp.runs.checks.effect_check.findings import Finding


@dataclass(frozen=True, repr=False)
class EffectCatalogue(DisplayMixin):
    """Effects with cause, parameters, units and bounds; `full` adds the source and the signature of each."""

    entries: tuple[dict[str, Any], ...]
    full: bool = False

    def __str__(self) -> str:
        lines = []
        for e in self.entries:
            lines.append(f"{e['name']}{' (always acts)' if e['always'] else ''}: {e['cause']}")
            lines += [f"    {format_parameter(p)}" for p in e["parameters"]]
            if self.full:
                lines.append(f"    source: {e['source']}\n    signature: {'; '.join(e['tells'])}")
        return "\n".join(lines)

    def to_table(self) -> DisplayTable:
        head = ("key", "default", "unit", "", "from", "to", "off")
        parts = []
        for e in self.entries:
            rows = [tuple(p[k] for k in ("key", "default", "unit", "about", "low", "high", "off"))
                    for p in e["parameters"]]  # fmt: skip
            notes = [f"source: {e['source']}", f"signature: {'; '.join(e['tells'])}"]
            parts.append(DisplayTable(f"{e['name']}: {e['cause']}", rows, head, notes))
        return parts[0] if self.full else DisplayTable(f"Catalogue of {len(parts)} effects", parts=parts)


@dataclass(frozen=True, repr=False)
class EffectCheckReport(DisplayMixin):
    """Results of the checks of an effect: `findings`, each with a name, a pass flag and a sentence."""

    name: str
    findings: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """Whether the effect passes every check that the catalogue passes."""
        return all(f.ok for f in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """The findings as plain data."""
        rows = [{"name": f.name, "ok": f.ok, "says": f.says} for f in self.findings]
        return {"effect": self.name, "ok": self.ok, "findings": rows}

    def __str__(self) -> str:
        rows = [f"  {'ok   ' if f.ok else 'FAILS'}  {f.name:13s}  {f.says}" for f in self.findings]
        return "\n".join([self.name, *rows, self._closing_line()])

    def to_table(self) -> DisplayTable:
        rows = [(f.name, "ok" if f.ok else "FAILS", f.says) for f in self.findings]
        return DisplayTable(f"{self.name}: {self._closing_line()}", rows, ("", "", ""))

    def _closing_line(self) -> str:
        failed = sum(not f.ok for f in self.findings)
        text = f"{failed} of {len(self.findings)} checks fail; the remaining checks run once these pass"
        return text if failed else "all checks pass"


def effects(name: str | None = None) -> EffectCatalogue:
    """The catalogue of effects with cause, parameters, units and source, or one effect.

    `name` may be a Python file with an effect, which is executed.  Raises BadInput for an unknown name.
    """
    chosen = dict([_find_effect(name)]) if name else catalogue() | find_installed_effects()
    return EffectCatalogue(tuple(describe_effect(n, e) for n, e in chosen.items()), bool(name))


def check_effect(name: str | Path, overrides: Mapping[str, Any] | Iterable[str] | None = None) -> EffectCheckReport:
    """Run every check of the catalogue on one effect, given by name or as a Python file, which is executed.

    `overrides` {"table.key": value} change the small case in which the effect is checked.  Raises BadInput for an
    unknown effect or file, and for invalid values.
    """
    from flashtemp.runs.checks.effect_check.findings import Finding
    from flashtemp.runs.checks.effect_check.fixtures import EffectUnderTest, SceneCache
    from flashtemp.runs.checks.effect_check.run_checks import run_all_checks

    given, name = parse_overrides(overrides), str(name)
    if _is_file(name) and not Path(name).is_file():
        raise BadInput(f"{name}: no such file; give a Python file with one effect")
    try:
        trial = EffectUnderTest(*_find_effect(name), given)
    except BadInput as fault:
        if not _is_file(name):
            raise
        return EffectCheckReport(Path(name).stem, (Finding("file", False, "; ".join(fault.lines)),))
    return EffectCheckReport(trial.name, tuple(run_all_checks(trial, SceneCache(Path.cwd()))))


def _is_file(name: str) -> bool:
    return name.endswith(".py") or "/" in name


def _find_effect(name: str) -> tuple[str, type[Effect]]:
    """Name and class of an effect from the catalogue, an installed package or a file.  Raises BadInput."""
    if _is_file(name):
        return Path(name).stem, read_effect(Path(name))
    return name, find_installed_effects().get(name) or find_effect(name)


def describe_effect(name: str, effect: type[Effect]) -> dict[str, Any]:
    """One effect as plain data."""
    section = effect.section if effect.base else name
    plain = [
        {
            "key": f"{section}.{k}", "default": p.value, "unit": p.unit, "about": p.about,
            "low": p.low, "high": p.high, "off": p.off,
        }
        for k, p in effect.params().items()
    ]  # fmt: skip
    return {
        "name": name,
        "always": effect.base,
        "cause": effect.cause,
        "source": effect.source,
        "tells": list(effect.tells),
        "parameters": plain,
    }


def format_parameter(p: dict[str, Any]) -> str:
    """One parameter as a line of text: key, default, unit, meaning, bounds and neutral value."""
    limits = f" [{p['low']:g}, {p['high']:g}]" if p["low"] > -math.inf or p["high"] < math.inf else ""
    off = "" if p["off"] is None else f", off = {p['off']:g}"
    unit = "" if p["unit"] == "1" else f" {p['unit']}"
    default = "not given" if p["default"] is None else p["default"]
    unit = f" ({p['unit']})" if p["default"] is None and unit else unit
    return f"{p['key']} = {default}{unit}: {p['about']}{limits}{off}"
