"""Names of everything that may move: free keys, parameters of effects, and the nuisances of cameras and conditions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

ALL_CONDITIONS = -1  # conditions: what they share


class Kind(StrEnum):
    """What a parameter is."""

    KEY = "key"  # of the case, freed by the campaign: ln of the factor on its value
    EFFECT = "effect"  # parameter of an effect
    SCATTER = "scatter"  # friction of one repetition, relative
    LEVEL = "level"  # friction of one condition, relative
    MODE = "mode"  # cosine of the pressure along the block, in all conditions
    TREND = "trend"  # the same, growing from repetition to repetition
    FLUX = "flux"  # cosine of the heat along the block in one condition
    MESH = "mesh"  # difference to a coarser mesh
    SHIFT_U = "shift_u"  # of a recording's image, px
    SHIFT_V = "shift_v"
    GAIN = "gain"  # of a recording's radiance, relative
    PLACE = "place"  # of a point of a recording along an axis, m
    LAG = "lag"  # time constant of a point of a recording, s
    SENSOR = "sensor"  # gain of a point of a recording: of the rise that it shows, relative
    SPREAD = "spread"  # width of a recording's optics, relative
    MAP = "map"  # smooth gain along and up a recording
    OFFSET = "offset"  # of a recording's image, in time
    STATIC = "static"  # smooth map of offsets of a recording that stays
    OPTICS = "optics"  # smear and stray light of a recording
    WALL = "wall"  # cooling of the wall against the section behind it
    FLOOR = "floor"  # smooth relative error of the model itself in a recording
    CELL = "cell"  # gain of the load cell, relative
    SCALE = "scale"  # of a recording's pixels, relative
    TURN = "turn"  # of a recording's image, rad
    CLOCK = "clock"  # what the frames of a recording are stamped late, s
    SIZE = "size"  # of the block, relative: its length, its width
    INPUT = "input"  # stated number of case or camera, the same in all conditions: ln of the factor on it, or its unit


SHIFT_KINDS = (Kind.SHIFT_U, Kind.SHIFT_V)
PLACEMENT_KINDS = (Kind.SCALE, Kind.TURN, Kind.CLOCK)
SETUP_KINDS = (*PLACEMENT_KINDS, Kind.SIZE)
BEAD_KINDS = (Kind.PLACE, Kind.LAG)
POINT_KINDS = (*BEAD_KINDS, Kind.SENSOR)
CAMERA_ERROR_KINDS = (Kind.OFFSET, Kind.STATIC, Kind.OPTICS)
RECORDING_KINDS = frozenset(
    {*SHIFT_KINDS, *PLACEMENT_KINDS, Kind.GAIN, Kind.SPREAD, Kind.MAP, Kind.WALL, Kind.FLOOR, *CAMERA_ERROR_KINDS}
)
CONDITION_KINDS = frozenset({Kind.SCATTER, Kind.LEVEL, Kind.TREND, Kind.FLUX, Kind.MESH})


@dataclass(frozen=True, order=True, slots=True)
class ParameterId:
    """One parameter: hashable, sorted by its fields, written as text only for people and files.

    `index` tells those of a kind apart: the repetition, the half waves along (and up), the set of shapes of a trace.
    `name` is a key of the case, a parameter of the `effect`, a point or the view whose recordings share it; `file` and
    `condition` say where alone it acts.

    >>> print(ParameterId(Kind.FLUX, (2,), condition=1), ParameterId.of_effect("pressure_tilt", "a"))
    flux:2|1 pressure_tilt.a
    """

    kind: Kind
    index: tuple[int, ...] = ()
    effect: str = ""
    name: str = ""
    file: str = ""
    condition: int = ALL_CONDITIONS

    @classmethod
    def of_key(cls, key: str) -> ParameterId:
        """A free key of the case."""
        return cls(Kind.KEY, name=key)

    @classmethod
    def of_input(cls, key: str) -> ParameterId:
        """A stated number of case or camera, by its key."""
        return cls(Kind.INPUT, name=key)

    @classmethod
    def of_effect(cls, effect: str, name: str, variant: int = 0) -> ParameterId:
        """A parameter of an effect; its trace with the shapes of a `variant` beyond the first."""
        return cls(Kind.EFFECT, (variant,) if variant else (), effect, name)

    def with_scope(self, condition: int, file: str) -> ParameterId:
        """The same where it belongs: to a recording, to a condition, or to all."""
        if self.kind in RECORDING_KINDS or (self.kind in POINT_KINDS and not self.name):
            return replace(self, file=file)
        return replace(self, condition=condition) if self.kind in CONDITION_KINDS else self

    @property
    def is_shared(self) -> bool:
        """Whether all conditions and recordings share it."""
        return not self.file and self.condition == ALL_CONDITIONS

    @property
    def shift_axis(self) -> int:
        """0 for a shift along u, 1 along v."""
        return int(self.kind is Kind.SHIFT_V)

    def __str__(self) -> str:
        if self.kind in (Kind.KEY, Kind.INPUT):
            return self.name
        if self.kind is Kind.EFFECT:
            return f"{self.effect}.{self.name}" + "".join(f"@{n}" for n in self.index)
        where = self.file or self.name or (str(self.condition) if self.condition != ALL_CONDITIONS else "")
        return ":".join([self.kind, *map(str, self.index)]) + (f"|{where}" if where else "")


Prior = tuple[float, float]  # mean and standard deviation
Priors = dict[ParameterId, Prior]
