"""Result folders: whole or absent, made under names that nobody else uses; only what a run itself made is removed."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import stat
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from flashtemp.errors import BadInput, IncompleteResult, UserInterrupt
from flashtemp.runs.results.processes import STOP_SIGNALS, lock_path, sync_to_disk
from flashtemp.display import PARTIAL_FILE_NAME

MARKER_FILE = ".flashtemp.json"  # in a working folder: whose it is; held locked while it is being written
MAX_MARKER_BYTES, MAX_MARKER_NAME_LETTERS = 2**16, 256


@dataclass(frozen=True)
class OwnerMarker:
    """What a marker says: the name of the result, the command that writes it, and how an interrupted one goes on.

    A folder can be gone on with, by `resume`, once it holds the file `needs`.
    """

    out: str
    command: str
    needs: str = ""
    resume: str = ""
    overwrite: bool = False
    process: str = ""


def find_free_name(out: Path, go_on: bool = False) -> Path:
    """The folder itself, or the first of name-2, name-3... that does not exist yet; begun ones only to `go_on`."""
    return _first_unused(out, lambda path: os.path.lexists(path) or (not go_on and bool(list_working_folders(path))))


def _first_unused(path: Path, used: Callable[[Path], bool] = os.path.lexists) -> Path:
    n, free = 1, path
    while used(free):
        n += 1
        free = path.with_name(f"{path.name}-{n}")
    return free


def list_working_folders(out: Path) -> list[Path]:
    """What lies beside `out` under the names of working folders, whoever made it: name.partial, name.partial-2..."""
    name = re.compile(re.escape(out.name) + r"\.partial(-[0-9]+)?")
    with suppress(OSError):
        return sorted(path for path in out.parent.iterdir() if name.fullmatch(path.name))
    return []


def read_marker(folder: Path) -> OwnerMarker | None:
    """Whose working folder that is; None where no run of flashtemp made it, whatever its marker holds."""
    marker = folder / MARKER_FILE
    if folder.is_symlink() or not folder.is_dir():
        return None
    try:
        state = marker.lstat()  # a pipe would be waited for, a device has no end
        if not stat.S_ISREG(state.st_mode) or state.st_size > MAX_MARKER_BYTES:
            return None
        found = OwnerMarker(**json.loads(marker.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return found if _is_valid_marker(found) else None


def _is_valid_marker(marker: OwnerMarker) -> bool:
    """Whether a marker's values are of their kinds, a command is a word, and its file one of the folder itself."""
    texts = (marker.out, marker.command, marker.needs, marker.resume, marker.process)
    if not all(isinstance(text, str) for text in texts) or not isinstance(marker.overwrite, bool):
        return False
    is_plain = (
        marker.needs.isprintable() and len(marker.needs) < MAX_MARKER_NAME_LETTERS and Path(marker.needs).name == marker.needs
    )
    return bool(re.fullmatch("[a-z]+", marker.command)) and is_plain


def list_resumable_folders(out: Path, command: str) -> list[Path]:
    """Working folders of a command for `out` that can be gone on with."""
    mine = [(path, read_marker(path)) for path in list_working_folders(out)]
    return [p for p, o in mine if o and (o.out, o.command) == (out.name, command) and (p / o.needs).is_file()]


