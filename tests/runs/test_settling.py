"""How many repetitions until data are reproducible: known answers, honest intervals, honest refusals."""

from __future__ import annotations

import json
import math
import re
import shutil

import numpy as np
import pytest
from scipy.stats import binom

from flashtemp.__main__ import main
from flashtemp.api.simulation import simulate
from flashtemp.errors import BadInput
from flashtemp.model.case import load_case
from flashtemp.runs.studies.relaxation_fit import MeanRecord, RelaxationFit
from flashtemp.runs.studies.running_in import (
    INTERVAL_CONFIDENCE,
    RELAXATION_PARAMETERS,
    analyse_running_in,
    fit_relaxation,
    read_record,
)

FINAL, START = 0.9, 0.8


def curve(s_w: float, start: float = START, final: float = FINAL):
    return lambda s: final + (start - final) * np.exp(-s / s_w)


def record(s_w, begin, end, **given) -> MeanRecord:
    """Means over stretches by quadrature, nothing of the fit's own formulas."""
    value = curve(s_w, given.pop("start", START), given.pop("final", FINAL))
    a, b = np.array(begin, float), np.array(end, float)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    means = 0.5 * value(0.5 * (a + b)[:, None] + 0.5 * (b - a)[:, None] * nodes) @ weights
    return MeanRecord(a, b, means, **given)


def repetitions(s_w: float, n: int, d: float = 3.5, **given) -> MeanRecord:
    return record(s_w, d * np.arange(n), d * np.arange(1, n + 1), length=d, **given)


def noisy(rng, s_w: float, n: int, noise: float, known: bool, start: float = START) -> MeanRecord:
    """Repetitions of 1 m with independent normal noise, and its sigma if known."""
    clean = repetitions(s_w, n, 1.0, start=start)
    sigma = np.full(n, noise) if known else None
    return MeanRecord(clean.begin, clean.end, clean.value + noise * rng.normal(size=n), sigma, 1.0)


# --- without noise ---------------------------------------------------------------------------------
LENGTHS = np.array([3.5, 1.0, 2.0, 7.0, 3.5, 3.5, 10.0])


EXACT = {
    "ordinary": (8.0, repetitions(8.0, 10)),
    "short": (2.0, repetitions(2.0, 6)),
    "long": (60.0, repetitions(60.0, 10)),
    "four": (8.0, repetitions(8.0, 4)),
    "lengths differ": (8.0, record(8.0, np.cumsum(LENGTHS) - LENGTHS, np.cumsum(LENGTHS), length=3.5)),
    "some are missing": (8.0, record(8.0, [7.0, 10.5, 17.5, 35.0, 70.0], [10.5, 14.0, 21.0, 38.5, 73.5], length=3.5)),
    "falls": (8.0, repetitions(8.0, 10, start=1.1, final=0.7)),
    "to zero": (8.0, repetitions(8.0, 10, start=1.4, final=0.0, of="pressure", absolute=True)),
    "to uneven": (8.0, repetitions(8.0, 10, start=1.4, final=0.3, of="pressure", absolute=True)),
}
ENDS = {"falls": (1.1, 0.7), "to zero": (1.4, 0.0), "to uneven": (1.4, 0.3)}


@pytest.mark.parametrize("name", EXACT)
def test_exact_averages_give_the_exact_answer(name):
    s_w, data = EXACT[name]
    start, final = ENDS.get(name, (START, FINAL))
    answer = fit_relaxation(data, 0.01)
    assert answer.s_w == pytest.approx(s_w, rel=1e-6)
    assert answer.start == pytest.approx(start, rel=1e-6)
    assert answer.final == pytest.approx(final, rel=1e-6, abs=1e-8)
    assert answer.s_w_interval == pytest.approx((s_w, s_w), rel=1e-4)
    allowed = 0.01 if data.absolute else 0.01 * final
    assert answer.slid == pytest.approx(s_w * math.log(abs(start - final) / allowed), rel=1e-6)
    assert answer.repetitions == math.ceil(answer.slid / 3.5)
    rest = [abs(curve(s_w, start, final)(3.5 * n) - final) for n in (answer.repetitions - 1, answer.repetitions)]
    assert rest[1] <= allowed < rest[0]


