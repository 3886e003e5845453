"""Comparison of a campaign with its stated case: simulate, predict every recording, subtract and test the residuals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from flashtemp.camera.image_screening import screen_recording
from flashtemp.camera.prediction import observation
from flashtemp.camera.prediction.camera_model import CameraModel
from flashtemp.camera.prediction.image_registration import align_image
from flashtemp.camera.prediction.observation import SIDE_WALL_CELLS, WAKE_CELL_GROWTH, PredictedImage, observe
from flashtemp.camera.quantisation import quantisation_step
from flashtemp.comparison.campaign import Campaign, Condition, LoadCellEntry, RecordingEntry
from flashtemp.comparison.largest_profile import find_largest_profile
from flashtemp.comparison.noise import (
    NoiseLevels,
    ResidualPeak,
    estimate_noise,
    lag1_autocorrelation,
    largest_structured_residual,
)
from flashtemp.comparison.noise_whitening import whiten_residual
from flashtemp.display import DisplayMixin, DisplayTable, ProgressMessage
from flashtemp.errors import BadInput, RenamedAttribute
from flashtemp.model.case import Case
from flashtemp.model.scene import Scene
from flashtemp.solver.run import Run
from flashtemp.solver.time_integration import integrate_schedule

ROAD_MARGIN_PX = 3.0  # pixels of road that are simulated beyond the last recorded one
SCHEDULE_ROUNDING = 1e-4  # of the schedule's length, for rounded times in tables
MAX_CLOCK_DIFFERENCE_S = 0.2  # s, between the clocks of camera and schedule; discovery estimates it
MAX_LOAD_CELL_OVERRUN_S = 0.1  # s, of load-cell readings beyond the end of the schedule, which are left out
WHITE_NOISE_LIMIT_SDS = 4.0  # standard errors: a larger autocorrelation is not white noise


@dataclass(frozen=True)
class RecordingComparison:
    """One recording and its prediction, (frames, nv, nu) degC and K, NaN where not compared.

    `noise` white and fixed, K; `sigmas` the whitened residual, for the tests; `shift` of the image in px with its
    `shift_error`, or `shift_refused`, a shift that contradicts the stated origin; lag-1 `correlation` along u, v and
    time, each with its value in standard errors.
    """

    view: RecordingEntry
    predicted: np.ndarray
    residual: np.ndarray
    sigmas: np.ndarray
    noise: NoiseLevels
    shift: tuple[float, float]
    shift_refused: tuple[float, float] | None
    shift_error: tuple[float, float]
    rmse_K: float
    bias_K: float
    chi2_per_dof: float
    pixels: int
    largest: ResidualPeak | None
    correlation: dict[str, tuple[float, float]]

    def as_dict(self) -> dict:
        """For compare.json."""
        r = self.view.recording
        return {
            "file": self.view.file,
            "view": r.view,
            "with": self.view.given,
            "held_out": self.view.held_out,
            "frames": r.frames,
            "values": self.pixels,
            "rmse_K": self.rmse_K,
            "bias_K": self.bias_K,
            "chi2_per_dof": self.chi2_per_dof,
            "noise": asdict(self.noise),
            "shift_px": list(self.shift),
            "shift_error_px": list(self.shift_error),
            "shift_refused_px": self.shift_refused and list(self.shift_refused),
            "largest": self.largest and asdict(self.largest),
            "correlation": {k: {"lag_one": r, "sigma": s} for k, (r, s) in self.correlation.items()},
            "white": self.is_white,
        } | ({"points": self.point_statistics} if r.places is not None else {})

    @property
    def largest_profile(self) -> dict[str, Any] | None:
        """The profile through the largest difference, as in compare.json."""
        return find_largest_profile(self.view.recording, self.predicted, self.residual, self.largest)

    @property
    def point_statistics(self) -> list[dict[str, Any]]:
        """Name, rms and mean difference (K) of every point of a recording of points."""
        places = self.view.recording.places
        series = self.residual[:, 0].T
        return [
            {"name": n, "rmse_K": float(np.sqrt(np.nanmean(r**2))), "bias_K": float(np.nanmean(r))}
            for n, r in zip(places.names if places is not None else (), series, strict=False)
            if np.isfinite(r).any()
        ]

    @property
    def sigma_residual(self) -> np.ndarray:
        """The residual (frames, nv, nu) over the noise of one pixel with its fixed pattern, for pictures."""
        return self.residual / np.hypot(self.noise.white, self.noise.pattern)

    @property
    def is_white(self) -> bool:
        """Whether the residual has no significant lag-1 autocorrelation in space and time."""
        return all(abs(s) < WHITE_NOISE_LIMIT_SDS for _, s in self.correlation.values())


@dataclass(frozen=True)
class ForceComparison:
    """One load-cell series and its prediction: friction coefficients (n,), `sigma` of one reading."""

    force: LoadCellEntry
    predicted: np.ndarray
    residual: np.ndarray
    sigma: float
    rmse: float
    bias: float
    chi2_per_dof: float
    correlation: dict[str, tuple[float, float]]

    def as_dict(self) -> dict:
        """For compare.json."""
        return {
            "file": self.force.file, "with": self.force.given, "held_out": self.force.held_out,
            "readings": len(self.residual), "rmse": self.rmse, "bias": self.bias, "sigma": self.sigma,
            "chi2_per_dof": self.chi2_per_dof,
            "correlation": {k: {"lag_one": r, "sigma": s} for k, (r, s) in self.correlation.items()},
        }  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(DisplayMixin):
    """Comparison of a campaign with its stated case, for every recording and every load-cell series.

    `screening` {file: defects of its camera that were found and masked}.
    """

    campaign: Campaign
    recordings: tuple[RecordingComparison, ...]
    forces: tuple[ForceComparison, ...]
    runs: tuple[Run, ...]
    screening: dict[str, str] = field(default_factory=dict)

    def as_dict(self) -> dict:
        """The content of compare.json."""
        return {
            "title": self.campaign.title,
            "case": self.campaign.case.name,
            "recordings": [s.as_dict() | {"profile": s.largest_profile} for s in self.recordings],
            "forces": [p.as_dict() for p in self.forces],
            "energy_imbalance": max(run.energy_imbalance for run in self.runs),
        } | ({"warnings": list(self.warnings)} if self.screening else {})

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line for each recording whose camera has defects."""
        return tuple(f"{file}: {found}" for file, found in self.screening.items())

    def to_table(self) -> DisplayTable:
        head = ("file", "rms", "mean", "unit", "chi2/dof", "white")
        rows: list[tuple[Any, ...]] = [
            (s.view.file, s.rmse_K, s.bias_K, "K", s.chi2_per_dof, s.is_white) for s in self.recordings
        ]
        rows += [(p.force.file, p.rmse, p.bias, "mu", p.chi2_per_dof, None) for p in self.forces]
        notes = [f"{s.view.file}: {summary_line(s)}" for s in self.recordings if not s.is_white]
        return DisplayTable(f"Comparison '{self.campaign.title}'", rows, head, [*notes, *self.warnings])

    def __str__(self) -> str:
        lines = [f"Comparison '{self.campaign.title}'"]
        for s in self.recordings:
            lines += [f"  {s.view.file}: {summary_line(s)}"]
        for p in self.forces:
            lines += [f"  {p.force.file}: mu differs by {p.rmse:.4f} rms, {p.bias:+.4f} on average,"
                      f" chi2/dof {p.chi2_per_dof:.3g}"]  # fmt: skip
        lines += [f"  note: {warning}" for warning in self.warnings]
        return "\n".join(lines)

    seeings = RenamedAttribute("recordings")
    pullings = RenamedAttribute("forces")


