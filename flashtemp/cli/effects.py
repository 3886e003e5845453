"""The command `effects`: the catalogue, one effect, and the check of a user-defined effect."""

from __future__ import annotations

from typing import Annotated

from flashtemp.cli.terminal import EXIT_BAD_INPUT, EXIT_DONE, Json, Switch, print_result
from flashtemp.errors import BadInput


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
