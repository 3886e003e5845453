"""Recordings of a campaign without what their cameras got wrong: bad pixels and frozen frames."""

from __future__ import annotations

from dataclasses import replace

from flashtemp.camera.image_screening import screen_recording
from flashtemp.comparison.campaign import Campaign, RecordingEntry


def screen_campaign(campaign: Campaign) -> tuple[Campaign, dict[str, str]]:
    """The campaign with the defects of its cameras masked, and by file a line that says which were found."""
    found: dict[str, str] = {}
    views = tuple(_screen_entry(view, found) for view in campaign.views)
    changed = any(new is not old for new, old in zip(views, campaign.views, strict=True))
    return (replace(campaign, views=views) if changed else campaign), found


def _screen_entry(view: RecordingEntry, found: dict[str, str]) -> RecordingEntry:
    screening = screen_recording(view.recording)
    if screening.summary:
        found[view.file] = screening.summary
    left = screening.apply_to(view.recording)
    return view if left is view.recording else replace(view, recording=left)
