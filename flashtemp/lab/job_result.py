"""What a job has left: its result folder, the main picture, the main numbers or the verdict, and the next steps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.lab.job_record import LoggedJob
from flashtemp.lab.job_start import file_word
from flashtemp.lab.jobs import WATCH_COMMAND
from flashtemp.lab.live_state import finite_number, number_list
from flashtemp.lab.page_layout import STANDARD_FILES, page_address
from flashtemp.lab.result_card import describe_result, find_main_picture
from flashtemp.lab.result_sentences import grade_comparison
from flashtemp.lab.verdict_data import GRADES
from flashtemp.lab.workspace import RESULT_COMMANDS, find_own_file, free_name, read_json_quietly, resolve_inside

NUMBER_FILES = {"run": "summary.json", "discover": "verdict.json", "compare": "compare.json"}
WITH_RESULT = ("done", "running", "unknown", "failed, exit code 1")  # states; 1: a picture is missing


@dataclass(frozen=True)
class JobResult:
    """The result of a job: `path`, `picture`, `numbers` (name, value), a `sentence` and the next steps.

    The steps are `links` (text, address) and `starts` (text, words of a command).
    """

    path: str
    picture: Path | None = None
    numbers: tuple[tuple[str, str], ...] = ()
    sentence: str = ""
    links: tuple[tuple[str, str], ...] = ()
    starts: tuple[tuple[str, tuple[str, ...]], ...] = ()


def result_name(words: Sequence[str]) -> str:
    """The result folder named in a command line, "" where there is none.

    >>> result_name(["run", "a.toml", "--out=b"]), result_name(["run", "--resume", "b.partial-1"])
    ('b', 'b')
    """
    for k, word in enumerate(words):
        if word.startswith("--out="):
            return word.removeprefix("--out=")
        if word in ("--out", "--resume") and k + 1 < len(words):
            return words[k + 1] if word == "--out" else words[k + 1].rsplit(".partial", 1)[0]
    return ""


def free_result_folder(folder: Path, out: str, jobs: Iterable[LoggedJob]) -> str:
    """A name for a result folder like `out` that neither exists nor will be written by one of the unfinished `jobs`."""
    taken = {Path(result_name(job.words)) for job in jobs if job.is_unfinished}
    path, n = Path(out), 1
    free = path.with_name(free_name(folder / path.parent, path.name))
    while free in taken:
        n += 1
        free = path.with_name(free_name(folder / path.parent, f"{path.name}-{n}"))
    return str(free)


def choose_result_folder(folder: Path, command: str, file: str | Path, jobs: Iterable[LoggedJob]) -> str:
    """The usual result folder of a command, or one like it that is free."""
    return free_result_folder(folder, usual_result_folder(command, file), jobs)


def usual_result_folder(command: str, file: str | Path) -> str:
    """A result folder named after the file of a command, or after its folder, and the command.

    >>> usual_result_folder("compare", "rig/campaign.toml"), usual_result_folder("run", "tyre.toml")
    ('results/rig-compare', 'results/tyre-run')
    """
    path = Path(file)
    name = ((path.parent.name if path.name in STANDARD_FILES else "") or path.stem).lstrip(".")
    return f"results/{name}-{command}"


def find_result(folder: Path, job: LoggedJob) -> JobResult | None:
    """The result of a job, None where it has none; a folder that was there before a job failed is not its result."""
    command = job.words[0]
    if job.state not in WITH_RESULT and (command, job.state) != (
        WATCH_COMMAND,
        "stopped",
    ):  # a watch is usually stopped
        return None
    name = result_name(job.words)
    try:
        path = resolve_inside(folder, name) if name else None
    except BadInput:
        return None
    if path is None or not path.is_dir():
        return None
    here = path.relative_to(folder.resolve())
    picture = find_main_picture(folder, here, command)
    numbers, sentence = _read_numbers(folder, here, command), describe_result(folder, here)
    links, starts = _next_links(folder, here, command), _next_commands(folder, here, job.words)
    return JobResult(str(here), picture, numbers, sentence, links, starts)


def _next_links(folder: Path, here: Path, command: str) -> tuple[tuple[str, str], ...]:
    """Links to the result and to its files."""
    if command == "twin":
        is_made = find_own_file(folder, here / "campaign.toml") is not None
        return (("Open the campaign", page_address("campaign", open=here / "campaign.toml")),) if is_made else ()
    if not any((folder / here / file).exists() for file in RESULT_COMMANDS):
        return ()
    links = [("Open the result", page_address("result", open=here))]
    if command == "run":
        links.append(("Open its case", page_address("case", open=here / "case.toml")))
    return tuple(links)


def _next_commands(folder: Path, here: Path, words: Sequence[str]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """What usually follows a result, as commands that can be started at once."""

    def named(label: str, command: str, file: str) -> tuple[str, tuple[str, ...]]:
        return label, (command, file_word(file), "--out", file_word(choose_result_folder(folder, command, file, ())))

    if words[0] == "twin" and find_own_file(folder, here / "campaign.toml") is not None:
        file = str(here)
        return (named("Compare it", "compare", file), named("Discover the hidden effect", "discover", file))
    if words[0] == "discover" and find_own_file(folder, here / "extended.toml") is not None:
        return (("Run the extended case", tuple(extended_case_words(folder, here, ()))),)
    if words[0] == WATCH_COMMAND and len(words) > 2:
        return (named("Ask what is missing", "discover", words[2]),)
    if words[0] == "compare" and len(words) > 1 and not words[1].startswith("-"):
        data = read_json_quietly(folder, here / "compare.json")
        return (named("Ask what is missing", "discover", words[1]),) if grade_comparison(data) != "good" else ()
    return ()


def extended_case_words(folder: Path, here: Path, jobs: Iterable[LoggedJob]) -> list[str]:
    """The command that runs the extended case of the verdict in the folder `here`."""
    out = free_result_folder(folder, f"results/{here.name.lstrip('.')}-extended", jobs)
    return ["run", file_word(str(here / "extended.toml")), "--out", out]


def _read_numbers(folder: Path, here: Path, command: str) -> tuple[tuple[str, str], ...]:
    """The main numbers of a result; none where the file is missing or damaged."""
    data = read_json_quietly(folder, here / NUMBER_FILES[command]) if command in NUMBER_FILES else {}
    if not data:
        return ()
    if command == "run":
        return _run_numbers(data)
    return _verdict_numbers(data) if command == "discover" else _comparison_numbers(data)


def _run_numbers(data: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """Highest temperature, rises along the block and friction of a run."""
    rises = [finite_number(data.get(f"rise_{place}_K")) for place in ("leading", "middle", "trailing")]
    friction = [v for v in number_list(data.get("friction_per_repetition")) if math.isfinite(v)]
    out = []
    if (hottest := finite_number(data.get("T_max_degC"))) is not None:
        out.append(("highest temperature", f"{hottest:.1f} °C"))
    if all(rise is not None for rise in rises):
        out.append(("rise leading · middle · trailing", " · ".join(f"{rise:.1f}" for rise in rises) + " K"))
    if friction:
        change = f" ({friction[0]:.2f} in the first repetition)" if len(friction) > 1 else ""
        out.append(("friction coefficient", f"{friction[-1]:.2f}{change}"))
    return tuple(out)


def _verdict_numbers(data: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """The misfit before and after a discovery."""
    models = [data.get(name) for name in ("base", "extended")]
    rms = [finite_number(m.get("rmse_K")) if isinstance(m, dict) else None for m in models]
    kind = data.get("verdict")
    out = [("verdict", GRADES[kind][0])] if isinstance(kind, str) and kind in GRADES else []
    if rms[0] is not None and rms[1] is not None:
        out.append(("rms difference, calibrated case → extended model", f"{rms[0]:.3g} → {rms[1]:.3g} K"))
    return tuple(out)


def _comparison_numbers(data: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """The rms difference of every recording, the largest of them."""
    recordings = data.get("recordings")
    rows = [r for r in recordings if isinstance(r, dict)] if isinstance(recordings, list) else []
    rms = [v for r in rows if (v := finite_number(r.get("rmse_K"))) is not None]
    return (("recordings", f"{len(rms)}"), ("largest rms difference", f"{max(rms):.3g} K")) if rms else ()
