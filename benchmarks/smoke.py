"""Every benchmark, small: does it run, and do flashtemp and its peers stay within their stated errors?

    python benchmarks/smoke.py

Half a minute; `make bench-smoke`, which continuous integration runs.  The figures are those of the small sizes.
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
from common import Row, table

from flashtemp.model.numerics import available


def theories() -> list[Row]:
    """Tables of friction for a plain case."""
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case.toml"
        case.write_text("effects = []\n")
        return theory.tables(case, 1, ("one speed",))


def worn() -> list[Row]:
    """One repetition of the run-in with every kind of wear."""
    given = {"schedule.repetitions": 1, "numerics.mesh": 0.5, "numerics.integrator": available()[-1]}
    return abrasion.compare(1, given)


def blind() -> list[Row]:
    """What the blind benchmarks hide: every seed draws the same twice, and what it draws is a case or a campaign."""
    from flashtemp.model.case import load

    began, case = time.process_time(), Path(__file__).parents[1] / "cases" / "uniform_pressure"
    for seed in range(12):
        plan = discover.draw(seed)
        assert plan == discover.draw(seed)
        load(case, discover.overrides(plan))
        assert independent.draw(seed, True) == independent.draw(seed, True)
        assert discover.draw_realistic(seed) == discover.draw_realistic(seed)
    noise = learned_laws.Traces(np.eye(4), ((np.arange(4), 1.0),))
    gains = noise.gains(noise.drawn(np.random.default_rng(1), 2000), (0.5, 1.0))
    share = 100.0 * float(np.mean(gains > 8.0))  # of draws of nothing but noise in which a law is seen
    return [Row("blind: laws seen in noise, %", 0, share, 0.1, time.process_time() - began)]


SMALL: dict[str, Callable[[], list[Row]]] = {
    "slide2d": lambda: slide2d.rows(1),
    "changing": lambda: changing.rows(1, small=True),
    "run_in": lambda: run_in.rows(1, ((0.7, 1e-3),), 1.2, **{"schedule.repetitions": 1}),
    "abrasion": worn,
    "theory": theories,
    "slide3d": slide3d.small,
    "closure": closure.small,
    "spots": spots.small,
    "discover, independent, learned_laws": blind,
}


def told(name: str) -> tuple[str, int]:
    """What one benchmark prints, and 1 where a row is beyond its stated error."""
    began, out = time.perf_counter(), StringIO()
    with redirect_stdout(out):
        print(f"--- {name}")
        beyond = table(SMALL[name]())
        print(f"    {time.perf_counter() - began:.1f} s")
    return out.getvalue(), beyond


def main() -> int:
    """All of them, two at a time: errors are judged here, not times."""
    beyond = 0
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for text, one in pool.map(told, SMALL):
            print(text, end="", flush=True)
            beyond |= one
    return beyond


if __name__ == "__main__":
    raise SystemExit(main())
