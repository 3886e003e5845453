"""Campaigns: a stated case, and the recordings and load-cell time series that are compared with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera import recording
from flashtemp.camera.importing import thermocouple_files
from flashtemp.camera.recording import Recording
from flashtemp.comparison.entry_values import (
    describe_table_as_recording,
    find_camera_fault,
    find_noise_fault,
    read_stated_noise,
)
from flashtemp.comparison.frame_means import AveragedFrames
from flashtemp.comparison.known_inputs import StatedUncertainty, read_known
from flashtemp.comparison.planned_recording import make_planned_recording
from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import BadInput, suggest_name
from flashtemp.model import case as cases
from flashtemp.model import case_file, file_kinds, schema
from flashtemp.physics import units
from flashtemp.physics.interpolation import read_xy_pairs
from flashtemp.physics.tables.column_matching import FRICTION, TIME

MAX_FREE_SD = 3.0  # relative standard deviation of a free key: a factor of 20
TOP_KEYS = {"title", "case", "free", "known", "candidates", "recording", "force"}
ENTRY_KEYS = {
    "recording": {"file", "view", "points", "with", "sigma_K", "held_out", "camera"},
    "force": {"file", "with", "sigma", "held_out"},
}
DEFAULT_CAMPAIGN_FILE = "campaign.toml"


CaseLoader = Callable[..., cases.Case]  # loads the case with overrides
RecordingLoader = Callable[[Path], Recording]  # reads a recording file


@dataclass(frozen=True)
class RecordingEntry:
    """A recording of a campaign: overrides `given` of the case, noise `sigma_K` of one pixel of one frame.

    `means` says over which frames of the camera each frame is averaged; None: over none.
    """

    file: str
    recording: Recording
    given: dict[str, Any] = field(default_factory=dict)
    sigma_K: float | None = None
    held_out: bool = False
    means: AveragedFrames | None = None


@dataclass(frozen=True)
class LoadCellEntry:
    """A time series of the load cell: `time` (n,) s, friction coefficient `mu` (n,), `sigma` of one reading."""

    file: str
    time: tuple[float, ...]
    mu: tuple[float, ...]
    given: dict[str, Any] = field(default_factory=dict)
    sigma: float | None = None
    held_out: bool = False


@dataclass(frozen=True)
class Condition:
    """All measurements with the same overrides `given` of the case, which need one simulation."""

    given: dict[str, Any]
    views: tuple[RecordingEntry, ...]
    forces: tuple[LoadCellEntry, ...]

    @property
    def entries(self) -> tuple[RecordingEntry | LoadCellEntry, ...]:
        return (*self.views, *self.forces)

    @property
    def words(self) -> str:
        return describe_overrides(self.given)


@dataclass(frozen=True, repr=False)
class Campaign(DisplayMixin):
    """A `case` file, its `free` nuisance parameters, the recordings `views` and `forces`; `folder` of relative paths.

    `candidates`: effects that may be missing.  `trust`: effect files of the case run whoever owns them.  `priors`
    {free key: relative standard deviation} and `known` {other key: standard deviation} as the campaign states them.
    `awaited`: files of entries that do not exist yet, where they may be missing.  `file_name`: that of the campaign in
    its folder.
    """

    title: str
    case: Path
    free: tuple[str, ...]
    views: tuple[RecordingEntry, ...]
    forces: tuple[LoadCellEntry, ...]
    folder: Path
    candidates: tuple[str, ...] | None = None
    trust: bool = False
    priors: dict[str, float] = field(default_factory=dict)
    known: dict[str, StatedUncertainty] = field(default_factory=dict)
    awaited: tuple[str, ...] = ()
    file_name: str = DEFAULT_CAMPAIGN_FILE

    @property
    def path(self) -> Path:
        """The path to give a command: the folder, or the file if it has its own name or is in the current folder."""
        is_default = self.file_name == DEFAULT_CAMPAIGN_FILE and self.folder != Path()
        return self.folder if is_default else self.folder / self.file_name

    @property
    def entries(self) -> tuple[RecordingEntry | LoadCellEntry, ...]:
        return (*self.views, *self.forces)

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """Entries grouped by equal overrides, in the order of their first appearance."""
        groups: dict[str, Condition] = {}
        for entry in self.entries:
            key = repr(sorted((k, _as_float(v)) for k, v in entry.given.items()))
            group = groups.get(key, Condition(entry.given, (), ()))
            if isinstance(entry, RecordingEntry):
                groups[key] = replace(group, views=(*group.views, entry))
            else:
                groups[key] = replace(group, forces=(*group.forces, entry))
        return tuple(groups.values())

    def load(self, given: dict[str, Any]) -> cases.Case:
        """The case with the overrides `given` of one entry."""
        return cases.load_case(self.case, given, trust=self.trust)

    def to_table(self) -> DisplayTable:
        head = ("file", "condition", "held out")
        rows = [(entry.file, describe_overrides(entry.given), entry.held_out) for entry in self.entries]
        return DisplayTable(
            f"Campaign '{self.title}'", rows, head, [f"case {self.case}", f"free: {', '.join(self.free)}"]
        )

    def __str__(self) -> str:
        lines = [f"Campaign '{self.title}': {len(self.views)} recordings, {len(self.forces)} load-cell traces"]
        for entry in self.entries:
            lines.append(f"  {entry.file}: {describe_overrides(entry.given)}{' (held out)' if entry.held_out else ''}")
        return "\n".join(lines)


def describe_overrides(given: dict[str, Any]) -> str:
    """A condition in words, from its overrides.

    >>> describe_overrides({"schedule.speed": 0.1}), describe_overrides({})
    ('schedule.speed = 0.1', 'the case')
    """
    return ", ".join(f"{k} = {v:g}" if isinstance(v, float) else f"{k} = {v}" for k, v in given.items()) or "the case"


def load(
    path: str | Path, planned: bool = False, trust: bool = False, limit: float | None = None, may_miss: bool = False
) -> Campaign:
    """Read campaign.toml (or a folder that contains it) and all files that it refers to.

    With `planned`, a recording may state a `view` instead of a file; it is then empty, with the pixels and frames of a
    typical camera.  `trust` lets effect files of the case run whoever owns them; `limit`: GB of memory for reading one
    recording.  With `may_miss`, entries whose files do not exist yet are `awaited`.  Raises BadInput with all faults at
    once, one line each.
    """
    path = Path(path)
    file = path / DEFAULT_CAMPAIGN_FILE if path.is_dir() else path
    if not file.is_file():
        raise BadInput(case_file.describe_missing_file(path, file_kinds.CAMPAIGN_KIND))
    text, raw = case_file.read_toml(file)
    return read_tables(text, raw, file, planned, trust, partial(recording.load, limit=limit), may_miss)


def read_tables(
    text: str,
    raw: dict[str, Any],
    file: Path,
    planned: bool,
    trust: bool,
    load_recording: RecordingLoader,
    may_miss: bool = False,
) -> Campaign:
    """The campaign of a file, from its `text` and parsed tables `raw`; arguments as of `load`.  Raises BadInput."""
    file_kinds.require_kind(file_kinds.CAMPAIGN_KIND, raw, file, file.name)
    reader = _CampaignReader(case_file.KeyLocations(str(file), text), file.parent, planned, load_recording, may_miss)
    for key in raw.keys() - TOP_KEYS:
        reader.add_fault(key, f"unknown key{suggest_name(key, sorted(TOP_KEYS))}")
    case = reader.read_case(raw)
    stated_case = reader.load_stated_case(case, trust)
    load_case_with = None if case is None or stated_case is None else partial(cases.load_case, case, trust=trust)
    entries = {kind: reader.read_entries(raw, kind) for kind in ENTRY_KEYS}
    views = {n: v for n, e in enumerate(entries["recording"], 1) if (v := reader.read_recording(e, n, load_case_with))}
    forces = {n: f for n, e in enumerate(entries["force"], 1) if (f := reader.read_load_cell(e, n, load_case_with))}
    reader.refuse_repeated("recording", {n: v for n, v in views.items() if "file" in entries["recording"][n - 1]})
    reader.refuse_repeated("force", forces)
    if not reader.faults and not views and not forces and not reader.awaited:
        reader.faults.append(f"{file}: holds no [[recording]] and no [[force]]; add at least one")
    priors = reader.read_priors(raw)
    free = reader.read_free_keys(tuple(priors) if priors is not None else reader.read_names(raw, "free"), stated_case)
    overrides = [e.get("with", {}) for e in (*entries["recording"], *entries["force"])]
    known = reader.read_uncertainties(raw, stated_case, free, overrides)
    candidates = reader.read_candidates(raw, stated_case)
    if fault := case_file.find_title_fault(raw.get("title", "")):
        reader.add_fault("title", fault)
    if reader.faults or case is None or stated_case is None:
        raise BadInput(*reader.faults)
    title = raw.get("title", file.resolve().parent.name)
    entered = tuple(views.values()), tuple(forces.values())
    awaited = tuple(dict.fromkeys(reader.awaited))
    return Campaign(
        title, case, free, *entered, file.parent, candidates, trust, priors or {}, known, awaited, file.name
    )


@dataclass(frozen=True)
class _CampaignReader:
    """Reader of a campaign file: `where` maps keys to lines, `folder` is that of the file; it collects `faults`."""

    where: case_file.KeyLocations
    folder: Path
    planned: bool
    load_recording: RecordingLoader
    may_miss: bool = False
    faults: list[str] = field(default_factory=list)
    awaited: list[str] = field(default_factory=list)

    def add_fault(self, key: str, text: str, nth: int = 1) -> None:
        """Add a fault of a key, or of the `nth` table of that name."""
        self.faults.append(f"{self.where(key, nth)}: {text}")

    def add_entry_fault(self, kind: str, number: int, *texts: str) -> None:
        """Add faults of the entry `number` of a kind, with its line."""
        line = self.where.find_line(kind, number)
        place = f"{self.where.file}:{line}" if line else self.where.file
        self.faults.extend(f"{place}: {kind} {number}: {text}" for text in texts)

    def read_case(self, raw: dict[str, Any]) -> Path | None:
        """Path of the case file; None, with a fault, where it does not exist."""
        name = raw.get("case", "case.toml")
        if not isinstance(name, str):
            self.add_fault("case", f"{name!r}; give the name of a case file in quotes")
            return None
        path = self.folder / name
        if not _path_exists(path):
            self.add_fault("case", f"no file '{name}' in {self.folder}; give the case file of the campaign")
            return None
        return path

    def load_stated_case(self, case: Path | None, trust: bool) -> cases.Case | None:
        """The case without overrides; None, with its faults, where it cannot be loaded."""
        try:
            return None if case is None else cases.load_case(case, trust=trust)
        except BadInput as fault:
            self.faults.extend(fault.lines)
            return None

    def read_entries(self, raw: dict[str, Any], kind: str) -> list[dict[str, Any]]:
        """Tables [[recording]] or [[force]]; unknown keys are faults."""
        entries = raw.get(kind, [])
        if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            self.add_fault(kind, f"write [[{kind}]] and its keys below it")
            return []
        for number, entry in enumerate(entries, 1):
            for key in entry.keys() - ENTRY_KEYS[kind]:
                self.add_entry_fault(kind, number, f"{key}: unknown key{suggest_name(key, sorted(ENTRY_KEYS[kind]))}")
        return entries

    def read_names(self, raw: dict[str, Any], key: str) -> tuple[str, ...] | None:
        """A list of names; None where the key is missing."""
        value = raw.get(key, [])
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            self.add_fault(key, f"{value!r}; give a list of names in quotes")
            return None
        return tuple(value) if key in raw else None

    def read_priors(self, raw: dict[str, Any]) -> dict[str, float] | None:
        """Free keys with the relative standard deviations of their priors; None where `free` is a list."""
        given = raw.get("free")
        if not isinstance(given, dict):
            return None
        flat = case_file.flatten_tables(given)  # contact.spot_fraction without quotes is a table in a table
        for key in flat.keys() & given.keys():
            table, _, name = key.rpartition(".")
            if name in (inside if isinstance(inside := given.get(table), dict) else {}):
                self.add_fault("free", f"'{key}' is listed twice; once is enough")
        for key, sd in flat.items():
            if isinstance(sd, bool) or not isinstance(sd, (int, float)) or not 0.0 < sd <= MAX_FREE_SD:
                self.add_fault(
                    "free", f"{key}: {sd!r}; give its relative standard deviation, a number > 0 and <= {MAX_FREE_SD:g}"
                )
        return flat

    def read_uncertainties(
        self, raw: dict[str, Any], stated_case: cases.Case | None, free: tuple[str, ...], overrides: list[Any]
    ) -> dict[str, StatedUncertainty]:
        """Stated uncertainties of fixed inputs, by key; `overrides`: the tables `with` of all entries."""
        if stated_case is None or "known" not in raw:
            return {}
        uncertainties, faults = read_known(raw["known"], stated_case, free, overrides)
        for fault in faults:
            self.add_fault("known", fault)
        return uncertainties

    def read_candidates(self, raw: dict[str, Any], stated_case: cases.Case | None) -> tuple[str, ...] | None:
        """Effects that may be missing; each must be known to the case."""
        names = self.read_names(raw, "candidates")
        known = cases.collect_effects() if stated_case is None else stated_case.known_effects
        for name in dict.fromkeys(n for n in names or () if (names or ()).count(n) > 1):
            self.add_fault("candidates", f"effect '{name}' is listed twice; once is enough")
        for name in names or ():
            if name not in known:
                is_file = name.endswith(".py")
                what = (
                    "; list a file of your own in the candidates of the case" if is_file else suggest_name(name, known)
                )
                self.add_fault("candidates", f"effect '{name}' is not in the catalogue{what}")
        return names

    def read_free_keys(self, given: tuple[str, ...] | None, stated_case: cases.Case | None) -> tuple[str, ...]:
        """Free keys, by default those of the case; each must be a number of its physics and appear once."""
        if stated_case is None:
            return ()
        free = stated_case.free if given is None else given
        for n, key in enumerate(free):
            if fault := schema.find_free_key_fault(key, stated_case.values, stated_case.known_effects):
                self.add_fault("free", fault)
            elif key in free[:n]:
                self.add_fault("free", f"'{key}' is listed twice; once is enough")
        return free

    def refuse_repeated(self, kind: str, entries: Mapping[int, RecordingEntry] | Mapping[int, LoadCellEntry]) -> None:
        """Add a fault for entries, by number, that repeat an earlier one: a measurement counts once."""
        for number, entry in entries.items():
            for earlier, other in entries.items():
                if earlier >= number:
                    break
                if _is_same_measurement(entry, other, self.folder):
                    what = f"'{entry.file}' holds the same measurement as {kind} {earlier}, '{other.file}'"
                    self.add_entry_fault(kind, number, f"file: {what}; list it once")
                    break

    def read_recording(
        self, entry: dict[str, Any], number: int, load_case_with: CaseLoader | None
    ) -> RecordingEntry | None:
        """A [[recording]]; None, with a fault, where it cannot be used."""
        is_planned = self.planned and "view" in entry and "file" not in entry
        sound = is_planned or self._has_file(entry, "recording", number)
        if not (self._check_shared_keys(entry, "recording", number, load_case_with) and sound):
            return None
        if not is_planned and self._is_awaited(entry):
            return None
        given, held = _read_overrides(entry, load_case_with), entry.get("held_out", False)
        sigma = read_stated_noise(entry, "recording")
        if is_planned:
            if load_case_with is None:
                return None
            try:
                recorded = make_planned_recording(entry, load_case_with(given), f"recording {number}")
            except BadInput as fault:
                self._add_named_faults("recording", number, fault)
                return None
            return RecordingEntry(
                f"planned {number} {entry['view']}", _with_camera_class(recorded, entry), given, sigma, held
            )
        try:
            if "points" not in entry:
                recorded = self.load_recording(self.folder / entry["file"])
            elif load_case_with is None:
                return None
            else:
                recorded = thermocouple_files.read_campaign_points(
                    entry, self.folder, load_case_with(given).scene.schedule, f"recording {number}"
                )
        except BadInput as fault:
            if "points" in entry:
                self._add_named_faults("recording", number, fault)
            elif text := describe_table_as_recording(entry["file"]):
                self.add_entry_fault("recording", number, text)
            else:  # errors of image files name their file already
                self.faults.extend(fault.lines)
            return None
        if text := find_noise_fault(recorded, sigma):
            self.add_entry_fault("recording", number, text)
            return None
        return RecordingEntry(entry["file"], _with_camera_class(recorded, entry), given, sigma, held)

    def read_load_cell(
        self, entry: dict[str, Any], number: int, load_case_with: CaseLoader | None
    ) -> LoadCellEntry | None:
        """A [[force]]; None, with a fault, where it cannot be used."""
        sound = self._has_file(entry, "force", number)
        if not (self._check_shared_keys(entry, "force", number, load_case_with) and sound) or self._is_awaited(entry):
            return None
        try:
            time, mu = read_xy_pairs(entry["file"], self.folder, "file", columns=(TIME, FRICTION))
        except BadInput as fault:
            self.add_entry_fault("force", number, *fault.lines)
            return None
        given, held = _read_overrides(entry, load_case_with), entry.get("held_out", False)
        return LoadCellEntry(entry["file"], time, mu, given, read_stated_noise(entry, "force"), held)

    def _add_named_faults(self, kind: str, number: int, fault: BadInput) -> None:
        """Add the lines of a fault that name the entry themselves."""
        self.add_entry_fault(kind, number, *(line.removeprefix(f"{kind} {number}: ") for line in fault.lines))

    def _has_file(self, entry: dict[str, Any], kind: str, number: int) -> bool:
        """Whether the file of an entry exists; if not, a fault is added."""
        file = entry.get("file")
        if not isinstance(file, str):
            more = "; a view without a file is for flashtemp plan" if "view" in entry else ""
            self.add_entry_fault(kind, number, f"file: {file!r}; give the name of a file in quotes{more}")
            return False
        if self._is_awaited(entry):
            self.awaited.append(file)
            return True
        if not _path_exists(self.folder / file) or not (self.folder / file).is_file():
            self.add_entry_fault(kind, number, f"file: no file '{file}' in {self.folder}")
            return False
        return True

    def _is_awaited(self, entry: dict[str, Any]) -> bool:
        """Whether the file of an entry may be missing and does not exist."""
        return self.may_miss and not _path_exists(self.folder / entry["file"])

    def _check_shared_keys(
        self, entry: dict[str, Any], kind: str, number: int, load_case_with: CaseLoader | None
    ) -> bool:
        """Whether the keys that recordings and forces share are valid; if not, faults are added."""
        before = len(self.faults)
        given, held = entry.get("with", {}), entry.get("held_out", False)
        if not isinstance(held, bool):
            self.add_entry_fault(kind, number, f"held_out: {held!r}; give true or false")
        if not isinstance(given, dict):
            self.add_entry_fault(kind, number, f'with: {given!r}; write with = {{ "contact.pressure" = 1.5e5 }}')
        elif campaign_wide := sorted({"title", "free", "known", "candidates"} & given.keys()):
            self.add_entry_fault(kind, number, f"with: '{campaign_wide[0]}' holds for all; write it at the top")
        elif load_case_with is not None:
            try:
                load_case_with(given, by="with")
            except BadInput as fault:
                self.add_entry_fault(kind, number, *fault.lines)
        if text := find_camera_fault(entry):
            self.add_entry_fault(kind, number, text)
        try:
            read_stated_noise(entry, kind)
        except BadInput as fault:
            self.add_entry_fault(kind, number, *fault.lines)
        return len(self.faults) == before


def _read_overrides(entry: dict[str, Any], load_case_with: CaseLoader | None) -> dict[str, Any]:
    """Overrides of an entry, {"table.key": value}, as numbers in the units of their keys."""
    given = case_file.flatten_tables(entry.get("with", {}))
    with_units = [key for key, value in given.items() if units.looks_like_quantity(value)]
    if load_case_with is None or not with_units:
        return given
    case = load_case_with(given)
    return given | {key: case[key] for key in with_units}


def _path_exists(path: Path) -> bool:
    """Whether a path exists; False also for a name that no file can have."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def _is_same_measurement(
    one: RecordingEntry | LoadCellEntry, other: RecordingEntry | LoadCellEntry, folder: Path
) -> bool:
    """Whether two entries hold the same values at the same times, or are one file.

    Two columns of one logger's table are two measurements.  A constant series may have been typed twice.
    """
    if isinstance(one, RecordingEntry) and isinstance(other, RecordingEntry):
        a, b = one.recording, other.recording
        same_shape = a.temperature.shape == b.temperature.shape and np.array_equal(a.time, b.time)
        return same_shape and np.array_equal(a.temperature, b.temperature, equal_nan=True)
    if isinstance(one, LoadCellEntry) and isinstance(other, LoadCellEntry):
        copied = (one.time, one.mu) == (other.time, other.mu) and len(set(one.mu)) > 1
        return copied or (folder / one.file).samefile(folder / other.file)
    return False


def _as_float(value: Any) -> Any:
    """A whole number as a float, so that 1 and 1.0 are one condition."""
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _with_camera_class(recorded: Recording, entry: dict[str, Any]) -> Recording:
    """A recording with the camera class that the campaign states."""
    return replace(recorded, camera=entry["camera"]) if "camera" in entry else recorded
