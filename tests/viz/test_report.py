"""The report of a comparison: one whole file, nothing outside it, its numbers those of the comparison."""

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import Campaign, LoadCellEntry, RecordingEntry
from flashtemp.comparison.compare import Comparison, ForceComparison, RecordingComparison, summary_line
from flashtemp.comparison.noise import NoiseLevels, ResidualPeak
from flashtemp.viz.html import comparison_report

TITLE = 'run-in <script>alert(1)</script> & "more"'
RUN = SimpleNamespace(
    direction=None,
    time=np.array([0.0, 4.0]),
    sliding=np.array([True, True]),
    repetition=np.array([1, 1]),
    energy_imbalance=2.5e-12,
)


def seeing(view="sidewall", file="side.nc"):
    """A recording 0.3 K hotter than computed at one end, by hand."""
    nv = 1 if view == "profile" else 6
    predicted = 25.0 + np.zeros((3, nv, 8))
    residual = 0.05 * np.random.default_rng(1).normal(size=predicted.shape)
    residual[:, :, 5:] += 0.3
    u, v = 1e-3 * np.arange(8) + 0.03, 1e-3 * np.arange(nv)
    recording = Recording(view, predicted + residual, np.array([1.0, 2.0, 3.0]), np.ones(3, int), u, v)
    given = {"contact.pressure": 1.5e5, "schedule.speed": "<slow>.csv"}
    return RecordingComparison(
        view=RecordingEntry(file, recording, given),
        predicted=predicted,
        residual=residual,
        sigmas=residual / 0.05,
        noise=NoiseLevels(0.0512, 0.021, ("white",)),
        shift=(0.31, -0.12),
        shift_refused=None,
        shift_error=(0.04, 0.05),
        rmse_K=0.1834,
        bias_K=0.1129,
        chi2_per_dof=13.1,
        pixels=residual.size,
        largest=ResidualPeak(0.31, 29.6, 0.0365, 0.0035, 2.0, 1),
        correlation={"u": (0.8, 9.14), "v": (0.7, 8.25), "time": (0.6, 7.36)},
    )


def pulling(bias=0.04, chi2=64.0, sure=5.5):
    time = np.linspace(0.0, 4.0, 30)
    return ForceComparison(
        LoadCellEntry("mu.csv", tuple(time), tuple(0.8 + bias + 0 * time), {}, None, True), 0.8 + 0 * time,
        bias + 0 * time, 0.005, abs(bias), bias, chi2, {"time": (0.9, sure)},
    )  # fmt: skip


def comparison(seeings, pullings, title=TITLE):
    views, forces = tuple(s.view for s in seeings), tuple(p.force for p in pullings)
    campaign = Campaign(title, Path("case.toml"), (), views, forces, Path("."))
    return Comparison(campaign, tuple(seeings), tuple(pullings), (RUN,))


class Reader(HTMLParser):
    """Every tag closed in its turn; text, attributes and cells kept."""

    def __init__(self, html):
        super().__init__()
        self.open, self.tags, self.attributes, self.text, self.rows = [], [], [], "", []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.handle_startendtag(tag, attrs)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, *a) for a in attrs]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script"):
            self.text += data
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    c = comparison([seeing(), seeing("wake", "wake.nc"), seeing("profile", "profile.nc")], [pulling()])
    path = tmp_path_factory.mktemp("report") / "report.html"
    assert comparison_report.write_report(c, path) == path
    assert [p.name for p in path.parent.iterdir()] == ["report.html"]
    html = path.read_text(encoding="utf-8")
    return c, html, Reader(html)


def test_every_tag_is_closed_and_nothing_lies_outside_the_file(written):
    _, html, reader = written
    assert html.startswith("<!DOCTYPE html>")
    assert {"script", "link", "iframe"}.isdisjoint(reader.tags)
    assert not re.search(r"https?:|url\(|@import", html)
    assert all(value.startswith("data:image/png;base64,") for _, name, value in reader.attributes if name == "src")
    assert not any(name.startswith("on") for _, name, _ in reader.attributes)


def test_all_pictures_are_inside(written):
    _, _, reader = written
    pictures = [base64.b64decode(v.split(",", 1)[1], validate=True) for t, n, v in reader.attributes if n == "src"]
    assert len(pictures) == 1 + 1 + 2 * 3 + 1  # the worst frame, overview, two a recording, one a trace
    assert all(p.startswith(b"\x89PNG") and p.rstrip().endswith(b"IEND\xaeB`\x82") for p in pictures)
    assert len(set(pictures)) == len(pictures)
    assert sum(name == "alt" and bool(value) for _, name, value in reader.attributes) == len(pictures)


def test_a_list_leads_to_every_section(written):
    _, html, reader = written
    assert html.index("Main result") < html.index("<nav") < html.index("<img") < html.index("<table")
    assert html[: html.index("<img")].count('class="verdict') == 1, "one sentence"
    listed = [v for _, name, v in reader.attributes if name == "href"]
    assert listed == ["#largest", "#files", "#numbers", "#pictures", *(f"#file-{i}" for i in range(1, 5)), "#reading"]
    assert {v[1:] for v in listed} <= {v for _, name, v in reader.attributes if name == "id"}
    told = [v for _, name, v in reader.attributes if name == "alt"]
    assert len(set(told)) == len(told)
    assert all(len(v) > 40 for v in told)


