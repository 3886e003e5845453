"""Scenes of a few parts for tests of the solver, handed out by the fixture `lab`."""

from __future__ import annotations

import os
import signal
import sys
from collections import Counter, defaultdict
from fnmatch import fnmatchcase
from itertools import pairwise
from math import log2
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.meshes.grading import geometric
from flashtemp.meshes.mesh import Mesh
from flashtemp.model.case import assemble_case
from flashtemp.model.case_file import KeyLocations
from flashtemp.model.numerics import SolverSettings, choose_binding
from flashtemp.model.scene import ActiveEffect, Scene
from flashtemp.model.schedule import Schedule, constant_series
from flashtemp.physics.effect import Effect, Heat, Term
from flashtemp.physics.material import LIBRARY, Material
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.system import PhaseSystem
from flashtemp.solver.time_integration import integrate_schedule

RUBBER, ROAD, L = LIBRARY["tread_rubber"], LIBRARY["asphalt"], 0.025
# the effusivities of road and rubber with 1e-4 and 1e-8 of their diffusivity: V8 and V15 neglect conduction along x
THIN_ROAD = Material(1e-2 * ROAD.conductivity, 1e2 * ROAD.density, ROAD.heat_capacity)
FILM_ROAD = Material(1e-4 * ROAD.conductivity, 1e4 * ROAD.density, ROAD.heat_capacity)
FILM_RUBBER = Material(1e-4 * RUBBER.conductivity, 1e4 * RUBBER.density, RUBBER.heat_capacity)
NO_BLOCK, NO_ROAD = Material(1e-12, 1200.0, 1700.0), Material(1e-12, 2300.0, 950.0)  # take no heat
LONGEST = "test_independent.py"
LEAK = 1e-12  # relative energy imbalance that rounding may leave


def pytest_configure():
    """Shells let what they start in the background ignore Ctrl-C, and its children inherit that; and what a command
    says on a slow machine is no more than on a fast one."""
    os.environ.setdefault("FLASHTEMP_PROGRESS", "1e4")
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def check(label: str, error: float, bound: float) -> None:
    """An error and its bound, printed for the table of docs/explanation/verification.md."""
    print(f"{label}: {error:.3g} <= {bound:.3g}")
    assert error <= bound, label


class Given(Effect):
    """Contributions that a test states itself."""

    def __init__(self, *parts):
        self.parts = parts

    def heat(self, scene, p):
        yield Heat.film("block.holder", lambda now, p: 0.0)
        yield from self.parts


def number(target: str, value: float) -> Term:
    return Term(target, lambda T, now, p: value)


APART, MU = number("contact.resistance", 1e30), number("friction.mu", 1.0)


def scene(mesh, *parts, rubber=RUBBER, road=ROAD, speed=0.1, pressure=1e5, time=1.0, wait=0.0, lifted=True, phi=1.0):
    """Only what `parts` state acts: effects as (Effect, {parameter: value}), everything else as contributions."""
    effects = [
        (e, {k: v.value for k, v in e.params().items()} | own) for e, own in (p for p in parts if type(p) is tuple)
    ]
    own = Given(number("contact.spot_fraction", phi), *(p for p in parts if type(p) is not tuple))
    acting = [ActiveEffect(type(e).__name__, e, SimpleNamespace(**values)) for e, values in [(own, {}), *effects]]
    plan = Schedule(constant_series(speed), constant_series(pressure), speed * time, 2 if wait else 1, wait, lifted)
    return Scene(
        mesh=mesh, block=rubber, road=road, schedule=plan, acting=tuple(acting), ambient=KELVIN,
        length=float(mesh.x[mesh.last]), height=float(mesh.height[-1]), spot_diameter=3e-3,
    )  # fmt: skip


def slide(scene, warm=0.0, rtol=1e-7, phase=0, profiles=4):
    """March from a block that is `warm` (K) above ambient; the Run and the cells' final rises."""
    balance = HeatBalance(scene)
    y = np.zeros(balance.size)
    warm = np.asarray(warm)
    y[scene.mesh.everywhere(scene.mesh.block)] = warm[..., None] if warm.ndim == 2 else warm
    start = scene.schedule.phases[phase].begin
    state = IntegrationState(t=start, phase=phase, y=y, removed_heat=-np.array(balance.stored_heat(y)))
    run = integrate_schedule(scene, SolverSettings(choose_binding(None), rtol, profiles=profiles), state=state)
    assert run.energy_imbalance < LEAK
    return run, state.y[: balance.n]


