"""Frames of opened camera files over HTTP, as 32-bit floats, for the pages that hold the key of the set."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from starlette.requests import Request
from starlette.responses import Response

from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.lab.opened_frames import OpenedFrames, open_frames

FRAMES_ADDRESS = "/frames"
KEY_BYTES = 18  # of randomness in a key
MAX_THUMBNAIL_STEP = 64
BINARY_HEADERS = {"cache-control": "no-store", "content-encoding": "identity"}  # packing costs more than sending


class FrameServer:
    """Opened sets of frames by a random key, until the page that opened a set is closed."""

    def __init__(self) -> None:
        self._sets: dict[str, OpenedFrames] = {}
        self._versions: WeakValueDictionary[tuple[object, ...], OpenedFrames] = WeakValueDictionary()

    def read(
        self, files: list[Path], facts: ImportOptions, report_frames: Callable[[int], object],
        report_share: Callable[[float], object] = lambda share: None,
    ) -> OpenedFrames:  # fmt: skip
        """The frames of camera files; those that a page shows already are not read again.  Raises BadInput."""
        version = (*((str(f), (state := f.stat()).st_mtime_ns, state.st_size) for f in files), repr(facts))
        opened = self._versions.get(version)
        if opened is None:
            opened = self._versions[version] = open_frames(files, facts, report_frames, report_share)
        return opened

    def share(self, opened: OpenedFrames) -> str:
        """Serve the frames; returns their address, to which `/NUMBER` of a frame or `/mask` is added."""
        key = secrets.token_urlsafe(KEY_BYTES)
        self._sets[key] = opened
        return f"{FRAMES_ADDRESS}/{key}"

    def replace(self, address: str, opened: OpenedFrames) -> None:
        """Serve other frames at the address of a set that is still served."""
        key = _key_of(address)
        if key in self._sets:
            for version, held in list(self._versions.items()):
                if held is self._sets[key]:
                    self._versions[version] = opened
            self._sets[key] = opened

    def withdraw(self, address: str) -> None:
        """Serve the frames of this address no longer."""
        self._sets.pop(_key_of(address), None)

    def add_route(self, app: Any) -> None:
        """Let an application answer the addresses of frames."""
        app.add_route(f"{FRAMES_ADDRESS}/{{key}}/{{name}}", self.answer)

    def answer(self, request: Request) -> Response:
        """A frame (float32, rows x columns, NaN where unknown), or the `mask` of bad pixels (uint8); 404 for others."""
        opened, name = self._sets.get(request.path_params["key"]), request.path_params["name"]
        if opened is None:
            return Response("no such frames\n", 404, media_type="text/plain")
        if name == "mask":
            return Response(opened.pixel_classes.tobytes(), 200, BINARY_HEADERS, "application/octet-stream")
        number, step = (_parse_number(text) for text in (name, request.query_params.get("step", "1")))
        if number is None or step is None or number >= len(opened.frames) or not 1 <= step <= MAX_THUMBNAIL_STEP:
            return Response("no such frame\n", 404, media_type="text/plain")
        frame = np.ascontiguousarray(opened.frames[number, ::step, ::step], dtype="<f4")
        return Response(frame.tobytes(), 200, BINARY_HEADERS, "application/octet-stream")


def _parse_number(text: str) -> int | None:
    """A whole number of at most nine ASCII digits, None for other texts."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 9 else None


def _key_of(address: str) -> str:
    return address.removeprefix(f"{FRAMES_ADDRESS}/")
