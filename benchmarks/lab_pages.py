"""Time until the pages of the web app show their first content, in a browser without a screen.

    python benchmarks/lab_pages.py [FOLDER]

Serves FOLDER (a new one with a case when none is given), opens every page three times and prints the least and the
median First Contentful Paint (W3C Paint Timing) in ms.  Chromium and playwright are needed, as for the tests.
"""

from __future__ import annotations

import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

PAGES = ("/", "/camera", "/case?open=case.toml", "/campaign", "/runs")
N_VISITS = 3
FIRST_PAINT = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? NaN"


def measure_pages(folder: Path, pages: tuple[str, ...] = PAGES) -> dict[str, list[float]]:
    """{page: times (ms) from the request to the first content}, each in a browser context of its own."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    server = subprocess.Popen(
        [sys.executable, "-m", "flashtemp", "lab", str(folder), "--no-browser"], stdout=subprocess.PIPE, text=True
    )
    times: dict[str, list[float]] = {path: [] for path in pages}
    try:
        address = server.stdout.readline().strip() if server.stdout else ""
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
            for path in pages * N_VISITS:
                context = browser.new_context(viewport={"width": 1280, "height": 900})
                page = context.new_page()
                page.goto(address)  # the token becomes a cookie, and what never changes is in the cache
                page.goto(address.split("/?")[0] + path)
                page.wait_for_timeout(1500)
                times[path].append(float(page.evaluate(FIRST_PAINT)))
                context.close()
            browser.close()
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(30)
    return times


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch)
        if len(sys.argv) == 1:
            (folder / "case.toml").write_text("[schedule]\ndistance = 0.4\n")
        print("page, least and median first contentful paint in ms")
        for path, times in measure_pages(folder).items():
            print(f"{path:24s} {min(times):6.0f} {statistics.median(times):6.0f}")


if __name__ == "__main__":
    main()
