"""Checks of an effect on the camera: finite values, and no change with all parameters off."""

from __future__ import annotations

import numpy as np

from flashtemp.camera.prediction.camera_model import CameraModel
from flashtemp.camera.recording import Recording
from flashtemp.errors import FlashtempError
from flashtemp.runs.checks.effect_check import suggestions
from flashtemp.runs.checks.effect_check.findings import Finding, make_finding
from flashtemp.runs.checks.effect_check.fixtures import EffectUnderTest, SceneCache, make_acting

NEUTRAL_WORDS = "with all parameters off it changes nothing"


def make_small_recording() -> Recording:
    """A recording of two frames of three pixels, in two repetitions."""
    return Recording(
        view="profile", temperature=np.full((2, 1, 3), 25.0), time=np.array([1.0, 40.0]),
        repetition=np.array([1, 2]), u=np.array([0.005, 0.0125, 0.02]), v=np.zeros(1),
    )  # fmt: skip


def check_camera_effect(bench: SceneCache, trial: EffectUnderTest) -> list[Finding]:
    """Findings on an effect that changes the camera image."""
    given = trial.own_values
    off = {k: p.off for k, p in trial.effect.params().items() if p.off is not None}
    try:
        on, rest = (_camera_values(make_acting(trial, given | v, bench.folder)) for v in ({}, off))
    except Exception as fault:
        if isinstance(fault, FlashtempError):
            raise
        return [Finding("laws", False, suggestions.explain_exception(trial.file, fault))]
    remaining = [f"{name} by {np.max(np.abs(v)):.2g}" for name, v in rest.items() if np.any(v != 0)]
    not_finite = [name for name, v in on.items() if not np.all(np.isfinite(v))]
    typo = [] if any(np.any(v != 0) for v in on.values()) else ["at its defaults it changes nothing; look for a typo"]
    infinite = [f"{name} is not finite; {suggestions.HOLD_REMEDY}" for name in not_finite]
    on_when_off = [f"with all parameters off it still changes {one}; a term must then be 0" for one in remaining]
    return [
        make_finding("laws", infinite, "every law returns numbers"),
        make_finding("off", on_when_off, NEUTRAL_WORDS),
        make_finding("acts", typo, f"at its defaults it changes {', '.join(on)}"),
    ]


def _camera_values(acting) -> dict[str, np.ndarray]:
    """The contribution of the effect to every camera quantity that it changes, for the small recording."""
    camera = CameraModel(make_small_recording(), (acting,))
    names = [part.target.removeprefix("camera.") for part in acting.effect.see(acting.p)]
    return {f"camera.{name}": np.asarray(camera(name, 0.0), dtype=float) for name in dict.fromkeys(names)}
