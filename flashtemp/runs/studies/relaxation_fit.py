"""Exponential relaxation to a final value over a distance: least squares with the exact profile likelihood.

Value = final + change g(s; s_w), where g is the mean of exp(-s/s_w) over the distance that a value is averaged over.
`final` and change follow from s_w by linear regression, so chi2 is a function of s_w alone and needs no initial guess.

>>> n = np.arange(6)
>>> fit = RelaxationFit(MeanRecord(n, n, 0.9 - 0.1 * np.exp(-n / 2.0)))
>>> round(fit.s_w, 6), round(fit.final, 6), round(fit.slid_distance(within=0.01), 3)
(2.0, 0.9, 4.816)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class MeanRecord:
    """Means `value` (n,) over the slid distance from `begin` to `end` (n,), which are equal for values at a point.

    `sigma`: standard errors (n,) or None; `length`: distance of one repetition or None, all distances in `unit`; `of`:
    the quantity.  `absolute`: changes are absolute and the final value is >= 0, otherwise they are relative to it.
    `expected`: s_w that the case of a simulation implies, m.
    """

    begin: np.ndarray
    end: np.ndarray
    value: np.ndarray
    sigma: np.ndarray | None = None
    length: float | None = None
    unit: str = "m"
    of: str = "friction"
    absolute: bool = False
    simulated: bool = False
    expected: float | None = None


def drop_first(record: MeanRecord, count: int) -> MeanRecord:
    """A record without its first `count` values."""
    sigma = None if record.sigma is None else record.sigma[count:]
    return replace(record, begin=record.begin[count:], end=record.end[count:], value=record.value[count:], sigma=sigma)


class RelaxationFit:
    """Weighted least squares of final + change g(s; s_w), with g the mean of exp(-s/s_w) over each interval.

    `final` and the change follow from s_w by linear regression, so the profile of chi2 over s_w is exact.
    """

    def __init__(self, record: MeanRecord):
        from scipy.optimize import minimize_scalar
        from scipy.stats import chi2

        self.record = record
        self.a, self.d = record.begin - record.begin[0], record.end - record.begin
        self.w = np.ones(len(self.a)) if record.sigma is None else record.sigma**-2.0
        y = record.value
        self.constant = float(self.w @ (y - self.w @ y / self.w.sum()) ** 2)
        self.noise = float(self.w.sum() * (8 * np.finfo(float).eps * np.abs(y).max()) ** 2)
        span = float(self.a[-1] + self.d[-1])
        step = float(np.min(np.diff(self.a + 0.5 * self.d)))
        self.grid = np.log(np.geomspace(step / 15, 1e3 * span, 600))  # from a step to a straight line
        chi = self.profile_chi2(self.grid)
        k = int(np.clip(np.argmin(chi), 1, len(chi) - 2))
        found = minimize_scalar(
            lambda u: float(self.profile_chi2(np.array([u]))[0]),
            bounds=(self.grid[k - 1], self.grid[k + 1]), method="bounded", options={"xatol": 1e-10},
        )  # fmt: skip
        self.u, self.s_w = float(found.x), math.exp(found.x)
        self.least = max(float(found.fun), self.noise)
        self.shape = self.relaxation_shapes(np.array([self.u]))[0]
        self.change, self.final = (float(v) for v in self.fit_linear_terms(self.shape)[:2])
        self.residual = y - self.final - self.change * self.shape
        self.free = len(y) - 3
        self.trusted = record.sigma is not None and self.least <= chi2.ppf(0.99, self.free)
        self.variance = 1.0 if self.trusted else self.least / self.free

    def relaxation_shapes(self, u: np.ndarray) -> np.ndarray:
        """g (m, n) for ln s_w (m,), with s from the beginning of the first interval."""
        s_w = np.exp(np.asarray(u))[:, None]
        h = self.d / s_w
        mean = np.where(h > 0, -np.expm1(-h) / np.where(h > 0, h, 1.0), 1.0)
        return np.exp(-self.a / s_w) * mean

    def fit_linear_terms(self, g: np.ndarray):
        """Change, final, chi2 and the weight of the change for shapes g (..., n)."""
        y, w = self.record.value, self.w / self.w.sum()
        centred = g - (g @ w)[..., None]
        weight = centred**2 @ self.w
        change = (centred * (y - w @ y)) @ self.w / weight
        final = w @ y - change * (g @ w)
        if self.record.absolute:  # a negative final value is replaced by 0, and the change fitted again
            weight = np.where(final < 0, g**2 @ self.w, weight)
            change = np.where(final < 0, (g * y) @ self.w / weight, change)
            final = np.maximum(final, 0.0)
        residual = y - final[..., None] - change[..., None] * g
        return change, final, residual**2 @ self.w, weight

    def profile_chi2(self, u: np.ndarray) -> np.ndarray:
        """chi2 (m,) for ln s_w (m,)."""
        return self.fit_linear_terms(self.relaxation_shapes(u))[2]

    def chi2_limit(self, level: float, fixed_parameters: int = 1) -> float:
        """chi2 that the true values of `fixed_parameters` parameters exceed with probability 1 - level."""
        from scipy.stats import chi2, f

        increase = (
            chi2.ppf(level, fixed_parameters)
            if self.trusted
            else fixed_parameters * f.ppf(level, fixed_parameters, self.free)
        )
        return self.least + self.variance * float(increase)

    @property
    def scatter(self) -> float:
        """Standard deviation of one value: from sigma if consistent with the data, otherwise from the residuals."""
        return math.sqrt(self.variance / float(np.mean(self.w)))

    def s_w_interval(self, limit: float) -> tuple[float, float]:
        """The interval of s_w with chi2 below `limit`; 0 or inf where the data give no bound."""
        from scipy.optimize import brentq

        def excess_chi2(u):
            return float(self.profile_chi2(np.array([u]))[0]) - limit

        fits = self.profile_chi2(self.grid) <= limit
        below, above = self.grid[fits & (self.grid <= self.u)], self.grid[fits & (self.grid >= self.u)]
        bottom, top = min([self.u, *below]), max([self.u, *above])
        under, over = self.grid[self.grid < bottom], self.grid[self.grid > top]
        low = math.exp(brentq(excess_chi2, under[-1], bottom, xtol=1e-12)) if len(under) else 0.0
        high = math.exp(brentq(excess_chi2, top, over[0], xtol=1e-12)) if len(over) else math.inf
        return low, high

    @property
    def start(self) -> float:
        """Value at s = 0."""
        return self.final + self.change * math.exp(min(700.0, self.record.begin[0] / self.s_w))

    @property
    def s_w_error(self) -> float:
        """Standard error of s_w by the linearised fit."""
        h = 1e-5
        up, down = self.relaxation_shapes(np.array([self.u + h, self.u - h]))
        slope = self.change * (up - down) / (2 * h)
        columns = [slope, self.shape, np.ones_like(slope)][: 2 if self.final == 0 else 3]
        J = np.stack(columns, axis=1) * np.sqrt(self.w)[:, None]
        scale = np.linalg.norm(J, axis=0)
        return self.s_w * math.sqrt(np.linalg.inv((J / scale).T @ (J / scale))[0, 0] * self.variance) / scale[0]

    def _distance_until(self, s_w, ratio, within: float):
        """Slid distance at which a change `ratio` at the first interval has decayed to `within`, at least 0."""
        with np.errstate(divide="ignore"):
            return np.maximum(0.0, self.record.begin[0] + s_w * np.log(np.abs(ratio) / within))

    def slid_distance(self, within: float) -> float:
        """Distance after which the remaining change is below `within`."""
        scale = 1.0 if self.record.absolute else self.final or 1e-300
        return float(self._distance_until(self.s_w, self.change / scale, within))

    def slid_distance_interval(self, within: float, limit: float) -> tuple[float, float]:
        """Range of that distance over all fits with chi2 below `limit`; s_w must have an upper bound."""
        interval = self.s_w_interval(limit)
        low = max(interval[0], math.exp(self.grid[0]))
        u = np.append(np.linspace(math.log(low), math.log(interval[1]), 1001), self.u)
        g, s_w = self.relaxation_shapes(u), np.exp(u)
        change, _, chi, weight = self.fit_linear_terms(g)
        if self.record.absolute:
            wide = np.sqrt(np.maximum(limit - chi, 0.0) / weight)
            ends = np.stack([change - wide, change + wide])
        else:
            ends = self._ratio_limits(g, limit)
        crosses = ends[0] * ends[1] <= 0
        reach = self._distance_until(s_w, ends, within)
        shortest = np.where(crosses, 0.0, reach.min(axis=0)).min()
        return float(shortest), float(reach.max())

    def _ratio_limits(self, g: np.ndarray, limit: float) -> np.ndarray:
        """Limits (2, m) of the ratio change/final with chi2 <= limit (Fieller), with y = final (1 + ratio g)."""
        y, w = self.record.value, self.w
        room = w @ y**2 - limit
        y1, yg = w @ y, g @ (w * y)
        # (y.u)^2 >= (y.y - limit) u.u with u = 1 + ratio g, a quadratic in the ratio
        a = yg**2 - room * (g**2 @ w)
        b = y1 * yg - room * (g @ w)
        c = y1**2 - room * w.sum()
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(-b - root) / a, (-b + root) / a])
        return np.where(a < 0, ends, np.array([[-np.inf], [np.inf]]))
