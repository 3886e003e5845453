"""What every input of a case does to its prediction, and how sure that is: shares of the variance and 95 % bands.

Linear part: differences of neighbouring runs beside one run.  Where the answer two standard deviations out is not where
the linear part puts it, a Latin hypercube of runs and an expansion in polynomials take its place.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from flashtemp.errors import BadInput, SolverFailure
from flashtemp.model.build import first_cells
from flashtemp.model.case import Case
from flashtemp.model.priors import Input, inputs, with_materials
from flashtemp.runs import shares
from flashtemp.runs.kept_points import computed, resumable
from flashtemp.runs.sensitivity_result import NUMBERS, Band, Number, Sensitivity
from flashtemp.runs.sign_of_friction import signs
from flashtemp.solver.march import march
from flashtemp.solver.run import Run
from flashtemp.solver.sensitivity import Move, Neighbourhood, explore

Array = npt.NDArray[np.float64]
Watch = Callable[[int, int], Any]
Where = tuple[Path | None, int | None, str | None]  # folder of kept runs, processes, scheduler
PROFILES = ("T_block", "T_spot", "T_road")
STEP = 0.02  # sd: of the traces
OUT, LINEAR = 2.0, 0.1  # sd at which the linear part is tried; miss over the band's half width that it may have
ALIKE = 0.95  # cosine between what moves T_spot most and what moves mu most, above which one trial does for both
DRAWS, MODES, CHUNK = 4000, 1e-5, 400  # of the expansion; share of the variance that modes may leave; columns at a time
EDGE = 1.959964  # sd of a 95 % band
PLAN = "plan.json"  # what an interrupted study was asked


def seen(run: Run, places: Array, moments: Array) -> dict[str, Array]:
    """Profiles (moments, places) at x/L and shares of the schedule's records, friction (moments,), and NUMBERS."""
    at, out = run.mesh.x[run.mesh.last] * places, {}
    records = np.interp(moments, np.linspace(0.0, 1.0, len(run.time)), np.arange(len(run.time)))
    low = np.floor(records).astype(int)
    high, w = np.minimum(low + 1, len(run.time) - 1), records - low
    for name in PROFILES:
        rows = np.array([np.interp(at, run.x, row) for row in getattr(run, name)])
        out[name] = (1 - w)[:, None] * rows[low] + w[:, None] * rows[high]
    mu = np.where(np.isfinite(run.friction), run.friction, 0.0)
    out["friction"] = (1 - w) * mu[low] + w * mu[high]
    return out | {"numbers": np.array([float(n.of(run)) for n in NUMBERS.values()])}


def _sampled(case: Case) -> dict[str, Array]:
    """What one run of a sample shows, at the cells and records of any case like it."""
    run = march(case.scene, case.settings, case.title)
    return seen(run, run.x / run.mesh.x[run.mesh.last], np.linspace(0.0, 1.0, len(run.time)))


@dataclass(frozen=True, eq=False)
class Linear:
    """The linear part: slopes per standard deviation (inputs, ...) of what `seen` gives of the `run`; cost in runs."""

    run: Run
    slopes: dict[str, Array]
    seconds: float


def study(
    case: Case, keys: Sequence[str] | None = None, samples: int | None = None, linear: bool = False,
    workers: int | None = None, scheduler: str | None = None, watch: Watch = lambda done, total: None,
    say: Callable[[str], Any] = lambda text: None, work: Path | None = None,
) -> Sensitivity:  # fmt: skip
    """The sensitivity of a case to `keys`, or to all inputs with a prior.

    `samples`: a Latin hypercube of so many runs; without it only where the linear part does not hold; never where
    `linear`.  Runs are kept in the folder `work`, as `folder` makes it.  Raises BadInput, SolverFailure, Interrupted.
    """
    full = with_materials(case)
    known, left = inputs(full, None if keys is None else tuple(keys))
    if samples is not None and (linear or samples < 2 * len(known) + 6):
        why = "contradicts --linear" if linear else f"give at least {2 * len(known) + 6} for {len(known)} inputs"
        raise BadInput(f"--samples: {samples}; {why}")
    say(f"{len(known)} inputs: runs beside the run")
    part = trace(full, known)
    check: dict[str, float] = {}
    lopsided = tuple(i.key for i in known if i.at_bound)
    if not linear and samples is None:
        check = _check(full, known, part, (work, workers, scheduler))
    holds = linear or (samples is None and not lopsided and max(check.values(), default=0.0) <= LINEAR)
    if holds:
        numbers, bands, failed = _of_traces(part), _bands_of_traces(part), 0
    else:
        count = samples or min(200, max(60, 10 * len(known)))
        say(f"{count} runs of a Latin hypercube")
        numbers, bands, failed = _of_sample(full, known, part, count, (work, workers, scheduler), watch)
    k = part.run.last
    return Sensitivity(
        case, part.run, known, left, "linear" if holds else "sample", numbers, bands, check, lopsided,
        signs(full, known, float(np.nanmax(part.run.T_spot[k]))), part.seconds, failed,
    )  # fmt: skip


