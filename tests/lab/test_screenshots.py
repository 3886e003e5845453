"""Key states of the pages look as they were last judged; write them anew with FLASHTEMP_SCREENS=write."""

from __future__ import annotations

import os
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from lab.browsing import CASE, page, served, wait_until_quiet

SCREENS = Path(__file__).parents[1] / "data" / "screens"
CELL_PX = 16  # side of the squares whose mean colours are compared: wider than a letter, narrower than a field
MAX_MEAN_DIFFERENCE = 0.02  # of all squares, 1 is black against white
MAX_CHANGED_SHARE = 0.03  # of squares that differ by more than a tenth: one field that is missing or moved
STATES = {
    "home": ("/", 1280, "light"), "home_narrow_dark": ("/", 800, "dark"), "case": ("/case?open=case.toml", 1280, "light"),
    "camera": ("/camera?open=cam", 1280, "light"), "campaign": ("/campaign", 1280, "light"),
}  # fmt: skip


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """A server of a folder whose name, case and four camera images are always the same."""
    place = tmp_path_factory.mktemp("screens") / "laboratory"
    (place / "cam").mkdir(parents=True)
    (place / "case.toml").write_text(CASE)
    warm = 20.0 + 30.0 * np.exp(-((np.arange(80)[None] - 40.0) ** 2) / 400.0 - np.arange(60)[:, None] / 20.0)
    for k in range(4):
        np.savetxt(place / "cam" / f"frame_{k}.csv", 20.0 + (warm - 20.0) * (k + 1) / 4, "%.2f", ",")
    with served(place) as (address, _):
        yield address


def mean_colours(picture: bytes) -> np.ndarray:
    """Mean colour (rows, columns, 3) of every square of CELL_PX, from 0 to 1."""
    from PIL import Image

    rgb = np.asarray(Image.open(BytesIO(picture)).convert("RGB"), float) / 255.0
    rows, columns = (n // CELL_PX for n in rgb.shape[:2])
    return rgb[: rows * CELL_PX, : columns * CELL_PX].reshape(rows, CELL_PX, columns, CELL_PX, 3).mean((1, 3))


def differences(seen: np.ndarray, stored: np.ndarray) -> tuple[float, float]:
    """Mean difference of all squares, and the share of those that differ by more than a tenth."""
    each = np.abs(seen - stored).max(axis=2)
    return float(each.mean()), float((each > 0.1).mean())


@pytest.mark.parametrize(
    "name", [n if n in ("home", "case") else pytest.param(n, marks=pytest.mark.long) for n in STATES]
)
def test_page_looks_as_it_was_judged(browser, address, name):
    from PIL import Image

    path, width, scheme = STATES[name]
    with page(browser, address, width, scheme) as seen:
        seen.goto(address.split("/?")[0] + path)
        seen.locator("h1").first.wait_for()
        wait_until_quiet(seen, 1000)
        found = mean_colours(seen.screenshot())  # what is visible without scrolling
    file = SCREENS / f"{name}.png"
    if os.environ.get("FLASHTEMP_SCREENS") == "write":
        Image.fromarray(np.round(255 * found).astype(np.uint8)).save(file)
    stored = np.asarray(Image.open(file).convert("RGB"), float) / 255.0
    assert found.shape == stored.shape
    mean, changed = differences(found, stored)
    assert mean <= MAX_MEAN_DIFFERENCE
    assert changed <= MAX_CHANGED_SHARE


def test_a_missing_card_is_a_difference():
    stored = np.ones((56, 80, 3))
    stored[10:20, 10:40] = 0.5
    assert differences(np.ones_like(stored), stored)[1] > MAX_CHANGED_SHARE
