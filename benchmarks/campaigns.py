"""Run `discover` on a folder of stored campaigns and compare its verdicts with the hidden truth.

    python benchmarks/campaigns.py run FOLDER RESULTS.jsonl [--processes N] [--limit SECONDS] [--engine MODULE]
    python benchmarks/campaigns.py table RESULTS.jsonl [OTHER.jsonl]
    python benchmarks/campaigns.py summary RESULTS.jsonl... --out benchmarks/results/discovery_validation.json

`--only GLOB` restricts each to matching names.  FOLDER/NAME/campaign is a campaign.  FOLDER/NAME/truth.json holds
`kind` (null, single, pair, outside, setup), `hidden` {effect: {parameter: value}} and, for an error of the set-up,
`setup` {error: size}.  Every campaign runs in its own process with a limit of CPU time.  A second call continues;
a results file holds the verdicts of one engine.  Tables have a row per kind and per source, the first word of a NAME.
A summary keeps the rows of other sources that are in its file.
`--store STORE` keeps the evidence of each verdict, some 30 kB, in STORE/NAME.pkl.xz for `criteria_replay.py`.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import nullcontext
from fnmatch import fnmatch
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

ENGINE = "flashtemp.discovery.engine"
LIMIT_S = 300
REFERENCE_COUNT_S = 0.18  # time in which a core of the published CPU times counts to ten million
WALL_PER_CPU = 10  # wall seconds per CPU second of the limit, after which a waiting process is ended
Z_BINS = ((0.0, 5.0), (5.0, 10.0), (10.0, 20.0), (20.0, math.inf))
OUTCOMES = (
    "right", "extra", "part", "group", "weak", "law", "none", "unexplained", "no_verdict", "wrong", "weak wrong",
    "timeout", "failed",
)  # fmt: skip
CORRECT = ("right", "extra", "part", "group", "weak")  # outcomes whose causes include a hidden effect
SUMMARY_COLUMNS: dict[str, tuple[str, ...]] = {  # of the validation page: the OUTCOMES in each
    "right": ("right",), "part": ("part", "law"), "group": ("group",), "weak": ("weak",), "none": ("none",),
    "unexplained": ("unexplained",), "no_verdict": ("no_verdict", "timeout", "failed"), "weak_wrong": ("weak wrong",),
    "wrong": ("wrong", "extra"),
}  # fmt: skip
EXPECTED = {  # causes and inputs that count as right for an error of the set-up; several where they act alike
    "length": ("block_length", "block.length", "pixel_scale"), "turned": ("image_turn",), "mirrored": ("mirrored",),
    "larger": ("pixel_scale", "block_length", "block.length"), "exchanged": ("exchanged", "mislabelled"),
    "clock": ("clock", "time_lag"), "load": ("contact.pressure", "pressure", "load"), "emissivity": ("emissivity",),
    "speed": ("schedule.speed", "speed"), "density": ("materials.rubber.density", "materials.rubber.heat_capacity"),
}  # fmt: skip
Record = dict[str, Any]


# --- one campaign, in a process of its own ----------------------------------------------------------------------
def judge_campaign(folder: Path, engine: str, limit: int, store: Path | None = None) -> Record:
    """Verdict of an engine on FOLDER/campaign, with the CPU and wall seconds that it took; its evidence in `store`."""
    from discover import time_counting
    from stored_evidence import Recorder, write_evidence

    from flashtemp.comparison import campaign

    discover = import_module(engine).discover
    count_s = time_counting()
    soft = math.ceil(time.process_time()) + limit
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (soft, resource.RLIM_INFINITY if store else soft + 10))
    recorder = Recorder()
    cpu, wall = time.process_time(), time.perf_counter()
    try:
        with recorder.record_calls() if store else nullcontext():
            found = discover(campaign.load(folder / "campaign"), partial(print, file=sys.stderr, flush=True), 1)
        out = describe_verdict(found[0] if isinstance(found, tuple) else found, read_truth(folder)["hidden"])
    except Exception:  # a failure is a result too
        out = {"verdict": "failed", "error": traceback.format_exc(limit=-6)}
    out |= {"cpu_s": time.process_time() - cpu, "wall_s": time.perf_counter() - wall, "count_s": count_s}
    if store and recorder.systems:
        resource.setrlimit(resource.RLIMIT_CPU, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        try:
            write_evidence(
                recorder.to_stored_search({"name": folder.name, **read_truth(folder), **out}),
                store / f"{folder.name}.pkl.xz",
            )
        except Exception:  # the verdict is kept without it
            out["not_stored"] = traceback.format_exc(limit=-6)
        out["store_s"] = time.process_time() - cpu - out["cpu_s"]
    return out


def read_truth(folder: Path) -> Record:
    """Content of truth.json; of unknown kind with nothing hidden if there is no such file."""
    file = folder / "truth.json"
    truth = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    return {"kind": truth.get("kind", "unknown"), "hidden": truth.get("hidden", {}), "setup": truth.get("setup", {})}


def describe_verdict(verdict: Any, hidden: dict[str, dict[str, float]]) -> Record:
    """Values of a verdict that the tables need."""
    effects = [c for c in verdict.causes if not c.laboratory]
    scores = {r.effect: r.score for r in verdict.rivals} | {c.effect: c.ln_bayes for c in effects}
    keys = [k.key for k in [verdict.held_key] if k and verdict.kind == "held_key"]
    parameters = [
        {"name": p.name, "value": p.value, "stderr": p.stderr, "ci95": list(p.ci95),
         "true": hidden.get(c.effect, {}).get(p.name.rpartition(".")[2])}
        for c in effects for p in c.parameters
    ]  # fmt: skip
    return {
        "verdict": verdict.kind,
        "effects": [c.effect for c in effects],
        "inputs": [*(c.effect for c in verdict.causes if c.laboratory), *keys],
        "group": list(verdict.group),
        "parameters": parameters,
        "best": sorted(scores.items(), key=lambda item: -item[1])[:3],
        "z": signal_to_noise(verdict, hidden),
        "excess": {k: [float(v), float(limit)] for k, (v, limit) in verdict.gates.items() if v > limit},
        "says": list(verdict.says),
    }


def signal_to_noise(verdict: Any, hidden: dict[str, dict[str, float]]) -> dict[str, float]:
    """z of every hidden effect that was a candidate: its true size over its standard error."""
    from flashtemp.physics.effect import find_effect

    out = {}
    for rival in verdict.rivals:
        parameter = rival.parameter.rpartition(".")[2]
        true = hidden.get(rival.effect, {}).get(parameter)
        if true is not None and rival.detectable > 0.0:
            off = find_effect(rival.effect).params()[parameter].off or 0.0
            out[rival.effect] = 5.0 * abs(true - off) / rival.detectable
    return out


# --- all campaigns ----------------------------------------------------------------------------------------------
def run_campaigns(
    folder: Path, results: Path, pattern: str, engine: str, processes: int, limit: int, store: Path | None = None
) -> None:
    """Append one line to `results` for every campaign that is not in it yet."""
    done = {r["name"] for r in read_records(results, engine)} if results.exists() else set()
    found = sorted(p.parent.parent for p in folder.glob("*/campaign/campaign.toml"))
    waiting = [p for p in found if p.name not in done and fnmatch(p.name, pattern)]
    with ThreadPoolExecutor(processes) as pool, results.open("a", encoding="utf-8") as out:
        for future in as_completed([pool.submit(run_in_child, p, engine, limit, store) for p in waiting]):
            record = future.result()
            out.write(json.dumps(record, default=float) + "\n")
            out.flush()
            print(summarise_record(record), flush=True)


def run_in_child(folder: Path, engine: str, limit: int, store: Path | None = None) -> Record:
    """Record of one campaign: truth and verdict; `timeout` beyond the limit, `failed` if the process failed."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        out, log = Path(scratch, "record.json"), Path(scratch, "log.txt")
        words = [sys.executable, __file__, "child", str(folder), str(out), "--engine", engine, "--limit", str(limit)]
        words += ["--store", str(store)] if store else []
        with log.open("w") as text:
            child = subprocess.Popen(words, stdout=text, stderr=text, env=os.environ | {"OMP_NUM_THREADS": "1"})
            guard = threading.Timer(WALL_PER_CPU * (limit + 10), child.kill)
            guard.start()
            status = child.wait()
            guard.cancel()
        lines = log.read_text(errors="replace").splitlines()
        if status == 0:
            found = json.loads(out.read_text())
        else:
            wall = time.perf_counter() - began
            over = status == -signal.SIGXCPU or wall > WALL_PER_CPU * (limit + 10)
            found = {"verdict": "timeout" if over else "failed", "stage": lines[-1] if lines else "", "wall_s": wall}
            found |= {"cpu_s": float(limit)} if over else {"error": "\n".join([f"exit status {status}", *lines[-12:]])}
    return {"name": folder.name, **read_truth(folder), "engine": engine, **found}


