"""The command `lab`: serve the web app."""

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
    """Open the web app in the browser: camera files, cases, runs and verdicts of a folder.

    Parameters
    ----------
    folder
        Folder with your files; the current folder when not given.
    """
    from flashtemp.lab.server import serve

    def print_address(address: str) -> None:
        print_message("stop with Ctrl-C; running commands save a checkpoint first")
        print(address, flush=True)

    serve(folder, browser, print_address)
    return EXIT_DONE
