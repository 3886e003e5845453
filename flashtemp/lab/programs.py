"""Effect files are programs: which of them a case or command would run, and which the user has allowed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.lab.toml_editing import try_parse
from flashtemp.lab.workspace import MAX_TOML_BYTES, resolve_inside
from flashtemp.model.case_file import flatten_tables, list_effect_files

CAMPAIGN_COMMANDS = ("compare", "discover", "plan")
TRUST = "--trust"


class AllowedPrograms:
    """The effect files, with their contents, that the user has allowed to run on this server."""

    def __init__(self) -> None:
        self._allowed: set[tuple[Path, str]] = set()

    def allow(self, files: Iterable[Path]) -> None:
        """Allow these files with their present contents."""
        self._allowed |= {(file, _file_digest(file)) for file in files}

    def unconfirmed_files(self, files: Iterable[Path]) -> list[Path]:
        """The files that are not allowed yet, or that have changed since."""
        return [file for file in files if (file, _file_digest(file)) not in self._allowed]


def has_trust(words: Sequence[str]) -> bool:
    """Whether a command line has the option `--trust`, which runs effect files without consent.

    >>> has_trust(["run", "case.toml", "--trust"]), has_trust(["run", "case.toml", "--trust=true"]), has_trust(["run"])
    (True, True, False)
    """
    return any(word == TRUST or word.startswith(f"{TRUST}=") for word in words)


def programs_of_text(text: str, folder: Path) -> list[Path]:
    """Effect files that a case with this text in `folder` lists; none where it is not TOML."""
    return [_resolve_links(folder / name) for name in list_effect_files(try_parse(text) or {})]


def programs_of_campaign(text: str, folder: Path) -> list[Path]:
    """Effect files that the case of a campaign with this text in `folder`, or a condition of it, lists.

    A condition (`with`) may change every key of the case, its effects too.  Raises BadInput.
    """
    raw = try_parse(text) or {}
    name = raw.get("case", "case.toml")
    if not isinstance(name, str):
        return []
    case = folder / name
    home = case if case.is_dir() else case.parent
    entries = [entry for kind in ("recording", "force") for entry in _only_tables(raw.get(kind))]
    changed = [
        _resolve_links(home / file) for e in entries for w in _only_tables([e.get("with")]) for file in _listed_files(w)
    ]
    return list(dict.fromkeys([*programs_of_case(case), *changed]))


def _only_tables(value: Any) -> list[dict[str, Any]]:
    """The tables in a list; [] for any other value."""
    return [table for table in value if isinstance(table, dict)] if isinstance(value, list) else []


def _listed_files(conditions: dict[str, Any]) -> list[str]:
    """Effect files among the conditions of one recording or load-cell trace."""
    return list_effect_files(flatten_tables(conditions))


def programs_of_case(case: Path) -> list[Path]:
    """Effect files that a case, a folder with a case.toml or a .toml file, lists.  Raises BadInput."""
    file = case / "case.toml" if case.is_dir() else case
    return programs_of_text(read_toml_text(file), file.parent)


def programs_of_command(words: Sequence[str], folder: Path) -> list[Path]:
    """Effect files that `flashtemp words...` would run in `folder`.  Raises BadInput for a file outside of it."""
    if "--resume" in words:
        return programs_of_case(resolve_inside(folder, words[words.index("--resume") + 1]))
    if words and words[0] == "watch":  # its first word is the folder of the camera files
        words = [CAMPAIGN_COMMANDS[0], *words[2:]]
    if len(words) < 2:
        return []
    path = resolve_inside(folder, words[1])
    if words[0] in CAMPAIGN_COMMANDS:
        file = path / "campaign.toml" if path.is_dir() else path
        return programs_of_campaign(read_toml_text(file), file.parent)
    home = path if path.is_dir() else path.parent
    changed = [_resolve_links(home / name) for word in words[2:] for name in _python_files(word)]
    return list(dict.fromkeys([*programs_of_case(path), *changed]))


def _python_files(word: str) -> list[str]:
    """Names of Python files in a typed override: effects=["./fan.py"], or effects=./a.py,./b.py in a sweep.

    >>> _python_files('effects=["a", "./fan.py"]'), _python_files("friction.mu=0.8")
    (['./fan.py'], [])
    """
    _, _, value = word.partition("=")
    return [name for name in re.split(r"""[\[\]"',;]+""", value) if name.strip().endswith(".py")]


def _resolve_links(file: Path) -> Path:
    """A path with its links followed; unchanged where it is not a valid path."""
    try:
        return file.resolve()
    except (OSError, ValueError, RuntimeError):
        return file


def read_toml_text(file: Path) -> str:
    """The text of a TOML file, "" where no command could read it.  Raises BadInput for a large file."""
    try:
        if not file.is_file():
            return ""
        if file.stat().st_size > MAX_TOML_BYTES:
            raise BadInput(f"{file}: larger than {MAX_TOML_BYTES // 2**20} MiB; start that from the command line")
        return file.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""


def _file_digest(file: Path) -> str:
    """SHA-256 of a file's content, "" where it cannot be read."""
    try:
        return sha256(file.read_bytes()).hexdigest()
    except (OSError, ValueError):
        return ""
