"""Which process makes friction depend on the load?  Every set of them acts in turn, and shares are Shapley's.

Five candidates (the source paper's question): saturation of the contact, non-linear viscoelasticity, skewness of the
roughness, adhesion that enlarges the contact, and frictional heating.  The first four act on the theory of friction,
heating on the temperatures that the solver finds.  What a set changes in ln mu is v(S); m(S) is what only all of S
together add to it (Harsanyi's dividend), and each takes an equal part of that: Shapley's value, the mean of what a
process adds over all orders in which the processes may come.
"""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, FlashtempError, SolverFailure
from flashtemp.model import case as cases
from flashtemp.model.build import theory_of
from flashtemp.model.scene import Acting, Scene
from flashtemp.runs.workers import stream
from flashtemp.showing import Sheet, Shown
from flashtemp.solver.balance import Balance
from flashtemp.solver.march import march
from flashtemp.solver.system import System

NOTHING = 0.01  # change of friction over the loads below which nothing needs a cause
SMALL, MOST = 1e-3, 3  # what processes change only together is told from this change on, the largest few
QUIET = {"output.profiles": 2, "output.fields": 2}  # only the end counts
PRESSURES, SPEEDS = (5e4, 1e5, 2e5, 3e5), (0.1, 0.5, 1.0)


@dataclass(frozen=True)
class Process:
    """A process with the key of the theory's table that switches it: its value off, and a typical one where it acts."""

    name: str
    words: str
    key: str | None
    off: Any = None
    on: Any = None


HEATING = "heating"
PROCESSES = (
    Process("saturation", "the contact saturates", "saturation", False, True),
    Process("softening", "filled rubber softens with strain", "payne_rest", 1.0, 0.4),
    Process("skewness", "the road's tops are flattened", "flattened", 1.0, 0.838166),
    Process("adhesion", "adhesion pulls rubber into contact", "work_of_adhesion", 0.0, 0.05),
    Process(HEATING, "friction heats the contact", None),
)
NAMES = tuple(p.name for p in PROCESSES)


@dataclass(frozen=True)
class Asked:
    """A case at some nominal pressures (Pa), and whether heating is to be left out of it."""

    case: cases.Case
    pressures: tuple[float, ...]
    cold: bool


def frictions(asked: Asked) -> list[float]:
    """Friction at each of the pressures: they share the theory's table.  Raises SolverFailure that names the point."""
    found = []
    for p in asked.pressures:
        point = asked.case.with_values({"contact.pressure": p})
        try:
            found.append(friction_of(point, asked.cold))
        except SolverFailure as fault:
            raise SolverFailure(f"at {point['schedule.speed']:g} m/s, {p:g} Pa: {fault}") from fault
    return found


def friction_of(case: cases.Case, cold: bool) -> float:
    """Load-weighted friction at the end of the last repetition; `cold`: all is at the ambient temperature."""
    scene = case.scene
    if not cold:
        run = march(scene, case.settings, case.title)
        return float(run.friction[run.last])
    phase = [phase for phase in scene.schedule.phases if phase.sliding][-1]
    system = System(Balance(scene), phase)
    now, y = system.moment(phase.end), system.b.initial()
    state, press, *_ = system.contact(now, y)
    T = np.full(len(press.pressure), now.ambient)
    mu = system.b.laws("friction.mu", 0.0, T, system.interface.at(state, now)._replace(face=T)) + 0.0 * T
    load = press.pressure * scene.mesh.column_area
    return float(mu @ load / load.sum())


Names = tuple[str, ...]  # processes, in the order of NAMES


def subsets(names: Names) -> list[Names]:
    """All sets of some processes, the empty one first."""
    return [some for n in range(len(names) + 1) for some in itertools.combinations(names, n)]


