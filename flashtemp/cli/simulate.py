"""Commands for one case: new, check, run, view, draw, report; and lab, the web app."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from flashtemp.cli.terminal import (
    EXIT_DONE,
    Json,
    Pdf,
    Switch,
    Trust,
    message_printer,
    print_message,
    print_result,
    progress_bar,
    result_folder,
    run_and_report,
)
from flashtemp.errors import BadInput


def new(kind: str, file: Path | None = None, /, *, json: Json = False) -> int:
    """Write a commented case, campaign or recording template.

    Parameters
    ----------
    kind
        Kind of template: case, campaign or recording.
    file
        File to write; case.toml, campaign.toml or recording.toml when not given.
    """
    from flashtemp.api import templates

    made = templates.new(kind, out=file or Path(f"{kind}.toml"))
    print_result(made.as_dict(), json, str(made))
    return EXIT_DONE


def run(
    case: Annotated[str | None, Parameter(help="A case folder or a .toml file.")] = None,
    /,
    *overrides: str,
    out: Path | None = None,
    resume: Path | None = None,
    overwrite: Annotated[bool, Switch] = False,
    pvd: Annotated[bool, Switch] = False,
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Simulate a case and write T(x, t), pictures and VTK files into a result folder.

    Parameters
    ----------
    overrides
        Keys of the case to change, as table.key=value; file names are relative to the folder of the case.
    out
        Result folder; results/CASE when not given.
    resume
        Continue the interrupted run of this result folder.
    overwrite
        Replace an existing result folder.
    pvd
        Also write a .pvd series for older ParaView.
    """
    from flashtemp.api import inputs, simulation

    if (case is None) == (resume is None):
        raise BadInput("run: give one CASE, or --resume DIR to continue an interrupted run")
    say = message_printer(json)
    if resume is not None:
        for value, what in ((overrides, "key=value"), (out, "--out: the result folder stays the same")):
            if value:
                raise BadInput(f"--resume: an interrupted run continues unchanged; leave out {what}")
        folder = simulation.find_resumed_folder(resume)
        with progress_bar(
            "resuming", lambda: inputs.load(simulation.find_working_folder(resume), trust=trust)
        ) as watch:
            result, code = run_and_report(lambda: simulation.resume(resume, pvd=pvd, watch=watch, say=say, trust=trust))
    elif case is not None:
        loaded = inputs.load(case, list(overrides), trust=trust)
        folder = result_folder(out, loaded.name)
        with progress_bar(loaded.name, lambda: loaded) as watch:
            how: dict[str, Any] = {"out": folder, "overwrite": overwrite, "pvd": pvd, "watch": watch, "say": say}
            result, code = run_and_report(lambda: simulation.simulate(loaded, **how))
    print_result(result.summary | {"out": str(folder)}, json, f"{result}\n  results in {folder}/")
    return code


def view(folder: Path, /, *, screenshot: Path | None = None, time: float | None = None, json: Json = False) -> int:
    """Show the temperature of block and road in 3D, cut open, with a slider over the saved times.

    Parameters
    ----------
    folder
        A result folder of run.
    screenshot
        Draw into this PNG file instead of opening a window; works without a screen.
    time
        Time to show first, s; the last one when not given.
    """
    from flashtemp.api import simulation

    shown = simulation.view(folder, screenshot=screenshot, time=time, say=print_message)
    print_result(shown.as_dict(), json, str(shown))
    return EXIT_DONE


def draw(
    folder: Path,
    /,
    *,
    format: str = "png",
    pvd: Annotated[bool, Switch] = False,
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Draw the pictures of a finished run or sweep again, into its folder.

    Parameters
    ----------
    folder
        A result folder of run or sweep.
    format
        png, svg or pdf; several separated by commas, as png,svg.
    pvd
        Also write a .pvd series for older ParaView.
    """
    from flashtemp.api import drawing

    drawn, code = run_and_report(
        lambda: drawing.draw(folder, format=format, pvd=pvd, trust=trust, say=message_printer(json))
    )
    print_result(drawn.as_dict(), json, str(drawn))
    return code


def report(folder: Path, /, *, pdf: Pdf = False, trust: Trust = False, json: Json = False) -> int:
    """Write the report of a finished run or study, or the report of any result as PDF, into its folder.

    Parameters
    ----------
    folder
        A result folder of run, sweep, sensitivity, compare, discover or plan.
    """
    from flashtemp.api import reports

    written = reports.report(folder, pdf=pdf, trust=trust, say=message_printer(json))
    print_result(written.as_dict(), json, str(written))
    return EXIT_DONE


def check(file: Path, /, *overrides: str, trust: Trust = False, json: Json = False) -> int:
    """Validate a case with the same code as run, and print what it would simulate.

    Parameters
    ----------
    file
        A case folder or a .toml file.
    overrides
        Keys of the case to change, as table.key=value.
    """
    from flashtemp.api import inputs, simulation
    from flashtemp.runs.checks import case_remarks, inactive_effects, mesh_error

    case = simulation.check(inputs.load(file, list(overrides), trust=trust))
    cells = case.scene.mesh.n_cells
    remarks = inactive_effects.describe_inactive_effects(case) + mesh_error.warn_of_coarse_mesh(case)
    remarks += map(str, case_remarks.remark_on_memory(case) + case_remarks.remark_on_values(case))
    remarks += map(str, case_remarks.remark_on_side_walls(case))
    answer = {"ok": True, "case": case.name, "effects": list(case.effects), "cells": cells, "remarks": remarks}
    print_result(answer, json, "\n".join([str(case), *(f"  {remark}" for remark in remarks), "ok"]))
    return EXIT_DONE
