"""The start of a command from a page: checks of its words, and consent where effect files would run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from flashtemp.errors import BadInput
from flashtemp.lab.campaign_checks import find_outside_files
from flashtemp.lab.jobs import LOG_FOLDER, WATCH_COMMAND, JobList
from flashtemp.lab.page_layout import STANDARD_FILES, ask_to_run
from flashtemp.lab.programs import CAMPAIGN_COMMANDS, AllowedPrograms, has_trust, programs_of_command, read_toml_text
from flashtemp.lab.toml_editing import try_parse
from flashtemp.lab.workspace import resolve_inside


async def start_job(folder: Path, jobs: JobList, allowed: AllowedPrograms, words: list[str]) -> bool:
    """Start a command, after consent where effect files would run; whether it was started.  Raises BadInput."""
    if not words:
        return False
    check_job_words(folder, words)
    if not await ask_to_run(programs_of_command(words, folder), allowed, has_trust(words)):
        return False
    for name in ("results", LOG_FOLDER):  # folders chosen by the page, not by the user
        if os.path.islink(folder / name):
            raise BadInput(f"{name}: is a link; replace it by a folder of that name")
    (folder / "results").mkdir(exist_ok=True)
    jobs.start(words)
    return True


def check_job_words(folder: Path, words: Sequence[str]) -> None:
    """Check that a command and its campaign name files inside the folder only.  Raises BadInput."""
    n_files = 2 if words[:1] == [WATCH_COMMAND] else 1  # a watch names its folder of camera files first
    files = [words[2]] if words[1:2] == ["--resume"] and len(words) > 2 else list(words[1 : 1 + n_files])
    for k, word in enumerate(words):
        if word.startswith("--out=") or word.startswith("--resume="):
            files.append(word.partition("=")[2])
        elif word == "--out" and k + 1 < len(words):
            files.append(words[k + 1])
        elif word == "--log" or word.startswith("--log="):
            raise BadInput("--log: the page keeps the log of every command itself; leave it out")
    paths = [resolve_inside(folder, file) for file in files]
    if words[:1] and words[0] in (*CAMPAIGN_COMMANDS, WATCH_COMMAND) and len(paths) >= n_files:
        _check_campaign_files(folder, paths[n_files - 1])


def _check_campaign_files(folder: Path, campaign: Path) -> None:
    """Check that the files that a campaign names lie inside the folder.  Raises BadInput."""
    path = campaign / "campaign.toml" if campaign.is_dir() else campaign
    if outside := find_outside_files(try_parse(read_toml_text(path)) or {}, path, folder):
        raise BadInput(*(f"{path}: {fault.text}" for fault in outside))


def file_word(name: str) -> str:
    """A file name as a command-line argument that cannot be mistaken for an option.

    >>> file_word("--trust"), file_word("case.toml"), file_word("")
    ('./--trust', 'case.toml', '')
    """
    return f"./{name}" if name.startswith("-") else name


def short_file_name(file: str | Path) -> str:
    """The name of a file in a command: a folder stands for its case.toml or campaign.toml.

    >>> [short_file_name(name) for name in ("lab/campaign.toml", "campaign.toml", "a/b.toml", "")]
    ['lab', 'campaign.toml', 'a/b.toml', '']
    """
    path = Path(file)
    if not str(file):
        return ""
    return str(path.parent if path.name in STANDARD_FILES and path.parent != Path() else path)
