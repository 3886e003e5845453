"""Commented template files for cases, campaigns and recordings; a case lists every key as it is declared."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flashtemp.camera.importing import import_options
from flashtemp.display import DisplayMixin
from flashtemp.errors import BadInput, suggest_name
from flashtemp.model.schema import CASE_TABLES, NAMED_TABLES, declared_params
from flashtemp.model.toml_format import value_text
from flashtemp.physics.effect import Param

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
CASE_TEMPLATE_HEAD = """\
# A case of flashtemp: `flashtemp check FILE`, `flashtemp run FILE`.  SI units, temperatures in degC; or "25 mm".
# Every key is listed with its default.  Remove the # to change one; keys that are not given keep their defaults.
title = "my case"

# effects = ["track_memory", "friction_softening"]   # `flashtemp effects` lists all
# free = ["friction.mu"]                             # parameters to fit to measured data
"""
NAMED_TABLE_MEANINGS = {
    "materials": "a user-defined material",
    "layers": "a layer of the block; layers are listed from the face upwards",
}
RARE_TABLES = ("numerics", "output", "limits")  # listed last


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


def case_text() -> str:
    """The text of the commented case."""
    ordered = [t for t in CASE_TABLES if t not in RARE_TABLES] + [t for t in CASE_TABLES if t in RARE_TABLES]
    out = CASE_TEMPLATE_HEAD + "".join(f"\n[{table}]\n{_key_lines(declared_params(table))}" for table in ordered)
    return out + "".join(
        f"\n# [{kind}.NAME]   # {NAMED_TABLE_MEANINGS[kind]}\n{_key_lines(keys)}" for kind, keys in NAMED_TABLES.items()
    )


def _key_lines(keys: dict[str, Param]) -> str:
    return "".join(f"# {example_line(name, param)}  # {describe_param(param)}\n" for name, param in keys.items())


def example_line(name: str, param: Param) -> str:
    return f"{name} = {value_text(param.value)}" if param.value is not None else f"{name} ="


def describe_param(param: Param) -> str:
    """Meaning, unit and range of a key as text.

    >>> describe_param(Param(0.02, "m", "length", low=1e-4, high=1.0))
    'length; m, 0.0001 to 1'
    """
    unit = "" if param.unit in ("", "1") else param.unit
    low, high = (f"{v:g}" if abs(v) < float("inf") else "" for v in (param.low, param.high))
    span = f"{low} to {high}" if low and high else f"from {low}" if low else ""
    more = ", ".join(t for t in (unit, span if {"number", "amount"} & set(param.kinds) else "") if t)
    return f"{param.about}; {more}" if more else param.about


TEMPLATE_KINDS = {"case": case_text, "campaign": lambda: CAMPAIGN_TEMPLATE, "recording": import_options.template_text}


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
