"""Recordings of a campaign without what their cameras got wrong: bad pixels and frozen frames."""

from __future__ import annotations

from dataclasses import replace

from flashtemp.camera.image_screening import screen_recording
from flashtemp.comparison.campaign import Campaign, View


def screen_campaign(campaign: Campaign) -> tuple[Campaign, dict[str, str]]:
    """The campaign with the defects of its cameras masked, and by file a line that says which were found."""
    found: dict[str, str] = {}
    views = tuple(_screened(view, found) for view in campaign.views)
    changed = any(new is not old for new, old in zip(views, campaign.views, strict=True))
    return (replace(campaign, views=views) if changed else campaign), found


def _screened(view: View, found: dict[str, str]) -> View:
    screening = screen_recording(view.recording)
    if screening.words:
        found[view.file] = screening.words
    left = screening.applied(view.recording)
    return view if left is view.recording else replace(view, recording=left)
