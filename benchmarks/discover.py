"""Blind benchmark of `discover`: outcomes for effects hidden by seed, by signal-to-noise ratio.

    python benchmarks/discover.py run 1000 1300 found.jsonl     one campaign per seed; a number after it: processes (2)
    python benchmarks/discover.py run 1000 1020 found.jsonl wide   made in 3D, judged in 2D, in more or less air
    python benchmarks/discover.py realistic 7000 7050 found.jsonl  by tests/reference, errors of uncooled cameras
    python benchmarks/discover.py store 7000 7050 FOLDER           the campaigns of `realistic`, for campaigns.py
    python benchmarks/discover.py store 8000 8050 FOLDER varied    another block, road, schedule and camera in each
    python benchmarks/discover.py store 7000 7050 FOLDER strong    one strong effect in each
    python benchmarks/discover.py table found.jsonl

In the first two modes `twin` computes the campaign (with another mesh, grading, tolerance, order and CVODE binding),
and the truth is read after the verdict is written.  In the mode `realistic` the independent generator in
tests/reference computes it.  It shares no code with flashtemp, and its cameras have errors (`uncooled_camera`).
Seeds below 1000 are for development, those from 1000 on are blind.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

CASE = Path(__file__).parents[1] / "cases" / "uniform_pressure"
SMALL = {
    "schedule.repetitions": 2, "schedule.distance": 0.6, "schedule.wait": 8.0, "road.track_length": 0.6,
    "numerics.mesh": 0.6,
}  # fmt: skip
WIDE = {"numerics.across": 60, "numerics.first_y": 3e-5, "road.track_length": 1.0}  # walls within 0.1 % of the rise
SINGLE = {  # effects that a campaign of this size can show, with the parameter that is drawn
    "pressure_tilt": "a", "edge_pressure": "B", "pressure_crown": "c", "interface_resistance": "resistance",
    "friction_softening": "b", "track_memory": "strength", "conductivity_slope": "block", "heat_depth": "share",
    "capacity_slope": "block", "ambient_drift": "rate", "side_cooling": "gain", "third_body": "growth",
    "friction_speed": "exponent", "friction_load": "exponent", "time_lag": "lag", "camera_offset": "offset",
    "emissivity": "change", "reflection": "excess", "blur": "sigma", "stick_slip": "amplitude",
    "conductivity_anisotropy": "excess", "internal_heat": "loss",
}  # fmt: skip

REALISTIC = {  # effects of the independent generator: parameter, and a size that is easily detected
    "pressure_tilt": ("a", 0.3), "edge_pressure": ("B", 1.0), "friction_softening": ("b", 0.006),
    "conductivity_slope": ("block", 0.008), "interface_resistance": ("resistance", 2e-5),
    "third_body": ("growth", 2e-5), "side_cooling": ("gain", 40.0), "ambient_drift": ("rate", 0.01),
}  # fmt: skip
FOREIGN = {"waves": 0.2, "polishing": 0.2}  # laws that no effect of the catalogue describes
SETUP_ERRORS: dict[str, tuple[float, float]] = {  # of `varied`: smallest and largest size, of either sign
    "length": (0.02, 0.05), "load": (0.08, 0.2), "speed": (0.05, 0.15), "density": (0.08, 0.2), "larger": (0.015, 0.04),
    "turned": (0.03, 0.08), "clock": (0.1, 0.5), "emissivity": (0.05, 0.15), "mirrored": (1.0, 1.0),
    "exchanged": (1.0, 1.0),
}  # fmt: skip
RATIOS = ("load", "speed", "density")  # of the real value to the stated one
STRENGTH = SINGLE | {name: parameter for name, (parameter, _) in REALISTIC.items()}
COLUMNS = 200  # of the independent generator along the block; with 80, a weak `edge_pressure` is 11 % off
COUNTED = 10_000_000  # steps of a loop that measures the speed of the machine


def draw_realistic(seed: int) -> dict:
    """Hidden content of a seed in the independent generator: kind, effects and relative sizes (1: easily detected)."""
    rng = np.random.default_rng([seed, 79])
    kind = str(rng.choice(["null", "single", "pair", "outside"], p=[0.25, 0.45, 0.15, 0.15]))
    count = {"null": 0, "single": 1, "pair": 2, "outside": 1}[kind]
    names = [str(n) for n in rng.choice(sorted(FOREIGN if kind == "outside" else REALISTIC), size=count, replace=False)]
    size = {n: 1.0 if kind == "outside" else float(np.exp(rng.uniform(np.log(0.08), np.log(1.5)))) for n in names}
    return {"seed": seed, "kind": kind, "hidden": names, "size": size}


def draw_strong(seed: int) -> dict:
    """Hidden content of a seed with one strong effect: 1.5 to 4 times as large as one that is easily detected.

    It stays within 0.9 of the largest value that the effect allows.
    """
    from flashtemp.physics.effect import find_effect

    rng = np.random.default_rng([seed, 82])
    name = str(rng.choice(sorted(REALISTIC)))
    parameter, easily = REALISTIC[name]
    largest = 0.9 * find_effect(name).params()[parameter].high / easily
    size = float(np.exp(rng.uniform(np.log(1.5), np.log(min(4.0, largest)))))
    return {"seed": seed, "kind": "single", "hidden": [name], "size": {name: size}}


def draw_hidden(seed: int) -> dict:
    """Hidden content of a seed: kind, effects and their relative sizes."""
    rng = np.random.default_rng([seed, 77])
    kind = str(rng.choice(["null", "single", "pair", "outside"], p=[0.2, 0.55, 0.15, 0.1]))
    count = {"null": 0, "single": 1, "pair": 2, "outside": 1}[kind]
    names = [str(n) for n in rng.choice(sorted(SINGLE), size=count, replace=False)]
    size = {n: float(np.exp(rng.uniform(np.log(0.05), np.log(1.5)))) for n in names}
    if kind == "outside":
        size = {n: max(s, 0.5) for n, s in size.items()}
    return {"seed": seed, "kind": kind, "hidden": names, "size": size}


def overrides(plan: dict, wide: bool = False) -> dict:
    """Keys of the case with which `twin` hides the drawn effects."""
    from flashtemp.physics.effect import find_effect

    out: dict = dict(SMALL)
    if wide:
        rng = np.random.default_rng([plan["seed"], 78])
        drawn = {"ambient.convection": (8.0, 25.0), "schedule.wait": (3.0, 20.0), "schedule.distance": (0.5, 1.0)}
        out |= WIDE | {key: float(rng.uniform(*span)) for key, span in drawn.items()}
        out["schedule.repetitions"] = int(rng.integers(1, 4))
    if plan["hidden"]:
        out["effects"] = plan["hidden"]
    for name, size in plan["size"].items():
        for k, param in find_effect(name).params().items():
            if param.off is not None and isinstance(param.value, (int, float)):
                size_k = size if k == SINGLE[name] else 0.0
                out[f"{name}.{k}"] = float(
                    np.clip(param.off + size_k * (param.value - param.off), param.low, param.high)
                )
    return out


def flatten_case(case: Path) -> None:
    """Rewrite the case in 2D, which resolves no side walls."""
    text = re.sub(r"(?m)^across = .*$", "across = 1", case.read_text())
    case.write_text(re.sub(r"(?m)^first_y = .*\n", "", text))


def run_seed(seed: int, wide: bool = False) -> dict:
    """Make a campaign, run discovery, then read the truth."""
    from flashtemp.comparison import campaign
    from flashtemp.comparison.synthetic_campaign import SEALED_TRUTH, SyntheticPlan, make_synthetic_campaign
    from flashtemp.discovery import engine
    from flashtemp.model import case

    plan, began = draw_hidden(seed), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "campaign"
        few = {"conditions": 2} if wide else {}
        make_synthetic_campaign(
            case.load_case(CASE, overrides(plan, wide)),
            SyntheticPlan(tuple(plan["hidden"]), seed, sliding=3, **few),
            out,
        )
        if wide:
            flatten_case(out / "case.toml")
        made = time.process_time() - began
        loaded = campaign.load(out)
        if plan["kind"] == "outside":
            loaded = replace(loaded, candidates=_other_candidates(plan["hidden"]))
        verdict, search = engine.discover(loaded, workers=1)
        truth = json.loads((out / SEALED_TRUTH).read_text())
    return plan | _record_verdict(verdict, search, truth) | {"made_s": made, "cpu_s": time.process_time() - began}


def make_realistic(plan: dict, folder: Path) -> tuple[dict, dict]:
    """The campaign that the independent generator computes for uncooled cameras, in `folder`; hidden effects with
    their parameters, and what else was drawn."""
    _find_reference()
    from reference import laboratory

    pitch = {"sidewall": 4e-4, "wake": 1e-3}
    frames = laboratory.continuous_frames(20, 3)
    test = laboratory.MeasurementProgramme(
        0.4, wait=4.0, columns=COLUMNS, mesh=0.5, pitch=pitch, wake_length=0.02, **frames
    )
    return _write_uncooled(plan, folder, test)


def draw_varied(seed: int) -> dict:
    """Hidden content of a varied campaign: as of `draw_realistic`, or in a fifth of all one error of the set-up."""
    rng, plan = np.random.default_rng([seed, 80]), draw_realistic(seed)
    if rng.uniform() > 0.2:
        return plan | {"setup": {}}
    name = str(rng.choice(sorted(SETUP_ERRORS)))
    size = float(np.exp(rng.uniform(*np.log(SETUP_ERRORS[name]))) * rng.choice((-1.0, 1.0)))
    if name == "emissivity":  # stated less real; the real one cannot exceed 1
        size = abs(size)
    return plan | {"kind": "setup", "hidden": [], "size": {}, "setup": {name: size}}


def make_varied(plan: dict, folder: Path) -> tuple[dict, dict]:
    """As `make_realistic`, with a block, road, schedule and cameras that are drawn too, and an error of the set-up."""
    _find_reference()
    from independent import draw_programme
    from reference import laboratory

    rng, drawn = np.random.default_rng([plan["seed"], 81]), draw_programme(plan["seed"])
    frames = laboratory.continuous_frames(int(rng.integers(10, 25)), int(rng.integers(2, 5)))
    test = replace(drawn, columns=COLUMNS, **frames)
    errors = {name: _setup_error(rng, test, name, size) for name, size in plan["setup"].items()}
    return _write_uncooled(plan, folder, test, errors)


def _setup_error(rng: np.random.Generator, test, name: str, size: float) -> Any:
    """The value that `SetupErrors` takes for an error of a size; for an exchange, one view in two conditions."""
    if name != "exchanged":
        return {"length": size * test.pair.length, "mirrored": True}.get(name, 1.0 + size if name in RATIOS else size)
    first, second = rng.choice(len(test.conditions), size=2, replace=False) + 1
    view = rng.choice(("sidewall", "wake"))
    return f"condition{first}_{view}.nc", f"condition{second}_{view}.nc"


def _find_reference() -> None:
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))


def _write_uncooled(plan: dict, folder: Path, test, setup_errors: dict | None = None) -> tuple[dict, dict]:
    """Write the campaign of a plan; its candidates are the effects that the independent generator knows."""
    from reference import laboratory

    hidden = {n: a * REALISTIC[n][1] if n in REALISTIC else FOREIGN[n] for n, a in plan["size"].items()}
    drawn = laboratory.write_campaign(folder, hidden, plan["seed"], test=test, uncooled=True, setup_errors=setup_errors)
    file = folder / "campaign.toml"
    candidates = f"candidates = {json.dumps(list(REALISTIC))}\n"
    file.write_text(re.sub(r"(?m)^case = .*\n", rf"\g<0>{candidates}", file.read_text(), count=1))
    return {n: {REALISTIC[n][0]: a} if n in REALISTIC else {"size": a} for n, a in hidden.items()}, drawn


STORED = {  # kinds of stored campaigns: what draws their hidden content, and what makes them
    "realistic": (draw_realistic, make_realistic),
    "varied": (draw_varied, make_varied),
    "strong": (draw_strong, make_realistic),
}


def store_campaigns(first: int, last: int, folder: Path, kind: str = "realistic") -> None:
    """Campaigns of seeds first..last-1 as `campaigns.py run` reads them."""
    draw, make = STORED[kind]
    for seed in range(first, last):
        own, plan = folder / f"{kind}_{seed}", draw(seed)
        hidden, drawn = make(plan, own / "campaign")
        truth = {"kind": plan["kind"], "hidden": hidden, "drawn": drawn["drawn"], "recordings": drawn["recordings"]}
        truth["setup"] = plan.get("setup", {})
        (own / "truth.json").write_text(json.dumps(truth, default=float))


def run_realistic_seed(seed: int) -> dict:
    """Make a campaign of the independent generator for uncooled cameras, run discovery, then read the truth."""
    from flashtemp.comparison import campaign
    from flashtemp.discovery import engine

    plan, count_s = draw_realistic(seed), time_counting()
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        hidden, drawn = make_realistic(plan, Path(folder))
        made = time.process_time() - began
        verdict, search = engine.discover(campaign.load(folder), workers=1)
    cpu = time.process_time() - began
    truth = {"hidden": hidden, "nuisance": drawn["drawn"]}
    cameras = {file: r["camera"] for file, r in drawn["recordings"].items()}
    found = _record_verdict(verdict, search, truth) | {"cameras": cameras}
    return plan | found | {"made_s": made, "cpu_s": cpu, "count_s": count_s}


def time_counting() -> float:
    """CPU seconds in which this machine counts to ten million."""
    began, count = time.process_time(), 0
    while count < COUNTED:
        count += 1
    return time.process_time() - began


def _other_candidates(hidden: list[str]) -> tuple[str, ...]:
    """The catalogue without the hidden effects."""
    from flashtemp.physics.effect import catalogue

    return tuple(n for n, e in catalogue().items() if e.candidate and not e.alike and n not in hidden)


def _record_verdict(verdict, search, truth: dict) -> dict:
    """The numbers of a verdict for the tables."""
    from flashtemp.physics.effect import find_effect

    z = {}
    for ranked in search.ranking[:1]:
        for s in ranked:
            if s.effect in truth["hidden"]:
                k = STRENGTH[s.effect]
                a = s.candidate.strengths[k]
                z[s.effect] = (
                    abs(truth["hidden"][s.effect][k] - find_effect(s.effect).params()[k].off) / abs(a) * s.typical_z
                )
    causes = []
    for c in verdict.causes:
        for p in c.parameters:
            name = p.name.split(".")[1]
            true = truth["hidden"].get(c.effect, {}).get(name)
            if name == STRENGTH.get(c.effect):
                causes.append({"effect": c.effect, "value": p.value, "stderr": p.stderr, "ci95": p.ci95, "true": true,
                               "ln_bayes": c.ln_bayes})  # fmt: skip
    scores = [(r.effect, r.score) for r in verdict.rivals[:3]]
    return {
        "verdict": verdict.kind, "causes": causes, "accepted": [c.effect for c in verdict.causes],
        "group": list(verdict.group), "z": z, "truth": truth["hidden"], "best": scores,
        "gates": {k: [float(v), limit] for k, (v, limit) in verdict.gates.items()},
        "chi2": verdict.base.chi2_per_dof if verdict.base else None,
        "held_out": [c.held_out_gain for c in verdict.causes],
        "bias": {n: [b, a, s] for n, b, a, s in verdict.shifts},
        "nuisance": truth["nuisance"],
    }  # fmt: skip


def run(first: int, last: int, file: Path, processes: int = 2, mode: str = "") -> None:
    """Run all seeds first..last-1 that are not in the file yet."""
    from concurrent.futures import ProcessPoolExecutor, as_completed

    done = {json.loads(line)["seed"] for line in file.read_text().splitlines()} if file.exists() else set()
    seeds = [s for s in range(first, last) if s not in done]
    with ProcessPoolExecutor(processes) as pool, file.open("a") as out:
        for future in as_completed([pool.submit(attempt_seed, s, mode) for s in seeds]):
            found = future.result()
            out.write(json.dumps(found, default=float) + "\n")
            out.flush()
            z = {k: round(v, 1) for k, v in found.get("z", {}).items()}
            named = found.get("accepted"), found.get("group"), f"{found.get('cpu_s', 0):.0f} s"
            print(found["seed"], found["kind"], found["hidden"], z, "->", found["verdict"], *named, flush=True)


def attempt_seed(seed: int, mode: str = "") -> dict:
    """One campaign of a mode, realistic, wide or neither; a failure is a result too."""
    try:
        return run_realistic_seed(seed) if mode == "realistic" else run_seed(seed, mode == "wide")
    except Exception:
        plan = draw_realistic(seed) if mode == "realistic" else draw_hidden(seed)
        return plan | {"verdict": "failed", "error": traceback.format_exc(limit=4)}


# --- tables ----------------------------------------------------------------------------------------------
BINS = ((0, 5), (5, 10), (10, 20), (20, np.inf))


def classify_record(r: dict) -> str:
    """right, group, weak, none, unexplained, extra or wrong."""
    truth, found = set(r["hidden"]), set(r.get("accepted", []))
    if r["verdict"] in ("none_needed", "unexplained", "no_verdict", "failed"):
        return {"none_needed": "none"}.get(r["verdict"], r["verdict"])
    if r["verdict"] == "weak":
        return "weak" if found <= truth else "weak wrong"
    if r["verdict"] == "group":
        return "group" if truth & set(r["group"]) else "wrong"
    return "right" if found == truth else "extra" if found > truth else "part" if found < truth else "wrong"


def print_tables(file: Path) -> None:
    rows = [json.loads(line) for line in file.read_text().splitlines()]
    kinds = defaultdict(list)
    for r in rows:
        kinds[r["kind"]].append(r)
    print(f"{len(rows)} campaigns, {np.mean([r.get('cpu_s', 0) for r in rows]):.0f} s of CPU each")
    if counts := [r["count_s"] for r in rows if "count_s" in r]:
        found = [r["cpu_s"] - r["made_s"] for r in rows if "count_s" in r]
        print(f"discovery: {np.median(found):.0f} s of CPU in the median, {max(found):.0f} s at most")
        print(f"the machine counts to ten million in {np.median(counts):.2f} s")
    print("\n| z of the hidden effect | campaigns | right | group | weak | none | unexplained | extra | wrong |")
    print("|---|---|---|---|---|---|---|---|---|")
    for low, high in BINS:
        own = [r for r in kinds["single"] if r.get("z") and low <= max(r["z"].values()) < high]
        n = Counter(classify_record(r) for r in own)
        cells = [len(own), n["right"], n["group"], n["weak"], n["none"], n["unexplained"], n["extra"],
                 n["wrong"] + n["weak wrong"]]  # fmt: skip
        print(f"| {low} to {high} | " + " | ".join(map(str, cells)) + " |")
    for kind in ("null", "pair", "outside"):
        print(kind, dict(Counter(classify_record(r) for r in kinds[kind])))
    for low, high in BINS:
        own = [r for r in kinds["pair"] if len(r.get("z", {})) == 2 and low <= min(r["z"].values()) < high]
        print(f"pairs whose weaker z is {low} to {high}:", dict(Counter(classify_record(r) for r in own)))
    for r in sorted(kinds["outside"], key=lambda r: r["hidden"]):
        print(f"  left out of the catalogue: {r['hidden'][0]} -> {r['verdict']} {', '.join(r.get('accepted', []))}")
    good = [
        (c, r) for r in kinds["single"] if classify_record(r) == "right" for c in r["causes"] if c["true"] is not None
    ]
    inside = sum(c["ci95"][0] <= c["true"] <= c["ci95"][1] for c, _ in good)
    errors = [abs(c["value"] / c["true"] - 1) for c, r in good if max(r["z"].values()) >= 10]
    pulls = [(c["value"] - c["true"]) / max(c["stderr"], 1e-300) for c, _ in good]
    if good:
        print(f"95 % intervals cover {inside} of {len(good)}; spread of (found - true)/stderr {np.std(pulls):.2f}")
        print(f"error at z >= 10: median {100 * np.median(errors):.1f} %, p90 {100 * np.quantile(errors, 0.9):.1f} %")
    confused = Counter((r["hidden"][0], ",".join(r.get("accepted", [])) or r["verdict"]) for r in kinds["single"]
                       if classify_record(r) not in ("right",))  # fmt: skip
    for (true, named), count in confused.most_common():
        print(f"  {true} -> {named}: {count}")


if __name__ == "__main__":
    if sys.argv[1] in ("run", "realistic"):
        processes = [int(word) for word in sys.argv[5:] if word != "wide"]
        mode = sys.argv[1] if sys.argv[1] == "realistic" else "wide" if "wide" in sys.argv[5:] else ""
        run(int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]), *processes, mode=mode)
        if mode == "realistic":
            print_tables(Path(sys.argv[4]))
    elif sys.argv[1] == "store":
        store_campaigns(int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]), *sys.argv[5:])
    else:
        print_tables(Path(sys.argv[2]))
