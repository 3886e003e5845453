"""The rules by which discovery speaks, one by one: which verdict, and how wide an interval."""

from __future__ import annotations

from types import SimpleNamespace as N

import numpy as np
import pytest

from flashtemp.discovery import assessment
from flashtemp.discovery.assessment import HELD
from flashtemp.discovery.discover import _kind
from flashtemp.discovery.parameters import ParameterId


def assessed(*density: float, labels=()):
    return N(left_out=N(density=np.array(density), labels=labels))


CALM, SHUT = {"pulls": (1.0, 3.0)}, {"pulls": (4.0, 3.0)}
WORSE, BETTER = assessed(-10.0, -12.0), assessed(-5.0, -6.0)
UNLIKE, ALIKE, LIKE = (assessed(x, labels=(HELD,)) for x in (-15.0, -11.0, -5.0))  # of what is held out


@pytest.mark.parametrize(
    ("hinted", "gates", "alike", "base", "extended", "accepted", "kind"),
    [
        (False, CALM, (), BETTER, BETTER, False, "none_needed"),
        (True, CALM, (), BETTER, BETTER, False, "weak"),
        (False, CALM, ("a",), WORSE, BETTER, True, "named"),
        (False, CALM, ("a",), BETTER, WORSE, True, "weak"),
        (False, CALM, ("a",), assessed(-5.0), assessed(-9.0), True, "named"),  # one fold alone says nothing
        (False, CALM, ("a",), assessed(-10.0, labels=(HELD,)), LIKE, True, "named"),
        (False, CALM, ("a",), assessed(-10.0, labels=(HELD,)), ALIKE, True, "named"),  # it need not show the cause
        (False, CALM, ("a",), assessed(-10.0, labels=(HELD,)), UNLIKE, True, "weak"),  # but may not speak against it
        (False, CALM, ("a", "b"), WORSE, BETTER, True, "group"),
        (False, SHUT, ("a",), WORSE, BETTER, True, "unexplained"),
        (True, SHUT, (), WORSE, WORSE, False, "unexplained"),
    ],
)
def test_kind(hinted, gates, alike, base, extended, accepted, kind):
    assert _kind(hinted, gates, alike, base, extended, accepted) == kind


def test_an_interval_is_95_percent_of_a_widened_error():
    p = ParameterId.of_effect("pressure_tilt", "a")
    known = {"pressure_tilt": N(params=lambda: {"a": N(low=-1.0, high=0.5, unit="1")})}

    class Solution(dict):
        names = (p,)

        def sd(self, name):
            return 0.1

    fit = N(solution=Solution({p: 0.05}), model=N(value=lambda name: 0.3), bound=())
    found = assessment._estimate(N(problem=N(case=N(known=known))), fit, p)
    assert found.value == pytest.approx(0.35)
    assert found.stderr == pytest.approx(0.12)
    assert found.ci95 == pytest.approx((0.35 - 1.96 * 0.12, 0.5))  # no further than the parameter may go
