"""Packages import only downwards, and the drawing of the docs shows every one of them."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def drawing():
    """The program that draws."""
    spec = importlib.util.spec_from_file_location("architecture", ROOT / "docs" / "architecture.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture(scope="module")
def rooms(drawing):
    """The packages as they are."""
    return drawing.packages()


def test_every_package_stands_in_the_drawing(drawing, rooms):
    text = {e.text for e in ElementTree.fromstring(drawing.draw()).iter() if e.text}
    assert {name + ("/" if room.modules else "") for name, room in rooms.items()} <= text


def test_no_arrow_points_up(drawing, rooms):
    floor = {name: n for n, names in enumerate(drawing.floors(rooms)) for name in names}
    assert all(floor[used] < floor[name] for name, room in rooms.items() for used in room.uses)


def test_a_circle_is_told(drawing, rooms):
    turned = drawing.Package("physics", "", {}, frozenset({"discovery"}))
    with pytest.raises(SystemExit, match="circle"):
        drawing.floors(rooms | {"physics": turned})


def test_page_says_what_every_package_is_for(rooms):
    page = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    for name, room in rooms.items():
        assert f"`{name}" in page, name
        assert room.says, name
