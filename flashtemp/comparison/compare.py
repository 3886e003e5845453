"""Measured against computed: simulate what the cameras of a campaign saw, subtract, and say where it differs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from flashtemp.camera import observation
from flashtemp.camera.instrument import Instrument
from flashtemp.camera.observation import ABOVE, WAKE, Seen, observe
from flashtemp.camera.registration import align
from flashtemp.comparison.campaign import Campaign, Condition, Force, View
from flashtemp.comparison.noise import Noise, Place, lag_one, noise, structured, whiten
from flashtemp.comparison.screening import screen_campaign
from flashtemp.errors import BadInput
from flashtemp.model.case import Case
from flashtemp.model.scene import Scene
from flashtemp.showing import Sheet, Shown
from flashtemp.solver.march import march
from flashtemp.solver.run import Run

MARGIN = 3.0  # pixels of road simulated beyond the last one seen
ROUNDED = 1e-4  # of the schedule: times in tables are rounded
CLOCK_S = 0.2  # s: how far the clocks of a camera and of a schedule may be apart; discovery estimates it
LATE = 0.1  # s that the clock of a load cell may run beyond the end: what comes then is left out
SURE = 4.0  # standard errors of a correlation that white noise does not reach


@dataclass(frozen=True)
class Seeing:
    """One recording against its prediction, (frames, nv, nu) degC and K, NaN where not compared.

    `noise` white and fixed, K; `sigmas` the whitened residual, for the tests; `shift` of the image in px with its
    `shift_error`, or the one `shift_refused` because the image cannot be that far off; `correlation` of
    neighbours along u, v and from frame to frame, and in standard errors.
    """

    view: View
    predicted: np.ndarray
    residual: np.ndarray
    sigmas: np.ndarray
    noise: Noise
    shift: tuple[float, float]
    shift_refused: tuple[float, float] | None
    shift_error: tuple[float, float]
    rmse_K: float
    bias_K: float
    chi2_per_dof: float
    pixels: int
    largest: Place | None
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
            "white": self.white,
        } | ({"points": self.each_point} if r.places is not None else {})

    @property
    def each_point(self) -> list[dict[str, Any]]:
        """Name, rms and mean difference (K) of every point of a recording of points."""
        places = self.view.recording.places
        left = self.residual[:, 0].T
        return [
            {"name": n, "rmse_K": float(np.sqrt(np.nanmean(r**2))), "bias_K": float(np.nanmean(r))}
            for n, r in zip(places.names if places is not None else (), left, strict=False)
            if np.isfinite(r).any()
        ]

    @property
    def in_sigma(self) -> np.ndarray:
        """The residual (frames, nv, nu) over the noise of one pixel, its fixed pattern included: for the eye."""
        return self.residual / np.hypot(self.noise.white, self.noise.pattern)

    @property
    def white(self) -> bool:
        """Whether no structure is left between neighbouring pixels and frames."""
        return all(abs(s) < SURE for _, s in self.correlation.values())


@dataclass(frozen=True)
class Pulling:
    """One load-cell trace against its prediction: friction coefficients (n,), `sigma` of one reading."""

    force: Force
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
class Comparison(Shown):
    """A campaign against the case that is believed: every recording and every load-cell trace.

    `screening` {file: which defects of its camera were found and left out}.
    """

    campaign: Campaign
    seeings: tuple[Seeing, ...]
    pullings: tuple[Pulling, ...]
    runs: tuple[Run, ...]
    screening: dict[str, str] = field(default_factory=dict)

    def as_dict(self) -> dict:
        """The content of compare.json."""
        return {
            "title": self.campaign.title,
            "case": self.campaign.case.name,
            "recordings": [s.as_dict() for s in self.seeings],
            "forces": [p.as_dict() for p in self.pullings],
            "energy_imbalance": max(run.energy_imbalance for run in self.runs),
        } | ({"warnings": list(self.warnings)} if self.screening else {})

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line for each recording whose camera has defects."""
        return tuple(f"{file}: {found}" for file, found in self.screening.items())

    def sheet(self) -> Sheet:
        head = ("file", "rms", "mean", "unit", "chi2/dof", "white")
        rows: list[tuple[Any, ...]] = [
            (s.view.file, s.rmse_K, s.bias_K, "K", s.chi2_per_dof, s.white) for s in self.seeings
        ]
        rows += [(p.force.file, p.rmse, p.bias, "mu", p.chi2_per_dof, None) for p in self.pullings]
        told = [f"{s.view.file}: {words(s)}" for s in self.seeings if not s.white]
        return Sheet(f"Comparison '{self.campaign.title}'", rows, head, [*told, *self.warnings])

    def __str__(self) -> str:
        lines = [f"Comparison '{self.campaign.title}'"]
        for s in self.seeings:
            lines += [f"  {s.view.file}: {words(s)}"]
        for p in self.pullings:
            lines += [f"  {p.force.file}: mu differs by {p.rmse:.4f} rms, {p.bias:+.4f} on average,"
                      f" chi2/dof {p.chi2_per_dof:.3g}"]  # fmt: skip
        lines += [f"  note: {warning}" for warning in self.warnings]
        return "\n".join(lines)