@dataclass(frozen=True, eq=False, repr=False)
class Loads(Shown):
    """mu over speeds (m/s) and nominal pressures (Pa): arrays (speeds, pressures) by what acts.

    `acting` processes of the case, with `values` {process: value of its key}; those that do not act were tried beside
    them, one at a time, with typical values.  `mu` {processes: mu} of every set of them; `other` heating alone under
    the other law of the contact fraction, which is `law`.  `skewness_cutoff` (m) is the shortest wave that skewness
    flattens, 0 all.  `signs` (`sign_of_friction.Sign`) say what of it may turn.
    """

    title: str
    pressure: np.ndarray
    speed: np.ndarray
    acting: Names
    values: dict[str, Any]
    mu: dict[Names, np.ndarray]
    other: np.ndarray
    law: str
    skewness_cutoff: float = 0.0
    signs: tuple[Any, ...] = ()

    @property
    def none(self) -> np.ndarray:
        """mu without any of the processes."""
        return self.mu[()]

    @property
    def every(self) -> np.ndarray:
        """mu of the case itself."""
        return self.mu[self.acting]

    @property
    def alone(self) -> dict[str, np.ndarray]:
        """{process: mu} with that process only."""
        return {n: self.mu[(n,)] for n in NAMES}

    @property
    def beside(self) -> dict[str, np.ndarray]:
        """{process: mu} of the case without it, where it acts there, else of the case with it."""
        return {n: self.mu[tuple(m for m in NAMES if (m in self.acting) != (m == n))] for n in NAMES}

    def change(self, mu: np.ndarray) -> np.ndarray:
        """Change of ln mu (speeds,) from the lowest to the highest load."""
        return np.log(mu[:, -1] / mu[:, 0])

    def shares(self) -> dict[str, np.ndarray]:
        """Shapley's share of each process in the change of ln mu (speeds,).

        Those of the case sum to its change, but for what `none` changes; one that it does not have shares in the case
        with it.
        """
        return self._shares(self.change)

    def local(self) -> dict[str, np.ndarray]:
        """The same (speeds, pressures - 1), from each load to the next."""
        return self._shares(lambda mu: np.diff(np.log(mu), axis=1))

    def together(self) -> dict[Names, np.ndarray]:
        """What only processes of the case together change in ln mu (speeds,), by sets of two and more."""
        return {some: v for some, v in self._dividends(self.acting, self.change).items() if len(some) > 1}

    def own(self) -> dict[str, np.ndarray]:
        """What each process changes in ln mu (speeds,) when nothing else acts."""
        return {n: self.change(mu) - self.change(self.none) for n, mu in self.alone.items()}

    def _dividends(self, names: Names, change) -> dict[Names, np.ndarray]:
        """{some: what only all of them together add} for all sets of `names`; of the empty one what `none` changes."""
        found: dict[Names, np.ndarray] = {}
        for some in subsets(names):
            found[some] = change(self.mu[some]) - sum(found[part] for part in subsets(some)[:-1])
        return found

    def _shares(self, change) -> dict[str, np.ndarray]:
        out = {}
        for n in NAMES:
            players = tuple(m for m in NAMES if m in self.acting or m == n)
            parts = self._dividends(players, change)
            out[n] = np.sum([v / len(some) for some, v in parts.items() if n in some], axis=0)
        return out

    @property
    def leading(self) -> str | None:
        """The process of the case that changes most over all speeds; None where the load does not matter."""
        if np.max(np.abs(self.change(self.every))) < NOTHING:
            return None
        return max(self.acting, key=lambda n: float(np.abs(self.shares()[n]).mean()))

    def as_dict(self) -> dict:
        """For --json."""
        plain = {k: getattr(self, k).tolist() for k in ("none", "every", "other")}
        sets = {k: {n: v.tolist() for n, v in getattr(self, k).items()} for k in ("alone", "beside")}
        return {
            "title": self.title, "pressure_Pa": self.pressure.tolist(), "speed_m_s": self.speed.tolist(),
            "contact_fraction": self.law, "skewness_cutoff_m": self.skewness_cutoff,
            "leading": self.leading, "acting": list(self.acting), "values": self.values,
            "ln_change": self.change(self.every).tolist(),
            "ln_shares": {n: v.tolist() for n, v in self.shares().items()},
            "ln_shares_from_load_to_load": {n: v.tolist() for n, v in self.local().items()},
            "ln_alone": {n: v.tolist() for n, v in self.own().items()},
            "ln_together": {" + ".join(some): v.tolist() for some, v in self.together().items()},
            "words": {p.name: p.words for p in PROCESSES}, "mu": plain | sets,
            "signs": [s.as_dict() for s in self.signs],
        }  # fmt: skip

    def save(self, file: Path) -> None:
        """A CSV row per speed and pressure."""
        columns = {"case": self.every, "none": self.none, f"{HEATING}_other_contact_fraction": self.other}
        columns |= {f"only_{'_'.join(some)}": v for some, v in self.mu.items() if some and some != self.acting}
        with Path(file).open("w", newline="", encoding="utf-8") as out:
            rows = csv.writer(out)
            rows.writerow(["speed_m_s", "pressure_Pa", *(f"mu_{name}" for name in columns)])
            for i, v in enumerate(self.speed):
                for j, p in enumerate(self.pressure):
                    rows.writerow([f"{v:g}", f"{p:g}", *(f"{values[i, j]:.6f}" for values in columns.values())])

    def __str__(self) -> str:
        low, high = self.pressure[0] / 1e6, self.pressure[-1] / 1e6
        lines = [f"Friction over load '{self.title}', {low:g} to {high:g} MPa; contact fraction {self.law}"]
        shares, own = self.shares(), self.own()
        for i, v in enumerate(self.speed):
            parts = ", ".join(f"{n} {_percent(shares[n][i])} (alone {_percent(own[n][i])})" for n in self.acting)
            change = f"{self.every[i, 0]:.3f} -> {self.every[i, -1]:.3f} ({_percent(self.change(self.every)[i])})"
            lines.append(f"  {v:g} m/s: mu {change}: {parts}")
            most = sorted(self.together().items(), key=lambda item: -abs(item[1][i]))
            said = [f"{' with '.join(some)} {_percent(m[i])}" for some, m in most if abs(m[i]) >= SMALL][:MOST]
            if said:
                lines.append(f"    only together: {', '.join(said)}")
        if self.leading is None:
            lines.append(f"  Nothing makes friction depend on the load by {100 * NOTHING:g} % here.")
        else:
            words = next(p.words for p in PROCESSES if p.name == self.leading)
            lines.append(f"  Mostly because {words} ({self.leading}).")
        here, there = (", ".join(map(_percent, self.change(mu))) for mu in (self.alone[HEATING], self.other))
        lines.append(f"  Heating alone: {here}; with the other contact fraction: {there}.  That law is a choice.")
        for p in PROCESSES:
            if p.name not in self.acting:
                found = ", ".join(map(_percent, shares[p.name]))
                lines.append(f"  Not in the case: if {p.words} ({p.key} = {self.values[p.name]}), {found}.")
        waves = f"waves longer than {1e3 * self.skewness_cutoff:g} mm" if self.skewness_cutoff else "all waves"
        lines.append(f"  Skewness is that of {waves} (skewness_cutoff).")
        lines += [f"  At one temperature: {s}." if s.over == "p" else f"  Heating: {s}." for s in self.signs]
        return "\n".join(lines)

    def sheet(self) -> Sheet:
        shares, change = self.shares(), self.change(self.every)
        head = ("speed, m/s", f"mu at {self.pressure[0]:g} Pa", f"mu at {self.pressure[-1]:g} Pa", "change", *NAMES)
        rows = [
            (float(v), float(self.every[i, 0]), float(self.every[i, -1]), _percent(change[i]),
             *(_percent(shares[n][i]) for n in NAMES))
            for i, v in enumerate(self.speed)
        ]  # fmt: skip
        tried = [f"{n} is not in the case: tried with a typical value" for n in NAMES if n not in self.acting]
        tried += map(str, self.signs)
        return Sheet(f"Friction over load '{self.title}', contact fraction {self.law}", rows, head, tried)


