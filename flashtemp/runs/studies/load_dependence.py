"""Attribution of the load dependence of friction to processes, by their Shapley values.

Five processes are considered: saturation of the contact, non-linear viscoelasticity, skewness of the roughness,
adhesion that enlarges the contact, and frictional heating.  The first four act on the friction theory, heating acts on
the temperatures of the solver.  Every subset S of the processes is simulated.  It changes ln mu over the loads by v(S);
the part that only all of S together contribute is the Harsanyi dividend m(S).  The Shapley value of a process is its
equal part of all dividends: the mean contribution over all orders in which the processes may be added.
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
from flashtemp.solver.system import PhaseSystem
from flashtemp.solver.time_integration import integrate_schedule

NEGLIGIBLE_LN_CHANGE = 0.01  # change of ln mu over the loads below which no process is reported
MIN_INTERACTION_LN, MAX_SHOWN_INTERACTIONS = 1e-3, 3  # smallest reported dividend; number of reported dividends
MINIMAL_OUTPUT = {"output.profiles": 2, "output.fields": 2}  # only the end of a run is used
DEFAULT_PRESSURES_PA, DEFAULT_SPEEDS_M_S = (5e4, 1e5, 2e5, 3e5), (0.1, 0.5, 1.0)


@dataclass(frozen=True)
class FrictionProcess:
    """A process and the `key` of the theory that controls it: value `off`, and typical value `on`; None for heating."""

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
    """A case at several nominal pressures (Pa); `cold`: without frictional heating."""

    case: cases.Case
    pressures: tuple[float, ...]
    cold: bool


def compute_load_frictions(load_case: LoadCase) -> list[float]:
    """Friction at each of the pressures; in one task, because they use one table of the theory.

    Raises SolverFailure with speed and pressure.
    """
    mu = []
    for p in load_case.pressures:
        point = load_case.case.with_values({"contact.pressure": p})
        try:
            mu.append(compute_case_friction(point, load_case.cold))
        except SolverFailure as fault:
            raise SolverFailure(f"at {point['schedule.speed']:g} m/s, {p:g} Pa: {fault}") from fault
    return mu


def compute_case_friction(case: cases.Case, cold: bool) -> float:
    """Load-weighted friction at the end of the last repetition; `cold`: everything at ambient temperature."""
    scene = case.scene
    if not cold:
        run = integrate_schedule(scene, case.settings, case.title)
        return float(run.friction[run.last_sliding_index])
    phase = [phase for phase in scene.schedule.phases if phase.sliding][-1]
    system = PhaseSystem(HeatBalance(scene), phase)
    now, y = system.law_context(phase.end), system.b.initial_state()
    state, press, *_ = system.solve_contact(now, y)
    T = np.full(len(press.pressure), now.ambient)
    mu = (
        system.b.laws("friction.mu", 0.0, T, system.interface.context_at_contact(state, now)._replace(face=T)) + 0.0 * T
    )
    load = press.pressure * scene.mesh.column_area
    return float(mu @ load / load.sum())


ProcessNames = tuple[str, ...]  # processes in the order of PROCESS_NAMES


def list_subsets(names: ProcessNames) -> list[ProcessNames]:
    """All subsets of the processes, the empty one first."""
    return [subset for n in range(len(names) + 1) for subset in itertools.combinations(names, n)]


@dataclass(frozen=True, eq=False, repr=False)
class LoadDependence(DisplayMixin):
    """Friction over speeds (m/s) and nominal pressures (Pa) for every subset of processes.

    `acting`: processes of the case; the others were added one at a time with typical values.  `values` {process: value
    of its key}.  `mu` {subset: array (speeds, pressures)}; `other`: the same for heating alone with the alternative law
    of the contact fraction, whose law in the case is `law`.  `skewness_cutoff`: shortest wavelength that skewness
    flattens, m, 0 for all.  `signs`: trends (`FrictionTrend`) with temperature and load.
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
        """mu of the case itself, with all its processes."""
        return self.mu[self.acting]

    @property
    def one_process(self) -> dict[str, np.ndarray]:
        """{process: mu} with that process only."""
        return {n: self.mu[(n,)] for n in PROCESS_NAMES}

    @property
    def all_but_one(self) -> dict[str, np.ndarray]:
        """{process: mu} of the case without a process it has, or with a process it does not have."""
        return {n: self.mu[tuple(m for m in PROCESS_NAMES if (m in self.acting) != (m == n))] for n in PROCESS_NAMES}

    def log_change(self, mu: np.ndarray) -> np.ndarray:
        """Change of ln mu (speeds,) from the lowest to the highest load."""
        return np.log(mu[:, -1] / mu[:, 0])

    def shapley_shares(self) -> dict[str, np.ndarray]:
        """The Shapley value of each process in the change of ln mu (speeds,).

        The values of the processes of the case add up to its change minus that `without_processes`.  The value of any
        other process is that in the case extended by it.
        """
        return self._shapley_shares(self.log_change)

    def stepwise_shares(self) -> dict[str, np.ndarray]:
        """Shapley values from each load to the next, (speeds, pressures - 1)."""
        return self._shapley_shares(lambda mu: np.diff(np.log(mu), axis=1))

    def interactions(self) -> dict[ProcessNames, np.ndarray]:
        """Harsanyi dividends of all subsets of two or more processes of the case, in ln mu (speeds,)."""
        dividends = self._harsanyi_dividends(self.acting, self.log_change)
        return {subset: v for subset, v in dividends.items() if len(subset) > 1}

    def lone_changes(self) -> dict[str, np.ndarray]:
        """Change of ln mu (speeds,) by each process when no other acts."""
        return {n: self.log_change(mu) - self.log_change(self.without_processes) for n, mu in self.one_process.items()}

    def _harsanyi_dividends(self, names: ProcessNames, change) -> dict[ProcessNames, np.ndarray]:
        """{subset: Harsanyi dividend} of all subsets of `names`; the empty one has the change without processes."""
        dividends: dict[ProcessNames, np.ndarray] = {}
        for subset in list_subsets(names):  # smaller subsets come first
            dividends[subset] = change(self.mu[subset]) - sum(dividends[part] for part in list_subsets(subset)[:-1])
        return dividends

    def _shapley_shares(self, change) -> dict[str, np.ndarray]:
        out = {}
        for n in PROCESS_NAMES:
            players = tuple(m for m in PROCESS_NAMES if m in self.acting or m == n)
            dividends = self._harsanyi_dividends(players, change)
            out[n] = np.sum([v / len(subset) for subset, v in dividends.items() if n in subset], axis=0)
        return out

    @property
    def leading_process(self) -> str | None:
        """The process of the case with the largest Shapley value; None where friction hardly depends on load."""
        if np.max(np.abs(self.log_change(self.all_processes))) < NEGLIGIBLE_LN_CHANGE:
            return None
        return max(self.acting, key=lambda n: float(np.abs(self.shapley_shares()[n]).mean()))

    def as_dict(self) -> dict:
        """All numbers as plain data."""
        plain = {"none": self.without_processes, "every": self.all_processes, "other": self.other}
        sets = {"alone": self.one_process, "beside": self.all_but_one}
        mu: dict[str, Any] = {k: v.tolist() for k, v in plain.items()}
        mu |= {k: {n: v.tolist() for n, v in arrays.items()} for k, arrays in sets.items()}
        return {
            "title": self.title, "pressure_Pa": self.pressure.tolist(), "speed_m_s": self.speed.tolist(),
            "contact_fraction": self.law, "skewness_cutoff_m": self.skewness_cutoff,
            "leading": self.leading_process, "acting": list(self.acting), "values": self.values,
            "ln_change": self.log_change(self.all_processes).tolist(),
            "ln_shares": {n: v.tolist() for n, v in self.shapley_shares().items()},
            "ln_shares_from_load_to_load": {n: v.tolist() for n, v in self.stepwise_shares().items()},
            "ln_alone": {n: v.tolist() for n, v in self.lone_changes().items()},
            "ln_together": {" + ".join(subset): v.tolist() for subset, v in self.interactions().items()},
            "words": {p.name: p.words for p in PROCESSES}, "mu": mu,
            "signs": [s.as_dict() for s in self.signs],
        }  # fmt: skip

    def save(self, file: Path) -> None:
        """Write a CSV file with one row per speed and pressure."""
        columns = {
            "case": self.all_processes,
            "none": self.without_processes,
            f"{HEATING}_other_contact_fraction": self.other,
        }
        columns |= {f"only_{'_'.join(s)}": v for s, v in self.mu.items() if s and s != self.acting}
        with Path(file).open("w", newline="", encoding="utf-8") as out:
            rows = csv.writer(out)
            rows.writerow(["speed_m_s", "pressure_Pa", *(f"mu_{name}" for name in columns)])
            for i, v in enumerate(self.speed):
                for j, p in enumerate(self.pressure):
                    rows.writerow([f"{v:g}", f"{p:g}", *(f"{values[i, j]:.6f}" for values in columns.values())])

    def __str__(self) -> str:
        low, high = self.pressure[0] / 1e6, self.pressure[-1] / 1e6
        lines = [f"Friction over load '{self.title}', {low:g} to {high:g} MPa; contact fraction {self.law}"]
        shares, lone = self.shapley_shares(), self.lone_changes()
        total = self.log_change(self.all_processes)
        for i, v in enumerate(self.speed):
            parts = ", ".join(
                f"{n} {_format_percent(shares[n][i])} (alone {_format_percent(lone[n][i])})" for n in self.acting
            )
            ends = f"{self.all_processes[i, 0]:.3f} -> {self.all_processes[i, -1]:.3f}"
            lines.append(f"  {v:g} m/s: mu {ends} ({_format_percent(total[i])}): {parts}")
            largest = sorted(self.interactions().items(), key=lambda item: -abs(item[1][i]))
            reported = [(s, m[i]) for s, m in largest if abs(m[i]) >= MIN_INTERACTION_LN][:MAX_SHOWN_INTERACTIONS]
            if reported:
                texts = (f"{' with '.join(s)} {_format_percent(m)}" for s, m in reported)
                lines.append(f"    only together: {', '.join(texts)}")
        if self.leading_process is None:
            lines.append(f"  Friction depends on the load by less than {100 * NEGLIGIBLE_LN_CHANGE:g} %.")
        else:
            words = next(p.words for p in PROCESSES if p.name == self.leading_process)
            lines.append(f"  Mostly because {words} ({self.leading_process}).")
        own_law, other_law = (
            ", ".join(map(_format_percent, self.log_change(mu))) for mu in (self.one_process[HEATING], self.other)
        )
        lines.append(f"  Heating alone: {own_law}; with the alternative law of the contact fraction: {other_law}.")
        for p in PROCESSES:
            if p.name not in self.acting:
                changes = ", ".join(map(_format_percent, shares[p.name]))
                lines.append(f"  Not in the case: if {p.words} ({p.key} = {self.values[p.name]}), {changes}.")
        waves = f"wavelengths above {1e3 * self.skewness_cutoff:g} mm" if self.skewness_cutoff else "all wavelengths"
        lines.append(f"  Skewness includes {waves} (skewness_cutoff).")
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
        notes = [f"{n} is not in the case: added with a typical value" for n in PROCESS_NAMES if n not in self.acting]
        notes += map(str, self.signs)
        return DisplayTable(f"Friction over load '{self.title}', contact fraction {self.law}", rows, head, notes)

    shares = RenamedAttribute("shapley_shares")


