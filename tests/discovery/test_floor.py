"""The model discrepancy: smooth errors of a thousandth are no evidence, causes above them still are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference import laboratory
from reference.laboratory import MeasurementErrors, MeasurementProgramme

from flashtemp.camera.recording import Recording
from flashtemp.camera.recording import load as recording
from flashtemp.comparison import campaign
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.discovery.decision import EffectSize, VerdictEvidence, decide
from flashtemp.discovery.engine import discover
from flashtemp.discovery.estimation import model_discrepancy
from flashtemp.discovery.prediction.prediction import Observable

TRIED = ("friction_softening", "interface_resistance")
SMALL = MeasurementProgramme(0.4, wait=4.0, columns=50, mesh=0.5)


def seen(view, frames=6, nv=20, nu=30):
    """A recording of 20 K over 20 degC, the same everywhere, and its prediction."""
    T = np.full((frames, nv, nu), laboratory.AIR_DEGC + 20.0)
    made = Recording(
        view, T, np.arange(frames, dtype=float), 1 + np.arange(frames) // 3, np.linspace(0.0, 0.02, nu),
        np.linspace(0.0, 5e-3, nv), reflected_degC=laboratory.AIR_DEGC,
    )  # fmt: skip
    return RecordingEntry("a.nc", made), Observable(T, np.full((nv, nu), True), {})


@pytest.mark.parametrize("view", ["sidewall", "wake"])
def test_a_prior_of_one_size_is_an_error_of_that_size(view):
    """Monte Carlo of 400 draws: rms over a view relative to its rise, within what so many draws scatter."""
    columns = model_discrepancy.discrepancy_basis(*seen(view))
    C = np.stack([c.ravel() for c in columns.values()], axis=1) / 20.0
    rng = np.random.default_rng(3)
    drawn = C @ rng.normal(size=(C.shape[1], 400)) * model_discrepancy.LARGEST_DISCREPANCY
    assert np.sqrt(np.mean(drawn**2)) == pytest.approx(model_discrepancy.LARGEST_DISCREPANCY, rel=0.1)


def test_a_wake_has_one_smooth_error_across_its_width():
    columns = model_discrepancy.discrepancy_basis(*seen("wake"))
    assert all(p.index[1] == 0 for p in columns)


@pytest.mark.parametrize(("friction", "kind"), [(0.0, "none_needed"), (0.02, "named")])
def test_a_cause_that_only_the_load_cell_shows_is_seen(friction, kind):
    unseen = EffectSize(rise_fraction=5e-4, change_K=0.01, friction_fraction=friction)
    found = VerdictEvidence(
        is_converged=True, base_certainly_misfits=False, causes=("friction_softening",), ln_bayes=58.0,
        ln_bayes_discrepancy=50.0, heldout_gain=43.0, size=unseen,
    )  # fmt: skip
    assert decide(found).kind == kind


@pytest.fixture(scope="module")
def null(tmp_path_factory):
    """A laboratory without errors; the wake's frames at the start of a repetition are off by 30 mK of 4 K."""
    folder = tmp_path_factory.mktemp("null")
    laboratory.write_campaign(folder, {}, 1, MeasurementErrors(size=0.0), SMALL)
    for file in folder.glob("*wake.nc"):
        r = recording(file)
        off = 0.03 * np.linspace(1.0, 0.0, len(r.u)) * (np.abs(r.v) < 0.025)[:, None]
        first = np.array([k == 0 or r.repetition[k] != r.repetition[k - 1] for k in range(r.frames)])
        replace(r, temperature=r.temperature + off * first[:, None, None]).save(file)
    return folder


@pytest.mark.long
def test_a_smooth_error_of_thirty_millikelvin_is_no_cause(null):
    """Without the model discrepancy `friction_softening` is named with ln Bayes factors of 10 to 40."""
    found, _ = discover(replace(campaign.load(null), candidates=TRIED), workers=1)
    assert found.kind in ("none_needed", "weak"), str(found)


@pytest.mark.long
def test_a_cause_above_the_floor_is_named_and_its_interval_holds(tmp_path):
    laboratory.write_campaign(tmp_path, {"friction_softening": 0.006}, 7, MeasurementErrors(size=0.0), SMALL)
    found, _ = discover(replace(campaign.load(tmp_path), candidates=TRIED), workers=1)
    assert found.kind == "named", str(found)
    [cause] = found.causes
    low, high = cause.parameters[0].ci95
    assert cause.effect == "friction_softening"
    assert low < 0.006 < high
    assert found.gain["share"] > model_discrepancy.LEAST_DISCREPANCY
