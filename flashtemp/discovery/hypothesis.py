"""What may move: the believed case at a point, its nuisance parameters with priors, and the candidate effects."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.model import case as cases
from flashtemp.model.schema import declared
from flashtemp.physics.effect import Effect, catalogue

PRIORS = {  # relative standard deviation: how well a laboratory knows what it may calibrate
    "friction.mu": 0.1,
    "contact.spot_fraction": 0.1,
    "ambient.convection": 0.3,
}
OTHERWISE = 0.2
SHARE = 0.01  # of an effect's typical strength: the step of its trace


def prior(key: str) -> float:
    """Relative standard deviation of a free key."""
    return PRIORS.get(key, OTHERWISE)


@dataclass(frozen=True)
class Model:
    """The believed case at a point: `free` {key: ln of the factor}, `effects` beyond it {name: {parameter: value}}."""

    free: dict[str, float] = field(default_factory=dict)
    effects: dict[str, dict[str, float]] = field(default_factory=dict)

    def overrides(self, case: cases.Case) -> dict[str, Any]:
        """Keys of the case that this point changes; values are kept within their bounds."""
        out: dict[str, Any] = {}
        for key, factor in self.free.items():
            out[key] = _within(key, case[key] * math.exp(factor))
        if self.effects:
            out["effects"] = [*case.effects, *self.effects]
        for name, values in self.effects.items():
            out |= {f"{name}.{k}": _within(f"{name}.{k}", v) for k, v in values.items()}
        return out

    def moved(self, name: str, step: float) -> Model:
        """The same with one parameter moved: a free key, or "effect.parameter" of one of the effects."""
        if name in self.free:
            return Model(self.free | {name: self.free[name] + step}, self.effects)
        effect, k = name.split(".")
        return self.with_effect(effect, self.effects[effect] | {k: self.effects[effect][k] + step})

    def with_effect(self, effect: str, values: dict[str, float]) -> Model:
        """The same with an effect added or changed."""
        return Model(self.free, self.effects | {effect: values})


def _within(key: str, value: float) -> float:
    table, name = key.rsplit(".", 1)
    param = declared(table)[name]
    low = math.nextafter(param.low, math.inf) if param.open_low else param.low
    return float(min(max(value, low), param.high))


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing: `strengths` {parameter: typical change from off}, `shapes` {parameter: default}.

    `optical`: it acts in the camera only.  `variants` are values of the shapes from which a fit may start.
    """

    effect: str
    strengths: dict[str, float]
    shapes: dict[str, float]
    optical: bool

    @property
    def kind(self) -> type[Effect]:
        return catalogue()[self.effect]

    @property
    def variants(self) -> tuple[dict[str, float], ...]:
        """Defaults first, then every shape that may differ lower and higher by its spread."""
        out = [dict(self.shapes)]
        params = self.kind.params()
        for k, value in self.shapes.items():
            spread = params[k].spread
            if spread > 1.0:
                out += [self.shapes | {k: _within(f"{self.effect}.{k}", value * f)} for f in (1 / spread, spread)]
        return tuple(out)

    def off(self, variant: int = 0) -> dict[str, float]:
        """Values of all parameters with every strength off."""
        idle = {k: p.off for k, p in self.kind.params().items() if p.off is not None}
        return idle | self.variants[variant]

    def column(self, k: str, variant: int = 0) -> str:
        """Name of the trace of a strength."""
        return f"{self.effect}.{k}" + (f"@{variant}" if variant else "")

    def columns(self, variant: int = 0) -> list[str]:
        return [self.column(k, variant) for k in self.strengths]


def candidates(case: cases.Case, names: tuple[str, ...] | None) -> tuple[list[Candidate], dict[str, str]]:
    """Effects that may be missing in a case, and for each that cannot be tried the reason."""
    found, left = [], {}
    for name, effect in catalogue().items():
        if effect.base or (names is not None and name not in names):
            continue
        if name in case.effects:
            left[name] = "the case holds it already"
            continue
        if effect.detail:
            left[name] = "describes the same physics in more detail"
            continue
        if names is None and effect.alike:
            left[name] = f"looks like {effect.alike}, which is tried; name it in candidates to try it too"
            continue
        params = effect.params()
        plain = {k: p for k, p in params.items() if "number" in p.kinds and isinstance(p.value, (int, float))}
        needs = [k for k, p in params.items() if p.value is None and k not in plain]
        strengths = {
            k: float(p.value - p.off)
            for k, p in plain.items()
            if p.off is not None and math.isfinite(p.off) and math.isfinite(p.value) and p.value != p.off
        }
        shapes = {k: float(p.value) for k, p in plain.items() if p.off is None and not isinstance(p.value, bool)}
        optical = effect.heat is Effect.heat
        candidate = Candidate(name, strengths, shapes, optical)
        try:
            cases.load_with(case, {"effects": [*case.effects, name]})
        except BadInput as fault:
            left[name] = f"needs {', '.join(needs)}" if needs else fault.lines[0]
            continue
        if strengths:
            found.append(candidate)
    return found, left


def believed(path: Path, given: dict[str, Any], model: Model) -> cases.Case:
    """The case of one condition at a point."""
    return cases.load(path, given | model.overrides(cases.load(path, given)))
