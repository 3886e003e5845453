"""Commands that answer a question before a campaign: how many repetitions, which wait."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from flashtemp.cli.terminal import DONE, Json, emit, tell


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
    from flashtemp.runs.running_in import settling

    result = settling(source, within, distance, of)
    emit(result.as_dict(), json, str(result))
    return DONE


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
    from flashtemp.model.case import load
    from flashtemp.runs.wait_time import shortest

    result = shortest(load(case, list(overrides)), below, of, (lambda text: None) if json else tell)
    emit(result.as_dict(), json, str(result))
    return DONE
