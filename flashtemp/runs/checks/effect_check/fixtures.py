"""Small scenes with one effect under test; every run is computed once."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.model import build, case_file
from flashtemp.model.case_file import KeyLocations
from flashtemp.model.numerics import SolverSettings, read_settings
from flashtemp.model.scene import ActiveEffect, Scene
from flashtemp.physics.effect import Effect, catalogue
from flashtemp.solver.run import Run
from flashtemp.solver.time_integration import integrate_schedule

SMALL_CASE = {  # heat reaches the back of the thin block; two repetitions are longer than one lap
    "block.height": 0.002,
    "road.track_length": 0.15,
    "schedule.distance": 0.2,
    "schedule.repetitions": 2,
    "schedule.wait": 1.0,
    "numerics.cells": [8, 8, 8],
    "output.profiles": 6,
}
CASE_SHAPES: dict[str, dict[str, Any]] = {  # lifted or resting while waiting; with cells across
    "lifted": {},
    "resting": {"schedule.lifted": False},
    "3D": {"numerics.across": 3, "ambient.road_sides": 30.0},
}
ALL_EFFECTS_CASE = {  # values with which every base effect acts
    "contact.alpha": 2e4,
    "contact.heat_split": 0.7,
    "contact.spot_exponent": 0.7,
    "contact.gap_coefficient": 30.0,
    "friction.volumetric_share": 0.3,
}


@dataclass(frozen=True)
class EffectUnderTest:
    """An effect under test, by name and class; `values` {"table.key": value} that it requires."""

    name: str
    effect: type[Effect]
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def module(self) -> ModuleType:
        """The module that defines the effect."""
        return sys.modules[self.effect.__module__]

    @property
    def file(self) -> Path:
        """The file that defines the effect."""
        return Path(str(self.module.__file__))

    @property
    def has_heat(self) -> bool:
        """Whether the effect acts on the heat balance; other effects act on the camera image only."""
        return self.effect.heat is not Effect.heat

    def off_values(self) -> dict[str, float]:
        """The neutral values of all parameters that have one, as {"table.key": value}."""
        table = self.effect.section or self.name
        return {f"{table}.{k}": p.off for k, p in self.effect.params().items() if p.off is not None}

    @property
    def own_values(self) -> dict[str, Any]:
        """Values of the table of the effect, by key."""
        return {k.split(".", 1)[1]: v for k, v in self.values.items() if k.startswith(f"{self.name}.")}

    @property
    def other_values(self) -> dict[str, Any]:
        """Values of all other tables, {"table.key": value}."""
        return {k: v for k, v in self.values.items() if not k.startswith(f"{self.name}.")}


class SceneCache:
    """Scenes and runs with an effect under test, computed once; file names are relative to `folder`."""

    def __init__(self, folder: Path = Path()):
        self.folder = folder
        self._runs: dict[tuple, Run] = {}

    def build_scene_settings(
        self, trial: EffectUnderTest | None, added_effects=(), values: Mapping[str, Any] | None = None
    ) -> tuple[Scene, SolverSettings]:
        """The small scene with the effect under test, `added_effects` and changed `values`.  Raises BadInput."""
        known = catalogue() | ({trial.name: trial.effect} if trial else {})
        names = [trial.name] if trial and not trial.effect.base else []
        own = dict(trial.values) if trial else {}
        where = KeyLocations("the small case", by="--check")
        raw = case_file.merge_overrides(
            {}, SMALL_CASE | {"effects": [*added_effects, *names]} | own | dict(values or {}), where.by
        )
        reader = case_file.CaseReader(known, where)
        listed = reader.read_effect_names(raw, "effects", list(known)) or ()
        tables = reader.read_values(raw, listed, ())
        if reader.faults:
            raise BadInput(*reader.faults)
        acting = {n: e for n, e in known.items() if e.base or n in listed}
        return build.build_scene(tables, acting, self.folder), read_settings(tables)

    def build_scene(
        self, trial: EffectUnderTest | None, added_effects=(), values: Mapping[str, Any] | None = None
    ) -> Scene:
        """The small scene.  Raises BadInput."""
        return self.build_scene_settings(trial, added_effects, values)[0]

    def run(self, trial: EffectUnderTest | None, added_effects=(), values: Mapping[str, Any] | None = None) -> Run:
        """The run of the small scene, computed once.  Raises BadInput, SolverFailure."""
        identity = (trial.name, trial.effect, repr(sorted(trial.values.items()))) if trial else None
        key = (identity, tuple(added_effects), repr(sorted((values or {}).items())))
        if key not in self._runs:
            self._runs[key] = integrate_schedule(*self.build_scene_settings(trial, added_effects, values))
        return self._runs[key]

    def run_without(self, trial: EffectUnderTest, values: Mapping[str, Any]) -> Run:
        """The run of the small scene without the effect under test, otherwise the same."""
        return self.run(None, values=trial.other_values | dict(values))


def make_acting(trial: EffectUnderTest, own_values: Mapping[str, Any], folder: Path) -> ActiveEffect:
    """The effect under test with values of its own keys, the other keys at their defaults.  Raises BadInput."""
    values = {k: p.value for k, p in trial.effect.params().items()} | dict(own_values)
    return ActiveEffect(trial.name, trial.effect(), SimpleNamespace(**trial.effect.prepare(values, folder)))
