"""What `sensitivity` found, as text, JSON and files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from flashtemp.display import DisplayMixin, DisplayTable, write_json
from flashtemp.model.case import Case
from flashtemp.model.priors import UncertainInput
from flashtemp.runs.studies.friction_trends import FrictionTrend
from flashtemp.solver.run import Run

Array = npt.NDArray[np.float64]
MAX_TABLE_INPUTS = 8  # inputs in a table


@dataclass(frozen=True)
class OutputSpec:
    """A number of a run: its unit, what it is, how it is read, and `min_width`, a width of no interest."""

    unit: str
    words: str
    evaluate: Callable[[Run], float]
    min_width: float


def _trailing_edge_value(run: Run, values: Array) -> float:
    """The value at the trailing edge at the end, of values (times, lines)."""
    return float(values[run.last_sliding_index][-1 - run.leading_line_index(run.last_sliding_index)])


def _heat_fraction(name: str) -> Callable[[Run], float]:
    return lambda run: run.budget[name] / max(run.budget["friction"], 1e-300)


OUTPUT_SPECS = {
    "T_spot_L": OutputSpec(
        "degC", "T_spot at the trailing edge", lambda run: _trailing_edge_value(run, run.T_spot), 0.05
    ),
    "T_spot_max": OutputSpec(
        "degC", "highest T_spot at the end", lambda run: float(run.T_spot[run.last_sliding_index].max()), 0.05
    ),
    "T_block_L": OutputSpec(
        "degC", "T(L), block at the trailing edge", lambda run: _trailing_edge_value(run, run.T_block), 0.05
    ),
    "mu": OutputSpec("1", "friction, last repetition", lambda run: (run.friction_per_repetition or [0.0])[-1], 1e-3),
    "into_road": OutputSpec("1", "share of the heat into the road", _heat_fraction("road"), 2e-3),
    "in_block": OutputSpec("1", "share of the heat left in the block", _heat_fraction("block"), 2e-3),
    "to_holder": OutputSpec("1", "share of the heat into the holder", _heat_fraction("holder"), 2e-3),
    "to_air": OutputSpec("1", "share of the heat into the air", _heat_fraction("air"), 2e-3),
}


@dataclass(frozen=True, eq=False)
class PredictedNumber:
    """A number of the prediction: `value` of the case, standard deviation, 95 % band, and by input: slopes per sd,
    first-order and total shares of the variance; `unexplained` share of it."""

    value: float
    sd: float
    low: float
    high: float
    slopes: Array
    first: Array
    total: Array
    unexplained: float


@dataclass(frozen=True, eq=False)
class PredictionBand:
    """95 % band, pointwise, at the run's records and places."""

    low: Array
    high: Array


