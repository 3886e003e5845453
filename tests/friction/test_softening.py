"""Softening of filled rubber with strain: storage and loss apart (Kraus 1984), strain scale by scale, keys of a case."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.errors import BadInput
from flashtemp.model.build import find_theory
from flashtemp.model.case import load_case
from flashtemp.physics.friction import rheology, roughness_spectrum
from flashtemp.physics.friction.persson import PayneSoftening, PerssonTheory

ASPHALT = roughness_spectrum.READY_ROADS["asphalt A"]
A = rheology.READY_RUBBERS["A"]
LINEAR = PerssonTheory(A, ASPHALT)
WARM, P = 293.15, 1.5e5
APART = PayneSoftening(0.4, 0.05, 0.6, loss_peak=1.5)


class Complex:
    """A modulus that knows no frequency: E' and E'' in Pa."""

    reach = (0.0, np.inf)

    def __init__(self, storage: float, loss: float):
        self.E = storage + 1j * loss

    def __call__(self, omega):
        return self.E + 0.0 * np.asarray(omega)


def flat(storage: float, loss: float, payne: PayneSoftening | None = None) -> PerssonTheory:
    """Theory of rubber without dispersion, Poisson's ratio 1/2."""
    return PerssonTheory(rheology.Rubber(Complex(storage, loss), A.shift), ASPHALT, payne=payne)


def test_kraus_by_hand():
    """At a strain of e_c: half of the storage's fall, the peak of the loss; far below and above: the limits."""
    law = replace(APART, loss_rest=0.8)
    assert law(0.05) == pytest.approx(0.7)
    assert law.loss_factor(0.05) == pytest.approx(1.5)
    assert law(1e-12) == pytest.approx(1.0, abs=1e-9)
    assert law.loss_factor(1e-12) == pytest.approx(1.0, abs=1e-5)
    assert law(1e12) == pytest.approx(0.4, abs=1e-9)
    assert law.loss_factor(1e12) == pytest.approx(0.8, abs=1e-5)
    # x = 2: storage 0.4 + 0.6/5; loss of Kraus 1 + 2 (0.5) 2/5
    assert APART(0.05 * 2 ** (1 / 0.6)) == pytest.approx(0.52)
    assert APART.loss_factor(0.05 * 2 ** (1 / 0.6)) == pytest.approx(1.4)


def test_loss_of_kraus_is_largest_at_the_critical_strain():
    strain = np.geomspace(1e-4, 10.0, 2001)
    assert strain[np.argmax(APART.loss_factor(strain))] == pytest.approx(0.05, rel=0.01)


def test_small_strain_changes_nothing():
    """A critical strain far above that of every scale: friction and contact of the linear theory."""
    small = replace(LINEAR, payne=replace(APART, strain=1e10))(0.1, WARM, P)
    plain = LINEAR(0.1, WARM, P)
    assert small.viscous == pytest.approx(float(plain.viscous), rel=1e-5)
    assert small.area == pytest.approx(float(plain.area), rel=1e-5)


def test_large_strain_multiplies_storage_and_loss_apart():
    """A critical strain far below that of every scale: the linear theory of the moduli rest E' and loss_rest E''."""
    far = PayneSoftening(0.4, 1e-12, 0.6, loss_peak=1.0, loss_rest=0.7)
    soft, known = flat(2e7, 1e7, far)(0.1, WARM, P), flat(0.4 * 2e7, 0.7 * 1e7)(0.1, WARM, P)
    np.testing.assert_allclose(soft.G, known.G, rtol=1e-4)
    assert soft.viscous == pytest.approx(float(known.viscous), rel=1e-4)
    assert soft.area == pytest.approx(float(known.area), rel=1e-4)
    # the loss is 0.7, not 0.4 of what it was: friction tells them apart
    one_factor = flat(2e7, 1e7, PayneSoftening(0.4, 1e-12))(0.1, WARM, P)
    assert soft.viscous > 1.3 * one_factor.viscous


