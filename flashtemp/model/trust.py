"""Whether a case's own effect file, which is a program, may run: it is the user's own, or the user says so."""

from __future__ import annotations

import os
import stat
from pathlib import Path

REMEDY = "read that file; then add --trust, or copy case and file into a folder of your own"


def refusal(case_file: Path, folder: Path, file: Path) -> str | None:
    """Why an effect file of a case may not run without the user's word, or None.

    It may when it lies in the `folder` of the case or below, and folder, case file and effect file all belong to the
    user who runs this and cannot be written by everybody.  That tells who put the files there, not who wrote them.
    """
    home, real = folder.resolve(), file.resolve()
    if not real.is_relative_to(home):
        return f"{file} would run as a program and lies outside the folder of the case; {REMEDY}"
    if not hasattr(os, "geteuid"):
        return f"{file} would run as a program, and this system does not tell whose it is; {REMEDY}"
    written = [case_file.resolve()] if case_file.is_file() else []  # a case may have been made in Python
    for path in dict.fromkeys((*written, home, real, real.parent)):
        state = path.stat()
        if state.st_uid != os.geteuid():
            return f"{file} would run as a program, and {path} belongs to another user; {REMEDY}"
        if state.st_mode & stat.S_IWOTH:
            return f"{file} would run as a program, and everybody may write {path}; {REMEDY}"
    return None
