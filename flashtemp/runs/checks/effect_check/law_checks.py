"""Checks of every law of an effect with the arguments of the heat balance: finite, repeatable, differentiable."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, FlashtempError, SolverFailure
from flashtemp.model.effect_laws import COMPLEX_STEP
from flashtemp.model.scene import ActiveEffect, Scene
from flashtemp.physics.effect import Deposit, Effect, Factor, Param
from flashtemp.runs.checks.effect_check import suggestions
from flashtemp.runs.checks.effect_check.findings import Finding, make_finding
from flashtemp.runs.checks.effect_check.fixtures import EffectUnderTest, SceneCache, make_acting
from flashtemp.runs.checks.effect_check.heat_balance_checks import sample_states, values_with_all_effects
from flashtemp.solver import contact_lanes

# arguments by which the solver differentiates laws
DIFFERENTIATED_FIELDS = ("T", "face", "local_pressure", "spot_fraction", "covered", "friction", "base")
MAX_LAW_RISE_K = 100.0  # K above ambient, highest temperature at which laws are evaluated
# positions of spots, and a fraction that the balance itself keeps above zero
UNBOUNDED_TARGETS = ("contact.cover", "contact.spot_fraction")
SAME_ANSWER_TOLERANCE = 1e-12  # relative difference between two evaluations
DERIVATIVE_TOLERANCE = 1e-5  # relative difference between complex step and finite differences
MAX_RELATIVE_SLOPE = 1e8  # derivative times argument over value, above which a law is singular


@dataclass(frozen=True)
class LawCall:
    """A contribution (the `number`th of its effect) and the arguments of its law: T in K, context `now`, `more`."""

    number: int
    part: Any
    film: bool
    T: Any
    now: Any
    more: tuple

    def evaluate_law(self, p, T=None, now=None, law: Callable | None = None):
        """The value of the law, with another temperature or context if given."""
        law, now = law or self.part.law, self.now if now is None else now
        return law(now, p) if self.film else law(self.T if T is None else T, now, p, *self.more)

    def contribution_text(self) -> str:
        """The contribution as written in the file."""
        if self.film or not hasattr(self.part, "target"):
            return f'Heat.{self.part.kind}("{self.part.site}")'
        return f'{type(self.part).__name__}("{self.part.target}")'

    def arguments_with(self, name: str, value) -> dict[str, Any]:
        """Arguments of `evaluate_law` with another value of T or of a field of the context."""
        return {"T": value} if name == "T" else {"now": _replace_fields(self.now, **{name: value})}

    def argument_value(self, name: str):
        """T, or a field of the context, by name."""
        return self.T if name == "T" else getattr(self.now, name, None)


class CallRecorder(Effect):
    """A wrapper of an effect that records the arguments of its laws."""

    def __init__(self, effect: Effect, file: Path):
        self.effect, self.file = effect, file
        self.calls: list[LawCall] = []

    def heat(self, scene, p):
        for number, part in enumerate(self.effect.heat(scene, p)):
            yield part if isinstance(part, Deposit) else replace(part, law=partial(self._record_call, number, part))

    def _record_call(self, number, part, *arguments):
        film = getattr(part, "kind", "") == "film"
        T, now, p, *more = (None, *arguments) if film else arguments
        real_now = _real_moment(now) if now is not None else None
        self.calls.append(LawCall(number, part, film, _real_part(T), real_now, tuple(more)))
        try:
            return part.law(*arguments)
        except Exception as fault:
            fault.add_note(suggestions.locate_law(self.file, part.law))
            raise


def record_law_calls(bench: SceneCache, trial: EffectUnderTest) -> tuple[list[LawCall], SimpleNamespace, Scene]:
    """The arguments of the laws during sliding and waiting in 2D and 3D, the parameters, and the scene.

    Raises whatever a law raises.
    """
    calls: dict[tuple, LawCall] = {}
    for shape in ("lifted", "3D"):
        scene = bench.build_scene(trial, values=values_with_all_effects(bench, trial, shape))
        own = next(a for a in scene.acting if a.name == trial.name)
        recorder = CallRecorder(own.effect, trial.file)
        acting = tuple(ActiveEffect(a.name, recorder, a.p) if a is own else a for a in scene.acting)
        for balance, system, t, y, _ in sample_states(replace(scene, acting=acting)):
            out = np.zeros(balance.size)
            system.rate(t, y, out)
            now = system.law_context(t)
            contact_lanes.spreading_loss_at_depth(
                balance, system.interface.context_at_contact(system.solve_contact(now, y).state, now)
            )
            for q in recorder.calls:
                calls.setdefault((q.number, shape, system.phase.sliding), q)
            recorder.calls.clear()
    return list(calls.values()), own.p, scene


def check_laws(bench: SceneCache, trial: EffectUnderTest) -> list[Finding]:
    """Findings on all laws of an effect on the heat balance."""
    try:
        calls, p, scene = record_law_calls(bench, trial)
    except SolverFailure as fault:
        return [Finding("laws", False, f"the heat balance cannot be evaluated at its defaults: {fault}")]
    except FlashtempError:
        raise
    except Exception as fault:
        return [Finding("laws", False, suggestions.explain_exception(trial.file, fault))]
    found: list[Finding] = []
    for name, check, good in (
        ("laws", _check_answers, "every law returns numbers wherever the heat balance evaluates it"),
        ("repeatable", _check_repeats, "every law returns the same value for the same arguments"),
        ("pointwise", _check_pointwise, "every law uses its own point only"),
        ("derivatives", _check_derivatives, "derivatives of every law by complex step agree with finite differences"),
        ("ends", _check_ends, "laws stay finite at rest, without pressure, and at the bounds of every parameter"),
    ):
        if all(f.ok for f in found[:2]):
            found.append(
                make_finding(
                    name, suggestions.first_fault_per_line(check(LawsUnderTest(bench, trial, calls, p, scene))), good
                )
            )
    return found


def find_laws_not_off(bench: SceneCache, trial: EffectUnderTest) -> list[str]:
    """Errors of laws that are not neutral with all parameters off, each with its line and value."""
    own = trial.own_values | {k.split(".", 1)[1]: v for k, v in trial.off_values().items()}
    calls, _, scene = record_law_calls(bench, trial)
    acting = make_acting(trial, own, bench.folder)
    laws, faults = _laws_by_number(acting, scene), []
    for q in (q for q in calls if q.number in laws):
        value = np.asarray(q.evaluate_law(acting.p, law=laws[q.number]))
        neutral = 1.0 if isinstance(q.part, Factor) else 0.0
        if np.any(value != neutral):
            worst = value.flat[np.argmax(np.abs(value - neutral))]
            text = f"{q.contribution_text()} is {worst:.6g} with all parameters off"
            faults.append(
                f"{suggestions.locate_law(trial.file, q.part.law)}: {text}; it must then be exactly {neutral:g}"
            )
    return suggestions.first_fault_per_line(faults)


@dataclass(frozen=True)
class LawsUnderTest:
    """Recorded calls of the laws of an effect under test, with the parameters and the scene of its defaults."""

    bench: SceneCache
    trial: EffectUnderTest
    calls: list[LawCall]
    p: SimpleNamespace
    scene: Scene


# --- one law -----------------------------------------------------------------------------------------
def _catch_law_errors(trial: EffectUnderTest, check: Callable[[], Iterator[str]], where: str = "") -> Iterator[str]:
    """The errors that a check yields; an exception in the law becomes an error with its line."""
    try:
        with np.errstate(all="ignore"):
            yield from check()
    except FlashtempError:
        raise
    except Exception as fault:
        yield suggestions.explain_exception(trial.file, fault, where)


def _check_answers(context: LawsUnderTest) -> Iterator[str]:
    for q in context.calls:
        yield from _catch_law_errors(context.trial, partial(_check_answer, context, q))


def _check_answer(context: LawsUnderTest, q: LawCall) -> Iterator[str]:
    value = np.asarray(q.evaluate_law(context.p))
    at = f"{suggestions.locate_law(context.trial.file, q.part.law)}: {q.contribution_text()}"
    if not np.issubdtype(value.dtype, np.number):
        yield f"{at} gives {value!r}; give a number"
    elif q.film and not np.all(np.real(value) >= 0):
        yield f"{at} is {np.min(np.real(value)):.3g} W/m2K; a heat transfer coefficient cannot be negative: give >= 0"
    elif not q.film and not np.all(np.isfinite(value)):
        yield f"{at} is not finite at its defaults; {suggestions.HOLD_REMEDY}"


def _check_repeats(context: LawsUnderTest) -> Iterator[str]:
    for q in context.calls:
        yield from _catch_law_errors(context.trial, partial(_check_repeat, context, q))


def _check_repeat(context: LawsUnderTest, q: LawCall) -> Iterator[str]:
    first = np.array(q.evaluate_law(context.p))
    for name in ("T", "local_pressure"):
        if isinstance(q.argument_value(name), np.ndarray):
            q.evaluate_law(context.p, **q.arguments_with(name, 1.1 * q.argument_value(name)))
    if not np.array_equal(first, np.array(q.evaluate_law(context.p)), equal_nan=True):
        at = suggestions.locate_law(context.trial.file, q.part.law)
        text = f"{q.contribution_text()} returns another value when called again"
        yield f"{at}: {text}; a law keeps nothing and draws no random numbers"


def _check_pointwise(context: LawsUnderTest) -> Iterator[str]:
    for q in context.calls:
        if any(np.ndim(m) for m in q.more):
            yield from _catch_law_errors(context.trial, partial(_compare_single_distance, context, q))
            continue
        lead = next(
            (q.argument_value(n) for n in ("T", "local_pressure", "spot_fraction") if np.ndim(q.argument_value(n))),
            None,
        )
        if lead is not None and len(lead) > 1 and getattr(q.part, "target", "") not in UNBOUNDED_TARGETS[:1]:
            yield from _catch_law_errors(context.trial, partial(_compare_single_point, context, q, lead))


def _compare_single_point(context: LawsUnderTest, q: LawCall, lead: np.ndarray) -> Iterator[str]:
    rng = np.random.default_rng(5)
    arrays = {n: v for n in DIFFERENTIATED_FIELDS if np.ndim(v := q.argument_value(n))}
    shake = {n: v * (1 + 0.05 * rng.uniform(-1, 1, v.shape)) for n, v in arrays.items()}
    T = shake.pop("T", q.T)
    now = _replace_fields(q.now, **shake)
    every = np.broadcast_to(q.evaluate_law(context.p, T=T, now=now), lead.shape)
    fields = {n: v for n in getattr(now, "_fields", ()) if np.ndim(v := getattr(now, n)) == lead.ndim}
    own = {n: v[:1] for n, v in fields.items() if len(v) == len(lead)}
    alone = np.broadcast_to(
        q.evaluate_law(context.p, T=T[:1] if np.ndim(T) else T, now=_replace_fields(now, **own)), lead[:1].shape
    )
    yield from _require_same(context, q, alone, every[:1])


def _compare_single_distance(context: LawsUnderTest, q: LawCall) -> Iterator[str]:
    """Check that a law of several distances returns the same value for one of them alone."""
    every = np.asarray(q.evaluate_law(context.p))
    alone = np.asarray(replace(q, more=tuple(m[:1] if np.ndim(m) else m for m in q.more)).evaluate_law(context.p))
    yield from _require_same(context, q, alone, every[:1] if every.ndim else every)


def _require_same(context: LawsUnderTest, q: LawCall, alone, among) -> Iterator[str]:
    if not np.allclose(alone, among, rtol=SAME_ANSWER_TOLERANCE, atol=0.0):
        at = suggestions.locate_law(context.trial.file, q.part.law)
        yield (
            f"{at}: {q.contribution_text()} returns another value at a point when evaluated there alone; "
            "a law may use its own point only: no mean, max or sum over an array"
        )


def _check_derivatives(context: LawsUnderTest) -> Iterator[str]:
    for q in (q for q in context.calls if not q.film):
        yield from _catch_law_errors(context.trial, partial(_check_derivative, context, q))


def _check_derivative(context: LawsUnderTest, q: LawCall) -> Iterator[str]:
    rng = np.random.default_rng(3)
    for name in DIFFERENTIATED_FIELDS:
        v = q.argument_value(name)
        if v is None or not np.issubdtype(np.asarray(v).dtype, np.number):
            continue
        v = np.asarray(v, dtype=float)
        warm = context.scene.ambient + rng.uniform(0.0, MAX_LAW_RISE_K, v.shape)
        v = warm if name in ("T", "face") else v * (1 + 0.2 * rng.uniform(-1, 1, v.shape))
        step = 3e-6 * np.maximum(np.abs(v), 1e-300)
        exact = (
            np.imag(q.evaluate_law(context.p, **q.arguments_with(name, v + 1j * COMPLEX_STEP * np.abs(v))))
            / COMPLEX_STEP
        )
        up, down = (np.asarray(q.evaluate_law(context.p, **q.arguments_with(name, v + s * step))) for s in (1, -1))
        difference = np.real(up - down) / 6e-6
        if np.any(np.abs(exact - difference) > DERIVATIVE_TOLERANCE * np.abs(difference) + 1e-8 * np.max(np.abs(up))):
            yield suggestions.explain_slope(context.trial.file, q.part.law, q.contribution_text(), name)


# --- singular laws -----------------------------------------------------------------------------------
def _check_ends(context: LawsUnderTest) -> Iterator[str]:
    """Errors of laws that are not finite at rest, without pressure, or at a bound of a parameter."""
    laws = {q.number: q.part.law for q in context.calls}
    for where, p, there in [("", context.p, laws), *_parameter_ends(context)]:
        for q in context.calls:
            if q.number in there and getattr(q.part, "target", "") not in UNBOUNDED_TARGETS:
                for what, now in _corner_moments(q):
                    places = " and ".join(w for w in (what, where) if w) or "the heat balance evaluates it"
                    check = partial(
                        _check_end, context, replace(q, part=replace(q.part, law=there[q.number]), now=now), p, places
                    )
                    yield from _catch_law_errors(context.trial, check, places)


def _check_end(context: LawsUnderTest, q: LawCall, p, where: str) -> Iterator[str]:
    value = np.asarray(q.evaluate_law(p))
    singular = not np.all(np.isfinite(value)) and not (q.film and np.all(value == np.inf))
    if q.now is not None and np.ndim(q.now.local_pressure) and not np.any(q.now.local_pressure) and not singular:
        slope = (
            np.imag(
                q.evaluate_law(p, now=_replace_fields(q.now, local_pressure=q.now.local_pressure + 1j * COMPLEX_STEP))
            )
            / COMPLEX_STEP
        )
        singular = bool(np.any(np.abs(slope) * q.now.pressure > MAX_RELATIVE_SLOPE * (1.0 + np.max(np.abs(value)))))
    if singular:
        at = suggestions.locate_law(context.trial.file, q.part.law)
        yield f"{at}: {q.contribution_text()} is singular where {where}; {suggestions.HOLD_REMEDY}"


def _corner_moments(q: LawCall) -> Iterator[tuple[str, Any]]:
    """The context of a call as recorded, at rest, at the start, and without pressure."""
    yield "", q.now
    if q.now is None:
        return
    if q.now.touching:
        yield "the speed is 0", _replace_fields(q.now, speed=0.0, last_speed=0.0)
    yield "the slid distance and the time are 0", _replace_fields(q.now, slid=0.0, contact_time=0.0, t=0.0)
    if np.ndim(q.now.local_pressure):
        yield "the local pressure is 0", _replace_fields(q.now, local_pressure=0.0 * q.now.local_pressure)


def _parameter_ends(context: LawsUnderTest) -> Iterator[tuple[str, SimpleNamespace, dict[int, Callable]]]:
    """Every numeric parameter at both bounds: description, parameters and laws by number."""
    if context.trial.effect.base or _is_slow(context.trial.effect):
        return
    for key, param in context.trial.effect.params().items():
        for end in _range_ends(param):
            try:
                acting = make_acting(context.trial, context.trial.own_values | {key: end}, context.bench.folder)
                yield f"{key} = {end:g}", acting.p, _laws_by_number(acting, context.scene)
            except BadInput:
                continue  # the effect refuses this value with a message, which is fine


def _laws_by_number(acting: ActiveEffect, scene: Scene) -> dict[int, Callable]:
    return {n: c.law for n, c in enumerate(acting.contributions(scene)) if not isinstance(c, Deposit)}


def _range_ends(param: Param) -> list[float]:
    """The finite bounds of a numeric parameter; just inside an open one."""
    if "number" not in param.kinds or not isinstance(param.value, (int, float)):
        return []
    low = param.low + 1e-3 * (param.value - param.low) if param.open_low else param.low
    return [end for end in (low, param.high) if np.isfinite(end)]


def _is_slow(effect: type[Effect]) -> bool:
    """Whether every scene of the effect computes a table, which is too slow for a check of all bounds."""
    return effect.leave is not Effect.leave


# --- contexts of laws --------------------------------------------------------------------------------
def _real_part(value):
    return np.real(value) if np.iscomplexobj(value) else value


def _real_moment(now):
    """A context without imaginary parts."""
    return now._replace(**{n: _real_part(v) for n in DIFFERENTIATED_FIELDS[1:] if (v := getattr(now, n)) is not None})


def _replace_fields(now, **values):
    return now._replace(**values) if values else now