def test_unevenness_does_not_fall_below_zero():
    """Pressure whose decay quickens at the end, as in cases/run_in, would be drawn below zero by a free fit."""
    s = 3.5 * np.arange(11)
    value = 1.4 * np.exp(-s[1:] / 20 - (s[1:] / 50) ** 2)
    free = MeanRecord(s[:-1], s[1:], value)
    answer = fit_relaxation(MeanRecord(s[:-1], s[1:], value, of="pressure", absolute=True))
    assert RelaxationFit(free).final < -0.1
    assert answer.final == 0.0
    assert answer.s_w == pytest.approx(-1 / np.polyfit(s[1:], np.log(value), 1)[0], rel=0.1)


def test_middle_of_a_long_repetition_is_not_enough():
    """A fit to the middles would give another start: averaging over a repetition is accounted for."""
    data = repetitions(2.0, 6)
    middle = 0.5 * (data.begin + data.end)
    assert fit_relaxation(data).start == pytest.approx(START, rel=1e-6)
    assert fit_relaxation(MeanRecord(middle, middle, data.value)).start < START - 0.01


def test_readings_at_a_point():
    s = np.arange(0.0, 30.0, 2.5)
    answer = fit_relaxation(MeanRecord(s, s, np.array([curve(8.0)(v) for v in s])))
    assert answer.s_w == pytest.approx(8.0, rel=1e-6)
    assert answer.repetitions is None
    assert f"after {answer.slid:.3g} m" in answer.says


# --- with noise: how often the truth lies inside, by seeds ------------------------------------------
TRIES = 300


@pytest.mark.parametrize("known", [True, False], ids=["sigma given", "from residuals"])
@pytest.mark.parametrize(("s_w", "n", "noise"), [(3.0, 15, 0.005), (6.0, 20, 0.004), (2.0, 6, 0.002)])
@pytest.mark.sample("2.0-6-0.002-from residuals")
def test_intervals_hold_the_truth_as_often_as_they_say(known, s_w, n, noise):
    rng = np.random.default_rng(11)
    fits = [RelaxationFit(noisy(rng, s_w, n, noise, known)) for _ in range(TRIES)]
    intervals = np.array([fit.s_w_interval(fit.chi2_limit(INTERVAL_CONFIDENCE)) for fit in fits])
    closed = [fit for fit, (_, high) in zip(fits, intervals, strict=True) if high < math.inf]
    assert len(closed) >= 0.9 * TRIES
    truths = [(s_w, intervals.T)]
    for within in (0.01, 0.08):  # a late answer hangs on s_w, an early one on the height of the change
        reach = np.array([fit.slid_distance_interval(within, fit.chi2_limit(INTERVAL_CONFIDENCE)) for fit in closed])
        truths.append((s_w * math.log(0.1 / (within * FINAL)), reach.T))
    for truth, (low, high) in truths:
        inside = np.mean((low <= truth) & (truth <= high))
        print(f"{truth:.3g}: inside {inside:.3f}, missed above {np.mean(high < truth):.3f}")
        assert 0.92 <= inside <= 0.98
    errors = np.array([fit.s_w for fit in closed]) - s_w
    assert abs(np.median(errors)) < 0.15 * np.std(errors)
    assert np.median([fit.s_w_error for fit in closed]) == pytest.approx(np.std(errors), rel=0.35)


@pytest.mark.parametrize("known", [True, False], ids=["sigma given", "from residuals"])
@pytest.mark.parametrize("n", [5, 10, 40])
@pytest.mark.sample("10-from residuals")
def test_no_relaxation_is_seldom_taken_for_one(known, n):
    rng = np.random.default_rng(3)
    fits = [RelaxationFit(noisy(rng, 3.0, n, 0.004, known, start=FINAL)) for _ in range(TRIES)]
    seen = sum(fit.constant > fit.chi2_limit(INTERVAL_CONFIDENCE, RELAXATION_PARAMETERS) for fit in fits)
    assert seen <= binom.ppf(0.999, TRIES, 0.06)


# --- what the data cannot say -------------------------------------------------------------------------
def check_cannot(answer, says: str) -> None:
    assert says in str(answer)
    assert answer.s_w is None
    assert answer.slid is None
    assert answer.repetitions is None


def test_three_values():
    check_cannot(fit_relaxation(repetitions(8.0, 3)), "3 values are too few; at least 4 repetitions are needed")


def test_no_trend():
    answer = fit_relaxation(noisy(np.random.default_rng(1), 3.0, 12, 0.0027, False, start=FINAL))
    check_cannot(answer, "no relaxation detected: the change is below the scatter; already reproducible to 0.18 %")
    assert answer.scatter == pytest.approx(0.0027, rel=0.5)


