"""Parameter sweep: every combination of several values of a case's keys, resumable, in one dataset."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.display import DisplayMixin, DisplayTable, ProgressMessage
from flashtemp.errors import BadInput, RenamedAttribute
from flashtemp.model import case as cases
from flashtemp.model import case_file, schema
from flashtemp.physics import units
from flashtemp.runs.results.resumable_batch import open_batch_folder, run_batch
from flashtemp.solver.time_integration import integrate_schedule

PROFILE_PLACES = np.linspace(0.0, 1.0, 101)  # x/L at which profiles are saved
POINT_PROFILES = {
    "T_block": ("degC", "block surface, averaged across y, at the end of each repetition"),
    "T_spot": ("degC", "in the macroasperity contact regions, at the end of each repetition"),
    "T_road": ("degC", "road surface in the heated lanes, at the end of each repetition"),
    "pressure": ("Pa", "nominal contact pressure at the end of each repetition"),
}
POINT_NUMBERS = {
    "T_max_degC": ("degC", "highest temperature"),
    "rise_leading_K": ("K", "temperature rise of the block surface at its leading edge, end of the last repetition"),
    "rise_middle_K": ("K", "temperature rise of the block surface in its middle, end of the last repetition"),
    "rise_trailing_K": ("K", "temperature rise of the block surface at its trailing edge, end of the last repetition"),
    "energy_imbalance": ("1", "relative error of the energy balance"),
    "worn_mean_m": ("m", "mean worn depth at the end"),
    "cells": ("1", "cells"),
    "wall_s": ("s", "wall time of the time integration"),
}
SWEEP_PLAN_FILE = "sweep.json"


@dataclass(frozen=True)
class SweepPlan:
    """A case, the `axes` to sweep {key: values} in the order given, and `points`, one Case per combination."""

    case: cases.Case
    axes: dict[str, tuple]
    points: tuple[cases.Case, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(len(v) for v in self.axes.values())

    @property
    def title(self) -> str:
        return f"Sweep of '{self.case.title}': {' x '.join(f'{len(v)} {k}' for k, v in self.axes.items())}"

    def values_at(self, k: int) -> tuple:
        """The values of the swept keys at point k."""
        index = np.unravel_index(k, self.shape)
        return tuple(values[i] for values, i in zip(self.axes.values(), index, strict=True))


@dataclass(frozen=True, eq=False, repr=False)
class SweepResult(DisplayMixin):
    """Result of a sweep: an xarray `dataset` with the swept keys as dimensions, and `failed` {point: error message}."""

    sweep: SweepPlan
    dataset: Any
    failed: dict[int, str]

    def data_frame(self):
        """The numbers as a pandas DataFrame with one row per combination."""
        ds = self.dataset
        numbers = ds[list(POINT_NUMBERS)].assign(friction_last=ds.friction[..., -1].drop_vars("repetition"))
        return numbers.to_dataframe().reset_index()

    def as_dict(self) -> dict[str, Any]:
        """Plain data: error messages in `failed`, and {column: values} over all combinations."""
        frame = self.data_frame()
        return {"failed": list(self.failed.values()), **{name: frame[name].tolist() for name in frame}}

    def save(self, folder: Path) -> None:
        """Write sweep.nc, sweep.csv with one row per combination, and the case with the files that it names."""
        case, frame = self.sweep.case, self.data_frame()
        (folder / "sweep.nc").write_bytes(bytes(self.dataset.to_netcdf(engine="h5netcdf")))
        (folder / "case.toml").write_text(case.toml(case.copy_files(folder)), encoding="utf-8")
        errors = [self.failed.get(i, "") for i in range(len(frame))]
        frame.assign(failed=errors).to_csv((folder / "sweep.csv").absolute(), index=False)  # pandas expands ~

    def __str__(self) -> str:
        """Size of the sweep, hottest and coolest point, and failures."""
        hottest, lines = self.dataset.T_max_degC, [self.sweep.title]
        if len(self.failed) < len(self.sweep.points):
            for word, where in (("hottest", hottest.argmax(...)), ("coolest", hottest.argmin(...))):
                at = hottest.isel(where)
                place = ", ".join(f"{k} = {at[k].item()}" for k in self.sweep.axes)
                lines.append(f"  {word}: {at.item():.1f} degC at {place}")
        return "\n".join([*lines, *(f"  {line}" for line in self._failure_lines())])

    def _failure_lines(self) -> list[str]:
        """One line per failed point."""
        return [f"failed: {self._point_text(k)}: {reason}" for k, reason in self.failed.items()]

    def _point_text(self, k: int) -> str:
        return ", ".join(f"{key} = {v}" for key, v in zip(self.sweep.axes, self.sweep.values_at(k), strict=True))

    def to_table(self) -> DisplayTable:
        columns = [*self.sweep.axes, "T_max_degC", "rise_trailing_K", "friction_last", "worn_mean_m"]
        rows = self.data_frame()[columns].values.tolist()
        return DisplayTable(self.sweep.title, rows, columns, self._failure_lines())

    frame = RenamedAttribute("data_frame")


def parse_axes(items: list[str]) -> tuple[dict[str, tuple], dict[str, Any]]:
    """Axes from words "key=v1,v2,..." and overrides from words "key=value".  Raises BadInput."""
    axes: dict[str, tuple] = {}
    fixed: dict[str, Any] = {}
    for item in items:
        key, eq, text = item.partition("=")
        values = _split_values(text) if eq else []
        if len(values) < 2:
            fixed |= case_file.parse_overrides([item])
            continue
        key = key.strip()
        axes[key] = tuple(next(iter(case_file.parse_overrides([f"{key}={v}"]).values())) for v in values)
    return axes, fixed


def plan_sweep(
    case: str | Path | cases.Case,
    axes: Mapping[str, Sequence],
    fixed: Mapping[str, Any] | None = None,
    trust: bool = False,
) -> SweepPlan:
    """Plan a sweep of a case, or of its path, with overrides `fixed` and `axes`; checks every combination.

    `trust` runs effect files of the case even if another user may have written them.  Raises BadInput when nothing is
    swept, a value occurs twice, or any combination is not a valid case.
    """
    constant = dict(fixed or {})

    def load_point(more: dict[str, Any]) -> cases.Case:
        return (
            case.with_values(constant | more)
            if isinstance(case, cases.Case)
            else cases.load_case(case, constant | more, trust=trust)
        )

    def plain_value(key: str, value: Any) -> Any:
        return load_point({key: value})[key] if units.looks_like_quantity(value) else value

    swept = {key: tuple(plain_value(key, v) for v in values) for key, values in axes.items()}
    if not swept:
        raise BadInput("sweep: nothing to sweep; give a key with several values, such as contact.pressure=1e5,2e5")
    for key, values in swept.items():
        if any(v in values[:i] for i, v in enumerate(values)):
            text = ",".join(map(str, values))
            raise BadInput(f"{key} (command line): {text}: a value occurs twice; give each once")
    points = [  # `replace` drops the cached scene of each checked case, which saves memory
        replace(load_point(dict(zip(swept, values, strict=True)))) for values in itertools.product(*swept.values())
    ]
    if len({p["schedule.repetitions"] for p in points}) > 1:
        raise BadInput("schedule.repetitions (command line): cannot be swept; repetitions are an axis of the result")
    return SweepPlan(load_point({}), swept, tuple(points))


def _split_values(text: str) -> list[str]:
    """Values separated by commas outside brackets and quotes.

    >>> _split_values('1e5, 2e5'), _split_values('[1, 2],[3, 4]')
    (['1e5', '2e5'], ['[1, 2]', '[3, 4]'])
    """
    parts, depth, quoted = [""], 0, ""
    for c in text:
        if quoted:
            quoted = "" if c == quoted else quoted
        elif c in "'\"":
            quoted = c
        depth += (c in "[{") - (c in "]}") if not quoted else 0
        if c == "," and depth == 0 and not quoted:
            parts.append("")
        else:
            parts[-1] += c
    return [p.strip() for p in parts if p.strip()]


def compute_point(case: cases.Case) -> dict[str, np.ndarray]:
    """Run one combination; returns profiles (repetitions, places) and numbers."""
    run = integrate_schedule(case.scene, case.settings, case.title)
    ends = [int(np.flatnonzero(run.sliding & (run.repetition == r))[-1]) for r in np.unique(run.repetition)]
    at = PROFILE_PLACES * run.mesh.x[run.mesh.last]
    out = {name: np.array([np.interp(at, run.x, getattr(run, name)[k]) for k in ends]) for name in POINT_PROFILES}
    summary = run.summary
    out |= {name: np.array(float(summary[name])) for name in POINT_NUMBERS}
    return out | {"friction": np.array(run.friction_per_repetition)}


def run_sweep(
    sweep: SweepPlan, work: Path | None = None, workers: int | None = None, scheduler: str | None = None,
    watch: Callable[[int, int], Any] = lambda done, total: None, say: Callable[[str], Any] = lambda text: None,
) -> SweepResult:  # fmt: skip
    """Run all points whose results are not saved in the folder `work`; without a folder nothing is saved.

    Every point is saved to its own file when it has finished; Ctrl-C takes effect then.  `say` is called with a message
    for each.  Raises OSError, SolverFailure, UserInterrupt.
    """
    rows: list[dict[str, Any]] = []

    def report_point(k: int, point: dict[str, np.ndarray]) -> None:
        values = dict(zip(sweep.axes, sweep.values_at(k), strict=True))
        rows.append(values | {"highest temperature (°C)": float(point["T_max_degC"])})
        say(ProgressMessage(f"{len(rows)} of {len(sweep.points)} runs", rows=list(rows)))

    needs = frozenset({*POINT_PROFILES, *POINT_NUMBERS, "friction"})
    results, failed = run_batch(
        compute_point, sweep.points, work, workers, scheduler, watch, needs, report=report_point
    )
    return SweepResult(sweep, _gather_dataset(sweep, results), failed)


def open_sweep_folder(out: Path, sweep: SweepPlan) -> AbstractContextManager[Path]:
    """The working folder of a sweep, as in `open_batch_folder`; points stay in the result."""
    plan = json.dumps({"case": sweep.case.toml(), "axes": {k: list(v) for k, v in sweep.axes.items()}}, indent=2) + "\n"
    return open_batch_folder(out, "sweep", SWEEP_PLAN_FILE, plan)


def _gather_dataset(sweep: SweepPlan, results: list[dict[str, np.ndarray] | None]):
    """The xarray Dataset with the swept keys as dimensions; nan where a point failed."""
    import xarray as xr

    repetitions = sweep.points[0]["schedule.repetitions"]
    axes = list(sweep.axes)
    variables: dict[str, tuple[str, str, tuple[str, ...]]] = {
        name: (unit, words, ("repetition", "place")) for name, (unit, words) in POINT_PROFILES.items()
    }
    variables |= {name: (unit, words, ()) for name, (unit, words) in POINT_NUMBERS.items()}
    variables["friction"] = "1", "load-weighted friction, mean of each repetition", ("repetition",)
    sizes = {"repetition": repetitions, "place": len(PROFILE_PLACES)}
    data = {}
    for name, (unit, words, dims) in variables.items():
        shape = tuple(sizes[d] for d in dims)
        values = [np.full(shape, np.nan) if p is None else p[name] for p in results]
        table = np.array(values).reshape(*sweep.shape, *shape)
        data[name] = ((*axes, *dims), table, {"units": unit, "long_name": words})
    coords = {
        key: (key, _coordinate_array(values), {"units": _key_unit(sweep.case, key)})
        for key, values in sweep.axes.items()
    }
    coords["repetition"] = ("repetition", np.arange(1, repetitions + 1), {"units": "1", "long_name": "1-based"})
    along = "x/L from the edge that leads while the block slides forward"
    coords["place"] = ("place", PROFILE_PLACES, {"units": "1", "long_name": along})
    about = {"title": sweep.case.title, "case": sweep.case.toml(), "Conventions": "CF-1.11"}
    return xr.Dataset(data, coords=coords, attrs=about)


def _coordinate_array(values: tuple) -> np.ndarray:
    """Values of an axis as numbers if possible, otherwise as text."""
    if all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values):
        return np.array(values, dtype=float)
    return np.array([str(v) for v in values])


def _key_unit(case: cases.Case, key: str) -> str:
    table, _, name = key.rpartition(".")
    return case.declared_params(table).get(name, schema.UNDECLARED_PARAM).unit or "1"
