"""Commands for measurements: import, compare, watch, discover, plan, and twin, which makes a synthetic campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.import_request import ImportRequest
from flashtemp.cli.terminal import (
    EXIT_BAD_INPUT,
    EXIT_DONE,
    Json,
    Limit,
    Pdf,
    Switch,
    Trust,
    escape_controls,
    message_printer,
    print_message,
    print_result,
    result_folder,
    run_and_report,
)
from flashtemp.errors import BadInput


def import_(
    *files: str,
    out: Path | None = None,
    look: Annotated[bool, Switch] = False,
    template: Annotated[bool, Switch] = False,
    overwrite: Annotated[bool, Switch] = False,
    facts: Annotated[ImportOptions, Parameter(name="*", negative=(), consume_multiple=True)] = ImportOptions(),  # noqa: B008 (frozen)
    json: Json = False,
) -> int:
    """Import camera files as one recording (NetCDF), with a picture that shows the block in the image.

    Parameters
    ----------
    files
        Camera files, a folder of them, patterns in quotes, or one recording template (.toml).
    out
        Recording to write, .nc; with --look the picture, .png.
    look
        Only preview the files: draw them, and print pixels, clock, object parameters and ranges.
    template
        Print a commented recording template.
    overwrite
        Replace an existing file.
    """
    from flashtemp.api import camera
    from flashtemp.camera.importing.import_request import expand_patterns
    from flashtemp.camera.importing.recording_import import missing_options

    if template:
        print(camera.recording_template())
        return EXIT_DONE
    request = ImportRequest.from_files(files, facts, out)
    if look:
        picture = out or Path(f"{Path(request.files[0]).name if request.files else 'files'}.look.png")
        preview = camera.inspect_files(request, out=picture, overwrite=overwrite, say=print_message)
        print_result(preview.as_dict(), json, str(preview))
        return EXIT_DONE
    if request.out is None:
        raise BadInput(
            "out: missing; give --out RECORDING.nc", *missing_options(expand_patterns(request.files), request.facts)
        )
    result = camera.import_recording(request, overwrite=overwrite, say=print_message)
    for note in result.notes:
        print_message(note)
    print_result(result.as_dict(), json, str(result))
    return EXIT_DONE


def compare(
    campaign: Path,
    /,
    *,
    out: Path | None = None,
    pdf: Pdf = False,
    limit: Limit = None,
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Simulate the recordings of a campaign and report the residuals, as one HTML report and one JSON file.

    Parameters
    ----------
    campaign
        A folder with a campaign.toml, or a .toml file.
    out
        Result folder; results/NAME-compare when not given.
    """
    from flashtemp.api import campaigns, reports

    if pdf:
        reports.check_pdf_library()
    loaded = campaigns.open_campaign(campaign, trust=trust, limit=limit)
    folder = result_folder(out, f"{loaded.folder.resolve().name}-compare")
    result, code = run_and_report(lambda: campaigns.compare(loaded, out=folder, pdf=pdf, say=message_printer(json)))
    print_result(result.as_dict() | {"out": str(folder)}, json, f"{result}\n  report in {folder}/report.html")
    return code


