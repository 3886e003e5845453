"""benchmarks/campaigns.py: campaigns on disk judged one process each, with a limit, and counted against the truth."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

from flashtemp.discovery.verdict import InputCorrection, Verdict

FILE = Path(__file__).parents[2] / "benchmarks" / "campaigns.py"
ENGINE = """
from flashtemp.discovery.verdict import Cause, ParameterEstimate, CandidateReport, Verdict

def discover(campaign, watch, workers):
    assert workers == 1
    if campaign.title == "endless":
        watch("counting")
        while True:
            pass
    if campaign.title == "broken":
        raise ValueError("no such thing")
    tilt = ParameterEstimate("pressure_tilt.a", 0.31, 0.02, (0.27, 0.35))
    cause = Cause("pressure_tilt", "a tilt", (tilt,), 50.0, 10.0, 1.0, ln_bayes=25.0)
    rivals = (
        CandidateReport("pressure_tilt", 24.0, 1.0, "accepted", parameter="pressure_tilt.a", detectable=0.1),
        CandidateReport("edge_pressure", 3.0, 1.0, "too little", parameter="edge_pressure.B", detectable=0.5),
        CandidateReport("time_lag", 9.0, 1.0, "less", parameter="time_lag.lag", detectable=0.1),
        CandidateReport("blur", -2.0, 1.0, "less", parameter="blur.sigma", detectable=0.1),
    )
    return Verdict(campaign.title, "named", ("a tilt.",), causes=(cause,), rivals=rivals), None
"""
TILT = {"pressure_tilt": {"a": 0.3}}


@pytest.fixture(scope="module")
def campaigns():
    spec = importlib.util.spec_from_file_location("campaigns", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """Results of three campaigns under an engine that names a tilt, breaks or never ends; printed lines; a rerun's."""
    folder = tmp_path_factory.mktemp("judged")
    (folder / "stub_engine.py").write_text(ENGINE)
    for title in ("named", "broken", "endless"):
        own = folder / title / "campaign"
        own.mkdir(parents=True)
        (own / "case.toml").write_text("[block]\nlength = 0.025\n[contact]\npressure = 1e5\n[friction]\nmu = 1.0\n")
        (own / "mu.csv").write_text("time_s,mu\n0.5,1.0\n1.0,1.0\n")
        (own / "campaign.toml").write_text(f'title = "{title}"\ncase = "case.toml"\n[[force]]\nfile = "mu.csv"\n')
        (own.parent / "truth.json").write_text(json.dumps({"kind": "single", "hidden": TILT}))
    words = [sys.executable, FILE, "run", folder, folder / "results.jsonl", "--engine", "stub_engine", "--limit", "1"]
    environment = {"PYTHONPATH": f"{folder}:{FILE.parents[1]}", "PATH": "/usr/bin:/bin"}

    def run(*more):
        done = subprocess.run([*words, *more], capture_output=True, text=True, env=environment, check=True)
        return done.stdout.splitlines()

    printed = [run("--only", "named"), run("--processes", "3"), run()]
    rows = [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()]
    return {r["name"]: r for r in rows}, printed, folder / "results.jsonl"


def test_every_campaign_runs_once_and_is_appended_as_it_ends(judged):
    rows, (only, rest, again), file = judged
    assert len(file.read_text().splitlines()) == len(rows) == 3
    assert [line.split(":")[0] for line in only] == ["named"]
    assert {line.split(":")[0] for line in rest} == {"broken", "endless"}
    assert again == []


def test_a_verdict_is_recorded_with_its_evidence(judged):
    row = judged[0]["named"]
    assert (row["verdict"], row["effects"], row["inputs"], row["group"]) == ("named", ["pressure_tilt"], [], [])
    assert row["best"] == [["pressure_tilt", 25.0], ["time_lag", 9.0], ["edge_pressure", 3.0]]
    assert row["z"] == {"pressure_tilt": pytest.approx(5.0 * 0.3 / 0.1)}
    [parameter] = row["parameters"]
    assert (parameter["name"], parameter["true"], parameter["ci95"]) == ("pressure_tilt.a", 0.3, [0.27, 0.35])
    assert 0.0 <= row["cpu_s"] <= 1.0
    assert row["wall_s"] > 0.0 < row["count_s"]


