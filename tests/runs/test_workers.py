"""Predictions by many hands: order, failures as answers, and no difference between one worker and several."""

from __future__ import annotations

import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import tomllib
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from flashtemp.discovery.hypotheses.candidates import ModelPoint, find_candidates
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.prediction import (
    DerivativeRequest,
    LoadCellEntry,
    Prediction,
    PredictionTask,
    predict_condition,
)
from flashtemp.errors import BadInput, EnergyBalanceError, SolverFailure
from flashtemp.model.case import load_case
from flashtemp.physics.effect import find_effect
from flashtemp.runs.results import worker_pool
from flashtemp.runs.results.worker_pool import call_safely, open_worker_pool

MU = ParameterId.of_key("friction.mu")
SMALL = {
    "block.height": 0.005, "road.depth": 0.01, "schedule.distance": 0.1, "numerics.mesh": 0.3, "output.profiles": 8,
}  # fmt: skip


@pytest.fixture
def tasks(tmp_path):
    """Three small conditions, the second with a block that wears through to its holder at once."""
    file = tmp_path / "case.toml"
    file.write_text("")
    lost = {"effects": ["wear"], "wear.rate": 1e-7, "schedule.speed": 1.0, "contact.pressure": 1e7}
    force = LoadCellEntry("mu.csv", (0.0, 0.05, 0.09), (1.0, 1.0, 1.0))
    out = []
    for given in ({"friction.mu": 0.8}, lost, {"friction.mu": 1.2}):
        out.append(
            PredictionTask(
                load_case(file),
                SMALL | given,
                {},
                ModelPoint({"friction.mu": 0.1}),
                (),
                (force,),
                DerivativeRequest((MU,)),
            )
        )
    return out


def test_a_failure_of_the_computation_is_an_answer():
    def fails(fault):
        raise fault

    for fault in (BadInput("case.toml: a: 1; give 2"), SolverFailure("the heat balance is no longer finite")):
        assert call_safely(fails, fault) is fault
    with pytest.raises(ZeroDivisionError):
        call_safely(lambda n: 1 / n, 0)
    assert call_safely(math.sqrt, 4.0) == 2.0


def test_returned_failure_has_no_chain():
    """Distributed libraries pickle an exception with its chain, which has no limit."""

    def fails(depth):
        try:
            if depth:
                fails(depth - 1)
            raise ZeroDivisionError
        except (ZeroDivisionError, SolverFailure) as fault:
            raise SolverFailure(f"level {depth}") from fault

    fault = call_safely(fails, 5)
    assert str(fault) == "level 5"
    assert fault.__cause__ is None
    assert fault.__context__ is None


def test_energy_balance_error_survives_pickling():
    answer = pickle.loads(pickle.dumps(EnergyBalanceError("the energy balance does not close", {"cells": 3})))
    assert (str(answer), answer.run) == ("the energy balance does not close", {"cells": 3})


@pytest.mark.parametrize("count", [1, 2])
def test_answers_keep_their_order(count):
    asked = [60000, 3, 30000, 2, 1]  # the first takes longest
    with open_worker_pool(math.factorial, count) as run:
        assert run(asked) == [math.factorial(n) for n in asked]
        assert run([]) == []
        assert run([4]) == [24]  # the same hands again


def test_no_process_hears_ctrl_c():
    """A terminal sends it to all of them; each begins deaf, also those that begin after the first."""
    late = "__import__('time').sleep(1.0) or __import__('signal').raise_signal(2)"  # when all have begun
    with open_worker_pool(eval, 3) as run:
        assert run([late] * 4) == [None] * 4


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.sample("1")
def test_failures_come_back_in_their_place(count):
    with open_worker_pool(find_effect, count) as run:
        first, fault, last = run(["friction", "frction", "wear"])
        assert (first, last) == (find_effect("friction"), find_effect("wear"))
        assert isinstance(fault, BadInput)
        assert str(fault) == "effect 'frction' is not in the catalogue; did you mean 'friction'?"
        assert fault.lines == (str(fault),)
        with pytest.raises(AttributeError):  # not a computation that failed: a fault of the program
            run([3.5])


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.long
def test_several_faults_stay_apart(count, tmp_path):
    file = tmp_path / "case.toml"
    file.write_text("[friction]\nmu = -1\n[block]\nheight = -2\n")
    with open_worker_pool(load_case, count) as run:
        [fault] = run([file])
    assert len(fault.lines) == 2
    assert str(fault) == "\n".join(fault.lines)