@pytest.mark.parametrize("value", [0.0, 0.9])
def test_nothing_changes_at_all(value):
    n = np.arange(6.0)
    check_cannot(fit_relaxation(MeanRecord(n, n + 1, np.full(6, value), length=1.0)), "already reproducible to 0 %")


def test_scatter_above_what_is_asked_says_how_many_to_average():
    answer = fit_relaxation(noisy(np.random.default_rng(1), 3.0, 12, 0.0027, False, start=FINAL), within=0.001)
    assert "scatter by 0.18 %, more than 0.1 %: average 4 repetitions" in str(answer)


def test_straight_line():
    """A trend without curvature sets a lower end to s_w only."""
    rng = np.random.default_rng(2)
    n = np.arange(10)
    answer = fit_relaxation(
        MeanRecord(3.5 * n, 3.5 * (n + 1), 0.8 + 0.004 * n + 1e-4 * rng.normal(size=10), length=3.5)
    )
    check_cannot(answer, "relaxation is longer than your data, s_w at least ")
    low, high = answer.s_w_interval
    assert high == math.inf
    assert low > 35
    assert f"slide at least {2 * low - 35:.3g} more metres" in answer.says


def test_far_beyond_the_data():
    """Even without noise nothing is extrapolated from a tenth of the change."""
    check_cannot(fit_relaxation(repetitions(400.0, 10)), "relaxation is longer than your data")


def test_too_noisy_to_end():
    answers = [fit_relaxation(noisy(np.random.default_rng(k), 3.0, 10, 0.012, False)) for k in range(30)]
    open_ended = [a for a in answers if a.s_w_interval and a.s_w_interval[1] == math.inf]
    assert open_ended
    for a in open_ended:
        check_cannot(a, "relaxation may be longer than your data")
        assert "slide at least 5 more" in a.says


def test_only_the_first_differs():
    rng = np.random.default_rng(4)
    value = 0.9 + 0.001 * rng.normal(size=10) - 0.05 * (np.arange(10) == 0)
    answer = fit_relaxation(MeanRecord(np.arange(10), np.arange(1, 11), value, length=1.0, unit="repetitions"))
    check_cannot(
        answer, "only the first values differ for certain: within 1 % of its final value after at most 1 repetitions"
    )
    assert answer.s_w_interval[0] == 0.0
    assert answer.s_w_interval[1] < 1.0


def test_sigma_too_small_widens():
    rng = np.random.default_rng(5)
    data = noisy(rng, 3.0, 15, 0.004, True)
    honest = fit_relaxation(data)
    bold = fit_relaxation(MeanRecord(data.begin, data.end, data.value, data.sigma / 10, 1.0))
    assert "times as much as their sigma states" in str(bold)
    wide = [a.s_w_interval[1] - a.s_w_interval[0] for a in (bold, honest)]
    assert wide[0] > 0.5 * wide[1]


def test_structured_residuals_are_told():
    """Two relaxations, as of a block that wears and warms."""
    n = np.arange(20)
    two = 0.9 - 0.1 * np.exp(-n / 4.0) + 0.05 * np.exp(-n / 1.0) + 1e-5 * np.random.default_rng(0).normal(size=20)
    answer = fit_relaxation(MeanRecord(n, n, two, length=1.0, unit="repetitions"))
    assert "not a single exponential" in str(answer)
    assert "without the first 1 to 3 values s_w = " in str(answer)
    told = sum(
        "not one" in str(fit_relaxation(noisy(np.random.default_rng(k), 4.0, 20, 0.003, False))) for k in range(60)
    )
    assert told <= 4


