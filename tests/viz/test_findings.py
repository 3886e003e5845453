"""The report of a discovery: for every kind of verdict one whole file whose words and pictures are the verdict's own."""

import base64
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure

from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.comparison.compare import RecordingComparison
from flashtemp.comparison.noise import NoiseLevels, lag1_autocorrelation, largest_structured_residual
from flashtemp.comparison.noise_whitening import whiten_residual
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.decision import NOISE_TEST, AdequacyTest, AlternativeCause, EffectSize, VerdictEvidence, decide
from flashtemp.discovery.diagnostics import adequacy_tests as adequacy
from flashtemp.discovery.diagnostics.rule_sentences import (
    ADEQUACY_WORDS,
    describe_rule,
    describe_success,
    explain_uncertainty,
)
from flashtemp.discovery.diagnostics.verdict_sentences import describe_verdict
from flashtemp.discovery.verdict import (
    VERDICT_KINDS,
    CandidateReport,
    Cause,
    ConditionEstimate,
    FitMetrics,
    FrictionDifference,
    InputCorrection,
    InputResult,
    LearnedLaw,
    MissingHeatFlux,
    NormalisedDeviation,
    ParameterEstimate,
    RuleResult,
    SetupErrorReport,
    StructureTest,
    Verdict,
)  # fmt: skip
from flashtemp.discovery.verdict_assembly import _rule_result
from flashtemp.physics.effect import catalogue
from flashtemp.viz import theme
from flashtemp.viz.html import page as html_parts
from flashtemp.viz.html import verdict_report
from flashtemp.viz.measurement import point_series
from flashtemp.viz.number_format import format_ratio
from flashtemp.viz.verdict import (
    before_after,
    candidate_scores,
    missing_heat,
    plot_helpers,
    residual_images,
    verdict_figures,
    whitened_maps,
)

StructureTest.__test__ = False  # a class of the verdict, not one of pytest
TITLE = 'run-in <script>alert(1)</script> & "more" $5'
TIME = np.array([5.0, 20.0, 35.0, 365.0, 380.0, 395.0])
REPETITION = np.array([1, 1, 1, 10, 10, 10])
NAMES = [
    "edge_pressure",
    "third_body",
    "track_memory",
    "pressure_tilt",
    "wear",
    "evaporation",
    "ambient_drift",
    "friction_softening",
    "friction_speed",
    "friction_load",
    "conductance_load",
    "conductance_speed",
    "conductivity_slope",
    "capacity_slope",
    "time_lag",
    "side_cooling",
    "heat_depth",
    "internal_heat",
    "pressure_crown",
    "conductivity_anisotropy",
]


# --- verdicts made by hand --------------------------------------------------------------------------
def seen(measured, predicted, view, file, given, held=False):
    level, shape = NoiseLevels(0.05, 0.02), measured.shape
    u = 1e-3 * np.arange(shape[2]) + (0.0515 if view == "wake" else 0.0005)
    v = 1e-3 * (np.arange(shape[1]) + 0.5 - (shape[1] / 2 if view == "wake" else 0)) if view != "profile" else [0.0]
    recording = Recording(view, measured, TIME, REPETITION, u, np.asarray(v))
    residual = measured - predicted
    residual[:, :, 0] = np.nan
    sigmas = whiten_residual(residual, level)
    good = np.isfinite(residual)
    return RecordingComparison(
        view=RecordingEntry(file, recording, given, 0.05, held),
        predicted=predicted,
        residual=residual,
        sigmas=sigmas,
        noise=level,
        shift=(0.0, 0.0),
        shift_refused=None,
        shift_error=(0.0, 0.0),
        rmse_K=float(np.sqrt(np.mean(residual[good] ** 2))),
        bias_K=float(np.mean(residual[good])),
        chi2_per_dof=float(np.mean(sigmas[good] ** 2)),
        pixels=int(good.sum()),
        largest=largest_structured_residual(residual, level, recording),
        correlation={n: lag1_autocorrelation(sigmas, a) for a, n in ((2, "u"), (1, "v"), (0, "time"))},
    )


def both(view="sidewall", given=None, spot=1.9, seed=1, held=False, file=None):
    """A recording against a base without, and a model with, a hot leading edge that fades with repetition."""
    nv, rng = {"sidewall": 14, "wake": 16, "profile": 1}[view], np.random.default_rng(seed)
    u, v = np.arange(50), np.arange(nv)
    rise = (TIME % 360)[:, None, None] ** 0.5
    if view == "wake":
        base = 21 + 0.8 * np.exp(-u / 20) * np.exp(-(((v - 7.5) / 6) ** 4))[:, None] * rise
        hot = 0.2 * spot * np.exp(-u / 8) * np.exp(-(((v - 7.5) / 6) ** 4))[:, None] * np.ones((6, 1, 1))
    else:
        base = 20 + 2.5 * rise * np.exp(-v / 6)[:, None] * (0.5 + 0.5 * np.sqrt((u + 1) / 50))
        hot = spot * np.exp(-u / 5) * np.exp(-v / 3)[:, None] * np.ones((6, 1, 1))
    hot = hot * np.where(REPETITION == 1, 1.0, 0.15)[:, None, None]
    measured = base + hot + 0.05 * rng.normal(size=hot.shape) + 0.02 * rng.normal(size=hot.shape[1:])
    if nv > 1:
        measured[:, 5, 30] = np.nan
    given = given or {}
    file = file or f"{view}_{seed}.nc"
    return seen(measured, base, view, file, given, held), seen(measured, base + hot, view, file, given, held)


def recordings(count=2, spot=1.9, views=("sidewall", "wake"), held=True):
    out = []
    for i in range(count):
        given = {"contact.pressure": (0.5 + 0.5 * (i % 2)) * 1e5, "schedule.speed": 0.1 * (1 + i)}
        given["ambient.temperature"] = 21.0
        out += [both(v, given, spot * (1 + 0.3 * i), 10 * i + k, held and i == count - 1) for k, v in enumerate(views)]
    return tuple(a for a, _ in out), tuple(b for _, b in out)


def lacks(condition, strength=1.0, repetitions=(1, 10)):
    x, rng = np.linspace(0.0, 0.05, 26), np.random.default_rng(3)
    sd = np.where(x < 0.004, 400.0, 150.0)
    flux = np.stack([strength * 4000 * np.exp(-x / 0.006) / n for n in range(1, len(repetitions) + 1)])
    flux = flux + sd * rng.normal(size=flux.shape)
    pressure = 1 + strength * 1.7 * np.exp(-x / 0.006) - 0.12
    resolution = np.clip(1.2 - (x / 0.05) ** 4 - 0.9 * np.exp(-x / 0.002), 0, 1)
    return MissingHeatFlux(condition, x, np.array(repetitions), flux, sd + 0 * flux, pressure, sd / 2500, resolution)