def summary_line(s: RecordingComparison) -> str:
    """Result of a comparison in one line for people."""
    line = f"{s.rmse_K:.3f} K rms, {s.bias_K:+.3f} K on average, chi2/dof {s.chi2_per_dof:.3g}"
    if s.largest is not None and not s.is_white:
        at = s.largest
        places = s.view.recording.places
        place = f"x = {1e3 * at.u:.3g} mm" if places is None else f"point {places.names[round(at.u)]}"
        if not s.view.recording.is_single_row:
            place += f", {'z' if s.view.recording.view == 'sidewall' else 'y'} = {1e3 * at.v:.3g} mm"
        line += (
            f"; most at {place}, t = {at.time:.4g} s (repetition {at.repetition}): {at.K:+.2f} K, {at.sigma:+.0f} sigma"
        )
    if len(s.point_statistics) > 1:
        line += "; rms of each point: " + ", ".join(f"{p['name']} {p['rmse_K']:.3g} K" for p in s.point_statistics)
    if s.shift_refused is not None:
        shift = " and ".join(f"{v:.2f}" for v in s.shift_refused)
        line += f"; a shift by {shift} px fits best but contradicts the stated origin: not applied"
    is_adequate = s.is_white and s.chi2_per_dof < WHITE_NOISE_LIMIT_SDS
    return line if not is_adequate else f"{line}; no structure left in space or time"


