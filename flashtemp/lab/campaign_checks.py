"""Check a campaign as its text stands, without saving it, and say what its data can show."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from flashtemp.api.campaigns import parse_campaign
from flashtemp.api.inputs import load
from flashtemp.comparison.campaign import Campaign, LoadCellEntry, RecordingEntry
from flashtemp.discovery.hypotheses.candidates import find_candidates
from flashtemp.display import format_count
from flashtemp.errors import BadInput, FlashtempError
from flashtemp.lab.key_units import describe_value, find_param, format_value
from flashtemp.lab.page_layout import refuse_damaged
from flashtemp.lab.recording_store import RecordingStore
from flashtemp.lab.toml_editor import TextFault
from flashtemp.lab.toml_tables import read_entries
from flashtemp.lab.workspace import escape_control, resolve_inside
from flashtemp.model.case import Case
from flashtemp.model.case_file import KeyLocations, parse_toml

ENTRY_KINDS: Final = ("recording", "force")
LOAD_CELL: Final = "load cell"  # in the table of what is measured, beside the views


@dataclass(frozen=True)
class CampaignFault:
    """An error of a campaign: the `kind` and `number` of its entry ("" and 0 for others), its `key`, the `text`, and
    the 1-based `line` that it is about, 0 where that is not known."""

    kind: str
    number: int
    key: str
    text: str
    line: int = 0

    @property
    def in_text(self) -> TextFault:
        """The error for the editor."""
        return TextFault(self.line, f"{self.kind} {self.number}" if self.kind else self.key, self.text)


@dataclass(frozen=True)
class CampaignCheck:
    """The outcome of a check: its `faults`, the stated `case` and the `campaign`, None where they cannot be read.

    Recordings of the campaign hold a few of their frames only.  `candidates` are the effects that may be missing, each
    with the reason why it is not tried by default ("" for those that are).
    """

    faults: tuple[CampaignFault, ...] = ()
    case: Case | None = None
    campaign: Campaign | None = None
    candidates: dict[str, str] = field(default_factory=dict)

    def entry_faults(self, kind: str, number: int) -> list[str]:
        """Errors of one entry."""
        return [f.text for f in self.faults if (f.kind, f.number) == (kind, number)]

    def key_faults(self, *keys: str) -> list[str]:
        """Errors of keys of the top level."""
        return [f.text for f in self.faults if not f.kind and f.key in keys]

    def other_faults(self, *keys: str) -> list[CampaignFault]:
        """Errors that belong to no entry and to none of these keys."""
        return [f for f in self.faults if not f.kind and f.key not in keys]


def check_campaign(text: str, path: Path, store: RecordingStore) -> CampaignCheck:
    """Check a text that stands for the campaign file `path`; only files inside the folder are read.

    Effect files of its case run: the caller has the user's consent.
    """
    try:
        raw = parse_toml(text)
    except (ValueError, RecursionError) as fault:
        reason = str(fault).splitlines()[0]
        line = re.search(r"at line (\d+)", reason)
        return CampaignCheck((CampaignFault("", 0, "", f"not valid TOML: {reason}", int(line[1]) if line else 0),))
    outside = find_outside_files(raw, path, store.folder)
    if outside:
        return CampaignCheck(tuple(_add_line(fault, text) for fault in outside))
    case = campaign = None
    faults: list[CampaignFault] = []
    try:
        with refuse_damaged(path):
            campaign = parse_campaign(text, path, planned=True, load_recording=store.load_sample)
    except (FlashtempError, OSError) as fault:
        lines = fault.lines if isinstance(fault, BadInput) else (str(fault),)
        faults = [_add_line(_locate_fault(line, raw, path), text) for line in lines]
    try:
        name = raw.get("case", "case.toml")
        case = load(path.parent / name) if isinstance(name, str) else None
    except (FlashtempError, OSError):
        case = None  # the campaign's own check names the fault
    return CampaignCheck(tuple(faults), case, campaign, {} if case is None else list_candidates(case))


def list_candidates(case: Case) -> dict[str, str]:
    """Effects that a case may lack, each with the reason why it is tried only if a campaign names it ("": tried)."""
    usual, others = find_candidates(case, None)
    named, _ = find_candidates(case, tuple(others))
    return {c.effect: "" for c in usual} | {c.effect: others[c.effect] for c in named}


def find_outside_files(raw: dict[str, Any], path: Path, folder: Path) -> list[CampaignFault]:
    """Faults for the case and for files of entries that lie outside the folder of the page."""
    named = [("", 0, "case", raw.get("case", "case.toml"))]
    for kind in ENTRY_KINDS:
        named += [(kind, n, "file", entry.get("file")) for n, entry in enumerate(read_entries(raw, kind), 1)]
    out = []
    for kind, number, key, name in named:
        if isinstance(name, str):
            try:
                resolve_inside(folder, os.path.relpath(path.parent / name, folder.resolve()))
            except (BadInput, ValueError) as fault:
                text = str(fault) if isinstance(fault, BadInput) else "not a valid file name"
                out.append(CampaignFault(kind, number, key, f"{key}: {text}"))
    return out


def _locate_fault(line: str, raw: dict[str, Any], path: Path) -> CampaignFault:
    """The entry or key that an error message of the reader is about."""
    line = line.replace(f" in {path.parent}", "")
    place = rf"{re.escape(str(path))}(?::\d+)?: "
    if numbered := re.match(rf"{place}(recording|force) (\d+): (.*)", line, re.DOTALL):
        return CampaignFault(numbered[1], int(numbered[2]), "", numbered[3])
    if own := re.match(rf"{place}([\w.]+): (.*)", line, re.DOTALL):
        return CampaignFault("", 0, own[1], own[2])
    for kind in ENTRY_KINDS:
        for number, entry in enumerate(read_entries(raw, kind), 1):
            if isinstance(entry.get("file"), str):
                prefix = f"{path.parent / entry['file']}: "
                if line.startswith(prefix):
                    return CampaignFault(kind, number, "file", line.removeprefix(prefix))
    case = path.parent / str(raw.get("case", "case.toml"))
    if line.startswith(str(case)):
        return CampaignFault("", 0, "case", f"{case.name}{line.removeprefix(str(case))}")
    return CampaignFault("", 0, "", line.removeprefix(f"{path}: "))


def _add_line(fault: CampaignFault, text: str) -> CampaignFault:
    """The error with the line of its entry or of its key."""
    locations = KeyLocations("", text)
    line = locations.find_line(fault.kind, fault.number) if fault.kind else locations.find_line(fault.key)
    return replace(fault, line=line or fault.line)


# --- what the data can show ------------------------------------------------------------------------------
@dataclass(frozen=True)
class MeasuredCondition:
    """One condition: in `words`, the number of entries of every view, and how many of them are held out."""

    words: str
    views: dict[str, int]
    n_held_out: int


def describe_given(given: Mapping[str, Any], case: Case | None) -> dict[str, str]:
    """{key: value with its unit} of the conditions of an entry."""
    params = {key: find_param(case, key) for key in given}
    return {k: format_value(v) if (p := params[k]) is None else describe_value(v, p) for k, v in given.items()}


def list_conditions(campaign: Campaign, case: Case | None) -> list[MeasuredCondition]:
    """Conditions of a campaign, with the units of the keys of its case, and what is measured in each."""
    out = []
    for condition in campaign.conditions:
        views: dict[str, int] = {}
        for entry in condition.entries:
            name = entry.recording.view if isinstance(entry, RecordingEntry) else LOAD_CELL
            views[name] = views.get(name, 0) + 1
        given = describe_given(condition.given, case)
        words = ", ".join(f"{key} {value}" for key, value in given.items()) or "the case"
        out.append(MeasuredCondition(words, views, sum(entry.held_out for entry in condition.entries)))
    return out


def advise_on_data(campaign: Campaign) -> list[tuple[str, str]]:
    """What a campaign can and cannot show, as sentences with their kind: "good", "warning" or "" (a remark)."""
    entries, conditions = campaign.entries, campaign.conditions
    out: list[tuple[str, str]] = []
    if entries and all(entry.held_out for entry in entries):
        return [("Everything is held out. Leave at least one measurement to be fitted.", "warning")]
    if len(conditions) == 1:
        out.append((
            "One condition: effects that depend on load or speed look alike. A second load or speed tells far more "
            "of them apart than a repetition.", "warning",
        ))  # fmt: skip
    elif not any(entry.held_out for entry in entries):
        out.append((f"Each of the {len(conditions)} conditions is also predicted from the others.", "good"))
    if n_held := sum(entry.held_out for entry in entries):
        out.append((f"{format_count(n_held, 'measurement')} held out: they test the prediction.", "good"))
    views = {view.recording.view for view in campaign.views}
    if views and "sidewall" not in views:
        out.append(("No side wall: the temperature inside the block is not seen.", ""))
    if views and "wake" not in views:
        out.append(("No wake: the share of heat that the road takes is not seen.", ""))
    if not any(isinstance(entry, LoadCellEntry) for entry in entries):
        out.append(("No load-cell trace: friction follows from the temperatures alone.", ""))
    out += _advise_on_noise(campaign.views)
    return out


def _advise_on_noise(views: Sequence[RecordingEntry]) -> list[tuple[str, str]]:
    """Remarks on recordings without a stated noise."""
    unstated = [v for v in views if v.sigma_K is None and v.recording.netd_K is None]
    if not unstated:
        return []
    names = ", ".join(escape_control(v.file) for v in unstated[:3]) + (" ..." if len(unstated) > 3 else "")
    return [(f"Noise is estimated from the frames where it is not stated: {names}.", "")]
