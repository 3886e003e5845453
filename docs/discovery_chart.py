"""Draw the flow chart of docs/explanation/discovery_method.md; `make docs` does it (docs/reference_pages.py).

Every step names the modules that do it; tests/structure/test_docs.py checks that they exist.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "flashtemp" / "discovery"

WIDTH, LEFT, BOX, HEIGHT, GAP, TOP = 900, 20, 560, 66, 22, 20  # px: drawing, left edge, boxes, between and above them
LANE, BEYOND = 70, 210  # px: from boxes to the line of a loop, and to the box beside them
INK, FAINT, PAPER, BAR = "#1b1b1b", "#666666", "#ffffff", "#0072B2"


@dataclass(frozen=True)
class Step:
    """A step of discovery: what it `does`, and the `modules` of flashtemp/discovery that do it."""

    name: str
    does: str
    modules: tuple[str, ...]


STEPS = (
    Step("prepare", "screen the frames, average long recordings, collect priors",
         ("prediction/problem", "prediction/frame_averaging")),
    Step("correct recordings", "mirrored, exchanged, of another condition, far from where they are stated",
         ("measurement_errors/recording_errors", "measurement_errors/initial_registration")),
    Step("calibrate", "coarser meshes, best point of the stated case, sensitivities of all candidates",
         ("estimation/fitting", "estimation/image_alignment")),
    Step("score", "ln Bayes factor of every candidate by its sensitivities", ("selection/scores",)),
    Step("fit", "the best three, and the best pair, in full", ("estimation/fitting", "estimation/trust_region")),
    Step("select", "accept the extension with the largest evidence, if it pays for its parameters",
         ("selection/forward_selection",)),
    Step("judge", "adequacy, left-out data, stated inputs, size of the effect; then one table of rules",
         ("diagnostics/adequacy_tests", "diagnostics/setup_errors", "decision")),
)  # fmt: skip
LAW = Step("identify a law", "free-form laws of every quantity", ("law_identification",))
AGAIN = ("accepted:", "score again", "(at most twice)")


def middle(number: int) -> float:
    """Height (px) of the middle of a step's box."""
    return TOP + number * (HEIGHT + GAP) + HEIGHT / 2


def box(step: Step, x: float, y: float, width: float) -> list[str]:
    """One step as SVG, `y` its middle."""
    top = y - HEIGHT / 2
    lines = [("name", step.name), ("says", step.does), ("modules", ", ".join(f"{m}.py" for m in step.modules))]
    out = [
        f'<rect x="{x:g}" y="{top:g}" width="{width:g}" height="{HEIGHT}" class="room"/>',
        f'<rect x="{x:g}" y="{top:g}" width="4" height="{HEIGHT}" class="bar"/>',
    ]
    for n, (style, text) in enumerate(lines):
        out.append(f'<text x="{x + 14:g}" y="{top + 20 + 18 * n:g}" class="{style}">{escape(text)}</text>')
    return out


def arrow(*points: tuple[float, float]) -> str:
    """A line through some points with a head at its end."""
    way = " ".join(f"{x:g},{y:g}" for x, y in points)
    return f'<polyline points="{way}" class="arrow" marker-end="url(#head)"/>'


def label(x: float, y: float, lines: tuple[str, ...]) -> list[str]:
    """Lines of text beside an arrow."""
    return [f'<text x="{x:g}" y="{y + 15 * n:g}" class="modules">{escape(t)}</text>' for n, t in enumerate(lines)]


def draw() -> str:
    """The drawing as SVG."""
    names = [s.name for s in STEPS]
    right, centre = LEFT + BOX, LEFT + BOX / 2
    body = []
    for n, step in enumerate(STEPS):
        body += box(step, LEFT, middle(n), BOX)
        body.append(arrow((centre, middle(n) + HEIGHT / 2), (centre, middle(n + 1) - HEIGHT / 2 - 2)))
    score, select, judge = (names.index(n) for n in ("score", "select", "judge"))
    lane = right + LANE
    body.append(
        arrow((right, middle(select)), (lane, middle(select)), (lane, middle(score)), (right + 2, middle(score)))
    )
    body += label(lane + 8, (middle(score) + middle(select)) / 2 - 15, AGAIN)
    body += box(LAW, right + LANE, middle(judge), BEYOND)
    body.append(arrow((right, middle(judge) - 12), (right + LANE - 2, middle(judge) - 12)))
    body.append(arrow((right + LANE, middle(judge) + 12), (right + 2, middle(judge) + 12)))
    body += label(right + 4, middle(judge) - HEIGHT / 2 - 3, ("if unexplained",))
    body += label(right + 4, middle(judge) + HEIGHT / 2 + 12, ("judged likewise",))
    end = middle(len(STEPS))
    body.append(f'<text x="{centre:g}" y="{end - HEIGHT / 2 + 18:g}" class="name" text-anchor="middle">verdict</text>')
    height = end - HEIGHT / 2 + 30
    style = (
        f"text{{font-family:Helvetica,Arial,sans-serif;font-size:12px;fill:{INK}}}"
        f" .modules{{fill:{FAINT};font-size:11px}} .name{{font-size:14px;font-weight:bold}}"
        f" .room{{fill:#f4f4f2}} .bar{{fill:{BAR}}} .head{{fill:{FAINT}}}"
        f" .arrow{{fill:none;stroke:{FAINT};stroke-width:1.4}}"
    )
    head = '<marker id="head" markerWidth="9" markerHeight="9" refX="7" refY="3.5" orient="auto">'
    text = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:g}" width="{WIDTH}">',
        f"<style>{style}</style>",
        f'<defs>{head}<path d="M0,0 L8,3.5 L0,7 z" class="head"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{height:g}" fill="{PAPER}"/>',
        *body,
        "</svg>",
    ]
    return "\n".join(text) + "\n"