def words(s: Seeing) -> str:
    """What a comparison found, in one line for people."""
    line = f"{s.rmse_K:.3f} K rms, {s.bias_K:+.3f} K on average, chi2/dof {s.chi2_per_dof:.3g}"
    if s.largest is not None and not s.white:
        at = s.largest
        places = s.view.recording.places
        place = f"x = {1e3 * at.u:.3g} mm" if places is None else f"point {places.names[round(at.u)]}"
        if not s.view.recording.line:
            place += f", {'z' if s.view.recording.view == 'sidewall' else 'y'} = {1e3 * at.v:.3g} mm"
        line += (
            f"; most at {place}, t = {at.time:.4g} s (repetition {at.repetition}): {at.K:+.2f} K, {at.sigma:+.0f} sigma"
        )
    if len(s.each_point) > 1:
        line += "; rms of each point: " + ", ".join(f"{p['name']} {p['rmse_K']:.3g} K" for p in s.each_point)
    if s.shift_refused is not None:
        far = " and ".join(f"{v:.2f}" for v in s.shift_refused)
        line += f"; a shift by {far} px would fit better than the image can be off: not applied"
    plain = s.white and s.chi2_per_dof < SURE
    return line if not plain else f"{line}; no structure left in space or time"


def compare(campaign: Campaign, watch: Callable[[str], Any] = lambda text: None) -> Comparison:
    """Simulate every condition of a campaign once and compare all its recordings and forces with it.

    Raises BadInput, SolverFailure.
    """
    campaign, screening = screen_campaign(campaign)
    seeings, pullings, runs = {}, {}, []
    for number, condition in enumerate(campaign.conditions, 1):
        watch(f"condition {number} of {len(campaign.conditions)}: {condition.words}")
        scene, run = simulate(campaign, condition)
        runs.append(run)
        for view in condition.views:
            seeings[id(view)] = see(run, scene, view)
        for force in condition.forces:
            pullings[id(force)] = pull(run, force)
    return Comparison(
        campaign,
        tuple(seeings[id(v)] for v in campaign.views),
        tuple(pullings[id(f)] for f in campaign.forces),
        tuple(runs),
        screening,
    )


def simulate(campaign: Campaign, condition: Condition) -> tuple[Scene, Run]:
    """March the believed case under one condition, with fields at all times that its recordings show."""
    given, views = condition.given, condition.views
    case = campaign.load(given | window(campaign.load(given), views))
    scene = case.scene
    for view in views:
        check(view, scene)
    settings = replace(case.settings, times=moments(views, scene), fields=2)
    return scene, march(scene, settings, case.title)


def window(case: Case, views) -> dict[str, Any]:
    """Overrides of a case for what its recordings see: even cells up a side wall, road as far as a wake reaches."""
    out, wakes = {}, [v for v in views if v.recording.view == "wake"]
    if any(v.recording.view == "sidewall" for v in views):
        out["numerics.above"] = max(ABOVE, case["numerics.above"])
    if not wakes:
        return out
    far = max(wakes, key=lambda v: v.recording.u[-1])
    behind = max(v.recording.u[-1] + MARGIN * v.recording.pitch[0] for v in wakes) - case["block.length"]
    if behind > 10.0:
        raise BadInput(f"{far.file}: u: {far.recording.u[-1]:g} m is too far behind the block; give u in m, below 10 m")
    return out | {
        "road.downstream": max(float(behind), case["road.downstream"]),
        "numerics.behind": min(WAKE, case["numerics.behind"]),
    }


def moments(views, scene: Scene, late: Mapping[str, float] = MappingProxyType({})) -> tuple[float, ...]:
    """All times (s) that the frames of recordings show, stamped `late` (s) by file; outside the schedule they show its
    beginning or its end."""
    shown = (Instrument(v.recording, scene.acting, late.get(v.file, 0.0)).asked() for v in views)
    return tuple(sorted({float(t) for times in shown for t in np.clip(times, 0.0, scene.schedule.end)}))


