"""Set or remove a key of a TOML text without changing anything else in it."""

from __future__ import annotations

import re
from typing import Any

from flashtemp.model.case_file import KeyLocations, parse_toml
from flashtemp.model.toml_format import value_text


def try_parse(text: str) -> dict[str, Any] | None:
    """The tables of a text, None where it is not TOML."""
    try:
        return parse_toml(text)
    except (ValueError, RecursionError):
        return None


def set_toml_key(text: str, table: str, key: str, value: Any) -> str:
    """The text with table.key = value, or without the key where value is None; `table` "" is the top level.

    >>> print(set_toml_key("[block]\\nlength = 0.02  # m\\n", "block", "length", 0.03))
    [block]
    length = 0.03  # m
    <BLANKLINE>
    >>> print(set_toml_key("", "friction", "mu", 0.8))
    [friction]
    mu = 0.8
    <BLANKLINE>
    """
    lines = text.splitlines()
    locations = KeyLocations("", text)
    spellings = [f"{name}.{key}" for name in _table_spellings(table)] if table else [key]
    line_number = next((n for dotted in spellings if (n := locations.find_line(dotted)) is not None), None)
    written = None if value is None else f"{key} = {value_text(value)}"
    if line_number is not None:
        first, last = line_number - 1, _last_line(lines, line_number - 1)
        comment = _trailing_comment(lines[first]) if first == last else ""
        lines[first : last + 1] = [] if written is None else [written + comment]
    elif written is not None:
        _insert_line(lines, table, written)
    return "\n".join(lines) + "\n"


def _quote_name(table: str) -> str:
    """The name of a table as the head states it: a part after the first point in quotes where TOML requires them.

    >>> _quote_name("materials.own"), _quote_name("layers.top layer")
    ('materials.own', 'layers."top layer"')
    """
    kind, dot, name = table.partition(".")
    return table if not dot or re.fullmatch(r"[A-Za-z0-9_-]+", name) else f"{kind}.{value_text(name)}"


def _table_spellings(table: str) -> list[str]:
    """The name of a table as a head may state it: bare, or a part in double or single quotes.

    >>> _table_spellings("layers.disc")
    ['layers.disc', 'layers."disc"', "layers.'disc'"]
    """
    kind, dot, name = table.partition(".")
    return [table, f"{kind}.{value_text(name)}", f"{kind}.'{name}'"] if dot else [table]


def _find_header(lines: list[str], table: str) -> int | None:
    """The line with the head of a table, None where there is none."""
    names = "|".join(map(re.escape, _table_spellings(table)))
    return next((k for k, line in enumerate(lines) if re.fullmatch(rf"\s*\[\s*({names})\s*\]\s*(#.*)?", line)), None)


def _last_line(lines: list[str], first: int) -> int:
    """The last line of a value that begins on line `first`: where its brackets are closed."""
    depth = 0
    for k in range(first, len(lines)):
        bare = re.sub(r'"[^"]*"|\'[^\']*\'', "", lines[k]).split("#", 1)[0]
        depth += sum(map(bare.count, "[{")) - sum(map(bare.count, "]}"))
        if depth <= 0:
            return k
    return first


def _trailing_comment(line: str) -> str:
    """The comment at the end of a line with its preceding space."""
    bare = re.sub(r'"[^"]*"|\'[^\']*\'', lambda m: "_" * len(m[0]), line)
    return line[len(bare.split("#", 1)[0].rstrip()) :] if "#" in bare else ""


def _insert_line(lines: list[str], table: str, written: str) -> None:
    """Add a line at the end of its table, which is created if necessary."""
    headers = [k for k, line in enumerate(lines) if re.match(r"\s*\[", line)]
    if not table:
        before = headers[0] if headers else len(lines)
        while before and not lines[before - 1].strip():
            before -= 1
        lines.insert(before, written)
        return
    header = _find_header(lines, table)
    if header is None:
        lines += ([""] if lines and lines[-1].strip() else []) + [f"[{_quote_name(table)}]", written]
        return
    end = next((k for k in headers if k > header), len(lines))
    while end > header + 1 and not lines[end - 1].strip():
        end -= 1
    lines.insert(end, written)


def remove_toml_table(text: str, table: str) -> tuple[str, str]:
    """The text without a table, and the lines of this table, which `add_toml_table` brings back.

    >>> remove_toml_table("[wear]\\nrate = 1e-10\\n\\n# sliding\\n[schedule]\\nspeed = 0.1\\n", "wear")
    ('# sliding\\n[schedule]\\nspeed = 0.1\\n', '[wear]\\nrate = 1e-10\\n')
    """
    lines = text.splitlines()
    headers = [k for k, line in enumerate(lines) if re.match(r"\s*\[", line)]
    first = _find_header(lines, table)
    if first is None:
        return text, ""
    end = next((k for k in headers if k > first), len(lines))
    run = end  # blank lines and comments at the end of the table
    while run > first + 1 and (not lines[run - 1].strip() or lines[run - 1].lstrip().startswith("#")):
        run -= 1
    last = next((k for k in range(run, end) if not lines[k].strip()), end)
    while last < end and not lines[last].strip():  # comments after a blank line belong to the next table
        lines.pop(last)
        end -= 1
    removed = lines[first:last]
    kept = [*lines[:first], *lines[last:]]
    return "\n".join(kept).rstrip("\n") + "\n", "\n".join(removed) + "\n"


def remove_empty_table(text: str, table: str) -> str:
    """The text without the head of a table that holds neither keys nor comments.

    >>> remove_empty_table("[block]\\n\\n[schedule]\\nspeed = 0.1\\n", "block")
    '[schedule]\\nspeed = 0.1\\n'
    """
    kept, removed = remove_toml_table(text, table)
    return kept if len(removed.splitlines()) == 1 and "#" not in removed else text


def add_toml_table(text: str, table_lines: str) -> str:
    """The text with the lines of a table at its end.

    >>> add_toml_table("effects = []\\n", "[wear]\\nrate = 1e-10\\n")
    'effects = []\\n\\n[wear]\\nrate = 1e-10\\n'
    """
    return text.rstrip("\n") + "\n\n" + table_lines if text.strip() else table_lines
