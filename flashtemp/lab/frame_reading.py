"""Reading of camera files outside the event loop, with its progress and a button that cancels it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import run, ui

from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.display import format_count
from flashtemp.lab.frame_server import FrameServer
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.page_layout import action, refuse_damaged
from flashtemp.lab.workspace import escape_control

UPDATE_INTERVAL_S = 0.3  # between two updates of the progress


class ReadingCancelled(Exception):
    """The user has cancelled the reading, or has left the page."""


class FrameReading:
    """One reading of camera files; `on_cancel` is called when the user cancels it.

    The thread that reads ends with the next frames: what it has read is dropped then, a temporary file included.
    """

    def __init__(self, server: FrameServer, files: list[Path], facts: ImportOptions, on_cancel: Callable[[], Any]):
        self.server, self.files, self.facts, self.on_cancel = server, files, facts, on_cancel
        self.n_frames, self.share = 0, 0.0
        self.is_cancelled = False

    async def read(self) -> OpenedFrames | None:
        """The frames; None where the reading was cancelled.  Raises BadInput."""
        ui.context.client.on_delete(self._stop)
        waiting = self._show_progress()
        try:
            return await run.io_bound(self._read_files)
        except ReadingCancelled:
            return None
        finally:
            if not waiting.is_deleted:
                waiting.delete()

    def _read_files(self) -> OpenedFrames:
        with refuse_damaged(self.files[0], ReadingCancelled):
            return self.server.read(self.files, self.facts, self._count, self._set_share)

    def _count(self, number: int) -> None:
        """Count frames that have been read; runs in the thread that reads, which a cancelled reading leaves here."""
        self.n_frames += number
        if self.is_cancelled:
            raise ReadingCancelled

    def _set_share(self, share: float) -> None:
        self.share = share

    def _stop(self) -> None:
        self.is_cancelled = True

    def _cancel(self) -> None:
        self._stop()
        self.on_cancel()

    def _show_progress(self) -> Any:
        """Number of frames, part of the files, and a button that cancels."""
        size = sum(file.stat().st_size for file in self.files if file.is_file()) / 1e6
        what = escape_control(self.files[0].name) if len(self.files) == 1 else format_count(len(self.files), "file")
        with ui.element("section").classes("ft-card").props('aria-label="reading"') as waiting:
            words = ui.label(f"Reading {what}, {size:.3g} MB ...").props("role=status")
            bar = ui.linear_progress(0.0, show_value=False, size="8px").props('rounded aria-label="part of the files"')
            action("Cancel", self._cancel, icon="close").classes("self-start")

            def update() -> None:
                words.set_text(f"Reading {what}, {size:.3g} MB: {format_count(self.n_frames, 'frame')} so far")
                bar.set_value(self.share)

            ui.timer(UPDATE_INTERVAL_S, update)
        return waiting