def compare(campaign: Campaign, watch: Callable[[str], Any] = lambda text: None) -> Comparison:
    """Simulate every condition of a campaign once and compare its recordings and forces with the result.

    `watch` is called with one line of progress per condition.  Raises BadInput, SolverFailure.
    """
    campaign, screening = screen_campaign(campaign)
    recordings: dict[Any, Any] = {}
    forces: dict[Any, Any] = {}
    runs: list[Any] = []
    for number, condition in enumerate(campaign.conditions, 1):
        words = f"condition {number} of {len(campaign.conditions)}: {condition.words}"
        rows = [{"recording": r.view.file, "rms difference (K)": r.rmse_K} for r in recordings.values()]
        watch(ProgressMessage(words, done=number - 1, total=len(campaign.conditions), rows=rows))
        scene, run = simulate_condition(campaign, condition)
        runs.append(run)
        for view in condition.views:
            recordings[id(view)] = compare_recording(run, scene, view)
        for force in condition.forces:
            forces[id(force)] = compare_force(run, force)
    return Comparison(
        campaign,
        tuple(recordings[id(v)] for v in campaign.views),
        tuple(forces[id(f)] for f in campaign.forces),
        tuple(runs),
        screening,
    )


def simulate_condition(campaign: Campaign, condition: Condition) -> tuple[Scene, Run]:
    """Simulate the stated case in one condition, with fields at all times that its recordings show."""
    given, views = condition.given, condition.views
    case = campaign.load(given | view_overrides(campaign.load(given), views))
    scene = case.scene
    for view in views:
        check_recording(view, scene)
    settings = replace(case.settings, times=required_times(views, scene), fields=2)
    return scene, integrate_schedule(scene, settings, case.title)


def view_overrides(case: Case, views) -> dict[str, Any]:
    """Overrides of a case that its recordings need: uniform cells up a side wall, road as far as a wake reaches."""
    out, wakes = {}, [v for v in views if v.recording.view == "wake"]
    if any(v.recording.view == "sidewall" for v in views):
        out["numerics.above"] = max(SIDE_WALL_CELLS, case["numerics.above"])
    if not wakes:
        return out
    far = max(wakes, key=lambda v: v.recording.u[-1])
    behind = max(v.recording.u[-1] + ROAD_MARGIN_PX * v.recording.pitch[0] for v in wakes) - case["block.length"]
    if behind > 10.0:
        raise BadInput(f"{far.file}: u: {far.recording.u[-1]:g} m is too far behind the block; give u in m, below 10 m")
    return out | {
        "road.downstream": max(float(behind), case["road.downstream"]),
        "numerics.behind": min(WAKE_CELL_GROWTH, case["numerics.behind"]),
    }


