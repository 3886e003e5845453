"""All commands put together: `app`, which parses a command line and calls the command's function."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cyclopts import App, CycloptsError

from flashtemp.camera import import_options
from flashtemp.cli import camera, campaigns, effects, friction, laboratory, road, simulate, starting, studies, tyre
from flashtemp.cli.words import refuse_odd_words
from flashtemp.physics import units

__all__ = ["COMMANDS", "NAMES", "CycloptsError", "app", "plain"]

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
UNITS: dict[str, Mapping[str, str]] = {  # of a command's options
    "import": import_options.UNITS,
    "view": {"time": "s"},
    "wait": {"below": "degC"},
    "repetitions": {"distance": "m"},
    "friction": {"slowest": "m/s", "fastest": "m/s"},
    "spots": dict.fromkeys(("cutoff", "length", "width", "pixel", "rms", "rolloff"), "m")
    | {"pressure": "Pa", "modulus": "Pa"},
    "spectrum": {"highpass": "m", "pixel": "m"},
}
NAMES = tuple(command.__name__.rstrip("_") for command in COMMANDS)
for _number, (_name, _command) in enumerate(zip(NAMES, COMMANDS, strict=True)):
    app.command(_command, name=_name, sort_key=_number)


def plain(words: list[str]) -> list[str]:
    """A command line as it is parsed: numbers of options without their units.  Raises BadInput."""
    refuse_odd_words(words)
    return words[:1] + units.convert_options(words[1:], UNITS.get(words[0], {})) if words else words


app.register_install_completion_command(sort_key=len(COMMANDS))
