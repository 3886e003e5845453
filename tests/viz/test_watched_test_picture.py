"""The picture of a running test shows the latest frame and the numbers of its history."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.live_evidence import (
    ComparedRecording,
    HypothesisEvidence,
    LiveAssessment,
    LiveDecision,
)
from flashtemp.discovery.watched_test import HistoryEntry
from flashtemp.viz import theme
from flashtemp.viz.measurement import watched_test

EFFECTS = {"tilt": 9.5, "wear": 1.0, "lag": -2.0}


def running_test(view: str, known: bool = True):
    """Two frames of 4 x 6 pixels and a history of two entries."""
    rows = 4 if view == "sidewall" else 1
    computed = 20.0 + np.arange(2.0 * rows * 6).reshape(2, rows, 6)
    residual = np.full(computed.shape, 0.5) if known else np.full(computed.shape, np.nan)
    r = Recording(
        view, computed + 0.5, np.array([1.0, 2.0]), np.array([1, 1]), 1e-3 * np.arange(6.0), 1e-3 * np.arange(rows)
    )
    compared = ComparedRecording(RecordingEntry("a.nc", r), computed, residual, 0.1 * residual)
    hypotheses = [HypothesisEvidence(e, v, 1.0, 1.0) for e, v in EFFECTS.items()]
    hypotheses.append(HypothesisEvidence("idle", 0.0, 0.0, 0.0, "has no effect"))
    decision = LiveDecision("tilt", 9.5, "wear", 8.5, True, "the data suffice: $tilt explains them")
    entry = HistoryEntry("2026-01-01T00:00:00+00:00", 1, "tilt", 1.0, False, dict.fromkeys(EFFECTS, 0.0), {"a.nc": 0.4})
    history = [entry, replace(entry, frames=2, ln_bayes=EFFECTS, rmse_K={"a.nc": 0.5})]
    assessment = LiveAssessment(tuple(hypotheses), decision, {"a.nc": compared})
    return SimpleNamespace(
        campaign=SimpleNamespace(title="run-in"), assessment=assessment, latest="a.nc", history=history
    )


def axes_of(fig, title):
    [ax] = [ax for ax in fig.axes if ax.get_title(loc="left") == title]
    return ax


def test_the_evidence_is_drawn_over_the_frames_with_its_limit():
    ax = axes_of(watched_test.draw(running_test("sidewall")), "evidence against the stated model")
    drawn = {line.get_label(): line for line in ax.lines}
    for name, value in EFFECTS.items():
        assert list(drawn[name].get_xdata()) == [1, 2]
        assert list(drawn[name].get_ydata()) == [0.0, value]
    assert "idle" not in drawn
    assert set(drawn["needed to name an effect"].get_ydata()) == {CRITERIA.ln_bayes_named}


def test_the_latest_frame_is_drawn_measured_computed_and_subtracted():
    test = running_test("sidewall")
    compared = test.assessment.recordings["a.nc"]
    fig = watched_test.draw(test)
    for title, values in (
        ("measured", compared.entry.recording.temperature[-1]),
        ("computed", compared.predicted[-1]),
        ("measured − computed", compared.residual[-1]),
    ):
        np.testing.assert_allclose(axes_of(fig, title).images[0].get_array().filled(np.nan), values)


@pytest.mark.parametrize("view", ["sidewall", "profile"])
@pytest.mark.parametrize("known", [True, False])
def test_a_frame_of_which_nothing_is_compared_is_drawn_too(view, known, tmp_path):
    path = theme.save_figure(watched_test.draw(running_test(view, known)), tmp_path / "watch.png")
    assert path.stat().st_size > 10_000