def test_a_campaign_beyond_its_cpu_limit_is_a_timeout_that_says_how_far_it_came(judged):
    row = judged[0]["endless"]
    assert (row["verdict"], row["stage"], row["cpu_s"]) == ("timeout", "counting", 1.0)


def test_a_failure_is_recorded_with_its_traceback(judged):
    row = judged[0]["broken"]
    assert row["verdict"] == "failed"
    assert "ValueError: no such thing" in row["error"]
    assert "stub_engine.py" in row["error"]


@pytest.mark.parametrize(("kind", "counted"), [("held_key", True), ("named", False)])
def test_a_stated_number_counts_as_named_where_it_is_the_verdict(campaigns, kind, counted):
    key = InputCorrection("contact.pressure", 1e5, 1.1e5, 1e3, "Pa", 20.0, "the pressure")
    found = campaigns.describe_verdict(Verdict("a", kind, (), held_key=key), {})
    assert found["inputs"] == ["contact.pressure"] * counted


def record(kind="single", verdict="named", effects=(), hidden=TILT, **more):
    base = {"name": "a", "kind": kind, "hidden": hidden, "setup": {}, "verdict": verdict, "effects": list(effects)}
    return base | {"engine": "e", "inputs": [], "group": [], "parameters": [], "z": {}, "cpu_s": 1.0} | more


PAIR = TILT | {"time_lag": {"lag": 0.1}}
SETUP = {"kind": "setup", "hidden": {}}


@pytest.mark.parametrize(
    ("expected", "fields"),
    [
        ("right", {"effects": ["pressure_tilt"]}),
        ("extra", {"effects": ["pressure_tilt", "blur"]}),
        ("wrong", {"effects": ["blur"]}),
        ("weak", {"verdict": "weak", "effects": ["pressure_tilt"]}),
        ("weak wrong", {"verdict": "weak", "effects": ["blur"]}),
        ("group", {"verdict": "group", "effects": ["blur"], "group": ["blur", "pressure_tilt"]}),
        ("wrong", {"verdict": "group", "effects": ["blur"], "group": ["blur", "time_lag"]}),
        ("law", {"verdict": "learned", "effects": ["learned_law"]}),
        ("wrong", {"inputs": ["block_length"]}),
        ("wrong", {"effects": ["pressure_tilt"], "inputs": ["pixel_scale"]}),
        ("wrong", {"verdict": "held_key", "inputs": ["materials.asphalt.density"]}),
        ("wrong", {"verdict": "group", "group": ["blur", "pressure_tilt"], "inputs": ["pixel_scale"]}),
        ("wrong", {"verdict": "learned", "effects": ["learned_law"], "inputs": ["pixel_scale"]}),
        ("weak wrong", {"verdict": "weak", "effects": ["pressure_tilt"], "inputs": ["pixel_scale"]}),
        ("extra", {"verdict": "group", "effects": ["pressure_tilt", "time_lag"], "group": ["pressure_tilt", "blur"]}),
        ("none", {"verdict": "none_needed"}),
        ("timeout", {"verdict": "timeout"}),
        ("right", {"kind": "pair", "hidden": PAIR, "effects": ["time_lag", "pressure_tilt"]}),
        ("part", {"kind": "pair", "hidden": PAIR, "effects": ["time_lag"]}),
        ("none", {"kind": "null", "hidden": {}, "verdict": "none_needed"}),
        ("wrong", {"kind": "null", "hidden": {}, "effects": ["blur"]}),
        ("wrong", {"kind": "null", "hidden": {}, "inputs": ["pixel_scale"]}),
        ("wrong", {"kind": "null", "hidden": {}, "verdict": "none_needed", "inputs": ["clock"]}),
        ("weak wrong", {"kind": "null", "hidden": {}, "verdict": "weak", "effects": ["blur"]}),
        ("right", {"kind": "outside", "hidden": {"waves": {}}, "verdict": "learned", "effects": ["learned_law"]}),
        ("wrong", {"kind": "outside", "hidden": {"waves": {}}, "effects": ["blur"]}),
        ("right", SETUP | {"setup": {"length": 1e-3}, "inputs": ["block_length"]}),
        ("right", SETUP | {"setup": {"length": 1e-3}, "inputs": ["block_length", "pixel_scale"]}),
        ("right", SETUP | {"setup": {"emissivity": 0.3}, "inputs": ["sidewall.emissivity"]}),
        ("right", SETUP | {"setup": {"clock": 0.1}, "effects": ["time_lag"]}),
        ("right", SETUP | {"setup": {"mirrored": True, "recordings": ["a.nc"]}, "inputs": ["mirrored"]}),
        ("wrong", SETUP | {"setup": {"length": 1e-3}, "inputs": ["image_turn"]}),
        ("wrong", SETUP | {"setup": {"length": 1e-3}, "inputs": ["block_length", "image_turn"]}),
        ("wrong", SETUP | {"setup": {"length": 1e-3}, "inputs": ["block_length"], "effects": ["pressure_tilt"]}),
        ("wrong", SETUP | {"setup": {"turned": 0.03}, "effects": ["pressure_tilt"]}),
        ("part", SETUP | {"setup": {"turned": 0.03, "length": 1e-3}, "inputs": ["image_turn"]}),
        ("weak", SETUP | {"setup": {"turned": 0.03}, "inputs": ["image_turn"], "verdict": "weak"}),
        ("unexplained", SETUP | {"setup": {"turned": 0.03}, "inputs": ["image_turn"], "verdict": "unexplained"}),
        ("none", SETUP | {"setup": {"turned": 0.03}, "verdict": "none_needed"}),
    ],
)
def test_outcomes_are_classified_against_the_truth(campaigns, expected, fields):
    assert campaigns.classify(record(**fields)) == expected


