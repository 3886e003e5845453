"""Decides whether blocks of rows in a text are one image with lines between its rows, or several images."""

from __future__ import annotations

import re
from collections.abc import Sequence

from flashtemp.camera.image_validation import SENSOR_SIZES
from flashtemp.camera.importing.formats.cell_parsing import parse_clock
from flashtemp.camera.importing.formats.text_layout import RowBlock, TextLayout
from flashtemp.errors import BadInput, shorten_text

FRAME_HEADING = re.compile(r"frame|image|bild|picture|photo|snapshot|shot|time|zeit|date|datum|record", re.IGNORECASE)


def arrange_images(
    layout: TextLayout, stated: int | None, rows_said: int | None
) -> tuple[list[Sequence[RowBlock]], list[str]]:
    """The blocks of each image, and notes.  `stated`: rows in the header; `rows_said`: rows that the user states.

    Blocks of equal height are images if a sensor has that height, or if each has a heading.  Blocks that only together
    have such a height are one image.  BadInput names the line if neither can be decided.
    """
    blocks = layout.blocks
    if len(blocks) == 1:
        return [blocks], []
    sizes = [len(block.rows) for block in blocks]
    between = [_lines_between(layout, block, after) for block, after in zip(blocks, blocks[1:], strict=False)]
    total, equal, wanted = sum(sizes), len(set(sizes)) == 1, rows_said or stated
    whole, parts = _is_whole(total, layout), _is_whole(sizes[0], layout)
    headed = all(any(FRAME_HEADING.search(t) or parse_clock(t) is not None for t in texts) for texts in between)
    silent = not any(between)
    at = blocks[0].lines[-1] + 1
    if wanted == total or (wanted is None and ((whole and not parts) or (silent and max(sizes) == 1))):
        return [blocks], [_describe_left_out(at, between)]
    if equal and (wanted == sizes[0] or (wanted is None and sizes[0] > 1 and (headed or (parts and not whole)))):
        return [[block] for block in blocks], [f"{len(blocks)} images in the file"]
    if parts or headed or wanted == sizes[0]:
        odd = next(k for k, size in enumerate(sizes) if size != sizes[0]) if not equal else 0
        raise BadInput(
            f"line {blocks[odd].lines[0]}: image {odd + 1} has {sizes[odd]} rows, others {sizes[0]}; the file is cut"
            " off or damaged: copy it again or export it anew and give that"
        )
    if silent and not equal and not (len(set(sizes[:-1])) == 1 and sizes[-1] < sizes[0]):
        return [blocks], [_describe_left_out(at, between)]
    what = "an empty line" if not between[0] else repr(shorten_text(between[0][0])[:40])
    raise BadInput(
        f"line {at}: {what} splits the rows into blocks of {', '.join(map(str, sizes[:4]))}"
        f"{' ...' if len(sizes) > 4 else ''} rows: one image, or several? give --rows {total} for one"
        + (f", --rows {sizes[0]} for several" if equal else "")
    )


def _lines_between(layout: TextLayout, block: RowBlock, after: RowBlock) -> list[str]:
    """Lines with words between two blocks, without remarks that begin with a comment sign."""
    begin, end = block.lines[-1], after.lines[0]
    some = (text.strip() for number, text in layout.others if begin < number < end)
    return [t for t in some if t.strip("; \t,") and not t.startswith(("#", "%", "//", "!"))]


def _is_whole(rows: int, layout: TextLayout) -> bool:
    """Whether a sensor of this width has so many rows, with or without labels."""
    columns = len(layout.blocks[0].rows[0])
    return any(rows - k in SENSOR_SIZES.get(columns - k, ()) for k in (0, 1)) or rows in SENSOR_SIZES.get(
        columns - 1, ()
    )


def _describe_left_out(line: int, between: list[list[str]]) -> str:
    if len(between) > 1:
        return f"lines between the rows, the first of them line {line}, left out"
    return (
        f"line {line} between the rows left out: {shorten_text(between[0][0])[:40]!r}"
        if between[0]
        else (f"line {line} between the rows is empty, left out")
    )
