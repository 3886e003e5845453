"""Every law of an effect by itself, asked what the balance asks it: finite, differentiable, pointwise, repeatable."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, FlashtempError, SolverFailure
from flashtemp.model.laws import STEP
from flashtemp.model.scene import Acting, Scene
from flashtemp.physics.effect import Deposit, Effect, Factor, Param
from flashtemp.runs.effect_check import remedies
from flashtemp.runs.effect_check.balance import rich, states
from flashtemp.runs.effect_check.findings import Finding, judged
from flashtemp.runs.effect_check.scenes import Bench, Trial, acting_of
from flashtemp.solver import lanes

CARRIED = ("T", "face", "local_pressure", "spot_fraction", "covered", "friction", "base")  # may pass a derivative on
WARM = 100.0  # K above ambient: how far laws of temperature are asked
FREE = ("contact.cover", "contact.spot_fraction")  # where spots are; what the balance itself holds from zero
SAME = 1e-12  # relative difference of one answer given twice
CLOSE, STEEP = 1e-5, 1e8  # of derivatives: relative difference; times its argument over the law, beyond all reason


@dataclass(frozen=True)
class Question:
    """One contribution (the `number`th of its effect) and what its law was asked: T in K, the moment, the rest."""

    number: int
    part: Any
    film: bool
    T: Any
    now: Any
    more: tuple

    def ask(self, p, T=None, now=None, law: Callable | None = None):
        """The law's answer, at another temperature or moment if given."""
        law, now = law or self.part.law, self.now if now is None else now
        return law(now, p) if self.film else law(self.T if T is None else T, now, p, *self.more)

    def named(self) -> str:
        """The contribution as it stands in the file."""
        if self.film or not hasattr(self.part, "target"):
            return f'Heat.{self.part.kind}("{self.part.site}")'
        return f'{type(self.part).__name__}("{self.part.target}")'

    def with_(self, name: str, value) -> dict[str, Any]:
        """Arguments of `ask` with another value of T or of a field of the moment."""
        return {"T": value} if name == "T" else {"now": _moved(self.now, **{name: value})}

    def value(self, name: str):
        """T, or that field of the moment."""
        return self.T if name == "T" else getattr(self.now, name, None)


class Overheard(Effect):
    """An effect that notes what its laws are asked."""

    def __init__(self, effect: Effect, file: Path):
        self.effect, self.file = effect, file
        self.questions: list[Question] = []

    def heat(self, scene, p):
        for number, part in enumerate(self.effect.heat(scene, p)):
            yield part if isinstance(part, Deposit) else replace(part, law=partial(self._law, number, part))

    def _law(self, number, part, *asked):
        film = getattr(part, "kind", "") == "film"
        T, now, p, *more = (None, *asked) if film else asked
        calm = _real(now) if now is not None else None
        self.questions.append(Question(number, part, film, _bare(T), calm, tuple(more)))
        try:
            return part.law(*asked)
        except Exception as fault:
            fault.add_note(remedies.place(self.file, part.law))
            raise


def overheard(bench: Bench, trial: Trial) -> tuple[list[Question], SimpleNamespace, Scene]:
    """What the balance asks the laws while sliding and while waiting, in 2D and in 3D; parameters; scene.

    Raises whatever a law raises.
    """
    kept: dict[tuple, Question] = {}
    for shape in ("lifted", "3D"):
        scene = bench.scene(trial, values=rich(bench, trial, shape))
        own = next(a for a in scene.acting if a.name == trial.name)
        note = Overheard(own.effect, trial.file)
        acting = tuple(Acting(a.name, note, a.p) if a is own else a for a in scene.acting)
        for balance, system, t, y, _ in states(replace(scene, acting=acting)):
            out = np.zeros(balance.size)
            system.rate(t, y, out)
            now = system.moment(t)
            lanes.loss_at_depth(balance, system.interface.at(system.contact(now, y).state, now))
            for q in note.questions:
                kept.setdefault((q.number, shape, system.phase.sliding), q)
            note.questions.clear()
    return list(kept.values()), own.p, scene


def asked(bench: Bench, trial: Trial) -> list[Finding]:
    """The findings on all laws of an effect on the balance."""
    try:
        questions, p, scene = overheard(bench, trial)
    except SolverFailure as fault:
        return [Finding("laws", False, f"the balance has no answer at its defaults: {fault}")]
    except FlashtempError:
        raise
    except Exception as fault:
        return [Finding("laws", False, remedies.of_exception(trial.file, fault))]
    found: list[Finding] = []
    for name, look, good in (
        ("laws", _answers, "every law gives numbers wherever the balance asks it"),
        ("repeatable", _repeats, "every law gives the same answer to the same question"),
        ("pointwise", _pointwise, "every law sees its own point and no other"),
        ("derivatives", _derivatives, "every law passes its derivative on, by complex step as by differences"),
        ("ends", _ends, "laws stay finite at rest, without pressure, and at every parameter's ends"),
    ):
        if all(f.ok for f in found[:2]):
            found.append(judged(name, remedies.once_a_line(look(Laws(bench, trial, questions, p, scene))), good))
    return found


