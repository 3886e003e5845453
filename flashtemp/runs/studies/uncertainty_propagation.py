"""Uncertainty propagation from the inputs of a case to its prediction: variance fractions and 95 % bands.

Linear propagation uses derivatives by differences of perturbed runs, integrated together with the run.  Where runs at
two standard deviations show that it is inaccurate, a Latin hypercube of runs and a polynomial expansion replace it.
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
from flashtemp.model.priors import UncertainInput, expand_materials, find_uncertain_inputs
from flashtemp.runs.results.resumable_batch import open_batch_folder, run_batch
from flashtemp.runs.studies import variance_decomposition
from flashtemp.runs.studies.friction_trends import find_trends
from flashtemp.runs.studies.sensitivity_result import OUTPUT_SPECS, PredictedNumber, PredictionBand, SensitivityResult
from flashtemp.solver.perturbed_run import Perturbation
from flashtemp.solver.run import Run
from flashtemp.solver.sensitivity import RunWithSensitivities, run_with_sensitivities
from flashtemp.solver.time_integration import integrate_schedule

Array = npt.NDArray[np.float64]
Watch = Callable[[int, int], Any]
BatchPlace = tuple[Path | None, int | None, str | None]  # folder of saved runs, processes, scheduler
BAND_PROFILES = ("T_block", "T_spot", "T_road")
SLOPE_STEP_SD = 0.02  # sd, step of the derivatives
LINEARITY_TEST_SD = 2.0  # sd at which linear propagation is tested
MAX_LINEAR_MISS = 0.1  # error of linear propagation over the half width of the band, above which runs are sampled
SAME_DIRECTION_COSINE = 0.95  # of the gradients of T_spot and mu, above which one direction tests both
EXPANSION_DRAWS = 4000  # draws from the polynomial expansion
MAX_LOST_VARIANCE = 1e-5  # fraction of the variance of a profile outside its leading modes
BAND_CHUNK_COLUMNS = 400  # columns processed at a time, to limit memory
BAND95_HALF_WIDTH_SD = 1.959964  # half width of a 95 % band
STUDY_PLAN_FILE = "plan.json"  # arguments of an interrupted study


def sample_outputs(run: Run, places: Array, moments: Array) -> dict[str, Array]:
    """Profiles (moments, places), friction (moments,) and the outputs of OUTPUT_SPECS of a run.

    `places` are x/L; `moments` are fractions of the number of saved records.
    """
    at, out = run.mesh.x[run.mesh.last] * places, {}
    records = np.interp(moments, np.linspace(0.0, 1.0, len(run.time)), np.arange(len(run.time)))
    low = np.floor(records).astype(int)
    high, w = np.minimum(low + 1, len(run.time) - 1), records - low
    for name in BAND_PROFILES:
        rows = np.array([np.interp(at, run.x, row) for row in getattr(run, name)])
        out[name] = (1 - w)[:, None] * rows[low] + w[:, None] * rows[high]
    mu = np.where(np.isfinite(run.friction), run.friction, 0.0)
    out["friction"] = (1 - w) * mu[low] + w * mu[high]
    return out | {"numbers": np.array([float(n.evaluate(run)) for n in OUTPUT_SPECS.values()])}


def _run_sample(case: Case) -> dict[str, Array]:
    """The outputs of one run of a sample at its cells and records."""
    run = integrate_schedule(case.scene, case.settings, case.title)
    return sample_outputs(run, run.x / run.mesh.x[run.mesh.last], np.linspace(0.0, 1.0, len(run.time)))


@dataclass(frozen=True, eq=False)
class LinearSensitivity:
    """Derivatives per standard deviation, `slopes` (inputs, ...), of the outputs of `sample_outputs` for the `run`."""

    run: Run
    slopes: dict[str, Array]
    seconds: float


def study_uncertainty(
    case: Case, keys: Sequence[str] | None = None, samples: int | None = None, linear: bool = False,
    workers: int | None = None, scheduler: str | None = None, watch: Watch = lambda done, total: None,
    say: Callable[[str], Any] = lambda text: None, work: Path | None = None,
) -> SensitivityResult:  # fmt: skip
    """Propagate the uncertainty of the inputs `keys`, or of all inputs with a standard deviation.

    `samples`: number of runs of a Latin hypercube; when not given, only where linear propagation is inaccurate, and
    never with `linear`.  Runs are saved in the folder `work` of `open_study_folder`.
    Raises BadInput, SolverFailure, UserInterrupt.
    """
    full = expand_materials(case)
    known, without_sd = find_uncertain_inputs(full, None if keys is None else tuple(keys))
    if samples is not None and (linear or samples < 2 * len(known) + 6):
        why = "contradicts --linear" if linear else f"give at least {2 * len(known) + 6} for {len(known)} inputs"
        raise BadInput(f"--samples: {samples}; {why}")
    say(f"{len(known)} inputs: derivatives together with the run")
    part = compute_linear_sensitivity(full, known)
    check: dict[str, float] = {}
    lopsided = tuple(i.key for i in known if i.is_near_bound)
    if not linear and samples is None:
        check = _test_linearity(full, known, part, (work, workers, scheduler))
    holds = linear or (samples is None and not lopsided and max(check.values(), default=0.0) <= MAX_LINEAR_MISS)
    if holds:
        numbers, bands, failed = _numbers_from_slopes(part), _bands_from_slopes(part), 0
    else:
        count = samples or min(200, max(60, 10 * len(known)))
        say(f"{count} runs of a Latin hypercube")
        numbers, bands, failed = _propagate_sample(full, known, part, count, (work, workers, scheduler), watch)
    k = part.run.last_sliding_index
    return SensitivityResult(
        case, part.run, known, without_sd, "linear" if holds else "sample", numbers, bands, check, lopsided,
        find_trends(full, known, float(np.nanmax(part.run.T_spot[k]))), part.seconds, failed,
    )  # fmt: skip


def open_study_folder(out: Path, case: Case, keys: Sequence[str] | None, samples: int | None, linear: bool):
    """The working folder of a study, as in `open_batch_folder`; runs of a sample do not stay in the result."""
    plan = {"case": case.toml(), "keys": keys and sorted(keys), "samples": samples, "linear": linear}
    return open_batch_folder(out, "sensitivity", STUDY_PLAN_FILE, json.dumps(plan, indent=2) + "\n", drop=True)


# --- linear propagation ---------------------------------------------------------------------------------------
def compute_linear_sensitivity(case: Case, known: Sequence[UncertainInput]) -> LinearSensitivity:
    """Integrate the run together with perturbed runs, one for each input changed by a small step."""
    began = time.process_time()
    # the perturbed runs need the same cells as the run itself
    pinned = case.with_values(first_cells(case.scene, case.values["numerics"]) | _fix_road_depth(case))
    moves = {}
    for i in known:
        step = SLOPE_STEP_SD if i.value + SLOPE_STEP_SD * i.sd <= i.high else -SLOPE_STEP_SD
        moved = pinned.with_values({i.key: i.value + step * i.sd}).scene
        moves[i.key] = Perturbation(moved, step, is_stretched=True)
    try:
        near: RunWithSensitivities[str] = run_with_sensitivities(
            pinned.scene, pinned.settings, moves, case.title, (), True
        )
    except ValueError as fault:
        raise BadInput(f"{case.name}: an input changes the number of cells or phases; leave it out: {fault}") from fault
    run, level = near.run, near.reference
    assert level is not None
    places = run.x / run.mesh.x[run.mesh.last]
    moments = np.linspace(0.0, 1.0, len(level.time))
    plain = sample_outputs(level, places, moments)
    slopes: dict[str, list[Array]] = {name: [] for name in plain}
    for i in known:
        other = sample_outputs(near.perturbed[i.key], places, moments)
        for name, values in plain.items():
            slope = (other[name] - values) / near.steps[i.key]
            slopes[name].append(slope if name == "numbers" else _interpolate_records(run.time, level.time, slope))
    return LinearSensitivity(run, {k: np.array(v) for k, v in slopes.items()}, time.process_time() - began)


def _fix_road_depth(case: Case) -> dict[str, float]:
    return {"road.depth": float(case.scene.mesh.depth[-1])}


def _interpolate_records(times: Array, known: Array, values: Array) -> Array:
    """Rows of `values` at `known` times, interpolated linearly in the record number to all `times`.

    Records are denser after each start, where temperatures follow sqrt(t); interpolation in time would miss that.
    """
    target, source = np.arange(len(times)), np.searchsorted(times, known)
    if values.ndim == 1:
        return np.interp(target, source, values)
    return np.array([np.interp(target, source, column) for column in values.T]).T


def _numbers_from_slopes(part: LinearSensitivity) -> dict[str, PredictedNumber]:
    out = {}
    for k, (name, about) in enumerate(OUTPUT_SPECS.items()):
        value, slopes = float(about.evaluate(part.run)), part.slopes["numbers"][:, k]
        sd, share = float(np.sqrt(np.sum(slopes**2))), variance_decomposition.linear_shares(slopes)
        out[name] = PredictedNumber(
            value, sd, value - BAND95_HALF_WIDTH_SD * sd, value + BAND95_HALF_WIDTH_SD * sd, slopes, share, share, 0.0
        )
    return out


def _bands_from_slopes(part: LinearSensitivity) -> dict[str, PredictionBand]:
    out = {}
    for name in (*BAND_PROFILES, "friction"):
        value = getattr(part.run, name)
        sd = np.sqrt(np.sum(part.slopes[name] ** 2, axis=0))
        out[name] = PredictionBand(value - BAND95_HALF_WIDTH_SD * sd, value + BAND95_HALF_WIDTH_SD * sd)
    return out


def _test_linearity(
    case: Case, known: Sequence[UncertainInput], part: LinearSensitivity, where: BatchPlace
) -> dict[str, float]:
    """{output: error of linear propagation over the half width of its band}, at 2 sd along the steepest direction."""
    slopes, names = part.slopes["numbers"], list(OUTPUT_SPECS)
    directions = [_unit_direction(slopes[:, names.index(n)]) for n in ("T_spot_L", "mu")]
    if not directions[1].any() or abs(directions[0] @ directions[1]) > SAME_DIRECTION_COSINE:
        directions = directions[:1]
    z = np.array([sign * LINEARITY_TEST_SD * direction for direction in directions for sign in (-1.0, 1.0)])
    results, failed = run_batch(_run_sample, [_case_at_z(case, known, row) for row in z], *where, last=False)
    if failed:
        raise SolverFailure(f"at two standard deviations: {next(iter(failed.values()))}")
    start = np.array([float(n.evaluate(part.run)) for n in OUTPUT_SPECS.values()])
    width = BAND95_HALF_WIDTH_SD * np.sqrt(np.sum(slopes**2, axis=0))
    out: dict[str, float] = {}
    for row, result in zip(z, results, strict=True):
        assert result is not None
        miss = np.abs(result["numbers"] - start - row @ slopes)
        for k, (name, about) in enumerate(OUTPUT_SPECS.items()):
            out[name] = max(out.get(name, 0.0), float(miss[k] / max(width[k], about.min_width)))
    return out


def _unit_direction(slopes: Array) -> Array:
    size = float(np.linalg.norm(slopes))
    return slopes / size if size > 0 else slopes


def _case_at_z(case: Case, known: Sequence[UncertainInput], z: Array) -> Case:
    """The case with every input at its standard normal deviate `z`."""
    return replace(case.with_values({i.key: float(i.value_at(v)) for i, v in zip(known, z, strict=True)}))


# --- sampling -------------------------------------------------------------------------------------------------
def _propagate_sample(
    case: Case, known: Sequence[UncertainInput], part: LinearSensitivity, count: int, where: BatchPlace, watch: Watch
):
    """Numbers and bands from a Latin hypercube of runs."""
    z = variance_decomposition.latin_hypercube(count, len(known))
    results, failed = run_batch(_run_sample, [_case_at_z(case, known, row) for row in z], *where, watch)
    shape = part.run.T_spot.shape
    kept = [k for k, result in enumerate(results) if result is not None and result["T_spot"].shape == shape]
    if len(kept) < 0.9 * count:
        why = next(iter(failed.values()), "the number of records differs")
        raise SolverFailure(f"{count - len(kept)} of {count} runs of the sample fail: {why}")
    z, rows = z[kept], [result for k in kept if (result := results[k]) is not None]
    drawn = variance_decomposition.latin_hypercube(EXPANSION_DRAWS, len(known), seed=1, even=False)
    numbers, n = {}, len(known)
    table = np.array([row["numbers"] for row in rows])
    rng = np.random.default_rng(2)
    for k, (name, about) in enumerate(OUTPUT_SPECS.items()):
        fit = variance_decomposition.fit_polynomial_chaos(z, table[:, k])
        noise = np.sqrt(fit.unexplained * np.var(table[:, k])) * rng.normal(size=EXPANSION_DRAWS)
        low, high = np.quantile(fit(drawn) + noise, (0.025, 0.975))
        sd = float(np.sqrt(fit.variance))
        numbers[name] = PredictedNumber(
            float(about.evaluate(part.run)), sd, float(low), float(high), part.slopes["numbers"][:, k],
            fit.first_order_indices(n), fit.total_indices(n), fit.unexplained,
        )  # fmt: skip
    return (
        numbers,
        {name: _sampled_band(z, drawn, [row[name] for row in rows]) for name in (*BAND_PROFILES, "friction")},
        count - len(kept),
    )


def _sampled_band(z: Array, drawn: Array, values: list[Array]) -> PredictionBand:
    """The 95 % band of fields (n rows): principal modes of the sample, each expanded in polynomials of the inputs."""
    shape, table = values[0].shape, np.array([v.ravel() for v in values])
    mean = table.mean(axis=0)
    u, s, v = np.linalg.svd(table - mean, full_matrices=False)
    kept = 1 + int(np.searchsorted(np.cumsum(s**2), (1 - MAX_LOST_VARIANCE) * np.sum(s**2))) if s.any() else 0
    scores = np.array(
        [variance_decomposition.fit_polynomial_chaos(z, u[:, k] * s[k])(drawn) for k in range(min(kept, len(s)))]
    )
    low, high = mean.copy(), mean.copy()
    for begin in range(0, len(mean) if len(scores) else 0, BAND_CHUNK_COLUMNS):
        part = slice(begin, begin + BAND_CHUNK_COLUMNS)
        low[part], high[part] = mean[part] + np.quantile(scores.T @ v[: len(scores), part], (0.025, 0.975), axis=0)
    return PredictionBand(low.reshape(shape), high.reshape(shape))
