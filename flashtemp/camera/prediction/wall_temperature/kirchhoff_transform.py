"""Kirchhoff transformation, which makes conduction linear where the block's conductivity depends on temperature.

theta, eq. (32) of theory.md, is the integral of k/k0 over the temperature rise.  The flux is then -k0 grad theta, and
only the diffusivity still depends on temperature.  Diffusivity and the ratio rise/theta, by which a heat-transfer
coefficient is multiplied, are evaluated at a mean rise (Carslaw & Jaeger 1959, section 1.6).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flashtemp.model.effect_laws import EffectLaws
from flashtemp.model.scene import LawContext, Scene
from flashtemp.physics.arrays import Array
from flashtemp.physics.material import Material

MEAN_RISE_FRACTION = 0.7  # of the face's mean rise: the material behind a wall that cools is less warm


@dataclass(frozen=True)
class KirchhoffTransform:
    """Conduction laws of a scene's block as functions of the rise (...) in K above the air at the start."""

    scene: Scene
    laws: EffectLaws
    now: LawContext

    @classmethod
    def from_scene(cls, scene: Scene) -> KirchhoffTransform:
        first = scene.schedule.phases[0]
        return cls(scene, EffectLaws(scene), scene.law_context(first, first.begin))

    def conductivity_ratio(self, rise: Array) -> Array:
        """k/k0 (...) at a temperature rise."""
        if not self.laws.has_law("block.conductivity"):
            return np.ones_like(rise)
        return self.laws("block.conductivity", 1.0, self.now.ambient + rise, self.now) * np.ones_like(rise)

    @property
    def axial_conductivity_ratio(self) -> float:
        """Conductivity along x over that across it."""
        return float(self.laws("block.conductivity_along", 1.0, None, None))

    def theta(self, rise: Array) -> Array:
        """theta (...) in K of temperature rises, by Simpson's rule."""
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
        """Temperature rise (...) in K at which theta is smaller by `theta` (...) K than at the rise `warmer`."""
        # midpoint rule for the inverse: the deficit of a wall is small against its rise
        return warmer - theta / self.conductivity_ratio(warmer - 0.5 * theta)

    def mean_material(self, rise: Array, times: Array) -> tuple[Material, float]:
        """Block material of one diffusivity, and the factor rise/theta of its heat-transfer coefficients.

        Both hold at the mean over `times` (n,) in s of the face's `rise` (n, x) in K.
        """
        mean_rise = np.trapezoid(rise.mean(axis=1), times) / (times[-1] - times[0])
        level, block = np.array(MEAN_RISE_FRACTION * mean_rise), self.scene.block
        gradient = np.mean(self.laws("block.capacity_gradient", 0.0, None, None))
        capacity = self.laws("block.heat_capacity", 1.0 + gradient * level, self.now.ambient + level, None)
        film_factor = level / self.theta(level) if level else 1.0
        capacity_ratio = float(np.mean(capacity) / self.conductivity_ratio(level))
        return replace(block, heat_capacity=block.heat_capacity * capacity_ratio), float(film_factor)
