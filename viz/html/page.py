"""Parts of the HTML reports: style, page, contents list, tables, folded sections, figures and terms."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import NamedTuple

PRINT_STYLE = """
@page { size: A4; margin: 18mm 16mm 20mm; }
@page {
  @bottom-left { content: string(title); font: 8pt sans-serif; color: #444; }
  @bottom-right { content: "page " counter(page) " of " counter(pages); font: 8pt sans-serif; color: #444; }
}
@media print {
  html { font-size: 9.5pt; }
  body { max-width: none; margin: 0; padding: 0; font-size: 1rem; line-height: 1.4; color: #000; background: #fff; }
  h1 { font-size: 16pt; margin-top: 0; string-set: title content(); }
  h2 { font-size: 12pt; margin: 14pt 0 4pt; } h3 { font-size: 10pt; margin: 10pt 0 3pt; }
  h1, h2, h3, summary, caption { break-after: avoid; break-inside: avoid; }
  p, dd, li { orphans: 3; widows: 3; max-width: none; }
  dt, #reproduction + p { break-after: avoid; }
  figure, .verdict, tr, dd { break-inside: avoid; }
  figure { margin: 6pt 0; text-align: center; } img { width: auto; max-width: 100%; max-height: 165mm; }
  .narrow img { max-width: 125mm; } figcaption { text-align: left; }
  .title-page { break-after: page; }
  .wide { overflow: visible; } thead { display: table-header-group; }
  table { width: 100%; font-size: 7.5pt; } th, td { padding: 1.5pt 3pt; } td.text { overflow-wrap: anywhere; }
  .dense table { font-size: 6pt; } .dense th, .dense td { padding: 1pt 2pt; } table.facts { font-size: 8.5pt; }
  td.text { min-width: 0; max-width: none; } .facts .digest { font-size: 6.5pt; }
  nav ul { columns: 2; column-gap: 8mm; max-width: none; font-size: 7.5pt; line-height: 1.2; }
  nav { break-inside: avoid; } .title-page h2 { margin: 8pt 0 3pt; } .title-page p { margin: 4pt 0; }
  nav a { color: #000; text-decoration: none; }
  nav a::after { content: leader(".") target-counter(attr(href), page); }
  a[href^="http"]::after { content: " (" attr(href) ")"; overflow-wrap: anywhere; }
  details { border: 0; } summary { color: #000; font-weight: 600; list-style: none; display: block; }
  summary::marker, summary::-webkit-details-marker { content: ""; display: none; }
  details::details-content { content-visibility: visible; block-size: auto; }
}
"""
PAGE_STYLE = """
body { font: 16px/1.5 "Segoe UI", Helvetica, Arial, sans-serif; color: #1a1a1a; background: #fff;
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
thead th { border-bottom: 1px solid #555; vertical-align: bottom; font-weight: 600; }
th:first-child, td:first-child, .text, .word { text-align: left; } td.word { white-space: nowrap; }
.facts { font-size: .9rem; } .facts td { text-align: left; }
.facts th { font-weight: 400; color: #444; padding-left: 0; white-space: nowrap; }
.digest { font-family: monospace; font-size: .75rem; }
nav ul { list-style: none; padding: 0; margin: .3rem 0; columns: 2; font-size: .9rem; max-width: 46rem; }
nav .sub { padding-left: 1.2rem; }
a { color: #0b5c8a; } details { margin: .6rem 0; } summary { cursor: pointer; font-size: .9rem; color: #0b5c8a; }
figure { margin: 1rem 0; } img { width: 100%; height: auto; }
.narrow img { max-width: 46rem; }
figcaption { font-size: .85rem; color: #444; }
dt { font-weight: 600; margin-top: .6rem; } dd { margin-left: 1.2rem; }
"""
MAX_NARROW_WIDTH_IN = 6.0  # inches; a narrower picture is not stretched to the width of the page
MAX_PICTURE_BYTES, PNG_SIGNATURE = 64 * 2**20, b"\x89PNG\r\n\x1a\n"
MAX_WORD_LETTERS = 24  # a longer text in a cell may be broken into lines
NUMBER_START = re.compile(r"[-+−±(≤≥]?\s?\d|[–∞]$")
LONG_NAME = re.compile(r"[\w.-]{13,}")  # a key or a file name
DENSE_COLUMNS = 9  # a table with more is printed smaller


class Section(NamedTuple):
    """A section of a report: the `anchor` of its link, its `heading` and HTML `parts`; a subsection has `level` 3."""

    anchor: str
    heading: str
    parts: list[str]
    level: int = 2


@dataclass(frozen=True)
class ReportSubject:
    """What a report is about, as pairs of name and text: `facts` of the work and `conditions` of the test.

    `method`: how the result was computed, in a paragraph.  `files`: SHA-256 digests of all inputs.  `programs`:
    versions.
    """

    facts: tuple[tuple[str, str], ...]
    conditions: tuple[tuple[str, str], ...]
    method: str
    files: tuple[tuple[str, str], ...]
    programs: tuple[tuple[str, str], ...]


def render_report(
    title: str, answer: list[str], subject: ReportSubject | None, sections: Sequence[Section], extra_style: str = ""
) -> str:
    """A self-contained HTML file: title page with the `answer` and the list of contents, then the sections.

    With a `subject` the title page says what was run, the conditions and the method, and the last section what
    reproduces the result.
    """
    every = [*sections, *(_reproduction_section(subject) if subject else [])]
    body = [
        '<section class="title-page">' if subject else "<section>",
        f"<h1>{escape(title)}</h1>",
        *answer,
        *(_subject_lines(subject) if subject else []),
        contents_list(every),
        "</section>",
        *(line for s in every for line in (heading(s.heading, s.anchor, s.level), *s.parts)),
    ]
    return render_page(title, body, extra_style)


def _subject_lines(subject: ReportSubject) -> list[str]:
    """What was run, the conditions of the test and the method."""
    return [
        fact_table(subject.facts),
        heading("Conditions", "conditions"),
        fact_table(subject.conditions),
        heading("Method", "method"),
        paragraph(subject.method),
    ]


def _reproduction_section(subject: ReportSubject) -> list[Section]:
    """Digests of the inputs and versions of the programs."""
    parts = [
        paragraph("The same inputs and programs give the same numbers. Digests are SHA-256."),
        fact_table(subject.files, "digest"),
        fact_table([("programs", ", ".join(f"{name} {version}" for name, version in subject.programs))]),
    ]
    return [Section("reproduction", "Reproducibility", parts)]


def render_page(title: str, body: list[str], extra_style: str = "") -> str:
    """A self-contained HTML file from the parts of its `body`; `extra_style` is appended to the style sheet."""
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8" />',
            '<meta name="viewport" content="width=device-width, initial-scale=1" />',
            '<meta name="generator" content="flashtemp" />',
            f"<title>{escape(title)}</title>",
            f"<style>{PAGE_STYLE}{extra_style}{PRINT_STYLE}</style>",
            "</head>",
            "<body>",
            "<main>",
            *body,
            "</main>",
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


def contents_list(sections: Iterable[Section]) -> str:
    """A list of links to sections and subsections."""
    kinds = {2: "", 3: ' class="sub"'}
    items = (f'<li{kinds[s.level]}><a href="#{escape(s.anchor)}">{escape(s.heading)}</a></li>' for s in sections)
    return "\n".join(['<nav aria-label="Contents">', "<ul>", *items, "</ul>", "</nav>"])


def fold_section(title: str, parts: Iterable[str]) -> str:
    """Parts of a page that are folded under a title until it is clicked."""
    return "\n".join([f"<details>\n<summary>{escape(title)}</summary>", *parts, "</details>"])


def table(head: list[str], rows: list[list[str]]) -> str:
    """An HTML table of text; columns of words, or with long texts, are aligned left, with their heads."""
    long = {k for row in rows for k, text in enumerate(row) if len(text) > MAX_WORD_LETTERS}
    words = set(range(len(head))) - {k for row in rows for k, text in enumerate(row) if NUMBER_START.match(text)}
    kinds = [' class="text"' if k in long else ' class="word"' if k in words else "" for k in range(len(head))]
    top = "".join(f'<th scope="col"{kind}>{escape(text)}</th>' for kind, text in zip(kinds, head, strict=True))
    lines = (
        "".join(f"<td{kind}>{_breakable(text)}</td>" for kind, text in zip(kinds, row, strict=True)) for row in rows
    )
    body = "\n".join(f"<tr>{cells}</tr>" for cells in lines)
    dense = " dense" if len(head) > DENSE_COLUMNS else ""
    whole = f"<thead><tr>{top}</tr></thead>\n<tbody>\n{body}\n</tbody>"
    return f'<div class="wide{dense}">\n<table>\n{whole}\n</table>\n</div>'


def _breakable(text: str) -> str:
    """Text for a cell; a long key or file name may break after its points and underscores.

    >>> _breakable("block.heat_capacity"), _breakable("1.5 mm")
    ('block.<wbr />heat_<wbr />capacity', '1.5 mm')
    """
    return LONG_NAME.sub(lambda name: re.sub(r"(?<=\w)([._])(?=[a-zA-Z])", r"\1<wbr />", name[0]), escape(text))


def fact_table(pairs: Iterable[tuple[str, str]], kind: str = "") -> str:
    """A table of two columns: a name and what is true of it; `kind` is a class of the second column."""
    cell = f'<td class="{kind}">' if kind else "<td>"
    rows = [f'<tr><th scope="row">{escape(name)}</th>{cell}{escape(text)}</td></tr>' for name, text in pairs]
    body = "\n".join(rows)
    return f'<div class="wide">\n<table class="facts">\n<tbody>\n{body}\n</tbody>\n</table>\n</div>'


def embed_figure(fig, alt: str, caption: str) -> str:
    """A figure embedded as PNG with its caption; `alt` describes it to readers who cannot see it."""
    from flashtemp.viz.theme import FIGURE_DPI

    buffer = io.BytesIO()
    fig.savefig(buffer, format="png", dpi=FIGURE_DPI)
    return embed_png(buffer.getvalue(), alt, caption, is_narrow=fig.get_figwidth() < MAX_NARROW_WIDTH_IN)


def read_png(file: Path) -> bytes:
    """The content of a PNG file; nothing where it is missing, a link, too large or of another kind."""
    is_usable = file.is_file() and not file.is_symlink() and file.stat().st_size <= MAX_PICTURE_BYTES
    data = file.read_bytes() if is_usable else b""
    return data if data.startswith(PNG_SIGNATURE) else b""


def embed_png(data: bytes, alt: str, caption: str, is_narrow: bool = False) -> str:
    """A PNG file embedded with its caption."""
    text, kind = base64.b64encode(data).decode("ascii"), ' class="narrow"' if is_narrow else ""
    source = f'<img src="data:image/png;base64,{text}" alt="{escape(alt)}" />'
    return f"<figure{kind}>\n{source}\n<figcaption>{escape(caption)}</figcaption>\n</figure>"
