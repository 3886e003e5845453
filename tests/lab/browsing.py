"""A server of a folder, and pages of it in a browser whose console must stay silent."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

CASE = """title = "small"
[schedule]
distance = 0.4
repetitions = 2
wait = 4.0
[numerics]
mesh = 0.3
[output]
animation = false
"""


@contextmanager
def served(place: Path):
    """The address of a server of the folder, and its process."""
    words = [sys.executable, "-m", "flashtemp", "lab", str(place), "--no-browser"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process.stdout.readline().strip(), process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=60)[1]
        assert "Traceback" not in said, said


@contextmanager
def page(browser, address, width=1280, scheme="light"):
    """A page at that width; whatever its console complains of fails the test."""
    with browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme) as context:
        seen, said = context.new_page(), []
        seen.set_default_timeout(30_000)
        seen.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
        seen.on("pageerror", lambda e: said.append(str(e)))
        seen.goto(address)
        yield seen
        assert said == []