def same(one, other):
    for file, seen in one.observables.items():
        np.testing.assert_array_equal(other.observables[file].values, seen.values)
        assert other.observables[file].columns.keys() == seen.columns.keys() == {MU}
        for name, values in seen.columns.items():
            np.testing.assert_array_equal(other.observables[file].columns[name], values)
    np.testing.assert_array_equal(other.run.T_block, one.run.T_block)


def test_one_worker_and_two_agree(tasks):
    with open_worker_pool(predict_condition, 1) as alone, open_worker_pool(predict_condition, 2) as both:
        answers = list(zip(alone(tasks), both(tasks), strict=True))
    for one, other in (answers[0], answers[2]):
        assert isinstance(one, Prediction)
        same(one, other)
    fault, again = answers[1]
    assert type(fault) is type(again) is SolverFailure
    assert str(fault) == str(again)
    mu = [a.observables["mu.csv"].values[0] for a, _ in (answers[0], answers[2])]
    assert mu == pytest.approx([0.8 * math.exp(0.1), 1.2 * math.exp(0.1)])


FAN = """
from flashtemp.physics import Effect, Factor, Param


class Fan(Effect):
    cause = "a fan that nobody told of slows the block"
    source = "this test"
    share = Param(0.1, "1", "more friction", -0.5, 1.0, off=0.0)

    def heat(self, scene, p):
        yield Factor("friction.mu", lambda T, now, p: 1.0 + p.share)
"""


@pytest.mark.long
def test_an_effect_of_the_users_own_is_a_candidate_in_every_process(tasks, tmp_path):
    """The case brings the text that was read: no worker looks at the file, or judges whose it is."""
    (tmp_path / "fan.py").write_text(FAN)
    (tmp_path / "case.toml").write_text('candidates = ["./fan.py"]')
    case = load_case(tmp_path / "case.toml", SMALL)
    [fan], left = find_candidates(case, case.candidates)
    assert (fan.strengths, left) == ({"share": 0.1}, {})
    asked = DerivativeRequest((MU,), candidates=(fan,))
    (tmp_path / "fan.py").unlink()
    with open_worker_pool(predict_condition, 2) as run:
        [found] = run([replace(tasks[0], case=case, derivatives=asked)])
    assert isinstance(found, Prediction), found
    columns = found.observables["mu.csv"].columns
    trace = columns[ParameterId.of_effect("fan", "share")]
    assert trace == pytest.approx(columns[MU], rel=1e-3)  # both multiply mu
    assert trace == pytest.approx(found.observables["mu.csv"].values, rel=1e-3)


def test_as_many_as_there_are_cores(monkeypatch):
    monkeypatch.setattr(worker_pool, "cores", lambda: 1)
    with open_worker_pool(lambda n: n + 1) as run:  # could not be sent to another process
        assert run([1, 2]) == [2, 3]


def test_a_process_that_is_killed_is_said():
    with open_worker_pool(signal.raise_signal, 2) as run, pytest.raises(SolverFailure, match="fewer --workers"):
        run([signal.SIGKILL])


# --- a cluster ---------------------------------------------------------------------------------------
def stand_in(monkeypatch, client):
    """dask.distributed with this Client."""
    package, module = ModuleType("dask"), ModuleType("dask.distributed")
    package.distributed, module.Client = module, client
    monkeypatch.setitem(sys.modules, "dask", package)
    monkeypatch.setitem(sys.modules, "dask.distributed", module)


def test_without_dask(monkeypatch):
    for name in ("dask", "dask.distributed"):
        monkeypatch.setitem(sys.modules, name, None)
    with (
        pytest.raises(BadInput, match=r"^--scheduler: .*not installed; pip install") as said,
        open_worker_pool(find_effect, None, "a:1"),
    ):
        pass
    assert len(said.value.lines) == 1
    assert "\n" not in str(said.value)