def fluxes(scene, rise):
    """Fluxes and temperatures of the contact at the end of the schedule."""
    system = PhaseSystem(HeatBalance(scene), scene.schedule.phases[-1])
    now = system.law_context(scene.schedule.end_time)
    return system.interface.solve_contact(now, 0.0, rise, system.incoming_road(now), system.b.ones).flux


def column(cells, height, first, refine=1):
    """Block without ends (1 km), so that all is one-dimensional; the road below is a dummy."""
    return Mesh(np.array([0.0, 500.0, 1000.0]), geometric(1e-3, 1e-4, 4), geometric(height, first, cells, refine), 0, 2)


def orders(errors):
    """Observed orders of accuracy between meshes that double."""
    return [log2(a / b) for a, b in pairwise(errors)]


def check_second_order(label, errors, bound):
    print(f"{label}: observed order", ", ".join(f"{p:.3f}" for p in orders(errors)))
    assert orders(errors) == pytest.approx([2.0] * (len(errors) - 1), abs=0.1)
    check(label, errors[-1], bound)


def case(**given):
    """A case assembled from overrides alone, table__key=value, and its run."""
    made = assemble_case(
        {}, {k.replace("__", "."): v for k, v in given.items()}, KeyLocations("none"), Path(), "verification"
    )
    run = integrate_schedule(made.scene, made.settings)
    assert run.energy_imbalance < LEAK
    return run


@pytest.fixture(scope="session")
def lab():
    """Everything above, for tests that cannot import from here."""
    return SimpleNamespace(**globals())


@pytest.fixture(scope="session")
def calibrate():
    """A campaign as discovery has it before it looks for causes: recordings corrected, the stated model calibrated."""
    from flashtemp.discovery import engine
    from flashtemp.discovery.prediction.prediction import predict_condition
    from flashtemp.discovery.prediction.problem import prepare_problem
    from flashtemp.runs.results.worker_pool import open_worker_pool

    def made(campaign):
        with open_worker_pool(predict_condition, 1) as run:
            problem, errors, first = engine.correct_measurements(prepare_problem(campaign, run), lambda text: None)
            problem, data, base = engine.calibrate_base(problem, first, lambda text: None)
        return SimpleNamespace(problem=problem, data=data, base=base, recording_errors=errors)

    return made


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark as long the parameters that a `sample` leaves out; every pattern of it has to fit one.  The longest file is
    begun first, so that no process waits for it alone."""
    items.sort(key=lambda item: item.path.name != LONGEST)
    sampled = defaultdict(list)
    for item in items:
        if (mark := item.get_closest_marker("sample")) is not None:
            name = item.callspec.id
            sampled[item.nodeid.partition("[")[0], mark.args].append(name)
            if not any(fnmatchcase(name, pattern) for pattern in mark.args):
                item.add_marker("long")
    if any("::" in str(given) for given in config.args):  # not all are here
        return
    for (test, patterns), names in sampled.items():
        for pattern in patterns:
            if not any(fnmatchcase(name, pattern) for name in names):
                raise pytest.UsageError(f"{test}: no parameters fit the sample {pattern!r}")


def pytest_terminal_summary(terminalreporter, config):
    """With --durations also the seconds of every folder and file, summed over processes."""
    if config.getoption("durations") is None:
        return
    seconds: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for report in (
        r for kind in ("passed", "failed", "error", "skipped", "") for r in terminalreporter.getreports(kind)
    ):
        file = Path(report.fspath)
        seconds[file.parent.name][file.stem] += getattr(report, "duration", 0.0)  # a file that fails to load has none
    terminalreporter.section("seconds of every folder")
    for folder, files in sorted(seconds.items()):
        parts = ", ".join(f"{name.removeprefix('test_')} {spent:.0f}" for name, spent in files.most_common())
        terminalreporter.line(f"{sum(files.values()):6.0f}  {folder}: {parts}")


@pytest.fixture(scope="session")
def discovery_benchmark():
    """Modules of the benchmark of discovery: its campaigns, its count of outcomes, its stored evidence and the replay."""
    before = list(sys.path)
    sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
    try:
        import campaigns
        import criteria_replay
        import discover
        import stored_evidence
    finally:
        sys.path[:] = before
    return SimpleNamespace(campaigns=campaigns, replay=criteria_replay, discover=discover, stored=stored_evidence)
