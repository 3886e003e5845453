"""InfraTec IRBIS ASCII: [Settings] with KEY=VALUE, then [Data]; the header states separators, unit and size."""

from __future__ import annotations

import numpy as np

from flashtemp.camera.importing.formats.cell_parsing import parse_cells, parse_clock, split_cells
from flashtemp.camera.importing.formats.raw_frames import RawFrames, agree_on_unit, to_celsius
from flashtemp.errors import BadInput, shorten_text

ASCII_START = "[Settings]"
ASCII_REMEDY = "export it anew and give that"
SIZE_KEYS = ("ImageHeight", "ImageWidth")
DIFFERENCE_CONTENTS = ("amplitude", "phase", "difference")


def _guess_separator(row: str) -> str | None:
    """Separator of the numbers in a row, if the header does not state it."""
    return next((sign for sign in "\t;" if sign in row.strip()), "," if row.count(",") > row.count(" ") else None)


def read_ascii(text: str, unit: str | None) -> RawFrames:
    """One image, degC, of the rows and columns that the header states.  Raises BadInput."""
    head, mark, body = text.partition("[Data]")
    pairs = dict(line.split("=", 1) for line in head.splitlines() if "=" in line)
    lines = [line for line in body.splitlines() if line.strip()]
    if not mark or not lines:
        raise BadInput("IRBIS header without [Data]: the file is cut off; export it anew and give that")
    try:
        separator = chr(int(pairs["DelimiterValue"], 16)) if "DelimiterValue" in pairs else _guess_separator(lines[0])
        point = chr(int(pairs["CommaValue"], 16)) if "CommaValue" in pairs else "." if "." in lines[0] else ","
        comma = point == "," != separator
        stated = tuple(int(pairs[k]) for k in SIZE_KEYS) if any(k in pairs for k in SIZE_KEYS) else None
    except (ValueError, KeyError, OverflowError) as fault:
        raise BadInput(f"IRBIS header damaged or cut off ({shorten_text(str(fault))}); {ASCII_REMEDY}") from fault
    rows = [split_cells(line, separator) for line in lines]
    if all(len(r) == len(rows[0]) and not r[-1] for r in rows):  # a separator at the end of every line
        rows = [r[:-1] for r in rows]
    widths = {len(r) for r in rows}
    size = stated or (len(rows), max(widths))
    if len(widths) > 1 or (len(rows), len(rows[0])) != size:
        raise BadInput(
            f"{len(rows)} rows of {min(widths)} to {max(widths)} values, the header says {size[1]} x {size[0]};"
            " the file is cut off: export it anew and give that"
        )
    values = parse_cells(rows, separator, comma)
    if np.any(np.isinf(values)):
        raise BadInput("words stand among the numbers of [Data]; export it anew and give that")
    content = pairs.get("Content", "Temperature")
    difference = content.lower() in DIFFERENCE_CONTENTS
    T, note = to_celsius(values, agree_on_unit(unit, pairs.get("TempUnit"), "TempUnit of its header"), difference)
    clock = parse_clock(f"{pairs.get('Params.Rec.Date', '')} {pairs.get('Params.Rec.Time', '')}")
    return RawFrames(
        format="IRBIS ASCII",
        temperature=T[None],
        clock=None if clock is None else np.array([clock]),
        outside=int(np.isnan(T).sum()),
        notes=(*([note] if note else []), *([f"{content}: a difference of temperatures"] if difference else [])),
        difference=difference,
    )
