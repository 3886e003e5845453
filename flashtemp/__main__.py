"""The command line: `flashtemp COMMAND`."""

from __future__ import annotations

import os
import sys

from cyclopts import App, CycloptsError

from flashtemp import __version__
from flashtemp.cli import camera, campaigns, effects, friction, road, simulate, studies, tyre
from flashtemp.cli.terminal import BAD, DONE, FAILED, STOPPED, tell
from flashtemp.errors import BadInput, FlashtempError, Interrupted

app = App(
    name="flashtemp",
    help="Where the heat of a sliding rubber block goes, and what your model of it is missing.",
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


def main(argv: list[str] | None = None) -> int:
    """Run one command and return its exit code (contract 5.1)."""
    try:
        code = app(
            sys.argv[1:] if argv is None else argv,
            exit_on_error=False, print_error=False, result_action="return_value",
        )  # fmt: skip
        return code if isinstance(code, int) else DONE
    except BadInput as fault:
        tell(str(fault))
        return BAD
    except CycloptsError as fault:
        tell("flashtemp: " + " ".join(str(fault).split()) + " See flashtemp --help.")
        return BAD
    except Interrupted as fault:
        tell(str(fault))
        return STOPPED
    except KeyboardInterrupt:
        tell("interrupted")
        return STOPPED
    except FlashtempError as fault:
        tell(f"the computation failed: {fault}")
        return FAILED
    except BrokenPipeError:  # the reader of stdout has gone, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as fault:
        tell(f"the computation failed: {' '.join(str(fault).split())}")
        return FAILED


if __name__ == "__main__":
    sys.exit(main())