def required_times(views, scene: Scene, late: Mapping[str, float] = MappingProxyType({})) -> tuple[float, ...]:
    """All times (s) that the frames of recordings show, limited to the schedule.

    `late` {file: s}: by how much frames are stamped late.
    """
    shown = (CameraModel(v.recording, scene.acting, late.get(v.file, 0.0)).required_times() for v in views)
    return tuple(sorted({float(t) for times in shown for t in np.clip(times, 0.0, scene.schedule.end_time)}))


def check_recording(view: RecordingEntry, scene: Scene) -> None:
    """BadInput unless the frames of a recording belong to the schedule of its condition."""
    schedule, time = scene.schedule, view.recording.time
    late = np.flatnonzero(time > schedule.end_time * (1 + SCHEDULE_ROUNDING) + MAX_CLOCK_DIFFERENCE_S)
    if len(late):
        raise BadInput(
            f"{view.file}: time: frame {late[0] + 1} is of {time[late[0]]:g} s, but the schedule of its condition ends "
            f"at {schedule.end_time:g} s; correct schedule.* in with, or the times of the recording"
        )
    observation.check_view(view.recording, scene, view.file)
    near = SCHEDULE_ROUNDING * schedule.end_time + MAX_CLOCK_DIFFERENCE_S
    for t, stated in zip(time, view.recording.repetition, strict=True):
        possible = [schedule.phase_at(at).repetition for at in (t - near, t + near)]
        if stated not in possible:
            raise BadInput(
                f"{view.file}: repetition: {stated} at {t:g} s, where the schedule of its condition is in repetition "
                f"{possible[0]}; correct schedule.* in with, or the recording"
            )


def compare_recording(run: Run, scene: Scene, view: RecordingEntry) -> RecordingComparison:
    """Compare one recording with a run of its condition."""
    recording = view.recording
    stated = stated_noise(view)

    def residual_of(predicted: PredictedImage) -> np.ndarray:
        out: np.ndarray = recording.temperature - predicted.temperature
        out[:, ~predicted.inside] = np.nan
        return out

    plain = observe(run, scene, recording, scene.acting)
    if not np.isfinite(residual_of(plain)).any():
        raise BadInput(
            f"{view.file}: no pixel lies on the block or the road, away from their edges; check u, v and view, "
            "or give smaller pixels"
        )
    step = quantisation_step(recording.temperature)
    # of an image that may be misaligned: only for weights
    first_noise = estimate_noise(residual_of(plain), *stated, digit_step=step)
    alignment = align_image(
        run, scene, recording, plain, lambda r: whiten_residual(r, first_noise), recording.registration_sigma_px or 0.0
    )
    residual = residual_of(alignment.seen)
    return compare_with_prediction(
        view,
        alignment.seen.temperature,
        residual,
        estimate_noise(residual, *stated, digit_step=step),
        alignment.shift,
        alignment.error,
        alignment.refused,
    )


def stated_noise(view: RecordingEntry) -> tuple[float | None, float | None]:
    """White and fixed noise (K) that a recording states, None where unknown; points have no fixed pattern."""
    recording = view.recording
    pattern = 0.0 if recording.fixed_pattern_K is None and recording.places is not None else recording.fixed_pattern_K
    return view.sigma_K if view.sigma_K is not None else recording.netd_K, pattern


