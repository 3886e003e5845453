"""Commands that march a case more than once: sweep, converge, repetitions, wait, sensitivity."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from flashtemp.cli.terminal import (
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
    from flashtemp.api import studies
    from flashtemp.runs.studies import sweep as sweeps

    asked = sweeps.plan_sweep(case, *sweeps.parse_axes(list(values)), trust)
    folder = out or Path("results") / f"{asked.case.name}-sweep"
    with progress_counter(asked.case.name) as watch:
        how: dict[str, Any] = {"out": folder, "workers": workers, "scheduler": scheduler, "watch": watch}
        found, code = run_and_report(lambda: studies.sweep(asked, **how))
    print_result({"out": str(folder), **found.as_dict()}, json, f"{found}\n  results in {folder}/")
    return EXIT_FAILED if found.failed else code


def converge(case: str, /, *overrides: str, trust: Trust = False, json: Json = False) -> int:
    """Observed order of accuracy and error estimate of a case, by refining it.

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
    """What every input does to T(x), T_spot, friction and the split of the heat, and how sure the prediction is.

    An input is known as the case says (key = { value = ..., sd = ... }), or as is usual.

    Parameters
    ----------
    case
        A case folder or a .toml file.
    keys
        Inputs that are uncertain, all with a standard deviation when not given; table.key=value changes the case.
    out
        Result folder; results/CASE-sensitivity when not given.
    samples
        Runs of a Latin hypercube; when not given it is drawn only where the linear part does not hold.
    linear
        Traces alone: the linear part is not tried, and nothing is sampled.
    workers
        Processes that share the runs; as many as there are cores when not given.
    scheduler
        Address of a running Dask scheduler whose workers share them instead.
    """
    from flashtemp.api import inputs, studies

    changes, chosen = [k for k in keys if "=" in k], [k for k in keys if "=" not in k]
    loaded = inputs.load(case, changes, trust=trust)
    folder = result_folder(out, f"{loaded.name}-sensitivity", go_on=True)
    with progress_counter(loaded.name) as watch:
        found = studies.sensitivity(
            loaded, chosen or None, samples=samples, linear=linear, out=folder, workers=workers, scheduler=scheduler,
            watch=watch, say=message_printer(json),
        )  # fmt: skip
    print_result(found.as_dict() | {"out": str(folder)}, json, f"{found}\n  results in {folder}/")
    return EXIT_DONE