@dataclass(frozen=True, eq=False, repr=False)
class SensitivityResult(DisplayMixin):
    """What each of the `inputs` does to a prediction: `numbers` {name of OUTPUT_SPECS: Number}, and `bands` of profiles.

    `keys_without_sd`: numbers of the case without a standard deviation.  `mode`; `check` {number: miss of the linear part over the
    half width of its band}; `lopsided` keys near a bound; `seconds` of the run and the traces; `failed` runs.
    """

    case: Case
    run: Run
    inputs: tuple[UncertainInput, ...]
    keys_without_sd: tuple[str, ...]
    mode: Literal["linear", "sample"]
    numbers: dict[str, PredictedNumber]
    bands: dict[str, PredictionBand]
    check: dict[str, float]
    lopsided: tuple[str, ...]
    signs: tuple[FrictionTrend, ...]
    seconds: float
    failed: int

    def leading_input(self, name: str) -> tuple[UncertainInput, float] | None:
        """The input with the largest total share of a number, and that share; None where nothing changes it."""
        total = self.numbers[name].total
        k = int(np.argmax(total))
        return (self.inputs[k], float(total[k])) if self.numbers[name].sd > 0 else None

    @property
    def ranked_inputs(self) -> list[int]:
        """Inputs by their largest total share of T_spot(L), T(L) or mu, the largest first."""
        size = np.max([self.numbers[n].total for n in ("T_spot_L", "T_block_L", "mu")], axis=0)
        return [int(k) for k in np.argsort(-size, kind="stable")]

    def list_conclusions(self) -> list[str]:
        """One per conclusion."""
        out = []
        for name in ("T_spot_L", "T_block_L", "mu", "into_road"):
            n, about = self.numbers[name], OUTPUT_SPECS[name]
            unit = "" if about.unit == "1" else f" {about.unit}"
            lead = self.leading_input(name)
            why = f"; most of it is {lead[0].key} ({100 * lead[1]:.0f} %)" if lead and n.sd > 1e-9 else ""
            digits = ".3f" if about.unit == "1" else ".1f"
            out.append(f"{about.words}: {n.value:{digits}}{unit}, 95 % band {n.low:{digits}} to {n.high:{digits}}{why}")
        return [*out, *self._confidence_sentences(), *map(str, self.signs)]

    def _confidence_sentences(self) -> list[str]:
        """In words how sure the shares are."""
        worst = max(self.check, key=self.check.__getitem__, default=None)
        said = []
        if worst is not None:
            far = f"2 sd out the linear part misses {OUTPUT_SPECS[worst].words} by {100 * self.check[worst]:.0f} %"
            said.append(f"{far} of the band's half width" + ("" if self.mode == "linear" else ": runs were sampled"))
        elif self.mode == "linear":
            said.append("the linear part was not tried")
        if self.lopsided:
            said.append(f"near a bound, so that the prior is lopsided: {', '.join(self.lopsided)}")
        wide = [n.unexplained for name, n in self.numbers.items() if n.high - n.low > OUTPUT_SPECS[name].min_width]
        left = max(wide, default=0.0)
        if self.mode == "sample" and left > 0.1:
            said.append(f"{100 * left:.0f} % of a variance is not explained by the sample: give more --samples")
        if self.failed:
            said.append(f"{self.failed} runs of the sample failed and are left out")
        return said

    def table_rows(self) -> list[list[Any]]:
        """An input each: key, value, sd, unit, and for T_spot(L), T(L), mu: change per sd and shares."""
        out = []
        for k in self.ranked_inputs:
            i, row = self.inputs[k], []
            for name in ("T_spot_L", "T_block_L", "mu"):
                n = self.numbers[name]
                row += [float(n.slopes[k]), f"{100 * n.first[k]:.0f}/{100 * n.total[k]:.0f} %"]
            out.append([i.key, i.value, i.sd, i.unit, *row])
        return out

    HEAD = ("input", "value", "sd", "unit", "T_spot(L), K per sd", "first/total", "T(L), K per sd", "first/total",
            "mu per sd", "first/total")  # fmt: skip

    def __str__(self) -> str:
        lines = [f"Sensitivity of '{self.case.title}' ({self.mode}, {len(self.inputs)} inputs)"]
        lines.append(
            f"  {'input':32s} {'value':>10s} {'sd':>9s}   {'T_spot(L)':>9s} {'share':>8s}   {'T(L)':>7s} {'share':>8s}"
            f"   {'mu':>8s} {'share':>8s}   (change per sd; first/total share)"
        )
        for key, value, sd, _, *rest in self.table_rows()[:MAX_TABLE_INPUTS]:
            spot, a, block, b, mu, c = rest
            cells = f"{spot:+9.2f} {a:>8s}   {block:+7.2f} {b:>8s}   {mu:+8.4f} {c:>8s}"
            lines.append(f"  {key:32s} {value:10.4g} {sd:9.2g}   {cells}")
        if len(self.inputs) > MAX_TABLE_INPUTS:
            lines.append(f"  and {len(self.inputs) - MAX_TABLE_INPUTS} more, all in sensitivity.json")
        said = self.list_conclusions()
        if self.keys_without_sd:
            said.append(f"held, since nobody says how sure they are: {', '.join(self.keys_without_sd)}")
        lines += [fill(s, 120, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False) for s in said]
        return "\n".join(lines)

    def to_table(self) -> DisplayTable:
        held = (
            [f"held, since nobody says how sure they are: {', '.join(self.keys_without_sd)}"]
            if self.keys_without_sd
            else []
        )
        return DisplayTable(
            f"Sensitivity of '{self.case.title}'", self.table_rows(), self.HEAD, [*self.list_conclusions(), *held]
        )

    def as_dict(self) -> dict[str, Any]:
        """For --json and sensitivity.json."""
        keys = [i.key for i in self.inputs]

        def by_key(values: Array) -> dict[str, float]:
            return dict(zip(keys, map(float, values), strict=True))

        return {
            "title": self.case.title, "mode": self.mode,
            "inputs": [
                {"key": i.key, "value": i.value, "sd": i.sd, "unit": i.unit, "reason": i.reason} for i in self.inputs
            ],
            "left_out": list(self.keys_without_sd),
            "numbers": {
                name: {
                    "words": OUTPUT_SPECS[name].words, "unit": OUTPUT_SPECS[name].unit, "value": n.value, "sd": n.sd,
                    "band95": [n.low, n.high], "per_sd": by_key(n.slopes), "first_order": by_key(n.first),
                    "total": by_key(n.total), "unexplained": n.unexplained,
                }
                for name, n in self.numbers.items()
            },
            "check": self.check, "lopsided": list(self.lopsided), "signs": [s.as_dict() for s in self.signs],
            "failed": self.failed, "seconds": self.seconds, "conclusions": self.list_conclusions(),
        }  # fmt: skip

    def save(self, folder: Path) -> None:
        """Write the case, sensitivity.json and run.nc with bands into a folder that exists."""
        (folder / "case.toml").write_text(self.case.toml(self.case.copy_files(folder)), encoding="utf-8")
        write_json(self.as_dict(), folder / "sensitivity.json")
        ds = self.run.dataset()
        for name, band in self.bands.items():
            for side, values in (("low", band.low), ("high", band.high)):
                about = {"units": ds[name].attrs["units"], "long_name": f"95 % band of {name}, {side}"}
                ds[f"{name}_{side}"] = (ds[name].dims, values, about)
        ds["time"].encoding["dtype"] = "float64"
        (folder / "run.nc").write_bytes(bytes(ds.to_netcdf(engine="h5netcdf")))
