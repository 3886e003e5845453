"""Reports as pages: one file that prints well and can be read aloud, the same as PDF, and errors before any work."""

import builtins
import hashlib
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import flashtemp
from flashtemp.__main__ import main
from flashtemp.api import reports
from flashtemp.errors import BadInput
from flashtemp.viz import theme
from flashtemp.viz.html import page, pdf, title_page

TITLE = "block <1> & more"
CASE = f"""
title = "{TITLE}"
[block]
length = 0.03
[schedule]
speed = 0.2
distance = 0.05
repetitions = 2
wait = 1.0
[numerics]
mesh = 0.25
[output]
profiles = 6
fields = 2
animation = false
"""
AA_CONTRAST = 4.5  # WCAG 2.2, criterion 1.4.3


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A case, its finished run with report, and a synthetic campaign of it, next to each other."""
    here = tmp_path_factory.mktemp("pages")
    (here / "case.toml").write_text(CASE)
    flashtemp.simulate(here, out=here / "run")
    flashtemp.report(here / "run")
    flashtemp.twin(here, hide=[], seed=1, out=here / "twin", conditions=1, views=["profile"], nuisance=0.0)
    flashtemp.compare(here / "twin", out=here / "compared")
    return here


@pytest.fixture(scope="module", params=["run", "compared"])
def html(request, folder):
    return (folder / request.param / "report.html").read_text(encoding="utf-8")


class Tags(HTMLParser):
    """Tags with their attributes, in order."""

    def __init__(self, html):
        super().__init__()
        self.found = []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def named(self, *tags):
        return [attributes for tag, attributes in self.found if tag in tags]


# --- one file -----------------------------------------------------------------------------------------
def test_a_report_is_one_file_without_scripts(html):
    tags = Tags(html)
    assert not tags.named("script", "link", "iframe", "object", "embed")
    assert all(a["src"].startswith("data:image/png;base64,") for a in tags.named("img"))
    assert all(a["href"].startswith("#") for a in tags.named("a"))
    assert not re.search(r"@import|url\(|https?:", html)


def test_the_style_is_made_for_paper_too(html):
    style = html[html.index("<style>") : html.index("</style>")]
    assert "size: A4" in style
    assert "counter(page)" in style
    assert re.search(r"figure, .*break-inside: avoid", style)
    assert re.search(r"h1, h2, h3.*break-after: avoid", style)
    assert 'a[href^="http"]::after { content: " (" attr(href) ")"' in style
    grounds = re.findall(r"background(?:-color)?:\s*([^;}]+)", style)
    assert {g.strip() for g in grounds} == {"#fff"}


def test_a_report_can_be_read_aloud(html):
    tags = Tags(html)
    assert tags.named("html")[0]["lang"] == "en"
    levels = [int(tag[1]) for tag, _ in tags.found if re.fullmatch(r"h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b <= a + 1 for a, b in zip(levels, levels[1:], strict=False)), levels
    assert len(tags.named("main")) == 1
    assert tags.named("nav")[0]["aria-label"]
    assert all(a.get("scope") in ("col", "row") for a in tags.named("th"))
    assert not re.search(r"<th[^>]*></th>", html)
    told = [a["alt"] for a in tags.named("img")]
    assert all(len(alt) > 40 and re.search(r"\d", alt) for alt in told), told
    assert len(set(told)) == len(told) >= 3


def test_all_text_has_enough_contrast_to_white():
    def luminance(colour):
        channels = np.array([int(colour[i : i + 2], 16) / 255 for i in (0, 2, 4)])
        linear = np.where(channels <= 0.03928, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
        return linear @ [0.2126, 0.7152, 0.0722]

    colours = re.findall(r"(?<![-\w])color: #(\w+)", page.PAGE_STYLE + page.PRINT_STYLE)
    assert len(colours) > 5
    for colour in colours:
        whole = colour if len(colour) == 6 else "".join(2 * c for c in colour)
        assert 1.05 / (luminance(whole) + 0.05) >= AA_CONTRAST, colour


# --- the title page -----------------------------------------------------------------------------------
def first_page(html):
    text = html[html.index('<section class="title-page">') : html.index("</section>")]
    return re.sub(r"<[^>]+>", "|", text)


def test_the_title_page_says_what_was_run_and_under_which_conditions(html):
    text = first_page(html)
    assert "block &lt;1&gt; &amp; more" in text
    assert re.search(r"\|command\|+flashtemp (run|compare) /", text)
    assert "|distance||0.05 m|" in text
    assert "|repetitions||2|" in text
    assert "|block, length × width × height||30 × 50 × " in text
    assert re.search(
        r"\|block, tread rubber\|\|conductivity [\d.]+ W/\(m K\), density \d+ kg/m³, heat capacity \d+ J/\(kg K\)\|",
        text,
    )
    assert re.search(r"on \d+ cells in 2 dimensions", text)
    assert "CVODE" in text
    assert re.search(r"about 3.8 % of the largest temperature rise", text), "the error of numerics.mesh = 0.25"
    assert flashtemp.__version__ in text
    assert re.search(r"\|date\|+20\d\d-\d\d-\d\d \d\d:\d\d [+-]\d{4}\|", text)


def test_values_of_several_conditions_are_listed_and_many_are_a_range(folder):
    case = flashtemp.load(folder)
    two = [{"contact.pressure": 2e5}, {"contact.pressure": 1e5, "friction.mu": 0.5}]
    found = dict(title_page.list_conditions(case, two))
    assert found["contact pressure"] == "0.1, 0.2 MPa"
    assert found["friction mu"] == f"0.5, {case['friction.mu']:g}"
    many = [{"schedule.speed": 0.1 * n} for n in range(1, 10)]
    assert dict(title_page.list_conditions(case, many))["speed"] == "9 values from 0.1 to 0.9 m/s"


def test_digests_are_those_of_the_inputs(folder):
    for name, file in (
        ("run", "run/case.toml"),
        ("compared", "twin/campaign.toml"),
        ("compared", "twin/condition1_mu.csv"),
    ):
        digest = hashlib.sha256((folder / file).read_bytes()).hexdigest()
        html = (folder / name / "report.html").read_text(encoding="utf-8")
        assert f'<th scope="row">{Path(file).name}</th><td class="digest">{digest}</td>' in html


# --- pdf ----------------------------------------------------------------------------------------------
def pdf_reader():
    """pypdf, where it and the writer of PDFs are installed."""
    try:
        pdf.import_library()
    except BadInput as fault:
        pytest.skip(str(fault))
    return pytest.importorskip("pypdf")


@pytest.mark.parametrize("name", [pytest.param("run", marks=pytest.mark.long), "compared"])
def test_the_pdf_has_the_pages_of_the_report_with_whole_pictures(folder, name):
    pypdf = pdf_reader()
    flashtemp.report(folder / name, pdf=True)
    html = (folder / name / "report.html").read_text(encoding="utf-8")
    document = pypdf.PdfReader(folder / name / "report.pdf")
    texts = [" ".join(p.extract_text().split()) for p in document.pages]
    count = len(texts)
    assert 3 <= count <= 12
    assert f"<title>{document.metadata.title}</title>" in html.replace("&lt;", "<").replace("&gt;", ">").replace(
        "&amp;", "&"
    )
    for number, text in enumerate(texts, 1):
        assert f"page {number} of {count}" in text
    assert "Conditions" in texts[0]
    assert "Method" in texts[0]
    assert "Reproducibility" in texts[-1]
    width, height = (float(v) for v in document.pages[0].mediabox[2:])
    assert (width, height) == pytest.approx((595.3, 841.9), abs=0.1)
    pictures = [p.get_contents().get_data().count(b" Do") for p in document.pages]
    assert pictures[0] == 0, "the title page stands alone"
    assert sum(pictures) == html.count("<img"), "a picture cut in two is on two pages"


def test_nothing_outside_a_report_gets_into_its_pdf(tmp_path):
    pypdf = pdf_reader()
    figure = theme.make_figure("secret", "", 2.0, 1.0)
    figure.savefig(tmp_path / "secret.png")
    (tmp_path / "report.html").write_text(f'<h1>a</h1><img src="{(tmp_path / "secret.png").as_uri()}" alt="b">')
    reports.report(tmp_path, pdf=True)
    assert b" Do" not in pypdf.PdfReader(tmp_path / "report.pdf").pages[0].get_contents().get_data()


@pytest.mark.parametrize("command", ["compare", "discover", "report"])
def test_without_the_library_a_pdf_is_refused_before_any_work(folder, tmp_path, monkeypatch, capsys, command):
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    monkeypatch.setattr("flashtemp.api.campaigns.open_campaign", lambda *a, **k: pytest.fail("work has begun"))
    target = str(folder / ("run" if command == "report" else "twin"))
    where = [] if command == "report" else ["--out", str(tmp_path / "out")]
    before = {p: p.stat().st_mtime_ns for p in (folder / "run").iterdir()}
    assert main([command, target, "--pdf", *where]) == 2
    told = capsys.readouterr().err
    assert told == "--pdf: WeasyPrint is not installed; pip install 'flashtemp[report]'\n"
    assert not (tmp_path / "out").exists()
    assert {p: p.stat().st_mtime_ns for p in (folder / "run").iterdir()} == before


def test_without_pango_the_remedy_is_told(monkeypatch):
    real = builtins.__import__

    def load(name, *rest):
        if name == "weasyprint":
            raise OSError("cannot load library 'libpango-1.0-0'")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", load)
    with pytest.raises(BadInput, match="finds no Pango.*install"):
        pdf.import_library()


def test_a_pdf_needs_a_folder_and_a_report_a_result(folder, tmp_path, capsys):
    with pytest.raises(BadInput, match="give out"):
        flashtemp.compare(folder / "twin", pdf=True)
    assert main(["report", str(tmp_path)]) == 2
    assert "no result of run, compare, discover, plan, sweep or sensitivity" in capsys.readouterr().err
    assert main(["report", str(folder / "compared")]) == 2
    assert "add --pdf" in capsys.readouterr().err


# --- pictures -----------------------------------------------------------------------------------------
@pytest.mark.parametrize("top", [17.5, 0.0125, 3.1, 260.0])
def test_ticks_of_axes_and_colour_bars_are_round(top):
    @theme.styled
    def draw():
        fig = theme.make_figure("what", "of which", 4.0, 3.0)
        ax = fig.subplots()
        ax.plot([0, top], [0, top])
        theme.add_colour_bar(fig, ax.imshow([[0.0, top]]), ax, "x (K)")
        return fig

    fig = draw()
    fig.canvas.draw()
    for axis in (fig.axes[0].xaxis, fig.axes[0].yaxis, fig.axes[1].yaxis):
        steps = np.diff(axis.get_majorticklocs())
        leading = steps / 10.0 ** np.floor(np.log10(steps) + 1e-9)
        assert np.allclose(leading, leading[0])
        assert np.isclose(leading[0], [1, 2, 5]).any(), leading


def test_a_bar_around_zero_is_labelled_at_its_ends():
    for limit in (theme.symmetric_limit(v) for v in np.geomspace(1e-4, 1e3, 40)):
        ticks = theme.symmetric_ticks(limit)
        assert ticks[[0, -1]] == pytest.approx([-limit, limit])
        assert 0.0 in ticks
        assert 3 <= len(ticks) <= 5


def test_long_titles_keep_what_is_shown():
    title = theme.compose_title("Heat budget", "a title of a user " * 30, 4.0)
    assert title.startswith("Heat budget, a title")
    assert title.endswith("...")
    assert len(title.splitlines()) == 2
    assert theme.compose_title("What", "file.nc\ncondition", 7.2) == "What, file.nc\ncondition"
