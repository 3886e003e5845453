"""A campaign made ready for fitting: conditions on meshes that stay, candidates, and recordings that do not belong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from flashtemp.camera.placement import Place
from flashtemp.comparison.campaign import Campaign, Condition, View
from flashtemp.comparison.compare import window
from flashtemp.comparison.screening import screen_campaign
from flashtemp.discovery.condensing import condensed
from flashtemp.discovery.hypothesis import Candidate, Model, candidates, prior
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction import Derivatives, Prediction, Task
from flashtemp.errors import BadInput, FlashtempError
from flashtemp.model import layers
from flashtemp.model.build import first_cells
from flashtemp.model.case import Case
from flashtemp.model.schema import refinement
from flashtemp.solver.circular_track import remembers

CLEARLY = 0.5  # misfit otherwise over misfit as told, below which a recording is something else
LIKELY = 1.4  # how much friction and contact that are not known may change a rise
SEEN = 0.3  # K: misfits below it are no ground for suspicion
LEAST = 0.1  # of numerics.finer that a case may give
# rtol at most where road comes back: at 1e-3 another sequence of steps changed a wake's ln evidence by 70, at 1e-4 by 2
FINE = 1e-4
UNSAID = {"registration_sigma_px": 0.5, "psf_sigma_px": 0.7}  # px: of an image that does not say it

Run = Callable[[list[Task]], Sequence[Prediction | FlashtempError]]


@dataclass(frozen=True)
class Problem:
    """What does not change while a campaign is fitted.

    `pins` of the mesh per condition; `tried` candidates and `left` {effect: why it cannot be tried}; `run` maps
    `predict` over tasks and gives failures as answers; `loose` errors of the laboratory whose prior is widened;
    `stiff`: images, clocks and the block may hardly be elsewhere than where they are; `shared_setup`: recordings of a
    view may share an error of scale, turn and clock besides their own.  Images that were seen to lie far
    from where they are told to begin at their `places` and `shifts`.  `untold` {recording: what of UNSAID it does not
    say}.  `screening` {recording: which defects of its camera were found}.
    """

    campaign: Campaign
    conditions: tuple[Condition, ...]
    pins: tuple[dict[str, Any], ...]
    tried: tuple[Candidate, ...]
    left: dict[str, str]
    run: Run
    case: Case
    loose: frozenset[ParameterId] = frozenset()
    stiff: bool = False
    shared_setup: bool = False
    places: dict[str, Place] = field(default_factory=dict)
    shifts: dict[str, tuple[float, float]] = field(default_factory=dict)
    untold: dict[str, tuple[str, ...]] = field(default_factory=dict)
    screening: dict[str, str] = field(default_factory=dict)

    def tasks(self, model: Model, derivatives: Derivatives, coarse: tuple[float, ...] | None = None) -> list[Task]:
        """One task per condition; `coarse` (3,) or (4,) multiplies the number of cells along, up, down and across."""
        out = []
        for c, pins in zip(self.conditions, self.pins, strict=True):
            if coarse:
                pins = pins | self._coarser(*coarse)
            out.append(Task(self.case, c.given, pins, model, c.views, c.forces, derivatives))
        return out

    def _coarser(self, along: float, up: float, down: float, across: float = 1.0) -> dict[str, Any]:
        """Keys of a mesh that has so many times the cells."""
        finer = zip((along, up, down), self.case["numerics.finer"], strict=True)
        out: dict[str, Any] = {"numerics.finer": [max(LEAST, k * f) for k, f in finer]}
        if across < 1.0:
            out["numerics.across"] = max(2, round(across * self.case["numerics.across"]))
            if first := self.case["numerics.first_y"]:
                out["numerics.first_y"] = first / across
        return out

    def predictions(self, tasks: list[Task]) -> list[Prediction]:
        """Answers to tasks, in order; a failure among them is raised."""
        return [checked(answer) for answer in self.run(tasks)]

    @property
    def priors(self) -> dict[ParameterId, float]:
        """Standard deviation of the ln of every free key."""
        stated = self.campaign.priors
        return {ParameterId.of_key(key): stated.get(key, prior(key)) for key in self.campaign.free}

    @property
    def free(self) -> tuple[ParameterId, ...]:
        return tuple(map(ParameterId.of_key, self.campaign.free))

    @property
    def start(self) -> Model:
        """The case as it is believed."""
        return Model(dict.fromkeys(self.campaign.free, 0.0), shifts=self.shifts, places=self.places)


def checked(answer: Prediction | FlashtempError) -> Prediction:
    """The answer itself unless it is a failure, which is raised."""
    if isinstance(answer, FlashtempError):
        raise answer
    return answer


def prepare(campaign: Campaign, run: Run) -> Problem:
    """Check a campaign for what fitting needs; long recordings are condensed.  Raises BadInput."""
    if campaign.entries and all(entry.held_out for entry in campaign.entries):
        raise BadInput("campaign: held_out = true of every recording and trace; leave at least one to be fitted")
    untold = {v.file: missing for v in campaign.views if (missing := _untold(v))}
    campaign, screening = screen_campaign(campaign)
    campaign = condensed(replace(campaign, views=tuple(map(_told, campaign.views))))
    case = campaign.load({})
    for key in campaign.free:
        value = case[key]
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < float("inf"):
            raise BadInput(
                f"{campaign.case}: {key}: {value!r} cannot be freed; give a number > 0, or leave it out of free"
            )
        may_move(campaign, case, key)
    named = campaign.candidates if campaign.candidates is not None else case.candidates
    tried, left = candidates(case, named)
    pins = tuple(_pins(campaign, c, tried) for c in campaign.conditions)
    return Problem(
        campaign, campaign.conditions, pins, tuple(tried), left, run, case, untold=untold, screening=screening
    )


def _untold(view: View) -> tuple[str, ...]:
    """What an image does not say of its camera: nobody knows exactly where it lies, and no optics are sharp."""
    if view.recording.view not in ("sidewall", "wake"):
        return ()
    return tuple(name for name in UNSAID if getattr(view.recording, name) is None)


def _told(view: View) -> View:
    """A view with what is usual for what it does not say."""
    usual: dict[str, Any] = {name: UNSAID[name] for name in _untold(view)}
    return replace(view, recording=replace(view.recording, **usual)) if usual else view


def may_move(campaign: Campaign, case: Case, key: str) -> None:
    """BadInput unless a key can move while mesh and schedule stay."""
    pins = first_cells(case.scene, case.values["numerics"])
    scene, moved = case.with_values(pins).scene, case.with_values(pins | {key: case[key] * 0.99}).scene
    same = all(np.array_equal(getattr(moved.mesh, k), getattr(scene.mesh, k)) for k in ("x", "height"))
    if not same or moved.schedule.end != scene.schedule.end:
        what = "schedule" if same else "mesh"
        raise BadInput(f"{campaign.case}: free: {key!r} changes the {what}; free a parameter of the physics instead")


def _pins(campaign: Campaign, condition: Condition, tried: list[Candidate]) -> dict[str, Any]:
    """Overrides that give a condition one mesh, whatever is tried on it."""
    case = campaign.load(condition.given)
    others = [c.effect for c in tried if not c.optical]
    scenes = [case.scene, *(case.with_values({"effects": [*case.effects, other]}).scene for other in others)]
    meshes = [s.mesh for s in scenes]
    returns = len(case.scene.schedule.directions) > 1 or any(map(remembers, scenes))
    refine = refinement(case["numerics.mesh"]) * case["numerics.finer"][1]
    return (
        window(case, condition.views)
        | layers.cells(case.scene, case.values["numerics"])
        | {
            "road.depth": float(max(m.depth[-1] for m in meshes)),
            "numerics.first_block": float(min(m.height[1] for m in meshes)) * refine,
            "numerics.first_road": first_cells(case.scene, case.values["numerics"])["numerics.first_road"],
        }
        | ({"numerics.rtol": min(FINE, case["numerics.rtol"])} if returns else {})
    )


# --- recordings that do not belong to their condition ---------------------------------------------------
def strangers(problem: Problem, predictions: Sequence[Prediction]) -> dict[str, str]:
    """{file: what it seems to be} of recordings that fit far better upside down or to another condition."""
    out = _copies(problem)
    for number, (condition, prediction) in enumerate(zip(problem.conditions, predictions, strict=True)):
        for view in condition.views:
            if view.file in out:
                continue
            seen, T = prediction.observables[view.file], view.recording.temperature
            still = problem.case["ambient.temperature"]
            own = misfit(T - still, seen.values - still, seen.inside)
            if not own > SEEN:
                continue
            ways = {}
            if view.recording.view == "sidewall":
                for words, turned in (("upside down", T[:, ::-1]), ("turned by 180 degrees", T[:, ::-1, ::-1])):
                    ways[f"is {words}"] = misfit(turned - still, seen.values - still, seen.inside)
            ways |= _elsewhere(problem, predictions, number, view)
            best = min(ways, key=ways.__getitem__, default=None)
            if best is not None and ways[best] < CLEARLY * own:
                out[view.file] = f"{best}: it differs by {own:.2g} K rms as told, by {ways[best]:.2g} K so"
    return out


def _elsewhere(problem: Problem, predictions: Sequence[Prediction], number: int, view: View) -> dict[str, float]:
    """{words: misfit (K)} of a recording of condition `number` to like recordings of the other conditions."""
    out, T, still = {}, view.recording.temperature, problem.case["ambient.temperature"]
    inside = predictions[number].observables[view.file].inside
    for other, condition in enumerate(problem.conditions):
        for like in condition.views if other != number else ():
            theirs = predictions[other].observables[like.file]
            if like.recording.view == view.recording.view and theirs.values.shape == T.shape:
                out[f"belongs to condition {other + 1}"] = misfit(
                    T - still, theirs.values - still, inside & theirs.inside
                )
    return out


def _copies(problem: Problem) -> dict[str, str]:
    """Recordings that hold the same values as one before: noise repeated is no second measurement."""
    out: dict[str, str] = {}
    seen: list[View] = []
    for view in problem.campaign.views:
        T = view.recording.temperature
        twin = next((v for v in seen if np.array_equal(v.recording.temperature, T, equal_nan=True)), None)
        if twin is not None and np.isfinite(T).any() and np.nanstd(T) > 0:
            out[view.file] = f"is the same as {twin.file}"
        seen.append(view)
    return out


def misfit(measured: npt.NDArray[Any], predicted: npt.NDArray[Any], inside: npt.NDArray[np.bool_]) -> float:
    """What a predicted rise leaves of a measured one, as much larger or smaller as friction may make it (rms, K)."""
    known = inside & np.isfinite(measured)
    if not known.any():
        return float("inf")
    own, rise = measured[known], predicted[known]
    factor = np.clip(own @ rise / max(float(rise @ rise), 1e-300), 1.0 / LIKELY, LIKELY)
    return float(np.sqrt(np.mean((own - factor * rise) ** 2)))


def with_views(problem: Problem, turned: Sequence[View]) -> Problem:
    """The problem with other images of some recordings."""
    by_file = {v.file: v for v in turned}

    def right(views: Sequence[View]) -> tuple[View, ...]:
        return tuple(by_file.get(v.file, v) for v in views)

    conditions = tuple(replace(c, views=right(c.views)) for c in problem.conditions)
    return replace(
        problem, conditions=conditions, campaign=replace(problem.campaign, views=right(problem.campaign.views))
    )


def without(
    problem: Problem, predictions: list[list[Prediction]], refused: dict[str, str]
) -> tuple[Problem, list[list[Prediction]]]:
    """The problem without some recordings, and its predictions without conditions of which nothing is left."""
    conditions = [replace(c, views=tuple(v for v in c.views if v.file not in refused)) for c in problem.conditions]
    kept = [i for i, c in enumerate(conditions) if c.entries]
    campaign = replace(problem.campaign, views=tuple(v for v in problem.campaign.views if v.file not in refused))
    left = replace(
        problem, campaign=campaign, conditions=tuple(conditions[i] for i in kept),
        pins=tuple(problem.pins[i] for i in kept),
    )  # fmt: skip
    return left, [[made[i] for i in kept] for made in predictions]
