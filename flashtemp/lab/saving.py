"""Writing into the folder: atomically, never through a link, never over a file that changed since it was read."""

from __future__ import annotations

import os
import secrets
from collections.abc import AsyncIterator, Collection
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from flashtemp.errors import BadInput
from flashtemp.lab.workspace import CAMERA_SUFFIXES, MAX_NAME_BYTES, MAX_TOML_BYTES, escape_control, resolve_inside

MAX_UPLOAD_BYTES = 2 * 2**30  # of one upload
MAX_UPLOAD_FILES = 1000  # limit of the form parser for one request
MEASUREMENT_SUFFIXES = {".nc"}  # recordings, which only the page of campaigns accepts
UPLOAD_LIMIT = f"at most {MAX_UPLOAD_BYTES // 2**30} GiB and {MAX_UPLOAD_FILES} files at once"
NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


@dataclass(frozen=True)
class TextVersion:
    """The content of a file that a page has last read or written: its resolved `path` and SHA-256 `digest`."""

    path: Path
    digest: str


class ReplacesFile(BadInput):
    """A file of that name exists that this page has not opened; it is replaced only with consent."""


def read_text(folder: Path, name: str) -> tuple[str, TextVersion]:
    """The text of a TOML file in the folder, and its version.  Raises BadInput."""
    path, label = _toml_path(folder, name), escape_control(name)
    if not path.is_file():
        raise BadInput(f"{label}: no such file; choose one on the folder page")
    if path.stat().st_size > MAX_TOML_BYTES:
        raise BadInput(f"{label}: larger than {MAX_TOML_BYTES // 2**20} MiB; give a shorter TOML file")
    data = path.read_bytes()
    try:
        return data.decode("utf-8").replace("\r\n", "\n"), TextVersion(path, sha256(data).hexdigest())
    except UnicodeDecodeError as fault:
        raise BadInput(f"{label}: not UTF-8 text and therefore not TOML; give a .toml file") from fault


def write_text(
    folder: Path, name: str, text: str, opened: TextVersion | None = None, replace: bool = False
) -> TextVersion:
    """Write a TOML file of the folder atomically and return its version.

    `opened` is the version that the page has last read or written.  Raises BadInput if that file has since changed on
    disk or the name is not a .toml file of the folder, ReplacesFile if it would replace another file without `replace`.
    """
    path, label = _toml_path(folder, name), escape_control(name)
    data = _encode_text(text, label)
    if os.path.lexists(path):
        if not path.is_file():
            raise BadInput(f"{label}: not a file; save under another name")
        is_opened = opened is not None and opened.path == path
        if is_opened and opened is not None and _file_digest(path) != opened.digest:
            raise BadInput(f"{label}: changed on disk since it was opened; reload the page or save under another name")
        if not is_opened and not replace:
            raise ReplacesFile(f"{label}: exists already; replace it, or save under another name")
    path.parent.mkdir(parents=True, exist_ok=True)
    _replace_file(path, data)
    return TextVersion(path, sha256(data).hexdigest())


async def write_upload(
    folder: Path, name: str, chunks: AsyncIterator[bytes], suffixes: Collection[str] = CAMERA_SUFFIXES
) -> Path:
    """Write an uploaded file under a new name in the folder.

    Raises BadInput for a name with a path, a hidden or existing name, none of the suffixes, and too many bytes.
    """
    path = folder / check_upload_name(name, suffixes)
    try:
        number = os.open(path, NEW_FILE, 0o666)
    except OSError as fault:
        raise BadInput(
            f"{escape_control(name)}: cannot be created: {fault.strerror}; give the file another name"
        ) from fault
    n_bytes, complete = 0, False
    try:
        with os.fdopen(number, "wb") as out:
            async for chunk in chunks:
                n_bytes += len(chunk)
                if n_bytes > MAX_UPLOAD_BYTES:
                    raise BadInput(f"{escape_control(name)}: {UPLOAD_LIMIT}; copy the file into the folder instead")
                out.write(chunk)
        complete = True
    finally:
        if not complete:
            path.unlink(missing_ok=True)
    return path


def check_upload_name(name: str, suffixes: Collection[str] = CAMERA_SUFFIXES) -> str:
    """The name of an uploaded file, if it is a plain name with one of the suffixes.  Raises BadInput."""
    label = escape_control(name)
    if not name or any(c in "/\\" or not c.isprintable() for c in name) or len(name.encode()) > MAX_NAME_BYTES:
        raise BadInput(f"{label!r}: not a plain file name; rename the file")
    if name.startswith("."):
        raise BadInput(f"{label}: a hidden name; rename the file")
    if Path(name).suffix.lower() not in suffixes:
        raise BadInput(f"{label}: not a camera file; accepted are: {' '.join(sorted(suffixes))}")
    return name


def _toml_path(folder: Path, name: str) -> Path:
    """The path of a TOML file of the folder.  Raises BadInput for any other name."""
    path = resolve_inside(folder, name)
    if path.suffix != ".toml" or not name.endswith(".toml"):
        raise BadInput(f"{escape_control(name)}: the page opens and saves TOML files; give a name that ends in .toml")
    return path


def _encode_text(text: str, label: str) -> bytes:
    try:
        data = text.encode("utf-8")
    except UnicodeEncodeError as fault:
        raise BadInput(f"{label}: character {fault.start + 1} is not Unicode; remove it") from fault
    if len(data) > MAX_TOML_BYTES:
        raise BadInput(f"{label}: larger than {MAX_TOML_BYTES // 2**20} MiB; give a shorter text")
    return data


def _file_digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


def _replace_file(path: Path, data: bytes) -> None:
    """Replace a file by renaming a new one; its random name and O_EXCL rule out a planted link."""
    work = path.with_name(f".{secrets.token_hex(8)}.new")
    number = os.open(work, NEW_FILE, 0o666)
    try:
        with os.fdopen(number, "wb") as out:
            if path.is_file():
                os.chmod(work, path.stat().st_mode & 0o777)
            out.write(data)
            out.flush()
            os.fsync(out.fileno())
        os.replace(work, path)
    except BaseException:
        with suppress(OSError):
            work.unlink()
        raise
