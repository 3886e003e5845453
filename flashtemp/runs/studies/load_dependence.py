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

from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import BadInput, FlashtempError, RenamedAttribute, SolverFailure
from flashtemp.model import case as cases
from flashtemp.model.build import find_theory
from flashtemp.model.scene import ActiveEffect, Scene
from flashtemp.runs.results.worker_pool import stream_results
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.march import march
from flashtemp.solver.system import PhaseSystem

NEGLIGIBLE_LN_CHANGE = 0.01  # change of friction over the loads below which nothing needs a cause
MIN_INTERACTION_LN, MAX_SHOWN_INTERACTIONS = (
    1e-3,
    3,
)  # what processes change only together is told from this change on, the largest few
MINIMAL_OUTPUT = {"output.profiles": 2, "output.fields": 2}  # only the end counts
DEFAULT_PRESSURES_PA, DEFAULT_SPEEDS_M_S = (5e4, 1e5, 2e5, 3e5), (0.1, 0.5, 1.0)


@dataclass(frozen=True)
class FrictionProcess:
    """A process with the key of the theory's table that switches it: its value off, and a typical one where it acts."""

    name: str
    words: str
    key: str | None
    off: Any = None
    on: Any = None


HEATING = "heating"
PROCESSES = (
    FrictionProcess("saturation", "the contact saturates", "saturation", False, True),
    FrictionProcess("softening", "filled rubber softens with strain", "payne_rest", 1.0, 0.4),
    FrictionProcess("skewness", "the road's tops are flattened", "flattened", 1.0, 0.838166),
    FrictionProcess("adhesion", "adhesion pulls rubber into contact", "work_of_adhesion", 0.0, 0.05),
    FrictionProcess(HEATING, "friction heats the contact", None),
)
PROCESS_NAMES = tuple(p.name for p in PROCESSES)


@dataclass(frozen=True)
class LoadCase:
    """A case at some nominal pressures (Pa), and whether heating is to be left out of it."""

    case: cases.Case
    pressures: tuple[float, ...]
    cold: bool


def compute_load_frictions(load_case: LoadCase) -> list[float]:
    """Friction at each of the pressures: they share the theory's table.  Raises SolverFailure that names the point."""
    found = []
    for p in load_case.pressures:
        point = load_case.case.with_values({"contact.pressure": p})
        try:
            found.append(compute_case_friction(point, load_case.cold))
        except SolverFailure as fault:
            raise SolverFailure(f"at {point['schedule.speed']:g} m/s, {p:g} Pa: {fault}") from fault
    return found


def compute_case_friction(case: cases.Case, cold: bool) -> float:
    """Load-weighted friction at the end of the last repetition; `cold`: all is at the ambient temperature."""
    scene = case.scene
    if not cold:
        run = march(scene, case.settings, case.title)
        return float(run.friction[run.last_sliding_index])
    phase = [phase for phase in scene.schedule.phases if phase.sliding][-1]
    system = PhaseSystem(HeatBalance(scene), phase)
    now, y = system.moment(phase.end), system.b.initial_state()
    state, press, *_ = system.solve_contact(now, y)
    T = np.full(len(press.pressure), now.ambient)
    mu = system.b.laws("friction.mu", 0.0, T, system.interface.moment_at_contact(state, now)._replace(face=T)) + 0.0 * T
    load = press.pressure * scene.mesh.column_area
    return float(mu @ load / load.sum())


ProcessNames = tuple[str, ...]  # processes, in the order of NAMES


def list_subsets(names: ProcessNames) -> list[ProcessNames]:
    """All sets of some processes, the empty one first."""
    return [some for n in range(len(names) + 1) for some in itertools.combinations(names, n)]


