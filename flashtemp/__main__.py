"""The command line: `flashtemp COMMAND`."""

from __future__ import annotations

import errno
import os
import sys
import traceback
import warnings

from cyclopts import App, CycloptsError

from flashtemp import __version__
from flashtemp.cli import camera, campaigns, effects, friction, road, simulate, studies, tyre
from flashtemp.cli.terminal import BAD, DONE, FAILED, STOPPED, tell
from flashtemp.errors import BadInput, FlashtempError, Interrupted, short

app = App(
    name="flashtemp",
    help="Where the heat of a sliding rubber block goes, and what your model of it is missing.",
    help_epilogue="Any command with --debug shows where in the program a fault arose.",
    version=__version__,
    suppress_keyboard_interrupt=False,  # told below
)
COMMANDS = (
    simulate.run, studies.sweep, simulate.view, simulate.check, studies.converge, effects.effects,
    studies.repetitions, studies.wait, campaigns.compare, campaigns.discover, campaigns.plan, campaigns.twin,
    road.spots, road.spectrum, tyre.tread, tyre.tyre, friction.friction, friction.loads,
)  # fmt: skip
for _command in COMMANDS:
    app.command(_command)
app.command(camera.import_, name="import")
# what an operating system says of a path that a user gave
PATHS = (
    errno.ENAMETOOLONG,
    errno.ENOENT,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.EACCES,
    errno.EPERM,
    errno.ELOOP,
    errno.EROFS,
)


def main(argv: list[str] | None = None) -> int:
    """Run one command and return its exit code (contract 5.1); with --debug a fault shows where it arose."""
    asked = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in asked
    if not debug:  # what becomes of it is told where it matters
        warnings.simplefilter("ignore", RuntimeWarning)
    try:
        code = app(
            [word for word in asked if word != "--debug"],
            exit_on_error=False, print_error=False, result_action="return_value",
        )  # fmt: skip
        return code if isinstance(code, int) else DONE
    except BrokenPipeError:  # the reader of stdout has gone, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except (Exception, KeyboardInterrupt) as fault:
        if debug:
            traceback.print_exc()
        return _ended(fault)


def _ended(fault: BaseException) -> int:
    """Say in words how a command came to its end; its exit code."""
    if isinstance(fault, BadInput):
        tell(str(fault))
        return BAD
    if isinstance(fault, CycloptsError):
        tell("flashtemp: " + " ".join(str(fault).split()) + " See flashtemp --help.")
        return BAD
    if isinstance(fault, Interrupted | KeyboardInterrupt):
        tell(str(fault) or "interrupted")
        return STOPPED
    said = " ".join(str(fault).split())
    if isinstance(fault, OSError) and fault.errno in PATHS:
        tell(f"{short(str(fault.filename))}: {fault.strerror}; give a path that can be used")
        return BAD
    if isinstance(fault, FlashtempError | OSError):
        tell(f"the computation failed: {fault if isinstance(fault, FlashtempError) else said}")
    else:
        tell(f"the program failed: {type(fault).__name__}: {short(said)}; the same command with --debug shows where")
    return FAILED


if __name__ == "__main__":
    sys.exit(main())
