"""Commands on campaigns: compare measured with computed, and make a synthetic campaign."""

from __future__ import annotations

import json as jsonlib
from pathlib import Path

from flashtemp.cli.terminal import DONE, Json, emit, finite, tell
from flashtemp.runs.folders import free_name, whole


def compare(campaign: Path, /, *, out: Path | None = None, json: Json = False) -> int:
    """Simulate what the cameras of a campaign saw, subtract, draw: one HTML report and one JSON.

    Parameters
    ----------
    campaign
        A folder with a campaign.toml, or a .toml file.
    out
        Result folder; results/NAME-compare when not given.
    """
    from flashtemp.comparison import campaign as campaigns
    from flashtemp.comparison import compare as comparing
    from flashtemp.viz import comparison_report

    say = (lambda text: None) if json else tell
    loaded = campaigns.load(campaign)
    folder = out or free_name(Path("results") / f"{loaded.folder.resolve().name}-compare")
    with whole(folder) as work:
        result = comparing.compare(loaded, say)
        (work / "compare.json").write_text(jsonlib.dumps(result.as_dict(), indent=2) + "\n", encoding="utf-8")
        say("writing the report")
        comparison_report.write(result, work / "report.html")
    emit(result.as_dict() | {"out": str(folder)}, json, f"{result}\n  report in {folder}/report.html")
    return DONE


def discover(
    campaign: Path,
    /,
    *,
    out: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    json: Json = False,
) -> int:
    """Find what the simulation gets wrong, name the cause, extend the model and measure the gain.

    Parameters
    ----------
    campaign
        A folder with a campaign.toml, or a .toml file.
    out
        Result folder; results/NAME-discover when not given.
    workers
        Processes that share the simulations; as many as there are cores when not given.
    scheduler
        Address of a running Dask scheduler whose workers share them instead.
    """
    from flashtemp.comparison import campaign as campaigns
    from flashtemp.discovery import discover as conclude
    from flashtemp.viz import discovery, verdict_report

    say = (lambda text: None) if json else tell
    loaded = campaigns.load(campaign)
    folder = out or free_name(Path("results") / f"{loaded.folder.resolve().name}-discover")
    with whole(folder) as work:
        verdict, search = conclude.discover(loaded, say, workers, scheduler)
        text = jsonlib.dumps(finite(verdict.as_dict()), indent=2, default=float)
        (work / "verdict.json").write_text(text + "\n", encoding="utf-8")
        conclude.write_extended(search, verdict, work)
        say("writing the report")
        discovery.draw_all(verdict, work)
        verdict_report.write(verdict, work / "report.html")
    emit(verdict.as_dict() | {"out": str(folder)}, json, f"{verdict}\n  report in {folder}/report.html")
    return DONE


def plan(
    campaign: Path,
    /,
    *,
    out: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    json: Json = False,
) -> int:
    """Before measuring: which effects these views and conditions can tell apart, and which experiment to add.

    Parameters
    ----------
    campaign
        A folder with a campaign.toml, or a .toml file; a recording may give view = "sidewall", "wake" or "profile"
        instead of a file.
    out
        Folder for plan.json and the picture of the separability matrix; nothing is written when not given.
    workers
        Processes that share the simulations; as many as there are cores when not given.
    scheduler
        Address of a running Dask scheduler whose workers share them instead.
    """
    from flashtemp.comparison import campaign as campaigns
    from flashtemp.discovery import experiment_design
    from flashtemp.discovery.prediction import look
    from flashtemp.discovery.problem import prepare
    from flashtemp.runs.workers import crew

    loaded = campaigns.load(campaign, planned=True)
    with crew(look, workers, scheduler) as run:
        outlook = experiment_design.plan(prepare(loaded, run))
    if out is not None:
        from flashtemp.viz import separability as picture

        with whole(out) as work:
            (work / "plan.json").write_text(jsonlib.dumps(finite(outlook.as_dict()), indent=2) + "\n", encoding="utf-8")
            picture.draw(outlook).savefig(work / "separability.png")
    emit(outlook.as_dict(), json, str(outlook))
    return DONE


def twin(
    case: str,
    /,
    *overrides: str,
    hide: str,
    seed: int,
    out: Path,
    conditions: int = 4,
    views: str = "sidewall,wake",
    nuisance: float = 1.0,
    json: Json = False,
) -> int:
    """A synthetic campaign with a hidden effect, as a laboratory would hand it over; the truth is sealed.

    Parameters
    ----------
    case
        A case folder or a .toml file: the model that is believed, without what is hidden.
    overrides
        Keys of the case to change, as table.key=value.
    hide
        Effects to hide, separated by commas; "none" hides nothing.
    seed
        Number from which everything random is drawn.
    out
        Folder of the campaign.
    conditions
        How many of the four conditions (two pressures, two speeds) are measured.
    views
        What is seen: some of sidewall, wake, profile.
    nuisance
        Scale of all that is drawn within what a laboratory knows; 0 leaves noise only.
    """
    from flashtemp.comparison.twin import Plan
    from flashtemp.comparison.twin import twin as make
    from flashtemp.model.case import load

    hidden = tuple(name for part in hide.split(",") if (name := part.strip()) and name != "none")
    plan = Plan(hidden, seed, conditions, tuple(v.strip() for v in views.split(",")), nuisance=nuisance)
    folder = make(load(case, list(overrides)), plan, out, (lambda text: None) if json else tell)
    emit({"out": str(folder), "seed": seed, "conditions": conditions}, json, f"campaign in {folder}/campaign.toml")
    return DONE