def _format_percent(change: float) -> str:
    return f"{100 * math.expm1(change):+.1f} %"


def attribute_load_dependence(
    case: cases.Case, pressures=DEFAULT_PRESSURES_PA, speeds=DEFAULT_SPEEDS_M_S, workers: int | None = None,
    watch: Callable[[int, int], Any] = lambda done, total: None,
) -> LoadDependence:  # fmt: skip
    """Simulate a case over pressures (Pa, ascending) and speeds (m/s) with every subset of its processes.

    A process that the case does not have is added with a typical value, in all subsets with those of the case.
    Raises BadInput where the case has no friction theory, SolverFailure where a run fails.
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
    subsets = {subset: switch_processes(subset) for names in players for subset in list_subsets(names)}
    other = switch_processes((HEATING,))[0] | _alternative_contact_law(case, scene, effect), True
    loads = tuple(float(p) for p in pressures)
    tasks = [
        LoadCase(case.with_values(overrides | MINIMAL_OUTPUT | {"schedule.speed": float(v)}), loads, not heated)
        for overrides, heated in (*subsets.values(), other)
        for v in speeds
    ]
    frictions = np.empty((len(tasks), len(loads)))
    for done, (k, answer) in enumerate(stream_results(compute_load_frictions, tasks, workers), 1):
        if isinstance(answer, FlashtempError):
            raise answer
        frictions[k] = answer
        watch(done, len(tasks))
    tables = frictions.reshape(-1, len(speeds), len(pressures))
    mu = dict(zip(subsets, tables, strict=False))  # the last table is that of the alternative contact fraction
    return LoadDependence(
        case.title, np.array(pressures, dtype=float), np.array(speeds, dtype=float), acting, on, mu, tables[-1],
        _contact_fraction_words(case, effect), case[f"{table}.skewness_cutoff"],
    )  # fmt: skip


def _contact_fraction_words(case: cases.Case, acting: ActiveEffect) -> str:
    """The law of the contact fraction as text."""
    if acting.p.spots == "theory":
        return "P(2 pi/D) of the theory, about proportional to the load"
    n = case["contact.spot_exponent"]
    return "fixed" if n == 0 else f"proportional to the load to the power {n:g}"


def _alternative_contact_law(case: cases.Case, scene: Scene, acting: ActiveEffect) -> dict[str, Any]:
    """Overrides for the alternative law: a fixed contact fraction where it grows with the load, and vice versa."""
    if acting.p.spots != "theory" and case["contact.spot_exponent"] == 0:
        return {f"{acting.name}.spots": "theory"}
    phi = case["contact.spot_fraction"]
    if acting.p.spots == "theory":
        wave = 2 * np.pi / scene.spot_diameter
        phi = float(acting.p.theory.contact_fraction(wave, np.sqrt(np.prod(scene.speeds)), scene.ambient, scene.load))
    return {f"{acting.name}.spots": "given", "contact.spot_exponent": 0.0, "contact.spot_fraction": phi}


def refuse_values(option: str, values: Sequence[float], fewest: int, text: str | None = None) -> None:
    """Raise BadInput unless there are at least `fewest` positive ascending numbers; `text` is the user's input."""
    ascending = all(b > a for a, b in itertools.pairwise(values))
    if len(values) < fewest or not ascending or not all(0 < a < 1e9 for a in values):
        text = text or ",".join(f"{v:g}" for v in values)
        raise BadInput(f"{option}: {text}; give at least {fewest} ascending numbers > 0, separated by commas")
