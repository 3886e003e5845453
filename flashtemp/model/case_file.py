"""Read a case file: TOML, line numbers of keys, overrides, and errors for unknown keys and invalid values."""

from __future__ import annotations

import re
import stat
import tomllib
import unicodedata
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Any

from flashtemp.errors import BadInput, shorten_text, suggest_name
from flashtemp.model import layers, priors
from flashtemp.model.schema import (
    CASE_TABLES,
    COMMAND_TABLES,
    NAMED_TABLES,
    REQUIRED_PARAMS,
    declared_params,
    find_free_key_fault,
    find_value_fault,
    named_table_kind,
)
from flashtemp.physics import units
from flashtemp.physics.effect import Effect, Param

Table = dict[str, Any]
EffectsByName = Mapping[str, type[Effect]]
TOML_ERRORS = (ValueError, RecursionError)  # raised by `parse_toml`, also for numbers and nesting beyond its limits
OVERLONG_KEY = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){64}""")
LARGEST_INTEGER = 2**63 - 1
MAX_TOML_BYTES = 2 * 2**20  # far above any real file: the largest case of the gallery has 4 kB
TOP_LEVEL_KEYS = ("title", "effects", "candidates", "free")  # keys before the first table


def _suggest_key(key: str, tables: Mapping[str, Mapping[str, Param]]) -> str:
    """The end of an error for an unknown key without a table; the table may have been left out."""
    top, inside = [*tables, "title", "effects", "free"], dict[str, list[str]]()
    for table, keys in tables.items():
        for name in keys:
            inside.setdefault(name, []).append(f"'{table}.{name}'")
    match = [key] if key in inside else get_close_matches(key, [*top, *inside], 1, 0.5)
    if match and match[0] not in top:
        return f"; did you mean {' or '.join(inside[match[0]][:3])}?"
    return suggest_name(key, top)


@dataclass(frozen=True)
class KeyLocations:
    """Locations of keys for error messages: file and line, or the origin `by` of an override."""

    file: str
    text: str = ""
    overridden: set[str] = field(default_factory=set)
    by: str = "command line"

    def __call__(self, dotted: str, nth: int = 1) -> str:
        if any(dotted == o or o.startswith(dotted + ".") for o in self.overridden):
            return f"{dotted} ({self.by})"
        line = self.find_line(dotted, nth)
        return f"{self.file}:{line}: {dotted}" if line else f"{self.file}: {dotted}"

    def find_line(self, dotted: str, nth: int = 1) -> int | None:
        """1-based line of a dotted key (for a table, of its `nth` head); None where the text does not contain it."""
        for number, is_table in _index_lines(self.text).get(dotted, ()):
            nth -= is_table
            if not is_table or nth == 0:
                return number
        return None

    def add_location(self, message: str) -> str:
        """An error message that begins with a key, with the location of this key added."""
        key = message.split(":", 1)[0]
        return self(key) + message[len(key) :] if re.fullmatch(r"[\w.]+", key) else f"{self.file}: {message}"


@lru_cache(maxsize=8)
def _index_lines(text: str) -> dict[str, list[tuple[int, bool]]]:
    """1-based lines of every dotted key of a TOML text, each with a flag for the head of a table.

    >>> _index_lines("title = 'a'\\n[block]\\nheight = 1")
    {'title': [(1, False)], 'block': [(2, True)], 'block.height': [(3, False)]}
    """
    lines: dict[str, list[tuple[int, bool]]] = {}
    prefix = ""
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.split("#", 1)[0].strip()
        if header := re.fullmatch(r"\[+\s*([^\]]+?)\s*\]+", line):
            prefix = header[1] + "."
            lines.setdefault(header[1], []).append((number, True))
        elif key := re.match(r"([\w\.\"'-]+)\s*=", line):
            lines.setdefault(prefix + key[1].strip("\"'"), []).append((number, False))
    return lines


def parse_toml(text: str) -> Table:
    """Tables of a TOML text, with integers of at most 64 bits as in TOML 1.0.  Raises ValueError, RecursionError.

    >>> parse_toml("cells = 0x10")
    {'cells': 16}
    >>> parse_toml("cells = 0x10000000000000000")
    Traceback (most recent call last):
        ...
    ValueError: an integer has more than 64 bits
    """
    if OVERLONG_KEY.search(text):  # tomllib takes time quadratic in the number of parts
        raise ValueError("a key has more than 64 parts")
    tables = tomllib.loads(text)
    pending: list[Any] = [tables]
    while pending:
        value = pending.pop()
        if isinstance(value, int) and not -LARGEST_INTEGER - 1 <= value <= LARGEST_INTEGER:
            raise ValueError("an integer has more than 64 bits")
        pending.extend(value.values() if isinstance(value, dict) else value if isinstance(value, list) else ())
    return tables


def read_toml(file: Path) -> tuple[str, Table]:
    """Text and tables of an existing TOML file.  Raises BadInput."""
    try:
        state = file.stat()
        if not stat.S_ISREG(state.st_mode):  # reading a pipe would block, a device may never end
            raise BadInput(f"{file}: not a regular file; give a .toml file")
        if state.st_size > MAX_TOML_BYTES:
            raise BadInput(f"{file}: larger than {MAX_TOML_BYTES // 2**20} MiB; give a shorter .toml file")
        text = file.read_text(encoding="utf-8")
        return text, parse_toml(text)
    except OSError as fault:
        raise BadInput(f"{file}: {fault.strerror}; give a file that can be read") from fault
    except UnicodeDecodeError as fault:
        raise BadInput(f"{file}: not UTF-8 text, so not TOML; give a .toml file") from fault
    except TOML_ERRORS as fault:
        raise BadInput(f"{file}: not valid TOML: {_describe_parse_error(fault)}; repair that line") from fault


def describe_missing_file(path: Path, kind: str) -> str:
    """The error for a missing case or campaign, with what the folder contains instead."""
    wanted = f"{kind}.toml"
    there = "in it" if path.is_dir() else ""
    other = next((n for n in ("case.toml", "campaign.toml") if there and n != wanted and (path / n).is_file()), "")
    what = f"no {wanted} in it" + (f", but {other}" if other else "") if there else f"no such {kind}"
    return f"{path}: {what}; give a folder with a {wanted} or a .toml file"


def _describe_parse_error(fault: Exception) -> str:
    """The message of a TOML error, without its advice for programmers."""
    return (
        "brackets are nested too deep"
        if isinstance(fault, RecursionError)
        else " ".join(str(fault).split(";")[0].split())
    )


def parse_overrides(overrides: Mapping[str, Any] | Iterable[str] | None) -> Table:
    """Overrides ["a.b=1"] or {"a.b": 1} as {"a.b": 1}; values are TOML, bare words text.  Raises BadInput."""
    if not overrides:
        return {}
    if isinstance(overrides, Mapping):
        return flatten_tables(overrides)
    out = {}
    for item in overrides:
        key, eq, text = item.partition("=")
        if not eq or not key.strip():
            raise BadInput(
                f"{item} (command line): not an override; write table.key=value, for example friction.mu=0.8"
            )
        try:
            out[key.strip()] = parse_toml(f"v = {text}")["v"]
        except tomllib.TOMLDecodeError:
            out[key.strip()] = text.strip()
        except TOML_ERRORS as fault:
            raise BadInput(
                f"{key.strip()} (command line): {_describe_parse_error(fault)}; give a shorter value"
            ) from fault
    return flatten_tables(out)


def flatten_tables(overrides: Mapping[str, Any]) -> Table:
    """Overrides with tables split into dotted keys, so that the other keys of these tables are kept.

    >>> flatten_tables({"contact": {"pressure": 1e5}, "materials": {"a": {"density": {"value": 1e3, "sd": 9.0}}}})
    {'contact.pressure': 100000.0, 'materials.a.density': {'value': 1000.0, 'sd': 9.0}}
    """
    out: Table = {}
    for key, value in overrides.items():
        is_table = "." not in key or (named_table_kind(key) and key.count(".") == 1)
        if is_table and isinstance(value, dict) and value:
            out |= flatten_tables({f"{key}.{name}": inside for name, inside in value.items()})
        else:
            out[key] = value
    return out


def merge_overrides(raw: Table, given: Table, by: str) -> Table:
    """A copy of the tables of a file with the overrides applied; `by` is their origin.  Raises BadInput."""
    out = {k: dict(v) if isinstance(v, dict) else v for k, v in raw.items()}
    for kind in NAMED_TABLES:
        if isinstance(out.get(kind), dict):
            out[kind] = {k: dict(v) if isinstance(v, dict) else v for k, v in out[kind].items()}
    for dotted, value in given.items():
        *path, last = dotted.split(".")
        at = out
        for step in path:
            at = at.setdefault(step, {})
            if not isinstance(at, dict):
                raise BadInput(f"{dotted} ({by}): '{step}' is not a table")
        before = at.get(last)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if number and isinstance(before, dict) and priors.has_stated_sd(before):
            at[last] = before | {"value": value}  # the new value keeps the stated sd
        else:
            at[last] = value
    return out


def list_effect_files(raw: Table) -> list[str]:
    """Effect files that a case lists in `effects` and `candidates`, each once.

    >>> list_effect_files({"effects": ["wear", "./fan.py"], "candidates": ["./fan.py"]})
    ['./fan.py']
    """
    names = [v for key in ("effects", "candidates") for v in split_names(raw.get(key, [])) or ()]
    return [v for v in dict.fromkeys(names) if v.endswith(".py")]


@dataclass(frozen=True)
class CaseReader:
    """Reads and checks the tables of a case; collects errors in `faults` and stated standard deviations in `priors`.

    `known`: effects by name; `where`: locations of keys for messages.
    """

    known: EffectsByName
    where: KeyLocations
    faults: list[str] = field(default_factory=list)
    priors: dict[str, float] = field(default_factory=dict)

    def add_fault(self, key: str, text: str) -> None:
        """Add an error of a key, with its location."""
        self.faults.append(f"{self.where(key)}: {text}")

    def read_effect_names(self, raw: Table, key: str, allowed: Collection[str]) -> tuple[str, ...] | None:
        """The effect names under `key`, each checked against `allowed`; None when the key is not given."""
        if key not in raw:
            return None
        value = split_names(raw[key])
        if value is None:
            self.add_fault(key, f"{raw[key]!r}; give a list of names that `flashtemp effects` prints")
            return ()
        value = [Path(v).stem if v.endswith(".py") else v for v in value]
        for name in value:
            if name not in allowed:
                always = name in self.known
                why = "always acts; leave it out" if always else f"is not in the catalogue{suggest_name(name, allowed)}"
                self.add_fault(key, f"effect '{name}' {why}")
        for name in {v for v in value if value.count(v) > 1}:
            self.add_fault(key, f"effect '{name}' is listed twice; once is enough")
        return tuple(v for v in value if v in allowed)

    def read_values(self, raw: Table, effects: Collection[str], unused_effects: Collection[str]) -> dict[str, Table]:
        """All tables that this case may have, with defaults; tables of `unused_effects` are ignored."""
        raw, tables = self._declared_tables(raw, effects)
        for table in raw:
            if table in tables or table in TOP_LEVEL_KEYS or table in unused_effects:
                continue
            if table in self.known and not self.known[table].base:
                self.add_fault(table, f'table of an effect that is not listed; add "{table}" to effects')
            else:
                self.add_fault(table, f"unknown key{_suggest_key(table, tables)}")
        values = {t: self._read_table(t, keys, raw.get(t, {})) for t, keys in tables.items()}
        for key, error in layers.derive_block_keys(values, raw.get("block", {})):
            self.add_fault(key, error)
        return values

    def _declared_tables(self, raw: Table, effects: Collection[str]) -> tuple[Table, dict[str, dict[str, Param]]]:
        """Raw tables with every material and layer as a table, and the declared keys of all possible tables."""
        flat, names = {k: v for k, v in raw.items() if k not in NAMED_TABLES}, []
        for kind in NAMED_TABLES:
            tables = raw.get(kind, {})
            if not isinstance(tables, dict):
                self.add_fault(kind, f"{shorten_text(repr(tables))}; write [{kind}.NAME] and its keys below it")
                tables = {}
            names += [f"{kind}.{n}" for n in tables]
            flat |= {f"{kind}.{n}": v for n, v in tables.items()}
        of_commands = [t for t in COMMAND_TABLES if t in raw]
        return flat, {t: declared_params(t, self.known) for t in [*CASE_TABLES, *of_commands, *names, *effects]}

    def _read_table(self, table: str, keys: dict[str, Param], given: Any) -> Table:
        """The values of one table with its defaults."""
        if not isinstance(given, dict):
            self.add_fault(table, f"{given!r} is not a table; write [{table}] and its keys below it")
            return {}
        for key in given:
            if key not in keys:
                self.add_fault(f"{table}.{key}", f"unknown key{suggest_name(key, keys, table)}")
        out = {}
        for key, param in keys.items():
            if key not in given:
                out[key] = param.value
                if param in REQUIRED_PARAMS:
                    self.add_fault(table, f"{key} is missing; give it{f' in {param.unit}' if param.unit else ''}")
                continue
            value = self._convert_unit(table, key, param, self._take_prior(table, key, param, given[key]))
            if value == "inf" and param.high == float("inf") and "number" in param.kinds:
                value = float("inf")
            if error := find_value_fault(param, value):
                self.add_fault(f"{table}.{key}", f"{shorten_text(repr(value))}; {error}")
            out[key] = value
        return out

    def _take_prior(self, table: str, key: str, param: Param, given: Any) -> Any:
        """The value of { value, sd }, whose sd is stored in `priors`; any other value unchanged."""
        if not priors.has_stated_sd(given):
            return given
        sd = self._convert_unit(table, key, param, given["sd"], difference=True)
        given = given | {"sd": sd, "value": self._convert_unit(table, key, param, given.get("value"))}
        if error := priors.find_sd_fault(param, table, given):
            self.add_fault(f"{table}.{key}", error)
            return param.value
        self.priors[f"{table}.{key}"] = float(given["sd"])
        return given["value"]

    def _convert_unit(self, table: str, key: str, param: Param, value: Any, difference: bool = False) -> Any:
        """The number of a text with a unit, also in a list; other values unchanged.

        `difference`: the text is a difference of temperatures, so its zero is not shifted.
        """
        if isinstance(value, list) and "amounts" in param.kinds:
            return [self._convert_unit(table, key, param, v) for v in value]
        if not units.looks_like_quantity(value) or not {"number", "amount", "amounts"} & set(param.kinds):
            return value
        try:
            return units.to_unit(value, param.unit, difference)
        except BadInput as fault:
            self.add_fault(f"{table}.{key}", str(fault))
            return param.value

    def read_free_keys(self, raw: Table, values: Mapping[str, Table]) -> tuple[str, ...]:
        """The keys to fit; friction.mu when not given."""
        free = raw.get("free", ["friction.mu"])
        if not isinstance(free, list):
            self.add_fault("free", f'{free!r}; give a list, for example ["friction.mu"]')
            return ()
        for n, key in enumerate(free):
            if error := find_free_key_fault(key, values, self.known):
                self.add_fault("free", error)
            elif key in free[:n]:
                self.add_fault("free", f"'{key}' is listed twice; once is enough")
        return tuple(free)

    def read_title(self, raw: Table, default: str) -> str:
        """The title, or `default` when not given."""
        title = raw.get("title", default)
        if error := find_title_fault(title):
            self.add_fault("title", error)
        return str(title)


def find_title_fault(title: Any) -> str | None:
    r"""The error of a title or name, or None; control characters are not allowed in files and pictures.

    >>> find_title_fault("run-in, 0.1 m/s"), find_title_fault("a\x00b")
    (None, "'a\\x00b' contains a control character; leave it out")
    """
    if not isinstance(title, str):
        return f"{shorten_text(repr(title))}; give text in quotes"
    odd = any(not c.isprintable() and c not in "\n\t" and unicodedata.category(c) in ("Cc", "Cs") for c in title)
    return f"{shorten_text(ascii(title))} contains a control character; leave it out" if odd else None


def split_names(value: Any) -> list[str] | None:
    """Names in a list, or in one text separated by commas; None for anything else.

    >>> split_names("wear, edge_pressure"), split_names(["wear"]), split_names(3)
    (['wear', 'edge_pressure'], ['wear'], None)
    """
    if isinstance(value, str):
        return [v.strip() for v in value.split(",") if v.strip()]
    return value if isinstance(value, list) and all(isinstance(v, str) for v in value) else None
