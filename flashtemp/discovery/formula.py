"""A formula for a learned curve, where one of a small family fits its nodes as well as the curve itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.stats import chi2

from flashtemp.discovery.unknown_law import GIVEN, Law
from flashtemp.physics.quantities import KELVIN

NARROWEST = {"saturating": 0.02, "peak": 0.05}  # forms whose last number is a width, and its least
FINE = 400  # places between the outermost nodes at which a line is held to a curve
FAR = 1e9  # of a law's values: no residual is larger
LIKELY = 0.05  # probability of so large a misfit, below which a formula does not fit
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Form:
    """One member of the family: `curve(s, *numbers)` (n,) of the share s of the argument's range or of `at` itself.

    `words` are formatted with the numbers; `starts` for the search.
    """

    name: str
    words: str
    curve: Callable[..., Array]
    starts: tuple[tuple[float, ...], ...]
    needs: Callable[[Law], bool] = lambda law: True


@dataclass(frozen=True)
class Formula:
    """A form with its `numbers`: in `words`, the misfit `chi2` of `free` degrees of freedom."""

    name: str
    words: str
    numbers: tuple[float, ...]
    chi2: float
    free: int

    @property
    def fits(self) -> bool:
        return bool(self.free > 0 and self.chi2 <= chi2.isf(LIKELY, self.free))


def _positive(law: Law) -> bool:
    """Whether a power may hold: from nothing on, too, where the law itself may be nothing there."""
    begins = law.nodes[0] == 0.0 and law.unknown.how != "factor" and len(law.nodes) > 2
    return (law.nodes[0] > 0.0 or begins) and law.argument.unit != "degC"


def _power(u: Array, s: Array, r: Array, a: float, n: float) -> Array:
    return np.asarray(a * r ** (n if np.min(r) > 0.0 else max(n, 1e-3)))


def _warm(law: Law) -> bool:
    return law.argument.unit == "degC"


def _wide(w: float, name: str) -> float:
    """The width of a form: positive, and no narrower than nodes can show."""
    return max(abs(w), NARROWEST[name])


# u: the argument; s: its share of the range; r: the argument over its middle
FORMS = (
    Form("constant", "{0:.4g}", lambda u, s, r, a: a + 0.0 * s, ((1.0,),)),
    Form("linear", "{0:.4g} (1 + {1:.3g} s)", lambda u, s, r, a, b: a * (1.0 + b * s), ((1.0, 0.1), (1.0, -0.1))),
    Form("power", "{0:.4g} r^{1:.3g}", _power, ((1.0, 0.3), (1.0, -0.3)), _positive),
    Form("exponential", "{0:.4g} exp({1:.3g} s)", lambda u, s, r, a, b: a * np.exp(b * s), ((1.0, 0.3), (1.0, -0.3))),
    Form(
        "Arrhenius", "{0:.4g} exp({1:.3g} (T_m/T - 1)), T in K, T_m the mean of the nodes",
        lambda u, s, r, a, e: a * np.exp(e * ((np.mean(u) + KELVIN) / (u + KELVIN) - 1.0)),
        ((1.0, 1.0), (1.0, -1.0)), _warm,
    ),
    Form(
        "saturating", "{0:.4g} (1 + {1:.3g} (1 - exp(-s/{2:.3g})))",
        lambda u, s, r, a, b, w: a * (1.0 + b * (1.0 - np.exp(-s / _wide(w, "saturating")))),
        ((1.0, 0.3, 0.3), (1.0, -0.3, 0.3)),
    ),
    Form(
        "peak", "{0:.4g} (1 + {1:.3g} exp(-(s - {2:.3g})^2/(2 {3:.3g}^2)))",
        lambda u, s, r, a, h, m, w: a * (1.0 + h * np.exp(-0.5 * ((s - m) / _wide(w, "peak")) ** 2)),
        ((1.0, 0.3, 0.5, 0.25), (1.0, -0.3, 0.5, 0.25), (1.0, 0.3, 0.2, 0.25), (1.0, 0.3, 0.8, 0.25)),
    ),
)  # fmt: skip


def formula(law: Law, covariance: Array) -> Formula | None:
    """The simplest form that fits a law whose node values have a `covariance` (n, n), None where none does; of equally
    simple ones the one that fits best.

    A form needs fewer numbers than the law has nodes.  So few nodes pay too little for a number by BIC: noise bends.
    """
    found = [f for form in FORMS if form.needs(law) and (f := _fitted(form, law, covariance)) is not None and f.fits]
    return min(found, key=lambda f: (len(f.numbers), f.chi2), default=None)


def _fitted(form: Form, law: Law, covariance: Array) -> Formula | None:
    count = len(form.starts[0])
    if count >= len(law.nodes):
        return None
    values = np.array(law.values)
    size = 1.0 if law.unknown.how == "factor" else max(float(np.max(np.abs(values))), 1e-300)

    def curve(at: Array, numbers: Array) -> Array:
        u0, u1 = law.nodes[0], law.nodes[-1]
        found = size * form.curve(at, (at - u0) / (u1 - u0), at / _middle(law), *numbers)
        return np.log(np.maximum(found, 1e-9)) if law.unknown.how == "factor" else found

    def fitted(covariance: Array, starts: Iterable[Array]) -> Any:
        sd = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
        white = np.linalg.cholesky(np.linalg.inv(covariance + np.diag((1e-3 * sd) ** 2))).T

        def left(numbers: Array) -> Array:
            with np.errstate(over="ignore", invalid="ignore"):  # a step may go where no number is so large
                off = white @ np.clip(values - curve(np.array(law.nodes), numbers), -FAR, FAR)
            return np.asarray(np.nan_to_num(off, nan=FAR), float)

        return min((least_squares(left, start, method="lm", max_nfev=120) for start in starts), key=lambda f: f.cost)

    best = fitted(covariance, map(np.array, form.starts))
    beside = _line(law, lambda at: curve(at, best.x)) - curve(np.array(law.nodes), best.x)
    best = fitted(covariance + np.diag(beside**2), [best.x])  # which line is nearest the data alone say
    numbers = [size * float(best.x[0]), *map(float, best.x[1:])]
    if form.name in NARROWEST:
        numbers[-1] = _wide(numbers[-1], form.name)
    return Formula(form.name, form.words.format(*numbers), tuple(numbers), 2.0 * float(best.cost), len(values) - count)


def _line(law: Law, curve: Callable[[Array], Array]) -> Array:
    """Values at the nodes of the line that is nearest to a curve: between its nodes a line is above what bends up."""
    if law.argument.name in GIVEN:
        return curve(np.array(law.nodes))
    at = np.linspace(law.nodes[0], law.nodes[-1], FINE)
    return np.asarray(np.linalg.lstsq(law.weights(at), curve(at), rcond=None)[0])


def _middle(law: Law) -> float:
    """Of an argument that is positive, or begins at nothing, the middle of the nodes in factors; else 1."""
    above = [u for u in law.nodes if u > 0.0]
    return float(np.sqrt(above[0] * above[-1])) if law.nodes[0] >= 0.0 and above else 1.0


def legend(law: Law) -> str:
    """What s and r of a formula are."""
    low, high, unit = law.nodes[0], law.nodes[-1], "" if law.argument.unit == "1" else f" {law.argument.unit}"
    s = f"s = ({law.argument.name} - {low:.4g}{unit})/{high - low:.4g}{unit}"
    return f"{s}, r = {law.argument.name}/{_middle(law):.4g}{unit}" if _positive(law) else s
