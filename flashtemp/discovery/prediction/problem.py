"""A campaign prepared for fitting: conditions with fixed meshes, candidates, and assumed camera values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flashtemp.camera.image_placement import ImagePlacement
from flashtemp.comparison.campaign import Campaign, Condition, RecordingEntry
from flashtemp.comparison.compare import screen_campaign, view_overrides
from flashtemp.comparison.condition_remarks import require_fitted_entry
from flashtemp.discovery.hypotheses.candidates import CandidateEffect, ModelPoint, find_candidates, prior_sd_of_key
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.frame_averaging import average_frames
from flashtemp.discovery.prediction.mesh_extrapolation import coarser_mesh_keys
from flashtemp.discovery.prediction.prediction import DerivativeRequest, Prediction, PredictionTask
from flashtemp.errors import BadInput, FlashtempError
from flashtemp.model import layers
from flashtemp.model.build import first_cells
from flashtemp.model.case import Case
from flashtemp.model.schema import refinement_factor
from flashtemp.solver.circular_track import has_road_memory

# rtol at most where road comes back: at 1e-3 another sequence of steps changed a wake's ln evidence by 70, at 1e-4 by 2
MAX_REVISIT_RTOL = 1e-4
ASSUMED_CAMERA_VALUES = {"registration_sigma_px": 0.5, "psf_sigma_px": 0.7}  # px: of an image that does not state it

TaskRunner = Callable[[list[PredictionTask]], Sequence[Prediction | FlashtempError]]


@dataclass(frozen=True)
class Problem:
    """Everything that stays the same while a campaign is fitted.

    `mesh_overrides`: keys that fix the mesh of each condition.  `candidates`, and `excluded_candidates` {effect: why it
    cannot be tried}.  `run`: maps `predict_condition` over tasks and returns failures as answers.
    `placements` and `shifts`: starting values for images that are far from their stated positions.
    `assumed_camera_facts` {recording: names in ASSUMED_CAMERA_VALUES that it does not state}.
    `screening` {recording: camera defects that were found}.
    `freed_inputs`: stated inputs that the data contradict, so that they are among the free keys.
    """

    campaign: Campaign
    conditions: tuple[Condition, ...]
    mesh_overrides: tuple[dict[str, Any], ...]
    candidates: tuple[CandidateEffect, ...]
    excluded_candidates: dict[str, str]
    run: TaskRunner
    case: Case
    placements: dict[str, ImagePlacement] = field(default_factory=dict)
    shifts: dict[str, tuple[float, float]] = field(default_factory=dict)
    assumed_camera_facts: dict[str, tuple[str, ...]] = field(default_factory=dict)
    screening: dict[str, str] = field(default_factory=dict)
    freed_inputs: tuple[str, ...] = ()

    def make_tasks(
        self, model: ModelPoint, derivatives: DerivativeRequest, cell_factors: tuple[float, ...] | None = None
    ) -> list[PredictionTask]:
        """One task for each condition; `cell_factors` (3,) or (4,): on the cells along, up, down (and across)."""
        out = []
        for c, pins in zip(self.conditions, self.mesh_overrides, strict=True):
            if cell_factors:
                pins = pins | coarser_mesh_keys(self.case, *cell_factors)
            out.append(PredictionTask(self.case, c.given, pins, model, c.views, c.forces, derivatives))
        return out

    def predict(self, tasks: list[PredictionTask]) -> list[Prediction]:
        """Answers to tasks, in order; a failure among them is raised."""
        return [raise_if_error(answer) for answer in self.run(tasks)]

    @property
    def key_priors(self) -> dict[ParameterId, float]:
        """Standard deviation of the ln of every free key."""
        stated = self.campaign.priors
        return {ParameterId.of_key(key): stated.get(key, prior_sd_of_key(key)) for key in self.campaign.free}

    @property
    def free_keys(self) -> tuple[ParameterId, ...]:
        return tuple(map(ParameterId.of_key, self.campaign.free))

    @property
    def stated_model(self) -> ModelPoint:
        """The stated case, without any effect added."""
        return ModelPoint(dict.fromkeys(self.campaign.free, 0.0), shifts=self.shifts, placements=self.placements)


def raise_if_error(answer: Prediction | FlashtempError) -> Prediction:
    """The answer itself unless it is a failure, which is raised."""
    if isinstance(answer, FlashtempError):
        raise answer
    return answer


def prepare_problem(campaign: Campaign, run: TaskRunner) -> Problem:
    """Check a campaign and prepare it for fitting; frames of long recordings are averaged.  Raises BadInput."""
    require_fitted_entry(campaign)
    assumed = {v.file: missing for v in campaign.views if (missing := _unstated_facts(v))}
    campaign, screening = screen_campaign(campaign)
    campaign = average_frames(replace(campaign, views=tuple(map(assume_camera_facts, campaign.views))))
    case = campaign.load({})
    for key in campaign.free:
        value = case[key]
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < float("inf"):
            raise BadInput(
                f"{campaign.case}: {key}: {value!r} cannot be freed; give a number > 0, or leave it out of free"
            )
        check_free_key(campaign, case, key)
    named = campaign.candidates if campaign.candidates is not None else case.candidates
    stated = tuple(campaign.load(c.given) for c in campaign.conditions if c.given) or (case,)
    has_images = any(v.recording.places is None for v in campaign.views)
    found, excluded = find_candidates(case, named, stated, has_images)
    pins = tuple(pin_mesh(campaign, c, found) for c in campaign.conditions)
    return Problem(
        campaign, campaign.conditions, pins, tuple(found), excluded, run, case, assumed_camera_facts=assumed,
        screening=screening,
    )  # fmt: skip


def _unstated_facts(view: RecordingEntry) -> tuple[str, ...]:
    """Names of camera values that an image does not state: uncertainty of its position, and blur of the optics."""
    if view.recording.view not in ("sidewall", "wake"):
        return ()
    return tuple(name for name in ASSUMED_CAMERA_VALUES if getattr(view.recording, name) is None)


def assume_camera_facts(view: RecordingEntry) -> RecordingEntry:
    """A view with usual values for those that it does not state."""
    usual: dict[str, Any] = {name: ASSUMED_CAMERA_VALUES[name] for name in _unstated_facts(view)}
    return replace(view, recording=replace(view.recording, **usual)) if usual else view


def check_free_key(campaign: Campaign, case: Case, key: str) -> None:
    """Raise BadInput if changing a key would change the mesh or the schedule."""
    pins = first_cells(case.scene, case.values["numerics"])
    scene, moved = case.with_values(pins).scene, case.with_values(pins | {key: case[key] * 0.99}).scene
    same = all(np.array_equal(getattr(moved.mesh, k), getattr(scene.mesh, k)) for k in ("x", "height"))
    if not same or moved.schedule.end_time != scene.schedule.end_time:
        what = "schedule" if same else "mesh"
        raise BadInput(f"{campaign.case}: free: {key!r} changes the {what}; free a parameter of the physics instead")


def pin_mesh(campaign: Campaign, condition: Condition, tried: list[CandidateEffect]) -> dict[str, Any]:
    """Overrides that give a condition the same mesh under every hypothesis."""
    case = campaign.load(condition.given)
    others = [c.effect for c in tried if not c.is_optical]
    scenes = [case.scene, *(case.with_values({"effects": [*case.effects, other]}).scene for other in others)]
    meshes = [s.mesh for s in scenes]
    returns = len(case.scene.schedule.directions) > 1 or any(map(has_road_memory, scenes))
    refine = refinement_factor(case["numerics.mesh"]) * case["numerics.finer"][1]
    return (
        view_overrides(case, condition.views)
        | layers.layer_cells(case.scene, case.values["numerics"])
        | {
            "road.depth": float(max(m.depth[-1] for m in meshes)),
            "numerics.first_block": float(min(m.height[1] for m in meshes)) * refine,
            "numerics.first_road": first_cells(case.scene, case.values["numerics"])["numerics.first_road"],
        }
        | ({"numerics.rtol": min(MAX_REVISIT_RTOL, case["numerics.rtol"])} if returns else {})
    )


def replace_views(problem: Problem, changed: Sequence[RecordingEntry]) -> Problem:
    """The problem with the images of some recordings replaced."""
    by_file = {v.file: v for v in changed}

    def updated_views(views: Sequence[RecordingEntry]) -> tuple[RecordingEntry, ...]:
        return tuple(by_file.get(v.file, v) for v in views)

    conditions = tuple(replace(c, views=updated_views(c.views)) for c in problem.conditions)
    return replace(
        problem, conditions=conditions, campaign=replace(problem.campaign, views=updated_views(problem.campaign.views))
    )
