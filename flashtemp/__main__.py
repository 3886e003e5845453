"""The command line: `flashtemp COMMAND`.

Slow imports happen inside `main`, where Ctrl-C is already handled.  `python -m flashtemp` would import from the
current folder first, which may contain somebody else's files; the lines above the imports prevent that.
"""
# ruff: noqa: E402  the current folder must leave the search path before anything is imported

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
from flashtemp.runs.results.live_state import record_end, record_start


def main(argv: list[str] | None = None) -> int:
    """Run one command and return its exit code (see `cli.exit_codes`).

    `argv`: the words of the command line, those of the process when not given.  With --debug an error prints its
    traceback; with --log FILE all output is also appended to that file.
    """
    if argv is None:
        exclude_current_folder()
        # matrices are small: on a shared machine, BLAS threads waiting for each other cost a factor of 5 to 200
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            os.environ.setdefault(name, "1")
        for stream in (sys.stdout, sys.stderr):  # the terminal's encoding may lack characters of a title
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="backslashreplace")
    try:
        words, log = split_log_option(list(sys.argv[1:] if argv is None else argv))
        with log_to_file(log, words):
            record_start()
            code = _run_and_handle_errors(words, argv is None)
            record_end(code)
            return code
    except (BadInput, OSError) as fault:  # the log file cannot be written
        return report_fault(fault)


def _run_and_handle_errors(words: list[str], last: bool) -> int:
    """Run one command, print any error, and return the exit code; `last`: the process ends afterwards."""
    debug = "--debug" in words
    try:
        with answer_interrupts(last) as interrupts:
            try:
                if last:
                    _ignore_local_settings()
                return _run([word for word in words if word != "--debug"], debug)
            except Exception as fault:
                # a library may turn the KeyboardInterrupt of a signal into an exception of its own
                if interrupts.is_requested and not isinstance(fault, FlashtempError):
                    raise KeyboardInterrupt from fault
                raise
    except BrokenPipeError:  # the reader of stdout has closed it, as in `| head`
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
    from flashtemp.cli.terminal import table_notes

    if not debug:  # overflow and 0/0 are checked where the result matters
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