def test_text_is_escaped(written):
    _, html, reader = written
    assert TITLE in reader.text
    assert "<script>" not in html
    assert "<slow>" not in html
    assert "speed <slow>.csv" in reader.text


def test_the_numbers_are_those_of_the_comparison(written):
    c, _, reader = written
    head, row = reader.rows[:2]
    cells = dict(zip(head, row, strict=True))
    assert cells["recording"] == "side.nc"
    assert cells["condition"] == "contact pressure 0.15 MPa, speed <slow>.csv"
    assert (cells["frames"], cells["RMSE (K)"], cells["bias (K)"]) == ("3", "0.183", "+0.113")
    assert (cells["chi2/dof (–)"], cells["white noise (K)"]) == ("13.1", "0.0512 estimated")
    assert cells["fixed pattern (K)"] == "0.021"
    assert cells["image shift u, v (px)"] == "+0.31, -0.12 ± 0.04, 0.05"
    assert cells["correlation of neighbours in sigma"] == "x +9.1, z +8.2, time +7.4"
    where = "+0.31 K, +30 sigma at x = 36.5 mm, z = 3.5 mm, t = 2 s (repetition 1)"
    assert cells["largest structured difference"] == where
    assert reader.rows[2][-2].startswith("x +9.1, y +8.2")
    assert reader.rows[3][-2] == "x +9.1, time +7.4"
    force = dict(zip(reader.rows[4], reader.rows[5], strict=True))
    assert force["load cell"] == "mu.csv (held out)"
    assert (force["readings"], force["RMSE (–)"], force["bias (–)"]) == ("30", "0.0400", "+0.0400")
    assert (force["noise (–)"], force["correlation in time in sigma"]) == ("0.005 estimated", "+5.5")
    assert all(summary_line(s) in reader.text for s in c.recordings)
    assert "2.5e-12" in reader.text


def test_it_says_how_to_read_it(written):
    text = written[2].text
    assert "not fitted to these data" in text
    assert all(term in text for term in ("chi2/dof", "Sigma", "Whiteness", "small shift of each image"))


def test_verdicts_follow_from_size_and_structure():
    s = seeing()
    still = {"u": (0.0, 1.0), "v": (0.0, -2.0), "time": (0.0, 3.0)}
    sentence, grade = comparison_report.judge_recording(s)
    assert grade == "bad"
    assert "3.6 times the noise" in sentence
    assert "the block is measured 0.31 K hotter than computed at x = 36.5 mm, z = 3.5 mm" in sentence
    cold = replace(seeing("wake"), largest=replace(s.largest, K=-0.31))
    assert (
        "the road is measured 0.31 K colder than computed at x = 36.5 mm, y = 3.5 mm"
        in comparison_report.judge_recording(cold)[0]
    )
    assert comparison_report.judge_recording(replace(s, chi2_per_dof=1.1))[1] == "near"
    assert comparison_report.judge_recording(replace(s, chi2_per_dof=1.1, correlation=still))[1] == "good"
    sentence, grade = comparison_report.judge_recording(replace(s, correlation=still))
    assert grade == "near"
    assert "no structure" in sentence
    assert comparison_report.judge_recording(replace(s, pixels=0, chi2_per_dof=float("nan")))[1] == "bad"
    assert "higher than computed by 0.04" in comparison_report.judge_friction(pulling())[0]
    assert "lower than computed by 0.04" in comparison_report.judge_friction(pulling(-0.04))[0]
    assert comparison_report.judge_friction(pulling(0.0, 1.0))[1] == "near"
    assert comparison_report.judge_friction(pulling(0.0, 1.0, sure=0.5))[1] == "good"


@pytest.mark.long
def test_a_refused_shift_and_estimated_noise_are_said():
    s = replace(seeing(), shift_refused=(4.4, 0.4), shift=(0.0, 0.0), shift_error=(0.0, 0.0))
    reader = Reader(comparison_report.render_report(comparison([s], [])))
    assert "A shift of the image by +4.40, +0.40 px would hide part of the difference" in reader.text
    assert "none; +4.40, +0.40 not applied" in reader.rows[1]
    assert "The noise of the pixels is not stated in the file" in reader.text
    quiet = replace(s, shift_refused=None, noise=NoiseLevels(0.05, 0.02))
    text = Reader(comparison_report.render_report(comparison([quiet], []))).text
    assert "would hide" not in text
    assert "is not stated" not in text


def test_a_campaign_of_forces_only():
    reader = Reader(comparison_report.render_report(comparison([], [pulling()])))
    assert reader.tags.count("img") == 2
    assert reader.tags.count("table") == 1
    assert "0 recordings, 1 load-cell file;" in reader.text
