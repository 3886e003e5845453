"""The command that serves the laboratory's page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from flashtemp.cli.terminal import EXIT_DONE, print_message


def lab(
    folder: Path = Path(),
    /,
    *,
    browser: Annotated[bool, Parameter(negative="--no-browser", help="Open the page in the browser.")] = True,
) -> int:
    """The laboratory's page in the browser: camera files, cases, runs and verdicts of a folder.

    Parameters
    ----------
    folder
        Where your files are; the present folder when not given.
    """
    from flashtemp.lab.server import serve

    def print_address(address: str) -> None:
        print_message("Ctrl-C ends it; whatever runs then leaves what it has")
        print(address, flush=True)

    serve(folder, browser, print_address)
    return EXIT_DONE
