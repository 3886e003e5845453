"""A report as PDF: the HTML file laid out for A4 by WeasyPrint, which needs no browser."""

from __future__ import annotations

import subprocess
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

from flashtemp.display import atomic_write
from flashtemp.errors import BadInput, describe_exception
from flashtemp.runs.results.current_folder import make_python_command
from flashtemp.viz.html.page import PRINT_STYLE

MAX_REPORT_BYTES = 256 * 2**20  # of the HTML file
MAX_LAYOUT_S, MAX_LAYOUT_BYTES = 180, 4 * 2**30  # of the process that lays out; long reports take about 20 s
EXIT_REFUSED = 2
REFUSED_EVENTS = ("socket.connect", "socket.getaddrinfo", "subprocess.Popen", "os.system", "os.exec", "os.posix_spawn")
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


def write_pdf(report: Path, path: Path, time_limit: float = MAX_LAYOUT_S) -> Path:
    """Write the HTML file `report` as PDF with tags for screen readers; returns the path.

    A process of its own lays it out, for at most `time_limit` s and MAX_LAYOUT_BYTES of memory, and reads no other file
    and no network: pictures must be inside the HTML file, since a report may be of unknown origin.  Raises BadInput.
    """
    import_library()
    if report.is_symlink():
        raise BadInput(f"{report}: is a link; copy the file that it leads to into the folder")
    if report.stat().st_size > MAX_REPORT_BYTES:
        raise BadInput(f"{report}: larger than {MAX_REPORT_BYTES // 2**20} MiB; print it from a browser")
    with atomic_write(path) as unfinished:
        command, env = make_python_command("-m", __name__, str(report.absolute()), str(unfinished.absolute()))
        try:
            done = subprocess.run(
                command, env=env, timeout=time_limit, check=False, text=True, encoding="utf-8", errors="replace",
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            )  # fmt: skip
        except subprocess.TimeoutExpired as fault:
            words = f"not laid out within {time_limit:g} s"
            raise BadInput(f"{report}: {words}; print it from a browser") from fault
        if done.returncode:
            reason = done.stdout.strip().splitlines()
            words = reason[-1] if done.returncode == EXIT_REFUSED and reason else "the layout ended without a word"
            raise BadInput(f"{report}: cannot be laid out as PDF ({words}); print it from a browser")
    return path


def lay_out(report: Path, path: Path) -> int:
    """Write a report as PDF in this process, within limits; returns the exit code, a refusal is printed."""
    library = import_library()
    from weasyprint.urls import URLFetcher

    try:
        with warnings.catch_warnings(action="ignore"):
            text = report.read_text(encoding="utf-8")
            _limit_process()
            document = library.HTML(
                string=text, base_url="about:blank", url_fetcher=URLFetcher(allowed_protocols=["data"])
            )
            _check_tree(document.etree_element)
            # reports of earlier releases have no rules for pages
            style = library.CSS(string=PRINT_STYLE)
            document.write_pdf(path, stylesheets=[style], pdf_tags=True)
    except Exception as fault:  # the library fails in many ways on pages that no release of flashtemp writes
        print(" ".join(describe_exception(fault).split()))
        return EXIT_REFUSED
    return 0


def _limit_process() -> None:
    """Limit time and memory of this process, and refuse it the network and other programs, whatever a page asks for."""
    with suppress(ImportError, ValueError, OSError):  # not on every system; the time limit of the caller stays
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (MAX_LAYOUT_S, MAX_LAYOUT_S))
        resource.setrlimit(resource.RLIMIT_AS, (MAX_LAYOUT_BYTES, MAX_LAYOUT_BYTES))
    sys.addaudithook(_refuse_outside)


def _refuse_outside(event: str, arguments: tuple[Any, ...]) -> None:
    """An audit hook that refuses connections and programs."""
    if event in REFUSED_EVENTS:
        raise PermissionError(f"{event} is not allowed while a report is laid out")


def _check_tree(root: Any) -> None:
    """Check that the elements of a report are nested and spanned within limits.  Raises BadInput."""
    level, depth = [root], 0
    while level:
        depth += 1
        spans = (element.get(name, "").strip() for element in level for name in ("colspan", "rowspan", "span"))
        if depth > MAX_DEPTH or any(span.isdigit() and (len(span) > 4 or int(span) > MAX_SPAN) for span in spans):
            raise BadInput(f"nests more than {MAX_DEPTH} elements or joins more than {MAX_SPAN} table cells")
        level = [child for element in level for child in element]


if __name__ == "__main__":
    sys.exit(lay_out(Path(sys.argv[1]), Path(sys.argv[2])))