def not_off(bench: Bench, trial: Trial) -> list[str]:
    """Laws that do something with all parameters off, each with its line and its answer there."""
    own = trial.own | {k.split(".", 1)[1]: v for k, v in trial.off().items()}
    questions, _, scene = overheard(bench, trial)
    acting = acting_of(trial, own, bench.folder)
    laws, faults = _by_number(acting, scene), []
    for q in (q for q in questions if q.number in laws):
        value, neutral = np.asarray(q.ask(acting.p, law=laws[q.number])), 1.0 if isinstance(q.part, Factor) else 0.0
        if np.any(value != neutral):
            says = f"{q.named()} is {value.flat[np.argmax(np.abs(value - neutral))]:.6g} with all parameters off"
            faults.append(f"{remedies.place(trial.file, q.part.law)}: {says}; it is then exactly {neutral:g}")
    return remedies.once_a_line(faults)


@dataclass(frozen=True)
class Laws:
    """The questions to the laws of an effect on trial, with the parameters and the scene of its defaults."""

    bench: Bench
    trial: Trial
    questions: list[Question]
    p: SimpleNamespace
    scene: Scene


# --- one law -----------------------------------------------------------------------------------------
def _tried(trial: Trial, work: Callable[[], Iterator[str]], where: str = "") -> Iterator[str]:
    """What work says; an exception of the law is a fault that names its line."""
    try:
        with np.errstate(all="ignore"):
            yield from work()
    except FlashtempError:
        raise
    except Exception as fault:
        yield remedies.of_exception(trial.file, fault, where)


def _answers(of: Laws) -> Iterator[str]:
    for q in of.questions:
        yield from _tried(of.trial, partial(_answer, of, q))


def _answer(of: Laws, q: Question) -> Iterator[str]:
    value = np.asarray(q.ask(of.p))
    at = f"{remedies.place(of.trial.file, q.part.law)}: {q.named()}"
    if not np.issubdtype(value.dtype, np.number):
        yield f"{at} gives {value!r}; give a number"
    elif q.film and not np.all(np.real(value) >= 0):
        yield f"{at} is {np.min(np.real(value)):.3g} W/m2K; a film carries heat towards what is colder: give >= 0"
    elif not q.film and not np.all(np.isfinite(value)):
        yield f"{at} is not finite at its defaults; {remedies.HELD}"


def _repeats(of: Laws) -> Iterator[str]:
    for q in of.questions:
        yield from _tried(of.trial, partial(_repeat, of, q))


def _repeat(of: Laws, q: Question) -> Iterator[str]:
    first = np.array(q.ask(of.p))
    for name in ("T", "local_pressure"):
        if isinstance(q.value(name), np.ndarray):
            q.ask(of.p, **q.with_(name, 1.1 * q.value(name)))
    if not np.array_equal(first, np.array(q.ask(of.p)), equal_nan=True):
        at = remedies.place(of.trial.file, q.part.law)
        yield f"{at}: {q.named()} answers otherwise when asked again; a law keeps nothing and draws no random numbers"


def _pointwise(of: Laws) -> Iterator[str]:
    for q in of.questions:
        if any(np.ndim(m) for m in q.more):
            yield from _tried(of.trial, partial(_apart, of, q))
            continue
        lead = next((q.value(n) for n in ("T", "local_pressure", "spot_fraction") if np.ndim(q.value(n))), None)
        if lead is not None and len(lead) > 1 and getattr(q.part, "target", "") not in FREE[:1]:
            yield from _tried(of.trial, partial(_alone, of, q, lead))


def _alone(of: Laws, q: Question, lead: np.ndarray) -> Iterator[str]:
    rng = np.random.default_rng(5)
    arrays = {n: v for n in CARRIED if np.ndim(v := q.value(n))}
    shake = {n: v * (1 + 0.05 * rng.uniform(-1, 1, v.shape)) for n, v in arrays.items()}
    T = shake.pop("T", q.T)
    now = _moved(q.now, **shake)
    every = np.broadcast_to(q.ask(of.p, T=T, now=now), lead.shape)
    fields = {n: v for n in getattr(now, "_fields", ()) if np.ndim(v := getattr(now, n)) == lead.ndim}
    own = {n: v[:1] for n, v in fields.items() if len(v) == len(lead)}
    alone = np.broadcast_to(q.ask(of.p, T=T[:1] if np.ndim(T) else T, now=_moved(now, **own)), lead[:1].shape)
    yield from _same(of, q, alone, every[:1])


def _apart(of: Laws, q: Question) -> Iterator[str]:
    """A law of distances sees one of them alone as among the others."""
    every = np.asarray(q.ask(of.p))
    alone = np.asarray(replace(q, more=tuple(m[:1] if np.ndim(m) else m for m in q.more)).ask(of.p))
    yield from _same(of, q, alone, every[:1] if every.ndim else every)


def _same(of: Laws, q: Question, alone, among) -> Iterator[str]:
    if not np.allclose(alone, among, rtol=SAME, atol=0.0):
        yield (
            f"{remedies.place(of.trial.file, q.part.law)}: {q.named()} answers otherwise at one point when asked about "
            "that point alone; a law sees its own point: no mean, max or sum over an array"
        )


