"""What the campaign page shows where no campaign is chosen, and the text of a new campaign."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from nicegui import ui

from flashtemp.display import format_count
from flashtemp.errors import FlashtempError
from flashtemp.lab.page_layout import action, card, chip, empty_state, note, page_address, show_command
from flashtemp.lab.saving import read_text
from flashtemp.lab.toml_tables import add_entry, read_entries
from flashtemp.lab.workspace import FolderListing, escape_control, list_folder
from flashtemp.model.case_file import parse_toml
from flashtemp.model.toml_format import value_text

MAX_CAMPAIGNS_LISTED: Final = 60
NEW_CAMPAIGN: Final = 'title = "my campaign"\ncase = "case.toml"\nfree = ["friction.mu"]\n'


def new_campaign_text(listing: FolderListing) -> str:
    """A new campaign with case.toml, or else the first case of the folder, and all recordings of the folder."""
    cases = [p.as_posix() for p in listing.cases]
    name = "case.toml" if "case.toml" in cases or not cases else cases[0]
    text = NEW_CAMPAIGN.replace('"case.toml"', value_text(name))
    for path in listing.recordings:
        text = add_entry(text, "recording", {"file": path.as_posix()})
    return text


def show_campaigns(folder: Path) -> None:
    """All campaigns of the folder, and how to begin a new one."""
    listing = list_folder(folder)
    for sentence in listing.omissions:
        note(sentence, "warning")
    if not listing.campaigns and not listing.recordings:
        _show_nothing(listing)
        return
    if listing.campaigns:
        with card("In this folder"), ui.element("div").classes("ft-grid"):
            for path in listing.campaigns[:MAX_CAMPAIGNS_LISTED]:
                _show_campaign(folder, path)
        if len(listing.campaigns) > MAX_CAMPAIGNS_LISTED:
            note(f"{len(listing.campaigns) - MAX_CAMPAIGNS_LISTED} more campaigns are not listed.")
    words = f"It begins with {_describe_content(listing)} of this folder. Nothing is written before you save it."
    with card("New campaign", words):
        with ui.row():
            action("New campaign", _open_new, "add", main=not listing.campaigns)
        show_command("flashtemp new campaign --out campaign.toml")


def _open_new() -> None:
    ui.navigate.to(page_address("campaign", new=1))


def _describe_content(listing: FolderListing) -> str:
    recordings = f"all {len(listing.recordings)} recordings" if len(listing.recordings) > 1 else "the recording"
    return recordings + (" and the case" if listing.cases else "")


def _show_nothing(listing: FolderListing) -> None:
    how = "A campaign lists recordings with the load and speed of each, and the case that should explain them. " + (
        "Mark the block in the camera files first." if listing.images else "Add camera files first."
    )
    with empty_state("No recordings yet", how):
        action("Import camera files", lambda: ui.navigate.to(page_address("camera")), "photo_camera", main=True)
        action("Plan a campaign before measuring", _open_new)


def _show_campaign(folder: Path, path: Path) -> None:
    title, entries, faulty = _read_campaign(folder, path)
    with ui.element("article").classes("ft-card"):
        ui.link(escape_control(str(path)), page_address("campaign", open=path)).classes("break-all ft-mono")
        if title:
            ui.label(title).classes("ft-muted break-words")
        with ui.row().classes("gap-1"):
            if faulty:
                chip("not valid TOML", "error")
            else:
                chip(format_count(len(entries), "measurement"))
                held = sum(entry.get("held_out") is True for entry in entries)
                if held:
                    chip(f"{held} held out")


def _read_campaign(folder: Path, path: Path) -> tuple[str, Sequence[dict[str, Any]], bool]:
    """Title and entries of a campaign, and whether its text is damaged."""
    try:
        raw = parse_toml(read_text(folder, str(path))[0])
    except (FlashtempError, OSError, ValueError, RecursionError):
        return "", [], True
    title = raw.get("title")
    entries = [entry for kind in ("recording", "force") for entry in read_entries(raw, kind)]
    return escape_control(title)[:80] if isinstance(title, str) else "", entries, False
