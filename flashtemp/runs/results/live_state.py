"""State of a running command for the web app: a small JSON file, written where the environment names one.

The variable FLASHTEMP_LIVE holds the path of the file.  It is replaced atomically, at most once per second, and merged
section by section: `began` and `pid`, `progress` (done, total, left_s), `message`, `stage` (details of progress
messages), `run` (see `runs.live_run`), and `end` (exit code and time).  Without the variable nothing is written.
"""

from __future__ import annotations

import json
import os
import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flashtemp.display import make_json_safe

LIVE_VARIABLE = "FLASHTEMP_LIVE"
LIVE_PERIOD_S = 1.0  # least time between two writes of a section


@dataclass
class LiveFile:
    """The state file at `path`; `written` is the time (s, monotonic) of the last write by this object."""

    path: Path
    written: float = float("-inf")

    def is_due(self) -> bool:
        """Whether LIVE_PERIOD_S have passed since the last write."""
        return time.monotonic() - self.written >= LIVE_PERIOD_S

    def write_sections(self, **sections: Any) -> None:
        """Replace sections of the file and keep the others; a full disk or a missing folder is no fault of a run."""
        self.written = time.monotonic()
        with suppress(OSError):
            text = json.dumps(make_json_safe(self._read_sections() | sections), default=float)
            fresh = self.path.with_name(f".{secrets.token_hex(8)}.live")
            try:
                with fresh.open("x", encoding="utf-8") as file:
                    file.write(text)
                fresh.replace(self.path)
            finally:
                fresh.unlink(missing_ok=True)

    def write_end(self, exit_code: int) -> None:
        """Write an exit code with the present time."""
        self.write_sections(end={"exit_code": exit_code, "time": time.time()})

    def _read_sections(self) -> dict[str, Any]:
        try:
            sections = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return sections if isinstance(sections, dict) else {}

    def publish_message(self, text: str) -> None:
        """Write a progress message; details that it has replace those of the same name."""
        stage = self._read_sections().get("stage", {}) | dict(getattr(text, "details", {}))
        self.write_sections(message=str(text), said=time.time(), **({"stage": stage} if stage else {}))


def open_live_file() -> LiveFile | None:
    """The state file that the environment names, or None."""
    name = os.environ.get(LIVE_VARIABLE)
    return LiveFile(Path(name)) if name else None


def record_start() -> None:
    """Write the process number and the time at which the command began."""
    if (live := open_live_file()) is not None:
        live.write_sections(pid=os.getpid(), began=time.time())


def record_end(exit_code: int) -> None:
    """Write the exit code of the command and the time at which it ended."""
    if (live := open_live_file()) is not None:
        live.write_end(exit_code)


def publish_messages(say: Callable[[str], Any]) -> Callable[[str], Any]:
    """A function for progress messages that also writes them to the state file, if there is one."""
    live = open_live_file()
    if live is None:
        return say

    def say_and_publish(text: str) -> None:
        say(text)
        live.publish_message(text)

    return say_and_publish
