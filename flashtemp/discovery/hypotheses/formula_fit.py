"""Formulas for learned curves: the simplest family that fits the nodes of a law within their errors."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from flashtemp.discovery.hypotheses.piecewise_linear_law import DISCRETE_REGRESSORS, PiecewiseLinearLaw
from flashtemp.physics.arrays import Array
from flashtemp.physics.quantities import KELVIN

MIN_WIDTH_FRACTION = {"saturating": 0.02, "peak": 0.05}  # share of the range: families whose last number is a width
PROJECTION_POINTS = 400  # over the range, at which a line is fitted to a formula
MAX_RESIDUAL_SD = 1e9  # standard deviations: a trial step may go where nothing is finite
MIN_P_VALUE = 0.05  # of the misfit, below which a formula does not fit


@dataclass(frozen=True)
class FormulaFamily:
    """A family of curves: `curve(u, s, r, *numbers)` (n,) of the regressor u, its share s of the range, and its ratio r
    to the middle of the range.

    `template` is formatted with the numbers; `starts` for their fit; `applies` to which laws.
    """

    name: str
    template: str
    curve: Callable[..., Array]
    starts: tuple[tuple[float, ...], ...]
    applies: Callable[[PiecewiseLinearLaw], bool] = lambda law: law.period is None


@dataclass(frozen=True)
class FittedFormula:
    """A family with its `numbers`, written out in `text`: `chi2` of the misfit with `dof` degrees of freedom."""

    name: str
    text: str
    numbers: tuple[float, ...]
    chi2: float
    dof: int

    @property
    def is_adequate(self) -> bool:
        """Whether the misfit may be chance (chi-squared test at 5 %)."""
        return bool(self.dof > 0 and self.chi2 <= chi2.isf(MIN_P_VALUE, self.dof))


def _allows_power(law: PiecewiseLinearLaw) -> bool:
    """Whether a power may hold: from zero on, too, where the law itself may be zero there."""
    from_zero = law.nodes[0] == 0.0 and law.quantity.action != "factor" and len(law.nodes) > 2
    return (law.nodes[0] > 0.0 or from_zero) and law.regressor.unit != "degC" and law.period is None


def _power_law(u: Array, s: Array, r: Array, a: float, n: float) -> Array:
    return np.asarray(a * r ** (n if np.min(r) > 0.0 else max(n, 1e-3)))


def _limit_width(w: float, name: str) -> float:
    """The width in a family: positive, and no narrower than nodes can show."""
    return max(abs(w), MIN_WIDTH_FRACTION[name])


FORMULA_FAMILIES = (
    FormulaFamily("constant", "{0:.4g}", lambda u, s, r, a: a + 0.0 * s, ((1.0,),), lambda law: True),
    FormulaFamily(
        "linear", "{0:.4g} (1 + {1:.3g} s)", lambda u, s, r, a, b: a * (1.0 + b * s), ((1.0, 0.1), (1.0, -0.1)),
    ),
    FormulaFamily("power", "{0:.4g} r^{1:.3g}", _power_law, ((1.0, 0.3), (1.0, -0.3)), _allows_power),
    FormulaFamily(
        "exponential", "{0:.4g} exp({1:.3g} s)", lambda u, s, r, a, b: a * np.exp(b * s), ((1.0, 0.3), (1.0, -0.3)),
    ),
    FormulaFamily(
        "Arrhenius", "{0:.4g} exp({1:.3g} (T_m/T - 1)), T in K, T_m the mean of the nodes",
        lambda u, s, r, a, e: a * np.exp(e * ((np.mean(u) + KELVIN) / (u + KELVIN) - 1.0)),
        ((1.0, 1.0), (1.0, -1.0)), lambda law: law.regressor.unit == "degC",
    ),
    FormulaFamily(
        "saturating", "{0:.4g} (1 + {1:.3g} (1 - exp(-s/{2:.3g})))",
        lambda u, s, r, a, b, w: a * (1.0 + b * (1.0 - np.exp(-s / _limit_width(w, "saturating")))),
        ((1.0, 0.3, 0.3), (1.0, -0.3, 0.3)),
    ),
    FormulaFamily(
        "peak", "{0:.4g} (1 + {1:.3g} exp(-(s - {2:.3g})^2/(2 {3:.3g}^2)))",
        lambda u, s, r, a, h, m, w: a * (1.0 + h * np.exp(-0.5 * ((s - m) / _limit_width(w, "peak")) ** 2)),
        ((1.0, 0.3, 0.5, 0.25), (1.0, -0.3, 0.5, 0.25), (1.0, 0.3, 0.2, 0.25), (1.0, 0.3, 0.8, 0.25)),
    ),
    FormulaFamily(
        "harmonic", "{0:.4g} (1 + {1:.3g} cos(2 pi (s - {2:.3g})))",
        lambda u, s, r, a, b, m: a * (1.0 + b * np.cos(2.0 * np.pi * (s - m))),
        ((1.0, 0.3, 0.1), (1.0, 0.3, 0.4), (1.0, 0.3, 0.7)), lambda law: law.period is not None,
    ),
)  # fmt: skip


def fit_simplest_formula(law: PiecewiseLinearLaw, covariance: Array) -> FittedFormula | None:
    """The simplest formula that fits a law whose node values have a `covariance` (n, n), None where none does; of
    equally simple ones the one that fits best.

    A formula needs fewer numbers than the law has nodes.  The smallest adequate family is taken, not the lowest BIC:
    of so few nodes the penalty of BIC is too small, and noise would pass for a bend.
    """
    fitted = (
        _fit_family(f, law, covariance)
        for f in FORMULA_FAMILIES
        if f.applies(law) and len(f.starts[0]) < len(law.nodes)
    )
    return min((f for f in fitted if f.is_adequate), key=lambda f: (len(f.numbers), f.chi2), default=None)


def _fit_family(family: FormulaFamily, law: PiecewiseLinearLaw, covariance: Array) -> FittedFormula:
    """The numbers of a family that fit best, by Levenberg-Marquardt from each of its starts."""
    values, nodes = np.array(law.values), np.array(law.nodes)
    factor = law.quantity.action == "factor"
    size = 1.0 if factor else max(float(np.max(np.abs(values))), 1e-300)

    def curve(at: Array, numbers: Array) -> Array:
        low, high = law.domain
        out = size * family.curve(at, (at - low) / (high - low), at / _geometric_middle(law), *numbers)
        return np.log(np.maximum(out, 1e-9)) if factor else out

    def fit_numbers(covariance: Array, starts: Iterable[Array]) -> Any:
        sd = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
        white = np.linalg.cholesky(np.linalg.inv(covariance + np.diag((1e-3 * sd) ** 2))).T

        def residuals(numbers: Array) -> Array:
            with np.errstate(over="ignore", invalid="ignore"):
                out = white @ np.clip(values - curve(nodes, numbers), -MAX_RESIDUAL_SD, MAX_RESIDUAL_SD)
            return np.asarray(np.nan_to_num(out, nan=MAX_RESIDUAL_SD), float)

        ends = (least_squares(residuals, start, method="lm", max_nfev=120) for start in starts)
        return min(ends, key=lambda f: f.cost)

    best = fit_numbers(covariance, map(np.array, family.starts))
    # a fitted line lies above what bends up, between its nodes and at them: not by how much the law is wrong
    bias = _project_on_nodes(law, lambda at: curve(at, best.x)) - curve(nodes, best.x)
    best = fit_numbers(covariance + np.diag(bias**2), [best.x])
    numbers = [size * float(best.x[0]), *map(float, best.x[1:])]
    if family.name in MIN_WIDTH_FRACTION:
        numbers[-1] = _limit_width(numbers[-1], family.name)
    text, dof = family.template.format(*numbers), len(values) - len(numbers)
    return FittedFormula(family.name, text, tuple(numbers), 2.0 * float(best.cost), dof)


def _project_on_nodes(law: PiecewiseLinearLaw, curve: Callable[[Array], Array]) -> Array:
    """Values at the nodes of the piecewise linear function nearest to a curve, by least squares."""
    if law.regressor.name in DISCRETE_REGRESSORS:
        return curve(np.array(law.nodes))
    at = np.linspace(*law.domain, PROJECTION_POINTS)
    return np.asarray(np.linalg.lstsq(law.hat_functions(at), curve(at), rcond=None)[0])


def _geometric_middle(law: PiecewiseLinearLaw) -> float:
    """The geometric middle of the nodes of a regressor that is positive, or begins at zero; else 1."""
    above = [u for u in law.nodes if u > 0.0]
    return float(np.sqrt(above[0] * above[-1])) if law.nodes[0] >= 0.0 and above else 1.0


def variable_legend(law: PiecewiseLinearLaw) -> str:
    """The definitions of s and r in a formula."""
    (low, high), name = law.domain, law.regressor.name
    unit = "" if law.regressor.unit == "1" else f" {law.regressor.unit}"
    s = f"s = ({name} - {low:.4g}{unit})/{high - low:.4g}{unit}"
    return f"{s}, r = {name}/{_geometric_middle(law):.4g}{unit}" if _allows_power(law) else s
