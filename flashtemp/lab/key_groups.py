"""Groups in which the case page lists the keys of a case: the usual ones are open, the others folded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from flashtemp.model.schema import CASE_TABLES, COMMAND_TABLES, NAMED_TABLES, declared_params
from flashtemp.physics.effect import Effect, Param, catalogue


@dataclass(frozen=True)
class KeyGroup:
    """A group of keys under a `title`: tables, or single keys "table.key"; `is_usual` groups are open at first."""

    title: str
    about: str
    keys: tuple[str, ...]
    is_usual: bool = True


KEY_GROUPS: Final = (
    KeyGroup("Geometry", "size of the block", ("block.length", "block.width", "block.height")),
    KeyGroup("Materials", "rubber and road", ("block.material", "road.material")),
    KeyGroup(
        "Contact and friction", "load, macroasperity spots, friction coefficient",
        ("contact.pressure", "contact.spot_fraction", "contact.spot_diameter", "friction.mu", "contact", "friction"),
    ),
    KeyGroup("Schedule", "speed, distance, repetitions and waits", ("schedule",)),
    KeyGroup("Ambient", "air, and cooling by the air", ("ambient",)),
    KeyGroup("Elasticity of the block", "modulus, Poisson's ratio, springs", ("block",), False),
    KeyGroup("Road", "track, and the part of the road that is simulated", ("road",), False),
    KeyGroup("Numerics", "mesh, tolerances, solver", ("numerics",), False),
    KeyGroup("Output", "what a run saves and draws, and when it stops", ("output", "limits"), False),
)  # fmt: skip  # a key belongs to the first group that lists it, or else to the group of its table


@dataclass(frozen=True)
class CaseKey:
    """A key of a case with its declaration."""

    table: str
    name: str
    param: Param

    @property
    def dotted(self) -> str:
        """The key as "table.name"."""
        return f"{self.table}.{self.name}"

    def contains_words(self, words: str) -> bool:
        """Whether every word of a search occurs in the key or in its description.

        >>> CaseKey("block", "length", Param(0.025, "m", "length along the slide")).contains_words("Slide length")
        True
        """
        text = f"{self.dotted} {self.param.about}".lower()
        return all(word in text for word in words.lower().split())


def list_group_keys() -> dict[KeyGroup, list[CaseKey]]:
    """The keys of the tables that every case has, by group."""
    out: dict[KeyGroup, list[CaseKey]] = {group: [] for group in KEY_GROUPS}
    for table in CASE_TABLES:
        for name, param in declared_params(table).items():
            listed = next((g for g in KEY_GROUPS if f"{table}.{name}" in g.keys), None)
            group = listed or next((g for g in KEY_GROUPS if table in g.keys), KEY_GROUPS[-1])
            out[group].append(CaseKey(table, name, param))
    return {group: sorted(keys, key=partial(_rank_key, group)) for group, keys in out.items()}


def _rank_key(group: KeyGroup, key: CaseKey) -> int:
    """Keys that a group names come first, in its order."""
    return group.keys.index(key.dotted) if key.dotted in group.keys else len(group.keys)


def list_extra_tables(raw: Mapping[str, Any]) -> list[str]:
    """Tables of a text that only some cases have: materials, layers and those of single commands.

    >>> list_extra_tables({"block": {}, "materials": {"own": {}}, "tread": {}})
    ['materials.own', 'tread']
    """
    named = [
        f"{kind}.{name}" for kind in NAMED_TABLES if isinstance(raw.get(kind), dict) for name in raw[kind]
    ]  # fmt: skip
    return [*named, *(table for table in COMMAND_TABLES if isinstance(raw.get(table), dict))]


def table_keys(table: str, known: Mapping[str, type[Effect]] | None = None) -> list[CaseKey]:
    """The keys of one table; effects are those of `known`, or of the catalogue."""
    return [CaseKey(table, name, param) for name, param in declared_params(table, known).items()]


def stated_value(raw: Mapping[str, Any], key: CaseKey) -> Any:
    """The value of a key in the tables of a text, None where it is not given."""
    at: Any = raw
    for step in (*key.table.split(".", 1), key.name):
        at = at.get(step) if isinstance(at, Mapping) else None
    return at


def stated_tables(raw: Mapping[str, Any]) -> Iterator[str]:
    """The tables of a text that declare keys: those of every case, extra tables, and those of effects."""
    effects = [name for name, effect in catalogue().items() if not effect.base and isinstance(raw.get(name), dict)]
    yield from (*CASE_TABLES, *list_extra_tables(raw), *effects)