def _derivatives(of: Laws) -> Iterator[str]:
    for q in (q for q in of.questions if not q.film):
        yield from _tried(of.trial, partial(_slopes, of, q))


def _slopes(of: Laws, q: Question) -> Iterator[str]:
    rng = np.random.default_rng(3)
    for name in CARRIED:
        v = q.value(name)
        if v is None or not np.issubdtype(np.asarray(v).dtype, np.number):
            continue
        v = np.asarray(v, dtype=float)
        warm = of.scene.ambient + rng.uniform(0.0, WARM, v.shape)
        v = warm if name in ("T", "face") else v * (1 + 0.2 * rng.uniform(-1, 1, v.shape))
        step = 3e-6 * np.maximum(np.abs(v), 1e-300)
        exact = np.imag(q.ask(of.p, **q.with_(name, v + 1j * STEP * np.abs(v)))) / STEP
        up, down = (np.asarray(q.ask(of.p, **q.with_(name, v + s * step))) for s in (1, -1))
        by = np.real(up - down) / 6e-6
        if np.any(np.abs(exact - by) > CLOSE * np.abs(by) + 1e-8 * np.max(np.abs(up))):
            yield remedies.of_slope(of.trial.file, q.part.law, q.named(), name)


# --- where powers blow up ----------------------------------------------------------------------------
def _ends(of: Laws) -> Iterator[str]:
    """Laws that are not finite at rest, without pressure, or where a parameter is at an end of its range."""
    laws = {q.number: q.part.law for q in of.questions}
    for where, p, there in [("", of.p, laws), *_bounds(of)]:
        for q in of.questions:
            if q.number in there and getattr(q.part, "target", "") not in FREE:
                for what, now in _corners(q):
                    places = " and ".join(w for w in (what, where) if w) or "it is asked"
                    look = partial(
                        _at_end, of, replace(q, part=replace(q.part, law=there[q.number]), now=now), p, places
                    )
                    yield from _tried(of.trial, look, places)


def _at_end(of: Laws, q: Question, p, where: str) -> Iterator[str]:
    value = np.asarray(q.ask(p))
    wild = not np.all(np.isfinite(value)) and not (q.film and np.all(value == np.inf))
    if q.now is not None and np.ndim(q.now.local_pressure) and not np.any(q.now.local_pressure) and not wild:
        slope = np.imag(q.ask(p, now=_moved(q.now, local_pressure=q.now.local_pressure + 1j * STEP))) / STEP
        wild = bool(np.any(np.abs(slope) * q.now.pressure > STEEP * (1.0 + np.max(np.abs(value)))))
    if wild:
        yield f"{remedies.place(of.trial.file, q.part.law)}: {q.named()} blows up where {where}; {remedies.HELD}"


def _corners(q: Question) -> Iterator[tuple[str, Any]]:
    """The moment as it was, at rest, and without pressure."""
    yield "", q.now
    if q.now is None:
        return
    if q.now.touching:
        yield "the speed is 0", _moved(q.now, speed=0.0, last_speed=0.0)
    yield "the slid distance and the time are 0", _moved(q.now, slid=0.0, contact_time=0.0, t=0.0)
    if np.ndim(q.now.local_pressure):
        yield "the local pressure is 0", _moved(q.now, local_pressure=0.0 * q.now.local_pressure)


def _bounds(of: Laws) -> Iterator[tuple[str, SimpleNamespace, dict[int, Callable]]]:
    """Every numeric parameter at both ends of its range: words, parameters and laws by number."""
    if of.trial.effect.base or _slow(of.trial.effect):
        return
    for key, param in of.trial.effect.params().items():
        for end in _range(param):
            try:
                acting = acting_of(of.trial, of.trial.own | {key: end}, of.bench.folder)
                yield f"{key} = {end:g}", acting.p, _by_number(acting, of.scene)
            except BadInput:
                continue  # refused in words: that is an answer


def _by_number(acting: Acting, scene: Scene) -> dict[int, Callable]:
    return {n: c.law for n, c in enumerate(acting.contributions(scene)) if not isinstance(c, Deposit)}


def _range(param: Param) -> list[float]:
    """Both ends of a parameter's range that are numbers; just inside an open one."""
    if "number" not in param.kinds or not isinstance(param.value, (int, float)):
        return []
    low = param.low + 1e-3 * (param.value - param.low) if param.open_low else param.low
    return [end for end in (low, param.high) if np.isfinite(end)]


def _slow(effect: type[Effect]) -> bool:
    """Whether each scene of it costs a table: its author looks after the ends."""
    return effect.leave is not Effect.leave


# --- moments -----------------------------------------------------------------------------------------
def _bare(value):
    return np.real(value) if np.iscomplexobj(value) else value


def _real(now):
    """A moment without imaginary parts."""
    return now._replace(**{n: _bare(v) for n in CARRIED[1:] if (v := getattr(now, n)) is not None})


def _moved(now, **values):
    return now._replace(**values) if values else now
