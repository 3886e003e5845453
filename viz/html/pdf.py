"""A report as PDF: the HTML file laid out for A4 by WeasyPrint, which needs no browser."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from flashtemp.display import atomic_write
from flashtemp.errors import BadInput, describe_exception
from flashtemp.viz.html.page import PRINT_STYLE

MAX_REPORT_BYTES = 256 * 2**20  # of the HTML file
MAX_DEPTH, MAX_SPAN = 200, 1000  # nested elements, and cells that one table cell covers; larger ones fill the memory


def import_library() -> Any:
    """WeasyPrint.  Raises BadInput where it is not installed, or where its library Pango is missing."""
    try:
        import weasyprint
    except ModuleNotFoundError as fault:
        if (fault.name or "").partition(".")[0] != "weasyprint":
            raise
        raise BadInput("--pdf: WeasyPrint is not installed; pip install 'flashtemp[report]'") from fault
    except OSError as fault:  # the shared library of the system
        raise BadInput(
            "--pdf: WeasyPrint finds no Pango on this system; install it (Debian: apt install libpango-1.0-0 "
            "libpangoft2-1.0-0), or print report.html from a browser"
        ) from fault
    return weasyprint


def write_pdf(report: Path, path: Path) -> Path:
    """Write the HTML file `report` as PDF with tags for screen readers; returns the path.

    Only pictures inside the file are read: an address in a report of unknown origin is never opened.  Raises BadInput.
    """
    library = import_library()
    if report.stat().st_size > MAX_REPORT_BYTES:
        raise BadInput(f"{report}: larger than {MAX_REPORT_BYTES // 2**20} MiB; print it from a browser")
    from weasyprint.urls import URLFetcher

    try:
        with warnings.catch_warnings(action="ignore"):
            document = library.HTML(
                string=report.read_text(encoding="utf-8"),
                base_url="about:blank",
                url_fetcher=URLFetcher(allowed_protocols=["data"]),
            )
            _check_tree(document.etree_element, report)
            # reports of earlier releases have no rules for pages
            style = library.CSS(string=PRINT_STYLE)
            with atomic_write(path) as unfinished:
                document.write_pdf(unfinished, stylesheets=[style], pdf_tags=True)
    except (BadInput, OSError):
        raise
    except Exception as fault:  # the library fails in many ways on pages that no release of flashtemp writes
        reason = describe_exception(fault)
        raise BadInput(f"{report}: cannot be laid out as PDF ({reason}); print it from a browser") from fault
    return path


def _check_tree(root: Any, report: Path) -> None:
    """Check that the elements of a report are nested and spanned within limits.  Raises BadInput."""
    level, depth = [root], 0
    while level:
        depth += 1
        spans = (element.get(name, "").strip() for element in level for name in ("colspan", "rowspan", "span"))
        if depth > MAX_DEPTH or any(span.isdigit() and (len(span) > 4 or int(span) > MAX_SPAN) for span in spans):
            raise BadInput(
                f"{report}: nests more than {MAX_DEPTH} elements or joins more than {MAX_SPAN} table cells; "
                "print it from a browser"
            )
        level = [child for element in level for child in element]
