"""Result folders: complete or absent, written under a temporary name and locked; foreign files are never removed."""

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

from flashtemp.display import PARTIAL_FILE_NAME
from flashtemp.errors import BadInput, IncompleteResult, UserInterrupt
from flashtemp.runs.results.processes import STOP_SIGNALS, lock_path, sync_to_disk

MARKER_FILE = ".flashtemp.json"  # describes and locks a working folder while it is being written
MAX_MARKER_BYTES, MAX_MARKER_NAME_LETTERS = 2**16, 256


@dataclass(frozen=True)
class OwnerMarker:
    """Contents of the marker of a working folder: result name, command, and how to continue an interrupted one.

    The folder can be continued with the command `resume` once it contains the file `needs`.
    """

    out: str
    command: str
    needs: str = ""
    resume: str = ""
    overwrite: bool = False
    process: str = ""


def find_free_name(out: Path, resumable: bool = False) -> Path:
    """The folder `out`, or the first of name-2, name-3... that does not exist.

    A name with an interrupted working folder counts as free only if `resumable`.
    """
    return _first_unused(
        out, lambda path: os.path.lexists(path) or (not resumable and bool(list_working_folders(path)))
    )


def _first_unused(path: Path, used: Callable[[Path], bool] = os.path.lexists) -> Path:
    n, free = 1, path
    while used(free):
        n += 1
        free = path.with_name(f"{path.name}-{n}")
    return free


def list_working_folders(out: Path) -> list[Path]:
    """Paths next to `out` with names of working folders (name.partial, name.partial-2...), whoever made them."""
    name = re.compile(re.escape(out.name) + r"\.partial(-[0-9]+)?")
    with suppress(OSError):
        return sorted(path for path in out.parent.iterdir() if name.fullmatch(path.name))
    return []


