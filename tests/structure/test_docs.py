"""The documentation: every link of the plain pages leads somewhere, every case stands in the gallery."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from dataclasses import fields
from pathlib import Path
from xml.etree import ElementTree

import pytest

from flashtemp.cli.commands import app
from flashtemp.discovery.criteria import Criteria
from flashtemp.discovery.verdict import VERDICT_KINDS
from flashtemp.model.schema import declared_params

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    p for p in ROOT.rglob("*.md") if not {".venv", "build", "made", "results"} & set(p.relative_to(ROOT).parts)
)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
FILE_ENDS = {"toml", "json", "nc", "csv", "py", "vtkhdf"}


def slug(heading: str) -> str:
    """The anchor of a heading, as code hosts make it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in LINK.findall(text):
        name, _, anchor = target.partition("#")
        if re.match(r"https?:|mailto:", name) or "made" in name.split("/"):
            continue
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), f"{page.name}: {target}"
        if anchor:
            heads = re.findall(r"^#+ (.+)$", file.read_text(encoding="utf-8"), flags=re.MULTILINE)
            assert anchor in map(slug, heads), f"{page.name}: {target}"


def test_every_case_stands_in_the_gallery(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs"), *sys.path])
    import gallery

    cases = {p.parent.name for p in (ROOT / "cases").glob("*/case.toml")}
    assert set(gallery.CASES) == set(gallery.told()) == cases
    assert {p.stem for p in gallery.PICTURES.glob("*.png")} == cases
    page = gallery.page()
    assert all(f"## {name}\n" in page for name in cases)


def test_figures_of_the_choices_cover_every_choice(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs"), *sys.path])
    import choices
    import temperature_speed_band as band

    for own in json.loads(choices.OUT.read_text(encoding="utf-8")).values():
        assert list(own) == list(choices.CHOICES), "run .venv/bin/python docs/choices.py"
    stored = json.loads(band.OUT.read_text(encoding="utf-8"))
    conditions = len(band.SPEEDS) * len(band.PRESSURES) * len(band.AMBIENT)
    asked = [name for name in choices.CHOICES for _ in range(conditions)]
    assert [row["choice"] for row in stored["rows"]] == asked, "run .venv/bin/python docs/temperature_speed_band.py"
    assert json.loads(json.dumps(band.summary(stored["rows"]))) == stored["summary"]


def test_pages_on_discovery_agree_with_code_and_data(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs"), *sys.path])
    import discovery_tables

    for name in discovery_tables.TABLES:
        text = (ROOT / "docs" / name).read_text(encoding="utf-8")
        assert discovery_tables.page(name, text) == text, "run .venv/bin/python docs/discovery_tables.py"


def test_every_criterion_stands_on_its_page_once():
    text = (ROOT / "docs" / "reference" / "discovery_criteria.md").read_text(encoding="utf-8")
    page = text.partition("<!-- criteria:")[2].partition("<!-- end -->")[0]
    assert re.findall(r"^\| `(\w+)`", page, re.MULTILINE) == [f.name for f in fields(Criteria)]


def test_replayed_criteria_show_what_changes(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs"), *sys.path])
    import discovery_tables

    none = {"half": 0, "double": 0}
    row = {
        "campaigns": 9, "decides": "verdicts", "half": {"weak_wrong": 2, "none": -2}, "double": {},
        "moved": {"half": {"a": "none -> weak", "b": "none -> weak"}, "double": {}}, "not_fitted": none | {"half": 1},
        "fits": {"half": [3, 0], "double": [0, 0]}, "law_not_tried": none, "recordings": {"half": [], "double": []},
    }  # fmt: skip
    (tmp_path / "replay.json").write_text(json.dumps({"campaigns": [], "criteria": {"max_causes": row}}))
    monkeypatch.setattr(discovery_tables, "REPLAY", tmp_path / "replay.json")
    words = "weak wrong +2, none -2, 2 verdicts change, fits +3, 1 not decidable"
    assert f"| `max_causes` | 9 | verdicts | {words} | none |" in discovery_tables.replay_table()


def test_flow_chart_of_discovery_names_modules_that_exist(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs"), *sys.path])
    import discovery_chart

    for step in (*discovery_chart.STEPS, discovery_chart.LAW):
        assert all((discovery_chart.PACKAGE / f"{module}.py").exists() for module in step.modules), step.name
    assert ElementTree.fromstring(discovery_chart.draw()).tag.endswith("svg")


def test_guide_says_what_to_do_with_every_kind_of_verdict():
    guide = (ROOT / "docs" / "how_to" / "discovery_guide.md").read_text(encoding="utf-8")
    rows = guide.partition("## What to do next")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)`", rows, re.MULTILINE)) == set(VERDICT_KINDS)


def test_glossary_is_sorted_and_names_keys_and_commands_that_exist():
    text = (ROOT / "docs" / "reference" / "glossary.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (?!term|-)([^|]+) \| ([^|]*) ?\| ([^|]+) \| (.+) \|$", text, re.MULTILINE)
    terms = [row[0].lower() for row in rows]
    assert len(terms) >= 80
    assert terms == sorted(set(terms))
    places = re.findall(r"`([^`]+)`", " ".join(row[3] for row in rows))
    keys = [
        p for p in places if re.fullmatch(r"[a-z_]+(\.NAME)?\.[a-zA-Z_]+", p) and p.rpartition(".")[2] not in FILE_ENDS
    ]
    assert len(keys) > 50
    for table, _, key in (k.rpartition(".") for k in keys):
        assert key in declared_params(table), f"{table}.{key}"
    for command in {p.split()[1] for p in places if p.startswith("flashtemp ")}:
        assert command in app, command


@pytest.mark.parametrize("book", sorted((ROOT / "docs" / "tutorials").glob("*.ipynb")), ids=lambda p: p.stem)
def test_notebooks_are_kept_without_what_they_print(book):
    cells = json.loads(book.read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)
    assert cells[0]["cell_type"] == "markdown"


def test_the_recipe_asks_for_what_the_package_asks_for():
    told = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = (ROOT / "docs" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    asked = re.findall(r"^    - (\S+) (>=\S+)$", recipe.split("  run:\n")[1].split("\ntests:")[0], re.MULTILINE)
    wanted = {(re.sub("^matplotlib$", "matplotlib-base", n), v) for n, v in (split(d) for d in told["dependencies"])}
    assert set(asked) == wanted | {("python", told["requires-python"])}
    released = re.search(r"^## (\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)[1]
    for file in ("docs/conda/recipe.yaml", "CITATION.cff", "pyproject.toml"):
        assert released in (ROOT / file).read_text(encoding="utf-8"), file


def split(dependency: str) -> tuple[str, str]:
    """Name and bound."""
    name, bound = re.fullmatch(r"([\w-]+)(>=.+)", dependency).groups()
    return name, bound
