"""Labels of rows and columns around a text image: numbers that count evenly, or words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from flashtemp.camera.image_validation import MAX_ROWS_PER_COLUMN
from flashtemp.camera.image_validation import MIN_SENSOR_COLUMNS as FEWEST_COLUMNS
from flashtemp.errors import BadInput

MIN_LABELS = 3  # labels from which even counting is recognised
# in units of the usual distance between neighbouring lines: a line of the image is nearer, one beyond is separate
SIMILAR_DISTANCE, SEPARATE_DISTANCE = 2.0, 10.0
LABEL_POSSIBLE, LABEL_LIKELY, LABEL_CERTAIN = 1, 2, 3
MAX_DECIMALS = 6
MAX_CORNER_CELLS = 3  # cells of a line of labels that belong to the corner with other labels


def is_evenly_spaced(numbers: np.ndarray) -> bool:
    """Whether numbers (n,) count by one step other than 0, within the resolution of their decimals.

    >>> is_evenly_spaced(np.array([-1.0, -0.5, 0.0, 0.5])), is_evenly_spaced(np.array([0.33, 0.67, 1.0, 1.33]))
    (True, True)
    >>> is_evenly_spaced(np.array([25.0, 25.1, 25.1, 25.3]))
    False
    """
    n = len(numbers)
    if n < MIN_LABELS or not np.isfinite(numbers).all() or numbers[0] == numbers[-1]:
        return False
    step = (numbers[-1] - numbers[0]) / (n - 1)
    off = float(np.abs(numbers - (numbers[0] + step * np.arange(n))).max())
    if off <= 1e-9 * float(np.abs(numbers).max()):
        return True
    decimals = (k for k in range(MAX_DECIMALS) if np.allclose(numbers, np.round(numbers, k), rtol=0, atol=1e-9))
    resolution = 10.0 ** -next(decimals, MAX_DECIMALS)
    return bool(off <= resolution and abs(step) >= 3 * resolution)


@dataclass(frozen=True)
class TrimmedMatrix:
    """A matrix without its labels, and notes on what was left out."""

    values: np.ndarray
    notes: tuple[str, ...] = ()


def remove_labels(
    values: np.ndarray, choice: str | None, is_whole: Callable[[int, int], bool | None], edge: np.ndarray | None = None
) -> TrimmedMatrix:
    """The image (rows, columns) of a matrix, in which words are inf and missing cells NaN.

    An outer line holds labels if it counts evenly and does not continue its neighbours.  `is_whole(rows, columns)`:
    whether a complete image can have that size, None if unknown.  `edge`: labels above all columns but the first.
    BadInput asks for `choice` (none, columns, rows or both) if labels and image cannot be distinguished.
    """
    values, notes = _without_words(values)
    if choice is not None:
        return _remove_stated_labels(values, choice, notes)
    if edge is not None and len(edge) == values.shape[1] - 1:
        if not is_evenly_spaced(values[:, 0]):
            raise BadInput(
                f"{len(edge)} numbers that count evenly stand above {values.shape[1]} columns: labels without a corner,"
                " or a row that is cut off; repair that line, or remove it and give the rest"
            )
        return TrimmedMatrix(
            values[:, 1:], (*notes, f"labels left out: columns {_span_text(edge)}, rows {_span_text(values[:, 0])}")
        )
    while True:  # numbers of columns may be above their positions
        rest, note = _without_outer_labels(values, is_whole)
        if note is None:
            return TrimmedMatrix(values, tuple(notes))
        values, notes = rest, [*notes, note]


def _without_outer_labels(
    values: np.ndarray, is_whole: Callable[[int, int], bool | None]
) -> tuple[np.ndarray, str | None]:
    """A matrix without a line of labels on one or two of its sides, and a note; None if there is none."""
    rows, columns = values.shape
    if columns < FEWEST_COLUMNS or rows < MIN_LABELS + 1 or rows > MAX_ROWS_PER_COLUMN * columns:
        return values, None  # no image, which `check_matrix` reports
    outer_row, outer_column = _find_label_line(values), _find_label_line(values.T)
    if outer_row.evidence and outer_column.evidence:
        return _remove_both_lines(values, outer_row, outer_column, is_whole)
    if outer_row.evidence and _is_label(outer_row, "columns", is_whole(rows, columns), is_whole(rows - 1, columns)):
        return outer_row.remove_from(values), f"labels left out: columns {_span_text(outer_row.labels)}"
    if outer_column.evidence and _is_label(outer_column, "rows", is_whole(rows, columns), is_whole(rows, columns - 1)):
        return outer_column.remove_from(values.T).T, f"labels left out: rows {_span_text(outer_column.labels)}"
    return values, None


@dataclass(frozen=True)
class OuterLine:
    """The first (`at` 1) or last (-1) line of a matrix, if it counts evenly and its neighbour does not continue it.

    `evidence`: 0 for no such line; LABEL_POSSIBLE if its numbers are as near to the next line as lines of the image are
    to each other, LABEL_LIKELY if they are not, LABEL_CERTAIN if they are far from it or the corner is no number.
    `corners`: cells before the labels.
    """

    at: int = 1
    evidence: int = 0
    labels: np.ndarray = field(default_factory=lambda: np.empty(0))
    corners: int = 0

    def remove_from(self, matrix: np.ndarray) -> np.ndarray:
        """The matrix without that line."""
        return matrix[1:] if self.at > 0 else matrix[:-1]


def _find_label_line(matrix: np.ndarray) -> OuterLine:
    """The first or last line of a matrix that can be labels; one without evidence if there is none."""
    for at in (1, -1):
        lines = matrix[::at]
        for inner in _label_slices(lines[0]):
            if not is_evenly_spaced(lines[0][inner]):
                continue
            jump, spread = _edge_distances(lines)
            if jump <= SEPARATE_DISTANCE and (
                is_evenly_spaced(lines[1][inner]) or max(jump, spread) <= SIMILAR_DISTANCE
            ):  # it goes on as a gradient
                break
            corner = not np.isfinite(lines[0]).all()
            before = int(np.argmax(np.isfinite(lines[0])))
            doubt = (
                LABEL_CERTAIN
                if jump > SEPARATE_DISTANCE or (corner and jump > SIMILAR_DISTANCE)
                else LABEL_LIKELY
                if jump > SIMILAR_DISTANCE
                else LABEL_POSSIBLE
            )
            return OuterLine(at, doubt, lines[0][inner], before)
    return OuterLine()


def _label_slices(line: np.ndarray) -> list[slice]:
    """Parts of a line that can be labels: without corner cells that are no numbers, or without one corner."""
    known = np.flatnonzero(np.isfinite(line))
    if len(known) == 0 or len(line) - len(known) > MAX_CORNER_CELLS:
        return []
    whole = slice(int(known[0]), int(known[-1]) + 1)
    return [whole, slice(1, None), slice(None, -1)]


def _remove_both_lines(
    values: np.ndarray, outer_row: OuterLine, outer_column: OuterLine, is_whole: Callable[[int, int], bool | None]
) -> tuple[np.ndarray, str | None]:
    """A matrix without an outer row and an outer column, if they are labels, and a note.  Raises BadInput."""
    rows, columns = values.shape
    whole, rest = is_whole(rows, columns), is_whole(rows - 1, columns - 1)
    if whole and not rest and max(outer_row.evidence, outer_column.evidence) < LABEL_CERTAIN:
        return values, None
    if not rest and outer_row.evidence + outer_column.evidence < 2 * LABEL_LIKELY:
        raise BadInput(
            f"its outer row and column count evenly ({_span_text(outer_row.labels)}, {_span_text(outer_column.labels)})"
            " and read like the image: labels, or a part of it; say --labels both or --labels none"
        )
    note = f"labels left out: columns {_span_text(outer_row.labels)}, rows {_span_text(outer_column.labels)}"
    image = _remove_more_lines(outer_column.remove_from(outer_row.remove_from(values).T), outer_row.corners - 1).T
    return _remove_more_lines(image, outer_column.corners - 1), note


def _remove_more_lines(lines: np.ndarray, most: int) -> np.ndarray:
    """A matrix without up to `most` further lines of labels, such as numbers next to positions."""
    while most > 0 and is_evenly_spaced(lines[0][np.isfinite(lines[0])]):
        lines, most = lines[1:], most - 1
    return lines


def _is_label(side: OuterLine, name: str, whole: bool | None, rest: bool | None) -> bool:
    """Whether a line on one side alone holds labels.  BadInput if that cannot be decided.

    A column that counts is more often a time or a counter than a label, so the size of the image must support it.
    """
    if rest and not whole:
        return True
    if whole and not rest and side.evidence < (LABEL_CERTAIN if name == "columns" else LABEL_LIKELY):
        return False
    if name == "columns" and side.evidence == LABEL_CERTAIN and not whole:
        return True
    place = "first" if side.at > 0 else "last"
    line, what = ("row", "labels of columns") if name == "columns" else ("column", "labels of rows, times or a counter")
    raise BadInput(
        f"its {place} {line} counts evenly, {_span_text(side.labels)}: {what}, or a part of the image; say --labels"
        f" {name} or --labels none, or give --view points with a logger's table"
    )


def _without_words(values: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """A matrix without the columns of words at its edges: names of rows, remarks."""
    notes = []
    for name, edge in (("names of rows", 0), ("remarks after the rows", -1)):
        column = values[:, edge]
        body = column[1:] if len(values) > 1 and np.isfinite(column[0]) and edge == 0 else column
        if values.shape[1] > 1 and np.isinf(body).any() and not np.isfinite(column).any():
            values = np.delete(values, edge, axis=1)
            notes.append(f"{name} left out")
    return values, notes


def _remove_stated_labels(values: np.ndarray, choice: str, notes: list[str]) -> TrimmedMatrix:
    """The matrix without the labels that the user stated with `choice`, "columns", "rows", "both" or "none".

    Labels of columns stand in the first row, which is left out; labels of rows in the first column.
    """
    columns, rows = choice in ("columns", "both"), choice in ("rows", "both")
    if columns:
        notes = [*notes, "the first row left out: labels, as stated by --labels"]
    if rows:
        notes = [*notes, "the first column left out: labels, as stated by --labels"]
    return TrimmedMatrix(values[int(columns) :, int(rows) :], tuple(notes))


def _edge_distances(lines: np.ndarray) -> tuple[float, float]:
    """Distance of the first line from the second, in level and in shape, in units of that between other neighbours."""
    with np.errstate(invalid="ignore"):
        steps = np.diff(np.where(np.isfinite(lines), lines, np.nan), axis=0)
    known = [step[np.isfinite(step)] for step in steps]
    found = []
    for of in (lambda step: np.median(np.abs(step)), np.std):
        values = np.array([float(of(step)) if step.size else 0.0 for step in known])
        usual = float(np.median(values[1:])) if len(values) > 1 else 0.0
        found.append(float(values[0]) / usual if usual > 0 else (np.inf if values[0] > 0 else 0.0))
    return found[0], found[1]


def _span_text(labels: np.ndarray) -> str:
    return f"{labels[0]:g} to {labels[-1]:g}"