def folder(out: Path, case: Case, keys: Sequence[str] | None, samples: int | None, linear: bool):
    """The folder for a study to work in, as in `resumable`; runs of a sample do not stay in the result."""
    told = {"case": case.toml(), "keys": keys and sorted(keys), "samples": samples, "linear": linear}
    return resumable(out, "sensitivity", PLAN, json.dumps(told, indent=2) + "\n", drop=True)


# --- the linear part ------------------------------------------------------------------------------------------
def trace(case: Case, known: Sequence[Input]) -> Linear:
    """One run, with neighbours that have one input moved each."""
    began = time.process_time()
    pinned = case.with_values(first_cells(case.scene, case.values["numerics"]) | _depth(case))
    moves = {}
    for i in known:
        step = STEP if i.value + STEP * i.sd <= i.high else -STEP
        moved = pinned.with_values({i.key: i.value + step * i.sd}).scene
        moves[i.key] = Move(moved, step, stretched=True)
    try:
        near: Neighbourhood[str] = explore(pinned.scene, pinned.settings, moves, case.title, (), True)
    except ValueError as fault:
        raise BadInput(f"{case.name}: an input changes the number of cells or phases; leave it out: {fault}") from fault
    run, level = near.run, near.level
    assert level is not None
    places = run.x / run.mesh.x[run.mesh.last]
    moments = np.linspace(0.0, 1.0, len(level.time))
    plain = seen(level, places, moments)
    slopes: dict[str, list[Array]] = {name: [] for name in plain}
    for i in known:
        other = seen(near.moved[i.key], places, moments)
        for name, values in plain.items():
            slope = (other[name] - values) / near.steps[i.key]
            slopes[name].append(slope if name == "numbers" else _at(run.time, level.time, slope))
    return Linear(run, {k: np.array(v) for k, v in slopes.items()}, time.process_time() - began)


def _depth(case: Case) -> dict[str, float]:
    return {"road.depth": float(case.scene.mesh.depth[-1])}


def _at(times: Array, known: Array, values: Array) -> Array:
    """Rows of `values` at `known` times, between them on lines over the number of the record.

    Records lie denser after each start, where heat goes as sqrt(t): lines over time would miss that.
    """
    wanted, given = np.arange(len(times)), np.searchsorted(times, known)
    if values.ndim == 1:
        return np.interp(wanted, given, values)
    return np.array([np.interp(wanted, given, column) for column in values.T]).T


def _of_traces(part: Linear) -> dict[str, Number]:
    out = {}
    for k, (name, about) in enumerate(NUMBERS.items()):
        value, slopes = float(about.of(part.run)), part.slopes["numbers"][:, k]
        sd, share = float(np.sqrt(np.sum(slopes**2))), shares.linear_shares(slopes)
        out[name] = Number(value, sd, value - EDGE * sd, value + EDGE * sd, slopes, share, share, 0.0)
    return out


def _bands_of_traces(part: Linear) -> dict[str, Band]:
    out = {}
    for name in (*PROFILES, "friction"):
        value = getattr(part.run, name)
        sd = np.sqrt(np.sum(part.slopes[name] ** 2, axis=0))
        out[name] = Band(value - EDGE * sd, value + EDGE * sd)
    return out


