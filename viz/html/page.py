"""Parts of the HTML reports: style, page, contents list, tables, folded sections, figures and terms."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from html import escape

PAGE_STYLE = """
body { font: 16px/1.5 system-ui, "Segoe UI", Helvetica, Arial, sans-serif; color: #1a1a1a; background: #fff;
  max-width: 66rem; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.6rem; line-height: 1.25; margin-bottom: .2rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .5rem; padding-bottom: .2rem; border-bottom: 1px solid #bbb; }
h3 { font-size: 1rem; margin: 1.8rem 0 .3rem; }
p, dd { max-width: 46rem; }
.small { font-size: .85rem; color: #444; }
.verdict { border-left: .3rem solid #999; padding: .1rem 0 .1rem .8rem; margin: .8rem 0; }
.good { border-color: #1fa37a; } .near { border-color: #e69f00; } .bad { border-color: #c8420b; }
.verdict p { margin: .15rem 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .8rem; line-height: 1.35; font-variant-numeric: tabular-nums; }
th, td { text-align: right; vertical-align: top; padding: .3rem .55rem; border-bottom: 1px solid #ddd; }
th { border-bottom: 1px solid #555; vertical-align: bottom; font-weight: 600; }
th:first-child, td:first-child, .text { text-align: left; }
nav ul { list-style: none; padding: 0; margin: .3rem 0; columns: 2; font-size: .9rem; max-width: 46rem; }
a { color: #0b5c8a; } details { margin: .6rem 0; } summary { cursor: pointer; font-size: .9rem; color: #0b5c8a; }
figure { margin: 1rem 0; } img { width: 100%; height: auto; }
figcaption { font-size: .85rem; color: #444; }
dt { font-weight: 600; margin-top: .6rem; } dd { margin-left: 1.2rem; }
@media print {
  body { max-width: none; margin: 0; padding: 0; font-size: 10pt; }
  table { font-size: 7pt; } th, td { padding: 1pt 3pt; } .wide { overflow: visible; }
  details::details-content { content-visibility: visible; block-size: auto; }
  figure, .verdict, tr { break-inside: avoid; } h2, h3 { break-after: avoid; }
}
"""


def render_page(title: str, body: list[str], extra_style: str = "") -> str:
    """A self-contained HTML file from the parts of its `body`; `extra_style` is appended to the style sheet."""
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8" />',
            '<meta name="viewport" content="width=device-width, initial-scale=1" />',
            f"<title>{escape(title)}</title>",
            f"<style>{PAGE_STYLE}{extra_style}</style>",
            "</head>",
            "<body>",
            *body,
            "</body>",
            "</html>",
            "",
        ]
    )


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph of plain text; `kind` is a class of the style sheet."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def term_list(pairs: Iterable[tuple[str, str]]) -> str:
    """A list of terms with their definitions."""
    return "\n".join(["<dl>", *(f"<dt>{escape(t)}</dt>\n<dd>{escape(text)}</dd>" for t, text in pairs), "</dl>"])


def heading(text: str, anchor: str, level: int = 2) -> str:
    """The heading of a section; the contents list links to its `anchor`."""
    return f'<h{level} id="{escape(anchor)}">{escape(text)}</h{level}>'


def contents_list(sections: Iterable[tuple[str, str]]) -> str:
    """A list of links to `sections` (anchor, heading)."""
    items = (f'<li><a href="#{escape(anchor)}">{escape(text)}</a></li>' for anchor, text in sections)
    return "\n".join(['<nav aria-label="contents">', "<ul>", *items, "</ul>", "</nav>"])


def fold_section(title: str, parts: Iterable[str]) -> str:
    """Parts of a page that are folded under a title until it is clicked."""
    return "\n".join([f"<details>\n<summary>{escape(title)}</summary>", *parts, "</details>"])


def table(head: list[str], rows: list[list[str]]) -> str:
    """An HTML table of text; columns with more than numbers are aligned left, with their heads."""
    words = {k for row in rows for k, text in enumerate(row) if len(text) > 24}

    def line(tag: str, texts: list[str]) -> str:
        kinds = (' class="text"' if k in words else "" for k in range(len(texts)))
        return "".join(f"<{tag}{kind}>{escape(text)}</{tag}>" for kind, text in zip(kinds, texts, strict=True))

    lines = [line("td", row) for row in rows]
    body = "\n".join(f"<tr>{cells}</tr>" for cells in lines)
    top = line("th", head)
    return f'<div class="wide">\n<table>\n<thead><tr>{top}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>\n</div>'


def embed_figure(fig, alt: str, caption: str) -> str:
    """A figure embedded as PNG with its caption; `alt` describes it to readers who cannot see it."""
    from flashtemp.viz.theme import FIGURE_DPI

    buffer = io.BytesIO()
    fig.savefig(buffer, format="png", dpi=FIGURE_DPI)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    source = f'<img src="data:image/png;base64,{data}" alt="{escape(alt)}" />'
    return f"<figure>\n{source}\n<figcaption>{escape(caption)}</figcaption>\n</figure>"
