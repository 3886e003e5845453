"""The state of a time integration: all that is needed to resume it from a checkpoint."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from flashtemp.solver.circular_track import CircularTrack
from flashtemp.solver.field_store import FieldStore


@dataclass
class IntegrationState:
    """Time (s), number of the phase and state vector of a time integration, and everything recorded so far."""

    t: float = 0.0
    phase: int = 0
    y: Any = None  # (size,) state vector, None before the start
    records: dict[str, list] = field(default_factory=dict)
    frames: FieldStore = field(default_factory=FieldStore)
    steps: int = 0
    calls: dict[str, int] = field(default_factory=lambda: {"rate": 0, "times": 0, "setup": 0, "solve": 0})
    wall_s: float = 0.0
    removed_heat: Any = None  # (2,) heat (J/m) in block and lanes removed at restarts
    track: CircularTrack | None = None
    track_columns: dict[str, Any] | None = None  # fields of the track, read from a checkpoint