# --- a result folder ----------------------------------------------------------------------------------
RATE, MU, STIFFNESS = 2e-9, 0.8, 1.4e9  # pressure relaxes over 1/(k_n k mu) = 0.446 m


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Constant friction on a block that touches everywhere: its pressure relaxes as one exponential."""
    folder = tmp_path_factory.mktemp("settling")
    (folder / "case.toml").write_text('effects = ["edge_pressure", "wear"]\n')
    values = {
        "wear.rate": RATE, "friction.mu": MU, "block.stiffness": STIFFNESS, "edge_pressure.B": 1.0,
        "block.height": 0.002, "schedule.distance": 0.2, "schedule.repetitions": 6, "numerics.cells": [12, 6, 6],
        "output.profiles": 12, "output.pictures": False, "output.vtk": False, "output.fields": 2,
    }  # fmt: skip
    out = folder / "result"
    return out, simulate(load_case(folder, values), out=out)


def test_pressure_of_a_simulation_relaxes_as_theory_says(result):
    out, run = result
    answer = analyse_running_in(out, of="pressure")
    assert run.pressure[run.sliding].min() > 0
    exact = 1 / (STIFFNESS * RATE * MU)
    assert answer.expected == pytest.approx(exact, rel=1e-9)
    assert answer.s_w == pytest.approx(exact, rel=2e-3)
    assert answer.final < 0.01
    rms = math.sqrt(((run.pressure[0] / 1.5e5 - 1) ** 2) @ run.mesh.dx_block / run.mesh.dx_block.sum())
    assert answer.start == pytest.approx(rms, rel=2e-3)
    assert "a simulation has no scatter" in str(answer)


def test_an_elastic_block_has_no_length_to_compare_with(result, tmp_path):
    """Every shape of its pressure relaxes over a length of its own; 1/(k_n k mu) is that of springs."""
    out, _ = result
    shutil.copytree(out, tmp_path / "result")
    case = tmp_path / "result" / "case.toml"
    text = re.sub(r"(?m)^stiffness = .*\n", "", case.read_text())
    assert text != case.read_text()
    case.write_text(text)
    assert analyse_running_in(tmp_path / "result", of="pressure").expected is None


def test_values_are_those_of_the_summary(result):
    out, run = result
    data = read_record(out)
    summary = json.loads((out / "summary.json").read_text())
    np.testing.assert_allclose(data.value, summary["friction_per_repetition"], rtol=1e-12)
    assert data.length == pytest.approx(0.2)
    np.testing.assert_allclose(data.end, 0.2 * np.arange(1, 7))
    check_cannot(analyse_running_in(out), "no relaxation detected")  # friction is constant


def test_result_without_its_case(result, tmp_path):
    """A result without its case still answers; only the comparison falls away."""
    out, _ = result
    (tmp_path / "run.nc").write_bytes((out / "run.nc").read_bytes())
    answer = analyse_running_in(tmp_path, of="pressure")
    assert answer.expected is None
    assert answer.s_w == pytest.approx(analyse_running_in(out, of="pressure").s_w)


# --- a measurement --------------------------------------------------------------------------------------
def csv(path, header: str, *columns, stem: str = "mu.csv"):
    rows = [",".join(f"{v:.17g}" for v in row) for row in zip(*columns, strict=True)]
    (path / stem).write_text("\n".join(["# measured on Monday", header, *rows]) + "\n")
    return path / stem


def test_both_tables_say_the_same(tmp_path):
    data = repetitions(8.0, 10)
    by_number = csv(tmp_path, "repetition,mu", np.arange(1, 11), data.value, stem="a.csv")
    by_metre = csv(tmp_path, "mu, slid_m", data.value, 0.5 * (data.begin + data.end), stem="b.csv")
    expected = fit_relaxation(data)
    for file in (by_number, by_metre):
        answer = analyse_running_in(file, distance=3.5)
        assert answer.s_w == pytest.approx(8.0, rel=1e-6)
        assert answer.start == pytest.approx(expected.start, rel=1e-6)
        assert answer.repetitions == expected.repetitions
    bare = analyse_running_in(by_number)
    assert (bare.unit, bare.repetitions) == ("repetitions", expected.repetitions)
    assert bare.s_w == pytest.approx(8.0 / 3.5, rel=1e-6)
    metres = analyse_running_in(by_metre)  # readings at a point: the same s_w, no repetitions
    assert metres.s_w == pytest.approx(8.0, rel=1e-6)
    assert metres.repetitions is None


def test_weights_count(tmp_path):
    """A wrong value with a large sigma does not pull."""
    data = repetitions(8.0, 12)
    value, sigma = data.value.copy(), np.full(12, 1e-4)
    value[3], sigma[3] = 0.95, 10.0
    file = csv(tmp_path, "repetition,mu,sigma", np.arange(1, 13), value, sigma)
    assert analyse_running_in(file, distance=3.5).s_w == pytest.approx(8.0, rel=1e-4)


def test_command(tmp_path, capsys):
    data = repetitions(8.0, 10)
    file = str(csv(tmp_path, "repetition,mu", np.arange(1, 11), data.value))
    assert main(["repetitions", file, "--distance", "3.5"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.startswith("friction: within 1 % of its final value after 6 repetitions (95 %: 6 to 6), 19.3 m\n")
    assert main(["repetitions", file, "--distance", "3.5", "--within", "0.001", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["repetitions"] == 11
    assert answer["s_w"] == pytest.approx(8.0, rel=1e-6)


BAD = {
    "nothing there": (None, ["nowhere.csv"], "nowhere.csv: no such file or folder; give"),
    "no result": (None, ["."], ".: no run.nc there; give a result folder"),
    "no header": ("1,0.9\n2,0.8\n", [], "mu.csv: no column names; write the header repetition"),
    "unknown column": ("repetition,my\n1,0.9\n", [], "column 'my'; did you mean 'mu'?; write the header repetition"),
    "no place": ("mu,sigma\n0.9,0.1\n", [], "mu.csv: header 'mu,sigma'; write repetition,mu[,sigma] or"),
    "two places": ("repetition,slid_m,mu\n1,2,0.9\n", [], "header 'repetition,slid_m,mu'; write"),
    "semicolons": ("repetition;my\n1;0,9\n", [], "column 'my'; did you mean 'mu'?"),
    "no rows": ("repetition,mu\n", [], "mu.csv: no rows of numbers in it; give a table"),
    "empty": ("", [], "mu.csv: the file is empty; give a table"),
    "binary": (b"\x89PNG\0\xff\xfe", [], "mu.csv:1: contains a NUL byte"),
    "text": ("repetition,mu\n1,0.9\n2,low\n", [], "mu.csv:3: ['2', 'low'] is not numeric"),
    "nan": ("repetition,mu\n1,0.9\n2,nan\n", [], "mu.csv:3: nan is not a finite number"),
    "ragged": ("repetition,mu\n1,0.9\n2\n", [], "mu.csv:3: '2' has 1 values, others 2"),
    "from zero": ("repetition,mu\n0,0.9\n1,0.8\n", [], "mu.csv: repetition: 0 in row 1; it must count from 1"),
    "half": ("repetition,mu\n1,0.9\n1.5,0.8\n", [], "repetition: 1.5 in row 2; it must count from 1 in whole numbers"),
    "goes back": ("slid_m,mu\n1,0.9\n0.5,0.8\n", [], "slid_m: 0.5 in row 2; it must increase"),
    "not the middle": ("slid_m,mu\n1,0.9\n4,0.8\n", ["--distance", "3.5"], "slid_m: 1 in row 1; it must be at least half of --distance 3.5"),
    "sigma": ("repetition,mu,sigma\n1,0.9,0\n", [], "sigma: 0 in row 1; it must be > 0, or leave the column out"),
    "a trace": ("slid_m,mu\n" + "".join(f"{k},0.9\n" for k in range(5001)), [], "mu.csv: mu: 5001 rows; give means over repetitions"),
    "pressure of a table": ("repetition,mu\n1,0.9\n", ["--of", "pressure"], "--of: pressure; "),
    "of what": ("repetition,mu\n1,0.9\n", ["--of", "load"], "load"),
    "distance": ("repetition,mu\n1,0.9\n", ["--distance", "0"], "--distance: 0; give the metres"),
    "within": ("repetition,mu\n1,0.9\n", ["--within", "1"], "--within: 1; give a fraction between 0 and 1"),
    "within nan": ("repetition,mu\n1,0.9\n", ["--within", "nan"], "--within: nan; give a fraction"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_one_line_that_helps(name, tmp_path, capsys, monkeypatch):
    text, more, says = BAD[name]
    monkeypatch.chdir(tmp_path)
    if text is not None:
        (tmp_path / "mu.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
        more = ["mu.csv", *more]
    assert main(["repetitions", *more]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    [line] = err.splitlines()
    assert says in line


def test_damaged_result(result, tmp_path, capsys):
    (tmp_path / "run.nc").write_bytes((result[0] / "run.nc").read_bytes()[:2000])
    assert main(["repetitions", str(tmp_path)]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert "run.nc: not a result" in line


def test_distance_of_a_result_is_known(result):
    with pytest.raises(BadInput, match="contains its distance; leave --distance out"):
        read_record(result[0], distance=3.5)


def test_start_is_counted_back_to_the_beginning():
    """The first repetitions were not recorded: the answer counts from the first metre all the same."""
    _, late = EXACT["some are missing"]
    assert RelaxationFit(late).start == pytest.approx(START, rel=1e-6)
    assert fit_relaxation(late).repetitions == fit_relaxation(repetitions(8.0, 10)).repetitions
