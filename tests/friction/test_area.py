"""Area in contact over p/E, smooth surfaces with adhesion, the maximum of mu(v) over load (claims C2, C6, C8)."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import erf

from flashtemp.__main__ import main
from flashtemp.physics.friction import adhesion
from flashtemp.physics.friction.adhesive_shear import AdhesiveShear
from flashtemp.physics.friction.curve_peak import find_peak
from flashtemp.physics.friction.flash_temperature import ContactSpots, compute_branches
from flashtemp.physics.friction.persson import PerssonTheory
from flashtemp.physics.friction.rheology import READY_RUBBERS as RUBBERS
from flashtemp.physics.friction.roughness_spectrum import READY_ROADS as ROADS
from flashtemp.physics.friction.roughness_spectrum import self_affine_spectrum
from flashtemp.physics.material import LIBRARY

CASE = Path(__file__).parents[2] / "cases" / "slope_tester"


def test_area_over_pressure_is_told_and_drawn(tmp_path, capsys):
    """A/A0 = erf(sqrt2 p/(E* h')): linear to 2.5 % up to 30 % in contact, saturated at p/E of 1.4 for a slope of 1.3."""
    out = tmp_path / "found"
    assert main(["friction", str(CASE), "--area", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {f.name for f in out.iterdir()} == {"case.toml", "area.json", "area.csv", "area.png"}
    x = np.array(told["p_over_E"])
    exact = np.sqrt(2) * x * (1 - told["poisson"] ** 2) / told["rms_slope"]
    assert told["rms_slope"] == pytest.approx(1.3, rel=1e-6)
    np.testing.assert_allclose(told["area"], erf(exact), rtol=1e-6)
    np.testing.assert_allclose(told["linear"], 2 / np.sqrt(np.pi) * exact, rtol=1e-6)
    assert told["area_there"] == pytest.approx(0.30, abs=0.005)
    assert told["saturated_from_p_over_E"] == pytest.approx(1.163087 * 1.3 / (0.75 * np.sqrt(2)), rel=1e-3)
    assert told["at_p_over_E_0.1"]["linear_too_large_by"] < 0.005


def test_attraction_on_a_smooth_surface_lets_friction_rise_as_the_load_falls():
    """0.5 um, rms slope 0.03, 0.05 J/m2: mu = tau A/p rises fourfold from 0.3 to 0.02 MPa; without attraction 1 %."""
    road = replace(self_affine_spectrum(5e-7, 1e4, 0.8, 1e3, slope=None), q1=1e7)
    plain = PerssonTheory(RUBBERS["A"], road, shear=AdhesiveShear(2e5))
    p = np.array([2e4, 5e4, 1e5, 2e5, 3e5])
    held = replace(plain, enlarged=(adhesion.adhesion_enlargement(plain, 0.1, 293.15, 0.05, p, viscous=0.0),))
    mu, without = (theory(0.1, 293.15, p).mu for theory in (held, plain))
    print(mu, without)
    assert np.all(np.diff(mu) < 0)
    assert mu[0] > 4 * mu[-1]
    np.testing.assert_allclose(without, without[0], rtol=0.01)


@pytest.mark.parametrize(("fraction", "low", "high"), [(None, 0.0, 0.01), (0.06, -0.15, -0.06)])
def test_the_maximum_of_friction_over_load_on_asphalt(fraction, low, high):
    """C8, from 0.05 to 0.3 MPa at 20 degC: it falls through heat where the spots are fixed by the road, not otherwise."""
    theory = PerssonTheory(RUBBERS["A"], ROADS["asphalt A"], shear=AdhesiveShear(4e6))
    v, tops = np.geomspace(0.3, 30.0, 13), []
    for p in (5e4, 3e5):
        pair = compute_branches(theory, LIBRARY["tread_rubber"], ContactSpots(3e-3, fraction), v, 293.15, p)
        tops.append([find_peak(v, branch.mu).value for branch in pair])
    change = np.array(tops[1]) / np.array(tops[0]) - 1
    print(change)
    assert 0.0 < change[0] < 0.01
    assert low < change[1] < high
