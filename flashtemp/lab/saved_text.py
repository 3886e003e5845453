"""Whether the text of a page is saved: a word beside its button, the address of the page, a question before leaving."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from nicegui import ui

from flashtemp.errors import BadInput
from flashtemp.lab.page_layout import action, page_address, save_text
from flashtemp.lab.saving import TextVersion
from flashtemp.lab.workspace import escape_control, resolve_inside

SAVED, EDITED, NEW = "saved", "unsaved changes", "not saved yet"


class SavedText:
    """The file of a text on the page `page`; `opened` is the version that was read, None for a new text."""

    STATE_KINDS: Final = {SAVED: "good", EDITED: "warning", NEW: "warning"}

    def __init__(self, folder: Path, page: str, text: str, opened: TextVersion | None):
        self.folder, self.page, self.opened = folder, page, opened
        self.kept_text = text  # leaving the page loses nothing of it: it is saved, or a new text begins with it
        self.asks = False

    def show(self, save: Callable[[], Any]) -> None:
        """Show the button Save and the state beside it."""
        self.state = ui.label().classes("ft-chip").props("aria-live=polite")
        action("Save", save, icon="save")

    def describe_state(self, name: str, text: str) -> str:
        """Whether the text is saved under this name, in a word."""
        if text != self.kept_text:
            return EDITED
        return SAVED if self.opened is not None and self.opened.path == self._find_path(name) else NEW

    def update(self, name: str, text: str) -> None:
        """Show the state; while a change would be lost, the browser asks before it leaves the page."""
        state = self.describe_state(name, text)
        self.state.set_text(state)
        self.state.classes(replace=f"ft-chip {self.STATE_KINDS[state]}")
        if self.asks != (state == EDITED):
            self.asks = state == EDITED
            ui.run_javascript(f"askBeforeLeaving({'true' if self.asks else 'false'})")

    async def save(self, name: str, text: str) -> bool:
        """Save the text, which the address of the page then names; False if the user declines.  Raises BadInput."""
        version = await save_text(self.folder, name, text, self.opened)
        if version is None:
            return False
        self.opened, self.kept_text = version, text
        self.update(name, text)
        await asyncio.sleep(0)  # the script is sent by a task, which must come before one that leads to another page
        ui.navigate.history.replace(page_address(self.page, open=name))
        ui.notify(f"{escape_control(name)} is saved")
        return True

    def _find_path(self, name: str) -> Path | None:
        try:
            return resolve_inside(self.folder, name)
        except BadInput:
            return None
