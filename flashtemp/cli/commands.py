"""All commands put together: `app`, which parses a command line and calls the command's function."""

from __future__ import annotations

from cyclopts import App, CycloptsError

from flashtemp.cli import camera, campaigns, effects, friction, laboratory, road, simulate, starting, studies, tyre

__all__ = ["COMMANDS", "CycloptsError", "app"]

app = App(
    name="flashtemp",
    help="Where the heat of a sliding rubber block goes, and what your model of it is missing.",
    help_epilogue="Any command with --debug shows where in the program a fault arose.",
    suppress_keyboard_interrupt=False,  # told below
)
COMMANDS = (
    starting.new,
    simulate.run, studies.sweep, simulate.draw, simulate.view, simulate.check, studies.converge, effects.effects,
    studies.repetitions, studies.wait, studies.sensitivity,
    campaigns.compare, campaigns.discover, campaigns.plan, campaigns.twin,
    road.spots, road.spectrum, tyre.tread, tyre.tyre, friction.friction, friction.loads, laboratory.lab,
)  # fmt: skip
for _command in COMMANDS:
    app.command(_command)
app.command(camera.import_, name="import")
