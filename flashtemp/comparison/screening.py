"""Screening of a campaign: masks bad pixels and frozen frames of its recordings."""

from __future__ import annotations

from dataclasses import replace

from flashtemp.camera.image_screening import screen_recording
from flashtemp.comparison.campaign import Campaign, RecordingEntry


def screen_campaign(campaign: Campaign) -> tuple[Campaign, dict[str, str]]:
    """The campaign with the defects of its cameras masked, and by file a line that lists them."""
    defects: dict[str, str] = {}
    views = tuple(_screen_entry(view, defects) for view in campaign.views)
    changed = any(new is not old for new, old in zip(views, campaign.views, strict=True))
    return (replace(campaign, views=views) if changed else campaign), defects


def _screen_entry(view: RecordingEntry, defects: dict[str, str]) -> RecordingEntry:
    screening = screen_recording(view.recording)
    if screening.summary:
        defects[view.file] = screening.summary
    masked = screening.apply_to(view.recording)
    return view if masked is view.recording else replace(view, recording=masked)
