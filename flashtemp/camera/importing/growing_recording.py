"""A recording that grows while camera files arrive: complete files are imported by the template of the recording.

A file that cannot be read waits and is tried again, because it may still be written.  It is refused when it stays bad.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

from flashtemp.camera.importing import recording_import
from flashtemp.camera.importing.arriving_files import FileState, read_state
from flashtemp.camera.importing.import_options import ImportOptions, load_template
from flashtemp.camera.importing.import_request import sort_files
from flashtemp.camera.importing.recording_import import ImageImport, ImportResult
from flashtemp.errors import BadInput, describe_exception
from flashtemp.model import file_kinds
from flashtemp.model.case_file import read_toml

IMPORTED, WAITING, REFUSED, REPEATED = "imported", "waiting", "refused", "repeated"  # states of a camera file
GLOB_CHARACTERS = "*?["


@dataclass(frozen=True)
class RecordingTemplate:
    """A recording template in `path`: `patterns` of camera files as absolute paths, import `facts`, and the file `out`
    of the recording."""

    path: Path
    patterns: tuple[Path, ...]
    facts: ImportOptions
    out: Path

    @classmethod
    def from_file(cls, path: Path, arrivals: Path) -> RecordingTemplate | None:
        """The template in a file; None for another kind of file or without `out`.  Raises BadInput.

        Its patterns are relative to its own folder, as for an import, or else to the folder of the `arrivals`.
        """
        try:
            _, raw = read_toml(path)
        except BadInput:  # broken TOML of whatever kind: the commands that read it report it
            return None
        if file_kinds.detect_kind(raw) != file_kinds.TEMPLATE_KIND:
            return None
        names, out, facts = load_template(path)
        folders = dict.fromkeys((path.resolve().parent, arrivals.resolve()))
        patterns = tuple(folder / name for name in names for folder in folders)
        return None if out is None else cls(path, patterns, facts, Path(out).resolve())

    def accepts_file(self, file: Path) -> bool:
        """Whether a camera file, an absolute path, belongs to the recording."""
        return any(_matches_pattern(file, pattern) for pattern in self.patterns)

    @property
    def needs_order(self) -> bool:
        """Whether the time of a frame follows from the files before it, so that none may be left out."""
        return self.facts.times is None and self.facts.zero is None and self.facts.view != "points"


def _matches_pattern(file: Path, pattern: Path) -> bool:
    """Whether a path has the name, matches the pattern, or lies in the folder that a template states."""
    is_folder = not any(c in pattern.name for c in GLOB_CHARACTERS) and not pattern.suffix
    parts = (*pattern.parts, "*") if is_folder and len(file.parts) > len(pattern.parts) else pattern.parts
    return len(parts) == len(file.parts) and all(
        fnmatchcase(part, wanted) or part == wanted for part, wanted in zip(file.parts, parts, strict=True)
    )


@dataclass(frozen=True)
class FileNews:
    """A camera file that has just changed its `state`, with the `reason` if it is not imported."""

    file: Path
    state: str
    reason: str = ""


@dataclass
class _BadFile:
    """A file that could not be imported: its content when it was tried, the reason, and since when, s.

    `retry`: it is to be tried again, because it has changed or can be read by now.
    """

    content: tuple[FileState, FileState | None]
    reason: str
    since: float
    is_refused: bool = False
    retry: bool = False


@dataclass
class GrowingRecording:
    """The recording of a template and the camera files that it has taken so far.

    `result`: the import of all of them; None before the first.  `folder` takes temporary files of large imports.
    """

    template: RecordingTemplate
    folder: Path
    result: ImportResult | None = None
    taken: dict[Path, FileState] = field(default_factory=dict)
    repeated: dict[Path, FileState] = field(default_factory=dict)
    unfinished: dict[Path, float] = field(default_factory=dict)  # files that are being written, since when, s
    bad: dict[Path, _BadFile] = field(default_factory=dict)
    _announced: dict[Path, FileState] = field(default_factory=dict)
    _stalled: set[Path] = field(default_factory=set)
    _digests: dict[bytes, Path] = field(default_factory=dict)
    _images: ImageImport | None = None

    def take_files(
        self, complete: Mapping[Path, FileState], unfinished: Mapping[Path, FileState], now: float, patience: float
    ) -> list[FileNews]:
        """Import files that have arrived or changed, and say what happened to each.

        `now`, s of any clock; a file that stays bad for `patience` s is refused.
        """
        complete = {p: s for p, s in complete.items() if self.template.accepts_file(p)}
        self.unfinished = {p: self.unfinished.get(p, now) for p in unfinished if self.template.accepts_file(p)}
        self._review_files(complete)
        self._accept_same_content(complete)
        news: list[FileNews] = []
        while True:
            usable = self._usable_files(complete)
            if usable == self.taken or not usable:
                break
            try:
                news += self._import_files(usable)
            except _FileFault as fault:
                self._images, self.taken = None, {}
                if fault.file in complete:  # else it has left the folder: go on without it
                    news += self._hold_file(fault.file, complete[fault.file], fault.reason, now)
        news += [*self._refuse_files(now, patience), *self._report_stalled(now, patience)]
        order = {path: n for n, path in enumerate(sort_files(n.file for n in news))}
        return sorted(news, key=lambda item: order[item.file])

    @property
    def waiting_files(self) -> dict[Path, str]:
        """Files that are tried again, with the reason."""
        return {p: b.reason for p, b in self.bad.items() if not b.is_refused}

    @property
    def refused_files(self) -> dict[Path, str]:
        """Files that stayed bad, with the reason."""
        return {p: b.reason for p, b in self.bad.items() if b.is_refused}

    def _usable_files(self, complete: Mapping[Path, FileState]) -> dict[Path, FileState]:
        """Files to import, in order; where times follow from the order, only those before the first unusable one.

        Files that were imported stay if they have left the folder, or until they have been written anew.
        """
        gone = {p: s for p, s in self.taken.items() if p not in complete}
        out: dict[Path, FileState] = {}
        for path in sort_files([*complete, *self.unfinished, *gone]):
            if path in self.repeated:
                continue
            state = gone.get(path) or complete.get(path)
            if state is None or (path in self.bad and not self.bad[path].retry):
                if self.template.needs_order:
                    break
                continue
            out[path] = state
        return out

    def _review_files(self, complete: Mapping[Path, FileState]) -> None:
        """Decide which bad files are tried again, and forget repeated and bad files that have changed or gone."""
        for path, bad in list(self.bad.items()):
            if path not in complete:
                if path not in self.unfinished:
                    del self.bad[path]
            elif self._content(complete[path]) != bad.content:
                bad.retry = True
            elif not bad.is_refused:
                bad.retry = _find_read_fault(path, self.template.facts) is None
        self.repeated = {p: s for p, s in self.repeated.items() if complete.get(p) == s}

    def _accept_same_content(self, complete: Mapping[Path, FileState]) -> None:
        """Take over the new state of imported files that were written again with the same content."""
        for path, state in complete.items():
            if path in self.taken and self.taken[path] != state:
                try:
                    is_same = self._digests.get(_file_digest(path)) == path
                except _FileFault:
                    continue
                if is_same:
                    self.taken[path] = self._announced[path] = state

    def _content(self, state: FileState) -> tuple[FileState, FileState | None]:
        """What the import of a file depends on: its own state and that of the table of times."""
        times = self.template.facts.times
        return state, None if times is None else read_state(times)

    def _hold_file(self, path: Path, state: FileState, reason: str, now: float) -> list[FileNews]:
        """Keep a bad file for later; news unless the same was reported before."""
        old, content = self.bad.get(path), self._content(state)
        is_same = old is not None and old.content == content
        since, is_refused = (old.since, old.is_refused) if old is not None and is_same else (now, False)
        self.bad[path] = _BadFile(content, reason, since, is_refused)
        return [] if is_same else [FileNews(path, WAITING, reason)]

    def _refuse_files(self, now: float, patience: float) -> list[FileNews]:
        news = []
        for path, bad in self.bad.items():
            if not bad.is_refused and path not in self.unfinished and now - bad.since >= patience:
                bad.is_refused = True
                news.append(FileNews(path, REFUSED, bad.reason))
        return news

    def _report_stalled(self, now: float, patience: float) -> list[FileNews]:
        """News of files that are empty or have been written for a long time, once for each."""
        self._stalled &= self.unfinished.keys()
        late = [p for p, since in self.unfinished.items() if now - since >= patience and p not in self._stalled]
        self._stalled |= set(late)
        return [FileNews(path, WAITING, "empty, or still being written") for path in late]

    def _import_files(self, usable: dict[Path, FileState]) -> list[FileNews]:
        """Import files in order, going on where the last import ended if possible.  Raises _FileFault."""
        names = self._chosen_files(list(usable))
        if self.template.facts.view == "points":
            return self._import_tables(names, usable)
        before = list(self.taken.items())
        if self._images is None or list(usable.items())[: len(before)] != before or self._is_thinned:
            self._images, self._digests, self.taken = ImageImport(self.template.facts, self.folder), {}, {}
        news: list[FileNews] = []
        for path in names:
            if path in self.taken:
                continue
            digest = _file_digest(path)
            if digest in self._digests:
                self.repeated[path] = usable[path]
                news.append(FileNews(path, REPEATED, f"has the content of {self._digests[digest].name}; left out"))
                continue
            self._add_file(path)
            self._digests[digest] = path
            self.taken[path] = usable[path]
        self.taken = {p: s for p, s in usable.items() if p not in self.repeated}
        new = [path for path in self.taken if self._announced.get(path) != self.taken[path]]
        if new or self.result is None:
            self.result = self._make_recording(new)
        return [*self._announce(new), *news]

    def _announce(self, new: Sequence[Path]) -> list[FileNews]:
        """News of files that have been imported for the first time or with other content."""
        for path in self.taken:
            self.bad.pop(path, None)
        self._announced |= {path: self.taken[path] for path in new}
        return [FileNews(path, IMPORTED) for path in new]

    def _add_file(self, path: Path) -> None:
        assert self._images is not None
        try:
            self._images.add_file(path)
        except (BadInput, OSError) as fault:
            raise _FileFault(path, _first_line(fault)) from fault

    def _make_recording(self, new: Sequence[Path]) -> ImportResult:
        """The recording of all files; a fault that only their combination shows is one of the last new file."""
        assert self._images is not None
        try:
            return self._images.make_recording()
        except (BadInput, OSError) as fault:
            raise _FileFault([*self.taken, *new][-1], _first_line(fault)) from fault

    def _import_tables(self, names: list[Path], usable: dict[Path, FileState]) -> list[FileNews]:
        """Import tables of thermocouples, which are small, at once."""
        new = [path for path in names if self._announced.get(path) != usable[path]]
        try:
            self.result = recording_import.import_recording(names, self.template.facts)
        except (BadInput, OSError) as fault:
            raise _FileFault(new[-1] if new else names[-1], _first_line(fault)) from fault
        self.taken = dict(usable)
        return self._announce(new)

    @property
    def _is_thinned(self) -> bool:
        return (self.template.facts.every or 1) > 1

    def _chosen_files(self, names: list[Path]) -> list[Path]:
        """Every n-th file where the template says so, as the import does.  Raises _FileFault."""
        if not self._is_thinned:
            return names
        try:
            return recording_import.thin_files(names, self.template.facts)
        except (BadInput, OSError) as fault:
            raise _FileFault(names[0], _first_line(fault)) from fault


class _FileFault(Exception):
    """A camera file that cannot be imported, with the reason in one line."""

    def __init__(self, file: Path, reason: str):
        super().__init__(reason)
        self.file, self.reason = file, reason


def _find_read_fault(path: Path, facts: ImportOptions) -> str | None:
    """Why a file cannot be read on its own; None if it can."""
    try:
        if facts.view == "points":
            recording_import.import_recording([path], facts)
        else:
            ImageImport(facts).add_file(path)
    except (BadInput, OSError) as fault:
        return _first_line(fault)
    return None


def _first_line(fault: BadInput | OSError) -> str:
    return fault.lines[0] if isinstance(fault, BadInput) else describe_exception(fault)


def _file_digest(path: Path) -> bytes:
    """A number that two files share only if their contents are equal.  Raises _FileFault."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").digest()
    except OSError as fault:
        raise _FileFault(path, describe_exception(fault)) from fault