def check(view: View, scene: Scene) -> None:
    """BadInput unless the frames of a recording belong to the schedule of its condition."""
    schedule, time = scene.schedule, view.recording.time
    late = np.flatnonzero(time > schedule.end * (1 + ROUNDED) + CLOCK_S)
    if len(late):
        raise BadInput(
            f"{view.file}: time: frame {late[0] + 1} is of {time[late[0]]:g} s, but the schedule of its condition ends "
            f"at {schedule.end:g} s; mend schedule.* in with, or the times of the recording"
        )
    observation.check(view.recording, scene, view.file)
    near = ROUNDED * schedule.end + CLOCK_S
    for t, said in zip(time, view.recording.repetition, strict=True):
        possible = [schedule.phase(at).repetition for at in (t - near, t + near)]
        if said not in possible:
            raise BadInput(
                f"{view.file}: repetition: {said} at {t:g} s, where the schedule of its condition is in repetition "
                f"{possible[0]}; mend schedule.* in with, or the recording"
            )


def see(run: Run, scene: Scene, view: View) -> Seeing:
    """One recording against a run of its condition."""
    recording = view.recording
    stated = levels(view)

    def left(seen: Seen) -> np.ndarray:
        out: np.ndarray = recording.temperature - seen.temperature
        out[:, ~seen.inside] = np.nan
        return out

    plain = observe(run, scene, recording, scene.acting)
    if not np.isfinite(left(plain)).any():
        raise BadInput(
            f"{view.file}: no pixel of it lies on the block or the road, clear of their edges; check u, v and view, "
            "or give smaller pixels"
        )
    guess = noise(left(plain), *stated)
    found = align(run, scene, recording, plain, lambda r: whiten(r, guess), recording.registration_sigma_px or 0.0)
    residual = left(found.seen)
    return judge(
        view, found.seen.temperature, residual, noise(residual, *stated), found.shift, found.error, found.refused
    )


def levels(view: View) -> tuple[float | None, float | None]:
    """White and fixed noise (K) that a recording states; points have no pattern between neighbours to estimate."""
    recording = view.recording
    pattern = 0.0 if recording.fixed_pattern_K is None and recording.places is not None else recording.fixed_pattern_K
    return view.sigma_K if view.sigma_K is not None else recording.netd_K, pattern


def judge(view: View, predicted, residual, level: Noise, shift=(0.0, 0.0), error=(0.0, 0.0), refused=None) -> Seeing:
    """A recording against a prediction, residual (frames, nv, nu) K, with its noise and shift found already."""
    sigmas = whiten(residual, level)
    good = np.isfinite(residual)
    count = int(good.sum())
    return Seeing(
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
        largest=structured(residual, level, view.recording),
        correlation={name: lag_one(sigmas, axis) for axis, name in ((2, "u"), (1, "v"), (0, "time"))},
    )


def pull(run: Run, force: Force) -> Pulling:
    """One load-cell trace against a run of its condition; readings while nothing slides are left out."""
    on, predicted = grip(run, force)
    residual = np.where(on, np.array(force.mu) - predicted, np.nan)
    return judge_pull(force, predicted, residual)


def grip(run: Run, force: Force) -> tuple[np.ndarray, np.ndarray]:
    """Which readings (n,) of a load cell were taken while the block slides, and the friction predicted for them."""
    good, time = np.isfinite(run.friction), np.array(force.time)
    if time[-1] > run.time[-1] + LATE:
        raise BadInput(
            f"{force.file}: time_s: goes to {time[-1]:g} s, but the schedule of its condition ends at "
            f"{run.time[-1]:g} s; mend schedule.* in with, or the table"
        )
    on = (np.interp(time, run.time, run.sliding.astype(float)) > 0.99) & (time <= run.time[-1] * (1 + ROUNDED))
    if not on.any():
        raise BadInput(f"{force.file}: time_s: no reading was taken while the block slides; check the times")
    return on, np.interp(time, run.time[good], run.friction[good])


def judge_pull(force: Force, predicted, residual) -> Pulling:
    """A load-cell trace against a prediction, residual (n,) NaN where not compared."""
    kept = residual[np.isfinite(residual)]
    sigma = force.sigma or scatter(kept)
    return Pulling(
        force, predicted, residual, sigma,
        rmse=float(np.sqrt(np.mean(kept**2))) if len(kept) else float("nan"),
        bias=float(np.mean(kept)) if len(kept) else float("nan"),
        chi2_per_dof=float(np.mean((kept / sigma) ** 2)) if len(kept) else float("nan"),
        correlation={"time": lag_one(kept / sigma, 0)},
    )  # fmt: skip


def scatter(residual: np.ndarray) -> float:
    """Standard deviation of one reading (n,) that changes slowly otherwise, from second differences."""
    steps = np.diff(residual, n=2) / np.sqrt(6.0)
    return float(max(1.4826 * np.median(np.abs(steps)), 1e-6) if len(steps) else 1e-3)
