"""A run that is in progress as plain data: profiles, temperatures over time and the field of the block, for display."""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.model.effect_laws import EffectLaws
from flashtemp.model.scene import Scene
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.enthalpy import build_heat_capacity
from flashtemp.solver.integration_state import IntegrationState

MAX_HISTORY_POINTS = 300  # of a curve over time
FIELD_SHAPE = (36, 120)  # most rows and columns of the picture of the block
DECIMALS = 3  # of temperatures in degC


class LiveRun:
    """Describes the states of one run of a `scene`; only reads them, so the run is the same with and without it."""

    def __init__(self, scene: Scene):
        self.scene = scene
        self.heat_capacity = build_heat_capacity(scene, EffectLaws(scene))

    def describe_state(self, state: IntegrationState) -> dict[str, Any]:
        """The state at its time: times in s, positions in mm from the leading edge, temperatures in degC."""
        schedule = self.scene.schedule
        phase = schedule.phases[min(state.phase, len(schedule.phases) - 1)]
        out: dict[str, Any] = {
            "time": state.t,
            "end": schedule.end_time,
            "sliding": phase.sliding,
            "repetition": phase.repetition,
            "repetitions": schedule.phases[-1].repetition,
            "steps": state.steps,
            "ambient": self.scene.ambient - KELVIN,
        }
        if state.records.get("time"):
            out |= self._describe_records(state.records)
        if state.y is not None:
            out["field"] = self._describe_field(state.y, phase.direction)
        return out

    def _describe_records(self, records: dict[str, list]) -> dict[str, Any]:
        """The latest profiles, and temperatures at three places of the block's face over time."""
        times, T = records["time"], records["T_block"]
        kept = np.unique(np.linspace(0, len(times) - 1, min(len(times), MAX_HISTORY_POINTS)).round().astype(int))
        faces = np.array([np.asarray(T[k])[[0, len(T[k]) // 2, -1]] for k in kept])
        spots = np.array([np.nanmax(records["T_spot"][k]) for k in kept])
        return {
            "x": _rounded(1e3 * self.scene.mesh.x_block, 4),
            "profile_time": float(times[-1]),
            "T_block": _rounded(T[-1]),
            "T_spot": _rounded(records["T_spot"][-1]),
            "history": {
                "time": _rounded([times[k] for k in kept], 4),
                "leading": _rounded(faces[:, 0]),
                "middle": _rounded(faces[:, 1]),
                "trailing": _rounded(faces[:, 2]),
                "spots": _rounded(spots),
            },
        }

    def _describe_field(self, y: np.ndarray, direction: int) -> dict[str, Any]:
        """The section of the block in its middle plane on equal pixels, from the top row down."""
        mesh = self.scene.mesh
        h = y[: mesh.n_cells]
        rise = h if self.heat_capacity is None else self.heat_capacity.temperature_rise(h)
        block = mesh.planes(rise)[mesh.block, mesh.n_across // 2][::direction]  # (lines, levels from the face up)
        edges = mesh.x[mesh.first : mesh.last + 1]
        z = 0.5 * (mesh.height[1:] + mesh.height[:-1])
        rows, columns = (
            min(shape, count) for shape, count in zip(FIELD_SHAPE, (len(z) * 3, len(edges) * 3), strict=True)
        )
        at_x = edges[0] + (np.arange(columns) + 0.5) / columns * (edges[-1] - edges[0])
        at_z = mesh.height[-1] * (1.0 - (np.arange(rows) + 0.5) / rows)
        along = np.array([np.interp(at_x, mesh.x_block, level) for level in block.T])
        image = np.array([np.interp(at_z, z, column) for column in along.T]).T
        return {
            "length": 1e3 * float(edges[-1] - edges[0]),
            "height": 1e3 * float(mesh.height[-1]),
            "T": [_rounded(row, 2) for row in image + self.scene.ambient - KELVIN],
        }


def _rounded(values: Any, decimals: int = DECIMALS) -> list[float | None]:
    """Values as a list, with None where one is not finite."""
    return [round(float(v), decimals) if np.isfinite(v) else None for v in values]