def read_marker(folder: Path) -> OwnerMarker | None:
    """The marker of a working folder; None for a folder without a valid marker of flashtemp."""
    marker = folder / MARKER_FILE
    if folder.is_symlink() or not folder.is_dir():
        return None
    try:
        state = marker.lstat()  # reading a pipe would block, a device may never end
        if not stat.S_ISREG(state.st_mode) or state.st_size > MAX_MARKER_BYTES:
            return None
        owner = OwnerMarker(**json.loads(marker.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return owner if _is_valid_marker(owner) else None


def _is_valid_marker(marker: OwnerMarker) -> bool:
    """Whether the fields of a marker have the right types, a plain command word and a plain file name."""
    texts = (marker.out, marker.command, marker.needs, marker.resume, marker.process)
    if not all(isinstance(text, str) for text in texts) or not isinstance(marker.overwrite, bool):
        return False
    is_plain = (
        marker.needs.isprintable()
        and len(marker.needs) < MAX_MARKER_NAME_LETTERS
        and Path(marker.needs).name == marker.needs
    )
    return bool(re.fullmatch("[a-z]+", marker.command)) and is_plain


def list_resumable_folders(out: Path, command: str) -> list[Path]:
    """Working folders of a command for `out` that can be continued."""
    owned = [(path, read_marker(path)) for path in list_working_folders(out)]
    return [p for p, o in owned if o and (o.out, o.command) == (out.name, command) and (p / o.needs).is_file()]


@contextmanager
def reserve_folder(
    out: Path, marker: OwnerMarker, is_resumable: Callable[[Path], bool] = lambda path: False, overwrite: bool = False
) -> Iterator[Path]:
    """Yield a locked working folder next to `out`: a new one, or that of an interrupted run.

    `is_resumable(folder)` tells whether an interrupted run is to be continued; with `overwrite` it is emptied.
    Raises BadInput where `out` exists, is being written, or belongs to another interrupted run.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with _serialise_access(out.parent):
            if os.path.lexists(out) and not overwrite:
                raise BadInput(f"--out: {out} exists; choose another folder")
            work, lock = _reuse_folder(out, is_resumable, overwrite) or _create_folder(out, marker)
    except OSError as fault:
        raise BadInput(f"--out: {out}: {fault.strerror}; choose a writable folder") from fault
    try:
        yield work
    finally:
        os.close(lock)


def _reuse_folder(out: Path, is_resumable: Callable[[Path], bool], overwrite: bool) -> tuple[Path, int] | None:
    """The working folder of an interrupted run of `out` and its lock; None where a new folder is needed."""
    for path in list_working_folders(out):
        owner = read_marker(path)
        if owner is None or owner.out != out.name:
            continue
        lock = lock_folder(path)
        if (path / owner.needs).is_file() if owner.needs else False:
            if is_resumable(path):
                return path, lock
            if overwrite:
                _clear_folder(path)
                return path, lock
            os.close(lock)
            again = f"flashtemp run --resume {out}" if owner.command == "run" else "the same command"
            hint = f"continue with '{again}', choose another folder or remove it"
            raise BadInput(f"--out: {path} holds an interrupted {owner.command}; {hint}")
        os.close(lock)  # killed before its first checkpoint: nothing to continue
    return None


def _create_folder(out: Path, marker: OwnerMarker) -> tuple[Path, int]:
    work = _first_unused(out.with_name(f"{out.name}.partial"))
    work.mkdir()
    contents = asdict(marker) | {"out": out.name, "process": f"{os.getpid()} on {socket.gethostname()}"}
    (work / MARKER_FILE).write_text(json.dumps(contents) + "\n", encoding="utf-8")
    return work, lock_folder(work)


def lock_folder(work: Path) -> int:
    """Lock a working folder; returns a file descriptor, and closing it releases the lock.

    Raises BadInput where another run has locked it, and where it contains links or devices (`refuse_links`).
    """
    refuse_links(work)
    marker = work / MARKER_FILE
    marker.touch()
    try:
        return lock_path(marker)
    except BlockingIOError as fault:
        raise BadInput(f"--out: another run is writing {work}; wait for it or choose another folder") from fault


def refuse_links(work: Path) -> None:
    """Raise BadInput where a working folder, or something in it, is a link, a pipe or a device.

    A run creates none, and its output would be written through them to files elsewhere.
    """
    inside = (Path(at) / name for at, folders, files in os.walk(work) for name in (*folders, *files))
    for path in (work, *inside):
        mode = path.lstat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise BadInput(f"{path}: a link, a pipe or a device, which no run creates; remove it or start again")


@contextmanager
def _serialise_access(folder: Path) -> Iterator[None]:
    """Within this context no other run creates or renames folders in `folder`."""
    lock = lock_path(folder, wait=True)
    try:
        yield
    finally:
        os.close(lock)


def _clear_folder(work: Path) -> None:
    """Remove the contents of an interrupted run, but not the marker."""
    for path in work.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.name != MARKER_FILE:
            path.unlink()


def publish_folder(work: Path, out: Path, overwrite: bool = False, drop: tuple[str, ...] = ()) -> Path:
    """Sync a complete folder to disk and rename it to `out`; returns its final path.

    An earlier result is replaced only with `overwrite`; if `out` was created meanwhile, the first free name is used.
    The files `drop` are removed after the renaming, so that a process killed before can be continued.
    """
    for path in work.rglob(".*"):  # temporary files of a process that was killed while writing
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
    """Sync everything in a folder to disk, so that it survives a power cut."""
    for path in (*folder.rglob("*"), folder):
        if not path.is_symlink() and (path.is_file() or path.is_dir()):
            sync_to_disk(path)


@contextmanager
def atomic_folder(out: Path, command: str = "result") -> Iterator[Path]:
    """Yield a new folder to write into, renamed to `out` at the end.

    A failure leaves nothing, except IncompleteResult and UserInterrupt, after which the folder is kept.
    Raises BadInput.
    """
    with reserve_folder(out, OwnerMarker(out.name, command)) as work:
        try:
            yield work
        except (IncompleteResult, UserInterrupt):  # the numbers are complete
            publish_folder(work, out)
            raise
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise
        check_published_name(out, publish_folder(work, out), None)


def check_published_name(out: Path, published: Path, result: object) -> None:
    """Raise IncompleteResult where a result had to be saved under another name."""
    if published != out:
        raise IncompleteResult(
            f"{out} was created by another program meanwhile; the complete result is in {published}", result
        )


def optional_folder(out: Path | str | None) -> AbstractContextManager[Path | None]:
    """The context of `atomic_folder`, or one that yields None where nothing is to be written.  Raises BadInput."""
    return nullcontext() if out is None else atomic_folder(Path(out))


@contextmanager
def stop_on_signal() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C and SIGTERM set, so that the work can stop at a consistent state."""
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