def _percent(change: float) -> str:
    return f"{100 * math.expm1(change):+.1f} %"


def attribute(
    case: cases.Case, pressures=PRESSURES, speeds=SPEEDS, workers: int | None = None,
    watch: Callable[[int, int], Any] = lambda done, total: None,
) -> Loads:  # fmt: skip
    """Simulate a case over pressures (Pa, rising) and speeds (m/s) with every set of its processes.

    A process that the case does not have is tried with a typical value, in all sets with those of the case.
    Raises BadInput where the case has no theory of friction, SolverFailure where a run fails.
    """
    scene, effect = theory_of(case)
    table = effect.name
    given = {p.name: case[f"{table}.{p.key}"] for p in PROCESSES if p.key}
    acting = tuple(p.name for p in PROCESSES if not p.key or given[p.name] != p.off)
    on = {p.name: given[p.name] if p.name in acting else p.on for p in PROCESSES if p.key}

    def switched(names) -> tuple[dict[str, Any], bool]:
        keys = {f"{table}.{p.key}": on[p.name] if p.name in names else p.off for p in PROCESSES if p.key}
        return keys, HEATING in names

    players = [acting, *(tuple(m for m in NAMES if m in acting or m == n) for n in NAMES if n not in acting)]
    wanted = {some: switched(some) for names in players for some in subsets(names)}
    other = switched((HEATING,))[0] | _other_law(case, scene, effect), True
    loads = tuple(float(p) for p in pressures)
    asked = [
        Asked(case.with_values(overrides | QUIET | {"schedule.speed": float(v)}), loads, not heated)
        for overrides, heated in (*wanted.values(), other)
        for v in speeds
    ]
    found = np.empty((len(asked), len(loads)))
    for done, (k, answer) in enumerate(stream(frictions, asked, workers), 1):
        if isinstance(answer, FlashtempError):
            raise answer
        found[k] = answer
        watch(done, len(asked))
    tables = found.reshape(-1, len(speeds), len(pressures))
    mu = dict(zip(wanted, tables, strict=False))
    return Loads(
        case.title, np.array(pressures, dtype=float), np.array(speeds, dtype=float), acting, on, mu, tables[-1],
        _law(case, effect), case[f"{table}.skewness_cutoff"],
    )  # fmt: skip


