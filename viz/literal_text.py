"""Literal text in pictures: titles, file names and labels of users are shown character by character.

matplotlib would read text between two dollar signs as mathematics, warn of characters that its font lacks, and fail
on control characters.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Any

UNKNOWN_LETTER = "\ufffd"  # Unicode replacement character
UNESCAPED_DOLLAR = re.compile(r"(?<!\\)\$")


def show_as_text(figure: Any) -> None:
    """Turn every title, label and note of a matplotlib figure into plain text; numeric tick labels are unchanged."""
    for text in _iter_texts(figure):
        original = text.get_text()
        shown, family = _with_known_letters(replace_unprintable(original), text.get_fontproperties())
        if family:
            text.set_fontfamily([*text.get_fontfamily(), family])
        if text.get_parse_math():
            shown = escape_mathematics(shown)
        if shown != original:
            text.set_text(shown)


def replace_unprintable(text: str) -> str:
    r"""Replace control characters and lone surrogates by UNKNOWN_LETTER; line feeds and tabs stay.

    >>> replace_unprintable("a\x00b\x1b[1m"), replace_unprintable("two\nlines")
    ('a\ufffdb\ufffd[1m', 'two\nlines')
    """
    return "".join(c if c.isprintable() or c in "\n\t" else UNKNOWN_LETTER for c in text)


def escape_mathematics(text: str) -> str:
    r"""Escape dollar signs so that neither matplotlib nor VTK reads mathematics.

    >>> print(escape_mathematics("5 $ and $x$"), escape_mathematics(r"\$"))
    5 \$ and \$x\$ \$
    """
    return UNESCAPED_DOLLAR.sub(r"\\$", text)


def _iter_texts(artist: Any) -> Iterator[Any]:
    """Text artists below an artist, except numeric tick labels."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    for child in artist.get_children():
        if isinstance(child, Axis):
            _show_tick_names(child)
            yield child.label
            continue
        if isinstance(child, Text) and child.get_text():
            yield child
        yield from _iter_texts(child)


def _show_tick_names(axis: Any) -> None:
    """Turn tick labels that are names, such as files or effects, into plain text."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.ticker import FixedLocator, FuncFormatter

    locator, formatter = axis.get_major_locator(), axis.get_major_formatter()
    if not (isinstance(locator, FixedLocator) and isinstance(formatter, FuncFormatter)):
        return
    name_at, places = formatter.func, axis.get_majorticklocs()
    names = replace_unprintable("".join(str(name_at(place, n)) for n, place in enumerate(places)))
    shown, family = _with_known_letters(names, FontProperties())
    lost = set(names) - set(shown)
    if family:
        axis.set_tick_params(labelfontfamily=[*FontProperties().get_family(), family])

    def as_text(place: float, n: int | None = None) -> str:
        name = "".join(UNKNOWN_LETTER if c in lost else c for c in replace_unprintable(str(name_at(place, n))))
        return escape_mathematics(name)

    axis.set_major_formatter(FuncFormatter(as_text))


def _with_known_letters(text: str, font: Any) -> tuple[str, str | None]:
    """The text with unknown characters replaced, and a font family for those that `font` lacks (or None)."""
    from matplotlib.font_manager import findfont

    missing = {c for c in text if ord(c) > 126} - _font_letters(str(findfont(font)))
    family = _find_font_family(frozenset(missing)) if missing else None
    if missing and family is None:
        text = "".join(UNKNOWN_LETTER if c in missing else c for c in text)
    return text, family


@cache
def _font_letters(font_file: str) -> frozenset[str]:
    """The characters of a font."""
    from matplotlib.font_manager import get_font

    return frozenset(map(chr, get_font(font_file).get_charmap()))


@cache
def _find_font_family(letters: frozenset[str]) -> str | None:
    """Name of an installed font with all these characters; None where there is none."""
    from matplotlib.font_manager import fontManager

    def order(entry: Any) -> tuple[Any, ...]:
        last_resort = entry.name.startswith("Last Resort")  # frames that name a letter's script
        return (last_resort, entry.weight != 400, entry.style, entry.name)

    for entry in sorted(fontManager.ttflist, key=order):
        try:
            if letters <= _font_letters(entry.fname):
                return str(entry.name)
        except (OSError, RuntimeError):  # a font file that cannot be read
            continue
    return None
