"""The folder of the web app: cases, campaigns, recordings, templates, camera files, results, unfinished runs."""

from __future__ import annotations

import csv
import fnmatch
import glob
import json
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.lab.file_name_conditions import find_conditions
from flashtemp.model import file_kinds
from flashtemp.model.case_file import MAX_TOML_BYTES, parse_toml
from flashtemp.runs.results import result_folder

MAX_LISTING_DEPTH, MAX_LISTED_FILES, MAX_LISTED_FOLDERS = 4, 5000, 2000
MAX_JSON_BYTES = 16 * 2**20  # of a JSON file that a page reads: a hundred times a usual verdict.json
TABLE_SUFFIXES, MAX_LINE_BYTES = {".csv", ".txt", ".asc"}, 1000  # of tables, and of one of their lines
MAX_NAME_BYTES = 255  # NAME_MAX of the usual file systems
CAMERA_SUFFIXES = {
    ".jpg", ".jpeg", ".fff", ".seq", ".csq", ".irb", ".csv", ".asc", ".txt", ".tif", ".tiff", ".png", ".mat", ".h5",
    ".hdf5",
}  # fmt: skip
RESULT_COMMANDS = {  # file in a result folder: its command; a study may contain its run
    "verdict.json": "discover", "compare.json": "compare", "plan.json": "plan", "sweep.nc": "sweep",
    "sensitivity.json": "sensitivity", "loads.json": "loads", "tread.json": "tread", "tyre.json": "tyre",
    "friction.json": "friction", "area.json": "friction", "run.nc": "run",
}  # fmt: skip


@dataclass
class FolderListing:
    """Paths relative to the folder, by kind; `results` with the command that made them, `begun` with their owners.

    `tables` are text files that are certainly no images: times of frames and readings of a load cell.  `omissions` are
    sentences on files that are not listed, with the reason.
    """

    cases: list[Path] = field(default_factory=list)
    campaigns: list[Path] = field(default_factory=list)
    templates: list[Path] = field(default_factory=list)
    recordings: list[Path] = field(default_factory=list)
    images: list[Path] = field(default_factory=list)
    tables: list[Path] = field(default_factory=list)
    results: dict[Path, str] = field(default_factory=dict)
    begun: dict[Path, result_folder.OwnerMarker] = field(default_factory=dict)
    omissions: list[str] = field(default_factory=list)

    @property
    def image_series(self) -> dict[str, int]:
        """{camera files that belong together, as `import` accepts them: their number}.

        A folder whose file names differ only in numbers is one series; in other folders each series is a pattern.
        Numbers that state a load or a speed (150kPa) divide a series where every part has several files.
        """
        folders: dict[Path, list[Path]] = {}
        for path in self.images:
            folders.setdefault(path.parent, []).append(path)
        out: dict[str, int] = {}
        tables: dict[Path, list[str]] = {}  # the name of a folder with tables would stand for them too
        for path in self.tables:
            tables.setdefault(path.parent, []).append(path.name)
        for folder, paths in folders.items():
            series = _group_series([path.name for path in paths], tables.get(folder, []))
            for pattern, names in series.items():
                alone = folder / (names[0] if len(names) == 1 else pattern)
                out[str(folder if len(series) == 1 and folder not in tables else alone)] = len(names)
        return out


def _group_series(names: list[str], others: list[str]) -> dict[str, list[str]]:
    """{pattern: names that differ only in its numbers}; no pattern matches a name of another series, or of `others`."""
    series: dict[str, list[str]] = {}
    for name in names:
        series.setdefault(_number_pattern(name), []).append(name)
    out: dict[str, list[str]] = {}
    for pattern, some in series.items():
        parts: dict[str, list[str]] = {}
        for name in some:
            parts.setdefault(_number_pattern(name, keep_conditions=True), []).append(name)
        # frames 100ms, 200ms ... state their times: a part of one file is no series
        out |= parts if all(len(part) > 1 for part in parts.values()) else {pattern: some}
    return {
        (p.replace("*", "[0-9]*") if sum(fnmatch.fnmatchcase(n, p) for n in (*names, *others)) > len(some) else p): some
        for p, some in out.items()
    }


def _number_pattern(name: str, keep_conditions: bool = False) -> str:
    """A file name with * for every number, those that state a condition kept on request."""
    kept = find_conditions(name) if keep_conditions else []
    places = [m for m in re.finditer(r"\d+", name) if not any(a <= m.start() < b for a, b in kept)]
    ends = [0, *(m.end() for m in places)]
    starts = [*(m.start() for m in places), len(name)]
    return "*".join(glob.escape(name[a:b]) for a, b in zip(ends, starts, strict=True))


