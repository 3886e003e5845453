"""A server of a folder, and pages of it in a browser whose console must stay silent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from pkgutil import iter_modules

from flashtemp.physics import effects

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
COARSE = CASE + "pictures = false\nvtk = false\n"  # where only matters that it has run
# Servers are forked from a process that has loaded the program and what its first page needs: that takes 2 to 3 s.
FORKS = get_context("forkserver")
FORKS.set_forkserver_preload([
    "flashtemp.lab.pages", "flashtemp.cli.web_app", "aiofiles.tempfile", "anyio._backends._asyncio", "uvicorn.lifespan.on",
    "uvicorn.loops.auto", "uvicorn.protocols.http.auto", "uvicorn.protocols.websockets.auto",
    *(f"{effects.__name__}.{module.name}" for module in iter_modules(effects.__path__)),
])  # fmt: skip


def serve_folder(place: Path, said: Path, announce) -> None:
    """What `flashtemp lab` does with its folder until Ctrl-C, in a process that has loaded the program."""
    from flashtemp.cli.web_app import describe_commands
    from flashtemp.lab.server import serve

    with said.open("w") as file:
        os.dup2(file.fileno(), 2)
    try:
        serve(place, False, announce.send, describe_commands())
    except KeyboardInterrupt:  # uvicorn repeats the signal that stopped it
        return


@contextmanager
def served_by_command(place: Path):
    """The address of a server of the folder, and its process: by the command line itself."""
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
def served_by_fork(place: Path):
    """The same, forked from a process that has loaded the program."""
    with tempfile.TemporaryDirectory() as away:
        said, (heard, announce) = Path(away) / "stderr", FORKS.Pipe(duplex=False)
        process = FORKS.Process(target=serve_folder, args=(place, said, announce))
        process.start()
        announce.close()
        try:
            yield heard.recv(), process
        finally:
            if process.is_alive():
                os.kill(process.pid, signal.SIGINT)
            process.join(60)
            assert process.exitcode in (0, -signal.SIGKILL), process.exitcode
            assert "Traceback" not in said.read_text(), said.read_text()


# coverage follows commands, not what is forked
served = served_by_command if "COVERAGE_PROCESS_CONFIG" in os.environ else served_by_fork


@contextmanager
def page(browser, address, width=1280, scheme="light", path=None):
    """A page at that width, admitted by the server; whatever its console complains of fails the test.

    `path`: what it opens; nothing when not given, so that a test loads no page beside its own.
    """
    base, _, token = address.partition("/?")
    with browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme) as context:
        seen, said = context.new_page(), []
        seen.set_default_timeout(30_000)
        seen.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
        seen.on("pageerror", lambda e: said.append(str(e)))
        if path is None:
            assert context.request.get(f"{base}/files/?{token}", max_redirects=0).status == 303  # sets the cookie
        else:
            seen.goto(f"{base}{path}?{token}")
        yield seen
        assert said == []


QUIET = """(ms) => new Promise((done) => {
    let timer;
    const observer = new MutationObserver(() => restart());
    const restart = () => {
        clearTimeout(timer);
        timer = setTimeout(() => {
            if (document.querySelector(".q-spinner")) return restart();
            observer.disconnect();
            done();
        }, ms);
    };
    observer.observe(document, {subtree: true, childList: true, attributes: true, characterData: true});
    restart();
})"""


def wait_until_quiet(seen, ms=500):
    """Until the page is connected to its server, has read all files, and nothing on it has changed for that time."""
    seen.wait_for_function("window.socket?.connected")
    seen.evaluate(QUIET, ms)