def read_records(file: Path, engine: str | None = None) -> list[Record]:
    """Records of a file.  Exits if they are of different engines, or of another engine than the one to be run."""
    records = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines() if line.strip()]
    engines = {r["engine"] for r in records} | ({engine} if engine else set())
    if len(engines) > 1:
        raise SystemExit(f"{file}: verdicts of {' and '.join(sorted(engines))}; give each engine a file of its own")
    return records


def summarise_record(r: Record) -> str:
    z = "".join(f" z={v:.0f}" for v in r.get("z", {}).values())
    return f"{r['name']}: {' + '.join(hidden_effects(r)) or 'nothing'}{z} -> {classify(r)}: {describe_end(r)}"


def describe_end(r: Record) -> str:
    """Verdict, causes and CPU seconds in a few words."""
    names = ", ".join([*r.get("effects", []), *r.get("inputs", [])])
    others = f" of {', '.join(r['group'])}" if r.get("group") else ""
    return f"{r['verdict']} {names}{others} ({r.get('cpu_s', math.nan):.0f} s)"


# --- tables -----------------------------------------------------------------------------------------------------
def classify(r: Record) -> str:
    """One of OUTCOMES: how a verdict compares with what was hidden.

    A name is right if it is a hidden effect, or one that EXPECTED has for an error of the set-up.  An effect that was
    not hidden is `extra` in addition to all hidden ones, and wrong otherwise.  An input without an error is wrong.
    """
    verdict = str(r["verdict"])
    if verdict in ("timeout", "failed", "no_verdict", "unexplained"):
        return verdict
    true, is_mistaken = list(hidden_effects(r).values()), len(hidden_effects(r)) > len(r["hidden"])
    group, inputs = set(r["group"]), set(r["inputs"])
    effects = set() if verdict == "learned" else set(r["effects"])
    wrong_effects, wrong_inputs = ({n for n in s if not is_true(n, true)} for s in (effects - group, inputs))
    if verdict == "weak":
        return "weak wrong" if wrong_effects or wrong_inputs else "weak"
    found = [any(is_true(n, [t]) for n in effects | inputs | group) for t in true]
    missed = group and not any(is_true(n, true) for n in group)
    if wrong_inputs or missed or (wrong_effects and (is_mistaken or not true or not all(found))):
        return "wrong"
    if verdict == "learned":
        return "right" if r["kind"] == "outside" else "law"
    if not effects | inputs | group:
        return "none"
    return "extra" if wrong_effects else "group" if group else "right" if all(found) else "part"


