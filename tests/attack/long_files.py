"""Camera files by the thousand: every container with one bit flipped, with up to eleven, and cut off anywhere.

A try is not clean when a cut gives a wrong image, or a flipped bit a wrong temperature where the container has checksums.
"""

from __future__ import annotations

import importlib.util
import tempfile
from functools import partial
from pathlib import Path

_spec = importlib.util.spec_from_file_location("camera_files", Path(__file__).with_name("test_camera_files.py"))
attack = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(attack)

TIMES = 300
SUMMED = ("FFF with checksums", "FLIR JPEG", "PNG", "MAT, packed")


def _attack(name: str, row, seed: int, share: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for kind in ("flip", "flips", "cut"):
            for fate, count in attack.attacked(Path(folder), name, kind, max(1, round(share * TIMES)), seed).items():
                wrong = fate == "wrong" or (fate == "pixel" and name in SUMMED)
                bad = wrong and (kind == "cut" or (kind == "flip" and name in SUMMED))
                for _ in range(count):
                    row.count(f"{kind} {fate}", f"{kind}: {fate}" if bad else "")


CLASSES = {f"camera file, {name}": partial(_attack, name) for name in attack.CONTAINERS}
