"""Every effect of the catalogue hidden once in a short twin, with default settings, and the verdict of `discover`.

    python benchmarks/newcomer_twins.py run 1 2 3 [--only GLOB] [--limit SECONDS] [--records RECORDS.jsonl]
    python benchmarks/newcomer_twins.py table

For each seed and effect `run` does what these two commands do, each in its own process with a limit of CPU time:

    flashtemp twin cases/uniform_pressure schedule.distance=0.4 schedule.repetitions=2 --hide EFFECT --seed N --out c
    flashtemp discover c

Rows are written as they come, and a second call continues.  `--records` keeps the full records of campaigns.py.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import Any

from campaigns import ENGINE, REFERENCE_COUNT_S, classify, run_in_child
from discover import CASE, time_counting

RESULTS = Path(__file__).parent / "results" / "newcomer_twins.json"
SHORT = ("schedule.distance=0.4", "schedule.repetitions=2")
LIMIT_S = 240  # CPU seconds of each of the two commands
INPUT_ERROR = 2  # exit code of flashtemp for bad input
Row = dict[str, Any]


def effects() -> list[str]:
    """Effects of the catalogue that may be hidden: all but those that always act."""
    from flashtemp.physics.effect import catalogue

    return [name for name, effect in catalogue().items() if not effect.base]


def is_alike(name: str) -> str:
    """The similar effect that `discover` tries in place of this one; empty where it tries this one."""
    from flashtemp.physics.effect import catalogue

    return catalogue()[name].alike or ""


def is_no_candidate(name: str) -> bool:
    """Whether `discover` tries an effect only where a case or campaign lists it."""
    from flashtemp.physics.effect import catalogue

    return not catalogue()[name].candidate


def judge_twin(name: str, seed: int, limit: int) -> tuple[Row, Row]:
    """The row of one twin, and the full record of its verdict (see campaigns.py)."""
    head = {"effect": name, "seed": seed, "alike": is_alike(name), "detail": is_no_candidate(name)}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch, f"newcomer_{name}_{seed}")
        folder.mkdir()
        out = folder / "campaign"
        words = ["twin", str(CASE), *SHORT, "--hide", name, "--seed", str(seed), "--out", str(out)]
        made = subprocess.run(
            [sys.executable, "-m", "flashtemp", *words], capture_output=True, text=True, check=False,
            env=os.environ | {"OMP_NUM_THREADS": "1"}, preexec_fn=partial(limit_cpu, limit),
        )  # fmt: skip
        if made.returncode:
            refused = made.returncode == INPUT_ERROR
            lines = [line for line in (made.stderr + made.stdout).splitlines() if line.strip()]
            reason = lines[-1] if refused and lines else f"no twin within {limit} s"
            row = head | {"outcome": "refused" if refused else "no twin", "reason": reason}
            return row, row | {"log": lines[-12:]}
        truth = json.loads((out / "sealed" / "truth.json").read_text(encoding="utf-8"))
        (folder / "truth.json").write_text(json.dumps({"kind": "single", "hidden": truth["hidden"]}))
        record = run_in_child(folder, ENGINE, limit)
    return head | describe(record, head["alike"]), record


def limit_cpu(seconds: int) -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 10))


def describe(record: Row, like: str) -> Row:
    """Outcome, verdict, names, z of the hidden effect and CPU seconds on the reference core.

    The outcome is one of campaigns.py, or `alike`: the effect is not tried, and a similar one (`like`) is identified.
    """
    named, outcome = [*record.get("effects", []), *record.get("inputs", [])], classify(record)
    z = [round(v, 1) for v in record.get("z", {}).values()]
    return {
        "outcome": "alike" if "wrong" in outcome and named == [like] else outcome,
        "verdict": record["verdict"],
        "named": named,
        "group": record.get("group", []),
        "z": z[0] if z else None,
        "cpu_s": round(record.get("cpu_s", math.nan) * REFERENCE_COUNT_S / record.get("count_s", time_counting()), 1),
    }


def run(seeds: list[int], pattern: str, limit: int, records: Path | None) -> None:
    """Add a row to RESULTS for every effect and seed that has none yet."""
    for seed in seeds:
        for name in effects():
            done = {(r["effect"], r["seed"]) for r in read_rows()}
            if (name, seed) in done or not fnmatch(name, pattern):
                continue
            row, record = judge_twin(name, seed, limit)
            print(print_progress(row), flush=True)
            rows = sorted([*read_rows(), row], key=lambda r: (r["effect"], r["seed"]))
            found = {"counting_time_s": REFERENCE_COUNT_S, "rows": rows}
            RESULTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
            if records:
                with records.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(record, default=float) + "\n")


def read_rows() -> list[Row]:
    return json.loads(RESULTS.read_text(encoding="utf-8"))["rows"] if RESULTS.exists() else []


def print_progress(row: Row) -> str:
    """One row in a line."""
    names = ", ".join(row.get("named", [])) + (f" of {', '.join(row['group'])}" if row.get("group") else "")
    end = row.get("reason") or f"{row['verdict']} {names} ({row['cpu_s']:.0f} s)"
    z = f" z={row['z']:.0f}" if row.get("z") is not None else ""
    return f"{row['effect']} {row['seed']}{z} -> {row['outcome']}: {end}"


def tabulate(rows: list[Row]) -> Iterator[str]:
    """Each row in a line, then CPU seconds."""
    yield from map(print_progress, rows)
    if spent := [r["cpu_s"] for r in rows if "cpu_s" in r]:
        yield f"{len(spent)} verdicts; CPU s median {statistics.median(spent):.0f}, largest {max(spent):.0f}"


def main() -> None:
    """Judge twins, or print the rows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    judge = commands.add_parser("run")
    judge.add_argument("seeds", type=int, nargs="+")
    judge.add_argument("--only", default="*", help="names of effects, as a glob pattern")
    judge.add_argument("--limit", type=int, default=LIMIT_S, help="CPU seconds of each command")
    judge.add_argument("--records", type=Path, help="file for the full records")
    commands.add_parser("table")
    args = parser.parse_args()
    if args.command == "table":
        print(*tabulate(read_rows()), sep="\n")
    else:
        run(args.seeds, args.only, args.limit, args.records)


if __name__ == "__main__":
    main()
