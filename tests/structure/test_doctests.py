"""The examples in the docstrings are true."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import pytest

import flashtemp

FEWEST = 40  # a ratchet: examples may only become more


def modules() -> list[str]:
    names = ["flashtemp"]
    for name in ("flashtemp", "flashtemp.meshes", "flashtemp.viz"):
        path = importlib.import_module(name).__path__
        names += [name, *(m.name for m in pkgutil.walk_packages(path, f"{name}."))]
    return sorted(set(names))


@pytest.mark.parametrize("name", modules())
def test_examples(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_there_are_examples():
    finder = doctest.DocTestFinder()
    found = [e for n in modules() for t in finder.find(importlib.import_module(n)) for e in t.examples]
    assert len(found) >= FEWEST


def test_all_folders_are_walked():
    """meshes and viz stand beside the package and are installed inside it."""
    names = modules()
    assert {
        "flashtemp.meshes.mesh",
        "flashtemp.physics.effects.friction",
        "flashtemp.camera.importing.formats.flir",
    } <= set(names)
    assert any(n.startswith("flashtemp.viz.") for n in names)
    assert flashtemp.__name__ in names
