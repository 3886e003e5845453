"""One case over several values of its keys: every combination once, resumable, in one dataset."""

from __future__ import annotations

import hashlib
import io
import itertools
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, FlashtempError, Interrupted
from flashtemp.model import case as cases
from flashtemp.model import case_file, schema
from flashtemp.runs.folders import partial, stoppable
from flashtemp.runs.workers import stream
from flashtemp.solver.march import march

PLACES = np.linspace(0.0, 1.0, 101)  # x/L at which profiles are kept
PROFILES = {
    "T_block": ("degC", "block surface, averaged across y, at the end of each repetition"),
    "T_spot": ("degC", "in the macroasperity contact regions, at the end of each repetition"),
    "T_road": ("degC", "road surface in the lanes, at the end of each repetition"),
    "pressure": ("Pa", "nominal contact pressure at the end of each repetition"),
}
NUMBERS = {
    "T_max_degC": ("degC", "highest temperature"),
    "rise_leading_K": ("K", "rise of the block's surface at its leading edge, end of the last repetition"),
    "rise_middle_K": ("K", "rise of the block's surface in its middle, end of the last repetition"),
    "rise_trailing_K": ("K", "rise of the block's surface at its trailing edge, end of the last repetition"),
    "energy_imbalance": ("1", "heat that appeared or vanished, relative"),
    "worn_mean_m": ("m", "mean worn depth at the end"),
    "cells": ("1", "cells"),
    "wall_s": ("s", "time of the march"),
}
POINTS, PLAN = "points", "sweep.json"