@pytest.mark.parametrize("fault", [OSError("Timed out\ntrying to connect"), TimeoutError(), ValueError("scheme\nfoo")])
def test_a_scheduler_that_does_not_answer(monkeypatch, fault):
    def client(address, timeout):
        raise fault

    stand_in(monkeypatch, client)
    with pytest.raises(BadInput) as said, open_worker_pool(find_effect, None, "tcp://nowhere:8786"):
        pass
    assert len(said.value.lines) == 1
    assert "\n" not in str(said.value)
    assert "tcp://nowhere:8786" in str(said.value)


@pytest.mark.long
def test_a_scheduler_that_cannot_be_reached():
    pytest.importorskip("distributed", reason="dask.distributed is not installed")
    with pytest.raises(BadInput) as said, open_worker_pool(find_effect, None, "tcp://127.0.0.1:9"):
        pass
    assert len(said.value.lines) == 1


def test_a_cluster_answers_like_one_worker(monkeypatch):
    """Faults come back as answers, order is kept, every prediction is computed anew, and the client is closed."""
    log = []

    class Client:
        def __init__(self, address, timeout):
            log.append(address)

        def __enter__(self):
            return self

        def __exit__(self, *fault):
            log.append("closed")

        def submit(self, function, *given, pure):
            assert pure is False
            return SimpleNamespace(answer=function(*given))

        def gather(self, futures):
            return [f.answer for f in futures]

    stand_in(monkeypatch, Client)
    with open_worker_pool(find_effect, 7, "tcp://there:8786") as run:
        first, fault, last = run(["friction", "frction", "wear"])
    assert (first, last) == (find_effect("friction"), find_effect("wear"))
    assert isinstance(fault, BadInput)
    assert log == ["tcp://there:8786", "closed"]


SCHEDULER = """
import time
from distributed import LocalCluster

if __name__ == "__main__":
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        time.sleep(600)
"""
CLIENT = """
import sys, time
from flashtemp.errors import SolverFailure
from flashtemp.runs.results.worker_pool import stream_results

try:
    for k, _ in stream_results(time.sleep, [0.2] * 100, scheduler=sys.argv[1]):
        print(k, flush=True)
except SolverFailure as fault:
    sys.exit(str(fault))
"""


def test_a_scheduler_that_is_killed_is_said_in_one_line(tmp_path):
    pytest.importorskip("distributed", reason="dask.distributed is not installed")
    for name, text in (("scheduler.py", SCHEDULER), ("client.py", CLIENT)):
        (tmp_path / name).write_text(text)
    command = [sys.executable, tmp_path / "scheduler.py"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as scheduler:
        address = scheduler.stdout.readline().strip()
        command = [sys.executable, tmp_path / "client.py", address]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as client:
            client.stdout.readline()
            scheduler.kill()
            said = client.communicate(timeout=60)[1].strip()
    assert said == f"the scheduler at {address} has stopped; give the address of a running one"


@pytest.mark.long
def test_a_worker_of_a_real_cluster_is_killed(tasks):
    """Two workers, one killed half way: every answer comes, once, in its place."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    asked = [tasks[0], tasks[2]] * 8
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        victim = next(iter(cluster.workers.values())).pid
        killed = threading.Event()

        def kill():
            os.kill(victim, signal.SIGKILL)
            killed.set()

        with (
            open_worker_pool(predict_condition, None, cluster.scheduler_address) as run,
            open_worker_pool(predict_condition, 1) as alone,
        ):
            run(asked[:2])  # the workers have begun
            threading.Timer(0.3, kill).start()
            answers = run(asked)
            assert killed.is_set()
            expected = alone(asked[:2])
    assert len(answers) == len(asked)
    for k, answer in enumerate(answers):
        same(expected[k % 2], answer)


def test_what_the_message_says_to_install_exists():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert "cluster" in project["optional-dependencies"]
