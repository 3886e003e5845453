"""Priors with a normal core and heavy tails, each represented by the normal distribution that touches it.

The prior of a deviation a with a usual size s is, up to a constant,

    p(a) = max over w >= s of (s/w)^k N(a; 0, w)

It is normal up to sqrt(1 + k) s, and its tails fall as 1/|a|^(1 + k).  The width w of largest density is
max(s, |a|/sqrt(1 + k)), and ln(p) is that of N(0, w) less the price k ln(w/s).  The integral of p is 1.26 at k = 1 and
1.03 at k = 3, which is neglected.

>>> round(local_width(0.1, 0.5, INPUT_TAIL), 3), round(width_price(0.25, 0.1, INPUT_TAIL), 2)
(0.25, 2.75)
"""

from __future__ import annotations

import math

# Strengths of effects: tails of a Cauchy distribution, so that a prior does not shrink a strong effect that the data
# determine well (Jeffreys, Theory of Probability, 1961, section 5.2).
STRENGTH_TAIL = 1.0
# Stated inputs: deviations between published measurements in units of their stated uncertainties follow Student's t
# distribution of a few degrees of freedom (Bailey, R. Soc. Open Sci. 4, 2017, 160600); tails as those with three.
INPUT_TAIL = 3.0
WIDE_PRIOR = 1e3  # usual sizes: a width at which the prior hardly acts, from which local widths are iterated
MAX_WIDTH_SWEEPS = 50  # iterations of widths, at most
WIDTH_TOLERANCE = 1.1  # ratio of widths at which iterations end: ln evidence is stationary there and changes by 0.02


def local_width(usual: float, deviation: float, tail: float) -> float:
    """Standard deviation of the normal distribution that touches the prior at a deviation, in its unit."""
    return max(abs(usual), abs(deviation) / math.sqrt(1.0 + tail))


def width_price(width: float, usual: float, tail: float) -> float:
    """What ln evidence loses where a prior of usual size has a local width."""
    return tail * math.log(width / abs(usual))
