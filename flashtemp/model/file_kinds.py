"""The three kinds of TOML input file, distinguished by their keys: case, campaign, recording template."""

from __future__ import annotations

from typing import Any

from flashtemp.errors import BadInput
from flashtemp.model.schema import CASE_TABLES

CASE_KIND, CAMPAIGN_KIND, TEMPLATE_KIND = "case", "campaign", "recording template"
FILE_KIND_REMEDIES = {  # (required kind, kind found): remedy
    (CASE_KIND, CAMPAIGN_KIND): "give flashtemp the case that it names, or use compare, discover or plan",
    (CASE_KIND, TEMPLATE_KIND): "use flashtemp import with it",
    (CAMPAIGN_KIND, CASE_KIND): 'give a campaign.toml with case = "{name}"',
    (CAMPAIGN_KIND, TEMPLATE_KIND): "import it first, and give a campaign.toml that names the recording",
    (TEMPLATE_KIND, CASE_KIND): "give camera files, or a template from flashtemp new recording",
    (TEMPLATE_KIND, CAMPAIGN_KIND): "give camera files, or a template from flashtemp new recording",
}


def detect_kind(raw: dict[str, Any]) -> str:
    """The kind of file that the tables belong to; "" where their keys do not decide."""
    if "recording" in raw or "force" in raw:
        return CAMPAIGN_KIND
    if "files" in raw:
        return TEMPLATE_KIND
    if {"effects", *CASE_TABLES} & raw.keys():
        return CASE_KIND
    return CAMPAIGN_KIND if "case" in raw else CASE_KIND if "free" in raw else ""


def require_kind(wanted: str, raw: dict[str, Any], path: Any, name: str) -> None:
    """Raise BadInput where the tables belong to another kind of file."""
    kind = detect_kind(raw)
    if kind and kind != wanted:
        raise BadInput(
            f"{path}: this is a {kind}, not a {wanted}; {FILE_KIND_REMEDIES[wanted, kind].format(name=name)}"
        )