@contextmanager
def reserve_folder(
    out: Path, marker: OwnerMarker, go_on: Callable[[Path], bool] = lambda path: False, overwrite: bool = False
) -> Iterator[Path]:
    """A working folder beside `out` that no other run writes: a new one, or what an interrupted run left.

    `go_on(folder)` says whether that is what is wanted; with `overwrite` it is emptied.  Raises BadInput where `out`
    exists, is being written, or an interrupted run of something else waits for it.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with _serialise_access(out.parent):
            if os.path.lexists(out) and not overwrite:
                raise BadInput(f"--out: {out} exists; choose another folder")
            work, lock = _reuse_folder(out, go_on, overwrite) or _create_folder(out, marker)
    except OSError as fault:
        raise BadInput(f"--out: {out}: {fault.strerror}; choose a folder that can be written") from fault
    try:
        yield work
    finally:
        os.close(lock)


def _reuse_folder(out: Path, go_on: Callable[[Path], bool], overwrite: bool) -> tuple[Path, int] | None:
    """What an interrupted run left for `out`, locked; None where a new folder is to be made."""
    for path in list_working_folders(out):
        told = read_marker(path)
        if told is None or told.out != out.name:
            continue
        lock = lock_folder(path)
        if (path / told.needs).is_file() if told.needs else False:
            if go_on(path):
                return path, lock
            if overwrite:
                _clear_folder(path)
                return path, lock
            os.close(lock)
            again = f"flashtemp run --resume {out}" if told.command == "run" else "the same command"
            hint = f"go on with '{again}', choose another folder or remove it"
            raise BadInput(f"--out: {path} holds an interrupted {told.command}; {hint}")
        os.close(lock)  # killed before there was anything to go on with
    return None


def _create_folder(out: Path, marker: OwnerMarker) -> tuple[Path, int]:
    work = _first_unused(out.with_name(f"{out.name}.partial"))
    work.mkdir()
    told = asdict(marker) | {"out": out.name, "process": f"{os.getpid()} on {socket.gethostname()}"}
    (work / MARKER_FILE).write_text(json.dumps(told) + "\n", encoding="utf-8")
    return work, lock_folder(work)


def lock_folder(work: Path) -> int:
    """Lock a working folder; close the number to let it go.

    Raises BadInput where another run holds it, and where it holds what no run makes (`refuse_links`).
    """
    refuse_links(work)
    marker = work / MARKER_FILE
    marker.touch()
    try:
        return lock_path(marker)
    except BlockingIOError as fault:
        raise BadInput(f"--out: another run is writing {work}; wait for it or choose another folder") from fault


def refuse_links(work: Path) -> None:
    """BadInput where a working folder, or something in it, is a link, a pipe or a device.

    A run makes none, and what it writes would go through them into files elsewhere.
    """
    inside = (Path(at) / name for at, folders, files in os.walk(work) for name in (*folders, *files))
    for path in (work, *inside):
        mode = path.lstat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise BadInput(f"{path}: a link, a pipe or a device, which no run makes; remove it or start anew")


@contextmanager
def _serialise_access(folder: Path) -> Iterator[None]:
    """One run at a time makes or places folders here."""
    lock = lock_path(folder, wait=True)
    try:
        yield
    finally:
        os.close(lock)


def _clear_folder(work: Path) -> None:
    """Remove what an interrupted run left, but not the marker."""
    for path in work.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.name != MARKER_FILE:
            path.unlink()


def publish_folder(work: Path, out: Path, overwrite: bool = False, drop: tuple[str, ...] = ()) -> Path:
    """Give a whole folder its name, on disk before anything goes; returns where it lies.

    An earlier result is replaced with `overwrite` alone; otherwise, where somebody made `out` meanwhile, the name is
    the first free one.  Files `drop` are removed once the folder has its name: killed before, it can be gone on with.
    """
    for path in work.rglob(".*"):  # of a process that was killed while it wrote
        if PARTIAL_FILE_NAME.fullmatch(path.name) and path.is_file() and not path.is_symlink():
            path.unlink()
    sync_tree(work)
    with _serialise_access(out.parent):
        old = None
        if os.path.lexists(out):
            if overwrite:
                old = _first_unused(out.with_name(out.name + ".replaced"))
                out.rename(old)
            else:
                out = _first_unused(out)
        try:
            work.rename(out)
        except BaseException:
            if old is not None:
                old.rename(out)
            raise
    for name in (*drop, MARKER_FILE):
        (out / name).unlink(missing_ok=True)
    sync_to_disk(out.parent)
    if old is not None:
        shutil.rmtree(old, ignore_errors=True)
    return out


def sync_tree(folder: Path) -> None:
    """Everything in a folder on disk, so that it outlasts a power cut."""
    for path in (*folder.rglob("*"), folder):
        if not path.is_symlink() and (path.is_file() or path.is_dir()):
            sync_to_disk(path)


@contextmanager
def atomic_folder(out: Path, command: str = "result") -> Iterator[Path]:
    """A new folder to write into, `out` at the end; a failure but Incomplete and Interrupted leaves nothing.

    Raises BadInput.
    """
    with reserve_folder(out, OwnerMarker(out.name, command)) as work:
        try:
            yield work
        except (IncompleteResult, UserInterrupt):  # what matters is there
            publish_folder(work, out)
            raise
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise
        check_published_name(out, publish_folder(work, out), None)


def check_published_name(out: Path, published: Path, result: object) -> None:
    """Incomplete where a result had to take another name."""
    if published != out:
        raise IncompleteResult(f"{out} was made by somebody else meanwhile; the result is whole in {published}", result)


def optional_folder(out: Path | str | None) -> AbstractContextManager[Path | None]:
    """A new folder as `atomic_folder` makes it, or None where nothing is to be written.  Raises BadInput."""
    return nullcontext() if out is None else atomic_folder(Path(out))


@contextmanager
def stop_on_signal() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set, so that work ends where it leaves something whole."""
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopped
        return
    old = {s: signal.signal(s, lambda *_: stopped.set()) for s in STOP_SIGNALS}
    try:
        yield stopped
    finally:
        for s, handler in old.items():
            signal.signal(s, handler)
