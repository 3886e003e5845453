"""All commands put together: `app`, which parses a command line and calls the command's function."""

from __future__ import annotations

from typing import Any

from cyclopts import App, CycloptsError

from flashtemp.camera.import_options import in_plain_numbers
from flashtemp.cli import camera, campaigns, effects, friction, laboratory, road, simulate, starting, studies, tyre

__all__ = ["COMMANDS", "CycloptsError", "app", "plain"]

app = App(
    name="flashtemp",
    help="Where the heat of a sliding rubber block goes, and what your model of it is missing.",
    help_epilogue="Any command with --debug shows where in the program a fault arose; with --log FILE everything that"
    " it says goes to that file too.",
    suppress_keyboard_interrupt=False,  # told below
)
COMMANDS: tuple[Any, ...] = (  # in the order of use
    starting.new, simulate.check, simulate.run, simulate.view, simulate.draw, laboratory.lab,
    studies.sweep, studies.converge, studies.sensitivity,
    camera.import_, campaigns.compare, campaigns.discover, campaigns.plan, campaigns.twin,
    studies.repetitions, studies.wait, effects.effects,
    friction.friction, friction.loads, road.spots, road.spectrum, tyre.tread, tyre.tyre,
)  # fmt: skip
for _number, _command in enumerate(COMMANDS):
    app.command(_command, name=_command.__name__.rstrip("_"), sort_key=_number)


def plain(words: list[str]) -> list[str]:
    """A command line as it is parsed: numbers of options without their units.  Raises BadInput."""
    return in_plain_numbers(words) if words[:1] == ["import"] else words


app.register_install_completion_command(sort_key=len(COMMANDS))
