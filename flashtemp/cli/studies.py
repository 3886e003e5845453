"""Commands for studies of a case: sweep, converge, repetitions, wait, sensitivity; and effects, the catalogue."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from flashtemp.cli.terminal import (
    EXIT_BAD_INPUT,
    EXIT_DONE,
    EXIT_FAILED,
    Json,
    Switch,
    Trust,
    message_printer,
    print_result,
    progress_counter,
    result_folder,
    run_and_report,
)
from flashtemp.errors import BadInput


def sweep(
    case: str,
    /,
    *values: str,
    out: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Simulate every combination of several values of a case's keys; one dataset has the keys as dimensions.

    The same command again continues an interrupted sweep.

    Parameters
    ----------
    case
        A case folder or a .toml file.
    values
        Keys to sweep, as table.key=v1,v2,...; a key with one value is an override.
    out
        Result folder; results/CASE-sweep when not given.
    workers
        Number of processes; one per core when not given.
    scheduler
        Address of a running Dask scheduler, whose workers run the simulations instead.
    """
    from flashtemp.api import studies
    from flashtemp.runs.studies import sweep as sweeps

    plan = sweeps.plan_sweep(case, *sweeps.parse_axes(list(values)), trust)
    folder = out or Path("results") / f"{plan.case.name}-sweep"
    with progress_counter(plan.case.name) as watch:
        how: dict[str, Any] = {"out": folder, "workers": workers, "scheduler": scheduler, "watch": watch}
        how["say"] = message_printer(as_json=True)  # not printed: the bar counts the runs; the web app lists them
        result, code = run_and_report(lambda: studies.sweep(plan, **how))
    print_result({"out": str(folder), **result.as_dict()}, json, f"{result}\n  results in {folder}/")
    return EXIT_FAILED if result.failed else code


def converge(case: str, /, *overrides: str, trust: Trust = False, json: Json = False) -> int:
    """Estimate the order of accuracy and the numerical error of a case from refined meshes.

    Parameters
    ----------
    case
        A case folder or a .toml file.
    overrides
        Keys of the case to change, as table.key=value.
    """
    from flashtemp.api import inputs, studies

    result = studies.converge(inputs.load(case, list(overrides), trust=trust), say=message_printer(json))
    print_result(result.as_dict(), json, str(result))
    return EXIT_DONE


def repetitions(
    source: Path,
    /,
    *,
    within: float = 0.01,
    distance: float | None = None,
    of: Literal["friction", "pressure"] = "friction",
    json: Json = False,
) -> int:
    """Estimate how many repetitions pass until data are reproducible, with the uncertainty of that number.

    The data are fitted by an exponential relaxation over the distance slid.

    Parameters
    ----------
    source
        A result folder, or a CSV file with a header: repetition,mu[,sigma] or slid_m,mu[,sigma].
    within
        Change that may remain, as a fraction of the final value.
    distance
        Distance slid in one repetition, m, for a CSV file.
    of
        Quantity to analyse: friction, or the unevenness of the pressure (result folder only).
    """
    from flashtemp.api import studies

    result = studies.repetitions(source, within=within, distance=distance, of=of)
    print_result(result.as_dict(), json, str(result))
    return EXIT_DONE


def wait(
    case: str,
    /,
    *overrides: str,
    below: float,
    of: Literal["block", "spot"] = "block",
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Find the shortest wait between repetitions that keeps the block below a temperature.

    Parameters
    ----------
    case
        A case folder or a .toml file.
    overrides
        Keys of the case to change, as table.key=value.
    below
        Highest temperature allowed, degC, anywhere on the block face and at any time.
    of
        Temperature to limit: that of the block surface (T_block) or of its macroasperity contact regions (T_spot).
    """
    from flashtemp.api import inputs, studies

    result = studies.wait(
        inputs.load(case, list(overrides), trust=trust), below=below, of=of, say=message_printer(json)
    )
    print_result(result.as_dict(), json, str(result))
    return EXIT_DONE


def sensitivity(
    case: str,
    /,
    *keys: str,
    out: Path | None = None,
    samples: int | None = None,
    linear: Annotated[bool, Switch] = False,
    workers: int | None = None,
    scheduler: str | None = None,
    trust: Trust = False,
    json: Json = False,
) -> int:
    """Propagate the uncertainty of the inputs to T(x), T_spot, friction and the split of the heat.

    The standard deviation of an input is that of the case (key = { value = ..., sd = ... }), or a default.

    Parameters
    ----------
    case
        A case folder or a .toml file.
    keys
        Uncertain inputs; all with a standard deviation when not given.  table.key=value changes the case.
    out
        Result folder; results/CASE-sensitivity when not given.
    samples
        Number of runs of a Latin hypercube; when not given, only where linear propagation is inaccurate.
    linear
        Linear propagation only: its accuracy is not checked, and nothing is sampled.
    workers
        Number of processes; one per core when not given.
    scheduler
        Address of a running Dask scheduler, whose workers run the simulations instead.
    """
    from flashtemp.api import inputs, studies

    changes, chosen = [k for k in keys if "=" in k], [k for k in keys if "=" not in k]
    loaded = inputs.load(case, changes, trust=trust)
    folder = result_folder(out, f"{loaded.name}-sensitivity", resumable=True)
    with progress_counter(loaded.name) as watch:
        result = studies.sensitivity(
            loaded, chosen or None, samples=samples, linear=linear, out=folder, workers=workers, scheduler=scheduler,
            watch=watch, say=message_printer(json),
        )  # fmt: skip
    print_result(result.as_dict() | {"out": str(folder)}, json, f"{result}\n  results in {folder}/")
    return EXIT_DONE


def effects(name: str | None = None, *values: str, check: Annotated[bool, Switch] = False, json: Json = False) -> int:
    """Show the catalogue of effects with cause, parameters, units and source, or check one effect.

    Parameters
    ----------
    name
        Show only this effect: a name of the catalogue, or a Python file with an effect, which is executed.
    values
        With --check: keys to change in the small case used for the check, as table.key=value.
    check
        Run the checks of the catalogue on this effect: exit code 0 when all pass, 2 when one fails.
    """
    from flashtemp.api import effects as api

    if not check:
        if values:
            raise BadInput(f"effects: {values[0]}: one name at a time; key=value goes with --check")
        result = api.effects(name)
        print_result(list(result.entries), json, str(result))
        return EXIT_DONE
    if name is None:
        raise BadInput("effects --check: give a FILE.py with an effect, or a name that `flashtemp effects` prints")
    checked = api.check_effect(name, list(values))
    print_result(checked.as_dict(), json, str(checked))
    return EXIT_DONE if checked.ok else EXIT_BAD_INPUT
