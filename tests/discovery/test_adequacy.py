"""Adequacy tests of a fit, with data whose distribution is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from scipy.stats import chi2, kstest

from flashtemp.discovery.diagnostics.adequacy_tests import pressure_mode_chi2
from flashtemp.discovery.estimation.linear_gaussian import DataBlock, LinearSystem
from flashtemp.discovery.estimation.nuisance_priors import PRESSURE_MODE_SD
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
