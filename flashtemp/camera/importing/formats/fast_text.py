"""Fast reader of plain text images: plain numbers, one separator, rows of one length.

All other files go to the general reader (`text`), which reads the same numbers from plain files.
"""

from __future__ import annotations

import io

import numpy as np

from flashtemp.camera.importing.formats.cell_parsing import MAX_CELL_LENGTH, mask_missing_marks
from flashtemp.physics.safe_text import MAX_LINE_LETTERS

MAX_HEADER_LINES = 200  # lines that may stand before the numbers
PLAIN_CHARACTERS = frozenset("0123456789+-.,;\t eE\r")
DIGIT, POINT, SIGN, EXPONENT_SIGN, SEPARATOR_SIGN, END, OTHER_SIGN = range(7)
ALLOWED_NEXT = {  # kinds of characters that may follow a kind
    DIGIT: (DIGIT, POINT, EXPONENT_SIGN, SEPARATOR_SIGN, END),
    POINT: (DIGIT,),
    SIGN: (DIGIT,),
    EXPONENT_SIGN: (DIGIT, SIGN),
    SEPARATOR_SIGN: (DIGIT, SIGN),
    END: (DIGIT, SIGN),
}
# successive marks that no number has, as 7 first + second
FORBIDDEN_PAIRS = (POINT * 7 + POINT, EXPONENT_SIGN * 7 + POINT, EXPONENT_SIGN * 7 + EXPONENT_SIGN)


def read_plain_rows(text: str) -> tuple[list[str], np.ndarray, str | None, bool] | None:
    """Header lines, numbers (rows, columns), separator (None: a space), and whether commas are decimal.

    None if the text is not plain.
    """
    header, begin = _split_header(text)
    try:
        body = text[begin:].replace("\r\n", "\n").rstrip("\n").encode("ascii") + b"\n"
    except UnicodeEncodeError:
        return None
    first = body[: body.index(b"\n")]
    found = [s for s in (b"\t", b";", b",", b" ") if s in first]
    comma = found in ([b"\t", b","], [b";", b","]) and b"." not in first
    if not found or (len(found) > 1 and not comma) or text[-1] not in "\r\n":
        return None
    apart = found[0]
    if apart == b"," and b"." not in first:  # commas could be decimal
        return None
    if not _is_regular_matrix(np.frombuffer(body, np.uint8), _byte_kinds(apart, b"," if comma else b".")):
        return None
    plain = body.replace(b",", b".") if comma else body
    values = np.loadtxt(io.BytesIO(plain), delimiter=apart.decode(), comments=None, ndmin=2)
    if any(2 * len(line.split(apart.decode())) > values.shape[1] for line in header):  # a row that is not plain
        return None
    return header, mask_missing_marks(values), None if apart == b" " else apart.decode(), comma


def _split_header(text: str) -> tuple[list[str], int]:
    """Lines before the first plain one, and the offset of that."""
    header: list[str] = []
    begin = 0
    while len(header) < MAX_HEADER_LINES:
        end = text.find("\n", begin)
        line = text[begin : end if end >= 0 else len(text)]
        if end < 0 or (line.strip() and PLAIN_CHARACTERS.issuperset(line)):
            break
        header += line.splitlines() or [""]
        begin = end + 1
    return header, begin


def _byte_kinds(apart: bytes, point: bytes) -> np.ndarray:
    """The kind of every byte (256,)."""
    kinds = np.full(256, OTHER_SIGN, np.uint8)
    for letters, kind in ((b"0123456789", DIGIT), (b"+-", SIGN), (b"eE", EXPONENT_SIGN), (b"\n", END)):
        kinds[list(letters)] = kind
    kinds[apart[0]], kinds[point[0]] = SEPARATOR_SIGN, POINT
    return kinds


def _is_regular_matrix(letters: np.ndarray, kinds: np.ndarray) -> bool:
    """Whether a text consists of rows with equal counts of well-formed numbers, and ends with a line end."""
    kind = kinds[letters]
    may, twice = np.zeros(49, bool), np.zeros(49, bool)
    may[[7 * a + b for a, after in ALLOWED_NEXT.items() for b in after]] = True
    twice[list(FORBIDDEN_PAIRS)] = True
    if kind[0] not in ALLOWED_NEXT[END] or not may[7 * kind[:-1] + kind[1:]].all():
        return False
    marks = kind[(kind == POINT) | (kind >= EXPONENT_SIGN)]
    if twice[7 * marks[:-1] + marks[1:]].any():
        return False
    ends = np.flatnonzero(kind >= SEPARATOR_SIGN)
    lines = np.flatnonzero(kind[ends] == END)
    columns = np.diff(lines, prepend=-1)
    longest = np.diff(ends, prepend=-1).max() - 1, np.diff(ends[lines], prepend=-1).max() - 1
    return (
        columns[0] > 1
        and bool(np.all(columns == columns[0]))
        and longest[0] <= MAX_CELL_LENGTH
        and longest[1] <= MAX_LINE_LETTERS
    )
