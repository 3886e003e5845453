"""Counts and temperatures: formula, inverse, derivative, the air's single path, changed parameters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flashtemp.camera.radiometry import (
    LONG_WAVE,
    ObjectParameters,
    PlanckCalibration,
    apparent_counts,
    object_temperature,
    recompute_temperature,
)
from flashtemp.errors import BadInput

E60 = PlanckCalibration(14985.93, 0.011283217, 1398.1, 1.0, -6233.0)
SEEN = ObjectParameters(emissivity=0.95, reflected=20.0, air=20.0, humidity=0.5, distance=1.0)
T = np.linspace(-20.0, 250.0, 271)


@given(
    st.floats(-30, 300), st.floats(0.1, 1), st.floats(-20, 100), st.floats(0, 50), st.floats(0, 1), st.floats(0, 50),
    st.floats(0.3, 1),
)  # fmt: skip
def test_there_and_back(T, emissivity, reflected, air, humidity, distance, window):
    p = ObjectParameters(emissivity, reflected, air, humidity, distance, window, 25.0)
    assert object_temperature(apparent_counts(T, E60, p), E60, p) == pytest.approx(T, abs=1e-9)


def test_black_body_is_planck_alone():
    bare = ObjectParameters()
    assert apparent_counts(T, E60, bare) == pytest.approx(E60.counts(T), rel=1e-15)
    assert E60.counts(80.0) == pytest.approx(14985.93 / (0.011283217 * (np.exp(1398.1 / 353.15) - 1)) + 6233, rel=1e-14)


def test_derivative_by_complex_step():
    p = SEEN.with_values({"window": 0.8, "window_temperature": 40.0})
    step = apparent_counts(T + 1e-30j, E60, p).imag / 1e-30
    finite = (apparent_counts(T + 1e-3, E60, p) - apparent_counts(T - 1e-3, E60, p)) / 2e-3
    assert step == pytest.approx(finite, rel=1e-7)
    back = object_temperature(apparent_counts(T, E60, p) + 1e-30j, E60, p).imag / 1e-30
    assert back * step == pytest.approx(np.ones(len(T)), rel=1e-12)


@pytest.mark.parametrize(
    ("change", "errors"),
    [
        ({"emissivity": 0.93}, (0.39, 1.05, 1.63)),
        ({"reflected": 30.0}, (-0.46, -0.35, -0.28)),
        ({"reflected": 0.0}, (0.79, 0.60, 0.49)),
        ({"distance": 5.0}, (0.14, 0.37, 0.58)),
        ({"distance": 0.0}, (-0.11, -0.30, -0.46)),
    ],
    ids=str,
)
def test_what_a_wrong_parameter_does(change, errors):
    """Errors at 40, 80 and 120 degC that an independent computation found, to its 0.01 K."""
    at = np.array([40.0, 80.0, 120.0])
    read = object_temperature(apparent_counts(at, E60, SEEN), E60, SEEN.with_values(change))
    assert read - at == pytest.approx(errors, abs=0.006)


def test_air_is_one_path_not_two_halves():
    tau = SEEN.transmission
    water = np.sqrt(0.5 * np.exp(1.5587 + 0.06939 * 20 - 2.7816e-4 * 400 + 6.8455e-7 * 8000))
    direct = 1.9 * np.exp(-(0.006569 - 0.002276 * water)) - 0.9 * np.exp(-(0.01262 - 0.00667 * water))
    assert tau == pytest.approx(direct, rel=1e-12)
    assert abs(SEEN.with_values({"distance": 0.5}).transmission ** 2 - tau) > 1e-3
    assert ObjectParameters(distance=0.0).transmission == 1.0


def test_a_window_mixes_in_its_own_temperature():
    behind = SEEN.with_values({"window": 0.7, "window_temperature": 90.0})
    seen = apparent_counts(T, E60, behind)
    assert seen == pytest.approx(0.7 * apparent_counts(T, E60, SEEN) + 0.3 * E60.counts(90.0), rel=1e-14)


def test_radiance_is_averaged_not_degrees():
    half = E60.temperature(0.5 * (E60.counts(50.0) + E60.counts(150.0)))
    assert half == pytest.approx(106.3, abs=0.2)


def test_reapplied_parameters():
    old, new = SEEN, SEEN.with_values({"emissivity": 0.88, "reflected": 35.0})
    shown = object_temperature(apparent_counts(T, E60, new), E60, old)
    assert recompute_temperature(shown, old, new, E60) == pytest.approx(T, abs=1e-9)
    assert recompute_temperature(T, old, old) is T
    assert recompute_temperature(T[T > 20], old, new) == pytest.approx(
        T[T > 20] + 5, abs=15
    )  # the generic band is a few K off
    generic = recompute_temperature(shown, old, new, LONG_WAVE)
    assert np.abs(generic - T).max() < 0.25


def test_too_few_counts_are_no_temperature():
    assert np.isnan(object_temperature(np.array([0.0, 6000.0]), E60, SEEN)).all()
    assert np.isfinite(object_temperature(np.array([9000.0]), E60, SEEN)).all()


@pytest.mark.parametrize(
    "bad",
    [{"emissivity": 0.0}, {"emissivity": 1.2}, {"humidity": 50.0}, {"distance": -1.0}, {"window": float("nan")}],
    ids=str,
)
def test_parameters_that_cannot_be(bad):
    with pytest.raises(BadInput, match=next(iter(bad))) as fault:
        SEEN.with_values(bad)
    assert "give" in str(fault.value)


@pytest.mark.parametrize("bad", [(0.0, 1, 1400, 1, 0), (1.0, 1, -3, 1, 0), (1.0, 1, 1400, float("nan"), 0)])
def test_calibrations_that_cannot_be(bad):
    with pytest.raises(BadInput, match="planck"):
        PlanckCalibration(*bad)