def compare_with_prediction(
    view: RecordingEntry, predicted, residual, level: NoiseLevels, shift=(0.0, 0.0), error=(0.0, 0.0), refused=None
) -> RecordingComparison:
    """Statistics of a recording's residual (frames, nv, nu) K for a given prediction, noise and shift."""
    sigmas = whiten_residual(residual, level)
    good = np.isfinite(residual)
    count = int(good.sum())
    return RecordingComparison(
        view=view,
        predicted=predicted,
        residual=residual,
        sigmas=sigmas,
        noise=level,
        shift=shift,
        shift_refused=refused,
        shift_error=error,
        rmse_K=float(np.sqrt(np.mean(residual[good] ** 2))) if count else float("nan"),
        bias_K=float(np.mean(residual[good])) if count else float("nan"),
        chi2_per_dof=float(np.sum(sigmas[good] ** 2) / max(count - sum(e > 0 for e in error), 1)),
        pixels=count,
        largest=largest_structured_residual(residual, level, view.recording),
        correlation={name: lag1_autocorrelation(sigmas, axis) for axis, name in ((2, "u"), (1, "v"), (0, "time"))},
    )


def compare_force(run: Run, force: LoadCellEntry) -> ForceComparison:
    """Compare one load-cell series with a run of its condition; readings while nothing slides are left out."""
    on, predicted = predict_friction(run, force)
    residual = np.where(on, np.array(force.mu) - predicted, np.nan)
    return compare_force_with_prediction(force, predicted, residual)


def predict_friction(run: Run, force: LoadCellEntry) -> tuple[np.ndarray, np.ndarray]:
    """Mask (n,) of load-cell readings taken while the block slides, and the friction predicted for all readings."""
    good, time = np.isfinite(run.friction), np.array(force.time)
    if time[-1] > run.time[-1] + MAX_LOAD_CELL_OVERRUN_S:
        raise BadInput(
            f"{force.file}: time_s: goes to {time[-1]:g} s, but the schedule of its condition ends at "
            f"{run.time[-1]:g} s; correct schedule.* in with, or the table"
        )
    on = (np.interp(time, run.time, run.sliding.astype(float)) > 0.99) & (
        time <= run.time[-1] * (1 + SCHEDULE_ROUNDING)
    )
    if not on.any():
        raise BadInput(f"{force.file}: time_s: no reading was taken while the block slides; check the times")
    return on, np.interp(time, run.time[good], run.friction[good])


def compare_force_with_prediction(force: LoadCellEntry, predicted, residual) -> ForceComparison:
    """Statistics of a load-cell series for a given prediction; residual (n,) is NaN where not compared."""
    kept = residual[np.isfinite(residual)]
    sigma = force.sigma or estimate_reading_noise(kept)
    return ForceComparison(
        force, predicted, residual, sigma,
        rmse=float(np.sqrt(np.mean(kept**2))) if len(kept) else float("nan"),
        bias=float(np.mean(kept)) if len(kept) else float("nan"),
        chi2_per_dof=float(np.mean((kept / sigma) ** 2)) if len(kept) else float("nan"),
        correlation={"time": lag1_autocorrelation(kept / sigma, 0)},
    )  # fmt: skip


def estimate_reading_noise(residual: np.ndarray) -> float:
    """Standard deviation of one reading from second differences (n,), which a slow change does not enter."""
    steps = np.diff(residual, n=2) / np.sqrt(6.0)
    return float(max(1.4826 * np.median(np.abs(steps)), 1e-6) if len(steps) else 1e-3)


def screen_campaign(campaign: Campaign) -> tuple[Campaign, dict[str, str]]:
    """The campaign with the defects of its cameras masked, and by file a line that lists them."""
    defects: dict[str, str] = {}
    views = tuple(_screen_entry(view, defects) for view in campaign.views)
    changed = any(new is not old for new, old in zip(views, campaign.views, strict=True))
    return (replace(campaign, views=views) if changed else campaign), defects


def _screen_entry(view: RecordingEntry, defects: dict[str, str]) -> RecordingEntry:
    screening = screen_recording(view.recording)
    if screening.summary:
        defects[view.file] = screening.summary
    masked = screening.apply_to(view.recording)
    return view if masked is view.recording else replace(view, recording=masked)
