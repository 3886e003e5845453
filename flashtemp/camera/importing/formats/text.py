"""Matrices of temperatures as text: exports of FLIR Tools, Testo, Optris, IRBIS and spreadsheets.

Such files differ in separator, decimal comma, header, labels, marks of pixels below the range, and the number of
images.  All of this is recognised and reported in notes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from flashtemp.camera import image_validation
from flashtemp.camera.importing.formats import fast_text, infratec_ascii
from flashtemp.camera.importing.formats.camera_file import CameraFile
from flashtemp.camera.importing.formats.cell_parsing import count_numeric, count_units, parse_cells
from flashtemp.camera.importing.formats.raw_frames import (
    UNSTATED_SCALE,
    RawFrames,
    scale_counts,
    temperature_unit,
    to_celsius,
)
from flashtemp.camera.importing.formats.text_blocks import arrange_images
from flashtemp.camera.importing.formats.text_header import TextHeader, find_unit, read_header
from flashtemp.camera.importing.formats.text_labels import TrimmedMatrix, remove_labels
from flashtemp.camera.importing.formats.text_layout import EXPORT_REMEDY, SEPARATOR_WORDS, TextLayout, read_layout
from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics import safe_text
from flashtemp.physics.tables.encoding import detect_unmarked_utf16, repair_signs

MEMORY_PER_TEXT_BYTE = 25.0  # bytes of memory while a byte of text becomes numbers
NO_TEXT = "no text with a matrix of temperatures; choose a file of a kind listed in docs/reference/file_formats.md"
ABSOLUTE_ZERO_MARK_DEGC = -273.0  # degC: absolute zero, of a pixel without a value, in whole degrees or finer
SIGN_TRANSLATION = str.maketrans(
    {"−": "-", "\u00a0": " ", "\u202f": " ", "℃": "°C", "℉": "°F", "º": "°", "˚": "°", "\ufeff": None}
)
MIN_MEDIAN_DEGC = -100.0  # degC: colder than any scene of a camera


@dataclass(frozen=True)
class TextImage:
    """The numbers of one image (rows, columns) with its labels, and the lines before it.

    `cells` and `lines` (numbers from 1) of its rows are for error messages; empty for plain files.
    """

    values: np.ndarray
    header: Sequence[str]
    edge: np.ndarray | None = None
    cells: Sequence[list[str]] = ()
    lines: Sequence[int] = ()


@dataclass(frozen=True)
class TextMatrices:
    """All images of a text, the unit in their cells, and notes on what was recognised."""

    images: list[TextImage]
    footer: Sequence[str]
    unit: str | None
    notes: list[str]
    commas_part: bool


def read(file: CameraFile) -> Iterator[RawFrames]:
    """The images of a text file, degC, one of `every`.  BadInput where the first bytes cannot be text."""
    if not is_text(file.start):
        raise BadInput(NO_TEXT)
    options = file.options
    names = ("unit", "scale", "offset", "below", "decimal", "rows", "labels")
    stated = {name: getattr(options, name) for name in names}
    yield read_text(file.read_all(MEMORY_PER_TEXT_BYTE), **stated).take_every(options.every)


def read_text(
    data: bytes, unit=None, scale=None, offset=None, below=None, decimal=None, rows=None, labels=None
) -> RawFrames:
    """The images of a text file, degC.

    Values at or under `below` (degC) are beyond the camera's range; by default, those at a plateau of the lowest or
    highest value.  `rows` of a file that holds a part of an image; `labels` if they look like the image: "none",
    "columns", "rows" or "both".  Raises BadInput.
    """
    text, notes = _normalise_text(decode_text(data))
    if text.lstrip().startswith(infratec_ascii.ASCII_START):
        return infratec_ascii.read_ascii(text, unit)
    found = _read_plain(text) if decimal is None else None
    found = found or _read_any_layout(text, decimal, rows)
    lines = [line for image in found.images for line in image.header] + list(found.footer)
    head = read_header(lines, found.commas_part)
    trimmed = [_trim_labels(image, head.size, rows, labels) for image in found.images]
    notes = [*found.notes, *notes, *trimmed[0].notes]
    for one in trimmed:
        if one.values.shape != trimmed[0].values.shape:
            raise BadInput(
                f"images of {_size_text(trimmed[0])} and {_size_text(one)} pixels in one file; {EXPORT_REMEDY}"
            )
        image_validation.check_matrix(one.values, head.size, rows, labels is not None)
    values = np.stack([one.values for one in trimmed])
    T, remark = _to_temperatures(values, head, found.unit, unit, scale, offset)
    if (zero := T <= ABSOLUTE_ZERO_MARK_DEGC).any():
        notes.append(f"{zero.sum()} pixels at absolute zero left out")
        T = np.where(zero, np.nan, T)
    marked = np.isnan(T)
    ends = below >= T if below is not None else np.stack([image_validation.saturated_pixels(image) for image in T])
    if below is None and ends.any():
        notes.append(f"{ends.sum()} pixels at the end of the camera's range left out (--below -273 keeps them)")
    clocks = [read_header(image.header).clock for image in found.images] if len(values) > 1 else [head.clock]
    return RawFrames(
        format="text matrix",
        temperature=np.where(marked | ends, np.nan, T),
        clock=None if None in clocks else np.array(clocks),
        stated_parameters=head.stated_parameters,
        outside=int((marked | ends).sum()),
        notes=(*notes, *([remark] if remark else [])),
        is_unscaled=scale is UNSTATED_SCALE,
    )


def _size_text(image: TrimmedMatrix) -> str:
    return f"{image.values.shape[1]} x {image.values.shape[0]}"


def _to_temperatures(values: np.ndarray, head: TextHeader, of_cells: str | None, unit, scale, offset):
    """Values in degC and a note on their unit."""
    if scale is not None or offset is not None:
        return scale_counts(values, scale, offset, "text"), ""
    known, where = find_unit(head, of_cells, unit, values)
    T, note = to_celsius(values, known)
    some = T[np.isfinite(T)]
    if known and some.size and not np.median(some) > MIN_MEDIAN_DEGC:
        raw = values[np.isfinite(values)]
        raise BadInput(
            f"unit: values of {raw.min():g} to {raw.max():g} in {known} would be {some.min():.1f} to {some.max():.1f}"
            " degC; correct --unit, or the unit in the file"
        )
    return T, where or note


def _read_plain(text: str) -> TextMatrices | None:
    """Images of a plain text; None if it is not plain."""
    plain = fast_text.read_plain_rows(text)
    if plain is None:
        return None
    header, values, separator, comma = plain
    notes = [f"{SEPARATOR_WORDS[separator]} between the values" + (", decimal commas" if comma else "")]
    return TextMatrices([TextImage(values, header)], [], None, notes, separator == "," and not comma)


def _read_any_layout(text: str, decimal: str | None, rows: int | None) -> TextMatrices:
    """The images of any text.  BadInput names the line at fault."""
    layout = read_layout(safe_text.split_bounded_lines(text, "line"), decimal, text[-1] in "\r\n")
    stated = read_header([line for _, line in layout.others]).size
    groups, notes = arrange_images(layout, stated[0], rows)
    edge = None if layout.edge is None else parse_cells([layout.edge], layout.separator, layout.comma)[0]
    images, before = [], 0
    for blocks in groups:
        begin, end = blocks[0].lines[0], blocks[-1].lines[-1]
        header = [line for number, line in layout.others if before < number < end]
        # words in a corner between labels may state a unit
        header += [cell for cell in blocks[0].rows[0] if cell and not count_numeric([cell])]
        cells = [row for block in blocks for row in block.rows]
        values = parse_cells(cells, layout.separator, layout.comma)
        lines = [number for block in blocks for number in block.lines]
        images.append(TextImage(values, header, edge if begin == groups[0][0].lines[0] else None, cells, lines))
        before = end
    footer = [line for number, line in layout.others if number > before]
    sign = f"{SEPARATOR_WORDS[layout.separator]} between the values" + (", decimal commas" if layout.comma else "")
    commas_part = layout.separator == "," and not layout.comma
    return TextMatrices(images, footer, _find_cell_unit(layout), [sign, *notes], commas_part)


def _find_cell_unit(layout: TextLayout) -> str | None:
    """The unit after the numbers of the cells.  BadInput if there are two."""
    units: dict[str, str] = {}
    for written in count_units(layout.rows):
        if (unit := temperature_unit(written)) is not None:
            units.setdefault(unit, written)
    if len(units) > 1:
        first, other = list(units.values())[:2]
        for block in layout.blocks:
            for line, row in zip(block.lines, block.rows, strict=True):
                if cell := next((c for c in row if c.endswith(other) and c[: -len(other)].strip()), None):
                    raise BadInput(
                        f"line {line}: {cell!r}, while other cells are in {first}; give one unit in all cells"
                    )
    return next(iter(units), None)


def _trim_labels(image: TextImage, stated: tuple[int | None, int | None], rows: int | None, choice) -> TrimmedMatrix:
    """An image without labels and remarks.  BadInput for words among its numbers."""

    def is_whole(height: int, width: int) -> bool | None:
        wanted = rows or stated[0], stated[1]
        if any(w is not None and w != n for w, n in zip(wanted, (height, width), strict=True)):
            return False
        if wanted[0] is not None:
            return True if wanted[1] is not None else None
        whole = image_validation.SENSOR_SIZES.get(width)
        return None if whole is None else height in whole

    found = remove_labels(image.values, choice, is_whole, image.edge)
    if found.values.size == 0 or np.isinf(found.values).any():
        words = np.argwhere(np.isinf(image.values)).tolist()
        inner = [(row, column) for row, column in words if row and 0 < column < image.values.shape[1] - 1]
        row, column = (inner or words or [(0, 0)])[0]
        where = f"line {image.lines[row]}: {shorten_text(image.cells[row][column])!r} in column {column + 1}: "
        raise BadInput(f"{where}words stand among the numbers of the matrix; remove or repair them")
    return found


def decode_text(data: bytes) -> str:
    """Text of bytes in UTF-8, UTF-16 or Windows-1252, without byte order mark; NULs stay."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", "replace")
    elif order := detect_unmarked_utf16(data[:200]):
        text = data.decode(order, "replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", "replace")
    if not text.strip("\0 \t\r\n"):
        raise BadInput(NO_TEXT)
    return text


def is_text(start: bytes) -> bool:
    """Whether a file with these first bytes can be text: NULs only at the end, or in every other byte (UTF-16)."""
    return (
        b"\0" not in start.rstrip(b"\0")
        or start[:2] in (b"\xff\xfe", b"\xfe\xff")
        or detect_unmarked_utf16(start[:200]) is not None
    )


def _normalise_text(text: str) -> tuple[str, list[str]]:
    """A text with uniform spelling of similar characters and without NULs at its end, and a note on those."""
    notes = []
    if text.endswith("\0"):
        kept = text.rstrip("\0")
        notes.append(f"{len(text) - len(kept)} NUL bytes at the end left out")
        text = kept
    if "\0" in text:
        at = text.index("\0")
        raise BadInput(
            f"line {text.count(chr(10), 0, at) + 1} holds a NUL byte after"
            f" {shorten_text(text[max(0, at - 20) : at])!r}: {NO_TEXT}"
        )
    if not text.isascii() or "&deg;" in text or "?" in text:
        text = repair_signs(text.translate(SIGN_TRANSLATION))
    return text, notes
