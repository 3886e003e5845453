"""The fixed set of the independent benchmark: campaigns with every laboratory error, nothing named that is not there."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

FILE = Path(__file__).parents[1] / "benchmarks" / "independent.py"
SEEDS = range(900, 920)
RAN = (900, 902, 916, 917)  # the others have not been run yet: docs/discover.md


@pytest.fixture(scope="module")
def benchmark():
    spec = importlib.util.spec_from_file_location("independent", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_kind_of_campaign_is_drawn(benchmark):
    drawn = [benchmark.draw(seed, True) for seed in SEEDS]
    assert {d["kind"] for d in drawn} == set(benchmark.KINDS)
    assert [benchmark.draw(seed, True) for seed in SEEDS] == drawn


def test_outcomes_are_counted_as_they_are(benchmark):
    def ended(kind, verdict, *named, hidden="pressure_tilt", group=(), laboratory=False):
        causes = [{"effect": n, "laboratory": laboratory} for n in named]
        return benchmark.outcome(
            {"kind": kind, "hidden": hidden, "verdict": verdict, "causes": causes, "group": list(group)}
        )

    assert ended("single", "named", "pressure_tilt") == "right"
    assert ended("single", "named", "pressure_tilt", "time_lag") == "extra"
    assert ended("single", "named", "time_lag") == "wrong"
    assert ended("null", "named", "time_lag", hidden="") == "wrong"
    assert ended("single", "weak", "time_lag") == "weak wrong"
    assert ended("single", "group", group=("pressure_tilt", "time_lag")) == "group"
    assert ended("single", "group", group=("blur", "time_lag")) == "wrong"
    assert ended("laboratory", "named", "scale", hidden="larger", laboratory=True) == "laboratory"
    assert ended("foreign", "unexplained", hidden="waves") == "unexplained"


@pytest.mark.long
@pytest.mark.parametrize("seed", RAN)
def test_nothing_is_named_that_is_not_there(benchmark, seed):
    """About 50 CPU seconds each."""
    found = benchmark.one(seed, small=True)
    print(seed, found["kind"], found["hidden"], f"z {found['z']:.1f}", found["verdict"], found["says"])
    assert benchmark.outcome(found) not in ("wrong", "weak wrong"), found["says"]