def watch(
    folder: Path,
    campaign: Path,
    /,
    *,
    out: Path | None = None,
    interval: float = 2.0,
    patience: float = 60.0,
    once: Annotated[bool, Switch] = False,
    until_decided: Annotated[bool, Switch] = False,
    overwrite: Annotated[bool, Switch] = False,
    workers: int | None = None,
    limit: Limit = None,
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Import and compare camera files as they arrive, and say when the data suffice to tell the hypotheses apart.

    Parameters
    ----------
    folder
        The folder in which camera files arrive.
    campaign
        A folder with a campaign.toml, or a .toml file; its recordings need not exist yet, but their templates.
    out
        Folder for watch.json and watch.png, rewritten after every file; results/NAME-watch when not given.
    interval
        Seconds between two looks into the folder.
    patience
        Seconds for which a file that cannot be read is tried again, before it is refused.
    once
        Process the files that are there and end; a refused file then gives exit code 2.
    until_decided
        End when the data suffice.
    overwrite
        Replace recordings that hold frames of missing files.
    workers
        Number of processes; one per core when not given.
    """
    from flashtemp.api import watching

    target = result_folder(out, f"{(campaign if campaign.is_dir() else campaign.parent).resolve().name}-watch")
    watched = watching.watch(
        folder, campaign, out=target, interval=interval, patience=patience, once=once, until_decided=until_decided,
        overwrite=overwrite, workers=workers, trust=trust, limit=limit, say=message_printer(json),
    )  # fmt: skip
    try:
        for event in watched:
            if not json:
                print(escape_controls(str(event)), flush=True)
    except KeyboardInterrupt:  # between two events
        raise watched.interrupt_watch() from None
    print_result(watched.as_dict() | {"out": str(target)}, json, f"{watched}\n  state in {target}")
    return EXIT_BAD_INPUT if once and watched.has_faults else EXIT_DONE


def discover(
    campaign: Path,
    /,
    *,
    out: Path | None = None,
    pdf: Pdf = False,
    workers: int | None = None,
    scheduler: str | None = None,
    limit: Limit = None,
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Find which effect the model lacks, extend the model by it and measure the improvement.

    Parameters
    ----------
    campaign
        A folder with a campaign.toml, or a .toml file.
    out
        Result folder; results/NAME-discover when not given.
    workers
        Number of processes; one per core when not given.
    scheduler
        Address of a running Dask scheduler, whose workers run the simulations instead.
    """
    from flashtemp.api import campaigns, reports

    if pdf:
        reports.check_pdf_library()
    loaded = campaigns.open_campaign(campaign, trust=trust, limit=limit)
    folder = result_folder(out, f"{loaded.folder.resolve().name}-discover")
    how: dict[str, Any] = {"out": folder, "pdf": pdf, "workers": workers, "scheduler": scheduler}
    verdict, code = run_and_report(lambda: campaigns.discover(loaded, **how, say=message_printer(json)))
    print_result(verdict.as_dict() | {"out": str(folder)}, json, f"{verdict}\n  report in {folder}/report.html")
    return code


def plan(
    campaign: Path,
    /,
    *,
    out: Path | None = None,
    pdf: Pdf = False,
    workers: int | None = None,
    scheduler: str | None = None,
    limit: Limit = None,
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Predict before measuring which effects a campaign can distinguish, and which experiment to add.

    Parameters
    ----------
    campaign
        A folder with a campaign.toml, or a .toml file; a recording may give view = "sidewall", "wake" or "profile"
        instead of a file.
    out
        Folder for plan.json, report.html and a picture of the separability matrix; nothing is written when not given.
    workers
        Number of processes; one per core when not given.
    scheduler
        Address of a running Dask scheduler, whose workers run the simulations instead.
    """
    from flashtemp.api import campaigns

    loaded = campaigns.open_campaign(campaign, planned=True, trust=trust, limit=limit)
    how: dict[str, Any] = {"out": out, "pdf": pdf, "workers": workers, "scheduler": scheduler}
    design, code = run_and_report(lambda: campaigns.plan(loaded, **how, say=message_printer(json)))
    print_result(design.as_dict(), json, str(design))
    return code


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
    points: str = "",
    camera: str = "ideal",
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Make a synthetic campaign with a hidden effect; the truth is in a sealed file.

    Parameters
    ----------
    case
        A case folder or a .toml file: the assumed model, without the hidden effects.
    overrides
        Keys of the case to change, as table.key=value.
    hide
        Effects to hide, separated by commas; "none" hides nothing.
    seed
        Seed of all random numbers.
    out
        Folder of the campaign.
    conditions
        Number of conditions to measure, of the four combinations of two pressures and two speeds.
    views
        Views to record, separated by commas: sidewall, wake, profile, points.
    nuisance
        Factor on the random measurement errors, those of calibration, position and conditions; 0 leaves noise only.
    points
        Thermocouples of the view points, as x=0.01,z=0.002,lag_s=0.5,place_sigma_m=0.0005, separated by ;.
    camera
        Errors of the cameras: ideal (noise and dead pixels only), uncooled (shutter, drift, mirror images, vignetting,
        stray light, lag, row and column noise, bad pixels with a constant value) or cooled (the same, smaller).
    """
    from flashtemp.api import campaigns, inputs

    made = campaigns.twin(
        inputs.load(case, list(overrides), trust=trust),
        hide=[name for part in hide.split(",") if (name := part.strip()) and name != "none"],
        seed=seed,
        out=out,
        conditions=conditions,
        views=[view.strip() for view in views.split(",")],
        nuisance=nuisance,
        points=inputs.parse_points(points),
        camera=camera,
        say=message_printer(json),
    )
    print_result(made.as_dict(), json, str(made))
    return EXIT_DONE