RIVALS = tuple(
    CandidateReport(
        n, score, 0.9 - 0.04 * i, f"would need an amplitude that breaks its bound {score:g} < 8", f"{n}.r", 0.45 + i,
        0.05, "1" if i % 2 else "W/m2/K", 3.0 + i, 0.02, 0.05 * (i + 1), 180.0 - i, i < 4,
    )
    for i, (n, score) in enumerate(
        zip(NAMES[1:], (96.0, 31.5, 12.2, 6.1, 3.3, 1.4, 0.2, -0.4, -0.9, -1.1, -1.5, -1.8, -2.2, -2.4, -3.0, -3.1, -3.5,
                        -4.0, -6.2), strict=True)
    )
)  # fmt: skip
CAUSE = Cause(
    "edge_pressure", "the nominal contact pressure peaks at the leading edge",
    (ParameterEstimate("edge_pressure.a", 1.724, 0.051, (1.62, 1.82)),
     ParameterEstimate("edge_pressure.length", 2.1e-3, 1.5e-4, (1.8e-3, 2.4e-3), "m", True)),
    5230.0, 0.041, 0.83, 3140.0, 72.0, 0.014,
    (ConditionEstimate("pressure 0.05 MPa, speed 0.1 m/s", 1.70, 0.08), ConditionEstimate("pressure 0.1 MPa, speed 0.2 m/s", 1.74, 0.06)),
    0.41,
)  # fmt: skip
AT = np.linspace(20.0, 60.0, 9)
LAW = LearnedLaw(
    "friction.mu", "T", "friction.mu as a function of T", "1", "degC", "linear, 1.0 + 0.01 T", AT, 1 + 0.01 * AT,
    0.9 + 0.01 * AT, 1.1 + 0.01 * AT, (20.0, 40.0, 60.0), {"friction.mu over v": 11.0},
)  # fmt: skip
SIGNS = np.corrcoef(np.random.default_rng(5).normal(size=(len(NAMES), 12)))
NUISANCE = tuple(
    NormalisedDeviation(n, value, 0.01, pull, unit)
    for n, value, pull, unit in (
        ("friction.mu", 0.97, 0.8, "1"), ("conductance.h", 1498.0, -3.4, "W/m2/K"), ("block.k", 0.24, 1.2, "W/m/K"),
        ("road.e", 1450.0, -0.3, "J/m2/K/s^0.5"), ("image shift u, sidewall_0.nc", 0.12, 0.6, "px"),
        ("gain, wake_1.nc", 1.004, 0.3, "1"),
    )
)  # fmt: skip
TESTS = (
    StructureTest("Moran's I", "sidewall_0.nc", 0.31, 0.001), StructureTest("runs along x", "wake_1.nc", -6.2, 0.004),
    StructureTest("Moran's I", "sidewall_0.nc", 0.004, 0.37, "after"), StructureTest("runs along x", "wake_1.nc", -0.4, 0.61, "after"),
)  # fmt: skip
BASE = FitMetrics(0.1863, 13.2, 0.2431, 17.1, 0.1712, 0.4105)
EXTENDED = FitMetrics(0.0537, 1.004, 0.0541, 1.01, 0.0212, 0.0566)
CERTIFICATE = {
    "converged": True,
    "largest_step": 0.004,
    "relinearisations": 3,
    "starts": [1, 2, 3],
    "mesh": {"pull": 0.4},
}


def verdict(kind, count=2, **changes):
    before, after = recordings(count)
    whole = {
        "title": TITLE,
        "kind": kind,
        "says": (
            "The uniform-pressure simulation misses the leading 6 mm by +1.9 K in repetition 1 and by less than 0.3 K in "
            "repetition 10 (noise 0.05 K).",
            "Cause: the nominal contact pressure peaks at the leading edge, a = 1.72 ± 0.05.",
        ),
        "causes": (CAUSE,),
        "next_experiment": "Rest 10 min before repetition 11: it separates <track memory> from drift.",
        "base": BASE,
        "extended": EXTENDED,
        "rivals": RIVALS,
        "nuisance": NUISANCE,
        "tests": TESTS,
        "missing": (lacks("pressure 0.05 MPa, speed 0.1 m/s"), lacks("pressure 0.1 MPa, speed 0.2 m/s", 1.3)),
        "separability": (tuple(NAMES), SIGNS),
        "shifts": (
            ("friction.mu", 0.93, 0.97, 0.01),
            ("conductance.h", 1610.0, 1498.0, 12.0),
            ("x.zero", 0.0, 0.1, 0.1),
        ),
        "before": before,
        "after": after,
        "gates": {"generic structure left": (-310.0, -150.0), "pressure modes": (4.2, 20.0)},
        "certificate": CERTIFICATE,
        "assumed": {"block.k": 0.05, "side wall emission": 0.01},
        "warnings": ("wake_1.nc: the noise was <estimated> from the data.",),
        "seconds": 83.0,
    }
    none = {"causes": (), "extended": None, "after": (), "shifts": (), "tests": TESTS[:2]}
    parts = {
        "named": {},
        "weak": {"says": ("The best explanation is weakly supported: ln Bayes factor 9.1.",)},
        "group": none | {
            "group": ("edge_pressure", "pressure_tilt"), "says": ("Either of two effects explains the data equally well.",),
            "rivals": (CandidateReport("edge_pressure", 98.0, 0.1, "cannot be told from pressure tilt", "edge_pressure.a", 1.7, 0.1,
                             refitted=True), *RIVALS[1:]),
        },
        "none_needed": none | {
            "says": ("No extension is needed: the largest of 20 effects has ln BF 1.3, below the alarm level 8.",),
            "rivals": tuple(replace(r, score=r.score / 80) for r in RIVALS), "next_experiment": "",
            "before": recordings(count, 0.0)[0], "missing": (lacks("as in the case", 0.0),), "base": EXTENDED,
        },
        "unexplained": none | {"says": ("Something outside the catalogue is present at x = 10 to 14 mm.",)},
        "held_key": none | {
            "says": ("A key that was held explains what a cause would: friction.mu was held at 0.8.",),
            "held_key": InputCorrection("friction.mu", 0.8, 1.0, 0.01, "1", 512.0, "friction.mu is 1, not 0.8"),
        },
        "learned": {
            "causes": (replace(CAUSE, effect="learned", words="mu over T"),), "says": ("Learned: mu over T.",),
            "law": LAW,
        },
        "no_verdict": none | {
            "says": ("The calibration did not converge: three starts ended in different places.",), "rivals": (),
            "certificate": {"converged": False, "largest_step": 0.7}, "before": (), "missing": (), "separability": None,
            "nuisance": (), "tests": (), "base": None, "next_experiment": "", "gates": {}, "assumed": {},
        },
    }  # fmt: skip
    return Verdict(**(whole | parts[kind] | changes))


# --- the page ---------------------------------------------------------------------------------------
class Reader(HTMLParser):
    """Every tag closed in its turn; text, attributes and cells kept."""

    def __init__(self, html):
        super().__init__()
        self.open, self.tags, self.attributes, self.text, self.rows, self.bare = [], [], [], "", [], 0
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.bare += tag == "table" and self.wraps != "wide"
        self.open.append(tag)
        self.handle_startendtag(tag, attrs)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, *a) for a in attrs]
        if tag == "div":
            self.wraps = dict(attrs).get("class")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script"):
            self.text += data
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data

    def table(self, *head):
        """Rows of the table that begins with these columns."""
        at = next(i for i, row in enumerate(self.rows) if row[: len(head)] == list(head))
        return [r for r in self.rows[at + 1 :] if len(r) == len(self.rows[at])]