def _law(case: cases.Case, acting: Acting) -> str:
    """The law of the contact fraction in words."""
    if acting.p.spots == "theory":
        return "P(2 pi/D) of the theory, about proportional to the load"
    n = case["contact.spot_exponent"]
    return "fixed" if n == 0 else f"proportional to the load to the power {n:g}"


def _other_law(case: cases.Case, scene: Scene, acting: Acting) -> dict[str, Any]:
    """Overrides for the other extreme: fixed spots where they grow with the load, growing ones where they are fixed."""
    if acting.p.spots != "theory" and case["contact.spot_exponent"] == 0:
        return {f"{acting.name}.spots": "theory"}
    phi = case["contact.spot_fraction"]
    if acting.p.spots == "theory":
        wave = 2 * np.pi / scene.spot_diameter
        phi = float(acting.p.theory.contact(wave, np.sqrt(np.prod(scene.speeds)), scene.ambient, scene.load))
    return {f"{acting.name}.spots": "given", "contact.spot_exponent": 0.0, "contact.spot_fraction": phi}


def refuse_values(option: str, values: Sequence[float], fewest: int, text: str | None = None) -> None:
    """BadInput unless there are at least `fewest` rising positive numbers; `text` is how they were given."""
    rising = all(b > a for a, b in itertools.pairwise(values))
    if len(values) < fewest or not rising or not all(0 < a < 1e9 for a in values):
        text = text or ",".join(f"{v:g}" for v in values)
        raise BadInput(f"{option}: {text}; give at least {fewest} rising numbers > 0, between commas")
