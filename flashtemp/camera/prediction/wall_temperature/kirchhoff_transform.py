"""Kirchhoff's transformation of a block's rise, of which the heat equation is linear where conductivity is a law of T.

theta is the integral of k/k0 over the rise: flux is -k0 grad theta, and diffusivity alone still follows temperature.
It is taken at a mean rise, as is the share of a film that theta feels (Carslaw & Jaeger 1959, 1.6).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flashtemp.model.effect_laws import EffectLaws
from flashtemp.model.scene import LawContext, Scene
from flashtemp.physics.arrays import Array
from flashtemp.physics.material import Material

MEAN_RISE_FRACTION = 0.7  # of the face's mean rise: what lies behind a wall that cools is less warm


@dataclass(frozen=True)
class KirchhoffTransform:
    """What a scene says of the conduction in its block, by rises (...) in K above the air at the start."""

    scene: Scene
    laws: EffectLaws
    now: LawContext

    @classmethod
    def from_scene(cls, scene: Scene) -> KirchhoffTransform:
        first = scene.schedule.phases[0]
        return cls(scene, EffectLaws(scene), scene.law_context(first, first.begin))

    def conductivity_ratio(self, rise: Array) -> Array:
        """k/k0 (...) where it is as warm."""
        if not self.laws.has_law("block.conductivity"):
            return np.ones_like(rise)
        return self.laws("block.conductivity", 1.0, self.now.ambient + rise, self.now) * np.ones_like(rise)

    @property
    def axial_conductivity_ratio(self) -> float:
        """k along x over k."""
        return float(self.laws("block.conductivity_along", 1.0, None, None))

    def theta(self, rise: Array) -> Array:
        """theta (...) in K of rises, by Simpson's rule."""
        if not self.laws.has_law("block.conductivity"):
            return rise
        return (
            rise
            * (
                self.conductivity_ratio(0.0 * rise)
                + 4.0 * self.conductivity_ratio(0.5 * rise)
                + self.conductivity_ratio(rise)
            )
            / 6.0
        )

    def subtract_theta(self, warmer: Array, theta: Array) -> Array:
        """The rise (...) in K of what has a smaller theta (...) by as much than what is `warmer`."""
        return warmer - theta / self.conductivity_ratio(warmer - 0.5 * theta)

    def mean_material(self, rise: Array, times: Array) -> tuple[Material, float]:
        """A block of one diffusivity, and the share of a film that theta feels; a face's `subtract_theta` (n, x) K at `times`."""
        passed = np.trapezoid(rise.mean(axis=1), times) / (times[-1] - times[0])
        level, block = np.array(MEAN_RISE_FRACTION * passed), self.scene.block
        gradient = np.mean(self.laws("block.capacity_gradient", 0.0, None, None))
        capacity = self.laws("block.heat_capacity", 1.0 + gradient * level, self.now.ambient + level, None)
        share = level / self.theta(level) if level else 1.0
        more = float(np.mean(capacity) / self.conductivity_ratio(level))
        return replace(block, heat_capacity=block.heat_capacity * more), float(share)
