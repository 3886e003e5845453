"""The result of a sensitivity study as text, JSON and files."""

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
MAX_TABLE_INPUTS = 8  # inputs in the table of the text


@dataclass(frozen=True)
class OutputSpec:
    """A scalar output of a run: unit, meaning, function, and `min_width`, a band width too small to matter."""

    unit: str
    words: str
    evaluate: Callable[[Run], float]
    min_width: float


def _trailing_edge_value(run: Run, values: Array) -> float:
    """The value at the trailing edge at the end of sliding, of values (times, columns)."""
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
    "into_road": OutputSpec("1", "fraction of the heat into the road", _heat_fraction("road"), 2e-3),
    "in_block": OutputSpec("1", "fraction of the heat stored in the block", _heat_fraction("block"), 2e-3),
    "to_holder": OutputSpec("1", "fraction of the heat into the holder", _heat_fraction("holder"), 2e-3),
    "to_air": OutputSpec("1", "fraction of the heat into the air", _heat_fraction("air"), 2e-3),
}


@dataclass(frozen=True, eq=False)
class PredictedNumber:
    """A predicted output: `value` of the case, standard deviation `sd` and 95 % band from `low` to `high`.

    Per input: `slopes` per sd, `first`-order and `total` fractions of the variance; `unexplained` is the fraction of
    the variance that the polynomial expansion does not explain.
    """

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
    """Pointwise 95 % band at the saved times and positions of the run."""

    low: Array
    high: Array


@dataclass(frozen=True, eq=False, repr=False)
class SensitivityResult(DisplayMixin):
    """Effect of the uncertain `inputs` on a prediction: `numbers` {name in OUTPUT_SPECS: PredictedNumber}, and `bands`.

    `keys_without_sd`: keys of the case without a standard deviation, which stay fixed.  `mode`: linear propagation or a
    sample of runs.  `check`: {output: error of linear propagation over the half width of its band}.  `lopsided`: keys
    near a bound.  `signs`: trends of friction.  `seconds`: CPU time of run and sensitivities; `failed`: number of
    failed runs.
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
        """The input with the largest total fraction of the variance of an output, and that fraction, or None."""
        total = self.numbers[name].total
        k = int(np.argmax(total))
        return (self.inputs[k], float(total[k])) if self.numbers[name].sd > 0 else None

    @property
    def ranked_inputs(self) -> list[int]:
        """Indices of the inputs by their largest total fraction of T_spot(L), T(L) or mu, in descending order."""
        size = np.max([self.numbers[n].total for n in ("T_spot_L", "T_block_L", "mu")], axis=0)
        return [int(k) for k in np.argsort(-size, kind="stable")]

    def list_conclusions(self) -> list[str]:
        """The conclusions, one sentence each."""
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
        """Sentences on the reliability of the variance fractions."""
        worst = max(self.check, key=self.check.__getitem__, default=None)
        out = []
        if worst is not None:
            miss = f"{100 * self.check[worst]:.0f} % of the half width of the band, for {OUTPUT_SPECS[worst].words}"
            sampled = "" if self.mode == "linear" else ": runs were sampled"
            out.append(f"the error of linear propagation at 2 sd is {miss}{sampled}")
        elif self.mode == "linear":
            out.append("the accuracy of linear propagation was not checked")
        if self.lopsided:
            out.append(f"near a bound, so the prior is asymmetric: {', '.join(self.lopsided)}")
        wide = [n.unexplained for name, n in self.numbers.items() if n.high - n.low > OUTPUT_SPECS[name].min_width]
        unexplained = max(wide, default=0.0)
        if self.mode == "sample" and unexplained > 0.1:
            out.append(f"the sample does not explain {100 * unexplained:.0f} % of a variance: give more --samples")
        if self.failed:
            out.append(f"{self.failed} runs of the sample failed and are left out")
        return out

    def table_rows(self) -> list[list[Any]]:
        """One row per input: key, value, sd, unit; for T_spot(L), T(L), mu: change per sd, variance fractions."""
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
            f"  {'input':32s} {'value':>10s} {'sd':>9s}   {'T_spot(L)':>9s} {'fraction':>8s}   {'T(L)':>7s}"
            f" {'fraction':>8s}   {'mu':>8s} {'fraction':>8s}   (change per sd; first/total fraction of the variance)"
        )
        for key, value, sd, _, *rest in self.table_rows()[:MAX_TABLE_INPUTS]:
            spot, a, block, b, mu, c = rest
            cells = f"{spot:+9.2f} {a:>8s}   {block:+7.2f} {b:>8s}   {mu:+8.4f} {c:>8s}"
            lines.append(f"  {key:32s} {value:10.4g} {sd:9.2g}   {cells}")
        if len(self.inputs) > MAX_TABLE_INPUTS:
            lines.append(f"  and {len(self.inputs) - MAX_TABLE_INPUTS} more, all in sensitivity.json")
        notes = [*self.list_conclusions(), *self._fixed_sentences()]
        lines += [fill(s, 120, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False) for s in notes]
        return "\n".join(lines)

    def _fixed_sentences(self) -> list[str]:
        keys = ", ".join(self.keys_without_sd)
        return [f"fixed, because they have no standard deviation: {keys}"] if keys else []

    def to_table(self) -> DisplayTable:
        notes = [*self.list_conclusions(), *self._fixed_sentences()]
        return DisplayTable(f"Sensitivity of '{self.case.title}'", self.table_rows(), self.HEAD, notes)

    def as_dict(self) -> dict[str, Any]:
        """All numbers as plain data, as in sensitivity.json."""
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
        """Write the case, sensitivity.json and run.nc with bands into an existing folder."""
        (folder / "case.toml").write_text(self.case.toml(self.case.copy_files(folder)), encoding="utf-8")
        write_json(self.as_dict(), folder / "sensitivity.json")
        ds = self.run.dataset()
        for name, band in self.bands.items():
            for side, values in (("low", band.low), ("high", band.high)):
                about = {"units": ds[name].attrs["units"], "long_name": f"95 % band of {name}, {side}"}
                ds[f"{name}_{side}"] = (ds[name].dims, values, about)
        ds["time"].encoding["dtype"] = "float64"
        (folder / "run.nc").write_bytes(bytes(ds.to_netcdf(engine="h5netcdf")))
