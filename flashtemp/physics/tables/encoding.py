"""Bytes of a text file as text, whatever encoding an export uses."""

from __future__ import annotations

import re

from flashtemp.errors import BadInput

CONTROL = re.compile(r"[\x01-\x08\x0e-\x1f\x7f]")
ARCHIVES = {b"PK\x03\x04": "a spreadsheet (.xlsx) or an archive", b"\xd0\xcf\x11\xe0": "a spreadsheet (.xls)"}


def decode_text(data: bytes, where: str) -> str:
    """Text of a file in UTF-8, UTF-16 or Windows-1252, without its byte order mark.

    Raises BadInput, beginning with `where`, for spreadsheets, for NUL bytes, and for files without any text.
    """
    for magic, kind in ARCHIVES.items():
        if data.startswith(magic):
            raise BadInput(f"{where}: is {kind}, not text; save it as CSV and give that")
    try:
        marked = data[:2] in (b"\xff\xfe", b"\xfe\xff")
        text = data.decode("utf-16") if marked else _decode_bytes(data)
    except UnicodeDecodeError as fault:
        raise BadInput(f"{where}: is cut off or no text (UTF-16); give a whole copy, or export it as UTF-8") from fault
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise BadInput(
            f"{where}:{line}: holds a NUL byte, so it is damaged or no text; give a whole copy or export it anew"
        )
    text = text.rstrip("\x1a")  # the end of a file in DOS
    if found := CONTROL.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise BadInput(f"{where}:{line}: holds {found[0]!r}, no character of a text: damaged; give a whole copy")
    if not text.strip():
        raise BadInput(f"{where}: nothing in it; give a table with a line per reading")
    return text


def _decode_bytes(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")  # the degree sign of older programs