def list_folder(folder: Path) -> FolderListing:
    """All files of a folder that a page can open; hidden files are omitted, links are not followed."""
    out = FolderListing()
    for path, names in _walk_folders(folder, out.omissions):
        relative = path.relative_to(folder)
        made = next((command for name, command in RESULT_COMMANDS.items() if name in names), None)
        if result_folder.MARKER_FILE in names and (owner := read_owner(path)) is not None:
            out.begun[relative] = owner
        elif made is not None:
            out.results[relative] = made
        else:
            for name in sorted(names):
                _add_file(out, folder, relative / name)
    traces: set[Path] = {trace for campaign in out.campaigns for trace in _load_cell_files(folder, campaign)}
    tables = traces | _find_time_tables(folder, out.images)
    out.tables = [path for path in out.images if path in tables]
    out.images = [path for path in out.images if path not in tables]
    return out


def _find_time_tables(folder: Path, images: list[Path]) -> set[Path]:
    """Text files that are certainly tables with the time of every frame; of names that differ in numbers alone, all
    are read only if the first is one."""
    groups: dict[Path, list[Path]] = {}
    for path in images:
        if path.suffix.lower() in TABLE_SUFFIXES:
            groups.setdefault(path.with_name(_number_pattern(path.name)), []).append(path)
    found: set[Path] = set()
    for paths in groups.values():
        if _is_time_table(folder, paths[0]):
            found.update(path for path in paths if _is_time_table(folder, path))
    return found


def _is_time_table(folder: Path, path: Path) -> bool:
    """Whether a text file has columns file and time, and its first row names a file beside it."""
    file = find_own_file(folder, path)
    if file is None:
        return False
    try:
        with file.open("rb") as opened:
            lines = [opened.readline(MAX_LINE_BYTES).decode("latin-1") for _ in range(2)]
    except OSError:
        return False
    head, row = (next(csv.reader([line.strip()], delimiter=_find_separator(lines[0])), []) for line in lines)
    names = [re.split(r"[\s,(\[]", cell.strip().lower())[0] for cell in head]
    if not {"file", "time"} <= set(names) or len(row) != len(names):
        return False
    return os.path.lexists(file.parent / Path(row[names.index("file")].strip()).name)


def _find_separator(line: str) -> str:
    return max(";\t,", key=line.count)


def list_image_folders(folder: Path) -> list[str]:
    """Folders in which camera files may arrive, those with camera files or without any file first; no results."""
    found = []
    for path, names in _walk_folders(folder, []):
        if path != folder and not any(n in RESULT_COMMANDS or n == result_folder.MARKER_FILE for n in names):
            found.append((any(Path(n).suffix.lower() not in CAMERA_SUFFIXES for n in names), path.relative_to(folder)))
    return [path.as_posix() for _, path in sorted(found)]


def _load_cell_files(folder: Path, campaign: Path) -> Iterator[Path]:
    """Paths, relative to the folder, of the load-cell traces that a campaign lists."""
    try:
        rows = parse_toml((folder / campaign).read_text(encoding="utf-8")).get("force", [])
    except (OSError, ValueError, RecursionError):
        return
    for row in rows if isinstance(rows, list) else ():
        if isinstance(row, dict) and isinstance(row.get("file"), str):
            yield Path(os.path.normpath(campaign.parent / row["file"]))


def _walk_folders(folder: Path, omissions: list[str]) -> Iterator[tuple[Path, list[str]]]:
    """(folder, names of its files) in order; folders inside a result are not entered."""
    n_files = n_undecodable = 0
    for n_folders, (at, inside, names) in enumerate(os.walk(folder), 1):
        path = Path(at)
        n_undecodable += sum(not _is_utf8(n) for n in (*names, *inside))
        names = [n for n in names if _is_utf8(n) and (not n.startswith(".") or n == result_folder.MARKER_FILE)]
        closed = any(n in RESULT_COMMANDS or n == result_folder.MARKER_FILE for n in names)
        deep = len(path.relative_to(folder).parts) >= MAX_LISTING_DEPTH
        inside[:] = [] if closed or deep else sorted(n for n in inside if _is_utf8(n) and not n.startswith("."))
        yield path, names if closed else sorted(names)[: MAX_LISTED_FILES - n_files]
        n_files += len(names)
        if n_files > MAX_LISTED_FILES or n_folders >= MAX_LISTED_FOLDERS:
            omissions.append(
                f"Only the first {MAX_LISTED_FILES} files in {MAX_LISTED_FOLDERS} folders are listed; "
                "serve a smaller folder to see the others."
            )
            break
    if n_undecodable:
        omissions.append(f"{n_undecodable} files or folders whose names are not UTF-8 are left out; rename them.")


def _is_utf8(name: str) -> bool:
    """Whether a name of the file system is text (os.fsdecode leaves lone surrogates for other bytes)."""
    return name.isascii() or not any("\ud800" <= c <= "\udfff" for c in name)