PICTURES = {
    "named": 6,
    "learned": 7,
    "weak": 6,
    "group": 5,
    "none_needed": 5,
    "unexplained": 5,
    "no_verdict": 0,
    "held_key": 5,
}


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The report of a kind of verdict, written when it is asked for."""
    folder = tmp_path_factory.mktemp("findings")

    @cache
    def page(kind):
        path = folder / f"{kind}.html"
        before = set(folder.iterdir())
        assert verdict_report.write_report(verdict(kind, 1), path) == path
        assert set(folder.iterdir()) - before == {path}
        html = path.read_text(encoding="utf-8")
        return html, Reader(html)

    return page


@pytest.fixture
def unpainted(monkeypatch):
    """Pages without pictures, which take their time."""
    monkeypatch.setattr(verdict_figures, "draw_figures", lambda verdict: {})


@pytest.mark.parametrize("kind", VERDICT_KINDS)
@pytest.mark.sample("named", "no_verdict")
def test_every_kind_is_one_whole_file_with_nothing_outside_it(pages, kind):
    html, reader = pages(kind)
    assert html.startswith("<!DOCTYPE html>")
    assert {"script", "link", "iframe"}.isdisjoint(reader.tags)
    marks = [v for _, name, v in reader.attributes if name == "id"]
    assert len(set(marks)) == len(marks)
    assert {v for _, name, v in reader.attributes if name == "href"} <= {f"#{m}" for m in marks}
    assert not re.search(r"https?:|url\(|@import", html)
    sources = [v for _, name, v in reader.attributes if name == "src"]
    assert all(v.startswith("data:image/png;base64,") for v in sources)
    pictures = [base64.b64decode(v.split(",", 1)[1], validate=True) for v in sources]
    assert all(p.startswith(b"\x89PNG") for p in pictures)
    assert len(set(pictures)) == len(pictures) == PICTURES[kind]
    assert reader.tags.count("figcaption") == len(pictures)
    told = [v for _, name, v in reader.attributes if name == "alt"]
    assert len(set(told)) == len(pictures)
    assert all(len(v) > 40 for v in told)
    assert not any(name.startswith("on") for _, name, _ in reader.attributes)
    assert reader.bare == 0
    assert TITLE in reader.text
    assert "nan" not in reader.text.replace("nano", "").lower().split()


@pytest.mark.parametrize("kind", VERDICT_KINDS)
@pytest.mark.sample("named", "no_verdict")
def test_the_answer_comes_first(pages, kind):
    _, reader = pages(kind)
    first = reader.text.index(verdict_report.ANSWERS_BY_KIND[kind][0])
    says = [reader.text.index(line) for line in verdict(kind).says]
    sections = [reader.text.find(h) for h in ("1. ", "Convergence of the calibration", "Warnings") if h in reader.text]
    assert first < min(says) <= max(says) < min(sections)
    assert verdict_report.ANSWERS_BY_KIND[kind][1] in {
        v for t, n, v in reader.attributes if n == "class" for v in v.split()
    }


def test_a_named_cause_stands_with_its_interval_and_its_gain(pages):
    _, reader = pages("named")
    head = reader.text[: reader.text.rindex("1. Measured minus computed temperature")]
    assert "The nominal contact pressure peaks at the leading edge" in head
    assert "from 0.186 K to 0.0537 K" in head
    assert "from 0.243 K to 0.0541 K" in head
    first, second = reader.table("parameter")[:2]
    assert first == ["edge_pressure.a", "1.724 ± 0.051", "1.62 to 1.82", "no"]
    assert second[2] == "0.0018 to 0.0024 m"
    assert second[3].startswith("yes")
    rival = reader.table("candidate")[0]
    assert rival[:6] == ["third body", "third_body.r = 0.450 ± 0.050 W/m²/K", "96", "full fit", "180", "0.90"]
    assert "third_body.r" in reader.table("effect", "parameter")[0]
    assert ["chi2/dof (–)", "13.20", "1.00"] in reader.rows or ["chi2/dof (–)", "13.2", "1.00"] in reader.rows
    assert reader.table("test for structure")[0] == [
        "Moran's I",
        "sidewall_0.nc",
        "base",
        "0.31",
        "≤\N{NO-BREAK SPACE}0.001",
    ]
    assert ["block.k", "0.05"] in reader.rows
    assert ["Pressure modes", "", "4.2", "20", "yes"] in reader.rows
    assert "Rest 10 min before repetition 11: it separates <track memory> from drift." in reader.text
    assert "<track memory>" not in pages("named")[0]


@pytest.mark.long
def test_kinds_read_as_they_are(pages):
    assert "Not distinguishable: edge pressure, pressure tilt." in pages("group")[1].text
    assert "The model was not extended" in pages("unexplained")[1].text
    text = pages("none_needed")[1].text
    assert "Measured minus computed temperature" in text
    assert "Structure in the residuals" not in text
    assert "Residuals against noise" in text
    assert "What to measure next" not in text
    text = pages("no_verdict")[1].text
    assert "Convergence of the calibration" in text
    assert "Distinctness" not in text
    assert "wake_1.nc: the noise was <estimated>" in text
    two = replace(CAUSE, effect="third_body", words="")
    assert "2 missing effects are identified" in verdict_report.render_report(
        verdict("named", causes=(CAUSE, two), before=(), after=())
    )


def test_a_verdict_without_anything_is_still_a_page():
    for kind in VERDICT_KINDS:
        reader = Reader(verdict_report.render_report(Verdict(TITLE, kind, ())))
        assert reader.tags.count("img") == 0
        assert "The convergence of the calibration was not recorded" in reader.text


def test_the_page_is_the_answer_a_list_of_contents_and_the_sections_in_its_order(pages):
    html, reader = pages("named")
    body = html[html.index("<body>") :]
    assert body.index('class="answer"') < body.index("<nav") < body.index("<h2") < body.index("<img")
    listed = [v[1:] for _, name, v in reader.attributes if name == "href"]
    assert listed == re.findall(r'<h2 id="([^"]+)"', body[body.index("</nav>") :])
    assert listed[:2] == ["result", "what-is-wrong"]
    assert len(listed) == 14


def test_what_is_long_is_folded(pages):
    html = pages("named")[0].replace("<wbr />", "")
    folds = "".join(re.findall(r"<details>.*?</details>", html, re.S))
    for words in ("test for structure", "prior standard deviation", "detectable at 5 sigma"):
        assert words in folds
    assert html.count("<details>") == html.count("<summary>") >= 5
    assert "edge_pressure.a" not in folds.replace('edge_pressure.a</td><td class="word">', "")
    unlikely = [r.effect.replace("_", " ") for r in RIVALS if r.score <= 0]
    assert all(
        f'<td class="word">{name}</td>' in folds or f'<td class="text">{name}</td>' in folds for name in unlikely
    )
    less = next(
        fold
        for fold in re.findall(r"<details>.*?</details>", html, re.S)
        if "would not make the data more probable" in fold
    )
    assert f">{RIVALS[0].effect.replace('_', ' ')}</td>" not in less


def test_a_campaign_of_load_cells_alone_has_no_temperatures_in_its_report(monkeypatch):
    few = replace(BASE, rmse_K=np.nan, mean_map_rmse_K=np.nan, near_contact_rmse_K=np.nan, held_out_rmse_K=0.0)
    v = verdict("named", gain={}, base=few, extended=replace(few, chi2_per_dof=1.02), before=(), after=())
    html = verdict_report.render_report(v)
    assert f"With the extension, chi2/dof goes from {format_ratio(few.chi2_per_dof)} to 1.02." in html
    assert "– K" not in html
    assert "left-out data (K)" not in html
    assert "hardly changes" not in html
    monkeypatch.setattr(verdict_figures, "draw_figures", lambda verdict: {})  # the same pictures again
    html = verdict_report.render_report(verdict("named", gain={}, base=few, extended=replace(few), before=(), after=()))
    assert "The missing effect is identified, but it hardly changes the computed friction" in html


def test_what_the_cause_changes_is_told_in_kelvin_and_nothing_is_green_that_changes_nothing(unpainted):
    gain = {"file": "wake_<1>.nc", "changed_K": 0.0021, "share": 0.0014, "friction": 0.0, "left_out_K": (0.05, 0.05)}
    small = replace(BASE, rmse_K=0.058412, mean_map_rmse_K=0.02, near_contact_rmse_K=0.03, held_out_rmse_K=0.0584)
    for smaller, grade in ((0.05840, "near"), (0.0560, "good")):
        v = verdict("named", gain=gain, base=small, extended=replace(small, rmse_K=smaller), before=(), after=())
        html = verdict_report.render_report(v)
        assert f'<div class="verdict {grade}">' in html
        assert ("but it hardly changes the computed temperatures" in html) == (grade == "near")
        assert "wake_&lt;1&gt;.nc by 0.0021 K root mean square (0.14 % of its temperature rise)" in html
        assert ("the root mean square of the differences, noise included, stays at 0.0584 K" in html) == (
            grade == "near"
        )
    assert '<div class="verdict near">' in verdict_report.render_report(
        verdict("learned", gain=gain, base=small, extended=small, before=(), after=())
    )


def test_noise_is_judged_by_the_very_data_that_are_shown(unpainted):
    """The heading claims structure only where maps or tests show it; both are said in numbers."""
    page = verdict_report.render_report(verdict("named", 1))
    assert "2. Structure in the residuals" in page
    quiet = recordings(1, 0.0)[0]
    chance = tuple(StructureTest(f"test {i}", "wall.nc", 0.1, p) for i, p in enumerate((0.01, 0.2, 0.5, 0.9)))
    page = verdict_report.render_report(verdict("named", 1, before=quiet, after=quiet, tests=chance))
    assert "Structure in the residuals" not in page
    assert "1 of 4 tests give" in page
    assert "noise alone can explain this" in page
    sure = tuple(replace(t, p=0.01) for t in chance)
    page = verdict_report.render_report(verdict("named", 1, before=quiet, after=quiet, tests=sure))
    assert "2. Structure in the residuals" in page
    assert "4 of 4 tests give" in page
    small = tuple(replace(t, is_small=True) for t in sure)
    page = verdict_report.render_report(verdict("named", 1, before=quiet, after=quiet, tests=small))
    assert "Structure in the residuals" not in page
    assert "the residuals are smaller than the stated noise, or the data are not independent" in page
    share = 100 * np.mean([np.abs(v) > 3 for v in plot_helpers.whitened_means(quiet[0]).ravel() if np.isfinite(v)])
    assert plot_helpers.outlier_fraction(quiet[0]) == pytest.approx(share / 100)


def test_every_adequacy_test_has_plain_words(unpainted):
    for words in ADEQUACY_WORDS.values():
        assert len({words.passes, words.measured_by, words.fails}) == 3
        assert "modes" not in words.passes + words.fails
    text = Reader(
        verdict_report.render_report(
            verdict("named", gates=dict.fromkeys(ADEQUACY_WORDS, (5.0, 4.0)), before=(), after=())
        )
    )
    rows = text.table("adequacy test")
    assert [r[0] for r in rows] == [words.passes for words in ADEQUACY_WORDS.values()]
    assert {r[-1] for r in rows} == {"no"}


def test_colour_bars_begin_and_end_at_a_number():
    for part in residual_images.draw(verdict("named", 1)).subfigs:
        images = part.axes[0].images[0], part.axes[2].images[0]
        for picture in images:
            ticks = picture.colorbar.get_ticks()
            assert (ticks[0], ticks[-1]) == (picture.norm.vmin, picture.norm.vmax)
            assert 4 <= len(ticks) <= 8
            assert np.all(np.round(10 * ticks / (ticks[1] - ticks[0])) % 5 == 0)


def test_the_frame_shown_is_of_a_difference_that_stands_out_or_hot():
    s = both()[0]
    shown = residual_images._select_frame(s)
    assert TIME[shown] == s.largest.time
    faint = replace(s, largest=replace(s.largest, sigma=4.0, time=TIME[0]))
    assert residual_images._select_frame(faint) == plot_helpers.hottest_frame(s, np.arange(len(TIME))) != 0


# --- pictures ---------------------------------------------------------------------------------------
def render(fig):
    """Draw a figure; every text lies inside it."""
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    drawer = canvas.get_renderer()
    parts = [fig, *fig.subfigs]
    axes = [ax for ax in fig.axes if ax.axison]
    texts = [t for ax in axes for t in (ax.xaxis.label, ax.yaxis.label, ax._left_title, *ax.texts)]
    texts += [t for ax in axes if ax.get_legend() for t in ax.get_legend().get_texts()]
    for text in [*texts, *(t for p in parts for t in (p._suptitle, p._supxlabel))]:
        if text and text.get_text():
            box = text.get_window_extent(drawer)
            assert min(box.x0, box.y0) > -2, text
            assert max(box.x1 - fig.bbox.x1, box.y1 - fig.bbox.y1) < 2, text
    return fig


@pytest.mark.parametrize(
    ("kind", "count"),
    [
        ("named", 6),
        ("group", 3),
        *(pytest.param(*v, marks=pytest.mark.long) for v in (("named", 1), ("weak", 2), ("none_needed", 2))),
    ],
)
@pytest.mark.sample("group-3")
def test_no_text_leaves_a_picture(kind, count):
    for name, fig in verdict_figures.draw_figures(verdict(kind, count)).items():
        render(fig)
        assert name in verdict_figures.PICTURE_CAPTIONS


def test_warnings_are_printed_with_the_answer():
    assert str(verdict("named")).endswith("  note: wake_1.nc: the noise was <estimated> from the data.")


@pytest.mark.long
def test_files_are_named_by_what_they_show(tmp_path):
    paths = verdict_figures.draw_all(verdict("named"), tmp_path)
    wanted = ["what_is_wrong.png", "not_noise.png", "missing.png", "why.png", "else.png", "gained.png"]
    assert [p.name for p in paths] == wanted
    assert all(p.read_bytes().startswith(b"\x89PNG") for p in paths)
    assert verdict_figures.draw_all(verdict("no_verdict", before=recordings()[0]), tmp_path) == []


@pytest.mark.long
def test_the_worst_conditions_are_drawn_and_said():
    v = verdict("named", 6)
    drawn = plot_helpers.select_recordings(v)
    assert len(drawn) == 4
    sizes = [max(plot_helpers.largest_difference(p) for p in g) for g in plot_helpers.group_recordings(v)]
    assert sorted(max(plot_helpers.largest_difference(p) for p in g) for g in drawn) == sorted(sizes)[2:]
    assert plot_helpers.describe_selection(v).startswith("Drawn are the 4 of 6 conditions")
    assert plot_helpers.describe_selection(v) in Reader(verdict_report.render_report(v)).text
    assert "ambient" not in drawn[0][0].words
    assert plot_helpers.describe_selection(verdict("named", 2)) == ""


def test_images_and_lines_are_those_of_the_recordings():
    v = verdict("named", 1)
    fig = residual_images.draw(v)
    s = v.before[0]
    k = int(np.argmin(np.abs(TIME - s.largest.time)))
    measured, computed, off, lines = fig.subfigs[0].axes[:4]
    for ax, values in ((measured, s.view.recording.temperature), (computed, s.predicted), (off, s.residual)):
        drawn, good = ax.images[0].get_array(), np.isfinite(s.residual[k])
        np.testing.assert_array_equal(~np.ma.getmaskarray(drawn), good)
        np.testing.assert_array_equal(drawn.compressed(), values[k][good])
    assert measured.images[0].norm is computed.images[0].norm
    assert off.images[0].norm.vmin == -off.images[0].norm.vmax
    first = lines.lines[0].get_ydata()
    np.testing.assert_allclose(first[1:29], s.view.recording.temperature[2, :2, 1:29].mean(axis=0))
    np.testing.assert_allclose(lines.lines[2].get_ydata()[1:], v.after[0].predicted[2, :2, 1:].mean(axis=0))
    assert len(lines.lines) == 6


def test_means_over_frames_are_white_where_only_noise_is_left():
    flat = np.concatenate([plot_helpers.whitened_means(s).ravel() for s in recordings(6)[1]])
    flat = flat[np.isfinite(flat)]
    assert np.std(flat) == pytest.approx(1.0, abs=0.05)
    assert np.abs(np.mean(flat)) < 0.05


def test_profiles_and_single_repetitions_are_drawn():
    a, b = zip(both("profile"), both("profile", {"schedule.speed": 0.5}, seed=2, held=True), strict=True)
    v = verdict("named", before=a, after=b)
    for fig in (residual_images.draw(v), whitened_maps.draw(v), before_after.draw(v)):
        render(fig)
    alone = verdict("named", missing=(lacks("as in the case", repetitions=(1,)),))
    assert len(render(missing_heat.draw(alone)).axes) == 2


@pytest.mark.parametrize("count", [1, 12])
def test_legend_of_the_thermocouples_covers_no_data(count):
    names = [f"point {n}" for n in range(count)]
    recording = SimpleNamespace(time=TIME, places=SimpleNamespace(names=names))
    residual = np.tile(np.linspace(-1.0, 1.0, len(TIME))[:, None, None], (1, 1, count))
    view = SimpleNamespace(recording=recording, held_out=False)
    before = SimpleNamespace(view=view, residual=residual, noise=SimpleNamespace(white=0.1, pattern=0.0))
    fig = theme.make_figure("", "", 8.0, 2.6)
    point_series.draw_residual_panel(fig, [SimpleNamespace(before=before, after=before)])
    render(fig)
    ax = fig.axes[-1]
    legend, panel = ax.get_legend().get_window_extent(), ax.get_window_extent()
    assert [text.get_text() for text in ax.get_legend().get_texts()] == names
    assert legend.x0 >= panel.x1
    assert legend.x1 <= fig.bbox.x1
    assert panel.width > 0.25 * fig.bbox.width


def test_what_is_not_resolved_is_grey_and_bands_are_95_percent():
    v = verdict("named")
    flux, pressure = missing_heat.draw(v).axes[:2]
    m = v.missing[0]
    hidden = int((m.resolution < missing_heat.MIN_RESOLUTION).sum())
    assert hidden > 0
    assert len(flux.patches) == len(pressure.patches) == hidden
    top = flux.collections[0].get_paths()[0].vertices[:, 1].max()
    assert top == pytest.approx(1e-3 * (m.flux[0] + 1.96 * m.flux_sd[0]).max())


def test_all_scores_are_drawn_with_the_alarm_level():
    v = verdict("named")
    ax = candidate_scores.draw_scores(v).axes[0]
    assert sorted(p.get_width() for p in ax.patches) == sorted([CAUSE.ln_bayes, *(r.score for r in RIVALS)])
    assert any(set(line.get_xdata()) == {CRITERIA.ln_bayes_named} for line in ax.lines)
    assert to_hex(ax.patches[0].get_facecolor()) == candidate_scores.ACCEPTED_COLOUR.lower()
    assert ax.get_xscale() == "symlog"
    kinds = {to_hex(p.get_edgecolor()) for p in candidate_scores.draw_scores(verdict("group")).axes[0].patches}
    assert candidate_scores.AMBIGUOUS_COLOUR.lower() in kinds
    twice = replace(v, rivals=(*RIVALS, CandidateReport("edge_pressure", 3139.0, 0.8, "accepted")))
    assert len(candidate_scores.draw_scores(twice).axes[0].patches) == 1 + len(RIVALS)


def test_extreme_numbers_are_drawn():
    scores = (3e5, 12.0, 9.0, -4e3, float("nan"))
    rivals = tuple(
        CandidateReport(f"{n}_{i}", s, 0.5, "", refitted=True)
        for i, (n, s) in enumerate(zip(NAMES, scores, strict=False))
    )
    pulls = tuple(NormalisedDeviation(f"gain, file_{i}.nc", 1.0, 0.1, 40.0 * (-1) ** i) for i in range(40))
    v = verdict("unexplained", rivals=rivals, nuisance=pulls, separability=None)
    render(candidate_scores.draw_scores(v))
    fig = render(candidate_scores.draw_alternatives(v))
    assert "24 of 40" in fig.axes[0].get_title(loc="right")
    same = FitMetrics(0.0701, 1.066, 0.071, 1.0)
    close = replace(same, rmse_K=0.0659)
    render(before_after.draw(verdict("named", base=same, extended=close, shifts=())))


@pytest.mark.long
def test_what_was_not_tried_has_no_bar_and_no_score():
    v = verdict(
        "unexplained", 1, rivals=(*RIVALS, CandidateReport("spots", 0.0, 0.0, "not tried: the case has no spots"))
    )
    assert len(candidate_scores.draw_scores(v).axes[0].patches) == len(RIVALS)
    reader = Reader(verdict_report.render_report(v))
    assert ["spots", "the case has no spots"] in reader.table("effect", "why not")
    assert "spots" not in {r[0] for r in reader.table("candidate")}


# --- the verdict in words --------------------------------------------------------------------------------
@pytest.mark.parametrize(("seen", "clear"), [((1.5, 2.0), 0), ((1.5, 40.0, 2.0), 1), ((9.0, 40.0), None)])
def test_data_that_can_hardly_show_a_cause_say_so(seen, clear):
    """A candidate that cannot act on them at all is not the strongest, whatever its score."""
    idle = replace(RIVALS[0], seen=0.0, score=1e3)
    shown = tuple(replace(r, seen=s) for r, s in zip(RIVALS[1:], seen, strict=False))
    lines = describe_verdict(replace(verdict("none_needed"), rivals=(idle, *shown)), catalogue())
    hardly = [line for line in lines if "would hardly show most effects" in line]
    assert len(hardly) == (clear is not None)
    assert all(f"{clear or 'none'} of {len(seen)} candidates" in line for line in hardly)
    assert any(f"The strongest of {len(seen)} candidates, {RIVALS[1].effect}," in line for line in lines)


@pytest.mark.parametrize(("chance", "doubted"), [(4e-4, True), (0.3, False)])
def test_a_law_on_which_conditions_hardly_agree_is_named_with_its_doubt(chance, doubted):
    lines = describe_verdict(replace(verdict("named"), causes=(replace(CAUSE, consistent=chance),)), catalogue())
    assert any("its law is not" in line for line in lines) is doubted
    scatter = [line for line in lines if "The conditions hardly agree" in line]
    assert len(scatter) == doubted
    for own in CAUSE.per_condition if doubted else ():
        assert f"{own.value:.4g} +- {own.stderr:.2g}" in scatter[0]


@pytest.mark.long
def test_no_verdict_keeps_what_it_knows():
    known = Reader(verdict_report.render_report(verdict("no_verdict", base=EXTENDED, rivals=RIVALS))).text
    assert RIVALS[0].effect.replace("_", " ") in known


# --- why a verdict is what it is, and the inputs that the data question ---------------------------------------
PRIVATE_WORDS = re.compile(r"\b(told|tells?|held|stands|laborator\w+|put right|mended|trace|nats)\b", re.I)


def stated_input(key, verdict, pull=0.5, ln_bayes=-1.0, **changes):
    known = {"stated": 1.5e5, "unit": "Pa", "sd": 0.02, "relative": True, "source": "by kind"}
    known |= {"estimate": 1.65e5, "stderr": 3.1e3, "words": f"{key} in words", "sentence": ""}
    return InputResult(key=key, pull=pull, ln_bayes=ln_bayes, verdict=verdict, **(known | changes))


UNCHECKED = tuple(stated_input(f"road.n{i}", "not checkable", stderr=np.inf) for i in range(6))
INPUTS = (
    stated_input("block.length", "consistent", stated=0.025, unit="m", estimate=0.0251, stderr=1e-4),
    stated_input("ambient.temperature", "contradicted", -5.1, 9.0, stated=20.0, unit="degC", sd=0.5, relative=False,
                 estimate=17.0, stderr=0.3),
    stated_input("contact.pressure", "contradicted", 6.2, 14.0),
    *UNCHECKED,
)  # fmt: skip
FAILED = RuleResult("heat of any shape (ln Bayes factor)", 31.2, 3.0, False, "heat of any shape: 31.2, limit 3")
FAILED_LAW = RuleResult(
    "the law predicts left-out data",
    0.57,
    0.5,
    False,
    "57 % of the excess misfit of left-out data remains with the law",
)
REFUTED_LAW = RuleResult(
    "left-out data do not speak against it", -9.0, -4.5, False,
    "left-out data are less probable with it (change of ln probability -9.0)",
)  # fmt: skip
PASSED = RuleResult("the evidence is strong", 12.0, 8.0, True, "the ln Bayes factor is 12")
SETUP = Cause(
    "pixel_scale", "the pixel scale of wall.nc is 1.2 % too small (or the block's length is 25.3 mm)",
    (ParameterEstimate("pixel_scale.wall.nc", 0.012, 0.001, (0.01, 0.014)),), 144.0, 0.0, 1.0, 60.0, laboratory=True,
)  # fmt: skip


def evidence(**changes):
    """Evidence for one strong cause, visible and adequate."""
    whole = {
        "is_converged": True, "base_certainly_misfits": False, "causes": ("wear",), "ln_bayes": 30.0,
        "ln_bayes_discrepancy": 30.0, "heldout_gain": 3.0, "size": EffectSize(0.05, 0.0, 0.1, 0.01),
        "alternatives": (AlternativeCause(frozenset({"radiation"}), 1.0),),
        "adequacy": tuple(AdequacyTest(name, 0.5, 1.0) for name in ADEQUACY_WORDS),
    }  # fmt: skip
    return VerdictEvidence(**(whole | changes))


def test_every_rule_of_a_decision_has_words_and_the_side_of_its_limit_is_right():
    """A rule that passes with a value below its limit has an upper limit, one with a value above it a lower one."""
    cases = [
        evidence(), evidence(is_converged=False), evidence(unresolved={"wear": 20.0}),
        evidence(learned_law="mu over T", law_excess_left=0.2),
    ]  # fmt: skip
    for r in [r for e in cases for r in decide(e).rules]:
        words = describe_rule(r.name)
        assert words.passes[:1].isupper(), r.name
        assert words.passes.lower() != r.name.lower() or words.measured_by or r.name == "the fit converged", r.name
        assert not PRIVATE_WORDS.search(words.passes + words.measured_by + words.fails)
        if words.measured_by and r.passed:
            assert (r.value <= r.limit) == words.is_upper, r.name


def test_adequacy_tests_and_their_words_have_the_same_names(monkeypatch):
    monkeypatch.setattr(adequacy, "unnamed_heat_evidence", lambda *a: 0.0)
    monkeypatch.setattr(adequacy, "pressure_mode_chi2", lambda *a: 0.0)
    monkeypatch.setattr(adequacy, "largest_misfit", lambda *a: None)
    monkeypatch.setattr(adequacy, "normalised_deviations", lambda *a: {})
    fit = SimpleNamespace(blocks=(), system=SimpleNamespace(fitted_columns=()), model=SimpleNamespace(effects=()))
    assert [t.name for t in adequacy.run_adequacy_tests(None, fit, CRITERIA)] == list(ADEQUACY_WORDS)


@pytest.mark.parametrize("kind", VERDICT_KINDS)
@pytest.mark.sample("named", "no_verdict")
def test_why_this_verdict_and_inputs_are_in_every_report_that_has_them(unpainted, kind):
    v = verdict(kind, 1, rules=(PASSED, FAILED), inputs=INPUTS, before=(), after=(), inputs_told_together=(
        ("block.length", "pixel scale"),))  # fmt: skip
    page = verdict_report.render_report(v)
    reader = Reader(page)
    rows = reader.table("rule")
    assert [r[2:] for r in rows[:2]] == [
        ["12", "≥\N{NO-BREAK SPACE}8", "passed"],
        ["31.2", "≤\N{NO-BREAK SPACE}3", ADEQUACY_WORDS[FAILED.name].fails],
    ]
    assert explain_uncertainty(v) in reader.text
    contradicted = reader.table("stated input")
    assert contradicted[:2] == [  # the most certain first, in the units of people
        ["contact.pressure in words", "contact.pressure", "0.15 MPa", "2 %, by kind", "0.1650 ± 0.0031 MPa", "6.2", "14"],
        ["ambient.temperature in words", "ambient.temperature", "20 °C", "0.5 K, by kind", "17.00 ± 0.30 °C", "5.1", "9"],
    ]  # fmt: skip
    folds = "".join(re.findall(r"<details>.*?</details>", page, re.S))
    assert '<td class="word">block.length</td>' in folds.replace("<wbr />", "")
    assert "contact.pressure in words" not in folds
    assert f"These data cannot check: {', '.join(i.key for i in UNCHECKED)}." in reader.text
    assert "These data cannot distinguish from each other: block.length and pixel scale." in reader.text
    assert reader.text.index("Why this verdict") < reader.text.index("Stated inputs against the data")


def test_inputs_without_a_contradiction_are_shown_and_old_verdicts_have_no_such_section(unpainted):
    text = Reader(verdict_report.render_report(verdict("named", inputs=UNCHECKED, before=(), after=()))).text
    assert "The data contradict no stated input." in text
    text = Reader(verdict_report.render_report(verdict("named", before=(), after=()))).text
    assert "Why this verdict" not in text
    assert "Stated inputs against the data" not in text
    assert "Adequacy tests" in text


def test_the_text_of_a_verdict_names_contradicted_inputs_and_up_to_six_that_cannot_be_checked():
    text = str(verdict("named", inputs=INPUTS))
    [line] = [line for line in text.splitlines() if "inputs: " in line]
    assert "contact.pressure (6.2 standard deviations)" in line
    assert line.endswith("cannot check 6 of 9: road.n0, road.n1, road.n2, road.n3, road.n4, road.n5")
    more = str(verdict("named", inputs=(*INPUTS, stated_input("road.n6", "not checkable"))))
    assert "cannot check 7 of 10\n" in more
    assert "road.n0" not in more
    assert "inputs:" not in str(verdict("named"))
    titles = [part.title for part in verdict("named", inputs=INPUTS, rules=(PASSED,)).to_table().parts]
    assert titles[:2] == ["Why this verdict", "Stated inputs against the data"]


@pytest.mark.parametrize(
    ("kind", "changes", "first", "also"),
    [
        ("named", {}, "The model lacks one effect: the nominal contact pressure peaks", "95 % interval 1.62 to 1.82"),
        ("named", {"causes": (CAUSE, replace(CAUSE, effect="wear"))}, "The model lacks 2 effects: ", "(wear)"),
        ("named", {"causes": (SETUP,)}, "The set-up differs from what is stated: the pixel scale", "(1.2 % +- 0.1 %)"),
        ("named", {"causes": (replace(CAUSE, effect="camera_offset", words="the camera's zero is off"),)},
         "No effect on heat is missing from the model, but the measurement has an error: the camera's zero is off "
         "(camera_offset).", "95 % interval 1.62 to 1.82"),
        ("named", {"causes": (CAUSE, replace(CAUSE, effect="camera_offset"))}, "The model lacks 2 effects: ", "offset"),
        ("named", {"causes": (SETUP, CAUSE)}, "The model lacks one effect: ", "The set-up differs from what is stated"),
        ("weak", {"not_named": ("the mesh may err by 3 mK",)}, "A missing effect is likely, but not established",
         "Not more certain because: the mesh may err by 3 mK."),
        ("group", {"group": ("wear", "radiation")}, "One effect is missing, and these data cannot distinguish which",
         "To distinguish them: Rest 10 min"),
        ("group", {"group": ("pixel_scale", "block_length"), "causes": (SETUP,)},
         "The set-up differs from what is stated, and these data cannot distinguish how: the pixel scale",
         "An independent measurement"),
        ("group", {"group": ("wear", "friction.mu"), "causes": (replace(CAUSE, effect="wear"),)},
         "Either an effect is missing or a stated input is wrong, and these data cannot distinguish which: ",
         "To decide, measure friction.mu in a separate test in which wear does not act; "),
        ("unexplained", {"rules": (PASSED, FAILED), "rivals": (), "causes": (CAUSE,)},
         "Something is missing that the catalogue does not contain.",
         "What was tested and failed: heat of another shape is needed along the contact"),
        ("unexplained", {"causes": (CAUSE,)}, f"Something is missing that none of the {len(RIVALS)} `candidates` of this campaign",
         "The catalogue has more effects; leave out `candidates` to try them."),
        ("unexplained", {"law": LAW, "rules": (FAILED, FAILED_LAW), "causes": (CAUSE,)}, "Something is missing that none of the ",
         f"The closest law is only a hint, because {FAILED_LAW.consequence}: friction.mu as a function of T"),
        ("unexplained", {"law": LAW, "rules": (FAILED, REFUTED_LAW), "causes": (CAUSE,)}, "Something is missing that none of the ",
         f"The closest law is only a hint, because {REFUTED_LAW.consequence}: friction.mu as a function of T"),
        ("none_needed", {}, "No extension is needed", "a cause needs 8"),
        ("no_verdict", {"not_named": ("wear could not be fitted to an end",)},
         "There is no verdict: wear could not be fitted to an end.", "Check the values of the case"),
        ("held_key", {}, "No effect is missing, but the data contradict a stated input: friction.mu is stated as 0.8; "
         "the data require 1 +- 0.01", "Correct friction.mu"),
        ("learned", {"law": LAW}, "A law outside the catalogue was learned from the data: friction.mu as a function of T",
         "1.2 (1.1 to 1.3) at 20 degC"),
    ],
)  # fmt: skip
def test_the_first_sentence_is_the_verdict_in_plain_words(kind, changes, first, also):
    v = verdict(kind, inputs=INPUTS, **changes)
    lines = describe_verdict(v, catalogue())
    assert lines[0].startswith(first)
    assert any(also in line for line in lines)
    assert not any(PRIVATE_WORDS.search(line) for line in lines)
    assert all(line.endswith(".") for line in lines)
    contradictions = [k for k, line in enumerate(lines) if line.startswith("The data contradict a stated input: ")]
    assert min(contradictions) > 0
    assert "contact.pressure is stated as 150000 Pa +- 2 %; the data require 165000 +- 3100 Pa, 6.2" in lines[
        contradictions[0]
    ]  # fmt: skip


NOISY = RuleResult(NOISE_TEST, 1.4, 1.0, False, "the residuals of wall.nc are 1.3 times its noise (rms)")


def test_residuals_above_the_noise_are_no_missing_effect_where_all_else_fits():
    """Only the test of noise fails: the first sentence names the recording, the second what may be wrong with it."""
    lines = describe_verdict(verdict("unexplained", rules=(PASSED, NOISY)), catalogue())
    assert lines[0].startswith("The residuals of wall.nc are 1.3 times its noise (rms)")
    assert "constant offset" in lines[1]
    assert not any("Something is missing" in line or "tested and failed" in line for line in lines)
    both_fail = describe_verdict(verdict("unexplained", rules=(FAILED, NOISY)), catalogue())
    assert both_fail[0].startswith("Something is missing")
    assert any("another shape is needed" in line and "residuals of wall.nc" in line for line in both_fail)
    old = replace(NOISY, consequence=f"{NOISE_TEST}: 1.4, limit 1")  # stored by an earlier version
    assert describe_verdict(verdict("unexplained", rules=(old,)), catalogue())[0].startswith("The residuals of a rec")


def test_a_group_says_what_each_of_its_effects_needs():
    [line] = [t for t in describe_verdict(verdict("group", group=tuple(NAMES[2:4])), catalogue()) if "would need" in t]
    assert line == f"Each of them alone would need: {NAMES[2]}.r = 1.45 +- 0.05; {NAMES[3]}.r = 2.45 +- 0.05 W/m2/K."


def test_friction_that_differs_is_said_in_every_valid_answer():
    differs = (FrictionDifference("condition 2", "condition 1", 0.084, 0.003, True),)
    for kind in VERDICT_KINDS:
        lines = describe_verdict(verdict(kind, friction_differences=differs), catalogue())
        said = [line for line in lines if line.startswith("Friction differs between conditions by 8.4 % (+- 0.3 %)")]
        assert len(said) == (kind not in ("no_verdict", "unexplained"))
        assert all("error of the stated load" in line for line in said)
    repeated = (replace(differs[0], is_between_conditions=False),)
    assert "Friction differs between repetitions by 8.4 %" in str(
        describe_verdict(verdict("none_needed", friction_differences=repeated), catalogue())
    )


def test_an_input_of_another_verdict_is_contradicted_once_and_only_beyond_chance():
    held = InputCorrection("contact.pressure", 1.5e5, 1.65e5, 3.1e3, "Pa", 14.0, "")
    faint = stated_input("schedule.speed", "contradicted", 3.1, CRITERIA.ln_bayes_hint - 1.0)
    lines = describe_verdict(verdict("named", inputs=(*INPUTS, faint), held_key=held), catalogue())
    assert sum("contact.pressure is stated" in line for line in lines) == 1
    assert not any("schedule.speed" in line for line in lines)
    lines = describe_verdict(verdict("named", held_key=held), catalogue())
    assert sum("contact.pressure is stated" in line for line in lines) == 1
    lines = describe_verdict(verdict("held_key", inputs=INPUTS, held_key=held), catalogue())
    assert sum("contact.pressure is stated" in line for line in lines) == 1


def test_an_error_of_the_set_up_within_usual_limits_has_the_unit_of_its_input():
    found = (
        SetupErrorReport("ambient.temperature", -0.4, 0.05, "1", -0.8, "ambient.temperature is 19.6 degC, not 20 degC"),
        SetupErrorReport("block_length", 0.005, 0.001, "1", 0.5, "the block's length is 25.1 mm"),
    )
    lines = describe_verdict(verdict("none_needed", inputs=INPUTS, laboratory=found), catalogue())
    assert [line for line in lines if line.startswith("Within usual")] == [
        "Within usual limits, and calibrated: ambient.temperature is 19.6 degC, not 20 degC (+- 0.05 K); "
        "the block's length is 25.1 mm (+- 0.1 %)."
    ]


@pytest.mark.parametrize(("ln_bayes", "first"), [(69.0, "The model does not explain"), (11.0, "Something is missing")])
def test_an_input_that_is_wrong_comes_before_a_model_that_fails(ln_bayes, first):
    """A speed 5 % too low was told in the sixth sentence, after an effect and a law that were not there."""
    wrong = stated_input("schedule.speed", "contradicted", 4.1, ln_bayes)
    effect = replace(CAUSE, ln_bayes=12.0)
    lines = describe_verdict(verdict("unexplained", causes=(effect,), inputs=(wrong,), rules=(FAILED,)), catalogue())
    assert lines[0].startswith(first)
    assert sum("schedule.speed is stated as" in line for line in lines[1:]) == 1


def test_what_cannot_be_as_stated_has_no_number():
    swapped = Cause("exchanged", "a.nc and b.nc are exchanged", (), 2e6, 0.0, 1.0, ln_bayes=1e6, laboratory=True)
    lines = describe_verdict(verdict("named", causes=(swapped,)), catalogue())
    assert lines[0] == (
        "The set-up differs from what is stated: a.nc and b.nc are exchanged; as stated it is impossible."
    )
    html = verdict_report.render_report(verdict("named", causes=(swapped,), before=(), after=()))
    assert verdict_report.SETUP_ANSWERS_BY_KIND["named"] in html


def test_a_group_with_a_stated_input_says_so_everywhere(unpainted):
    """The headline, the sentences on the gain and the line on inputs do not take the effect for the only cause."""
    v = verdict("group", 1, group=("wear", "friction.mu"), causes=(replace(CAUSE, effect="wear"),), inputs=UNCHECKED)
    assert verdict_report.INPUT_OR_EFFECT_ANSWER in verdict_report.render_report(v)
    assert "inputs: with wear in the model, the data contradict no stated input" in str(v)
    lines = describe_verdict(replace(v, extended=EXTENDED), catalogue())
    assert any(line.startswith("With wear, and everything calibrated again, ") for line in lines)
    assert not any("the extension" in line for line in lines)


def test_a_shift_of_a_free_key_has_its_unit():
    found = NormalisedDeviation("ambient.convection", 11.2, 3.0, np.log(1.12) / 0.3, "W/m2K")
    v = verdict("named", nuisance=(found,), shifts=(("ambient.convection", 4.066, 11.2, 3.0),))
    [line] = [line for line in describe_verdict(v, catalogue()) if "would be estimated" in line]
    assert line.endswith("estimated as 4.066 instead of 11.2 +- 3 W/m2K.")
    cause = replace(CAUSE, references={"ambient.convection": "edge_pressure.reference = 20 degC"})
    lines = describe_verdict(replace(v, causes=(cause,)), catalogue())
    assert any(line.endswith("11.2 +- 3 W/m2K (at edge_pressure.reference = 20 degC).") for line in lines)
    lines = describe_verdict(replace(v, assumed={"ambient.convection": 0.3}), catalogue())  # 10 exp(-3 x 0.3) = 4.066
    assert any("estimated as 4.066 (the limit of 3 prior standard deviations) instead" in line for line in lines)


@pytest.mark.parametrize(("low", "wide"), [(20.1, 1.2), (20.2, 3.0), (20.4, 5.9), (20.4, 1.5), (20.0, 15.0)])
def test_a_colour_bar_has_no_part_without_colours(low, wide):
    ends = residual_images._round_ticks(Normalize(low, low + wide))
    marks = residual_images._inner_ticks(Normalize(ends[0], ends[-1]))
    assert ends[0] - 1e-9 <= marks[0] < marks[-1] <= ends[-1] + 1e-9
    assert 3 <= len(marks) <= 8


@pytest.mark.parametrize(("least", "most"), [(0.046, 0.11), (0.03, 0.1), (0.9, 1.3), (0.02, 4.0), (0.11, 0.35)])
def test_numbers_on_the_axis_of_what_was_gained_do_not_overlap(least, most):
    figure = Figure(figsize=(3.0, 1.2), dpi=160)
    axis = figure.add_subplot()
    with style.context(["default", theme.MATPLOTLIB_STYLE]):
        before_after._draw_dumbbells(axis, [("one", most, least)])
        FigureCanvasAgg(figure).draw()
    low, high = axis.get_xlim()
    labels = [t for t in axis.get_xticklabels() if low <= t.get_position()[0] <= high and t.get_text()]
    boxes = [t.get_window_extent() for t in labels]
    assert len(boxes) >= 2
    assert all(a.x1 + 2 < b.x0 for a, b in zip(boxes, boxes[1:], strict=False)), [t.get_text() for t in labels]


def test_heads_of_tables_stand_above_their_words():
    table = html_parts.table(["a", "words", "c"], [["1", "2", "3"], ["1", "w" * 25, "3"]])
    assert table.count('class="text"') == 3
    assert '<th scope="col" class="text">words</th>' in table


@pytest.mark.parametrize(
    ("error_K", "words"), [(0.002, "stays the same (0.0587 K and 0.06 K, within noise)"), (2e-4, "grows from 0.0587 K")]
)
def test_a_gain_or_loss_is_told_only_beyond_its_statistical_error(unpainted, error_K, words):
    base = replace(BASE, rmse_K=0.0587, held_out_rmse_K=0.0498, held_out_z=1.0)
    after = replace(base, rmse_K=0.06, rmse_change_error_K=error_K, held_out_z=1.003, held_out_rmse_K=0.05)
    v = verdict("named", base=base, extended=replace(after, held_out_z_change_error=error_K), before=(), after=())
    assert words in verdict_report.render_report(v)
    lines = describe_verdict(v, catalogue())
    assert any("as well as before (1 and 1 sigma, within noise)" in line for line in lines) == (error_K == 0.002)


def test_a_rule_that_passed_has_a_text_that_says_so():
    for rule in decide(
        VerdictEvidence(True, False, ("pressure_tilt",), ln_bayes=58.0, ln_bayes_discrepancy=40.0)
    ).rules:
        found = _rule_result(rule)
        assert rule.passed
        assert found.consequence == describe_success(found) != rule.consequence
    [failed] = decide(VerdictEvidence(False, False)).rules
    assert _rule_result(failed).consequence == failed.consequence