def test_loss_alone_changes_friction_in_proportion():
    """Storage kept, E'' small beside it: contact stays, friction takes the factor of the loss."""
    far = PayneSoftening(1.0, 1e-12, 0.6, loss_peak=0.8, loss_rest=0.5)
    plain, changed = flat(1e7, 1e4)(0.1, WARM, P), flat(1e7, 1e4, far)(0.1, WARM, P)
    assert changed.area == pytest.approx(float(plain.area), rel=1e-6)
    assert changed.viscous / plain.viscous == pytest.approx(0.5, rel=1e-4)


def test_the_same_law_for_both_is_one_factor():
    """loss_rest = rest and loss_peak = (1 + rest)/2 is the law of the storage: results of one factor on E."""
    one, both = (
        replace(LINEAR, payne=p)(0.1, WARM, P)
        for p in (PayneSoftening(0.4), PayneSoftening(0.4, loss_peak=0.7, loss_rest=0.4))
    )
    np.testing.assert_allclose(both.P, one.P, rtol=1e-6)
    assert both.viscous == pytest.approx(float(one.viscous), rel=1e-6)


def test_strain_of_a_scale_is_the_slope_up_to_it():
    """p/(P E*) of rubber without dispersion is sqrt(pi/8) times the rms slope of all longer waves."""
    found = flat(1e7, 0.0)(0.1, WARM, P)
    strain = P / (found.P * 1e7 / 0.75)
    slopes = np.array([ASPHALT.rms_slope(q) for q in found.q])
    touching = found.P < 0.03
    assert touching.sum() > 20
    np.testing.assert_allclose(strain[touching], (np.sqrt(np.pi / 8) * slopes)[touching], rtol=2e-3)


def test_longer_waves_soften_less():
    """The modulus at a wavenumber is that of the strain there, which rises with every scale that is added."""
    soft = flat(1e7, 0.0, PayneSoftening(0.4, 0.05))(0.1, WARM, P)
    linear = flat(1e7, 0.0)(0.1, WARM, P)
    factor = np.sqrt(np.gradient(soft.G, soft.q) / np.gradient(linear.G, linear.q))[2:-2]
    assert 0.9 < factor[0] < 1.0
    assert factor[-1] < 0.5
    assert np.all(np.diff(factor) < 1e-3)


def test_the_default_of_a_case_is_one_factor_and_the_keys_arrive(tmp_path):
    (tmp_path / "case.toml").write_text('effects = ["persson_friction"]\n')

    def payne(**given):
        return find_theory(load_case(tmp_path, {f"persson_friction.{k}": v for k, v in given.items()}))[
            1
        ].p.theory.payne

    assert payne() is None
    assert payne(payne_rest=0.4) == PayneSoftening(0.4, 0.05)
    assert payne(payne_rest=0.4, payne_loss_peak=1.2, payne_loss_rest=0.9) == PayneSoftening(0.4, 0.05, 0.6, 1.2, 0.9)
    assert payne(payne_loss_peak=1.2) is None
    acting = find_theory(load_case(tmp_path, {"persson_friction.payne_loss_peak": 1.2}))[1]
    assert any("payne_loss_peak has no effect" in line for line in acting.p.assumed)


def test_a_peak_below_its_flanks_is_refused(tmp_path, capsys):
    with pytest.raises(BadInput, match="payne_loss_peak: 0.9 is below 1"):
        PayneSoftening(loss_peak=0.9)
    (tmp_path / "case.toml").write_text('effects = ["persson_friction"]\n')
    words = ["persson_friction.payne_rest=0.4", "persson_friction.payne_loss_peak=0.6"]
    assert main(["check", str(tmp_path), *words]) == 2
    told = capsys.readouterr().err.strip()
    assert "persson_friction.payne_loss_peak (command line): 0.6 is below 1, the mean of 1" in told
    assert len(told.splitlines()) == 1
