"""Drawings of the pages as shapes: data that the browser draws as SVG in the colours of the style sheet."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

from nicegui.element import Element

from flashtemp.lab.workspace import escape_control

Shape = dict[str, Any]  # {"tag": name of an SVG element, attributes, and the "text" inside it}
ARROW_HEAD_PX: Final = 7.0


class Drawing(Element, component="assets/drawing.js"):  # type: ignore[call-arg]  # mypy skips nicegui
    """An SVG drawing with shapes in a view box of `width` by `height`; `about` is its text for screen readers."""

    def __init__(self, width: float, height: float, about: str, shapes: Iterable[Shape] = ()):
        super().__init__()
        self._props["box"] = f"0 0 {width:g} {height:g}"
        self.draw(shapes, about)

    def draw(self, shapes: Iterable[Shape], about: str) -> None:
        """Replace the shapes and the description."""
        self._props["shapes"], self._props["label"] = list(shapes), escape_control(about)
        self.update()


def rectangle(x: float, y: float, width: float, height: float, kind: str) -> Shape:
    """A rectangle with the class `kind` of the style sheet."""
    return {"tag": "rect", "class": kind} | _rounded(x=x, y=y, width=max(width, 0.0), height=max(height, 0.0))


def line(x1: float, y1: float, x2: float, y2: float, kind: str) -> Shape:
    """A straight line."""
    return {"tag": "line", "class": kind} | _rounded(x1=x1, y1=y1, x2=x2, y2=y2)


def polyline(points: Sequence[tuple[float, float]], kind: str, closed: bool = False) -> Shape:
    """A line through points, closed to an area where required."""
    path = "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in points) + ("Z" if closed else "")
    return {"tag": "path", "class": kind, "d": path}


def circle(x: float, y: float, r: float, kind: str) -> Shape:
    """A circle of radius r."""
    return {"tag": "circle", "class": kind} | _rounded(cx=x, cy=y, r=r)


def words(
    x: float, y: float, text: str, kind: str = "ft-d-text", anchor: str = "middle", upward: bool = False
) -> Shape:
    """A text with its baseline at y; `anchor` is "start", "middle" or "end", and `upward` turns it by 90 degrees."""
    shape = {"tag": "text", "class": kind, "text-anchor": anchor, "text": escape_control(text)} | _rounded(x=x, y=y)
    return shape | ({"transform": f"rotate(-90 {x:.2f} {y:.2f})"} if upward else {})


def arrow(x1: float, y1: float, x2: float, y2: float, kind: str = "ft-d-arrow") -> list[Shape]:
    """An arrow from the first to the second point."""
    length = max(((x2 - x1) ** 2 + (y2 - y1) ** 2) ** 0.5, 1e-9)
    along, across = ((x2 - x1) / length, (y2 - y1) / length), (-(y2 - y1) / length, (x2 - x1) / length)
    back = [
        (x2 - ARROW_HEAD_PX * along[0] + s * across[0], y2 - ARROW_HEAD_PX * along[1] + s * across[1])
        for s in (0.45 * ARROW_HEAD_PX, -0.45 * ARROW_HEAD_PX)
    ]
    return [line(x1, y1, x2, y2, kind), polyline([(x2, y2), *back], f"{kind} ft-d-solid", closed=True)]


def dimension(x1: float, y1: float, x2: float, y2: float, text: str) -> list[Shape]:
    """A dimension line between two points, horizontal or vertical, with end marks and its text beside it."""
    is_level = abs(y2 - y1) < abs(x2 - x1)
    dx, dy = (0.0, 4.0) if is_level else (4.0, 0.0)
    ends = [line(x - dx, y - dy, x + dx, y + dy, "ft-d-dimension") for x, y in ((x1, y1), (x2, y2))]
    at = ((x1 + x2) / 2, y1 + 15) if is_level else (x1 + 15, (y1 + y2) / 2)
    return [line(x1, y1, x2, y2, "ft-d-dimension"), *ends, words(*at, text, "ft-d-number", upward=not is_level)]


def _rounded(**places: float) -> dict[str, float]:
    return {name: round(value, 2) for name, value in places.items()}