def test_the_table_counts_outcomes_by_z_and_coverage_with_exact_bounds(campaigns):
    def found(low, high):
        return {"parameters": [{"name": "pressure_tilt.a", "ci95": [low, high], "true": 0.3}]}

    rows = [record(effects=["pressure_tilt"], z={"pressure_tilt": 7.0}, **found(0.2, 0.4)) for _ in range(9)]
    rows += [record(effects=["pressure_tilt"], z={"pressure_tilt": 30.0}, **found(0.31, 0.4))]
    rows += [record(verdict="timeout", z={}, cpu_s=99.0), record("null", "none_needed", hidden={})]
    lines = "\n".join(campaigns.tabulate(rows))
    assert "| single, z 5 to 10 | 9 | 9 |" in lines
    assert "| single, z 20 to inf | 1 | 1 |" in lines
    assert "| single, z unknown | 1 | 0 | 0 | 1 |" in lines
    assert "9 of 10 (55 to 100 %)" in lines  # Clopper and Pearson 1934: 0.555 to 0.9975
    assert "max 99.0" in lines


def test_the_table_has_a_row_per_source_and_kind(campaigns):
    rows = [record(name="twin_blur_1", hidden={"blur": {}}, effects=["blur"]), record(name="twin_wear_2")]
    rows += [record("null", "none_needed", name=f"realistic_{k}", hidden={}) for k in range(3)]
    rows += [record("setup", name="setup_load", hidden={}, setup={"load": 1.1}, inputs=["contact.pressure"])]
    [head, *table] = "\n".join(campaigns.tabulate(rows)).split("| source ")[1].splitlines()
    assert head.split("|")[1:-1] == [" campaigns ", " right ", " none "]
    assert table[1:4] == [
        "| realistic, null | 3 | 0 | 3 |",
        "| setup, setup | 1 | 1 | 0 |",
        "| twin, single | 2 | 1 | 1 |",
    ]
    assert [line.split(":")[0] for line in table if "CPU s" in line] == ["realistic", "setup", "twin", "all"]


