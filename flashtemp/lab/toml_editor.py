"""The editor of a TOML text: colours of the chosen scheme, lines with errors marked and explained."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.errors import FlashtempError
from flashtemp.lab.page_layout import add_script, relative_names, script_literal
from flashtemp.lab.style import read_asset
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
    """Load style and script of the editor; for the building of a page, because later scripts do not run."""
    ui.add_css(read_asset("editor.css"))
    add_script("editor.js")


class TomlEditor:
    """The text with its marks; `changed` is called after every change."""

    def __init__(self, text: str, changed: Callable[[], Any], name: str):
        self.marked_lines: dict[int, str] = {}
        with ui.element("div").classes("ft-editor"):
            self.editor = ui.codemirror(
                text, language="TOML", on_change=changed, theme="vscodeLight", line_wrapping=True
            ).classes("w-full")  # fmt: skip
        self.editor.style("height: clamp(20rem, calc(100vh - 24rem), 46rem)")
        prepare = f"prepareEditor({self.editor.id}, {script_literal(name)})"
        ui.timer(0.1, lambda: ui.run_javascript(prepare), once=True)

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
        if lines != self.marked_lines:
            self.marked_lines = lines
            # not as properties of the editor: with these the browser gets the text of the server and loses what was
            # typed since
            ui.run_javascript(f"markLines({self.editor.id}, {script_literal(json.dumps(lines))})")

    def reveal_line(self, line: int) -> None:
        """Scroll to a line."""
        if 1 <= line <= self.text.count("\n") + 1:
            self.editor.reveal_line(line)

    def show_fault(self, fault: TextFault, folder: Path, before: Callable[[], Any] = lambda: None) -> None:
        """Show an error as a button that leads to its line, after a call of `before`; as text where it has no line."""
        text = escape_control(relative_names(str(fault), folder))
        if not fault.line:
            ui.label(text).classes("ft-fault")
            return

        def go_to_line() -> None:
            before()
            self.reveal_line(fault.line)

        with ui.element("button").classes("ft-fault").props("type=button").on("click", go_to_line):
            ui.label(text).classes("inline")
