"""Measured against computed: compare a campaign, find what the model lacks, plan one, make a synthetic one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flashtemp.api.inputs import Overrides, Say, ignore_message, resolve_case
from flashtemp.api.picture_faults import RERUN_ELSEWHERE_HINT, report_drawing_faults
from flashtemp.comparison import campaign as reading
from flashtemp.comparison import compare as comparing
from flashtemp.comparison import synthetic_campaign as twins
from flashtemp.comparison.campaign import Campaign
from flashtemp.comparison.compare import Comparison
from flashtemp.discovery import engine, experiment_design
from flashtemp.discovery.experiment_design import DesignReport
from flashtemp.discovery.prediction.prediction import predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.discovery.verdict import Verdict
from flashtemp.display import DisplayMixin, write_json
from flashtemp.model.case import Case
from flashtemp.runs.results.result_folder import optional_folder
from flashtemp.runs.results.worker_pool import open_worker_pool


def open_campaign(
    campaign: str | Path, planned: bool = False, *, trust: bool = False, limit: float | None = None
) -> Campaign:
    """Read a campaign: a folder with a campaign.toml, or a .toml file, and everything that it names.

    With `planned` a recording may give a view instead of a file, as before measuring; `trust` lets effect files of its
    case run whose ever they are; `limit`: GB of memory that reading one recording may take, 1 when not given.
    Raises BadInput.
    """
    return reading.load(campaign, planned, trust, limit)


def resolve_campaign(campaign: str | Path | Campaign, planned: bool = False) -> Campaign:
    """A campaign from its path, or one that is open.  Raises BadInput."""
    return campaign if isinstance(campaign, Campaign) else open_campaign(campaign, planned)


def compare(campaign: str | Path | Campaign, *, out: str | Path | None = None, say: Say = ignore_message) -> Comparison:
    """Simulate what the cameras of a campaign saw and subtract.

    `out`: folder for compare.json and report.html.  Raises BadInput, SolverFailure.
    """
    loaded = resolve_campaign(campaign)
    with optional_folder(out) as work:
        result = comparing.compare(loaded, say)
        if work is not None:
            write_json(result.as_dict(), work / "compare.json")
            say("writing the report")
            with report_drawing_faults(result, out or work, "report.html", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz.html import comparison_report

                comparison_report.write_report(result, work / "report.html")
    return result


def discover(
    campaign: str | Path | Campaign,
    *,
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    say: Say = ignore_message,
) -> Verdict:
    """Find what the simulation of a campaign gets wrong, name the cause, extend the model and measure the gain.

    `out`: folder for verdict.json, report.html, pictures and the extended case.  Raises BadInput, SolverFailure.
    """
    loaded = resolve_campaign(campaign)
    with optional_folder(out) as work:
        verdict, search = engine.discover(loaded, say, workers, scheduler)
        if work is not None:
            write_json(verdict.as_dict(), work / "verdict.json")
            engine.write_extended(search, verdict, work)
            say("writing the report")
            with report_drawing_faults(verdict, out or work, "report.html and pictures", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz.html import verdict_report
                from flashtemp.viz.verdict import verdict_figures

                verdict_report.write_report(verdict, work / "report.html")
                verdict_figures.draw_all(verdict, work)
    return verdict


def plan(
    campaign: str | Path | Campaign,
    *,
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    say: Say = ignore_message,
) -> DesignReport:
    """Before measuring: which effects the views and conditions of a campaign can tell apart, and what to add.

    `out`: folder for plan.json and the picture of the separability matrix.  Raises BadInput, SolverFailure.
    """
    loaded = resolve_campaign(campaign, planned=True)
    with optional_folder(out) as work:
        with open_worker_pool(predict_condition, workers, scheduler) as run:
            outlook = experiment_design.assess_design(prepare_problem(loaded, run), say)
        if work is not None:
            write_json(outlook.as_dict(), work / "plan.json")
            with report_drawing_faults(outlook, out or work, "separability.png", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz import theme
                from flashtemp.viz.verdict import separability as picture

                theme.save_figure(picture.draw(outlook), work / "separability.png")
    return outlook


@dataclass(frozen=True, repr=False)
class SyntheticCampaign(DisplayMixin):
    """A synthetic campaign in a folder; what was hidden lies sealed there."""

    folder: Path
    seed: int
    conditions: int

    def as_dict(self) -> dict[str, Any]:
        """For --json."""
        return {"out": str(self.folder), "seed": self.seed, "conditions": self.conditions}

    def campaign(self) -> Campaign:
        """The campaign, as a laboratory would hand it over."""
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
    """A synthetic campaign in the new folder `out`, with effects that are hidden from the case that is believed.

    `hide` names of effects, `views` some of sidewall, wake, profile and points, `points` tables of x, z (m), lag_s and
    place_sigma_m of thermocouples, `nuisance` scales all that is drawn within what a laboratory knows.  The
    `camera` is ideal, or it has errors of uncooled or cooled cameras.  Raises BadInput, SolverFailure.
    """
    asked = twins.SyntheticPlan(
        tuple(hide), seed, conditions, tuple(views), nuisance=nuisance, points=tuple(points), camera=camera
    )
    return SyntheticCampaign(
        twins.make_synthetic_campaign(resolve_case(case, overrides), asked, Path(out), say), seed, conditions
    )
