"""Identifiers of all estimated parameters: free keys, parameters of effects, nuisances of cameras and conditions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

ALL_CONDITIONS = -1  # in place of the number of a condition


class ParameterKind(StrEnum):
    """The kind of a parameter."""

    KEY = "key"  # of the case, freed by the campaign: ln of the factor on its value
    EFFECT = "effect"  # parameter of an effect
    SCATTER = "scatter"  # friction of one repetition, relative
    LEVEL = "level"  # friction of one condition, relative
    MODE = "mode"  # cosine of the pressure along the block, in all conditions
    TREND = "trend"  # the same, growing from repetition to repetition
    FLUX = "flux"  # cosine of the heat along the block in one condition
    MESH = "mesh"  # error of the mesh in one direction
    SHIFT_U = "shift_u"  # of a recording's image, px
    SHIFT_V = "shift_v"
    GAIN = "gain"  # of a recording's radiance, relative
    PLACE = "place"  # of a point of a recording along an axis, m
    LAG = "lag"  # time constant of a point of a recording, s
    SENSOR = "sensor"  # gain of a point of a recording on its temperature rise, relative
    ZERO = "zero"  # error that a point of a recording shows at any temperature, K
    COLD_JUNCTION = "cold_junction"  # error of the cold junction that all points of a device share, K
    SPREAD = "spread"  # width of a recording's optics, relative
    MAP = "map"  # smooth gain along and up a recording
    OFFSET = "offset"  # of a recording's image, in time
    STATIC = "static"  # smooth map of offsets of a recording, constant in time
    OPTICS = "optics"  # smear and stray light of a recording
    WALL = "wall"  # cooling of the wall against the section behind it
    MODEL_DISCREPANCY = "floor"  # smooth relative error of the model in a recording
    CELL = "cell"  # gain of the load cell, relative
    SCALE = "scale"  # of a recording's pixels, relative
    TURN = "turn"  # of a recording's image, rad
    CLOCK = "clock"  # delay of the time stamps of a recording, s
    SIZE = "size"  # of the block, relative: its length, its width
    INPUT = "input"  # stated number of case or camera, the same in all conditions: ln of the factor on it, or its unit


SHIFT_KINDS = (ParameterKind.SHIFT_U, ParameterKind.SHIFT_V)
PLACEMENT_KINDS = (ParameterKind.SCALE, ParameterKind.TURN, ParameterKind.CLOCK)
SETUP_KINDS = (*PLACEMENT_KINDS, ParameterKind.SIZE)
BEAD_KINDS = (ParameterKind.PLACE, ParameterKind.LAG)
ZERO_KINDS = (ParameterKind.ZERO, ParameterKind.COLD_JUNCTION)
POINT_KINDS = (*BEAD_KINDS, ParameterKind.SENSOR, *ZERO_KINDS)
CAMERA_ERROR_KINDS = (ParameterKind.OFFSET, ParameterKind.STATIC, ParameterKind.OPTICS)
RECORDING_KINDS = frozenset(
    {
        *SHIFT_KINDS,
        *PLACEMENT_KINDS,
        ParameterKind.GAIN,
        ParameterKind.SPREAD,
        ParameterKind.MAP,
        ParameterKind.WALL,
        ParameterKind.MODEL_DISCREPANCY,
        *CAMERA_ERROR_KINDS,
    }
)
CONDITION_KINDS = frozenset(
    {ParameterKind.SCATTER, ParameterKind.LEVEL, ParameterKind.TREND, ParameterKind.FLUX, ParameterKind.MESH}
)


@dataclass(frozen=True, order=True, slots=True)
class ParameterId:
    """Identifier of one parameter: hashable, sorted by its fields, written as text only in reports and files.

    `index` distinguishes parameters of a kind: the repetition, the half waves along (and up), the shape variant.
    `name`: a key of the case, a parameter of the `effect`, a point, or the view whose recordings share it.  `file` and
    `condition`: set if it acts in one recording or condition only.

    >>> print(ParameterId(ParameterKind.FLUX, (2,), condition=1), ParameterId.of_effect("pressure_tilt", "a"))
    flux:2|1 pressure_tilt.a
    """

    kind: ParameterKind
    index: tuple[int, ...] = ()
    effect: str = ""
    name: str = ""
    file: str = ""
    condition: int = ALL_CONDITIONS

    @classmethod
    def of_key(cls, key: str) -> ParameterId:
        """A free key of the case."""
        return cls(ParameterKind.KEY, name=key)

    @classmethod
    def of_input(cls, key: str) -> ParameterId:
        """A stated number of case or camera, by its key."""
        return cls(ParameterKind.INPUT, name=key)

    @classmethod
    def of_effect(cls, effect: str, name: str, variant: int = 0) -> ParameterId:
        """A parameter of an effect; with `variant` > 0 its column for that variant of the shapes."""
        return cls(ParameterKind.EFFECT, (variant,) if variant else (), effect, name)

    def with_scope(self, condition: int, file: str) -> ParameterId:
        """The parameter with the scope of its kind: one recording, one condition, or all."""
        if self.kind in RECORDING_KINDS or (self.kind in POINT_KINDS and not self.name):
            return replace(self, file=file)
        return replace(self, condition=condition) if self.kind in CONDITION_KINDS else self

    @property
    def is_shared(self) -> bool:
        """Whether it is common to all conditions and recordings."""
        return not self.file and self.condition == ALL_CONDITIONS

    @property
    def shift_axis(self) -> int:
        """0 for a shift along u, 1 along v."""
        return int(self.kind is ParameterKind.SHIFT_V)

    def __str__(self) -> str:
        if self.kind in (ParameterKind.KEY, ParameterKind.INPUT):
            return self.name
        if self.kind is ParameterKind.EFFECT:
            return f"{self.effect}.{self.name}" + "".join(f"@{n}" for n in self.index)
        where = self.file or self.name or (str(self.condition) if self.condition != ALL_CONDITIONS else "")
        return ":".join([self.kind, *map(str, self.index)]) + (f"|{where}" if where else "")


Prior = tuple[float, float]  # mean and standard deviation
Priors = dict[ParameterId, Prior]
