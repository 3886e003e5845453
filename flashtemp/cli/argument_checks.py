"""Checks of command-line words before parsing: no control characters, no invalid UTF-8, no unwritable files."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from pathlib import Path

from flashtemp.errors import BadInput, shorten_text

LINE_SIGNS = "\n\t"  # allowed in values, because TOML values may span several lines
MAX_NAME_BYTES, MAX_PATH_BYTES = 255, 4095  # limits of common file systems


def refuse_odd_words(words: Iterable[str]) -> None:
    """Raise BadInput for words that are empty, contain control characters or are not valid UTF-8.

    A terminal would execute control characters, and cases, messages and results could not contain such names.

    >>> refuse_odd_words(["run", "case", "contact.pressure=[[0, 1e5],\\n[1, 2e5]]"])
    >>> refuse_odd_words(["run", "a\\x1b[31m"])
    Traceback (most recent call last):
        ...
    flashtemp.errors.BadInput: 'a\\x1b[31m' (command line): contains a control character; give another name or value
    """
    for word in words:
        name, value = _split_word(word)
        shown = shorten_text(ascii(word))
        if not word:
            raise BadInput("'' (command line): an empty word; give a name or a value, or leave it out")
        if any(_is_control(c) for c in name) or any(_is_control(c) and c not in LINE_SIGNS for c in value):
            raise BadInput(f"{shown} (command line): contains a control character; give another name or value")
        if any("\ud800" <= c <= "\udfff" for c in word):
            raise BadInput(f"{shown} (command line): is not valid UTF-8; rename the file")


def refuse_unwritable(file: str, option: str) -> None:
    """Raise BadInput where a file to write has too long a name, or is a device, pipe or folder."""
    name = shorten_text(file)
    if len(os.fsencode(file)) > MAX_PATH_BYTES or any(len(os.fsencode(p)) > MAX_NAME_BYTES for p in file.split("/")):
        raise BadInput(f"{option}: {name}: File name too long; give a shorter one")
    try:
        mode = Path(file).stat().st_mode
    except FileNotFoundError:
        return
    except OSError as fault:
        raise BadInput(f"{option}: {name}: {fault.strerror}; give a file that can be written") from fault
    if not stat.S_ISREG(mode):
        what = "a folder" if stat.S_ISDIR(mode) else "not a regular file"
        raise BadInput(f"{option}: {name}: is {what}; give the name of a file")


def _split_word(word: str) -> tuple[str, str]:
    """Key and value of key=value or --option=value; any other word is a key with an empty value."""
    name, equals, value = word.partition("=")
    return (name, value) if equals else (word, "")


def _is_control(letter: str) -> bool:
    return ord(letter) < 32 or 127 <= ord(letter) < 160
