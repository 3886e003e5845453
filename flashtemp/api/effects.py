"""The catalogue of effects, for people and programs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from flashtemp.physics.effect import Effect, catalogue, find
from flashtemp.showing import Sheet, Shown


@dataclass(frozen=True, repr=False)
class Listing(Shown):
    """Effects with their cause in words, parameters, units and bounds; `full` tells source and signs too."""

    entries: tuple[dict[str, Any], ...]
    full: bool = False

    def __str__(self) -> str:
        lines = []
        for e in self.entries:
            lines.append(f"{e['name']}{' (always acts)' if e['always'] else ''}: {e['cause']}")
            lines += [f"    {_line(p)}" for p in e["parameters"]]
            if self.full:
                lines.append(f"    source: {e['source']}\n    tells: {'; '.join(e['tells'])}")
        return "\n".join(lines)

    def sheet(self) -> Sheet:
        head = ("key", "default", "unit", "", "from", "to", "off")
        parts = []
        for e in self.entries:
            rows = [tuple(p[k] for k in ("key", "default", "unit", "about", "low", "high", "off"))
                    for p in e["parameters"]]  # fmt: skip
            told = [f"source: {e['source']}", f"tells: {'; '.join(e['tells'])}"]
            parts.append(Sheet(f"{e['name']}: {e['cause']}", rows, head, told))
        return parts[0] if self.full else Sheet(f"Catalogue of {len(parts)} effects", parts=parts)


def effects(name: str | None = None) -> Listing:
    """The catalogue: every effect with its cause in words, parameters, units and source, or one of them.

    Raises BadInput for an unknown name.
    """
    chosen = {name: find(name)} if name else catalogue()
    return Listing(tuple(describe(n, e) for n, e in chosen.items()), bool(name))


def describe(name: str, effect: type[Effect]) -> dict[str, Any]:
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


def _line(p: dict[str, Any]) -> str:
    """One parameter in words."""
    limits = f" [{p['low']:g}, {p['high']:g}]" if p["low"] > -math.inf or p["high"] < math.inf else ""
    off = "" if p["off"] is None else f", off = {p['off']:g}"
    unit = "" if p["unit"] == "1" else f" {p['unit']}"
    default = "not given" if p["default"] is None else p["default"]
    unit = f" ({p['unit']})" if p["default"] is None and unit else unit
    return f"{p['key']} = {default}{unit}: {p['about']}{limits}{off}"
