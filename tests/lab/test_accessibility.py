"""Every page meets the Web Content Accessibility Guidelines 2.2, levels A and AA, as far as axe-core can tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lab.browsing import CASE, page, served, wait_until_quiet

import flashtemp
from flashtemp.lab.style import COLOURS

RULES = {
    "runOnly": {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}
}
AA_CONTRAST = 4.5  # criterion 1.4.3, text of usual size
TEXT_ON_GROUND = [
    (text, ground)
    for ground in ("ground", "surface", "sunken")
    for text in ("text", "muted", "accent", "good", "warning", "error")
] + [("on-accent", "accent"), ("accent", "accent-soft")]


def relative_luminance(colour: str) -> float:
    """Definition in the guidelines (sRGB)."""
    channels = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize(("text", "ground"), TEXT_ON_GROUND)
def test_text_stands_out_from_its_ground(text, ground, scheme):
    low, high = sorted(relative_luminance(COLOURS[role][scheme]) for role in (text, ground))
    assert (high + 0.05) / (low + 0.05) >= AA_CONTRAST


@pytest.fixture(scope="module")
def filled(tmp_path_factory) -> Path:
    """A folder with a case, camera files, a campaign with recordings, and a run."""
    place = tmp_path_factory.mktemp("filled")
    (place / "camera").mkdir()
    for k in range(3):
        np.savetxt(
            place / "camera" / f"frame_{k}.csv", 20.0 + np.arange(30.0 * 40.0).reshape(30, 40) / 100.0, fmt="%.2f"
        )
    (place / "case.toml").write_text(CASE)
    flashtemp.simulate(place / "case.toml", out=place / "results" / "case-run")
    flashtemp.twin(place / "case.toml", hide=[], seed=3, out=place / "lab", conditions=1, views=["sidewall"])
    return place


@pytest.fixture(scope="module")
def address(filled):
    with served(filled) as (address, _):
        yield address


PAGES = {
    "home": "/", "camera": "/camera", "recording": "/camera?open=lab/condition1_sidewall.nc",
    "frames": "/camera?open=camera", "case": "/case?open=case.toml", "campaign": "/campaign?open=lab/campaign.toml",
    "form": "/runs?command=run&of=case.toml", "result": "/result?open=results/case-run",
}  # fmt: skip
BARE_PAGES = {
    "no case": "/case", "no campaign": "/campaign", "runs": "/runs", "no such result": "/result?open=nothing",
}  # fmt: skip


def check_page(seen):
    """No barrier that axe-core finds, and no scrolling sideways."""
    from axe_playwright_python.sync_playwright import Axe

    wait_until_quiet(seen)  # what the server adds after the page is connected
    found = Axe().run(seen, options=RULES).response["violations"]
    told = [f"{v['id']}: {v['help']}: {n['html'][:160]} {n['failureSummary'][:200]}" for v in found for n in v["nodes"]]
    assert told == []
    before = seen.viewport_size
    for width in (1280, 800):
        seen.set_viewport_size({"width": width, "height": 900})
        seen.wait_for_timeout(200)
        assert seen.evaluate("document.documentElement.scrollWidth") <= width
    seen.set_viewport_size(before)


@pytest.mark.long  # tests of the home page, of a case, of a campaign, of frames, of results and of runs check theirs
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", PAGES | BARE_PAGES)
def test_page_is_accessible_and_never_scrolls_sideways(browser, address, name, scheme):
    with page(browser, address, scheme=scheme) as seen:
        seen.goto(address.split("/?")[0] + (PAGES | BARE_PAGES)[name])
        seen.locator("h1").first.wait_for()
        check_page(seen)
