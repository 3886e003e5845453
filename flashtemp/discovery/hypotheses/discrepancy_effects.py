"""Effects of unknown origin as nuisances: friction scatter between repetitions, and pressure of any shape.

They belong to no catalogue.  Calibration estimates them with narrow priors.  If the data need them far larger, the
model lacks something: `adequacy_tests` compares their estimates with their usual sizes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from flashtemp.model.scene import ActiveEffect, Scene
from flashtemp.physics.effect import Effect, Factor, Term


class RepetitionFrictionScatter(Effect):
    """Friction of one repetition that differs from the others: mu (1 + size)."""

    def heat(self, scene: Any, p: Any) -> Iterator[Factor]:
        """Multiplies mu in repetition `number`."""
        yield Factor("friction.mu", lambda T, now, p: 1.0 + p.size * (now.repetition == p.number))


class PressureCosineMode(Effect):
    """Cosine of the nominal contact pressure along the block, constant or growing from repetition to repetition."""

    steady = True  # within a stretch, for which alone anything is kept

    def heat(self, scene: Any, p: Any) -> Iterator[Term]:
        """Adds size cos(number pi x/L) to local over mean pressure, times -1..1 over the repetitions for a trend."""
        last = scene.schedule.repetitions

        def law(T: Any, now: Any, p: Any) -> Any:
            grown = 2.0 * (now.repetition - 1) / max(last - 1, 1) - 1.0 if p.trend else 1.0
            return p.size * grown * np.cos(p.number * np.pi * now.x / scene.length)

        yield Term("contact.pressure", law)


def add_friction_scatter(scene: Scene, repetition: int, size: float) -> Scene:
    """The scene with friction higher by a share `size` in one repetition."""
    return _add_effect(scene, RepetitionFrictionScatter(), number=repetition, size=size)


def add_pressure_mode(scene: Scene, number: int, size: float, trend: bool = False) -> Scene:
    """The scene with a cosine of `number` half waves along the block added to its relative pressure."""
    return _add_effect(scene, PressureCosineMode(), number=number, size=size, trend=trend)


def _add_effect(scene: Scene, effect: Effect, **values: float) -> Scene:
    part = ActiveEffect(type(effect).__name__.lower(), effect, SimpleNamespace(**values))
    return replace(scene, acting=(*scene.acting, part))