@dataclass(frozen=True)
class Sweep:
    """A case and what is swept: {key: its values}, in the order given; `points` one Case per combination."""

    case: cases.Case
    axes: dict[str, tuple]
    points: tuple[cases.Case, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(len(v) for v in self.axes.values())


def plan(path, given: list[str]) -> Sweep:
    """Read a case with "key=value" overrides and "key=v1,v2,..." axes; checks every combination.

    Raises BadInput when nothing is swept, a value stands there twice, or any combination is no valid case.
    """
    axes, fixed = {}, {}
    for item in given:
        key, eq, text = item.partition("=")
        values = _split(text) if eq else []
        if len(values) < 2:
            fixed |= case_file.parse_overrides([item])
            continue
        key = key.strip()
        axes[key] = tuple(next(iter(case_file.parse_overrides([f"{key}={v}"]).values())) for v in values)
        if any(v in axes[key][:i] for i, v in enumerate(axes[key])):
            raise BadInput(f"{key} (command line): {text}: a value stands there twice; give each once")
    if not axes:
        raise BadInput("sweep: nothing to sweep; give a key with several values, as contact.pressure=1e5,2e5")
    base = cases.load(path, fixed)
    points = [  # copied, so that the many do not keep the scenes with which they were checked
        replace(cases.load(path, fixed | dict(zip(axes, values, strict=True))))
        for values in itertools.product(*axes.values())
    ]
    if len({p["schedule.repetitions"] for p in points}) > 1:
        raise BadInput("schedule.repetitions (command line): cannot be swept; repetitions are an axis of the result")
    return Sweep(base, axes, tuple(points))


def _split(text: str) -> list[str]:
    """Values between commas that stand outside brackets and quotes.

    >>> _split('1e5, 2e5'), _split('[1, 2],[3, 4]')
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


def point(case: cases.Case) -> dict[str, np.ndarray]:
    """What one combination gives: profiles (repetitions, places) and numbers."""
    run = march(case.scene, case.settings, case.title)
    ends = [int(np.flatnonzero(run.sliding & (run.repetition == r))[-1]) for r in np.unique(run.repetition)]
    at = PLACES * run.mesh.x[run.mesh.last]
    out = {name: np.array([np.interp(at, run.x, getattr(run, name)[k]) for k in ends]) for name in PROFILES}
    summary = run.summary
    out |= {name: np.array(float(summary[name])) for name in NUMBERS}
    return out | {"friction": np.array(run.friction_per_repetition)}


def carry_out(
    sweep: Sweep, work: Path, workers: int | None = None, scheduler: str | None = None,
    watch: Callable[[int, int], Any] = lambda done, total: None,
) -> tuple[Any, dict[int, str]]:  # fmt: skip
    """March all points that the folder `work` does not hold yet; the dataset, and {point: why it failed}.

    Every point is kept in its own file as soon as it is there; Ctrl-C is seen then.  Raises OSError, SolverFailure.
    """
    files = [work / POINTS / f"{_name(p)}.npz" for p in sweep.points]
    todo = [i for i, file in enumerate(files) if not file.exists()]
    failed: dict[int, str] = {}
    watch(len(files) - len(todo), len(files))
    with stoppable() as stopped:
        for n, (k, answer) in enumerate(stream(point, [sweep.points[i] for i in todo], workers, scheduler), 1):
            if isinstance(answer, FlashtempError):
                failed[todo[k]] = str(answer)
            else:
                _keep(files[todo[k]], answer)
            watch(len(files) - len(todo) + n, len(files))
            if stopped.is_set() and n < len(todo):
                raise Interrupted(work, "the same command")
    return _gather(sweep, files), failed


@contextmanager
def folder(out: Path, sweep: Sweep) -> Iterator[Path]:
    """The folder to work in, `out`.partial, renamed at the end; what is there of the same sweep is gone on with.

    Raises BadInput where `out` exists or its partial folder holds another sweep or another run.
    """
    if out.exists():
        raise BadInput(f"--out: {out} exists; choose another folder")
    work = partial(out)
    told = json.dumps({"case": sweep.case.toml(), "axes": {k: list(v) for k, v in sweep.axes.items()}}, indent=2) + "\n"
    held = work / PLAN
    if work.exists() and (not held.is_file() or held.read_text() != told):
        raise BadInput(f"--out: {work} holds something else than this sweep; choose another folder or remove it")
    try:
        (work / POINTS).mkdir(parents=True, exist_ok=True)
        held.write_text(told)
    except OSError as fault:
        raise BadInput(f"--out: {out}: {fault.strerror}; choose a folder that can be written") from fault
    yield work
    work.rename(out)


def save(sweep: Sweep, found, failed: dict[int, str], work: Path) -> None:
    """Write sweep.nc, sweep.csv (a row per combination) and the case, with the files that it names."""
    (work / "sweep.nc").write_bytes(bytes(found.to_netcdf(engine="h5netcdf")))
    (work / "case.toml").write_text(sweep.case.toml(sweep.case.copy_files(work)), encoding="utf-8")
    table(found, failed, work / "sweep.csv")


def table(found, failed: dict[int, str] | None = None, file: Path | None = None) -> dict:
    """The numbers of every combination, {column: values}; also as a CSV file where one is named."""
    frame = found[list(NUMBERS)].assign(friction_last=found.friction[..., -1].drop_vars("repetition")).to_dataframe()
    frame = frame.reset_index()
    if file is not None:
        frame.assign(failed=[(failed or {}).get(i, "") for i in range(len(frame))]).to_csv(file, index=False)
    return {name: frame[name].tolist() for name in frame}


def says(sweep: Sweep, found, failed: dict[int, str]) -> str:
    """The sweep in words: how much, how far the temperature went, what failed."""
    hottest = found.T_max_degC
    lines = [f"Sweep of '{sweep.case.title}': {' x '.join(f'{len(v)} {k}' for k, v in sweep.axes.items())}"]
    if len(failed) < len(sweep.points):
        for word, where in (("hottest", hottest.argmax(...)), ("coolest", hottest.argmin(...))):
            at = hottest.isel(where)
            place = ", ".join(f"{k} = {at[k].item()}" for k in sweep.axes)
            lines.append(f"  {word}: {at.item():.1f} degC at {place}")
    for k, reason in failed.items():
        place = ", ".join(f"{key} = {value}" for key, value in zip(sweep.axes, _at(sweep, k), strict=True))
        lines.append(f"  failed: {place}: {reason}")
    return "\n".join(lines)


def _at(sweep: Sweep, k: int) -> tuple:
    """The values of the swept keys at point k."""
    index = np.unravel_index(k, sweep.shape)
    return tuple(values[i] for values, i in zip(sweep.axes.values(), index, strict=True))


def _name(case: cases.Case) -> str:
    """A name that another case, or other contents of its files, does not have."""
    seen = hashlib.sha256(case.toml().encode())
    for _, file in sorted(case.files().items()):
        seen.update((case.folder / file).read_bytes())
    return seen.hexdigest()[:20]


def _keep(file: Path, answer: dict[str, np.ndarray]) -> None:
    """Write a point whole or not at all."""
    image = io.BytesIO()
    np.savez_compressed(image, **answer)
    fresh = file.with_suffix(".new")
    fresh.write_bytes(image.getvalue())
    os.replace(fresh, file)


def _gather(sweep: Sweep, files: list[Path]):
    """The xarray Dataset with the swept keys as dimensions; nan where a point failed."""
    import xarray as xr

    found = [dict(np.load(f)) if f.exists() else None for f in files]
    repetitions = sweep.points[0]["schedule.repetitions"]
    axes = list(sweep.axes)
    told = {name: (unit, words, ("repetition", "place")) for name, (unit, words) in PROFILES.items()}
    told |= {name: (unit, words, ()) for name, (unit, words) in NUMBERS.items()}
    told["friction"] = "1", "load-weighted friction, mean of each repetition", ("repetition",)
    sizes = {"repetition": repetitions, "place": len(PLACES)}
    data = {}
    for name, (unit, words, dims) in told.items():
        shape = tuple(sizes[d] for d in dims)
        values = [np.full(shape, np.nan) if p is None else p[name] for p in found]
        table = np.array(values).reshape(*sweep.shape, *shape)
        data[name] = ((*axes, *dims), table, {"units": unit, "long_name": words})
    coords = {key: (key, _coordinate(values), {"units": _unit(key)}) for key, values in sweep.axes.items()}
    coords["repetition"] = ("repetition", np.arange(1, repetitions + 1), {"units": "1", "long_name": "1-based"})
    coords["place"] = ("place", PLACES, {"units": "1", "long_name": "x/L from the leading edge"})
    about = {"title": sweep.case.title, "case": sweep.case.toml(), "Conventions": "CF-1.11"}
    return xr.Dataset(data, coords=coords, attrs=about)


def _coordinate(values: tuple) -> np.ndarray:
    """Numbers as numbers, everything else as text."""
    if all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values):
        return np.array(values, dtype=float)
    return np.array([str(v) for v in values])


def _unit(key: str) -> str:
    table, _, name = key.rpartition(".")
    return schema.declared(table).get(name, schema.NOTHING).unit or "1"
