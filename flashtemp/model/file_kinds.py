"""The three kinds of TOML file that people write: told apart by their keys, so that one in another's place is told."""

from __future__ import annotations

from typing import Any

from flashtemp.errors import BadInput
from flashtemp.model.schema import CASE_TABLES

CASE_KIND, CAMPAIGN_KIND, TEMPLATE_KIND = "case", "campaign", "recording template"
FILE_KIND_REMEDIES = {  # what was wanted, what is there: what to do
    (CASE_KIND, CAMPAIGN_KIND): "give flashtemp the case that it names, or use compare, discover or plan",
    (CASE_KIND, TEMPLATE_KIND): "use flashtemp import with it",
    (CAMPAIGN_KIND, CASE_KIND): 'give a campaign.toml with case = "{name}"',
    (CAMPAIGN_KIND, TEMPLATE_KIND): "import it first, and give a campaign.toml that names the recording",
    (TEMPLATE_KIND, CASE_KIND): "give camera files, or a template as flashtemp new recording writes it",
    (TEMPLATE_KIND, CAMPAIGN_KIND): "give camera files, or a template as flashtemp new recording writes it",
}


def detect_kind(raw: dict[str, Any]) -> str:
    """Whether tables are those of a case, a campaign or a recording template; "" where their keys do not tell."""
    if "recording" in raw or "force" in raw:
        return CAMPAIGN_KIND
    if "files" in raw:
        return TEMPLATE_KIND
    if {"effects", *CASE_TABLES} & raw.keys():
        return CASE_KIND
    return CAMPAIGN_KIND if "case" in raw else CASE_KIND if "free" in raw else ""


def require_kind(wanted: str, raw: dict[str, Any], path: Any, name: str) -> None:
    """BadInput where tables are those of another kind of file."""
    there = detect_kind(raw)
    if there and there != wanted:
        raise BadInput(
            f"{path}: this is a {there}, not a {wanted}; {FILE_KIND_REMEDIES[wanted, there].format(name=name)}"
        )
