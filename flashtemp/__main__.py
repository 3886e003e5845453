"""The command line: `flashtemp COMMAND`.  What takes time to load is loaded inside `main`, where Ctrl-C is answered."""

from __future__ import annotations

import os
import sys

from flashtemp.cli.ending import DONE, ended
from flashtemp.cli.interrupts import interruptible
from flashtemp.errors import BadInput, FlashtempError


def main(argv: list[str] | None = None) -> int:
    """Run one command and return its exit code (contract 5.1); with --debug a fault shows where it arose."""
    asked = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in asked
    try:
        with interruptible(last=argv is None) as interrupts:
            try:
                return _run([word for word in asked if word != "--debug"], debug)
            except Exception as fault:
                if interrupts.seen and not isinstance(fault, FlashtempError):  # an interrupt in another's clothes
                    raise KeyboardInterrupt from fault
                raise
    except BrokenPipeError:  # the reader of stdout has gone, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except (Exception, KeyboardInterrupt) as fault:
        if debug:
            import traceback

            traceback.print_exc()
        return ended(fault)


def _run(words: list[str], debug: bool) -> int:
    import warnings

    from flashtemp.cli.commands import CycloptsError, app

    if not debug:  # what becomes of it is told where it matters
        warnings.simplefilter("ignore", RuntimeWarning)
    try:
        code = app(words, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as fault:
        raise BadInput("flashtemp: " + " ".join(str(fault).split()) + " See flashtemp --help.") from fault
    return code if isinstance(code, int) else DONE


if __name__ == "__main__":
    sys.exit(main())
