"""The scene of a simulation: mesh, materials, schedule and active effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from flashtemp.meshes.mesh import Mesh
from flashtemp.model.schedule import Phase, Schedule
from flashtemp.physics import contribution_check
from flashtemp.physics.arrays import Array, Value
from flashtemp.physics.effect import Effect
from flashtemp.physics.material import Layer, Material

GAUSS_RULE = np.polynomial.legendre.leggauss(3)


class LawContext(NamedTuple):
    """State at which the laws of effects are evaluated: SI units, temperatures in K, arrays along x."""

    t: float  # s from the first start of sliding
    speed: float  # m/s
    pressure: float  # nominal contact pressure, mean over the block, Pa
    slid: float  # m since this repetition started, in either direction
    contact_time: float  # s since this repetition started
    waited: float  # s since sliding stopped, 0 while sliding
    last_speed: float  # m/s before the stop; the present speed while sliding
    touching: bool  # False while the block is lifted
    ambient: float  # air and initial temperature, K
    repetition: int = 1
    x: Any = None  # m from the edge that leads in forward sliding
    y: Any = 0.0  # m from the centre line
    local_pressure: Any = None  # Pa at x
    spot_fraction: Any = None  # macroasperity contact fraction at x
    covered: Any = None  # macroasperity contact fraction, mean over the block's length
    friction: Any = None  # friction coefficient at x
    worn: Any = None  # wear depth at x, m; None without wear
    face: Any = None  # face temperature averaged over the passage of spots, K; for contact laws
    base: Any = None  # value of the quantity so far, for a factor that depends on it
    carried: Any = None  # K, temperature rise in the entering road from earlier passes, across y, by depth cell
    passed: float = 0.0  # m of road since the first start of all repetitions
    lead: Any = None  # m from the edge that leads now: x, or length - x in backward sliding
    direction: int = 1  # -1 in backward sliding
    low: Any = None  # m above the interface, lower edges of cells; for laws of a zone
    high: Any = None  # m above the interface, upper edges of cells
    leg: float = 0.0  # m since the start of this repetition or its last reversal

    def at_position(self, mesh: Mesh, lead: Value, y: Value, **changed: Any) -> LawContext:
        """The context at `lead` (m) behind the leading edge and at y (m), with other `changed` fields."""
        x = lead if self.direction > 0 else mesh.x[mesh.last] - lead
        return self.with_fields(x=x, lead=lead, y=y, **changed)

    def with_fields(self, **changed: Any) -> LawContext:
        """The context with `changed` fields; half the cost of `_replace`, because every time step calls it often."""
        fields = list(self)
        for name, value in changed.items():
            fields[LAW_CONTEXT_INDEX[name]] = value
        return LawContext._make(fields)

    def under_block(self, mesh: Mesh, **changed: Any) -> LawContext:
        """The context at all columns under the block, with other `changed` fields."""
        return self.at_position(mesh, mesh.column_x, mesh.column_y, **changed)


LAW_CONTEXT_INDEX = {name: i for i, name in enumerate(LawContext._fields)}  # position of each field in the tuple


@dataclass(frozen=True)
class SceneOutline:
    """A scene without its mesh, on which the `heat()` method of effects is called first.

    The mesh depends on the effects (depth of heat release, memory of the track), so `heat()` is called twice: on this
    outline, and on the Scene.  The outline has every attribute of a Scene that `heat()` may use.
    """

    block: Material
    road: Material
    schedule: Schedule
    ambient: float
    length: float
    width: float
    height: float
    spot_diameter: float
    spot_fraction: float
    track_length: float | None
    modulus: float
    modulus_slope: float
    poisson: float
    stiffness: float | None
    elastic_3d: bool
    resolved: bool
    layers: tuple[Layer, ...] = ()

    @property
    def speeds(self) -> tuple[float, float]:
        """Lowest and highest sliding speed given, m/s."""
        return self.schedule.speed.range

    @property
    def load(self) -> float:
        """Highest mean nominal contact pressure, Pa."""
        return max(self.schedule.pressure.value)


@dataclass(frozen=True)
class ActiveEffect:
    """An effect with the values of its parameters."""

    name: str
    effect: Effect
    p: SimpleNamespace

    def contributions(self, scene: Scene | SceneOutline) -> contribution_check.Contributions:
        """The contributions of the effect to the heat balance of a scene.  Raises BadInput for an unknown target."""
        return contribution_check.check_balance_contributions(self.name, self.effect, scene, self.p)


@dataclass(frozen=True)
class Scene:
    """A block on a road: all data of the heat balance (theory.md, eqs. (8) to (12)), independent of files and solvers.

    Lengths in m, `ambient` in K.  The macroasperity contact regions have the diameter `spot_diameter` and cover the
    fraction `spot_fraction`.  The elastic block has Young's `modulus` (Pa), its relative slope with temperature (1/K)
    and `poisson`; with a `stiffness` (Pa per m of compression) the block is on independent springs instead.
    `elastic_3d`: one elastic block in 3D instead of plane strain in every plane.  `layers`: layers of the block from
    the face upwards, the first of which has the material `block`; empty for a block of one material.
    """

    mesh: Mesh
    block: Material
    road: Material
    schedule: Schedule
    acting: tuple[ActiveEffect, ...]
    ambient: float
    length: float
    height: float
    spot_diameter: float
    track_length: float | None = None
    modulus: float = 5e6
    modulus_slope: float = 0.0
    poisson: float = 0.49
    stiffness: float | None = None
    elastic_3d: bool = False
    spot_fraction: float = 0.2
    layers: tuple[Layer, ...] = ()

    @property
    def width(self) -> float:
        """Width across the direction of sliding, m."""
        return float(self.mesh.y[-1] - self.mesh.y[0])

    @property
    def speeds(self) -> tuple[float, float]:
        """Lowest and highest sliding speed given, m/s."""
        return self.schedule.speed.range

    @property
    def load(self) -> float:
        """Highest mean nominal contact pressure, Pa."""
        return max(self.schedule.pressure.value)

    @property
    def resolved(self) -> bool:
        """Whether the mesh has cells across the width (3D)."""
        return bool(self.mesh.n_across > 1)

    def block_property(self, name: str) -> Any:
        """A property of the block's material by name: a number, or with layers an array over cells (n_block,)."""
        if not self.layers:
            return getattr(self.block, name)
        pairs = zip(self.layers, self.mesh.layers, strict=True)
        return np.concatenate([np.full(s.stop - s.start, getattr(layer.material, name)) for layer, s in pairs])

    def in_layer(self, name: str) -> Array:
        """Indicator (n_block,): 1 in the cells of the layer `name`, 0 elsewhere."""
        inside = np.zeros(self.mesh.n_block)
        for layer, cells in zip(self.layers, self.mesh.layers, strict=True):
            inside[cells] = layer.name == name
        return inside

    def law_context(self, phase: Phase, t: float) -> LawContext:
        """The context at time t (s) within a phase, before fields that depend on position."""
        s = self.schedule
        since, slid, passed = t - phase.start, s.slid_distance(phase, t), s.total_slid_distance(phase, t)
        if s.alone:
            return LawContext(
                t, 0.0, s.pressure(since), 0.0, since, 0.0, 0.0, False, self.ambient, phase.repetition, passed=passed
            )
        if phase.sliding:
            v = s.speed(since)
            return LawContext(
                t, v, s.pressure(since), slid, since, 0.0, v, True, self.ambient, phase.repetition,
                passed=passed, direction=phase.direction, leg=slid - phase.leg_before,
            )  # fmt: skip
        return LawContext(
            t, 0.0, s.pressure(s.slide_time), slid, since, t - phase.begin, s.last_speed(),
            not s.lifted, self.ambient, phase.repetition,
            passed=passed, direction=phase.direction, leg=slid - phase.leg_before,
        )  # fmt: skip

    def __str__(self) -> str:
        names = ", ".join(a.name for a in self.acting)
        stack = "".join(f"\n  {line}" for line in describe_layers(self.layers))
        return f"Scene\n  {self.mesh}{stack}\n  {self.schedule}\n  effects: {names}"


def describe_layers(layers: tuple[Layer, ...]) -> list[str]:
    """One line of text per layer of a block, from the face upwards."""
    last = len(layers) - 1
    return [
        f"layer '{a.name}', {1e3 * a.thickness:g} mm"
        + ("" if n == last else f", {a.contact_resistance:g} m2K/W to '{layers[n + 1].name}'")
        for n, a in enumerate(layers)
    ]


def gauss_mean(law: Callable[..., Value], edges: Array, *args: Any) -> Array:
    """Cell means of a pointwise law of x, with three Gauss points per cell."""
    nodes, weights = GAUSS_RULE
    mid, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    values = [np.asarray(law(mid + half * s, *args)) for s in nodes]
    return np.asarray(sum(w * v for w, v in zip(weights, values, strict=True)) / 2)
