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

from flashtemp.errors import BadInput, Incomplete, Interrupted
from flashtemp.runs.processes import ENDS, locked, synced
from flashtemp.showing import UNFINISHED

MARKER = ".flashtemp.json"  # in a working folder: whose it is; held locked while it is being written
MAX_MARKER_BYTES, MAX_NAME_LETTERS = 2**16, 256


@dataclass(frozen=True)
class Owner:
    """What a marker says: the name of the result, the command that writes it, and how an interrupted one goes on.

    A folder can be gone on with, by `resume`, once it holds the file `needs`.
    """

    out: str
    command: str
    needs: str = ""
    resume: str = ""
    overwrite: bool = False
    process: str = ""


def free_name(out: Path, go_on: bool = False) -> Path:
    """The folder itself, or the first of name-2, name-3... that does not exist yet; begun ones only to `go_on`."""
    return _unused(out, lambda path: os.path.lexists(path) or (not go_on and bool(partials(path))))


def _unused(path: Path, used: Callable[[Path], bool] = os.path.lexists) -> Path:
    n, free = 1, path
    while used(free):
        n += 1
        free = path.with_name(f"{path.name}-{n}")
    return free


def partials(out: Path) -> list[Path]:
    """What lies beside `out` under the names of working folders, whoever made it: name.partial, name.partial-2..."""
    name = re.compile(re.escape(out.name) + r"\.partial(-[0-9]+)?")
    with suppress(OSError):
        return sorted(path for path in out.parent.iterdir() if name.fullmatch(path.name))
    return []