def test_the_summary_counts_every_campaign_once_and_no_cause_in_nothing_as_right(campaigns, tmp_path):
    """A core that counts in 0.36 s is half as fast as the reference: 40 s are 20 s there."""
    found = {
        "parameters": [{"name": "pressure_tilt.a", "ci95": [0.2, 0.4], "true": 0.3}],
        "count_s": 0.36,
        "cpu_s": 40.0,
    }
    rows = [record(name="ideal_1", effects=["pressure_tilt"], z={"pressure_tilt": 7.0}, **found)]
    rows += [record(name="ideal_2", effects=["pressure_tilt", "blur"], z={"pressure_tilt": 8.0}, count_s=0.36)]
    rows += [
        record(name="ideal_3", kind="null", verdict=v, hidden={}, count_s=0.36) for v in ("none_needed", "timeout")
    ]
    found = campaigns.summarise(rows)
    assert [(r["set"], r["kind"], r["campaigns"]) for r in found["rows"]] == [
        ("ideal", "null", 2), ("ideal", "single, z 5 to 10", 2),
    ]  # fmt: skip
    null, single = found["rows"]
    assert (null["right"], null["no_verdict"], null["none"]) == (1, 1, 0)
    assert (single["right"], single["wrong"], single["max_cpu_s"]) == (1, 1, 20.0)
    assert all(sum(r[c] for c in campaigns.SUMMARY_COLUMNS) == r["campaigns"] for r in found["rows"])
    assert found["intervals"] == [{"set": "ideal", "inside": 1, "intervals": 1}]
    assert sorted(o for some in campaigns.SUMMARY_COLUMNS.values() for o in some) == sorted(campaigns.OUTCOMES)


def test_a_summary_replaces_its_own_sets_and_keeps_others(campaigns, tmp_path, monkeypatch):
    out, results = tmp_path / "summary.json", tmp_path / "results.jsonl"
    for names in (("ideal_1", "setup_1"), ("ideal_1", "ideal_2")):
        rows = [record(name=n, effects=["pressure_tilt"], z={"pressure_tilt": 7.0}) for n in names]
        results.write_text("".join(json.dumps(r) + "\n" for r in rows))
        monkeypatch.setattr(sys, "argv", ["campaigns.py", "summary", str(results), "--out", str(out)])
        campaigns.main()
    found = json.loads(out.read_text())
    assert [(r["set"], r["campaigns"]) for r in found["rows"]] == [("ideal", 2), ("setup", 1)]


def test_cpu_seconds_are_shown_raw_and_scaled_to_the_reference_core(campaigns):
    """A core that counts in 0.36 s is half as fast as the reference: 40 s are 20 s there; a timeout takes the median."""
    rows = [record(cpu_s=s, count_s=0.36) for s in (20.0, 40.0)] + [record(verdict="timeout", cpu_s=300.0)]
    [line] = [line for line in campaigns.tabulate(rows) if line.startswith("all")]
    assert "CPU s median 40.0" in line
    assert "scaled median 20.0" in line
    assert line.count("max 300.0") == line.count("max 150.0") == 1


def test_a_results_file_refuses_another_engine(campaigns, judged, tmp_path):
    with pytest.raises(SystemExit, match="other_engine and stub_engine"):
        campaigns.run_campaigns(judged[2].parent, judged[2], "*", "other_engine", 1, 1)
    mixed = tmp_path / "mixed.jsonl"
    mixed.write_text("".join(json.dumps(record(engine=e)) + "\n" for e in ("old", "new")))
    with pytest.raises(SystemExit, match="verdicts of new and old"):
        campaigns.read_records(mixed)


def test_two_files_are_compared_campaign_by_campaign(campaigns):
    old = [record(name="a", verdict="timeout", z={}), record(name="b", effects=["pressure_tilt"])]
    new = [record(name="a", effects=["pressure_tilt"], z={"pressure_tilt": 12.0}), old[1], record(name="c")]
    lines = list(campaigns.compare_records(old, new))
    changed = lines[next(i for i, line in enumerate(lines) if "| campaign |" in line) + 1 :]
    assert len(changed) == 1
    assert changed[0].startswith("| a | pressure_tilt | 12 | timeout: timeout")
    assert "right: named pressure_tilt" in changed[0]
    assert sum(line.startswith("| single, z 10 to 20 | 1 |") for line in lines) == 2
