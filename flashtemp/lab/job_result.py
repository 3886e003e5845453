"""What a job has left: its result folder, the main picture, the main numbers or the verdict, and the next steps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.lab.job_record import LoggedJob
from flashtemp.lab.live_state import finite_number, number_list
from flashtemp.lab.page_layout import page_address
from flashtemp.lab.result_card import find_main_picture
from flashtemp.lab.workspace import RESULT_COMMANDS, find_own_file, free_name, read_brief_json, resolve_inside

NUMBER_FILES = {"run": "summary.json", "discover": "verdict.json", "compare": "compare.json", "watch": "watch.json"}
WITH_RESULT = ("done", "running", "unknown", "failed, exit code 1")  # states; 1: a picture is missing


@dataclass(frozen=True)
class JobResult:
    """The result of a job: `path`, `picture`, `numbers` (name, value), a `sentence` and `links` (text, address)."""

    path: str
    picture: Path | None = None
    numbers: tuple[tuple[str, str], ...] = ()
    sentence: str = ""
    links: tuple[tuple[str, str], ...] = ()


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


def find_result(folder: Path, job: LoggedJob) -> JobResult | None:
    """The result of a job, None where it has none; a folder that was there before a job failed is not its result."""
    command = job.words[0]
    if job.state not in WITH_RESULT and (command, job.state) != ("watch", "stopped"):  # a watch is usually stopped
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
    numbers, sentence = _read_numbers(folder, here, command)
    links = _next_links(folder, here, command)
    if command == "watch" and len(job.words) > 2:
        links = (("Discover what is missing", page_address("runs", command="discover", of=job.words[2])),)
    return JobResult(str(here), picture, numbers, sentence, links)


def _next_links(folder: Path, here: Path, command: str) -> tuple[tuple[str, str], ...]:
    """Links to the result and to what usually follows it."""
    if command == "twin":
        is_made = find_own_file(folder, here / "campaign.toml") is not None
        links = [
            ("Open the campaign", page_address("campaign", open=here / "campaign.toml")),
            ("Compare it", page_address("runs", command="compare", of=here)),
            ("Discover the hidden effect", page_address("runs", command="discover", of=here)),
        ]
        return tuple(links) if is_made else ()
    if not any((folder / here / file).exists() for file in RESULT_COMMANDS):
        return ()
    links = [("Open the result", page_address("result", open=here))]
    if command == "discover" and find_own_file(folder, here / "extended.toml") is not None:
        links.append(("Run the extended case", page_address("runs", command="run", of=here / "extended.toml")))
    if command == "run":
        links.append(("Open its case", page_address("case", open=here / "case.toml")))
    return tuple(links)


def _read_numbers(folder: Path, here: Path, command: str) -> tuple[tuple[tuple[str, str], ...], str]:
    """The main numbers of a result and its sentence; none where the file is missing or damaged."""
    data = read_brief_json(folder, here / NUMBER_FILES[command]) if command in NUMBER_FILES else {}
    if not data:
        return (), ""
    if command == "run":
        return _run_numbers(data), ""
    if command == "watch":
        says = data.get("says")
        return (), says[:1].upper() + says[1:] if isinstance(says, str) else ""
    if command == "discover":
        says = data.get("says")
        first = says[0] if isinstance(says, list) and says and isinstance(says[0], str) else ""
        return _verdict_numbers(data), first
    return _comparison_numbers(data), ""


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
    out = [("verdict", kind.replace("_", " "))] if isinstance(kind, str) else []
    if rms[0] is not None and rms[1] is not None:
        out.append(("rms difference, stated → extended model", f"{rms[0]:.3g} → {rms[1]:.3g} K"))
    return tuple(out)


def _comparison_numbers(data: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """The rms difference of every recording, the largest of them."""
    recordings = data.get("recordings")
    rows = [r for r in recordings if isinstance(r, dict)] if isinstance(recordings, list) else []
    rms = [v for r in rows if (v := finite_number(r.get("rmse_K"))) is not None]
    return (("recordings", f"{len(rms)}"), ("largest rms difference", f"{max(rms):.3g} K")) if rms else ()
