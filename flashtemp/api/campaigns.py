"""Campaigns of measurements: compare with the simulation, discover missing effects, plan, make synthetic data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flashtemp.api import reports
from flashtemp.api.inputs import Overrides, Say, ignore_message, resolve_case
from flashtemp.api.picture_faults import RERUN_ELSEWHERE_HINT, report_drawing_faults
from flashtemp.camera.recording import load as load_recording
from flashtemp.comparison import campaign as reading
from flashtemp.comparison import compare as comparing
from flashtemp.comparison import synthetic_campaign as twins
from flashtemp.comparison.campaign import Campaign
from flashtemp.comparison.compare import Comparison
from flashtemp.comparison.condition_remarks import remark_on_conditions
from flashtemp.discovery import engine, experiment_design
from flashtemp.discovery.experiment_design import DesignReport
from flashtemp.discovery.prediction.prediction import predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.discovery.verdict import Verdict
from flashtemp.display import DisplayMixin, write_json
from flashtemp.errors import BadInput
from flashtemp.model.case import Case
from flashtemp.model.case_file import parse_toml
from flashtemp.runs.results.result_folder import optional_folder
from flashtemp.runs.results.worker_pool import open_worker_pool


def open_campaign(
    campaign: str | Path, planned: bool = False, *, trust: bool = False, limit: float | None = None
) -> Campaign:
    """Read a campaign, from a folder with a campaign.toml or from a .toml file, with its case and recordings.

    With `planned` a recording may give a view instead of a file, as before measuring.  `trust` runs effect files of
    the case even if another user may have written them.  `limit` is the memory in GB for reading one recording, 1 when
    not given.  Raises BadInput.
    """
    return reading.load(campaign, planned, trust, limit)


def parse_campaign(
    text: str, file: Path, planned: bool = False, load_recording: reading.RecordingLoader = load_recording
) -> Campaign:
    """The campaign that `text` describes as the content of `file`, which need not exist.

    `planned` as in `open_campaign`; `load_recording` reads the recordings.  Raises BadInput.
    """
    try:
        raw = parse_toml(text)
    except (ValueError, RecursionError) as fault:
        raise BadInput(f"{file}: not valid TOML: {str(fault).split(chr(10))[0]}; repair that line") from fault
    return reading.read_tables(text, raw, file, planned, False, load_recording)


def resolve_campaign(campaign: str | Path | Campaign, planned: bool = False) -> Campaign:
    """The campaign itself, or the one read from a path.  Raises BadInput."""
    return campaign if isinstance(campaign, Campaign) else open_campaign(campaign, planned)


def compare(
    campaign: str | Path | Campaign, *, out: str | Path | None = None, pdf: bool = False, say: Say = ignore_message
) -> Comparison:
    """Simulate every recording of a campaign and compute the residuals, measured minus simulated.

    `out`: folder for compare.json and report.html; `pdf` adds report.pdf.  Raises BadInput, SolverFailure.
    """
    _check_pdf_request(pdf, out)
    loaded = resolve_campaign(campaign)
    for remark in remark_on_conditions(loaded):
        say(remark)
    with optional_folder(out) as work:
        result = comparing.compare(loaded, say)
        if work is not None:
            write_json(result.as_dict(), work / "compare.json")
            say("writing the report")
            with report_drawing_faults(result, out or work, "report.html", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz.html import comparison_report

                command = reports.format_command("compare", loaded.path)
                subject = comparison_report.describe_method(result, command)
                comparison_report.write_report(result, work / "report.html", subject)
                comparison_report.write_picture(result, work / "what_is_wrong.png")
            _write_pdf_report(result, pdf, work, out)
    return result


def _check_pdf_request(pdf: bool, out: str | Path | None) -> None:
    """Raise BadInput where a PDF is wanted and cannot be written."""
    if pdf and out is None:
        raise BadInput("pdf: there is no folder for report.pdf; give out as well")
    if pdf:
        reports.check_pdf_library()


def _write_pdf_report(result: Any, pdf: bool, work: Path, out: str | Path | None) -> None:
    """Write report.pdf next to report.html if it is wanted.  Raises IncompleteResult where that fails."""
    if pdf:
        again = f"flashtemp report {out} --pdf"
        with report_drawing_faults(result, out or work, reports.PDF_FILE, again):
            reports.write_pdf(work)


def discover(
    campaign: str | Path | Campaign,
    *,
    out: str | Path | None = None,
    pdf: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    say: Say = ignore_message,
) -> Verdict:
    """Find which effect the model of a campaign lacks, extend the model by it and measure the improvement.

    `out`: folder for verdict.json, report.html, pictures and the extended case; `pdf` adds report.pdf.  `workers`:
    number of processes, one per core when not given; `scheduler`: address of a Dask scheduler to use instead.  Raises
    BadInput, SolverFailure.
    """
    _check_pdf_request(pdf, out)
    loaded = resolve_campaign(campaign)
    for remark in remark_on_conditions(loaded):
        say(remark)
    with optional_folder(out) as work:
        verdict, search = engine.discover(loaded, say, workers, scheduler)
        if work is not None:
            write_json(verdict.as_dict(), work / "verdict.json")
            engine.write_extended(search, verdict, work)
            say("writing the report")
            with report_drawing_faults(verdict, out or work, "report.html and pictures", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz.html import verdict_report
                from flashtemp.viz.verdict import verdict_figures

                subject = verdict_report.describe_method(loaded, reports.format_command("discover", loaded.path))
                verdict_report.write_report(verdict, work / "report.html", subject)
                verdict_figures.draw_all(verdict, work)
            _write_pdf_report(verdict, pdf, work, out)
    return verdict


def plan(
    campaign: str | Path | Campaign,
    *,
    out: str | Path | None = None,
    pdf: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    say: Say = ignore_message,
) -> DesignReport:
    """Before measuring, find which effects a campaign can distinguish, and which experiment to add.

    `out`: folder for plan.json, report.html and the picture of the separability matrix; `pdf`, `workers` and
    `scheduler` as in `discover`.  Raises BadInput, SolverFailure.
    """
    _check_pdf_request(pdf, out)
    loaded = resolve_campaign(campaign, planned=True)
    for remark in remark_on_conditions(loaded):
        say(remark)
    with optional_folder(out) as work:
        with open_worker_pool(predict_condition, workers, scheduler) as run:
            design = experiment_design.assess_design(prepare_problem(loaded, run), say)
        if work is not None:
            write_json(design.as_dict(), work / "plan.json")
            with report_drawing_faults(design, out or work, "separability.png and report.html", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz import theme
                from flashtemp.viz.html import study_report, title_page
                from flashtemp.viz.verdict import separability as picture

                theme.save_figure(picture.draw(design), work / "separability.png")
                command = reports.format_command("plan", loaded.path)
                subject = title_page.describe_campaign(loaded, loaded.load({}), command, study_report.PLAN_METHOD)
                study_report.write_plan_report(work, subject)
            _write_pdf_report(design, pdf, work, out)
    return design


@dataclass(frozen=True, repr=False)
class SyntheticCampaign(DisplayMixin):
    """A synthetic campaign in a folder, which also contains the hidden truth in a sealed file."""

    folder: Path
    seed: int
    conditions: int

    def as_dict(self) -> dict[str, Any]:
        """Folder, seed and number of conditions as plain data."""
        return {"out": str(self.folder), "seed": self.seed, "conditions": self.conditions}

    def campaign(self) -> Campaign:
        """The campaign, opened like a measured one."""
        return open_campaign(self.folder)

    def __str__(self) -> str:
        return f"campaign in {self.folder}/campaign.toml"


def twin(
    case: str | Path | Case,
    overrides: Overrides | None = None,
    *,
    hide: Sequence[str],
    seed: int,
    out: str | Path,
    conditions: int = 4,
    views: Sequence[str] = ("sidewall", "wake"),
    nuisance: float = 1.0,
    points: Sequence[dict[str, Any]] = (),
    camera: str = "ideal",
    say: Say = ignore_message,
) -> SyntheticCampaign:
    """Make a synthetic campaign in the new folder `out`, with effects that its case does not contain.

    `hide`: names of these effects; `views`: some of sidewall, wake, profile and points; `points`: tables of x, z (m),
    lag_s and place_sigma_m of thermocouples.  `nuisance` scales all random measurement errors, 0 leaves noise only.
    `camera`: "ideal", or with the errors of an "uncooled" or "cooled" camera.  Raises BadInput, SolverFailure.
    """
    synthetic_plan = twins.SyntheticPlan(
        tuple(hide), seed, conditions, tuple(views), nuisance=nuisance, points=tuple(points), camera=camera
    )
    return SyntheticCampaign(
        twins.make_synthetic_campaign(resolve_case(case, overrides), synthetic_plan, Path(out), say), seed, conditions
    )
