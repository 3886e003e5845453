"""Commented files to begin with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flashtemp.camera.importing import import_options
from flashtemp.display import DisplayMixin
from flashtemp.errors import BadInput, suggest_name
from flashtemp.model.case_template import case_text

CAMPAIGN_TEMPLATE = """\
# A campaign of flashtemp: `flashtemp compare FILE` simulates what the cameras saw and subtracts,
# `flashtemp discover FILE` names what the model misses, `flashtemp plan FILE` tells before measuring what could be
# told apart.
title = "my campaign"
case = "case.toml"                       # the model that is believed
free = ["friction.mu"]                   # what a fit may move; { "friction.mu" = 0.1 } says how well it is known
# known = { "contact.pressure" = 0.01 }  # how well other stated numbers are known; "0.3 K" of temperatures
# candidates = ["edge_pressure"]         # all that the catalogue has when not given

[[recording]]                            # one per recording that `flashtemp import` has made
file = "side.nc"
# view = "sidewall"                      # instead of a file, to plan
# with = { "contact.pressure" = 3e5 }    # what was different from the case
# sigma_K = 0.05                         # noise of one pixel of one frame; from the data when not given
# held_out = true                        # not fitted: tells whether the model foretells

# [[recording]]                          # thermocouples: a table of s and degC
# view = "points"
# file = "thermocouples.csv"
# points = [{ name = "a", x = 0.01, z = 0.002, place_sigma_m = 0.0005, gain_sigma = 0.005 }]

# [[force]]                              # a load-cell trace: a table of s and friction coefficient
# file = "mu.csv"
"""
TEMPLATE_KINDS = {"case": case_text, "campaign": lambda: CAMPAIGN_TEMPLATE, "recording": import_options.template_text}


@dataclass(frozen=True, repr=False)
class TemplateFile(DisplayMixin):
    """A commented file of a kind: its `text`, and the file that it was written to."""

    kind: str
    text: str
    file: Path | None = None

    def as_dict(self) -> dict[str, str | None]:
        """Plain text for JSON."""
        return {"kind": self.kind, "file": str(self.file) if self.file else None, "text": self.text}

    def __str__(self) -> str:
        return self.text if self.file is None else f"{self.file}: a commented {self.kind}; edit it"


def new(kind: str, *, out: str | Path | None = None) -> TemplateFile:
    """A commented case, campaign or recording template, written to the file `out` where that is given.

    Raises BadInput for a file that exists.
    """
    if kind not in TEMPLATE_KINDS:
        raise BadInput(f"new: {kind!r}{suggest_name(kind, TEMPLATE_KINDS)}")
    text = TEMPLATE_KINDS[kind]().rstrip() + "\n"
    if out is None:
        return TemplateFile(kind, text)
    try:
        with Path(out).open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as fault:
        raise BadInput(f"{out}: exists already; choose another name") from fault
    return TemplateFile(kind, text, Path(out))