def hidden_effects(r: Record) -> dict[str, tuple[str, ...]]:
    """Hidden effects and errors of the set-up, each with the names under which a verdict may report it."""
    return {name: (name,) for name in r["hidden"]} | {name: EXPECTED[name] for name in r["setup"] if name in EXPECTED}


def is_true(name: str, true: list[tuple[str, ...]]) -> bool:
    """Whether a name, or its last part (`sidewall.emissivity`), is one of the accepted names of a truth."""
    return any(name in names or name.rpartition(".")[2] in names for names in true)


def label(r: Record) -> str:
    """Row of the table: kind, and bin of the largest z of a single effect or of the weaker one of a pair."""
    if r["kind"] not in ("single", "pair"):
        return str(r["kind"])
    z = r.get("z", {})
    if len(z) < len(r["hidden"]):
        return f"{r['kind']}, z unknown"
    low, high = next(b for b in Z_BINS if b[0] <= min(z.values()) < b[1])
    return f"{r['kind']}, z {low:.0f} to {high:.0f}"


def source(r: Record) -> str:
    """The source of a campaign, by the first word of its name: realistic, ideal, twin, setup, camera."""
    return str(r["name"]).partition("_")[0]


def tabulate(records: list[Record]) -> Iterator[str]:
    """Lines of the tables: outcomes by kind and by source, coverage of the intervals, CPU seconds."""
    records = sorted(records, key=lambda r: (r["kind"], min(r.get("z", {}).values(), default=math.inf)))
    yield from count_outcomes("hidden", records, label)
    records.sort(key=source)
    yield from count_outcomes("source", records, lambda r: f"{source(r)}, {r['kind']}")
    counted = [r["count_s"] for r in records if "count_s" in r]
    usual = float(np.median(counted)) if counted else math.nan  # for a process that ended before it measured its own
    for name in [*dict.fromkeys(map(source, records)), "all"]:
        own = [r for r in records if "cpu_s" in r and name in (source(r), "all")]
        if spent := [(r["cpu_s"], r["cpu_s"] * REFERENCE_COUNT_S / r.get("count_s", usual)) for r in own]:
            raw, scaled = np.quantile(spent, (0.5, 0.9, 1.0), axis=0).T
            words = (f"median {middle:.1f}, p90 {p90:.1f}, max {most:.1f}" for middle, p90, most in (raw, scaled))
            yield f"{name}: CPU s {'; scaled '.join(words)}{summarise_coverage(own)}"
    yield f"this machine counts to ten million in {usual:.2f} s; scaled to one that needs {REFERENCE_COUNT_S:.2f} s"


