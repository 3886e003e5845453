"""What is simulated: mesh, materials, schedule and the effects that act on them."""

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
    """The moment at which laws are evaluated; SI units, temperatures in K, arrays along x."""

    t: float  # s from the first start of sliding
    speed: float  # m/s
    pressure: float  # nominal contact pressure, mean over the block, Pa
    slid: float  # m since this repetition started, whichever way
    contact_time: float  # s since this repetition started
    waited: float  # s since sliding stopped, 0 while sliding
    last_speed: float  # m/s before the stop, the speed itself while sliding
    touching: bool  # False while the block is lifted
    ambient: float  # air and initial temperature, K
    repetition: int = 1
    x: Any = None  # m from the edge that leads while the block slides forward
    y: Any = 0.0  # m from the centre line
    local_pressure: Any = None  # Pa at x
    spot_fraction: Any = None  # macroasperity contact fraction at x
    covered: Any = None  # macroasperity contact fraction, mean over the block's length
    friction: Any = None  # friction coefficient at x
    worn: Any = None  # m worn at x; None where nothing is abraded
    face: Any = None  # temperature of the block's face averaged over the passage of spots, K; for laws of the contact
    base: Any = None  # the quantity so far, for a law that bends it
    carried: Any = None  # K, what earlier passes left in the road entering now, across y, by depth cell
    passed: float = 0.0  # m of road since the first start of all repetitions
    lead: Any = None  # m from the edge that leads now: x, or while the block slides back, length - x
    direction: int = 1  # -1 while the block slides back
    low: Any = None  # m above the interface, lower and upper edges of cells, for laws of a zone
    high: Any = None
    leg: float = 0.0  # m since this repetition started or last turned round

    def at_position(self, mesh: Mesh, lead: Value, y: Value, **seen: Any) -> LawContext:
        """The moment as laws see it `lead` (m) behind the leading edge, with what else they see there."""
        x = lead if self.direction > 0 else mesh.x[mesh.last] - lead
        return self.with_fields(x=x, lead=lead, y=y, **seen)

    def with_fields(self, **seen: Any) -> LawContext:
        """The moment as laws see it that see this besides: `_replace` at half the cost, since every step asks often."""
        fields = list(self)
        for name, value in seen.items():
            fields[LAW_CONTEXT_INDEX[name]] = value
        return LawContext._make(fields)

    def under_block(self, mesh: Mesh, **seen: Any) -> LawContext:
        """The moment as laws see it at all columns under the block."""
        return self.at_position(mesh, mesh.column_x, mesh.column_y, **seen)


LAW_CONTEXT_INDEX = {name: i for i, name in enumerate(LawContext._fields)}  # where each stands in the tuple


@dataclass(frozen=True)
class SceneOutline:
    """A scene before it has a mesh: what `heat()` is asked on first.

    The mesh follows from what effects say (how deep heat is released, whether the track is remembered), so effects are
    asked twice: on this, and on the Scene.  It has all of a Scene that `heat()` may use.
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
        """What the effect yields on a scene.  Raises BadInput when it names what is not there."""
        return contribution_check.check_balance_contributions(self.name, self.effect, scene, self.p)


@dataclass(frozen=True)
class Scene:
    """A block on a road: everything the balance needs, nothing about files or solvers.

    Lengths in m, `ambient` in K; `spot_diameter` of the macroasperity contact regions, which cover `spot_fraction`;
    `modulus` (Young's, Pa), its relative slope with temperature (1/K) and `poisson` of the elastic block; with a
    `stiffness`, Pa per m of compression, it stands on springs instead; `elastic_3d` whether its planes across are one
    block in 3D, or each in plane strain.  `layers` of the block from the face
    upwards, of which `block` is the first one's material; none where it is one material.
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
        """Whether there are cells across: 3D."""
        return bool(self.mesh.n_across > 1)

    def block_property(self, name: str) -> Any:
        """A property of the block's material by its name: a number, or with layers one for each cell (n_block,)."""
        if not self.layers:
            return getattr(self.block, name)
        own = zip(self.layers, self.mesh.layers, strict=True)
        return np.concatenate([np.full(s.stop - s.start, getattr(layer.material, name)) for layer, s in own])

    def in_layer(self, name: str) -> Array:
        """1 in the cells (n_block,) up the block that belong to a layer, 0 in the others."""
        inside = np.zeros(self.mesh.n_block)
        for layer, cells in zip(self.layers, self.mesh.layers, strict=True):
            inside[cells] = layer.name == name
        return inside

    def law_context(self, phase: Phase, t: float) -> LawContext:
        """The schedule at time t within a phase."""
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
    """The layers of a block in words, one line each from the face upwards."""
    last = len(layers) - 1
    return [
        f"layer '{a.name}', {1e3 * a.thickness:g} mm"
        + ("" if n == last else f", {a.contact_resistance:g} m2K/W to '{layers[n + 1].name}'")
        for n, a in enumerate(layers)
    ]


def gauss_mean(law: Callable[..., Value], edges: Array, *args: Any) -> Array:
    """Cell means of a pointwise law of x by three Gauss points per cell."""
    nodes, weights = GAUSS_RULE
    mid, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    values = [np.asarray(law(mid + half * s, *args)) for s in nodes]
    return np.asarray(sum(w * v for w, v in zip(weights, values, strict=True)) / 2)
