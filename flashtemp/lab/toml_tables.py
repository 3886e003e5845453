"""Change, add and remove entries of an array of tables in a TOML text, such as [[recording]], and keep all else.

Every change is checked by parsing the new text: it holds what it should hold, or the change is refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.lab.toml_editing import set_toml_key, try_parse
from flashtemp.model.case_file import flatten_tables, parse_toml
from flashtemp.model.toml_format import value_text

Table = dict[str, Any]
CONDITIONS = "with"  # the table of an entry whose keys contain dots
REMEDY = "change it in the text"


def read_entries(raw: Mapping[str, Any], kind: str) -> list[Table]:
    """The entries of an array of tables, with flat conditions; those that are no tables are empty.

    >>> read_entries({"recording": [{"with": {"contact": {"pressure": 2.0}}}, 3]}, "recording")
    [{'with': {'contact.pressure': 2.0}}, {}]
    """
    entries = raw.get(kind, [])
    return [_flatten_entry(e) if isinstance(e, dict) else {} for e in entries] if isinstance(entries, list) else []


def change_entry(text: str, kind: str, number: int, changed: Mapping[str, Any]) -> str:
    """The text with keys of the entry `number`, counted from 1, changed, or removed where their value is None.

    Conditions are a flat table {"table.key": value}.  Raises BadInput.

    >>> print(change_entry('[[a]]\\nfile = "x"  # mine\\n', "a", 1, {"file": "y", "with": {"b.c": 2.0}}))
    [[a]]
    file = "y"  # mine
    with = { "b.c" = 2.0 }
    <BLANKLINE>
    """
    entries = _parse_entries(text, kind)
    if not 1 <= number <= len(entries):
        raise BadInput(f"{kind} {number}: the text has {len(entries)} of them")
    old = entries[number - 1]
    new = {k: v for k, v in {**old, **changed}.items() if v is not None and not (k == CONDITIONS and not v)}
    wanted = [*entries[: number - 1], new, *entries[number:]]
    lines, ranges = text.splitlines(), _find_ranges(text, kind)
    if len(ranges) == len(entries):
        first, last = ranges[number - 1]
        for block in (_edit_block(lines[first:last], kind, old, new), _write_entry(kind, new)):
            candidate = _join_lines([*lines[:first], *block, *lines[last:]])
            if _holds_entries(candidate, kind, wanted, text):
                return candidate
    raise BadInput(f"{kind} {number}: cannot be changed here, by the way it is written; {REMEDY}")


def add_entry(text: str, kind: str, entry: Mapping[str, Any], after: int | None = None) -> str:
    """The text with a new entry behind the entry `after`, or behind the last one of its kind.  Raises BadInput.

    >>> print(add_entry('title = "t"\\n', "recording", {"file": "a.nc"}))
    title = "t"
    <BLANKLINE>
    [[recording]]
    file = "a.nc"
    <BLANKLINE>
    """
    entries, ranges, lines = _parse_entries(text, kind), _find_ranges(text, kind), text.rstrip().splitlines()
    at = len(entries) if after is None else after
    position = ranges[at - 1][1] if ranges and 1 <= at <= len(ranges) else len(lines)
    tail = lines[position:]
    gap = [""] if tail and tail[0].strip() else []
    head = [*lines[:position], *([""] if position and lines[position - 1].strip() else [])]
    candidate = _join_lines([*head, *_write_entry(kind, entry), *gap, *tail])
    wanted = [*entries[:at], _flatten_entry(dict(entry)), *entries[at:]]
    if not _holds_entries(candidate, kind, wanted, text):
        raise BadInput(f"{kind}: no entry can be added here, by the way the others are written; {REMEDY}")
    return candidate


def remove_entry(text: str, kind: str, number: int) -> str:
    """The text without the entry `number`, counted from 1.  Raises BadInput.

    >>> remove_entry('[[a]]\\nb = 1\\n\\n[[a]]\\nb = 2\\n', "a", 1)
    '[[a]]\\nb = 2\\n'
    """
    entries, ranges, lines = _parse_entries(text, kind), _find_ranges(text, kind), text.splitlines()
    if len(ranges) == len(entries) and 1 <= number <= len(entries):
        first, last = ranges[number - 1]
        while last < len(lines) and not lines[last].strip():
            last += 1
        candidate = _join_lines([*lines[:first], *lines[last:]]).lstrip("\n")
        if _holds_entries(candidate, kind, [*entries[: number - 1], *entries[number:]], text):
            return candidate
    raise BadInput(f"{kind} {number}: cannot be removed here, by the way it is written; {REMEDY}")


def set_top_key(text: str, key: str, value: Any) -> str:
    """The text with a key of the top level set, also where it is written as a table, or removed (None).

    Raises BadInput.

    >>> print(set_top_key('[free]\\na = 0.1\\n\\n[[b]]\\nc = 1\\n', "free", ["a"]))
    free = ["a"]
    <BLANKLINE>
    [[b]]
    c = 1
    <BLANKLINE>
    """
    raw = _parse_text(text)
    if isinstance(raw.get(key), dict) and (ranges := _find_ranges(text, key, array=False)):
        lines = text.splitlines()
        for first, last in reversed(ranges):
            del lines[first:last]
        text = _join_lines(lines).lstrip("\n")
        text = f"\n{text}" if text.startswith("[") else text
    candidate = set_toml_key(text, "", key, value)
    wanted = {k: v for k, v in raw.items() if k != key} | ({} if value is None else {key: value})
    if try_parse(candidate) != wanted:
        raise BadInput(f"{key}: cannot be changed here, by the way it is written; {REMEDY}")
    return candidate


# --- the lines of an entry -------------------------------------------------------------------------------
def _find_ranges(text: str, kind: str, array: bool = True) -> list[tuple[int, int]]:
    """First line and end of every entry of an array of tables with its inner tables, or of a single table."""
    lines = text.splitlines()
    heads = [(k, head) for k, line in enumerate(lines) if (head := _table_name(line)) is not None]
    out = []
    for n, (first, (name, is_array)) in enumerate(heads):
        if name != kind or is_array is not array:
            continue
        end = next((k for k, (other, _) in heads[n + 1 :] if not other.startswith(f"{kind}.")), len(lines))
        while end > first + 1 and (not lines[end - 1].strip() or lines[end - 1].lstrip().startswith("#")):
            end -= 1  # blank lines and comments before the next table belong to that one
        out.append((first, end))
    return out


def _table_name(line: str) -> tuple[str, bool] | None:
    """Name of a table whose head the line is, and whether it is one of an array; None for other lines."""
    found = re.fullmatch(r"\s*(\[\[?)\s*([\w.\"'-]+(?:\s*\.\s*[\w\"'-]+)*)\s*\]\]?\s*(#.*)?", line)
    return (re.sub(r"[\s\"']", "", found[2]), found[1] == "[[") if found else None


def _edit_block(block: list[str], kind: str, old: Table, new: Table) -> list[str]:
    """The lines of an entry with the changed keys alone edited."""
    lines = list(block)
    inner = next((k for k, line in enumerate(lines) if _table_name(line) == (f"{kind}.{CONDITIONS}", False)), None)
    own_end = next((k for k, line in enumerate(lines) if k and _table_name(line)), len(lines))
    if inner is not None:  # conditions as a table of their own
        before, after = old.get(CONDITIONS, {}), new.get(CONDITIONS, {})
        end = next((k for k in range(inner + 1, len(lines)) if _table_name(lines[k])), len(lines))
        part = lines[inner:end]
        for key in [*before, *(k for k in after if k not in before)]:
            if before.get(key) != after.get(key):
                part = _set_line(part, key, after.get(key))
        lines[inner:end] = part if after else []
    part = lines[:own_end]
    for key in [*old, *(k for k in new if k not in old)]:
        if old.get(key) != new.get(key) and not (key == CONDITIONS and inner is not None):
            part = _set_line(part, key, new.get(key))
    lines[:own_end] = part
    while lines and not lines[-1].strip():
        lines.pop()
    return lines


def _set_line(lines: list[str], key: str, value: Any) -> list[str]:
    """Lines of one table, with its head, in which one key has a value on one line, or is missing (None)."""
    pattern = re.compile(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=")
    at = next((k for k, line in enumerate(lines) if pattern.match(line)), None)
    written = [] if value is None else [value_text({key: value})[2:-2]]
    if at is not None:
        comment = re.search(r"\s+#[^\"'\]}]*$", lines[at])
        return [*lines[:at], *(line + (comment[0] if comment else "") for line in written), *lines[at + 1 :]]
    end = len(lines)
    while end > 1 and not lines[end - 1].strip():
        end -= 1
    return [*lines[:end], *written, *lines[end:]]


def _join_lines(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"


def _write_entry(kind: str, entry: Mapping[str, Any]) -> list[str]:
    return [f"[[{kind}]]", *(value_text({key: value})[2:-2] for key, value in entry.items())]


# --- checks ----------------------------------------------------------------------------------------------
def _parse_text(text: str) -> Table:
    """The tables of a text.  Raises BadInput."""
    try:
        return parse_toml(text)
    except (ValueError, RecursionError) as fault:
        raise BadInput(f"the text is not valid TOML: {str(fault).splitlines()[0]}; repair that line first") from fault


def _parse_entries(text: str, kind: str) -> list[Table]:
    return read_entries(_parse_text(text), kind)


def _flatten_entry(entry: Table) -> Table:
    """An entry with flat conditions."""
    given = entry.get(CONDITIONS)
    return entry | {CONDITIONS: flatten_tables(given)} if isinstance(given, dict) else entry


def _holds_entries(text: str, kind: str, wanted: list[Table], original: str) -> bool:
    """Whether a text holds the wanted entries, and everything else of the original."""
    raw, before = try_parse(text), _parse_text(original)
    others = [{k: v for k, v in tables.items() if k != kind} for tables in (raw or {}, before)]
    return raw is not None and others[0] == others[1] and read_entries(raw, kind) == wanted
