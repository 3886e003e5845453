"""Permission to run the effect file of a case, which is a program: only files of the user, or with --trust."""

from __future__ import annotations

import os
from pathlib import Path

from flashtemp.physics.permissions import describe_other_writer

TRUST_REMEDY = "read that file; then add --trust, or copy case and file into a folder of your own"


def find_refusal(case_file: Path, folder: Path, file: Path) -> str | None:
    """Why an effect file of a case may not run without --trust, or None.

    It may run when nobody else can have written it or put it there, by the rule of OpenSSH's StrictModes:

    - it lies in the `folder` of the case or below;
    - the case file, the effect file, the folder of the case and all below it belong to the user who runs this;
    - every folder and link above, up to the root, belongs to the user or to root;
    - nobody else may write any of these, by the permissions for others or a group, or by an access list.  A group
      with the user as its only member is allowed, and so is a sticky folder (/tmp) above the folder of the case.

    This tests who put the files there, not who wrote them.
    """
    home, real = folder.resolve(), file.resolve()
    if not real.is_relative_to(home):
        return f"{file} would run as a program and lies outside the folder of the case; {TRUST_REMEDY}"
    if not hasattr(os, "geteuid"):
        return f"{file} would run as a program, and this system does not report its owner; {TRUST_REMEDY}"
    checked = [(file, home)]
    if case_file.is_file():  # a case may have been made in Python
        checked.append((case_file, case_file.resolve()))
    for path, own_from in checked:
        if why := describe_other_writer(path, own_from):
            return f"{file} would run as a program, and {why}; {TRUST_REMEDY}"
    return None
