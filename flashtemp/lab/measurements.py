"""Measurements on frames of temperatures: spots, boxes and lines, for one frame, over time, and along a line."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from flashtemp.camera.importing.rectification import apply_homography

Array = npt.NDArray[np.float64]
Point = tuple[float, float]  # column, row; the middle of the upper left pixel is 0, 0
KIND_POINTS: Final = {"spot": 1, "box": 2, "line": 2}  # number of points of a measurement
STATISTICS: Final = ("mean", "min", "max", "sd")
MAX_NAME_LENGTH = 40  # of the name of a measurement
FRAMES_AT_ONCE = 64  # that are read together


@dataclass(frozen=True)
class Measurement:
    """A spot (one point), a box (two opposite corners) or a line (two ends) with its `name`."""

    name: str
    kind: str
    points: tuple[Point, ...]

    def pixels_of(self, frames: Array) -> Array:
        """Values (n, pixels) of the pixels that count, of frames (n, rows, columns); NaN where unknown."""
        rows, columns = frames.shape[1:]
        if self.kind == "line":
            return interpolate_frames(frames, self.sample_points())
        c = np.clip(np.rint([p[0] for p in self.points]).astype(int), 0, columns - 1)
        r = np.clip(np.rint([p[1] for p in self.points]).astype(int), 0, rows - 1)
        box = frames[:, r.min() : r.max() + 1, c.min() : c.max() + 1]
        return np.asarray(box, float).reshape(len(frames), -1)

    def sample_points(self) -> Array:
        """Points (n, 2) along a line, at most one pixel apart."""
        a, b = np.array(self.points[0]), np.array(self.points[-1])
        share = np.linspace(0.0, 1.0, int(np.ceil(np.hypot(*(b - a)))) + 1)[:, None]
        return np.asarray(a + share * (b - a), float)


def read_numbers(values: object, count: int) -> list[float]:
    """`count` finite numbers of a list; [] where it is no such list.

    >>> read_numbers([1, 2.5], 2), read_numbers([1, "x"], 2), read_numbers([1.0], 2)
    ([1.0, 2.5], [], [])
    """
    if not isinstance(values, list) or len(values) != count:
        return []
    plain = all(isinstance(v, (int, float)) and not isinstance(v, bool) and np.isfinite(v) for v in values)
    return [float(v) for v in values] if plain else []


def interpolate_frames(frames: Array, at: Array) -> Array:
    """Values (n, points) of frames (n, rows, columns) at columns and rows `at` (points, 2), linear between pixels."""
    rows, columns = frames.shape[1:]
    c, r = np.clip(at[:, 0], 0, columns - 1), np.clip(at[:, 1], 0, rows - 1)
    c0, r0 = np.floor(c).astype(int), np.floor(r).astype(int)
    c1, r1 = np.minimum(c0 + 1, columns - 1), np.minimum(r0 + 1, rows - 1)
    x, y = c - c0, r - r0
    corners = ((r0, c0, (1 - x) * (1 - y)), (r0, c1, x * (1 - y)), (r1, c0, (1 - x) * y), (r1, c1, x * y))
    out = np.zeros((len(frames), len(at)))
    for row, column, weight in corners:  # an unknown pixel counts only where it has a weight
        out += np.where(weight > 0, weight * np.asarray(frames[:, row, column], float), 0.0)
    return out


def summarise_values(values: Array) -> dict[str, Array]:
    """Mean, min, max and standard deviation (n,) of values (n, pixels), over the known ones."""
    known = np.isfinite(values)
    count = known.sum(axis=1)
    none = count == 0
    mean = np.where(known, values, 0.0).sum(axis=1) / np.maximum(count, 1)
    square = np.where(known, (values - mean[:, None]) ** 2, 0.0).sum(axis=1) / np.maximum(count, 1)
    found = {
        "mean": mean,
        "min": np.where(known, values, np.inf).min(axis=1),
        "max": np.where(known, values, -np.inf).max(axis=1),
        "sd": np.sqrt(square),
    }
    return {name: np.where(none, np.nan, value) for name, value in found.items()}


def read_measurements(kept: object, shape: tuple[int, int], most: int) -> list[Measurement]:
    """At most `most` measurements on images of that `shape` (rows, columns) from plain values; others are left out."""
    found: list[Measurement] = []
    for one in kept if isinstance(kept, list) else ():
        if not isinstance(one, dict) or len(found) >= most:
            continue
        points, kind = one.get("points"), one.get("kind")
        places = [read_numbers(p, 2) for p in points] if isinstance(points, list) else []
        inside = all(p and -1 <= p[0] <= shape[1] and -1 <= p[1] <= shape[0] for p in places)
        if isinstance(kind, str) and len(places) == KIND_POINTS.get(kind) and inside:
            name = str(one.get("name", ""))[:MAX_NAME_LENGTH] or kind.capitalize()
            found.append(Measurement(name, kind, tuple((p[0], p[1]) for p in places)))
    return found


def measure_frames(frames: Array, measurement: Measurement) -> dict[str, Array]:
    """Mean, min, max and standard deviation (n,) of a measurement in every frame (n, rows, columns), degC."""
    parts = [
        summarise_values(measurement.pixels_of(frames[k : k + FRAMES_AT_ONCE]))
        for k in range(0, len(frames), FRAMES_AT_ONCE)
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in STATISTICS}


def profile_along(frame: Array, line: Measurement, to_metres: Array | None = None) -> tuple[Array, Array]:
    """Distance from the first end and value (n,) along a line of a frame (rows, columns).

    The distance is in mm with the map `to_metres` (3, 3) from pixels to m, else in pixels.
    """
    at = line.sample_points()
    placed = at if to_metres is None else 1e3 * apply_homography(to_metres, at)
    steps = np.hypot(*np.diff(placed, axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)]), interpolate_frames(frame[None], at)[0]


def write_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table as CSV; unknown numbers are empty cells."""
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow(header)
    for row in rows:
        writer.writerow(["" if isinstance(v, float) and not np.isfinite(v) else v for v in row])
    return out.getvalue()


def curves_table(
    measurements: Sequence[Measurement], curves: Sequence[dict[str, Array]], time: Array, unit: str
) -> str:
    """Curves over time of all measurements as CSV: frame, time, then value, or mean, min, max and sd of each."""
    columns = [
        (f"{m.name} {name}, {unit}" if m.kind != "spot" else f"{m.name}, {unit}", curve[name])
        for m, curve in zip(measurements, curves, strict=True)
        for name in (STATISTICS if m.kind != "spot" else STATISTICS[:1])
    ]
    rows = ([k, f"{t:.6g}", *(round(float(c[k]), 4) for _, c in columns)] for k, t in enumerate(time))
    return write_table(["frame", "time, s", *(name for name, _ in columns)], rows)
