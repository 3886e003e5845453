"""The command on effects: the catalogue, one effect, and whether an effect of one's own is sound."""

from __future__ import annotations

from typing import Annotated

from flashtemp.cli.terminal import EXIT_BAD_INPUT, EXIT_DONE, Json, Switch, print_result
from flashtemp.errors import BadInput


def effects(name: str | None = None, *values: str, check: Annotated[bool, Switch] = False, json: Json = False) -> int:
    """The catalogue: every effect with its cause in words, parameters, units and source.

    Parameters
    ----------
    name
        Show this effect only: a name of the catalogue, or a Python file with an effect, which is executed.
    values
        With --check: keys of the small case that it is tried in, as table.key=value.
    check
        Try the effect out as the whole catalogue is: exit code 0 when all holds, 2 when something does not.
    """
    from flashtemp.api import effects as api

    if not check:
        if values:
            raise BadInput(f"effects: {values[0]}: one name at a time; key=value goes with --check")
        found = api.effects(name)
        print_result(list(found.entries), json, str(found))
        return EXIT_DONE
    if name is None:
        raise BadInput("effects --check: give a FILE.py with an effect, or a name that `flashtemp effects` prints")
    checked = api.check_effect(name, list(values))
    print_result(checked.as_dict(), json, str(checked))
    return EXIT_DONE if checked.ok else EXIT_BAD_INPUT
