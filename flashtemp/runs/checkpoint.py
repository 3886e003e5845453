"""Checkpoints of a march: all that an interrupted run needs to go on, beside the fields that it has kept so far."""

from __future__ import annotations

import hashlib
from pathlib import Path

import h5py
import numpy as np

from flashtemp.errors import BadInput
from flashtemp.runs import vtk
from flashtemp.solver.field_store import Frames
from flashtemp.solver.progress import Progress

CHECKPOINT, FRAMES = "checkpoint.h5", "frames.bin"


def save(work: Path, p: Progress) -> None:
    """Write all that a march needs to go on; replaces the last checkpoint only when whole."""
    fresh = work / (CHECKPOINT + ".new")
    with vtk.in_memory(fresh) as file:
        file.attrs.update(
            {
                "t": p.t,
                "phase": p.phase,
                "steps": p.steps,
                "wall": p.wall,
                "frames": len(p.frames),
                "case": _fingerprint(work),
                **{f"calls_{k}": v for k, v in p.calls.items()},
            }
        )
        file["y"], file["left"] = p.y, p.left
        for name, values in p.records.items():
            data = np.array(values, dtype=object if name == "ledger" else None)
            file.create_dataset(f"records/{name}", data=data, dtype=h5py.string_dtype() if name == "ledger" else None)
        if p.track is not None:
            for name in ("place", "time", "mean", "lane"):
                file[f"track/{name}"] = np.array(getattr(p.track, name))
    fresh.replace(work / CHECKPOINT)


def load(work: Path) -> Progress:
    """The Progress of a checkpoint; BadInput when it is damaged or its case was changed meanwhile."""
    try:
        with h5py.File(work / CHECKPOINT) as file:
            if file.attrs["case"] != _fingerprint(work):
                raise BadInput(f"--resume: {work / 'case.toml'} was changed since the run; restore it or start anew")
            return _progress(file, work)
    except (OSError, KeyError) as fault:
        raise BadInput(f"--resume: {work / CHECKPOINT} is damaged ({fault}); start the run anew") from fault


def _fingerprint(work: Path) -> str:
    return hashlib.sha256((work / "case.toml").read_bytes()).hexdigest()


def _progress(file, work: Path) -> Progress:
    """The track's columns are put back when the march rebuilds it."""
    a = file.attrs
    records = {k: list(v[:]) for k, v in file["records"].items()}
    records["ledger"] = [s.decode() if isinstance(s, bytes) else str(s) for s in records["ledger"]]
    columns = {k: list(v[:]) for k, v in file["track"].items()} if "track" in file else None
    return Progress(
        t=float(a["t"]),
        phase=int(a["phase"]),
        y=file["y"][:],
        records=records,
        frames=Frames(work / FRAMES, int(a["frames"])),
        steps=int(a["steps"]),
        calls={k.removeprefix("calls_"): int(a[k]) for k in a if k.startswith("calls_")},
        wall=float(a["wall"]),
        left=file["left"][:],
        columns=columns,
    )
