"""A campaign made ready for fitting: conditions on meshes that stay, candidates, and what recordings do not state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flashtemp.camera.placement import Place
from flashtemp.comparison.campaign import Campaign, Condition, View
from flashtemp.comparison.compare import window
from flashtemp.comparison.screening import screen_campaign
from flashtemp.discovery.hypotheses.candidates import Candidate, Model, candidates, prior_sd_of_key
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.frame_averaging import average_frames
from flashtemp.discovery.prediction.prediction import Derivatives, Prediction, Task
from flashtemp.errors import BadInput, FlashtempError
from flashtemp.model import layers
from flashtemp.model.build import first_cells
from flashtemp.model.case import Case
from flashtemp.model.schema import refinement
from flashtemp.solver.circular_track import remembers

LEAST = 0.1  # of numerics.finer that a case may give
# rtol at most where road comes back: at 1e-3 another sequence of steps changed a wake's ln evidence by 70, at 1e-4 by 2
FINE = 1e-4
ASSUMED_CAMERA_VALUES = {"registration_sigma_px": 0.5, "psf_sigma_px": 0.7}  # px: of an image that does not say it

Run = Callable[[list[Task]], Sequence[Prediction | FlashtempError]]


@dataclass(frozen=True)
class Problem:
    """What does not change while a campaign is fitted.

    `pins` of the mesh per condition; `candidates` and `excluded_candidates` {effect: why it cannot be tried}; `run`
    maps `predict_condition` over tasks and gives failures as answers.  Images that were seen to lie far from where they
    are stated to begin at their `places` and `shifts`.  `assumed_camera_facts` {recording: which of
    ASSUMED_CAMERA_VALUES it does not state}.  `screening` {recording: which defects of its camera were found}.
    """

    campaign: Campaign
    conditions: tuple[Condition, ...]
    pins: tuple[dict[str, Any], ...]
    candidates: tuple[Candidate, ...]
    excluded_candidates: dict[str, str]
    run: Run
    case: Case
    places: dict[str, Place] = field(default_factory=dict)
    shifts: dict[str, tuple[float, float]] = field(default_factory=dict)
    assumed_camera_facts: dict[str, tuple[str, ...]] = field(default_factory=dict)
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
        return [raise_if_error(answer) for answer in self.run(tasks)]

    @property
    def priors(self) -> dict[ParameterId, float]:
        """Standard deviation of the ln of every free key."""
        stated = self.campaign.priors
        return {ParameterId.of_key(key): stated.get(key, prior_sd_of_key(key)) for key in self.campaign.free}

    @property
    def free(self) -> tuple[ParameterId, ...]:
        return tuple(map(ParameterId.of_key, self.campaign.free))

    @property
    def start(self) -> Model:
        """The case as it is believed."""
        return Model(dict.fromkeys(self.campaign.free, 0.0), shifts=self.shifts, places=self.places)


def raise_if_error(answer: Prediction | FlashtempError) -> Prediction:
    """The answer itself unless it is a failure, which is raised."""
    if isinstance(answer, FlashtempError):
        raise answer
    return answer


def prepare_problem(campaign: Campaign, run: Run) -> Problem:
    """Check a campaign for what fitting needs; long recordings are condensed.  Raises BadInput."""
    if campaign.entries and all(entry.held_out for entry in campaign.entries):
        raise BadInput("campaign: held_out = true of every recording and trace; leave at least one to be fitted")
    assumed = {v.file: missing for v in campaign.views if (missing := _unstated_facts(v))}
    campaign, screening = screen_campaign(campaign)
    campaign = average_frames(replace(campaign, views=tuple(map(_with_assumed_facts, campaign.views))))
    case = campaign.load({})
    for key in campaign.free:
        value = case[key]
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < float("inf"):
            raise BadInput(
                f"{campaign.case}: {key}: {value!r} cannot be freed; give a number > 0, or leave it out of free"
            )
        check_free_key(campaign, case, key)
    named = campaign.candidates if campaign.candidates is not None else case.candidates
    found, excluded = candidates(case, named)
    pins = tuple(_pins(campaign, c, found) for c in campaign.conditions)
    return Problem(
        campaign, campaign.conditions, pins, tuple(found), excluded, run, case, assumed_camera_facts=assumed,
        screening=screening,
    )  # fmt: skip


def _unstated_facts(view: View) -> tuple[str, ...]:
    """What an image does not say of its camera: nobody knows exactly where it lies, and no optics are sharp."""
    if view.recording.view not in ("sidewall", "wake"):
        return ()
    return tuple(name for name in ASSUMED_CAMERA_VALUES if getattr(view.recording, name) is None)


def _with_assumed_facts(view: View) -> View:
    """A view with what is usual for what it does not say."""
    usual: dict[str, Any] = {name: ASSUMED_CAMERA_VALUES[name] for name in _unstated_facts(view)}
    return replace(view, recording=replace(view.recording, **usual)) if usual else view


def check_free_key(campaign: Campaign, case: Case, key: str) -> None:
    """BadInput unless a key can move while mesh and schedule stay."""
    pins = first_cells(case.scene, case.values["numerics"])
    scene, moved = case.with_values(pins).scene, case.with_values(pins | {key: case[key] * 0.99}).scene
    same = all(np.array_equal(getattr(moved.mesh, k), getattr(scene.mesh, k)) for k in ("x", "height"))
    if not same or moved.schedule.end != scene.schedule.end:
        what = "schedule" if same else "mesh"
        raise BadInput(f"{campaign.case}: free: {key!r} changes the {what}; free a parameter of the physics instead")


def _pins(campaign: Campaign, condition: Condition, found: list[Candidate]) -> dict[str, Any]:
    """Overrides that give a condition one mesh, whatever is tried on it."""
    case = campaign.load(condition.given)
    others = [c.effect for c in found if not c.optical]
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


def replace_views(problem: Problem, turned: Sequence[View]) -> Problem:
    """The problem with other images of some recordings."""
    by_file = {v.file: v for v in turned}

    def right(views: Sequence[View]) -> tuple[View, ...]:
        return tuple(by_file.get(v.file, v) for v in views)

    conditions = tuple(replace(c, views=right(c.views)) for c in problem.conditions)
    return replace(
        problem, conditions=conditions, campaign=replace(problem.campaign, views=right(problem.campaign.views))
    )