def count_outcomes(head: str, records: list[Record], row: Callable[[Record], str]) -> Iterator[str]:
    """Lines of a table with one row for each label that `row` gives to a record."""
    counts: dict[str, Counter[str]] = {}
    for r in records:
        counts.setdefault(row(r), Counter())[classify(r)] += 1
    heads = [o for o in OUTCOMES if any(c[o] for c in counts.values())]
    yield f"| {head} | campaigns | " + " | ".join(heads) + " |\n" + "|---" * (len(heads) + 2) + "|"
    for name, count in counts.items():
        yield f"| {name} | {count.total()} | " + " | ".join(str(count[o]) for o in heads) + " |"
    yield ""


def summarise_coverage(records: list[Record]) -> str:
    """Fraction of 95 % intervals of identified effects that contain the truth, with Clopper-Pearson 95 % bounds."""
    from scipy.stats import binomtest

    inside, count = count_intervals(records)
    if not count:
        return ""
    low, high = binomtest(inside, count).proportion_ci(0.95, method="exact")
    return f"; 95 % intervals contain the truth in {inside} of {count} ({100 * low:.0f} to {100 * high:.0f} %)"


def summarise(records: list[Record]) -> Record:
    """Figures of the validation page: a row for each set and kind, and how many intervals contain the truth.

    CPU seconds are scaled to a core that counts to ten million in REFERENCE_COUNT_S.  A verdict without a cause is
    right where nothing is hidden.
    """
    counted = [r["count_s"] for r in records if "count_s" in r]
    usual = float(np.median(counted)) if counted else math.nan
    rows: dict[tuple[str, str], list[Record]] = {}
    for r in sorted(records, key=lambda r: (source(r), r["kind"], min(r.get("z", {}).values(), default=math.inf))):
        rows.setdefault((source(r), label(r)), []).append(r)
    return {
        "counting_time_s": REFERENCE_COUNT_S,
        "rows": [{"set": name, "kind": kind, **summarise_row(own, usual)} for (name, kind), own in rows.items()],
        "intervals": [
            {"set": name, "inside": inside, "intervals": count}
            for name in dict.fromkeys(map(source, records))
            for inside, count in [count_intervals([r for r in records if source(r) == name])]
            if count
        ],
    }


def keep_other_sets(found: Record, before: Record) -> Record:
    """A summary with the rows of an earlier one for all sets that it lacks."""
    own = {row["set"] for row in found["rows"]}
    return found | {
        part: sorted([*found[part], *(r for r in before[part] if r["set"] not in own)], key=lambda r: r["set"])
        for part in ("rows", "intervals")
    }


