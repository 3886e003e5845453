"""Words of a command line before anything is made of them: what no file name and no value may hold is refused here."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from pathlib import Path

from flashtemp.errors import BadInput, shorten_text

LINE_SIGNS = "\n\t"  # values in TOML may go over several lines
MAX_NAME_BYTES, MAX_PATH_BYTES = 255, 4095  # of common file systems


def refuse_odd_words(words: Iterable[str]) -> None:
    """Raises BadInput for words that hold control characters or are no text in UTF-8, and for empty ones.

    A terminal would act on such characters, and files of such names cannot be named in cases, messages and results.

    >>> refuse_odd_words(["run", "case", "contact.pressure=[[0, 1e5],\\n[1, 2e5]]"])
    >>> refuse_odd_words(["run", "a\\x1b[31m"])
    Traceback (most recent call last):
        ...
    flashtemp.errors.BadInput: 'a\\x1b[31m' (command line): holds a control character; give another name or value
    """
    for word in words:
        name, value = _split_word(word)
        shown = shorten_text(ascii(word))
        if not word:
            raise BadInput("'' (command line): an empty word; give a name or a value, or leave it out")
        if any(_is_control(c) for c in name) or any(_is_control(c) and c not in LINE_SIGNS for c in value):
            raise BadInput(f"{shown} (command line): holds a control character; give another name or value")
        if any("\ud800" <= c <= "\udfff" for c in word):
            raise BadInput(f"{shown} (command line): is no text in UTF-8; give the file a name in UTF-8")


def refuse_unwritable(file: str, option: str) -> None:
    """Raises BadInput for the name of a file to write that is too long, or a device, pipe or folder."""
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
        what = "a folder" if stat.S_ISDIR(mode) else "no ordinary file"
        raise BadInput(f"{option}: {name}: is {what}; give the name of a file")


def _split_word(word: str) -> tuple[str, str]:
    """The key and the value of key=value or --option=value; all of another word is its name."""
    name, equals, value = word.partition("=")
    return (name, value) if equals else (word, "")


def _is_control(letter: str) -> bool:
    return ord(letter) < 32 or 127 <= ord(letter) < 160
