"""Reports of finished results: one HTML file, and the same as PDF."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flashtemp.api.inputs import Say, ignore_message
from flashtemp.display import DisplayMixin
from flashtemp.errors import BadInput
from flashtemp.runs.job import is_result
from flashtemp.runs.load_run import open_run

REPORT_FILE, PDF_FILE = "report.html", "report.pdf"


@dataclass(frozen=True, repr=False)
class ReportResult(DisplayMixin):
    """The result of `report`: the `files` written into the result `folder`."""

    folder: Path
    files: tuple[Path, ...]

    def as_dict(self) -> dict[str, Any]:
        """Folder and file names as plain data."""
        return {"out": str(self.folder), "files": [f.name for f in self.files]}

    def __str__(self) -> str:
        return f"written in {self.folder}/: {', '.join(f.name for f in self.files)}"


def report(folder: str | Path, *, pdf: bool = False, trust: bool = False, say: Say = ignore_message) -> ReportResult:
    """Write the report of a finished result into its folder, and with `pdf` the same as report.pdf.

    A run, a sweep and a sensitivity study get a new report.html.  That of a comparison, a discovery or a plan is kept,
    since it needs the campaign.  `trust` as in `load`.  Raises BadInput.
    """
    path = Path(folder)
    if pdf:
        check_pdf_library()
    written = _write_report(path, trust, say)
    if not written and not (path / REPORT_FILE).is_file():
        raise BadInput(
            f"{path}: no result of run, compare, discover, plan, sweep or sensitivity; give the folder of one"
        )
    if not written and not pdf:
        raise BadInput(f"{path}: its {REPORT_FILE} is complete; add --pdf to write {PDF_FILE}")
    if pdf:
        say(f"writing {PDF_FILE}")
        written.append(write_pdf(path))
    return ReportResult(path, tuple(written))


def _write_report(folder: Path, trust: bool, say: Say) -> list[Path]:
    """Write the report of a run or a study; [] for results whose report is kept, and for other folders."""
    if is_result(folder):
        return [_write_run_report(folder, trust, say)]
    from flashtemp.viz.html import study_report

    if (folder / "sweep.nc").is_file():
        say(f"writing {REPORT_FILE}")
        return [study_report.write_sweep_report(folder, trust)]
    if (folder / "sensitivity.json").is_file():
        say(f"writing {REPORT_FILE}")
        return [study_report.write_sensitivity_report(folder, trust)]
    if (folder / "plan.json").is_file() and not (folder / REPORT_FILE).is_file():  # of an earlier release
        return [study_report.write_plan_report(folder)]
    return []


def _write_run_report(folder: Path, trust: bool, say: Say) -> Path:
    from flashtemp.viz.html import run_report, title_page

    case, run = open_run(folder, trust)
    say(f"writing {REPORT_FILE}")
    return Path(run_report.write_report(run, folder / REPORT_FILE, title_page.describe_run(case, run, folder)))


def check_pdf_library() -> None:
    """Check that a PDF can be written, before any work begins.  Raises BadInput with the remedy."""
    from flashtemp.viz.html import pdf

    pdf.import_library()


def write_pdf(folder: Path) -> Path:
    """Write report.pdf from the report.html of a folder; returns its path.  Raises BadInput."""
    from flashtemp.viz.html import pdf

    return Path(pdf.write_pdf(folder / REPORT_FILE, folder / PDF_FILE))


def format_command(name: str, *words: str | Path) -> str:
    """A command line that repeats a call.

    >>> format_command("compare", Path("my tests"))
    "flashtemp compare 'my tests'"
    """
    return shlex.join(["flashtemp", name, *map(str, words)])