@dataclass(frozen=True, eq=False, repr=False)
class LoadDependence(DisplayMixin):
    """mu over speeds (m/s) and nominal pressures (Pa): arrays (speeds, pressures) by what acts.

    `acting` processes of the case, with `values` {process: value of its key}; those that do not act were tried beside
    them, one at a time, with typical values.  `mu` {processes: mu} of every set of them; `other` heating alone under
    the other law of the contact fraction, which is `law`.  `skewness_cutoff` (m) is the shortest wave that skewness
    flattens, 0 all.  `signs` (`sign_of_friction.Sign`) say what of it may turn.
    """

    title: str
    pressure: np.ndarray
    speed: np.ndarray
    acting: ProcessNames
    values: dict[str, Any]
    mu: dict[ProcessNames, np.ndarray]
    other: np.ndarray
    law: str
    skewness_cutoff: float = 0.0
    signs: tuple[Any, ...] = ()

    @property
    def without_processes(self) -> np.ndarray:
        """mu without any of the processes."""
        return self.mu[()]

    @property
    def all_processes(self) -> np.ndarray:
        """mu of the case itself."""
        return self.mu[self.acting]

    @property
    def one_process(self) -> dict[str, np.ndarray]:
        """{process: mu} with that process only."""
        return {n: self.mu[(n,)] for n in PROCESS_NAMES}

    @property
    def all_but_one(self) -> dict[str, np.ndarray]:
        """{process: mu} of the case without it, where it acts there, else of the case with it."""
        return {n: self.mu[tuple(m for m in PROCESS_NAMES if (m in self.acting) != (m == n))] for n in PROCESS_NAMES}

    def log_change(self, mu: np.ndarray) -> np.ndarray:
        """Change of ln mu (speeds,) from the lowest to the highest load."""
        return np.log(mu[:, -1] / mu[:, 0])

    def shapley_shares(self) -> dict[str, np.ndarray]:
        """Shapley's share of each process in the change of ln mu (speeds,).

        Those of the case sum to its change, but for what `without_processes` changes; one that it does not have shares in the case
        with it.
        """
        return self._shapley_shares(self.log_change)

    def stepwise_shares(self) -> dict[str, np.ndarray]:
        """The same (speeds, pressures - 1), from each load to the next."""
        return self._shapley_shares(lambda mu: np.diff(np.log(mu), axis=1))

    def interactions(self) -> dict[ProcessNames, np.ndarray]:
        """What only processes of the case together change in ln mu (speeds,), by sets of two and more."""
        return {some: v for some, v in self._harsanyi_dividends(self.acting, self.log_change).items() if len(some) > 1}

    def lone_changes(self) -> dict[str, np.ndarray]:
        """What each process changes in ln mu (speeds,) when nothing else acts."""
        return {n: self.log_change(mu) - self.log_change(self.without_processes) for n, mu in self.one_process.items()}

    def _harsanyi_dividends(self, names: ProcessNames, change) -> dict[ProcessNames, np.ndarray]:
        """{some: what only all of them together add} for all sets of `names`; of the empty one what `without_processes` changes."""
        found: dict[ProcessNames, np.ndarray] = {}
        for some in list_subsets(names):
            found[some] = change(self.mu[some]) - sum(found[part] for part in list_subsets(some)[:-1])
        return found

    def _shapley_shares(self, change) -> dict[str, np.ndarray]:
        out = {}
        for n in PROCESS_NAMES:
            players = tuple(m for m in PROCESS_NAMES if m in self.acting or m == n)
            parts = self._harsanyi_dividends(players, change)
            out[n] = np.sum([v / len(some) for some, v in parts.items() if n in some], axis=0)
        return out

    @property
    def leading_process(self) -> str | None:
        """The process of the case that changes most over all speeds; None where the load does not matter."""
        if np.max(np.abs(self.log_change(self.all_processes))) < NEGLIGIBLE_LN_CHANGE:
            return None
        return max(self.acting, key=lambda n: float(np.abs(self.shapley_shares()[n]).mean()))

    def as_dict(self) -> dict:
        """For --json."""
        curves = {"none": self.without_processes, "every": self.all_processes, "other": self.other}
        plain = {key: values.tolist() for key, values in curves.items()}
        by_process = {"alone": self.one_process, "beside": self.all_but_one}
        sets = {key: {n: v.tolist() for n, v in values.items()} for key, values in by_process.items()}
        return {
            "title": self.title, "pressure_Pa": self.pressure.tolist(), "speed_m_s": self.speed.tolist(),
            "contact_fraction": self.law, "skewness_cutoff_m": self.skewness_cutoff,
            "leading": self.leading_process, "acting": list(self.acting), "values": self.values,
            "ln_change": self.log_change(self.all_processes).tolist(),
            "ln_shares": {n: v.tolist() for n, v in self.shapley_shares().items()},
            "ln_shares_from_load_to_load": {n: v.tolist() for n, v in self.stepwise_shares().items()},
            "ln_alone": {n: v.tolist() for n, v in self.lone_changes().items()},
            "ln_together": {" + ".join(some): v.tolist() for some, v in self.interactions().items()},
            "words": {p.name: p.words for p in PROCESSES}, "mu": plain | sets,
            "signs": [s.as_dict() for s in self.signs],
        }  # fmt: skip

    def save(self, file: Path) -> None:
        """A CSV row per speed and pressure."""
        columns = {
            "case": self.all_processes,
            "none": self.without_processes,
            f"{HEATING}_other_contact_fraction": self.other,
        }
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
        shares, own = self.shapley_shares(), self.lone_changes()
        for i, v in enumerate(self.speed):
            parts = ", ".join(
                f"{n} {_format_percent(shares[n][i])} (alone {_format_percent(own[n][i])})" for n in self.acting
            )
            change = f"{self.all_processes[i, 0]:.3f} -> {self.all_processes[i, -1]:.3f} ({_format_percent(self.log_change(self.all_processes)[i])})"
            lines.append(f"  {v:g} m/s: mu {change}: {parts}")
            most = sorted(self.interactions().items(), key=lambda item: -abs(item[1][i]))
            said = [
                f"{' with '.join(some)} {_format_percent(m[i])}" for some, m in most if abs(m[i]) >= MIN_INTERACTION_LN
            ][:MAX_SHOWN_INTERACTIONS]
            if said:
                lines.append(f"    only together: {', '.join(said)}")
        if self.leading_process is None:
            lines.append(f"  Nothing makes friction depend on the load by {100 * NEGLIGIBLE_LN_CHANGE:g} % here.")
        else:
            words = next(p.words for p in PROCESSES if p.name == self.leading_process)
            lines.append(f"  Mostly because {words} ({self.leading_process}).")
        here, there = (
            ", ".join(map(_format_percent, self.log_change(mu))) for mu in (self.one_process[HEATING], self.other)
        )
        lines.append(f"  Heating alone: {here}; with the other contact fraction: {there}.  That law is a choice.")
        for p in PROCESSES:
            if p.name not in self.acting:
                found = ", ".join(map(_format_percent, shares[p.name]))
                lines.append(f"  Not in the case: if {p.words} ({p.key} = {self.values[p.name]}), {found}.")
        waves = f"waves longer than {1e3 * self.skewness_cutoff:g} mm" if self.skewness_cutoff else "all waves"
        lines.append(f"  Skewness is that of {waves} (skewness_cutoff).")
        lines += [f"  At one temperature: {s}." if s.over == "p" else f"  Heating: {s}." for s in self.signs]
        return "\n".join(lines)

    def to_table(self) -> DisplayTable:
        shares, change = self.shapley_shares(), self.log_change(self.all_processes)
        head = (
            "speed, m/s",
            f"mu at {self.pressure[0]:g} Pa",
            f"mu at {self.pressure[-1]:g} Pa",
            "change",
            *PROCESS_NAMES,
        )
        rows = [
            (float(v), float(self.all_processes[i, 0]), float(self.all_processes[i, -1]), _format_percent(change[i]),
             *(_format_percent(shares[n][i]) for n in PROCESS_NAMES))
            for i, v in enumerate(self.speed)
        ]  # fmt: skip
        tried = [f"{n} is not in the case: tried with a typical value" for n in PROCESS_NAMES if n not in self.acting]
        tried += map(str, self.signs)
        return DisplayTable(f"Friction over load '{self.title}', contact fraction {self.law}", rows, head, tried)

    shares = RenamedAttribute("shapley_shares")


