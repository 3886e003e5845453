"""What is to be imported: which camera files are meant, what is said of them, and where the recording goes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flashtemp.camera.import_options import Facts, load
from flashtemp.errors import BadInput

NO_CAMERA_FILE = {".toml", ".md", ".nc", ".xml", ".ini", ".py"}  # not taken out of a folder by itself


@dataclass(frozen=True)
class Request:
    """What is to be imported: names of `files`, patterns or folders, the `facts` said, and where the recording goes."""

    files: tuple[str, ...]
    facts: Facts
    out: Path | None

    @classmethod
    def of(cls, files: Sequence[str], facts: Facts, out: Path | None = None) -> Request:
        """Files, or one recording template (.toml), over which `facts` and `out` go.  Raises BadInput."""
        if len(files) != 1 or not files[0].endswith(".toml"):
            return cls(tuple(files), facts, out)
        template = Path(files[0])
        names, own, said = load(template)
        beside = tuple(str(template.parent / name) for name in names)
        return cls(beside, facts.over(said), out or (None if own is None else Path(own)))


def target(out: Path, overwrite: bool = False) -> Path:
    """Where a recording goes; BadInput where it cannot."""
    if out.suffix != ".nc":
        raise BadInput(f"{out}: a recording is NetCDF; give a name that ends in .nc")
    if out.exists() and not overwrite:
        raise BadInput(f"{out}: exists already; add --overwrite or choose another name")
    if (picture := out.with_suffix(".png")).exists() and not overwrite:
        raise BadInput(f"{picture}: exists already; add --overwrite or choose another name for the recording")
    if not out.parent.is_dir():
        raise BadInput(f"{out}: no folder {out.parent}; give a folder that exists")
    return out


def found(names: Sequence[str], folder: Path = Path()) -> list[Path]:
    """Files of names, patterns and folders in the order given; those of one pattern or folder by name.

    So are files of one folder that follow each other: a shell hands img10 over before img2.  Raises BadInput.
    """
    groups: list[list[Path]] = []
    single = False  # whether the last group is of files given one by one
    for name in names:
        path = folder / name
        some = _some(path)
        if some is None and single and groups[-1][0].parent == path.parent:
            groups[-1].append(path)
            continue
        if some is not None and not some:
            raise BadInput(f"{path}: no camera files there; give files, a folder or a pattern that matches some")
        single = some is None
        groups.append([path] if some is None else some)
    if not groups:
        raise BadInput("no camera files; give files, a folder or a recording template (.toml)")
    return [path for group in groups for path in sorted(group, key=_by_number)]


def _some(path: Path) -> list[Path] | None:
    """The files of a folder or pattern; None where the path is a file's own."""
    if path.is_dir():
        inside = [p for p in path.iterdir() if p.is_file() and not p.name.startswith(".")]
        return [p for p in inside if p.suffix.lower() not in NO_CAMERA_FILE]
    if not any(c in str(path) for c in "*?[") or path.exists():
        return None
    root = Path(path.anchor) if path.is_absolute() else Path()
    return [p for p in root.glob(str(path.relative_to(path.anchor))) if p.is_file()]


def _by_number(path: Path) -> list[int | str]:
    """Names in order of the numbers in them."""
    return [int(t) if t.isdigit() else t for t in re.split(r"(\d+)", str(path))]