def _add_file(out: FolderListing, folder: Path, path: Path) -> None:
    """Add one file to the list of its kind."""
    suffix = path.suffix.lower()
    if suffix == ".toml":
        kind = {
            file_kinds.CASE_KIND: out.cases,
            file_kinds.CAMPAIGN_KIND: out.campaigns,
            file_kinds.TEMPLATE_KIND: out.templates,
        }.get(kind_of(folder / path))
        if kind is not None:
            kind.append(path)
    elif suffix == ".nc":
        out.recordings.append(path)
    elif (
        suffix in CAMERA_SUFFIXES
        and not path.name.endswith(".look.png")
        and not (folder / path.with_suffix(".nc")).exists()
    ):
        out.images.append(path)


def kind_of(file: Path) -> str:
    """Whether a TOML file is a case, a campaign or a recording template; "" for any other."""
    default = "case" if file.name == "case.toml" else ""
    try:
        if not _is_short_file(file):
            return ""
        return file_kinds.detect_kind(parse_toml(file.read_text(encoding="utf-8"))) or default
    except (OSError, ValueError, RecursionError):
        return default


def read_owner(folder: Path) -> result_folder.OwnerMarker | None:
    """The owner of a working folder; None where its marker is not that of a flashtemp command."""
    try:
        return result_folder.read_marker(folder) if _is_short_file(folder / result_folder.MARKER_FILE) else None
    except (OSError, ValueError, RecursionError):
        return None


def _is_short_file(file: Path) -> bool:
    """Whether a file is regular and short: reading a pipe could block, a large file could fill the memory."""
    state = file.stat()
    return stat.S_ISREG(state.st_mode) and state.st_size <= MAX_TOML_BYTES


def resolve_inside(folder: Path, name: str) -> Path:
    """The resolved path of a name in the folder.  Raises BadInput if it is outside, hidden, or not a file name."""
    try:
        path, home = (folder / name).resolve(), folder.resolve()
        os.lstat(path)
    except FileNotFoundError:
        pass
    except NotADirectoryError as fault:
        raise BadInput(
            f"{escape_control(name)}: a part of the path is a file; give the name of a file in a folder"
        ) from fault
    except (OSError, ValueError, RuntimeError) as fault:  # too long, a NUL byte, links in a circle
        raise BadInput(f"{escape_control(name)!r}: not a valid file name; give a name in this folder") from fault
    if not path.is_relative_to(home):
        raise BadInput(f"{escape_control(name)}: outside the folder of this page; give a name inside it")
    if has_hidden_part(path.relative_to(home)) or has_hidden_part(Path(name)):
        raise BadInput(f"{escape_control(name)}: hidden files are not opened here; give a name without a leading dot")
    return path


def find_own_file(folder: Path, name: str | Path) -> Path | None:
    """A regular file of the folder; None where there is none or a link leads out of the folder."""
    try:
        path = resolve_inside(folder, str(name))
        return path if path.is_file() else None
    except (BadInput, OSError):
        return None


def read_json(folder: Path, name: str | Path) -> dict[str, Any]:
    """A JSON object of the folder; {} where it is missing.  Raises BadInput for a damaged or too large file."""
    path = find_own_file(folder, name)
    try:
        if path is None:
            return {}
        if path.stat().st_size > MAX_JSON_BYTES:
            raise BadInput(f"{path}: larger than {MAX_JSON_BYTES // 2**20} MiB; open it with a text editor")
        found = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(found, dict):
            raise TypeError
    except (OSError, ValueError, TypeError, RecursionError) as fault:
        raise BadInput(f"{path}: cannot be read ({type(fault).__name__}); create it again or remove it") from fault
    return found


def read_json_quietly(folder: Path, name: str | Path) -> dict[str, Any]:
    """A JSON object of the folder as `read_json`; {} also where that raises, for lists of many results."""
    try:
        return read_json(folder, name)
    except BadInput:
        return {}


def has_hidden_part(path: Path) -> bool:
    """Whether a part of a path other than `..` begins with a dot."""
    return any(part.startswith(".") and part != ".." for part in path.parts)


def escape_control(text: str) -> str:
    r"""Escape every character that is not printable: line breaks, direction marks, lone surrogates.

    >>> escape_control("a\nb\u202ec")
    'a\\nb\\u202ec'
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def free_name(folder: Path, name: str) -> str:
    """The name, or name-2, name-3 ... where it exists."""
    stem, suffix, n, free = Path(name).stem, Path(name).suffix, 1, name
    while os.path.lexists(folder / free) or result_folder.list_working_folders(folder / free):
        n += 1
        free = f"{stem}-{n}{suffix}"
    return free
