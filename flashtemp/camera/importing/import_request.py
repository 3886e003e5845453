"""Import requests: the camera files, the options stated for them, and the file of the recording."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from flashtemp.camera.importing.import_options import ImportOptions, load_template
from flashtemp.errors import BadInput

COPY_WORD = r"(?:copy|kopie|copie|copia|cópia|kopia|kopi|kopija|másolat)"
COPY_SUFFIX = re.compile(  # suffixes that Windows, macOS, browsers and Linux add to the name of a copy
    rf"(?: [-–] {COPY_WORD}(?: ?\((?P<a>\d+)\))?| {COPY_WORD}(?: (?P<b>\d+))?"
    rf"| ?\((?:(?:another|(?P<c>\d+)(?:st|nd|rd|th|\.)) )?{COPY_WORD}\)| ?\((?P<d>\d+)\))$",
    re.IGNORECASE,
)
ORDINALS = {"another": 2}  # of copies that Linux names in words
ORDER_NOTE_FILES = 6  # files that a note on their order lists
NO_CAMERA_FILE = {".toml", ".md", ".nc", ".xml", ".ini", ".py"}  # skipped in a folder


@dataclass(frozen=True)
class ImportRequest:
    """Files, patterns or folders to import, the `facts` stated for them, and the file `out` of the recording."""

    files: tuple[str, ...]
    facts: ImportOptions
    out: Path | None

    @classmethod
    def from_files(cls, files: Sequence[str], facts: ImportOptions, out: Path | None = None) -> ImportRequest:
        """Request from files, or from one recording template (.toml) that `facts` and `out` override."""
        if len(files) != 1 or not files[0].endswith(".toml"):
            return cls(tuple(files), facts, out)
        template = Path(files[0])
        names, template_out, template_facts = load_template(template)
        files = tuple(str(template.parent / name) for name in names)
        return cls(
            files, facts.merged_over(template_facts), out or (None if template_out is None else Path(template_out))
        )


def output_path(out: Path, overwrite: bool = False) -> Path:
    """The file of a recording.  BadInput if it cannot be written there."""
    if out.suffix != ".nc":
        raise BadInput(f"{out}: a recording is NetCDF; give a name that ends in .nc")
    if out.exists() and not overwrite:
        raise BadInput(f"{out}: exists already; add --overwrite or choose another name")
    if (picture := out.with_suffix(".png")).exists() and not overwrite:
        raise BadInput(f"{picture}: exists already; add --overwrite or choose another name for the recording")
    if not out.parent.is_dir():
        raise BadInput(f"{out}: no folder {out.parent}; give a folder that exists")
    return out


def expand_patterns(names: Sequence[str], folder: Path = Path()) -> list[Path]:
    """Files of names, patterns and folders in the order given; those of one pattern or folder in the order of names.

    Consecutive files of one folder are sorted too: a shell lists img10 before img2, and "img (1)" before "img".  Raises
    BadInput.
    """
    groups: list[list[Path]] = []
    single = False  # whether the last group consists of single files
    for name in names:
        path = folder / name
        some = _matching_files(path)
        if some is None and single and groups[-1][0].parent == path.parent:
            groups[-1].append(path)
            continue
        if some is not None and not some:
            raise BadInput(f"{path}: no camera files there; give files, a folder or a pattern that matches some")
        single = some is None
        groups.append([path] if some is None else some)
    if not groups:
        raise BadInput("no camera files; give files, a folder or a recording template (.toml)")
    return [path for group in groups for path in sort_files(group)]


def sort_files(paths: Iterable[Path]) -> list[Path]:
    """Files in the order of their names: numbers by value, a copy after its original."""
    return sorted(paths, key=_sort_key)


def _matching_files(path: Path) -> list[Path] | None:
    """The files of a folder or pattern; None for the path of a single file."""
    if path.is_dir():
        inside = [p for p in path.iterdir() if p.is_file() and not p.name.startswith(".")]
        return [p for p in inside if p.suffix.lower() not in NO_CAMERA_FILE]
    if not any(c in str(path) for c in "*?[") or path.exists():
        return None
    root = Path(path.anchor) if path.is_absolute() else Path()
    return [p for p in root.glob(str(path.relative_to(path.anchor))) if p.is_file()]


def _natural_key(text: str) -> tuple[int | str, ...]:
    """Sort key of a text: words at even places, numbers at odd ones."""
    return tuple(int(t) if k % 2 else t for k, t in enumerate(re.split(r"(\d+)", text.casefold())))


def split_copies(stem: str) -> tuple[str, tuple[int, ...]]:
    """A file's name without copy suffixes, and the number of each copy.

    >>> split_copies("IMG_7"), split_copies("IMG_7 (2)"), split_copies("IMG_7 - Copy (3)"), split_copies("IMG_7 copy")
    (('IMG_7', ()), ('IMG_7', (2,)), ('IMG_7', (3,)), ('IMG_7', (1,)))
    """
    marks: list[int] = []
    while mark := COPY_SUFFIX.search(stem):
        nth = next((n for word, n in ORDINALS.items() if word in mark[0].lower()), 1)
        marks.insert(0, int(mark["a"] or mark["b"] or mark["c"] or mark["d"] or nth))
        stem = stem[: mark.start()]
    return stem, tuple(marks)


def _sort_key(path: Path) -> tuple:
    """Sort key of a file: numbers by value, a copy after its original."""
    base, copies = split_copies(path.stem)
    return _natural_key(path.parent.as_posix()), _natural_key(base), copies, path.suffix.casefold(), path.name


def describe_order(files: Sequence[Path]) -> list[str]:
    """Notes on the order of files if their names leave it open; else empty."""
    bases = [split_copies(path.stem) for path in files]
    originals, folders = set(bases), {path.parent for path in files}
    places = [(path.parent, *base, path.suffix.casefold()) for path, base in zip(files, bases, strict=True)]
    reasons = []
    if len(folders) > 1 and len({path.name for path in files}) < len(files):
        reasons.append("files of one name in different folders, in the order in which the folders were given")
    if len(set(places)) < len(places):
        reasons.append("copies that are numbered alike, in the order of their names")
    elif any(copies and (base, ()) in originals for base, copies in bases):
        reasons.append("copies after the file that they bear the name of")
    if len({re.sub(r"\d+", "0", base.casefold()) for base, _ in bases}) > 1:
        reasons.append("names of different patterns, in the order of their names")
    if not reasons:
        return []
    some = ", ".join(path.name if len(folders) == 1 else path.as_posix() for path in files[:ORDER_NOTE_FILES])
    more = f" and {len(files) - ORDER_NOTE_FILES} more" if len(files) > ORDER_NOTE_FILES else ""
    return [f"order of the files: {some}{more} ({'; '.join(reasons)})"]
