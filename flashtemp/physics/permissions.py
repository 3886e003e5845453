"""Check whether other users can change a file: the check that OpenSSH makes of files before it uses them.

OpenSSH calls it StrictModes (sshd_config(5); `safe_path` in misc.c): a file and every folder above it belong to the
user or to root, and nobody else may write to any of them.  Here symbolic links are followed and checked as well.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from functools import cache
from pathlib import Path

MAX_LINKS = 40  # as in Linux, path_resolution(7)
ROOT_USER = 0


def list_path_parts(path: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """Every folder and link on the way from the root to a path, and the file itself, each with its `lstat` result.

    Raises OSError where one is missing, or links form a circle.
    """
    rest = list(reversed(path.absolute().parts))
    here = Path(rest.pop())
    yield here, here.lstat()
    links = 0
    while rest:
        name = rest.pop()
        if name == os.pardir:
            here = here.parent
            continue
        part = here / name
        state = part.lstat()
        yield part, state
        if not stat.S_ISLNK(state.st_mode):
            here = part
            continue
        links += 1
        if links > MAX_LINKS:
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
        target = Path(os.readlink(part))
        if target.is_absolute():
            here = Path(target.anchor)
        rest += reversed(target.parts[1:] if target.is_absolute() else target.parts)


def describe_other_writer(path: Path, own_from: Path | None = None) -> str | None:
    """Describe who else can change the file or folder `path`; None when only the user and root can.

    Folders with the sticky bit, such as /tmp, are allowed on the way: users cannot change each other's entries there.
    From the folder `own_from` on, itself included, such folders are not allowed, and everything must belong to the
    user, not to root.  Raises OSError as `list_path_parts` does; POSIX only.
    """
    user, end = os.geteuid(), path.resolve()
    for part, state in list_path_parts(path):
        strict = own_from is not None and part.is_relative_to(own_from)
        if state.st_uid not in ({user} if strict else {user, ROOT_USER}):
            return f"{part} belongs to another user"
        if stat.S_ISLNK(state.st_mode):  # the target follows; permission to replace the link is that of its folder
            continue
        if not strict and part != end and stat.S_ISDIR(state.st_mode) and state.st_mode & stat.S_ISVTX:
            continue
        if state.st_mode & stat.S_IWOTH:
            return f"everybody may write {part}"
        if can_group_write(part, state):
            return f"other users of its group may write {part}"
    return None


def can_group_write(path: Path, state: os.stat_result) -> bool:
    """Whether other users may write to a file or folder as members of its group or by an access list."""
    if not state.st_mode & stat.S_IWGRP:
        return False
    return _has_access_list(path) or not is_private_group(state.st_gid, os.geteuid())


@cache
def is_private_group(group: int, user: int) -> bool:
    """Whether a group has the user's name and no other member (the convention of Debian and Fedora).

    Debian's OpenSSH accepts write permission of such a group, because with umask 002 every new file has it.
    """
    import grp
    import pwd

    try:
        entry, name = grp.getgrgid(group), pwd.getpwuid(user).pw_name
    except KeyError:
        return False
    members = {*entry.gr_mem, *(p.pw_name for p in pwd.getpwall() if p.pw_gid == group)}
    return entry.gr_name == name and members <= {name}


def _has_access_list(path: Path) -> bool:
    """Whether a POSIX access list exists; the group bits then show the mask of the list (acl(5))."""
    if not hasattr(os, "getxattr"):  # macOS
        return False
    try:
        os.getxattr(path, "system.posix_acl_access")
    except OSError:
        return False
    return True
