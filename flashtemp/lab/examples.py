"""The examples of the home page: files that are copied into the folder, and a command that starts from them."""

from __future__ import annotations

import os
import tomllib
from dataclasses import dataclass
from pathlib import Path

from flashtemp.errors import BadInput
from flashtemp.lab.saving import write_text
from flashtemp.lab.style import read_asset
from flashtemp.lab.workspace import free_name, resolve_inside

EXAMPLES_FOLDER = "examples"  # in the folder of the page
DESCRIPTIONS = "examples/examples.toml"  # among the assets


@dataclass(frozen=True)
class Example:
    """One example: its title, what one sees, its `file`, its `command` and, if not a new result folder, its `out`."""

    title: str
    about: str
    file: str
    command: tuple[str, ...]
    out: str = ""

    def command_words(self, folder: Path) -> list[str]:
        """The command line without `flashtemp`, with a folder that is free."""
        place = Path(self.out) if self.out else Path("results") / f"{Path(self.file).stem}-{self.command[0]}"
        return [*self.command, "--out", str(place.parent / free_name(folder / place.parent, place.name))]


def list_examples() -> list[Example]:
    """The examples in the order of their file."""
    rows = tomllib.loads(read_asset(DESCRIPTIONS))["example"]
    return [Example(**{**row, "command": tuple(row["command"])}) for row in rows]


def write_example(example: Example, folder: Path) -> str:
    """Write the file of an example, if it is not there; returns its name in the folder.  Raises BadInput."""
    if os.path.islink(folder / EXAMPLES_FOLDER):
        raise BadInput(f"{EXAMPLES_FOLDER}: is a link; replace it by a folder of that name")
    name = f"{EXAMPLES_FOLDER}/{example.file}"
    if not resolve_inside(folder, name).exists():
        write_text(folder, name, read_asset(name))
    return name
