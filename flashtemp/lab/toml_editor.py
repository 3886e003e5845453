"""The editor of a TOML text: colours of the chosen scheme, lines with errors marked and explained."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.errors import FlashtempError
from flashtemp.lab.page_layout import add_script, script_literal
from flashtemp.lab.workspace import escape_control


@dataclass(frozen=True)
class TextFault:
    """An error of a text: its 1-based `line` (0: none), the dotted `key` ("" for none), and what is wrong."""

    line: int
    key: str
    text: str

    def __str__(self) -> str:
        where = f"line {self.line}: " if self.line else ""
        return f"{where}{self.key}: {self.text}" if self.key else f"{where}{self.text}"


def read_faults(fault: FlashtempError | OSError, file: Path) -> list[TextFault]:
    """The errors of a text that stands for `file`, from an exception of the check.

    >>> from flashtemp.errors import BadInput
    >>> read_faults(BadInput("/a/case.toml:5: block.length: 'far'; give a number (m)"), Path("/a/case.toml"))
    [TextFault(line=5, key='block.length', text="'far'; give a number (m)")]
    """
    out = []
    for line in str(fault).splitlines() or [""]:
        rest = line.removeprefix(str(file))
        located = re.fullmatch(r"(?::(\d+))?: ([\w.\"'-]+): (.*)", rest) if rest != line else None
        if located:
            out.append(TextFault(int(located[1] or 0), located[2], located[3]))
            continue
        syntax = re.search(r"at line (\d+)", rest) if rest != line else None
        out.append(TextFault(int(syntax[1]) if syntax else 0, "", rest.lstrip(": ") if rest != line else line))
    return out


def prepare_editor() -> None:
    """Load the script of the editor; for the building of a page, because it has no effect on one that is shown."""
    add_script("editor.js")


class TomlEditor:
    """The text with its marks; `changed` is called after every change."""

    def __init__(self, text: str, changed: Callable[[], Any], name: str):
        self.box = ui.element("div").classes("ft-editor")
        with self.box:
            self.editor = ui.codemirror(
                text, language="TOML", on_change=changed, theme="vscodeLight", line_wrapping=True
            ).classes("w-full")  # fmt: skip
        self.editor.style("height: clamp(20rem, calc(100vh - 24rem), 46rem)")
        self.box.on("scheme", lambda e: self._set_scheme(e.args is True), js_handler="e => emit(e.detail)")
        ui.timer(
            0.1,
            lambda: ui.run_javascript(f"watchScheme({self.box.id}); nameEditor({self.box.id}, {script_literal(name)})"),
            once=True,
        )

    @property
    def text(self) -> str:
        """The text."""
        return self.editor.value or ""

    def set_text(self, text: str) -> None:
        """Replace the text."""
        if text != self.text:
            self.editor.value = text

    def mark_faults(self, faults: Iterable[TextFault]) -> None:
        """Mark the lines of errors; the error is shown under the pointer."""
        n_lines = self.text.count("\n") + 1
        lines: dict[int, str] = {}
        for fault in faults:
            if 1 <= fault.line <= n_lines:
                more = escape_control(f"{fault.key}: {fault.text}" if fault.key else fault.text)
                lines[fault.line] = f"{lines[fault.line]}; {more}" if fault.line in lines else more
        marks = [{"kind": "line", "line": k, "class": "ft-fault-line"} for k in sorted(lines)]
        if marks or self.editor.decorations:
            self.editor.decorations, self.editor.line_tooltips = marks, lines

    def reveal_line(self, line: int) -> None:
        """Scroll to a line."""
        if 1 <= line <= self.text.count("\n") + 1:
            self.editor.reveal_line(line)

    def _set_scheme(self, is_dark: bool) -> None:
        self.editor.theme = "vscodeDark" if is_dark else "vscodeLight"