def summarise_row(records: list[Record], usual_count_s: float) -> Record:
    """Campaigns of one row by SUMMARY_COLUMNS, with their CPU seconds on the reference core."""
    count = Counter(map(summary_column, records))
    spent = [r["cpu_s"] * REFERENCE_COUNT_S / r.get("count_s", usual_count_s) for r in records if "cpu_s" in r]
    times = [round(float(q), 1) for q in np.quantile(spent, (0.5, 0.9, 1.0))] if spent else [None] * 3
    return {
        "campaigns": len(records),
        **{column: count[column] for column in SUMMARY_COLUMNS},
        **dict(zip(("median_cpu_s", "p90_cpu_s", "max_cpu_s"), times, strict=True)),
    }


def summary_column(r: Record) -> str:
    """The one of SUMMARY_COLUMNS to which a campaign belongs; no cause is right where nothing is hidden."""
    outcome = "right" if r["kind"] == "null" and classify(r) == "none" else classify(r)
    return next(column for column, outcomes in SUMMARY_COLUMNS.items() if outcome in outcomes)


def count_intervals(records: list[Record]) -> tuple[int, int]:
    """Number of 95 % intervals of identified effects that contain the true value, and number of all of them."""
    known = [p for r in records if classify(r) in CORRECT for p in r["parameters"] if p["true"] is not None]
    return sum(p["ci95"][0] <= p["true"] <= p["ci95"][1] for p in known), len(known)


def compare_records(first: list[Record], second: list[Record]) -> Iterator[str]:
    """Lines about campaigns of both files: each file's tables, then every verdict that changed."""
    others = {r["name"]: r for r in second}
    pairs = [(a, others[a["name"]]) for a in first if a["name"] in others]
    # z is a property of the campaign: both runs count in the same bin, also where one timed out
    pairs = [(a | {"z": a.get("z") or b.get("z", {})}, b | {"z": a.get("z") or b.get("z", {})}) for a, b in pairs]
    for side, title in enumerate(("first file", "second file")):
        yield f"\n{title}, {len(pairs)} campaigns in both"
        yield from tabulate([p[side] for p in pairs])
    yield "\n| campaign | hidden | z | first | second |\n|---|---|---|---|---|"
    for a, b in pairs:
        if (classify(a), a.get("effects"), a.get("inputs")) != (classify(b), b.get("effects"), b.get("inputs")):
            z = ", ".join(f"{v:.0f}" for v in a["z"].values())
            cells = (f"{classify(r)}: {describe_end(r)}" for r in (a, b))
            yield f"| {a['name']} | {' + '.join(hidden_effects(a)) or 'nothing'} | {z} | {' | '.join(cells)} |"


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    for name, names in (("run", ("folder", "results")), ("child", ("folder", "results")), ("table", ("results",))):
        command = commands.add_parser(name)
        for positional in names:
            command.add_argument(positional, type=Path)
        command.add_argument("--only", default="*", help="names of campaigns, as a glob pattern")
        command.add_argument("--engine", default=ENGINE, help="module with discover(campaign, watch, workers)")
        command.add_argument("--limit", type=int, default=LIMIT_S, help="CPU seconds of one campaign")
        command.add_argument("--processes", type=int, default=1)
        command.add_argument("--store", type=Path, help="folder for the evidence of each verdict (criteria_replay.py)")
    commands.choices["table"].add_argument("other", type=Path, nargs="?")
    summary = commands.add_parser("summary")
    summary.add_argument("results", type=Path, nargs="+")
    summary.add_argument("--out", type=Path, required=True)
    return parser.parse_args()


def main() -> None:
    """Run campaigns, or print the tables of one or two files."""
    args = parse_arguments()
    if args.command == "child":
        found = judge_campaign(args.folder, args.engine, args.limit, args.store)
        args.results.write_text(json.dumps(found, default=float))
    elif args.command == "run":
        run_campaigns(args.folder, args.results, args.only, args.engine, args.processes, args.limit, args.store)
    elif args.command == "summary":
        records = {r["name"]: r for file in args.results for r in read_records(file)}
        found = summarise(list(records.values()))
        if args.out.exists():
            found = keep_other_sets(found, json.loads(args.out.read_text(encoding="utf-8")))
        args.out.parent.mkdir(parents=True, exist_ok=True)
        args.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    else:
        files = [read_records(f) for f in (args.results, args.other) if f is not None]
        records = [[r for r in file if fnmatch(r["name"], args.only)] for file in files]
        print(*(tabulate(records[0]) if len(records) == 1 else compare_records(*records)), sep="\n")


if __name__ == "__main__":
    main()
