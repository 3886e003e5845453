"""Blind benchmark of `discover` on campaigns of the independent generator in tests/reference.

    python benchmarks/independent.py run 5000 5300 found.jsonl     one campaign per seed; those in the file are skipped
    python benchmarks/independent.py run 900 920 fixed.jsonl small   shorter, fewer candidates, as in the tests
    python benchmarks/independent.py run 5000 5300 found.jsonl held   one image, or one condition, of each is held out
    python benchmarks/independent.py run 5000 5300 found.jsonl varied   another block, road, schedule and camera in each
    python benchmarks/independent.py table found.jsonl

Every campaign has all set-up errors at their usual size (`Errors`).  The hidden effect is drawn from the seed and read
after the verdict.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

TYPICAL = {  # parameter that is drawn, and a size that is easily detected
    "pressure_tilt": ("a", 0.3), "edge_pressure": ("B", 1.0), "friction_softening": ("b", 0.006),
    "conductivity_slope": ("block", 0.008), "ambient_drift": ("rate", 0.01), "conductance_speed": ("resistance", 2e-5),
    "interface_resistance": ("resistance", 2e-5), "third_body": ("growth", 2e-5), "side_cooling": ("gain", 40.0),
    "track_memory": ("strength", 1.0), "time_lag": ("lag", -0.1),
}  # fmt: skip
FEW = ("pressure_tilt", "friction_softening", "conductivity_slope", "ambient_drift", "interface_resistance", "time_lag")
FOREIGN = {"laminar_cooling": 60.0, "waves": 0.2, "polishing": 0.2}  # laws outside the catalogue
KNOWN = {"laminar_cooling": ("side_cooling", "exponent", 0.5)}  # in the catalogue: parameter, true value
LABORATORY = {"larger": 0.025, "turned": 0.035, "length": 6e-4, "mirrored": True}  # errors beyond what is usual
KINDS = {"null": 0.3, "single": 0.45, "foreign": 0.125, "laboratory": 0.125}
BINS = ((0, 5), (5, 10), (10, 20), (20, np.inf))


def draw_hidden(seed: int, small: bool = False) -> dict:
    """Hidden content of a seed: kind, effect and its relative size."""
    rng = np.random.default_rng([seed, 177])
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    pools: dict = {"null": {}, "single": TYPICAL, "foreign": FOREIGN, "laboratory": LABORATORY}
    pool = pools[kind]
    if small and kind == "single":
        pool = {k: TYPICAL[k] for k in FEW}
    name = str(rng.choice(sorted(pool))) if pool else ""
    size = float(np.exp(rng.uniform(np.log(0.08), np.log(1.5))))
    return {"seed": seed, "kind": kind, "hidden": name, "size": size}


def hold_out_some(campaign, seed: int):
    """The campaign with one image, or all of one condition, marked held out, as drawn from the seed."""
    rng = np.random.default_rng([seed, 179])
    view = campaign.views[rng.integers(len(campaign.views))]
    whole = rng.uniform() < 0.25

    def mark_held_out(entry):
        return replace(entry, held_out=entry is view or (whole and entry.given == view.given))

    return replace(
        campaign, views=tuple(map(mark_held_out, campaign.views)), forces=tuple(map(mark_held_out, campaign.forces))
    )


def draw_programme(seed: int):
    """A block on a road, a schedule and cameras as drawn from the seed; half of all have thermocouples."""
    from reference.laboratory import MeasurementProgramme
    from reference.sliding import SlidingPair

    rng = np.random.default_rng([seed, 181])

    def draw_within(low: float, high: float, digits: int = 3) -> float:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.{digits}g}")

    length, height = draw_within(0.012, 0.05), draw_within(0.005, 0.015)
    pair = SlidingPair(
        length=length, height=height, width=draw_within(0.03, 0.09), diameter=draw_within(1.5e-3, 5e-3),
        k=draw_within(0.2, 0.45), rc=1700.0 * draw_within(1050.0, 1250.0), road_k=draw_within(0.8, 2.5),
        road_rc=950.0 * draw_within(1900.0, 2600.0),
    )  # fmt: skip
    pressure, speed = draw_within(0.6e5, 3e5), draw_within(0.05, 0.3)
    conditions = [(pressure, speed), (pressure * draw_within(0.4, 1.0, 2), speed * draw_within(1.5, 4.0, 2))]
    if rng.uniform() < 0.3:
        conditions.append((conditions[1][0], speed))
    beads = [(rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.6)) for _ in range(rng.integers(2, 6))]
    taken = np.linspace(draw_within(0.15, 0.3), 0.9, int(rng.integers(2, 6)))
    return MeasurementProgramme(
        distance=max(draw_within(0.3, 1.0), 12.0 * length), repetitions=int(rng.integers(1, 5)),
        wait=draw_within(3.0, 20.0),
        columns=int(np.clip(round(length / 2.5e-4), 60, 140)), convection=draw_within(6.0, 25.0, 2),
        conditions=tuple(conditions), pair=pair, mu=draw_within(0.5, 1.3, 2), fraction=draw_within(0.08, 0.4, 2),
        netd=draw_within(0.03, 0.1, 2), frame_fractions=tuple(taken),
        pitch={"sidewall": draw_within(1.5e-4, 5e-4, 2), "wake": draw_within(3e-4, 1e-3, 2)},
        wake_length=draw_within(0.015, 0.05, 2),
        sensors=tuple(beads) if rng.uniform() < 0.5 else (), lag=draw_within(0.1, 1.0, 2),
    )  # fmt: skip


def run_seed(seed: int, small: bool = False, held: bool = False, varied: bool = False, repetitions: int = 2) -> dict:
    """Make a campaign, run discovery, then read the truth; only a `small` one has other `repetitions` than two."""
    from reference import laboratory

    from flashtemp.comparison import campaign
    from flashtemp.discovery import engine

    plan, began = draw_hidden(seed, small), time.process_time()
    name, kind = plan["hidden"], plan["kind"]
    hidden = {name: plan["size"] * TYPICAL[name][1]} if kind == "single" else {}
    hidden |= {name: FOREIGN[name]} if kind == "foreign" else {}
    setup_errors = {name: LABORATORY[name]} if kind == "laboratory" else {}
    with tempfile.TemporaryDirectory() as folder:
        usual = (
            laboratory.MeasurementProgramme(0.4, repetitions, wait=4.0, columns=100, mesh=0.5)
            if small
            else laboratory.MeasurementProgramme()
        )
        test = draw_programme(seed) if varied else usual
        truth = laboratory.write_campaign(folder, hidden, seed, test=test, setup_errors=setup_errors)
        made = time.process_time() - began
        loaded = replace(campaign.load(folder), candidates=FEW if small else tuple(TYPICAL))
        loaded = hold_out_some(loaded, seed) if held else loaded
        verdict, search = engine.discover(loaded, workers=1)
    found = _record_verdict(verdict, search, plan, hidden)
    return (
        plan
        | {"true": hidden, "made_s": made, "cpu_s": time.process_time() - began}
        | found
        | {"drawn": truth["drawn"], "held_out": [e.file for e in loaded.entries if e.held_out]}
    )


def _record_verdict(verdict, search, plan: dict, hidden: dict) -> dict:
    """Numbers that the tables need; z of the hidden effect from its sensitivity and its true size."""
    z = 0.0
    for s in search.ranking[0] if search.ranking else ():
        if s.effect in hidden:
            z = abs(hidden[s.effect] / s.candidate.leading_strength[1]) * s.typical_z
    causes = [
        {"effect": c.effect, "ln_bayes": c.ln_bayes, "laboratory": bool(getattr(c, "laboratory", False)),
         "parameters": {p.name: [p.value, p.stderr, *p.ci95] for p in c.parameters}}
        for c in verdict.causes
    ]  # fmt: skip
    return {
        "verdict": verdict.kind, "causes": causes, "group": list(verdict.group), "z": z, "says": list(verdict.says),
        "best": [(r.effect, r.score) for r in verdict.rivals[:3]], "gain": verdict.gain,
        "gates": {k: [float(v), limit] for k, (v, limit) in verdict.gates.items() if v > limit},
    }  # fmt: skip


def run(first: int, last: int, file: Path, **how: bool) -> None:
    """Run all seeds first..last-1 that are not in the file, one after the other."""
    done = {json.loads(line)["seed"] for line in file.read_text().splitlines()} if file.exists() else set()
    for seed in range(first, last):
        if seed in done:
            continue
        try:
            found = run_seed(seed, **how)
        except Exception:  # a failure is a result too
            found = draw_hidden(seed, how.get("small", False)) | {
                "verdict": "failed",
                "error": traceback.format_exc(limit=4),
            }
        with file.open("a") as out:
            out.write(json.dumps(found, default=float) + "\n")
        named = [c["effect"] for c in found.get("causes", [])]
        print(seed, found["kind"], found["hidden"], f"{found.get('z', 0):.1f}", "->", found["verdict"], named,
              found.get("group"), f"{found.get('cpu_s', 0):.0f} s", flush=True)  # fmt: skip


# --- tables ----------------------------------------------------------------------------------------------
def classify_record(r: dict) -> str:
    """right, extra, wrong, group, weak, weak wrong, laboratory, or the verdict itself."""
    physics = {c["effect"] for c in r.get("causes", []) if not c["laboratory"]}
    truth = {r["hidden"]} if r["kind"] == "single" else set()
    truth |= set(KNOWN.get(r["hidden"], ())[:1])
    if r["verdict"] == "weak":
        return "weak" if physics <= truth else "weak wrong"
    if r["verdict"] == "group":
        return "group" if truth & set(r["group"]) else "wrong"
    if r["verdict"] != "named":
        return r["verdict"]
    if not physics:
        return "laboratory"
    return "right" if physics == truth else "extra" if truth and physics > truth else "wrong"


def print_tables(file: Path) -> None:
    """Counts by kind, and of singles by z; coverage of the intervals of what was named rightly; CPU by kind."""
    rows = [json.loads(line) for line in file.read_text().splitlines()]
    print(f"{len(rows)} campaigns, {np.mean([r.get('cpu_s', 0) for r in rows]):.0f} s of CPU each")
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for r in rows:
        label = r["kind"]
        if label == "single":
            low, high = next(b for b in BINS if b[0] <= r.get("z", 0.0) < b[1])
            label = f"one effect, z {low} to {high}"
        elif r["hidden"] in KNOWN:
            label = "walls cooled as sqrt(v)"
        counts[label][classify_record(r)] += 1
    heads = sorted({o for c in counts.values() for o in c})
    print("| hidden | campaigns | " + " | ".join(heads) + " |\n" + "|---" * (len(heads) + 2) + "|")
    for label in sorted(counts):
        print(f"| {label} | {counts[label].total()} | " + " | ".join(str(counts[label][o]) for o in heads) + " |")
    inside, total = 0, 0
    for r in rows:
        if r["hidden"] and classify_record(r) in ("right", "extra", "weak"):
            effect, key, true = KNOWN.get(r["hidden"], (r["hidden"], "", r["true"].get(r["hidden"])))
            name = f"{effect}.{key or TYPICAL[effect][0]}"
            for c in r["causes"]:
                if name in c["parameters"]:
                    _, _, low, high = c["parameters"][name]
                    inside, total = inside + (low <= true <= high), total + 1
    print(f"95 % intervals hold the truth in {inside} of {total}")
    for kind in KINDS:
        spent = [r["cpu_s"] - r["made_s"] for r in rows if r["kind"] == kind and "cpu_s" in r]
        if spent:
            low, high = min(spent), max(spent)
            print(f"CPU s of discovery, {kind}: {np.median(spent):.1f} in the median ({low:.1f} to {high:.1f})")


if __name__ == "__main__":
    if sys.argv[1] == "run":
        how = {word: word in sys.argv[5:] for word in ("small", "held", "varied")}
        run(int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]), **how)
    else:
        print_tables(Path(sys.argv[2]))
