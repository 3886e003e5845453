"""What lies in a laboratory's folder: cases, campaigns, recordings, templates, camera files, results, begun work."""

from __future__ import annotations

import glob
import os
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from flashtemp.errors import BadInput
from flashtemp.model import kinds
from flashtemp.runs import folders

DEEP, MOST = 4, 5000  # folders in folders, and files, that are looked at
CAMERA = {
    ".jpg", ".jpeg", ".fff", ".seq", ".csq", ".irb", ".csv", ".asc", ".txt", ".tif", ".tiff", ".png", ".mat", ".h5",
    ".hdf5",
}  # fmt: skip
RESULTS = {  # file that a result folder holds: the command that makes it
    "run.nc": "run", "verdict.json": "discover", "compare.json": "compare", "plan.json": "plan", "sweep.nc": "sweep",
    "sensitivity.json": "sensitivity",
}  # fmt: skip


@dataclass
class Listing:
    """Paths relative to the folder, by kind; `results` with the command that made them, `begun` with their owners."""

    cases: list[Path] = field(default_factory=list)
    campaigns: list[Path] = field(default_factory=list)
    templates: list[Path] = field(default_factory=list)
    recordings: list[Path] = field(default_factory=list)
    images: list[Path] = field(default_factory=list)
    results: dict[Path, str] = field(default_factory=dict)
    begun: dict[Path, folders.Owner] = field(default_factory=dict)

    @property
    def series(self) -> dict[str, int]:
        """Camera files that belong together, as `import` takes them, and how many they are.

        A folder whose names differ in numbers alone is one series; of any other every such series is a pattern.
        """
        folders: dict[Path, dict[str, list[Path]]] = {}
        for path in self.images:
            parts = re.split(r"\d+", path.name)
            folders.setdefault(path.parent, {}).setdefault("*".join(map(glob.escape, parts)), []).append(path)
        out: dict[str, int] = {}
        for folder, patterns in folders.items():
            for pattern, paths in patterns.items():
                alone = paths[0] if len(paths) == 1 else folder / pattern
                out[str(folder if len(patterns) == 1 else alone)] = len(paths)
        return out


def listing(folder: Path) -> Listing:
    """Everything in a folder that a page can open; hidden files are left out, links are not followed."""
    out = Listing()
    for path, names in _folders(folder):
        here = path.relative_to(folder)
        made = next((command for name, command in RESULTS.items() if name in names), None)
        if (owner := folders.owner(path)) is not None:
            out.begun[here] = owner
        elif made is not None:
            out.results[here] = made
        else:
            for name in sorted(names):
                _sort(out, folder, here / name)
    return out


def _folders(folder: Path) -> Iterator[tuple[Path, list[str]]]:
    """Folders in order, with the names of their files; what lies in a result is a part of it."""
    seen = 0
    for at, inside, names in os.walk(folder):
        path = Path(at)
        names = [n for n in names if not n.startswith(".") or n == folders.MARKER]
        closed = any(n in RESULTS or n == folders.MARKER for n in names)
        deep = len(path.relative_to(folder).parts) >= DEEP
        inside[:] = [] if closed or deep else sorted(n for n in inside if not n.startswith("."))
        seen += len(names)
        yield path, names
        if seen > MOST:
            return


def _sort(out: Listing, folder: Path, path: Path) -> None:
    """Put one file where it belongs."""
    suffix = path.suffix.lower()
    if suffix == ".toml":
        kind = {kinds.CASE: out.cases, kinds.CAMPAIGN: out.campaigns, kinds.TEMPLATE: out.templates}.get(
            kind_of(folder / path)
        )
        if kind is not None:
            kind.append(path)
    elif suffix == ".nc":
        out.recordings.append(path)
    elif suffix in CAMERA and not path.name.endswith(".look.png") and not (folder / path.with_suffix(".nc")).exists():
        out.images.append(path)


def kind_of(file: Path) -> str:
    """Whether a TOML file is a case, a campaign or a recording template; "" for any other."""
    named = "case" if file.name == "case.toml" else ""
    try:
        return kinds.kind(tomllib.loads(file.read_text(encoding="utf-8"))) or named
    except (OSError, ValueError, RecursionError):
        return named


def inside(folder: Path, name: str) -> Path:
    """A path that lies in the folder, whatever was asked for.  Raises BadInput."""
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise BadInput(f"{name}: lies outside the folder of this page; give a name in it")
    return path


def free_name(folder: Path, name: str) -> str:
    """That name, or name-2, name-3... where it is taken."""
    stem, suffix, n, free = Path(name).stem, Path(name).suffix, 1, name
    while (folder / free).exists() or folders.partials(folder / free):
        n += 1
        free = f"{stem}-{n}{suffix}"
    return free
