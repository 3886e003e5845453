"""Side walls that lie far from where they are stated to lie, registered before the first fit.

A registered pose is another starting point of the same fit.  It replaces the stated one only where the recording by
itself is adequate there, and is not after an alignment from the stated pose: an image that is turned and scaled may
hide a part of a pressure peak or tilt, which then leaves misfit in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flashtemp.discovery.estimation.nuisance_priors import all_derivatives
from flashtemp.discovery.measurement_errors.image_pose import (
    STATED_POSE,
    ImagePose,
    is_far_from,
    register_image,
    with_poses,
)
from flashtemp.discovery.measurement_errors.recording_fit import (
    RecordingHypothesis,
    compare_fits,
    fit_at_pose,
)
from flashtemp.discovery.prediction.prediction import Prediction, PredictionTask
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.errors import FlashtempError


def register_images(problem: Problem, predictions: Sequence[Prediction]) -> Problem:
    """The problem with another starting pose for images whose data clearly require it.

    `predictions`: of the stated model, with all nuisances and fields.  They must be computed again if another problem
    is returned.
    """
    poses = {}
    tasks = problem.make_tasks(problem.stated_model, replace(all_derivatives(problem), fields=True))
    for number, (condition, prediction) in enumerate(zip(problem.conditions, predictions, strict=True)):
        for view in condition.views:
            hypothesis = RecordingHypothesis(view, number)
            if (pose := _registered_pose(problem, tasks[number], prediction, hypothesis)) is not None:
                poses[view.file] = pose
    return with_poses(problem, poses) if poses else problem


def _registered_pose(
    problem: Problem, task: PredictionTask, prediction: Prediction, hypothesis: RecordingHypothesis
) -> ImagePose | None:
    """The registered pose of an image if the evidence for it is clear; else None."""
    recording = hypothesis.view.recording
    pose = register_image(problem, recording, prediction.observables[hypothesis.file])
    if pose is None:
        return None
    try:
        registered = fit_at_pose(problem, task, prediction, hypothesis, pose)
        # an image that lies wrong leaves structure that looks like noise of lines
        stated = fit_at_pose(problem, task, prediction, hypothesis, STATED_POSE, registered.noise)
        if stated.is_adequate or (stated := stated.with_aligned_image()).is_adequate:
            return None
        registered = registered.with_aligned_image()
    except FlashtempError:  # in this pose the image shows no part of the block
        return None
    is_other = is_far_from(recording, problem.case["block.length"], registered.pose, stated.pose)
    is_clear = compare_fits(problem, [stated], [registered]).is_clear(1)
    return registered.pose if is_other and is_clear and registered.is_adequate else None
