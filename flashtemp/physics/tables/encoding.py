"""Decode text files in the encodings that programs export."""

from __future__ import annotations

import re

from flashtemp.errors import BadInput

CONTROL_CHARACTER = re.compile(r"[\x01-\x08\x0e-\x1f\x7f]")
DECODED_TWICE = re.compile("\u00c2(?=[\u00a0-\u00bf])")  # U+00A0 to U+00BF in UTF-8, read as Windows-1252
LOST_DEGREE = re.compile(  # degree signs after a wrong conversion: from HTML, to ASCII, from Mac OS, from Shift JIS
    "&deg;|(?<![^\\W\\d_])[?\u00a1\ufffd\uff9f\u309c\u00df](?=[CFK](?![^\\W_]))"
)
TYPOGRAPHIC_MINUS = "\u2212"  # the typographic minus sign
ARCHIVE_MAGIC = {b"PK\x03\x04": "a spreadsheet (.xlsx) or an archive", b"\xd0\xcf\x11\xe0": "a spreadsheet (.xls)"}


def decode_text(data: bytes, where: str) -> str:
    """Text of a file in UTF-8, UTF-16 or Windows-1252, without its byte order mark.

    `repair_signs` restores characters lost by wrong conversions.  Raises BadInput, beginning with `where`, for
    spreadsheets, for NUL bytes, and for files without any text.
    """
    for magic, kind in ARCHIVE_MAGIC.items():
        if data.startswith(magic):
            raise BadInput(f"{where}: is {kind}, not text; save it as CSV and give that")
    try:
        marked = data[:2] in (b"\xff\xfe", b"\xfe\xff")
        wide = "utf-16" if marked else detect_unmarked_utf16(data[:200])
        text = data.decode(wide) if wide else _decode_bytes(data)
    except UnicodeDecodeError as fault:
        raise BadInput(
            f"{where}: is cut off or not text (UTF-16); give a complete copy, or export it as UTF-8"
        ) from fault
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise BadInput(
            f"{where}:{line}: contains a NUL byte, so it is damaged or not text;"
            " give a complete copy or export it again"
        )
    text = text.rstrip("\x1a")  # the end of a file in DOS
    if found := CONTROL_CHARACTER.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise BadInput(f"{where}:{line}: contains {found[0]!r}, a control character: damaged; give a complete copy")
    if not text.strip():
        raise BadInput(f"{where}: the file is empty; give a table with a line per reading")
    return repair_signs(text)


def repair_signs(text: str) -> str:
    """Restore degree signs and other characters that a wrong conversion of the encoding damaged.

    >>> repair_signs("T (?F);d (\u00c2\u00b5m);\uff9fC;22.5 &deg;C")
    'T (°F);d (µm);°C;22.5 °C'
    >>> repair_signs("which?"), repair_signs("stra\u00dfe")
    ('which?', 'straße')
    """
    if text.isascii() and "?" not in text and "&deg;" not in text:
        return text
    return LOST_DEGREE.sub("\u00b0", DECODED_TWICE.sub("", text).replace(TYPOGRAPHIC_MINUS, "-"))


def detect_unmarked_utf16(start: bytes) -> str | None:
    """Detect UTF-16 without a byte order mark, in which every other byte is 0.

    >>> detect_unmarked_utf16("Time,front".encode("utf-16-be")), detect_unmarked_utf16(b"Time,front")
    ('utf-16-be', None)
    """
    even, odd = start[0::2], start[1::2]
    if len(start) > 8 and not any(odd) and all(even):
        return "utf-16-le"
    return "utf-16-be" if len(start) > 8 and not any(even) and all(odd) else None


def _decode_bytes(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")  # the degree sign of older programs
