"""The documentation: every link of the plain pages leads somewhere, every case stands in the gallery."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    p for p in ROOT.rglob("*.md") if not {".venv", "build", "made", "results"} & set(p.relative_to(ROOT).parts)
)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def slug(heading: str) -> str:
    """The anchor of a heading, as code hosts make it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in LINK.findall(text):
        name, _, anchor = target.partition("#")
        if re.match(r"https?:|mailto:", name) or name.startswith("made/"):
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


@pytest.mark.parametrize("book", sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")), ids=lambda p: p.stem)
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
