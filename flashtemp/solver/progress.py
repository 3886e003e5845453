"""Where a march stands: enough to go on from a checkpoint."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from flashtemp.solver.circular_track import Track
from flashtemp.solver.field_store import Frames


@dataclass
class Progress:
    """Time (s), number of the phase and state of a march, and all that it has recorded; it grows as the march goes."""

    t: float = 0.0
    phase: int = 0
    y: Any = None  # (size,); none before the start
    records: dict[str, list] = field(default_factory=dict)
    frames: Frames = field(default_factory=Frames)
    steps: int = 0
    calls: dict[str, int] = field(default_factory=lambda: {"rate": 0, "times": 0, "setup": 0, "solve": 0})
    wall: float = 0.0
    left: Any = None  # (2,) heat (J/m) in block and lanes removed at restarts
    track: Track | None = None
    columns: dict[str, Any] | None = None  # of the track, as read from a checkpoint
