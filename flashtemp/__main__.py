"""The command line: results on stdout, messages and progress on stderr, exit codes of the contract."""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter

from flashtemp import __version__
from flashtemp.errors import BadInput, FlashtempError, Interrupted

DONE, FAILED, BAD, STOPPED = 0, 1, 2, 130
app = App(
    name="flashtemp",
    help="Where the heat of a sliding rubber block goes, and what your model of it is missing.",
    version=__version__,
)
Json = Annotated[
    bool, Parameter(name="--json", negative=(), help="Print the result as JSON on stdout, nothing else there.")
]
Switch = Parameter(negative=())


def tell(text: str) -> None:
    """A message for the person at the terminal."""
    print(text, file=sys.stderr)


@contextmanager
def progress_bar(label: str):
    """Progress with time left on stderr; silent where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as bar:
        task, shown = bar.add_task(label, total=None), 0.0

        def watch(now, end: float) -> None:
            nonlocal shown
            if time.monotonic() - shown > 0.1:
                shown = time.monotonic()
                bar.update(task, completed=now.t, total=end)

        yield watch


@app.command
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
    from flashtemp import job
    from flashtemp.case import load

    if (case is None) == (resume is None):
        raise BadInput("run: give one CASE, or --resume DIR to go on with an interrupted run")
    say = (lambda text: None) if json else tell
    if resume is not None:
        if overrides:
            raise BadInput("--resume: an interrupted run goes on as it was; leave out the key=value")
        with progress_bar("resuming") as watch:
            result = job.resume(resume, pvd, watch, say)
        folder = resume.with_name(resume.name.removesuffix(".partial"))
    else:
        loaded = load(case, list(overrides))
        folder = out or job.free_name(Path("results") / loaded.name)
        with progress_bar(loaded.name) as watch:
            result = job.simulate(loaded, folder, overwrite, pvd, watch, say)
    emit(result.summary | {"out": str(folder)}, json, f"{result}\n  results in {folder}/")
    return DONE


@app.command
def check(file: Path, /, *overrides: str, json: Json = False) -> int:
    """Validate a case with exactly the code of run, and print what it would simulate.

    Parameters
    ----------
    file
        A case folder or a .toml file.
    overrides
        Keys of the case to change, as table.key=value.
    """
    from flashtemp.case import build, load, settings

    case = load(file, list(overrides))
    settings(case)
    scene = build(case)
    emit(
        {"ok": True, "case": case.name, "effects": list(case.effects), "cells": scene.mesh.n_cells}, json, f"{case}\nok"
    )
    return DONE


@app.command
def converge(case: str, /, *overrides: str, json: Json = False) -> int:
    """Observed order of accuracy and error estimate of a case, by refining it.

    Parameters
    ----------
    case
        A case folder or a .toml file.
    overrides
        Keys of the case to change, as table.key=value.
    """
    from flashtemp.case import load
    from flashtemp.verify import QUANTITIES
    from flashtemp.verify import converge as refine

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


@app.command
def repetitions(
    source: Path,
    /,
    *,
    within: float = 0.01,
    distance: float | None = None,
    of: Literal["friction", "pressure"] = "friction",
    json: Json = False,
) -> int:
    """How many repetitions until data are reproducible: relaxation over the distance slid, with its uncertainty.

    Parameters
    ----------
    source
        A result folder, or a CSV file with a header: repetition,mu[,sigma] or slid_m,mu[,sigma].
    within
        What may remain of the change, as a share of the final value.
    distance
        Metres slid in one repetition, for a CSV file.
    of
        What settles: friction, or how uneven the pressure is (result folder only).
    """
    from flashtemp.settling import settling

    result = settling(source, within, distance, of)
    emit(result.as_dict(), json, str(result))
    return DONE


@app.command
def wait(
    case: str,
    /,
    *overrides: str,
    below: float,
    of: Literal["block", "spot"] = "block",
    json: Json = False,
) -> int:
    """The shortest wait between repetitions that keeps the block below a temperature.

    Parameters
    ----------
    case
        A case folder or a .toml file.
    overrides
        Keys of the case to change, as table.key=value.
    below
        Highest temperature allowed, degC, anywhere under the block and at any time.
    of
        Which temperature: the block's surface (T_block) or its macroasperity contact regions (T_spot).
    """
    from flashtemp.case import load
    from flashtemp.waiting import shortest

    result = shortest(load(case, list(overrides)), below, of, (lambda text: None) if json else tell)
    emit(result.as_dict(), json, str(result))
    return DONE


@app.command
def effects(name: str | None = None, json: Json = False) -> int:
    """The catalogue: every effect with its cause in words, parameters, units and source.

    Parameters
    ----------
    name
        Show this effect only.
    """
    from flashtemp.effect import catalogue, find

    chosen = {name: find(name)} if name else catalogue()
    entries = [describe(n, e) for n, e in chosen.items()]
    lines = []
    for e in entries:
        lines.append(f"{e['name']}{' (always acts)' if e['always'] else ''}: {e['cause']}")
        for p in e["parameters"]:
            off = "" if p["off"] is None else f", off = {p['off']:g}"
            lines.append(
                f"    {p['key']} = {p['default']} {p['unit']}: {p['about']} [{p['low']:g}, {p['high']:g}]{off}"
            )
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


def later(what: str):
    """A command of the contract whose work is still to come: says so and ends with exit code 2."""

    def command(
        *arguments: Annotated[str, Parameter(allow_leading_hyphen=True)],
    ) -> int:
        raise BadInput(f"{what}: this version of flashtemp cannot do it yet; run, check, converge and effects work")

    return command


LATER = {
    "import": "camera files -> one recording",
    "compare": "simulate what the camera saw, subtract, draw",
    "discover": "find what the simulation gets wrong and name the cause",
    "plan": "before measuring: which effects the views and conditions can tell apart",
    "twin": "a synthetic campaign with a hidden effect",
    "sweep": "a case over several values of a key",
    "view": "interactive 3D view of a result",
}
for _name, _help in LATER.items():
    app.command(later(_name), name=_name, help=f"Not in this version yet: {_help}.")


def emit(data, as_json: bool, text: str) -> None:
    """The result on stdout, once, in the form asked for."""
    print(json.dumps(_finite(data), indent=2) if as_json else text)


def _finite(data):
    """Data with infinite and undefined numbers as text or null, so that the JSON is valid everywhere."""
    if isinstance(data, dict):
        return {k: _finite(v) for k, v in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(v) for v in data]
    if isinstance(data, float) and data != data:
        return None
    if isinstance(data, float) and abs(data) == float("inf"):
        return "inf" if data > 0 else "-inf"
    return data


def main(argv: list[str] | None = None) -> int:
    """Run one command and return its exit code (contract 5.1)."""
    try:
        code = app(
            sys.argv[1:] if argv is None else argv,
            exit_on_error=False, print_error=False, result_action="return_value",
        )  # fmt: skip
        return code if isinstance(code, int) else DONE
    except BadInput as fault:
        tell(str(fault))
        return BAD
    except CycloptsError as fault:
        tell("flashtemp: " + " ".join(str(fault).split()) + " See flashtemp --help.")
        return BAD
    except Interrupted as fault:
        folder = str(fault.path).removesuffix(".partial")
        tell(f"{fault}; go on with: flashtemp run --resume {folder}")
        return STOPPED
    except KeyboardInterrupt:
        tell("interrupted")
        return STOPPED
    except FlashtempError as fault:
        tell(f"the computation failed: {fault}")
        return FAILED
    except BrokenPipeError:  # the reader of stdout has gone, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as fault:
        tell(f"the computation failed: {' '.join(str(fault).split())}")
        return FAILED


if __name__ == "__main__":
    sys.exit(main())
