"""Files that arrive in a folder: found by polling, and complete once their size and time stay the same.

Polling works on network shares too, where the operating system reports no changes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from flashtemp.camera.importing.import_request import NO_CAMERA_FILE
from flashtemp.errors import BadInput

MAX_FOLDER_DEPTH = 4  # folders below the watched one that are searched


@dataclass(frozen=True)
class FileState:
    """Size in bytes and modification time in ns of a file; both change while it is being written."""

    size: int
    mtime_ns: int


def read_state(path: Path) -> FileState | None:
    """The state of a file; None where it cannot be examined."""
    try:
        state = path.stat()
    except OSError:
        return None
    return FileState(state.st_size, state.st_mtime_ns)


@dataclass
class FolderScanner:
    """Scanner of a folder and the folders in it; a file is complete if two scans in a row find the same state.

    An empty file is never complete.  Hidden files are left out, because copying programs write them, and so are links
    out of the folder, because whoever fills it chooses what they read.
    """

    folder: Path
    _last: dict[Path, FileState] = field(default_factory=dict)

    def scan_files(self) -> tuple[dict[Path, FileState], dict[Path, FileState]]:
        """Complete files, and files that may still be written, with their states.  BadInput where there is no folder.

        A file is absent from both while the operating system does not let it be examined.
        """
        now = dict(_iter_files(self.folder, self.folder.resolve()))
        complete = {p: s for p, s in now.items() if s.size and self._last.get(p) == s}
        self._last = now
        return complete, {p: s for p, s in now.items() if p not in complete}


def _iter_files(folder: Path, home: Path, depth: int = 0) -> Iterator[tuple[Path, FileState]]:
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError as fault:
        if depth:  # a folder inside that has just been removed
            return
        raise BadInput(f"{folder}: {fault.strerror}; give the folder in which camera files arrive") from fault
    for entry in entries:
        if entry.name.startswith("."):
            continue
        with suppress(OSError):  # it has been removed, or its writer has locked it
            if entry.is_dir(follow_symlinks=False):
                if depth < MAX_FOLDER_DEPTH:
                    yield from _iter_files(Path(entry.path), home, depth + 1)
            elif entry.is_symlink() and not Path(entry.path).resolve().is_relative_to(home):
                continue
            elif entry.is_file() and Path(entry.name).suffix.lower() not in NO_CAMERA_FILE:
                state = entry.stat()
                yield Path(entry.path), FileState(state.st_size, state.st_mtime_ns)
