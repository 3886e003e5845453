"""How wide an interval discovery states; which verdict it gives is in test_decision."""

from __future__ import annotations

from types import SimpleNamespace as N

import pytest

from flashtemp.discovery.diagnostics import fit_report
from flashtemp.discovery.parameters import ParameterId


def test_an_interval_is_95_percent_of_a_widened_error():
    p = ParameterId.of_effect("pressure_tilt", "a")
    known = {"pressure_tilt": N(params=lambda: {"a": N(low=-1.0, high=0.5, unit="1")})}

    class Solution(dict):
        names = (p,)

        def sd(self, name):
            return 0.1

    fit = N(solution=Solution({p: 0.05}), model=N(effect_value=lambda name: 0.3), bound=())
    found = fit_report._estimate_parameter(N(problem=N(case=N(known_effects=known))), fit, p)
    assert found.value == pytest.approx(0.35)
    assert found.stderr == pytest.approx(0.12)
    assert found.ci95 == pytest.approx((0.35 - 1.96 * 0.12, 0.5))  # no further than the parameter may go
