"""The panel on what the data of a campaign can show: conditions and views as a table, and advice."""

from __future__ import annotations

from typing import Final

from nicegui import ui

from flashtemp.display import format_count
from flashtemp.lab.campaign_checks import (
    ENTRY_KINDS,
    LOAD_CELL,
    CampaignCheck,
    advise_on_data,
    list_conditions,
)
from flashtemp.lab.campaign_document import CampaignDocument
from flashtemp.lab.page_layout import note
from flashtemp.lab.workspace import escape_control

VIEW_ORDER: Final = ("sidewall", "wake", "profile", "points", LOAD_CELL)


def show_scope(check: CampaignCheck, document: CampaignDocument) -> None:
    """Show conditions with what is measured in each, and advice; or what must be repaired first."""
    entries = [entry for kind in ENTRY_KINDS for entry in document.list_entries(kind)]
    campaign = check.campaign
    if campaign is None:
        if document.raw is None:
            ui.label("The text is not valid TOML.").classes("ft-muted")
        elif not entries:
            ui.label("Add a measurement to see what it can show.").classes("ft-muted")
        elif check.faults:
            n = len(check.faults)
            ui.label(f"{format_count(n, 'error')} to repair first. Each stands at its row or key.").classes("ft-muted")
        else:
            ui.label("The campaign is not checked yet.").classes("ft-muted")
        return
    conditions = list_conditions(campaign, check.case)
    used = [view for view in VIEW_ORDER if any(view in condition.views for condition in conditions)]
    with ui.row().classes("gap-6"):
        for number, words in (
            (len(conditions), "conditions" if len(conditions) != 1 else "condition"),
            (len(campaign.views), "recordings" if len(campaign.views) != 1 else "recording"),
            (len(campaign.forces), "load-cell traces" if len(campaign.forces) != 1 else "load-cell trace"),
            (len(campaign.free), "free keys" if len(campaign.free) != 1 else "free key"),
        ):
            with ui.column().classes("gap-0"):
                ui.label(str(number)).classes("ft-figure")
                ui.label(words).classes("ft-muted ft-small")
    with ui.element("div").classes("ft-scroll"), ui.element("table").classes("ft-table"):
        with ui.element("thead"), ui.element("tr"):
            for words in ("condition", *used, "held out"):
                with ui.element("th").props("scope=col"):
                    ui.label(words)
        with ui.element("tbody"):
            for condition in conditions:
                with ui.element("tr"):
                    with ui.element("td"):
                        ui.label(escape_control(condition.words)).classes("ft-small break-words")
                    for number in (*(condition.views.get(view, 0) for view in used), condition.n_held_out):
                        with ui.element("td"):
                            ui.label(str(number) if number else "–")
    for sentence, kind in advise_on_data(campaign):
        note(sentence, kind)
    ui.label("Plan says which effects these data can tell apart, and which measurement to add.").classes("ft-muted")