def owner(folder: Path) -> Owner | None:
    """Whose working folder that is; None where no run of flashtemp made it, whatever its marker holds."""
    marker = folder / MARKER
    if folder.is_symlink() or not folder.is_dir():
        return None
    try:
        state = marker.lstat()  # a pipe would be waited for, a device has no end
        if not stat.S_ISREG(state.st_mode) or state.st_size > MAX_MARKER_BYTES:
            return None
        found = Owner(**json.loads(marker.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return found if _is_sound(found) else None


def _is_sound(found: Owner) -> bool:
    """Whether a marker's values are of their kinds, a command is a word, and its file one of the folder itself."""
    texts = (found.out, found.command, found.needs, found.resume, found.process)
    if not all(isinstance(text, str) for text in texts) or not isinstance(found.overwrite, bool):
        return False
    is_plain = (
        found.needs.isprintable() and len(found.needs) < MAX_NAME_LETTERS and Path(found.needs).name == found.needs
    )
    return bool(re.fullmatch("[a-z]+", found.command)) and is_plain


def left_behind(out: Path, command: str) -> list[Path]:
    """Working folders of a command for `out` that can be gone on with."""
    mine = [(path, owner(path)) for path in partials(out)]
    return [p for p, o in mine if o and (o.out, o.command) == (out.name, command) and (p / o.needs).is_file()]


@contextmanager
def claim(
    out: Path, mine: Owner, go_on: Callable[[Path], bool] = lambda path: False, overwrite: bool = False
) -> Iterator[Path]:
    """A working folder beside `out` that no other run writes: a new one, or what an interrupted run left.

    `go_on(folder)` says whether that is what is wanted; with `overwrite` it is emptied.  Raises BadInput where `out`
    exists, is being written, or an interrupted run of something else waits for it.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with _turn(out.parent):
            if os.path.lexists(out) and not overwrite:
                raise BadInput(f"--out: {out} exists; choose another folder")
            work, lock = _left(out, go_on, overwrite) or _new(out, mine)
    except OSError as fault:
        raise BadInput(f"--out: {out}: {fault.strerror}; choose a folder that can be written") from fault
    try:
        yield work
    finally:
        os.close(lock)


def _left(out: Path, go_on: Callable[[Path], bool], overwrite: bool) -> tuple[Path, int] | None:
    """What an interrupted run left for `out`, locked; None where a new folder is to be made."""
    for path in partials(out):
        told = owner(path)
        if told is None or told.out != out.name:
            continue
        lock = hold(path)
        if (path / told.needs).is_file() if told.needs else False:
            if go_on(path):
                return path, lock
            if overwrite:
                _empty(path)
                return path, lock
            os.close(lock)
            again = f"flashtemp run --resume {out}" if told.command == "run" else "the same command"
            hint = f"go on with '{again}', choose another folder or remove it"
            raise BadInput(f"--out: {path} holds an interrupted {told.command}; {hint}")
        os.close(lock)  # killed before there was anything to go on with
    return None


def _new(out: Path, mine: Owner) -> tuple[Path, int]:
    work = _unused(out.with_name(f"{out.name}.partial"))
    work.mkdir()
    told = asdict(mine) | {"out": out.name, "process": f"{os.getpid()} on {socket.gethostname()}"}
    (work / MARKER).write_text(json.dumps(told) + "\n", encoding="utf-8")
    return work, hold(work)


def hold(work: Path) -> int:
    """Lock a working folder; close the number to let it go.

    Raises BadInput where another run holds it, and where it holds what no run makes (`refuse_links`).
    """
    refuse_links(work)
    marker = work / MARKER
    marker.touch()
    try:
        return locked(marker)
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
def _turn(folder: Path) -> Iterator[None]:
    """One run at a time makes or places folders here."""
    lock = locked(folder, wait=True)
    try:
        yield
    finally:
        os.close(lock)


def _empty(work: Path) -> None:
    """Remove what an interrupted run left, but not the marker."""
    for path in work.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.name != MARKER:
            path.unlink()


def place(work: Path, out: Path, overwrite: bool = False, drop: tuple[str, ...] = ()) -> Path:
    """Give a whole folder its name, on disk before anything goes; returns where it lies.

    An earlier result is replaced with `overwrite` alone; otherwise, where somebody made `out` meanwhile, the name is
    the first free one.  Files `drop` are removed once the folder has its name: killed before, it can be gone on with.
    """
    for path in work.rglob(".*"):  # of a process that was killed while it wrote
        if UNFINISHED.fullmatch(path.name) and path.is_file() and not path.is_symlink():
            path.unlink()
    settle(work)
    with _turn(out.parent):
        old = None
        if os.path.lexists(out):
            if overwrite:
                old = _unused(out.with_name(out.name + ".replaced"))
                out.rename(old)
            else:
                out = _unused(out)
        try:
            work.rename(out)
        except BaseException:
            if old is not None:
                old.rename(out)
            raise
    for name in (*drop, MARKER):
        (out / name).unlink(missing_ok=True)
    synced(out.parent)
    if old is not None:
        shutil.rmtree(old, ignore_errors=True)
    return out


def settle(folder: Path) -> None:
    """Everything in a folder on disk, so that it outlasts a power cut."""
    for path in (*folder.rglob("*"), folder):
        if not path.is_symlink() and (path.is_file() or path.is_dir()):
            synced(path)


@contextmanager
def whole(out: Path, command: str = "result") -> Iterator[Path]:
    """A new folder to write into, `out` at the end; a failure but Incomplete and Interrupted leaves nothing.

    Raises BadInput.
    """
    with claim(out, Owner(out.name, command)) as work:
        try:
            yield work
        except (Incomplete, Interrupted):  # what matters is there
            place(work, out)
            raise
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise
        check_place(out, place(work, out), None)


def check_place(out: Path, lies: Path, result: object) -> None:
    """Incomplete where a result had to take another name."""
    if lies != out:
        raise Incomplete(f"{out} was made by somebody else meanwhile; the result is whole in {lies}", result)


def wanted(out: Path | str | None) -> AbstractContextManager[Path | None]:
    """A new folder as `whole` makes it, or None where nothing is to be written.  Raises BadInput."""
    return nullcontext() if out is None else whole(Path(out))


@contextmanager
def stoppable() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set, so that work ends where it leaves something whole."""
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopped
        return
    old = {s: signal.signal(s, lambda *_: stopped.set()) for s in ENDS}
    try:
        yield stopped
    finally:
        for s, handler in old.items():
            signal.signal(s, handler)
