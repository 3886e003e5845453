"""Commands on one case: run, sweep, view, check, converge; and the catalogue of effects."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from flashtemp.cli.terminal import DONE, FAILED, Json, Switch, counter, emit, progress_bar, tell
from flashtemp.errors import BadInput
from flashtemp.runs.folders import free_name


def run(
    case: Annotated[str | None, Parameter(help="A case folder or a .toml file.")] = None,
    /,
    *overrides: str,
    out: Path | None = None,
    resume: Path | None = None,
    overwrite: Annotated[bool, Switch] = False,
    pvd: Annotated[bool, Switch] = False,
    json: Json = False,
) -> int:
    """Simulate a case: T(x, t), pictures and VTK in a result folder.

    Parameters
    ----------
    overrides
        Keys of the case to change, as table.key=value; files are looked up beside the case.
    out
        Result folder; results/CASE when not given.
    resume
        Go on with the interrupted run of this result folder.
    overwrite
        Replace an existing result folder.
    pvd
        Also write a .pvd series for older ParaView.
    """
    from flashtemp.api import simulation
    from flashtemp.model.case import load

    if (case is None) == (resume is None):
        raise BadInput("run: give one CASE, or --resume DIR to go on with an interrupted run")
    say = (lambda text: None) if json else tell
    if resume is not None:
        if overrides:
            raise BadInput("--resume: an interrupted run goes on as it was; leave out the key=value")
        with progress_bar("resuming") as watch:
            result = simulation.resume(resume, pvd, watch, say)
        folder = resume.with_name(resume.name.removesuffix(".partial"))
    else:
        loaded = load(case, list(overrides))
        folder = out or free_name(Path("results") / loaded.name)
        with progress_bar(loaded.name) as watch:
            result = simulation.simulate(loaded, folder, overwrite, pvd, watch, say)
    emit(result.summary | {"out": str(folder)}, json, f"{result}\n  results in {folder}/")
    return DONE


def sweep(
    case: str,
    /,
    *values: str,
    out: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    json: Json = False,
) -> int:
    """A case over several values of its keys, every combination: one dataset with the keys as dimensions.

    The same command again goes on where an interrupted sweep stopped.

    Parameters
    ----------
    case
        A case folder or a .toml file.
    values
        What is swept, as table.key=v1,v2,...; keys with one value are overrides.
    out
        Result folder; results/CASE-sweep when not given.
    workers
        Processes that share the runs; as many as there are cores when not given.
    scheduler
        Address of a running Dask scheduler whose workers share them instead.
    """
    from flashtemp.runs import sweep as sweeps
    from flashtemp.viz import sweep as picture

    asked = sweeps.plan(case, list(values))
    out = out or Path("results") / f"{asked.case.name}-sweep"
    with counter(asked.case.name) as watch, sweeps.folder(out, asked) as work:
        found, failed = sweeps.carry_out(asked, work, workers, scheduler, watch)
        sweeps.save(asked, found, failed, work)
        picture.draw(found).savefig(work / "sweep.png")
    says = sweeps.says(asked, found, failed)
    emit(
        {"out": str(out), "failed": list(failed.values()), **sweeps.table(found)}, json, f"{says}\n  results in {out}/"
    )
    return FAILED if failed else DONE


def view(folder: Path, /, *, screenshot: Path | None = None, time: float | None = None, json: Json = False) -> int:
    """Block and road in space with their temperature, cut open; a slider shows the kept times.

    Parameters
    ----------
    folder
        A result folder of run.
    screenshot
        Draw into this PNG file instead of a window; needs no screen.
    time
        Moment to begin with, in s; the last one when not given.
    """
    from flashtemp.runs.vtk import open_fields
    from flashtemp.viz import window

    fields = open_fields(folder)
    t = float(fields.times[-1]) if time is None else time
    if not fields.times[0] <= t <= fields.times[-1]:
        raise BadInput(f"--time: {t:g} s; give a moment from {fields.times[0]:g} to {fields.times[-1]:g} s")
    if screenshot is not None and (screenshot.suffix != ".png" or not screenshot.absolute().parent.is_dir()):
        raise BadInput(f"--screenshot: {screenshot}; give a .png file in a folder that exists")
    if screenshot is None and not window.on_screen():
        raise BadInput("view: there is no screen here; draw into a file with --screenshot FILE.png")
    able = window.off_screen() if screenshot is not None else True
    from flashtemp.viz import space

    if screenshot is None:
        space.show(fields, t)
    elif able:
        space.screenshot(fields, t, screenshot)
    else:
        tell(f"drawn without VTK, which finds no window here: install {window.MISSING}")
        space.plain(fields, t).savefig(screenshot)
    emit({"screenshot": str(screenshot), "time": t, "vtk": able}, json, str(screenshot or "closed"))
    return DONE


def check(file: Path, /, *overrides: str, json: Json = False) -> int:
    """Validate a case with exactly the code of run, and print what it would simulate.

    Parameters
    ----------
    file
        A case folder or a .toml file.
    overrides
        Keys of the case to change, as table.key=value.
    """
    from flashtemp.model.case import load

    case = load(file, list(overrides))
    scene = case.scene
    emit(
        {"ok": True, "case": case.name, "effects": list(case.effects), "cells": scene.mesh.n_cells}, json, f"{case}\nok"
    )
    return DONE


def converge(case: str, /, *overrides: str, json: Json = False) -> int:
    """Observed order of accuracy and error estimate of a case, by refining it.

    Parameters
    ----------
    case
        A case folder or a .toml file.
    overrides
        Keys of the case to change, as table.key=value.
    """
    from flashtemp.model.case import load
    from flashtemp.runs.convergence import QUANTITIES
    from flashtemp.runs.convergence import converge as refine

    result = refine(load(case, list(overrides)), (lambda text: None) if json else tell)
    rows = [
        f"  {name:26s} {result.values[1][i]:12.6g}   order {result.order[i]:5.2f}   "
        f"error: space {result.space[i]:.2g}, time {result.time[i]:.2g}"
        for i, name in enumerate(QUANTITIES)
    ]
    cells = " / ".join(map(str, result.cells))
    text = "\n".join(
        [f"{cells} cells", *rows, f"  T(x) differs from the finest level by {result.profile_percent:.3f} %"]
    )
    emit(result.as_dict(), json, text)
    return DONE


def effects(name: str | None = None, json: Json = False) -> int:
    """The catalogue: every effect with its cause in words, parameters, units and source.

    Parameters
    ----------
    name
        Show this effect only.
    """
    from flashtemp.physics.effect import catalogue, find

    chosen = {name: find(name)} if name else catalogue()
    entries = [describe(n, e) for n, e in chosen.items()]
    lines = []
    for e in entries:
        lines.append(f"{e['name']}{' (always acts)' if e['always'] else ''}: {e['cause']}")
        for p in e["parameters"]:
            limits = f" [{p['low']:g}, {p['high']:g}]" if p["low"] > -math.inf or p["high"] < math.inf else ""
            off = "" if p["off"] is None else f", off = {p['off']:g}"
            unit = "" if p["unit"] == "1" else f" {p['unit']}"
            default = "not given" if p["default"] is None else p["default"]
            unit = f" ({p['unit']})" if p["default"] is None and unit else unit
            lines.append(f"    {p['key']} = {default}{unit}: {p['about']}{limits}{off}")
        if name:
            lines.append(f"    source: {e['source']}\n    tells: {'; '.join(e['tells'])}")
    emit(entries, json, "\n".join(lines))
    return DONE


def describe(name: str, effect) -> dict:
    """One effect of the catalogue as plain data; infinite numbers as text, which JSON can hold."""
    section = effect.section if effect.base else name
    plain = [
        {
            "key": f"{section}.{k}", "default": p.value, "unit": p.unit, "about": p.about,
            "low": p.low, "high": p.high, "off": p.off,
        }
        for k, p in effect.params().items()
    ]  # fmt: skip
    return {
        "name": name,
        "always": effect.base,
        "cause": effect.cause,
        "source": effect.source,
        "tells": list(effect.tells),
        "parameters": plain,
    }
