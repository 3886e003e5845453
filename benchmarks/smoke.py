"""Every benchmark at a small size: checks that it runs and that errors stay within their stated values.

    python benchmarks/smoke.py

Takes half a minute; `make bench-smoke` runs it.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
from io import StringIO
from multiprocessing import get_context
from pathlib import Path

import abrasion
import changing
import closure
import discover
import independent
import learned_laws
import numpy as np
import run_in
import slide2d
import slide3d
import spots
import theory
from common import ErrorRow, print_rows

from flashtemp.model.numerics import installed_bindings


def theory_rows() -> list[ErrorRow]:
    """Tables of friction for a plain case."""
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case.toml"
        case.write_text("effects = []\n")
        return theory.table_rows(case, 1, ("one speed",))


def abrasion_rows() -> list[ErrorRow]:
    """One repetition of the run-in with every kind of wear."""
    given = {"schedule.repetitions": 1, "numerics.mesh": 0.5, "numerics.integrator": installed_bindings()[-1]}
    return abrasion.compare_kinds(1, given)


def blind_rows() -> list[ErrorRow]:
    """Hidden content of the blind benchmarks: a seed always draws the same, and gives a valid case or campaign."""
    from flashtemp.model.case import load_case

    began, case = time.process_time(), Path(__file__).parents[1] / "cases" / "uniform_pressure"
    for seed in range(12):
        plan = discover.draw_hidden(seed)
        assert plan == discover.draw_hidden(seed)
        load_case(case, discover.overrides(plan))
        assert independent.draw_hidden(seed, True) == independent.draw_hidden(seed, True)
        assert discover.draw_realistic(seed) == discover.draw_realistic(seed)
    noise = learned_laws.LawSignatures(np.eye(4), ((np.arange(4), 1.0),))
    gains = noise.best_gains(noise.draw_scores(np.random.default_rng(1), 2000), (0.5, 1.0))
    share = 100.0 * float(np.mean(gains > 8.0))  # of draws of noise alone in which a law is found
    return [ErrorRow("blind: laws found in noise, %", 0, share, 0.1, time.process_time() - began)]


SMALL_BENCHMARKS: dict[str, Callable[[], list[ErrorRow]]] = {
    "slide2d": lambda: slide2d.rows(1),
    "changing": lambda: changing.rows(1, small=True),
    "run_in": lambda: run_in.rows(1, ((0.7, 1e-3),), 1.2, **{"schedule.repetitions": 1}),
    "abrasion": abrasion_rows,
    "theory": theory_rows,
    "slide3d": slide3d.small_rows,
    "closure": closure.small_rows,
    "spots": spots.small_rows,
    "discover, independent, learned_laws": blind_rows,
}


def run_benchmark(name: str) -> tuple[str, int]:
    """Output of one benchmark, and 1 if a row is beyond its stated error."""
    began, out = time.perf_counter(), StringIO()
    with redirect_stdout(out):
        print(f"--- {name}")
        beyond = print_rows(SMALL_BENCHMARKS[name]())
        print(f"    {time.perf_counter() - began:.1f} s")
    return out.getvalue(), beyond


def main() -> int:
    """Run all benchmarks, two at a time, because times do not matter here."""
    beyond = 0
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for text, one in pool.map(run_benchmark, SMALL_BENCHMARKS):
            print(text, end="", flush=True)
            beyond |= one
    return beyond


if __name__ == "__main__":
    raise SystemExit(main())
