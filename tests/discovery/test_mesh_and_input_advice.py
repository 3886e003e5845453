"""What discovery advises beside a cause: a finer mesh across, and a case with a stated number corrected."""

from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.discovery.diagnostics import mesh_resolution
from flashtemp.discovery.diagnostics.extended_case import correct_input, describe_correction
from flashtemp.discovery.diagnostics.mesh_resolution import (
    mesh_resolution_warnings,
    unconverged_fit_warnings,
)
from flashtemp.discovery.estimation.linearised_fit import FitStatus
from flashtemp.discovery.estimation.model_discrepancy import LARGEST_DISCREPANCY
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.verdict import InputCorrection, Verdict
from flashtemp.model.case import load_case

WALL = "wall.nc"


def predicted(*directions, error_fraction):
    """Data and a prediction of a wall 10 K warm, of which the mesh errs by a fraction in each of some directions.

    One of two frames is compared.
    """
    rise = np.full((2, 2, 3), 10.0)
    rise[0, 0, 0] = 0.0
    inside = np.ones((2, 3), bool)
    known = np.array([[True] * 6, [False] * 6])
    column = error_fraction * np.sqrt(np.mean(rise[0] ** 2)) * np.ones((6, len(directions)))
    fixed = SimpleNamespace(names=tuple(ParameterId(ParameterKind.MESH, (k,)) for k in directions), F=column)
    case = {"numerics.mesh": 0.5, "numerics.across": 8, "numerics.first_y": 5e-4}
    data = SimpleNamespace(
        fixed={WALL: fixed}, is_compared={WALL: known}, problem=SimpleNamespace(case=case),
        to_kelvin=lambda file, whitened: np.stack([whitened, np.zeros(6)]),
    )  # fmt: skip
    observable = SimpleNamespace(values=rise, inside=inside)
    return data, [SimpleNamespace(observables={WALL: observable})]


@pytest.mark.parametrize(("times", "count"), [(1.2, 1), (0.8, 0)])
@pytest.mark.parametrize(
    ("directions", "key"),
    [((3,), "numerics.across = 8 with numerics.first_y = 0.0005"), ((0, 1), "numerics.mesh = 0.5")],
)
def test_a_mesh_that_errs_by_more_than_a_model_may_is_told(directions, key, times, count):
    data, predictions = predicted(*directions, error_fraction=times * LARGEST_DISCREPANCY / len(directions))
    lines = mesh_resolution_warnings(data, predictions)
    assert len(lines) == count
    for line in lines:
        assert line.startswith(f"{key} may be too coarse: its error is about ")
        assert WALL in line


@pytest.mark.parametrize(
    ("status", "deviation", "count"),
    [(FitStatus.BUDGET, 9.0, 1), (FitStatus.BUDGET, 7.0, 0), (FitStatus.CONVERGED, 9.0, 0), (FitStatus.OUTRUN, 9.0, 0)],
)
def test_a_mesh_that_keeps_a_fit_from_its_best_point_is_told(monkeypatch, status, deviation, count):
    found = {
        ParameterId(ParameterKind.MESH, (0,), condition=0): -deviation,
        ParameterId(ParameterKind.GAIN, file=WALL): 99.0,
    }
    monkeypatch.setattr(mesh_resolution, "normalised_deviations", lambda fit: found)
    fit = SimpleNamespace(status=status, is_comparable=status in (FitStatus.CONVERGED, FitStatus.STALLED))
    lines = unconverged_fit_warnings({frozenset({"track_memory"}): fit}, 0.5)
    assert len(lines) == count
    for line in lines:
        assert line.startswith("numerics.mesh = 0.5 may be too coarse: the fit of track_memory did not converge")
        assert line.endswith("try 1")


@pytest.mark.parametrize(
    ("key", "stated", "wanted", "unit"),
    [
        ("materials.asphalt.density", 2300.0, 2530.0, "kg/m3"),
        ("friction.mu", 0.8, 1.0, "1"),
        ("ambient.temperature", 20.0, 23.0, "degC"),
    ],
)
def test_the_extended_case_has_the_corrected_number_with_a_comment(tmp_path, key, stated, wanted, unit):
    (tmp_path / "case.toml").write_text("[friction]\nmu = 0.8\n[ambient]\ntemperature = 20.0\n")
    held = InputCorrection(key, stated, wanted, 0.01, unit, 30.0, "", {"contact.spot_fraction": 0.21})
    corrected = correct_input(load_case(tmp_path / "case.toml"), held)
    (tmp_path / "extended.toml").write_text(describe_correction(held) + corrected.toml())
    again = load_case(tmp_path / "extended.toml")
    own = load_case(tmp_path / "case.toml")
    table, name = key.rsplit(".", 1)
    before = own[key] if table in own.values else stated
    expected = before + wanted - stated if unit == "degC" else before * wanted / stated
    assert again[key] == pytest.approx(expected)
    assert again["contact.spot_fraction"] == pytest.approx(0.21)
    assert (tmp_path / "extended.toml").read_text().startswith(f"# {key} is corrected from {stated:g} to {wanted:g} +-")


@pytest.mark.parametrize(
    ("kind", "key", "extends"),
    [("held_key", "friction.mu", True), ("named", "friction.mu", False), ("held_key", "sidewall.emissivity", False)],
)
def test_a_number_is_corrected_where_it_alone_is_wrong_and_the_case_has_it(kind, key, extends):
    v = Verdict("a", kind, (), held_key=InputCorrection(key, 0.8, 1.0, 0.01, "1", 30.0, ""))
    assert v.has_extension == extends
    assert v.as_dict()["extended_case"] == ("extended.toml" if extends else None)