def _format_percent(change: float) -> str:
    return f"{100 * math.expm1(change):+.1f} %"


def attribute_load_dependence(
    case: cases.Case, pressures=DEFAULT_PRESSURES_PA, speeds=DEFAULT_SPEEDS_M_S, workers: int | None = None,
    watch: Callable[[int, int], Any] = lambda done, total: None,
) -> LoadDependence:  # fmt: skip
    """Simulate a case over pressures (Pa, rising) and speeds (m/s) with every set of its processes.

    A process that the case does not have is tried with a typical value, in all sets with those of the case.
    Raises BadInput where the case has no theory of friction, SolverFailure where a run fails.
    """
    scene, effect = find_theory(case)
    table = effect.name
    given = {p.name: case[f"{table}.{p.key}"] for p in PROCESSES if p.key}
    acting = tuple(p.name for p in PROCESSES if not p.key or given[p.name] != p.off)
    on = {p.name: given[p.name] if p.name in acting else p.on for p in PROCESSES if p.key}

    def switch_processes(names) -> tuple[dict[str, Any], bool]:
        keys = {f"{table}.{p.key}": on[p.name] if p.name in names else p.off for p in PROCESSES if p.key}
        return keys, HEATING in names

    players = [
        acting,
        *(tuple(m for m in PROCESS_NAMES if m in acting or m == n) for n in PROCESS_NAMES if n not in acting),
    ]
    wanted = {some: switch_processes(some) for names in players for some in list_subsets(names)}
    other = switch_processes((HEATING,))[0] | _other_law(case, scene, effect), True
    loads = tuple(float(p) for p in pressures)
    asked = [
        LoadCase(case.with_values(overrides | MINIMAL_OUTPUT | {"schedule.speed": float(v)}), loads, not heated)
        for overrides, heated in (*wanted.values(), other)
        for v in speeds
    ]
    found = np.empty((len(asked), len(loads)))
    for done, (k, answer) in enumerate(stream_results(compute_load_frictions, asked, workers), 1):
        if isinstance(answer, FlashtempError):
            raise answer
        found[k] = answer
        watch(done, len(asked))
    tables = found.reshape(-1, len(speeds), len(pressures))
    mu = dict(zip(wanted, tables, strict=False))
    return LoadDependence(
        case.title, np.array(pressures, dtype=float), np.array(speeds, dtype=float), acting, on, mu, tables[-1],
        _contact_fraction_words(case, effect), case[f"{table}.skewness_cutoff"],
    )  # fmt: skip


def _contact_fraction_words(case: cases.Case, acting: ActiveEffect) -> str:
    """The law of the contact fraction in words."""
    if acting.p.spots == "theory":
        return "P(2 pi/D) of the theory, about proportional to the load"
    n = case["contact.spot_exponent"]
    return "fixed" if n == 0 else f"proportional to the load to the power {n:g}"


def _other_law(case: cases.Case, scene: Scene, acting: ActiveEffect) -> dict[str, Any]:
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
