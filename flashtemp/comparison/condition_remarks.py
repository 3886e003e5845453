"""Checks of a campaign before it is simulated: unusual values in its conditions, and whether data are left to fit."""

from __future__ import annotations

from flashtemp.comparison.campaign import Campaign
from flashtemp.errors import BadInput
from flashtemp.model.case_file import KeyLocations
from flashtemp.runs.checks.case_remarks import remark_on_side_walls, remark_on_values


def remark_on_conditions(campaign: Campaign) -> list[str]:
    """Remarks on unusual values of the case and of the conditions `with` of each entry, as with a wrong unit.

    The rule is that of `remark_on_values`; each line names file, entry, key and value.  Side walls that the case does
    not cool are remarked too.  Raises BadInput.
    """
    case = campaign.load({})
    out = [f"{campaign.case}: {remark}" for remark in remark_on_values(case) + remark_on_side_walls(case)]
    for condition in campaign.conditions:
        remarks = [r for r in remark_on_values(campaign.load(condition.given)) if r.key in condition.given]
        for entry in condition.entries:
            out += [f"{campaign.folder / campaign.file_name}: {entry.file}: with: {remark}" for remark in remarks]
    return out


def require_fitted_entry(campaign: Campaign) -> None:
    """Raise BadInput, with file and line, where all recordings and load cells of a campaign are held out."""
    if not campaign.entries or not all(entry.held_out for entry in campaign.entries):
        return
    file = campaign.folder / campaign.file_name
    locations = KeyLocations(str(file), file.read_text(encoding="utf-8") if file.is_file() else "")
    kind = "recording" if campaign.views else "force"
    line = locations.find_line(f"{kind}.held_out")
    place = f"{file}:{line}" if line else f"{file}"
    raise BadInput(f"{place}: held_out: true for all recordings and load cells; leave at least one to be fitted")
