"""Adequacy tests of a fit, with data whose distribution is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.adequacy_tests import largest_misfit, pressure_mode_chi2
from flashtemp.discovery.diagnostics.friction_differences import find_friction_differences
from flashtemp.discovery.estimation.linear_gaussian import DataBlock, LinearSystem, Solution
from flashtemp.discovery.estimation.nuisance_priors import NUISANCE_SD, PRESSURE_MODE_SD
from flashtemp.discovery.parameters import ParameterId, ParameterKind

MODES = [ParameterId(ParameterKind.MODE, (n,)) for n in range(1, 7)]
KEY = ParameterId.of_key("friction.mu")
SD = np.array([PRESSURE_MODE_SD / p.index[0] for p in MODES])
WIDENED = 10.0  # a fit that lacks something widens the priors of all pressure shapes


def fit_of(rng, size, seen):
    """A fit of 60 data to modes of `size` nominal widths, which the data show `seen` times better than the prior."""
    C = rng.normal(size=(60, 7)) * np.append(seen / SD, 30.0) / np.sqrt(60)
    r = C @ np.append(size * SD * rng.normal(size=6), 0.05 * rng.normal()) + rng.normal(size=60)
    names = tuple((p, k) for k, p in enumerate([*MODES, KEY]))
    empty = np.empty((60, 0), np.float32)
    system = LinearSystem([DataBlock("a", 0, False, r, C.astype(np.float32), names, empty, np.empty((0, 0)))])
    priors = {p: (0.0, WIDENED * sd) for p, sd in zip(MODES, SD, strict=True)} | {KEY: (0.0, 0.05)}
    equations = system.normal_equations()
    return SimpleNamespace(
        system=system, free_priors=priors, equations=equations, solution=system.solve(priors, equations)
    )


def test_pressure_that_is_as_usual_gives_chi2_of_six_degrees_of_freedom():
    """Whether the data show the modes ten times better than they are known beforehand, or ten times worse."""
    rng = np.random.default_rng(5)
    for seen in (10.0, 1.0, 0.1):
        found = [pressure_mode_chi2(fit_of(rng, 1.0, seen)) for _ in range(400)]
        assert kstest(found, chi2(6).cdf).pvalue > 1e-3, seen


def test_pressure_of_another_shape_is_noticed_where_the_data_show_it():
    rng = np.random.default_rng(6)
    clear = [pressure_mode_chi2(fit_of(rng, 20.0, 10.0)) for _ in range(50)]
    hidden = [pressure_mode_chi2(fit_of(rng, 20.0, 0.01)) for _ in range(50)]
    assert min(clear) > 100.0
    assert np.mean(hidden) < 9.0


def test_the_test_of_noise_says_which_recording_fails_it():
    blocks = [SimpleNamespace(label=label, count=800, held_out=False) for label in ("quiet.nc", "loud.nc")]
    system = SimpleNamespace(block_chi2=lambda solution: [800.0, 2.25 * 800.0])
    fit = SimpleNamespace(blocks=blocks, system=system, solution=None)
    worst = largest_misfit(fit, fit, CRITERIA)
    assert (worst.label, worst.chi2) == ("loud.nc", 2.25)
    assert worst.limit == pytest.approx(1.0 + np.hypot(4.0 * 0.05, 0.2))  # chance, and noise known to 5 %
    assert worst.misfit_words.startswith("the residuals of loud.nc are 1.5 times its noise")


# --- friction of conditions and repetitions ---------------------------------------------------------------------
def with_friction(kind, values, errors):
    """A fit with friction of as many conditions, or repetitions of the second condition."""
    is_level = kind is ParameterKind.LEVEL
    names = [ParameterId(kind, condition=k) if is_level else ParameterId(kind, (k + 1,), condition=1)
             for k in range(len(values))]  # fmt: skip
    return SimpleNamespace(solution=Solution(tuple(names), np.array(values), np.diag(np.square(errors)), 0.0, 0.0, 100))


def test_friction_that_differs_between_conditions_is_reported():
    """A load that is 10 % more than stated: -4.2 % and +4.1 % are both near the prior of 2 %, their difference not."""
    [found] = find_friction_differences(with_friction(ParameterKind.LEVEL, (-0.042, 0.041), (0.002, 0.002)))
    assert (found.higher, found.lower, found.is_between_conditions) == ("condition 2", "condition 1", True)
    assert (found.value, found.stderr) == (pytest.approx(0.083), pytest.approx(0.002 * np.sqrt(2.0)))


@pytest.mark.parametrize(
    ("values", "errors"),
    [
        ((-0.025, 0.025), (0.002, 0.002)),  # 5 %: scatter of 2 % in each gives up to 5.5 %
        ((-0.042, 0.041), (0.02, 0.02)),  # without a load cell, heat alone hardly tells
        ((-0.03, 0.0, 0.01, 0.03), (0.002,) * 4),  # the range of four is larger than the difference of two
        ((0.05,), (0.002,)),
    ],
)
def test_friction_within_scatter_or_its_error_is_not_reported(values, errors):
    assert find_friction_differences(with_friction(ParameterKind.LEVEL, values, errors)) == ()


def test_scatter_alone_is_reported_in_one_of_twenty_tests():
    rng = np.random.default_rng(4)
    for kind, count in ((ParameterKind.LEVEL, 2), (ParameterKind.LEVEL, 6), (ParameterKind.SCATTER, 4)):
        tests = NUISANCE_SD[kind] * rng.normal(size=(600, count))
        found = [find_friction_differences(with_friction(kind, t, [1e-4] * count)) for t in tests]
        assert np.mean([bool(f) for f in found]) == pytest.approx(0.05, abs=0.03)


def test_friction_of_repetitions_is_compared_within_a_condition():
    [found] = find_friction_differences(with_friction(ParameterKind.SCATTER, (-0.03, 0.0, 0.04), (0.002,) * 3))
    assert (found.higher, found.lower) == ("repetition 3 of condition 2", "repetition 1 of condition 2")
    assert not found.is_between_conditions
