"""Draw the tower of packages from the imports as they are.

Left the packages, floor by floor, with what each is for and its modules; right who imports whom.  `make docs` draws it
(docs/reference_pages.py); so it is never out of date.
"""

from __future__ import annotations

import ast
import textwrap
from collections import defaultdict
from dataclasses import dataclass
from html import escape
from pathlib import Path

ROOT = Path(__file__).parent.parent
BESIDE = ("meshes", "viz")  # stand in the project's root and are installed inside flashtemp

WIDTH, LEFT, LINE, PAD, GAP = 1180, 720, 16, 12, 10  # px: drawing, boxes, lines of text, inside and between boxes
CELL, LETTER, SMALL = 24, 6.4, 11.5  # px: of the matrix, a small letter's width and height
INK, FAINT, PAPER, BAR = "#1b1b1b", "#666666", "#ffffff", "#0072B2"


@dataclass(frozen=True)
class Package:
    """A room of the tower: `says` its first line, `modules` in it by folder, `uses` the packages it imports."""

    name: str
    says: str
    modules: dict[str, tuple[str, ...]]
    uses: frozenset[str]


def files() -> dict[str, list[Path]]:
    """Python files of every package at the top of flashtemp, and of those beside it."""
    found = defaultdict(list)
    for folder in (ROOT / "flashtemp", *(ROOT / name for name in BESIDE)):
        for file in sorted(folder.rglob("*.py")):
            parts = file.relative_to(ROOT).with_suffix("").parts
            top = parts[0] if parts[0] in BESIDE else parts[1]
            if top != "__init__":
                found[top].append(file)
    return dict(found)


def imported(file: Path, names) -> set[str]:
    """Which of the packages a file imports, also inside its functions."""
    out = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        dotted = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            dotted = [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
        for name in dotted:
            own, _, rest = name.partition(".")
            if own == "flashtemp" and rest:
                out.add(rest.split(".")[0])
    return out & set(names)


def packages() -> dict[str, Package]:
    """Every package with its first line, modules and imports."""
    rooms = files()
    out = {}
    for name, own in rooms.items():
        folder = ROOT / (name if name in BESIDE else f"flashtemp/{name}")
        head = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
        says = (ast.get_docstring(ast.parse(head.read_text(encoding="utf-8"))) or "").splitlines()[0]
        modules = defaultdict(list)
        for file in own:
            if file.stem != "__init__" and folder.is_dir():
                modules[file.relative_to(folder).parent.as_posix()].append(file.stem)
        uses = frozenset(set().union(*(imported(f, rooms) for f in own)) - {name})
        out[name] = Package(name, says, {k: tuple(v) for k, v in modules.items()}, uses)
    return out


def floors(rooms: dict[str, Package]) -> list[list[str]]:
    """Names floor by floor from the ground: every package stands above all that it imports."""
    level: dict[str, int] = {}
    while len(level) < len(rooms):
        able = [n for n, p in rooms.items() if n not in level and p.uses <= set(level)]
        if not able:
            raise SystemExit(f"imports run in a circle among {sorted(set(rooms) - set(level))}")
        for n in able:
            level[n] = 1 + max((level[u] for u in rooms[n].uses), default=-1)
    return [sorted(n for n in level if level[n] == f) for f in range(max(level.values()) + 1)]


def words(room: Package, width: float) -> list[tuple[str, str]]:
    """Lines of a box as (style, text)."""
    chars = int((width - 2 * PAD) / LETTER)
    lines = [("name", room.name + ("/" if room.modules else ""))]
    lines += [("says", t) for t in textwrap.wrap(room.says, chars)]
    for folder, names in sorted(room.modules.items()):
        text = f"{len(names)} files, one effect each" if folder == "effects" else ", ".join(names)
        label = "" if folder == "." else f"{folder}/: "
        lines += [("modules", t) for t in textwrap.wrap(label + text, chars)]
    return lines


def box(room: Package, x: float, y: float, width: float, height: float) -> list[str]:
    """One room of the tower as SVG."""
    out = [
        f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" class="room"/>',
        f'<rect x="{x:g}" y="{y:g}" width="4" height="{height:g}" class="bar"/>',
    ]
    for n, (style, text) in enumerate(words(room, width)):
        out.append(f'<text x="{x + PAD:g}" y="{y + PAD + 11 + n * LINE:g}" class="{style}">{escape(text)}</text>')
    return out


def matrix(rooms: dict[str, Package], order: list[str], middle: dict[str, float]) -> list[str]:
    """Who imports whom: a row beside every room, a column per package, all marks below the diagonal."""
    left = WIDTH - CELL * len(order) - 20
    place = {name: left + CELL * (n + 0.5) for n, name in enumerate(order)}
    top, bottom = min(middle.values()) - 26, max(middle.values()) + 14
    out = []
    for name in order:
        x = place[name]
        out.append(f'<line x1="{x:g}" y1="{top + 20:g}" x2="{x:g}" y2="{bottom:g}" class="rule"/>')
        out.append(f'<text transform="translate({x + 4:g} {top + 14:g}) rotate(-60)" class="column">{name}</text>')
    for name in order:
        y = middle[name]
        out.append(f'<text x="{left - 8:g}" y="{y + 4:g}" class="row">{name}</text>')
        out.append(f'<rect x="{place[name] - 6:g}" y="{y - 6:g}" width="12" height="12" class="self"/>')
        out += [f'<circle cx="{place[u]:g}" cy="{y:g}" r="5" class="mark"/>' for u in sorted(rooms[name].uses)]
    return out


def draw() -> str:
    """The drawing as SVG."""
    rooms = packages()
    tower = floors(rooms)[::-1]
    y = 96.0
    body, middle = [], {}
    for floor in tower:
        width = (LEFT - GAP * (len(floor) - 1)) / len(floor)
        height = 2 * PAD + LINE * max(len(words(rooms[n], width)) for n in floor) - 4
        for n, name in enumerate(floor):
            body += box(rooms[name], 20 + n * (width + GAP), y, width, height)
            middle[name] = y + height / 2 + (n - (len(floor) - 1) / 2) * 18
        y += height + GAP
    order = [name for floor in tower for name in floor]
    style = (
        f"text{{font-family:Helvetica,Arial,sans-serif;font-size:{SMALL}px;fill:{INK}}} .modules{{fill:{FAINT}}}"
        f" .name{{font-size:15px;font-weight:bold}} .title{{font-size:17px;font-weight:bold}} .row{{text-anchor:end}}"
        f" .room{{fill:#f4f4f2}} .bar,.mark{{fill:{BAR}}} .self{{fill:#d9d9d6}} .rule{{stroke:#e3e3e0}}"
    )
    text = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {y + 10:g}" width="{WIDTH}">',
        f"<style>{style}</style>",
        f'<rect width="{WIDTH}" height="{y + 10:g}" fill="{PAPER}"/>',
        '<text x="20" y="34" class="title">flashtemp, floor by floor</text>',
        '<text x="20" y="56" class="says">A package imports only from floors below it; '
        "drawn from the imports by docs/architecture.py</text>",
        f'<text x="{LEFT + 60}" y="34" class="title">who imports whom</text>',
        *body,
        *matrix(rooms, order, middle),
        "</svg>",
    ]
    return "\n".join(text) + "\n"
