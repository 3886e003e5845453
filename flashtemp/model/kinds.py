"""The three kinds of TOML file that people write: told apart by their keys, so that one in another's place is told."""

from __future__ import annotations

from typing import Any

from flashtemp.errors import BadInput
from flashtemp.model.schema import TABLES

CASE, CAMPAIGN, TEMPLATE = "case", "campaign", "recording template"
INSTEAD = {  # what was wanted, what is there: what to do
    (CASE, CAMPAIGN): "give flashtemp the case that it names, or use compare, discover or plan",
    (CASE, TEMPLATE): "use flashtemp import with it",
    (CAMPAIGN, CASE): 'give a campaign.toml with case = "{name}"',
    (CAMPAIGN, TEMPLATE): "import it first, and give a campaign.toml that names the recording",
    (TEMPLATE, CASE): "give camera files, or a template as flashtemp new recording writes it",
    (TEMPLATE, CAMPAIGN): "give camera files, or a template as flashtemp new recording writes it",
}


def kind(raw: dict[str, Any]) -> str:
    """Whether tables are those of a case, a campaign or a recording template; "" where their keys do not tell."""
    if "recording" in raw or "force" in raw:
        return CAMPAIGN
    if "files" in raw:
        return TEMPLATE
    if {"effects", *TABLES} & raw.keys():
        return CASE
    return CAMPAIGN if "case" in raw else CASE if "free" in raw else ""


def expect(wanted: str, raw: dict[str, Any], path: Any, name: str) -> None:
    """BadInput where tables are those of another kind of file."""
    there = kind(raw)
    if there and there != wanted:
        raise BadInput(f"{path}: this is a {there}, not a {wanted}; {INSTEAD[wanted, there].format(name=name)}")
