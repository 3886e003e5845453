"""The command-line application: `app` parses a command line and calls the function of the command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cyclopts import App, CycloptsError, Group

from flashtemp.camera.importing import import_options
from flashtemp.cli import campaigns, friction, simulate, studies, web_app
from flashtemp.cli.argument_checks import refuse_odd_words
from flashtemp.physics import units

__all__ = ["COMMAND_FUNCTIONS", "COMMAND_NAMES", "CycloptsError", "app", "strip_units"]

OPTIONS_GROUP = Group("Options", sort_key=100)  # after the groups of commands

app = App(
    name="flashtemp",
    group_commands=OPTIONS_GROUP,
    help="Where the heat of a sliding rubber block goes, and what your model of it is missing.",
    help_epilogue="With --debug, any command prints the traceback of an error; with --log FILE, its output is also"
    " appended to that file.",
    suppress_keyboard_interrupt=False,  # `__main__` handles Ctrl-C
)
COMMAND_GROUPS: dict[str, tuple[Any, ...]] = {  # groups and order of the help: by task, in the order of use
    "Simulate": (
        simulate.new, simulate.check, simulate.run, simulate.view, simulate.draw, simulate.report, web_app.lab,
    ),
    "Study a case": (
        studies.sweep, studies.converge, studies.sensitivity, studies.repetitions, studies.wait, studies.effects,
    ),
    "Compare with measurements": (
        campaigns.import_, campaigns.compare, campaigns.watch, campaigns.discover, campaigns.plan, campaigns.twin,
    ),
    "Rubber and road": (
        friction.friction, friction.loads, friction.spots, friction.spectrum, friction.tread, friction.tyre,
    ),
}  # fmt: skip
COMMAND_FUNCTIONS: tuple[Any, ...] = tuple(command for commands in COMMAND_GROUPS.values() for command in commands)
SECOND_SPELLINGS = {  # an alias with the standard term of the field
    "wait": "min-wait",
    "loads": "load-dependence",
    "spots": "contact-map",
    "spectrum": "power-spectrum",
    "twin": "synthetic-campaign",
}
OPTION_UNITS: dict[str, Mapping[str, str]] = {  # units of the options of a command
    "import": import_options.IMPORT_OPTION_UNITS,
    "view": {"time": "s"},
    "watch": {"interval": "s", "patience": "s"},
    "wait": {"below": "degC"},
    "repetitions": {"distance": "m"},
    "friction": {"slowest": "m/s", "fastest": "m/s"},
    "spots": dict.fromkeys(("cutoff", "length", "width", "pixel", "rms", "rolloff"), "m")
    | {"pressure": "Pa", "modulus": "Pa"},
    "spectrum": {"highpass": "m", "pixel": "m"},
}
COMMAND_NAMES = tuple(command.__name__.rstrip("_") for command in COMMAND_FUNCTIONS)
CANONICAL_NAMES = {second: name for name, second in SECOND_SPELLINGS.items()}
for _number, (_title, _commands) in enumerate(COMMAND_GROUPS.items()):
    _group = Group(_title, sort_key=_number)
    for _command in _commands:
        _name = _command.__name__.rstrip("_")
        app.command(
            _command, name=_name, alias=SECOND_SPELLINGS.get(_name), group=_group, sort_key=COMMAND_NAMES.index(_name)
        )


def strip_units(words: list[str]) -> list[str]:
    """The words of a command line with the units of option values converted and removed.  Raises BadInput."""
    refuse_odd_words(words)
    return (
        words[:1] + units.convert_options(words[1:], OPTION_UNITS.get(CANONICAL_NAMES.get(words[0], words[0]), {}))
        if words
        else words
    )


app.register_install_completion_command(group=OPTIONS_GROUP)
