"""Commented template files for cases, campaigns and recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flashtemp.camera.importing import import_options
from flashtemp.display import DisplayMixin
from flashtemp.errors import BadInput, suggest_name
from flashtemp.model.case_template import case_text

CAMPAIGN_TEMPLATE = """\
# A campaign of flashtemp: `flashtemp compare FILE` simulates the recordings and computes the residuals,
# `flashtemp discover FILE` finds which effect the model lacks, `flashtemp plan FILE` predicts before measuring
# which effects can be distinguished.
title = "my campaign"
case = "case.toml"                       # the model to compare with
free = ["friction.mu"]                   # parameters to fit; { "friction.mu" = 0.1 } adds a relative sd
# known = { "contact.pressure" = 0.01 }  # relative standard deviations of inputs; "0.3 K" of temperatures
# candidates = ["edge_pressure"]         # the whole catalogue when not given

[[recording]]                            # one per recording made by `flashtemp import`
file = "side.nc"
# view = "sidewall"                      # instead of a file, for `plan`
# with = { "contact.pressure" = 3e5 }    # conditions that differ from the case
# sigma_K = 0.05                         # noise of one pixel of one frame; estimated from the data when not given
# held_out = true                        # not fitted: tests the prediction

# [[recording]]                          # thermocouples: a table of s and degC
# view = "points"
# file = "thermocouples.csv"
# points = [{ name = "a", x = 0.01, z = 0.002, place_sigma_m = 0.0005, gain_sigma = 0.005 }]

# [[force]]                              # load-cell time series: a table of s and friction coefficient
# file = "mu.csv"
"""
TEMPLATE_KINDS = {"case": case_text, "campaign": lambda: CAMPAIGN_TEMPLATE, "recording": import_options.template_text}


@dataclass(frozen=True, repr=False)
class TemplateFile(DisplayMixin):
    """A template of a `kind`: its `text`, and the `file` it was written to, if any."""

    kind: str
    text: str
    file: Path | None = None

    def as_dict(self) -> dict[str, str | None]:
        """Kind, file name and text as plain data."""
        return {"kind": self.kind, "file": str(self.file) if self.file else None, "text": self.text}

    def __str__(self) -> str:
        return self.text if self.file is None else f"{self.file}: a commented {self.kind}, ready to edit"


def new(kind: str, *, out: str | Path | None = None) -> TemplateFile:
    """Make a commented template of a case, campaign or recording; with `out`, write it to that file.

    Raises BadInput for an unknown `kind` and for a file that exists.
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
