"""Trends of friction with temperature, speed and load, and how probable their signs are for uncertain inputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import ndtr

from flashtemp.errors import FlashtempError
from flashtemp.model.case import Case
from flashtemp.model.priors import UncertainInput
from flashtemp.model.scene import ActiveEffect
from flashtemp.physics.quantities import KELVIN
from flashtemp.runs.studies.load_dependence import MINIMAL_OUTPUT, compute_case_friction
from flashtemp.runs.studies.variance_decomposition import latin_hypercube

# mu at v (m/s), T (K) and p (Pa), with the contact at the same temperature as everything else
FrictionLaw = Callable[[float, float, float], float]
NEGLIGIBLE_LN_MU = 1e-3  # change of ln mu over a range below which friction does not depend on it
DEFAULT_WARMING_K, DEFAULT_RANGE_FACTOR = 40.0, 2.0  # K above ambient; factor around a single speed or load
UNENLARGED_KEYS = {"flattened": 1.0, "work_of_adhesion": 0.0}  # neutral values of the keys that enlarge the area
INPUT_RANGE_SD, TREND_DRAWS, BISECTION_STEPS = 1.96, 60, 8
# tables without influence on friction at given v, T and p
TABLES_WITHOUT_LAW = ("block", "road", "contact", "schedule", "ambient")


@dataclass(frozen=True)
class FrictionTrend:
    """Trend of friction `over` "T", "v" or "p" from `low` to `high`: `change` of ln mu, and `rise_probability`.

    `flips`: (input, value, unit, number of sd) at which one input alone reverses the sign, the nearest first.
    """

    over: str
    low: float
    high: float
    change: float
    rise_probability: float
    flips: tuple[tuple[str, float, str, float], ...]

    def as_dict(self) -> dict[str, Any]:
        return {
            "over": self.over, "from": self.low, "to": self.high, "change_ln_mu": self.change,
            "probability_rises": self.rise_probability, "probability_falls": 1.0 - self.rise_probability,
            "flips": [dict(zip(("key", "value", "unit", "sd_away"), f, strict=True)) for f in self.flips],
            "sentence": str(self),
        }  # fmt: skip

    def __str__(self) -> str:
        words, unit, digits = {
            "T": ("temperature", "degC", 3), "v": ("speed", "m/s", 3), "p": ("load", "MPa", 3),
        }[self.over]  # fmt: skip
        scale = 1e-6 if self.over == "p" else 1.0
        rise = self.change > 0
        span = f"{scale * self.low:.{digits}g} to {scale * self.high:.{digits}g} {unit}"
        trend = f"mu {'rises' if rise else 'falls'} with {words}, {100 * np.expm1(self.change):+.1f} % from {span}"
        other = 1.0 - self.rise_probability if rise else self.rise_probability
        if not self.flips:
            return f"{trend}; the sign has a probability of {100 * (1 - other):.0f} % for uncertain inputs"
        key, value, of, away = self.flips[0]
        more = ", ".join(k for k, *_ in self.flips[1:])
        return (
            f"{trend}, but the sign reverses within the uncertainty of {key}: from {value:.3g} {of}".rstrip(" 1")
            + f" ({away:+.1f} sd) on mu {'falls' if rise else 'rises'}"
            + (f" (also with {more})" if more else "")
            + f"; the opposite sign has a probability of {100 * other:.0f} %"
        )


def find_trends(
    case: Case, inputs: Sequence[UncertainInput], warmest: float | None = None
) -> tuple[FrictionTrend, ...]:
    """Trends over the ranges of a case, without quantities on which friction does not depend; `warmest` in degC.

    Temperature ranges from ambient to `warmest` (40 K above ambient when not given), speed and pressure over those of
    the schedule, or from half to double a constant one.
    """
    relevant = [
        i for i in inputs if i.key.split(".")[0] not in TABLES_WITHOUT_LAW and not i.key.startswith("materials.")
    ]
    laws: dict[tuple[tuple[str, float], ...], FrictionLaw] = {}

    def law_at(values: dict[str, float]) -> FrictionLaw:
        name = tuple(sorted(values.items()))
        if name not in laws:  # building a theory is slow, and all three trends use the same laws
            laws[name] = _friction_law(case, values)
        return laws[name]

    out = []
    for over, (low, high) in _trend_ranges(case, warmest).items():

        def log_change(values: dict[str, float], over=over, low=low, high=high) -> float:
            return _log_friction_change(case, law_at(values), over, low, high)

        try:
            trend = _assess_trend(over, low, high, relevant, log_change)
        except FlashtempError:
            continue
        if trend is not None:
            out.append(trend)
    return tuple(out)


def _assess_trend(over: str, low: float, high: float, inputs: list[UncertainInput], log_change) -> FrictionTrend | None:
    """The trend over one range: its sign, its probability, and where single inputs reverse it."""
    now = log_change({})
    ends = {
        i.key: [log_change({i.key: float(i.value_at(z))}) for z in (-INPUT_RANGE_SD, INPUT_RANGE_SD)] for i in inputs
    }
    if max([abs(now), *(abs(c) for both in ends.values() for c in both)]) < NEGLIGIBLE_LN_MU:
        return None
    matter = [i for i in inputs if max(abs(c - now) for c in ends[i.key]) > 0.02 * NEGLIGIBLE_LN_MU]
    sd = float(np.sqrt(sum(((ends[i.key][1] - ends[i.key][0]) / (2 * INPUT_RANGE_SD)) ** 2 for i in matter)))
    rises = float(ndtr(now / sd)) if sd > 0 else float(now > 0)
    if sd > 0 and 0.002 < rises < 0.998:  # otherwise no draw would have the opposite sign
        z = latin_hypercube(TREND_DRAWS, len(inputs))  # the same draws for all trends
        drawn = [log_change({i.key: float(i.value_at(v)) for i, v in zip(inputs, row, strict=True)}) for row in z]
        rises = float(np.mean(np.array(drawn) > 0))
    flips = []
    for i in matter:
        for edge, end in zip((-INPUT_RANGE_SD, INPUT_RANGE_SD), ends[i.key], strict=True):
            if end * now < 0:
                place = _find_sign_change(lambda z, i=i: log_change({i.key: float(i.value_at(z))}), edge, now)  # type: ignore[misc]
                flips.append((i.key, float(i.value_at(place)), i.unit, place))
    return FrictionTrend(over, low, high, now, rises, tuple(sorted(flips, key=lambda f: abs(f[3]))))


def _find_sign_change(log_change: Callable[[float], float], end: float, now: float) -> float:
    """The position between 0 and `end` at which the sign reverses, by bisection."""
    a, b = 0.0, end
    for _ in range(BISECTION_STEPS):
        middle = 0.5 * (a + b)
        a, b = (middle, b) if log_change(middle) * now > 0 else (a, middle)
    return b


def _trend_ranges(case: Case, warmest: float | None) -> dict[str, tuple[float, float]]:
    scene = case.scene
    T0 = scene.ambient - KELVIN
    out = {"T": (T0, max(warmest or 0.0, T0 + 1.0) if warmest is not None else T0 + DEFAULT_WARMING_K)}
    for over, series in (("v", scene.schedule.speed), ("p", scene.schedule.pressure)):
        low, high = series.range
        out[over] = (low, high) if high > low else (low / DEFAULT_RANGE_FACTOR, high * DEFAULT_RANGE_FACTOR)
    return out


def _log_friction_change(case: Case, law: FrictionLaw, over: str, low: float, high: float) -> float:
    """ln mu at the upper end minus ln mu at the lower end, with the other quantities as in the case."""
    scene = case.scene
    mean = {"v": float(np.sqrt(np.prod(scene.speeds))), "T": scene.ambient, "p": scene.load}
    ends = [mean | {over: x + KELVIN if over == "T" else x} for x in (low, high)]
    a, b = (law(e["v"], e["T"], e["p"]) for e in ends)
    return float(np.log(b / a)) if a > 0 and b > 0 else 0.0


def _friction_law(case: Case, values: dict[str, float]) -> FrictionLaw:
    """The friction law of a case with changed values: its theory, or else all its laws without heating."""
    for acting in case.scene.acting:
        if hasattr(acting.p, "theory") and acting.p.weight == 1:
            theory = _modified_theory(case, acting, values)
            return lambda v, T, p: float(theory(v, T, p).mu)
    other = case.with_values(values | MINIMAL_OUTPUT) if values else case
    return lambda v, T, p: compute_case_friction(
        other.with_values({"schedule.speed": v, "ambient.temperature": T - KELVIN, "contact.pressure": p}), True
    )


def _modified_theory(case: Case, acting: ActiveEffect, values: dict[str, float]) -> Any:
    """The theory with changed values of its keys.

    The area added by skewness and adhesion is reused unless its own keys change, because it is slow to compute.
    """
    changed = {k.removeprefix(f"{acting.name}."): v for k, v in values.items() if k.startswith(f"{acting.name}.")}
    if not changed:
        return acting.p.theory
    table = {k: case.values[acting.name][k] for k in acting.effect.params()} | changed
    kept = {k: off for k, off in UNENLARGED_KEYS.items() if k not in changed}
    theory = acting.effect.prepare(table | kept, case.folder)["theory"]
    return replace(theory, enlarged=acting.p.theory.enlarged) if len(kept) == len(UNENLARGED_KEYS) else theory