def _check(case: Case, known: Sequence[Input], part: Linear, where: Where) -> dict[str, float]:
    """{number: how far off the linear part is, over the half width of its band} where most inputs are 2 sd out."""
    slopes, names = part.slopes["numbers"], list(NUMBERS)
    ways = [_way(slopes[:, names.index(n)]) for n in ("T_spot_L", "mu")]
    if not ways[1].any() or abs(ways[0] @ ways[1]) > ALIKE:
        ways = ways[:1]
    z = np.array([sign * OUT * way for way in ways for sign in (-1.0, 1.0)])
    found, failed = computed(_sampled, [_at_z(case, known, row) for row in z], *where, last=False)
    if failed:
        raise SolverFailure(f"two standard deviations out: {next(iter(failed.values()))}")
    start = np.array([float(n.of(part.run)) for n in NUMBERS.values()])
    width = EDGE * np.sqrt(np.sum(slopes**2, axis=0))
    out: dict[str, float] = {}
    for row, one in zip(z, found, strict=True):
        assert one is not None
        miss = np.abs(one["numbers"] - start - row @ slopes)
        for k, (name, about) in enumerate(NUMBERS.items()):
            out[name] = max(out.get(name, 0.0), float(miss[k] / max(width[k], about.least)))
    return out


def _way(slopes: Array) -> Array:
    size = float(np.linalg.norm(slopes))
    return slopes / size if size > 0 else slopes


def _at_z(case: Case, known: Sequence[Input], z: Array) -> Case:
    """The case with every input at its place z of the standard normal distribution."""
    return replace(case.with_values({i.key: float(i.at(v)) for i, v in zip(known, z, strict=True)}))


# --- where it does not hold -----------------------------------------------------------------------------------
def _of_sample(case: Case, known: Sequence[Input], part: Linear, count: int, where: Where, watch: Watch):
    """Numbers and bands from a Latin hypercube of runs."""
    z = shares.hypercube(count, len(known))
    found, failed = computed(_sampled, [_at_z(case, known, row) for row in z], *where, watch)
    kept = [k for k, one in enumerate(found) if one is not None and one["T_spot"].shape == part.run.T_spot.shape]
    if len(kept) < 0.9 * count:
        why = next(iter(failed.values()), "runs of other records")
        raise SolverFailure(f"{count - len(kept)} of {count} runs of the sample fail: {why}")
    z, rows = z[kept], [one for k in kept if (one := found[k]) is not None]
    drawn = shares.hypercube(DRAWS, len(known), seed=1, even=False)
    numbers, n = {}, len(known)
    table = np.array([one["numbers"] for one in rows])
    rng = np.random.default_rng(2)
    for k, (name, about) in enumerate(NUMBERS.items()):
        fit = shares.expand(z, table[:, k])
        noise = np.sqrt(fit.left * np.var(table[:, k])) * rng.normal(size=DRAWS)
        low, high = np.quantile(fit(drawn) + noise, (0.025, 0.975))
        sd = float(np.sqrt(fit.variance))
        numbers[name] = Number(
            float(about.of(part.run)), sd, float(low), float(high), part.slopes["numbers"][:, k],
            fit.first(n), fit.total(n), fit.left,
        )  # fmt: skip
    return (
        numbers,
        {name: _band(z, drawn, [one[name] for one in rows]) for name in (*PROFILES, "friction")},
        count - len(kept),
    )


def _band(z: Array, drawn: Array, values: list[Array]) -> Band:
    """The 95 % band of fields: their main modes over the sample, each expanded in the inputs."""
    shape, table = values[0].shape, np.array([v.ravel() for v in values])
    mean = table.mean(axis=0)
    u, s, v = np.linalg.svd(table - mean, full_matrices=False)
    kept = 1 + int(np.searchsorted(np.cumsum(s**2), (1 - MODES) * np.sum(s**2))) if s.any() else 0
    scores = np.array([shares.expand(z, u[:, k] * s[k])(drawn) for k in range(min(kept, len(s)))])
    low, high = mean.copy(), mean.copy()
    for begin in range(0, len(mean) if len(scores) else 0, CHUNK):
        part = slice(begin, begin + CHUNK)
        low[part], high[part] = mean[part] + np.quantile(scores.T @ v[: len(scores), part], (0.025, 0.975), axis=0)
    return Band(low.reshape(shape), high.reshape(shape))
