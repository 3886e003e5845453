"""Checkpoints: the state that an interrupted run needs to continue, in addition to its saved fields.

A checkpoint replaces the last one only when it and the fields are on disk.  Checksums detect any changed bit.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np

from flashtemp.errors import BadInput, describe_exception
from flashtemp.physics import safe_hdf5
from flashtemp.runs.results.processes import sync_to_disk
from flashtemp.solver.circular_track import TRACK_FIELDS
from flashtemp.solver.field_store import FieldStore
from flashtemp.solver.integration_state import IntegrationState

CHECKPOINT_FILE, FRAMES_FILE, RESERVE_FILE = "checkpoint.h5", "frames.bin", "reserve.bin"
HEADER_BYTES = 512  # header before the HDF5 image (a user block, which HDF5 skips): file type and checksum
HEADER_PREFIX = b"flashtemp checkpoint 3, "  # start of the header; the number is the version of the format
NUMERIC_KINDS = re.compile("[<>|=]?[fiub][0-9]{1,2}")  # dtypes of numbers
# disk space reserved for a checkpoint on a full disk, in addition to twice the size of the last one
RESERVE_MARGIN_BYTES = 1 << 18


def save_checkpoint(work: Path, progress: IntegrationState) -> None:
    """Write the state of a run; replaces the last checkpoint only when the new one is complete and on disk.

    On a full disk the reserved space is released for it.  Raises OSError.
    """
    image = _build_image(work, progress)
    try:
        progress.frames.sync_to_disk()
        _write_file(work, image)
    except OSError:
        if not (work / RESERVE_FILE).exists():
            raise
        (work / RESERVE_FILE).unlink()
        _write_file(work, image)
    else:
        _reserve_space(work / RESERVE_FILE, 2 * len(image) + RESERVE_MARGIN_BYTES)


def _build_image(work: Path, progress: IntegrationState) -> bytes:
    name = work / f".{CHECKPOINT_FILE}.image"  # never written, but HDF5 requires a name
    with h5py.File(name, "w", driver="core", backing_store=False) as file:
        file.attrs.update(
            {
                "t": progress.t,
                "phase": progress.phase,
                "steps": progress.steps,
                "wall": progress.wall_s,
                "fields": _describe_dtype(progress.frames.dtype),
                "case": _hash_inputs(work),
                **{f"calls_{k}": v for k, v in progress.calls.items()},
            }
        )
        file["y"], file["left"] = progress.y, progress.removed_heat
        file["sums"] = np.array([list(s) for s in progress.frames.checksums], dtype=np.uint8)
        for key, values in progress.records.items():
            data = np.array(values, dtype=object if key == "ledger" else None)
            file.create_dataset(f"records/{key}", data=data, dtype=h5py.string_dtype() if key == "ledger" else None)
        if progress.track is not None:
            for key in TRACK_FIELDS:
                file[f"track/{key}"] = np.array(getattr(progress.track, key))
        file.flush()
        return bytes(file.id.get_file_image())


def _build_header(image: bytes) -> bytes:
    return HEADER_PREFIX + f"sha256 of what follows: {hashlib.sha256(image).hexdigest()}\n".encode().ljust(
        HEADER_BYTES - len(HEADER_PREFIX)
    )


def _write_file(work: Path, image: bytes) -> None:
    fresh = work / (CHECKPOINT_FILE + ".new")
    try:
        with fresh.open("wb") as file:
            file.write(_build_header(image))
            file.write(image)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(work / CHECKPOINT_FILE)
    except OSError:
        fresh.unlink(missing_ok=True)
        raise
    sync_to_disk(work)


def _reserve_space(file: Path, size: int) -> None:
    """Reserve disk space where possible, to be released when the disk is full."""
    if not hasattr(os, "posix_fallocate"):  # macOS, Windows
        return
    with suppress(OSError), file.open("ab") as handle:
        if file.stat().st_size < size:
            os.posix_fallocate(handle.fileno(), 0, size)


def load_checkpoint(work: Path) -> IntegrationState:
    """The state of a checkpoint.  Raises BadInput when it or its fields are damaged, or its case has changed."""
    file = work / CHECKPOINT_FILE
    try:
        data = file.read_bytes()
        if data.startswith(HEADER_PREFIX[:-3]) and not data.startswith(HEADER_PREFIX):
            raise BadInput(f"--resume: {file} was written by another version of flashtemp; start the run again")
        if data[:HEADER_BYTES] != _build_header(data[HEADER_BYTES:]):
            raise BadInput(f"--resume: {file} is damaged; start the run again")
        with h5py.File(io.BytesIO(data[HEADER_BYTES:])) as image:
            safe_hdf5.list_datasets(image)  # raises for links into other files
            if image.attrs["case"] != _hash_inputs(work):
                changed = f"{work / 'case.toml'} or a file in inputs was changed since the run"
                raise BadInput(f"--resume: {changed}; restore it or start again")
            state = _read_progress(image, work)
    except BadInput:
        raise
    except Exception as fault:  # a valid checksum does not guarantee valid contents
        raise BadInput(f"--resume: {file} is damaged ({describe_exception(fault)}); start the run again") from fault
    if damage := state.frames.describe_damage():
        raise BadInput(f"--resume: {damage}; start the run again")
    return state


def _hash_inputs(work: Path) -> str:
    """SHA-256 digest of the case and of all files that it names, including their names."""
    digest = hashlib.sha256((work / "case.toml").read_bytes())
    for path in sorted((work / "inputs").rglob("*")):
        if path.is_file() and path.suffix != ".pyc":
            digest.update(path.relative_to(work / "inputs").as_posix().encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _describe_dtype(dtype: np.dtype | None) -> str:
    """Names, dtypes and shapes of the fields of a record as JSON."""
    parts = [] if dtype is None else [(n, dtype[n].base.str, list(dtype[n].shape)) for n in dtype.names or ()]
    return json.dumps(parts)


def _read_progress(file, work: Path) -> IntegrationState:
    """The state in an open checkpoint; the track is rebuilt from its columns when the run continues."""
    a = file.attrs
    records = {k: list(v[:]) for k, v in file["records"].items()} if "records" in file else {}
    if records:
        records["ledger"] = [s.decode() if isinstance(s, bytes) else str(s) for s in records["ledger"]]
    phase, y, left = int(a["phase"]), file["y"][:], file["left"][:]
    if phase < 0 or not np.isfinite(a["t"]) or any(v.ndim != 1 or v.dtype.kind != "f" for v in (y, left)):
        raise ValueError("not the state of a run")
    columns = {k: list(v[:]) for k, v in file["track"].items()} if "track" in file else None
    fields = [(n, kind, tuple(shape)) for n, kind, shape in json.loads(a["fields"])]
    # a forged object dtype would be read as memory addresses
    if odd := [kind for _, kind, _ in fields if not NUMERIC_KINDS.fullmatch(kind)]:
        raise ValueError(f"fields of kind {odd[0]!r}")
    sums = [bytes(s.tolist()) for s in file["sums"][:]]
    return IntegrationState(
        t=float(a["t"]),
        phase=phase,
        y=y,
        records=records,
        frames=FieldStore(work / FRAMES_FILE, np.dtype(fields) if fields else None, sums),
        steps=int(a["steps"]),
        calls={k.removeprefix("calls_"): int(a[k]) for k in a if k.startswith("calls_")},
        wall_s=float(a["wall"]),
        removed_heat=left,
        track_columns=columns,
    )
