"""The stated case at a point of its parameters, and the candidate effects that it may lack."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flashtemp.camera.image_placement import STATED_PLACEMENT, ImagePlacement
from flashtemp.discovery.hypotheses.heavy_tails import STRENGTH_TAIL, local_width
from flashtemp.discovery.parameters import BEAD_KINDS, PLACEMENT_KINDS, ParameterId, ParameterKind, Priors
from flashtemp.errors import BadInput
from flashtemp.model.case import Case
from flashtemp.physics.effect import Deposit, Effect, Param

KEY_PRIOR_SD = {  # relative prior standard deviation of keys that are usually calibrated
    "friction.mu": 0.1,
    "contact.spot_fraction": 0.1,
    "ambient.convection": 0.3,
}
DEFAULT_KEY_PRIOR_SD = 0.2
NEEDS_OTHER_MESH = "refines the mesh along the road; add it to the effects of the case instead"
NOTHING_SLIDES = "nothing slides: the block is by itself"
# prefixes of quantities that matter in contact with the road only
CONTACT_TARGETS = ("friction.", "contact.", "holder.", "road.lane", "block.abrasion", "block.worn", "block.expansion")
STRENGTH_STEP_FRACTION = 0.01  # of an effect's typical strength: the step of its derivative


def prior_sd_of_key(key: str) -> float:
    """Relative standard deviation of a free key."""
    return KEY_PRIOR_SD.get(key, DEFAULT_KEY_PRIOR_SD)


def parameter_spec(case: Case, key: str) -> Param:
    """What is declared of a key of a case."""
    table, name = key.rsplit(".", 1)
    return case.declared_params(table)[name]


def clip_to_bounds(param: Param, value: float) -> float:
    """A value kept within the bounds of its parameter."""
    low = math.nextafter(param.low, math.inf) if param.open_low else param.low
    return float(min(max(value, low), param.high))


@dataclass(frozen=True)
class ModelPoint:
    """The stated case at a point of its parameters.

    `free` {key: ln of the factor on its value}.  `effects` {name: {parameter: value}}: those added to the case.
    `shifts` {file: (u, v)} px and `placements` {file: scale, rotation and clock} of images.  `bead_offsets`: offsets of
    points along an axis (m) and of their time constants (s).  `sizes` {key: relative error of the stated block size}.
    """

    free: dict[str, float] = field(default_factory=dict)
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    shifts: dict[str, tuple[float, float]] = field(default_factory=dict)
    placements: dict[str, ImagePlacement] = field(default_factory=dict)
    bead_offsets: dict[ParameterId, float] = field(default_factory=dict)
    sizes: dict[str, float] = field(default_factory=dict)

    def apply_to(self, case: Case) -> Case:
        """The case at this point.  Raises BadInput."""
        ruler = {key: case[key] * (1.0 + share) for key, share in self.sizes.items()}
        return case.with_values(self.case_overrides(case) | ruler)

    def case_overrides(self, case: Case) -> dict[str, Any]:
        """Keys of the case that this point changes; values are kept within their bounds."""
        out: dict[str, Any] = {}
        for key, factor in self.free.items():
            out[key] = clip_to_bounds(parameter_spec(case, key), case[key] * math.exp(factor))
        if self.effects:
            out["effects"] = [*case.effects, *self.effects]
        for name, values in self.effects.items():
            params = case.known_effects[name].params()
            out |= {f"{name}.{k}": clip_to_bounds(params[k], v) for k, v in values.items()}
        return out

    def effect_value(self, p: ParameterId) -> float:
        """The value of an effect parameter."""
        return self.effects[p.effect][p.name]

    def image_shift(self, file: str) -> tuple[float, float]:
        """The shift (px along u and v) of the image of a recording."""
        return self.shifts.get(file, (0.0, 0.0))

    def image_placement(self, file: str) -> ImagePlacement:
        """Scale, turn and clock of a recording."""
        return self.placements.get(file, STATED_PLACEMENT)

    def setup_value(self, p: ParameterId) -> float:
        """The value of scale, rotation or clock of a recording, or of a block size; 0 for other kinds."""
        if p.kind is ParameterKind.SIZE:
            return self.sizes.get(p.name, 0.0)
        return (
            float(getattr(self.image_placement(p.file), p.kind.value)) if p.kind in PLACEMENT_KINDS and p.file else 0.0
        )

    def with_step(self, p: ParameterId, step: float) -> ModelPoint:
        """The point with a step of a free key, of an image placement, of a block size or of an effect parameter."""
        if p.kind in BEAD_KINDS:
            return replace(self, bead_offsets=self.bead_offsets | {p: self.bead_offsets.get(p, 0.0) + step})
        if p.kind is ParameterKind.SIZE:
            return replace(self, sizes=self.sizes | {p.name: self.setup_value(p) + step})
        if p.kind in PLACEMENT_KINDS:
            there = replace(self.image_placement(p.file), **{p.kind.value: self.setup_value(p) + step})
            return replace(self, placements=self.placements | {p.file: there})
        if p.kind is ParameterKind.KEY:
            return replace(self, free=self.free | {p.name: self.free.get(p.name, 0.0) + step})
        return self.with_effect(p.effect, self.effects[p.effect] | {p.name: self.effect_value(p) + step})

    def with_effect(self, effect: str, values: dict[str, float]) -> ModelPoint:
        """The point with an effect added or its values replaced."""
        return replace(self, effects=self.effects | {effect: values})


@dataclass(frozen=True)
class CandidateEffect:
    """An effect that may be missing: `strengths` {parameter: typical change from its neutral value} and `shapes`
    {parameter: default}.

    `params` are its declarations; `is_optical`: it acts in the camera only.  `has_heavy_tails`: strengths have priors
    with heavy tails, else normal ones, as nodes of a law have, because evidence chooses their width.
    """

    effect: str
    params: dict[str, Param]
    strengths: dict[str, float]
    shapes: dict[str, float]
    is_optical: bool
    has_heavy_tails: bool = True

    @property
    def leading_strength(self) -> tuple[str, float]:
        """The first strength, which represents the effect, and its typical change from its neutral value."""
        return next(iter(self.strengths.items()))

    @property
    def shape_variants(self) -> tuple[dict[str, float], ...]:
        """Values of the shapes from which a fit may start: defaults, then each divided and multiplied by its spread."""
        out = [dict(self.shapes)]
        for k, value in self.shapes.items():
            spread = self.params[k].spread
            if spread > 1.0:
                out += [self.shapes | {k: clip_to_bounds(self.params[k], value * f)} for f in (1 / spread, spread)]
        return tuple(out)

    def neutral_values(self, variant: int = 0) -> dict[str, float]:
        """Values of all parameters at which the effect does not act."""
        idle = {k: p.off for k, p in self.params.items() if p.off is not None}
        return idle | self.shape_variants[variant]

    def strength_column(self, k: str, variant: int = 0) -> ParameterId:
        """The column of a strength."""
        return ParameterId.of_effect(self.effect, k, variant)

    def strength_columns(self, variant: int = 0) -> list[ParameterId]:
        return [self.strength_column(k, variant) for k in self.strengths]

    def parameter_priors(self, values: Mapping[str, float] | None = None) -> Priors:
        """Priors of all parameters of a full fit: strengths about their neutral values, shapes about their defaults.

        Strengths have typical widths, or the local widths at their `values`.
        """
        out = {}
        for k, a in self.strengths.items():
            off = self.params[k].off or 0.0
            change = values[k] - off if values and self.has_heavy_tails else 0.0
            out[self.strength_column(k)] = (off, local_width(a, change, STRENGTH_TAIL))
        for k, value in self.shapes.items():
            if self.params[k].spread > 1.0:
                out[self.strength_column(k)] = (value, abs(value) * float(np.log(self.params[k].spread)))
        return out


def find_candidates(
    case: Case, names: tuple[str, ...] | None, conditions: Sequence[Case] = (), has_images: bool = True
) -> tuple[list[CandidateEffect], dict[str, str]]:
    """Effects that may be missing in a case, and {effect: reason} of those that cannot be tried.

    `names`: the effects that a campaign lists; None for all that declare themselves candidates.  `conditions`: the case
    under every condition of a campaign, in each of which an effect must be possible.  `has_images`: whether a camera
    recorded anything.  Without images, errors of a camera are no candidates: zeros and gains of thermocouples are
    calibrated instead.
    """
    found, left = [], {}
    slides = any(not c["schedule.alone"] for c in conditions or (case,))
    for name, effect in case.known_effects.items():
        if effect.base or (names is not None and name not in names):
            continue
        candidate = _make_candidate(name, effect)
        reason = _exclusion_reason(case, name, effect, names is not None, has_images)
        if not reason and not slides and _acts_in_contact_only(case, name):
            reason = NOTHING_SLIDES
        reason = reason or _build_fault(candidate, (case, *conditions))
        if reason:
            left[name] = reason
        elif candidate.strengths:
            found.append(candidate)
    return found, left


def _exclusion_reason(case: Case, name: str, effect: type[Effect], is_requested: bool, has_images: bool) -> str:
    """Why an effect cannot be tried with its default values; empty if it can."""
    if name in case.effects:
        return "the case has it already"
    if not effect.candidate and not is_requested:
        return "its file does not declare it a candidate; name it in candidates to try it too"
    if not has_images and not is_requested and _is_optical(effect):
        return "acts in a camera, and no recording is an image; name it in candidates to try it too"
    if effect.alike and not is_requested:
        return f"resembles {effect.alike}, which is tried; name it in candidates to try it too"
    try:
        extended = case.with_values({"effects": [*case.effects, name]})
    except BadInput as fault:
        needs = [k for k, p in effect.params().items() if p.value is None and p.kinds != ("name",)]
        return f"needs {', '.join(needs)}" if needs else fault.lines[0]
    # sensitivities are differences of runs on one mesh
    return "" if np.array_equal(extended.scene.mesh.x, case.scene.mesh.x) else NEEDS_OTHER_MESH


def _build_fault(candidate: CandidateEffect, cases: Sequence[Case]) -> str:
    """Why a case cannot be built with a candidate in one of its shape variants; empty if all can."""
    for case in cases:
        for shapes in candidate.shape_variants:
            added = {f"{candidate.effect}.{k}": value for k, value in shapes.items()}
            try:
                case.with_values({"effects": [*case.effects, candidate.effect]} | added)
            except BadInput as fault:
                stated = ", ".join(f"{key} = {value:.3g}" for key, value in added.items())
                return f"cannot be built with {stated or 'its default values'}: {fault.lines[0]}"
    return ""


def _acts_in_contact_only(case: Case, name: str) -> bool:
    """Whether everything that an effect does in a case needs contact with the road."""
    scene = case.with_values({"effects": [*case.effects, name]}).scene
    [acting] = [one for one in scene.acting if one.name == name]
    parts = list(acting.contributions(scene))
    return bool(parts) and all(
        isinstance(part, Deposit) or getattr(part, "target", "").startswith(CONTACT_TARGETS) for part in parts
    )


def _is_optical(effect: type[Effect]) -> bool:
    """Whether an effect has no heat, so that it acts in the camera only."""
    return effect.heat is Effect.heat


def _make_candidate(name: str, effect: type[Effect]) -> CandidateEffect:
    params = effect.params()
    plain = {k: p for k, p in params.items() if "number" in p.kinds and isinstance(p.value, (int, float))}
    strengths = {
        k: float(p.value - p.off)
        for k, p in plain.items()
        if p.off is not None and math.isfinite(p.off) and math.isfinite(p.value) and p.value != p.off
    }
    shapes = {k: float(p.value) for k, p in plain.items() if p.off is None and not isinstance(p.value, bool)}
    return CandidateEffect(name, params, strengths, shapes, _is_optical(effect))
