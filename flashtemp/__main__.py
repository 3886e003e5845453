"""The command line: `flashtemp COMMAND`.  What takes time to load is loaded inside `main`, where Ctrl-C is answered.

`python -m flashtemp` searches the current folder first, where a stranger's files may lie; from here on it does not.
"""
# ruff: noqa: E402  what stands before the imports keeps them from the current folder

import os
import sys

PROGRAM_FOLDER = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
if __name__ == "__main__" and not sys.flags.safe_path and sys.path[0] != PROGRAM_FOLDER:
    del sys.path[0]

from flashtemp.cli.exit_codes import EXIT_DONE, report_fault
from flashtemp.cli.interrupts import answer_interrupts
from flashtemp.cli.log_file import log_to_file, split_log_option
from flashtemp.errors import BadInput, FlashtempError
from flashtemp.runs.results.current_folder import exclude_current_folder


def main(argv: list[str] | None = None) -> int:
    """Run one command and return its exit code (contract 5.1); with --debug a fault shows where it arose.

    With --log FILE everything that is said goes to the end of that file too.
    """
    if argv is None:
        exclude_current_folder()
        # small products: threads that wait for each other take 5 to 200 times as long on a shared machine
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            os.environ.setdefault(name, "1")
        for stream in (sys.stdout, sys.stderr):  # a title may hold letters that the terminal's code page has not
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="backslashreplace")
    try:
        asked, log = split_log_option(list(sys.argv[1:] if argv is None else argv))
        with log_to_file(log, asked):
            return _ended(asked, argv is None)
    except (BadInput, OSError) as fault:  # of the log itself
        return report_fault(fault)


def _ended(asked: list[str], last: bool) -> int:
    """One command from its first moment to its exit code."""
    debug = "--debug" in asked
    try:
        with answer_interrupts(last) as interrupts:
            try:
                if last:
                    _ignore_local_settings()
                return _run([word for word in asked if word != "--debug"], debug)
            except Exception as fault:
                if interrupts.is_requested and not isinstance(
                    fault, FlashtempError
                ):  # an interrupt in another's clothes
                    raise KeyboardInterrupt from fault
                raise
    except BrokenPipeError:  # the reader of stdout has gone, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_DONE
    except (Exception, KeyboardInterrupt) as fault:
        if debug:
            import traceback

            traceback.print_exc()
        return report_fault(fault)


def _ignore_local_settings() -> None:
    from flashtemp.physics.local_settings import ignore_local_settings

    ignore_local_settings()


def _run(words: list[str], debug: bool) -> int:
    import warnings

    from flashtemp.cli.commands import CANONICAL_NAMES, COMMAND_NAMES, CycloptsError, app, strip_units
    from flashtemp.cli.table_notes import table_notes

    if not debug:  # what becomes of it is told where it matters
        warnings.simplefilter("ignore", RuntimeWarning)
    try:
        with table_notes():
            code = app(strip_units(words), exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as fault:
        where = f"{words[0]} " if words and words[0] in (*COMMAND_NAMES, *CANONICAL_NAMES) else ""
        raise BadInput("flashtemp: " + " ".join(str(fault).split()) + f" See flashtemp {where}--help.") from fault
    return code if isinstance(code, int) else EXIT_DONE


if __name__ == "__main__":
    sys.exit(main())
