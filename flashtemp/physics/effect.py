"""The whole contract of an effect: a pointwise law on a named site, with declared parameters.

An effect is a class in one file of `flashtemp/effects`.  Its body declares parameters; its method
`heat` yields contributions.  `off` is the value of a parameter at which the effect vanishes exactly,
so that the extended model is then bit for bit the base.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from math import inf
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Protocol

from flashtemp.errors import BadInput, RenamedAttribute, renamed_names, suggest_name
from flashtemp.physics.arrays import Value
from flashtemp.physics.material import Layer, Material

Law = Callable[..., Value]  # law(T, now, p): T in K, `now` the moment, `p` the effect's parameters
FilmLaw = Callable[..., Value]  # law(now, p)


class SceneView(Protocol):
    """What `heat()` may ask of a scene: lengths in m, `ambient` in K, `speeds` m/s, `load` Pa; `resolved` in 3D.

    Laws may ask for its `mesh` too, and `in_layer(name)` for the cells (n_block,) up the block that are of a layer.
    """

    @property
    def block(self) -> Material: ...
    @property
    def road(self) -> Material: ...
    @property
    def schedule(self) -> Any: ...
    @property
    def ambient(self) -> float: ...
    @property
    def length(self) -> float: ...
    @property
    def width(self) -> float: ...
    @property
    def height(self) -> float: ...
    @property
    def spot_diameter(self) -> float: ...
    @property
    def spot_fraction(self) -> float: ...
    @property
    def track_length(self) -> float | None: ...
    @property
    def stiffness(self) -> float: ...
    @property
    def speeds(self) -> tuple[float, float]: ...
    @property
    def load(self) -> float: ...
    @property
    def resolved(self) -> bool: ...
    @property
    def layers(self) -> tuple[Layer, ...]: ...


@dataclass(frozen=True)
class Param:
    """A declared parameter: default `value`, `unit`, bounds, and the value `off` that does nothing.

    `kinds` says what a case may give: "number", "text" (a file or a keyword), "table" (a law or a
    list).  A parameter without `off` describes the effect (a depth, a period) and cannot switch it; where it
    is fitted it may differ from its default by a factor `spread`.  `curved`: the law is flat at `off`, so that
    only the whole strength shows what it does.  `signed`: the bounds are those of its size, negative values turn it.
    """

    value: Any
    unit: str
    about: str
    low: float = -inf
    high: float = inf
    off: float | None = None
    open_low: bool = False
    spread: float = 1.0
    curved: bool = False
    signed: bool = False
    kinds: tuple[str, ...] = ("number",)

    def __post_init__(self) -> None:
        if self.low > self.high:  # told with its line where the class is read
            raise ValueError(f"no number is >= {self.low:g} and <= {self.high:g}")

    def find_fault(self, value: Any) -> str | None:
        """What is wrong with a number from a case, or None."""
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return f"give a number ({self.unit})" if self.unit not in ("", "1") else "give a number"
        if isinstance(value, int) and abs(value) > sys.float_info.max:
            return f"give a number of at most {sys.float_info.max:.2g}"
        size = abs(value) if self.signed else value
        below = size < self.low or (self.open_low and size == self.low)
        if value != value or below or size > self.high:
            sign = ">" if self.open_low else ">="
            upper = f" and <= {self.high:g}" if self.high < inf else ""
            lower = f"{sign} {self.low:g}" if self.low > -inf else ""
            unit = f" ({self.unit})" if self.unit not in ("", "1") else ""
            turned = ", or its negative" if self.signed else ""
            return f"give a number {lower}{upper}{unit}{turned}"
        return None

    fault = RenamedAttribute("find_fault")


@dataclass(frozen=True)
class Heat:
    """Heat on a site: `patch` in W/m2 into the body, `film`, or `zone` in W/m3; `to` is the ledger.

    `law(T, now, p)`: T in K at the site's points, `now` the moment, `p` the effect's parameters.
    """

    kind: str
    site: str
    law: Law
    to: str = "air"
    far: FilmLaw | None = None

    @classmethod
    def patch(cls, site: str, law: Law, to: str = "air") -> Heat:
        """Flux into the body through a named patch of the mesh, W/m2."""
        return cls("patch", site, law, to)

    @classmethod
    def film(cls, site: str, coefficient: FilmLaw, to: str = "air", far: FilmLaw | None = None) -> Heat:
        """Convective film: `coefficient(now, p)` in W/m2K, inf for a fixed temperature.

        The far temperature is the ambient one unless `far(now, p)` gives another, K.
        """
        return cls("film", site, coefficient, to, far)

    @classmethod
    def zone(cls, site: str, law: Law, to: str = "air") -> Heat:
        """Volumetric heat in "block" or "road", W/m3."""
        return cls("zone", site, law, to)


@dataclass(frozen=True)
class Factor:
    """A law that multiplies a quantity of the balance, such as "friction.mu"; 1 does nothing."""

    target: str
    law: Law


@dataclass(frozen=True)
class Term:
    """A law that adds to a quantity of the balance, in that quantity's unit; 0 does nothing."""

    target: str
    law: Law


@dataclass(frozen=True)
class Deposit:
    """A share of the friction heat released inside the rubber, decaying as exp(-z/depth), m."""

    share: float
    depth: float


class Effect:
    """One cause of heat or of change in heat; subclasses declare parameters and yield laws."""

    cause: ClassVar[str] = ""
    source: ClassVar[str] = ""
    tells: ClassVar[tuple[str, ...]] = ()
    alike: ClassVar[str | None] = None  # an effect that looks the same: `discover` tries that one only
    candidate: ClassVar[bool] = False  # `discover` tries it unasked; else only where a case or campaign names it
    section: ClassVar[str | None] = None  # base effects share a table of the case
    base: ClassVar[bool] = False  # base effects always act
    needs: ClassVar[str] = ""  # without which it cannot act, for people
    uniform: ClassVar[bool] = False  # takes the block for one material: refused where it has layers
    steady: ClassVar[bool] = False  # what it does to the contact changes with nothing but place and pressure

    @classmethod
    def params(cls) -> dict[str, Param]:
        """Declared parameters by name, in the order of the file."""
        return {k: v for k, v in vars(cls).items() if isinstance(v, Param)}

    @classmethod
    def prepare(cls, values: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Case values turned into what the laws use, such as tables read; raises BadInput."""
        return values

    def heat(self, scene: SceneView, p: Any) -> Iterator[Heat | Factor | Term | Deposit]:
        """Contributions to the balance of `scene`.

        Asked more than once: first on an outline of the scene without `scene.mesh`, as the mesh follows from how deep
        heat is released; then on the scene itself.  Laws may use the mesh, this method may not.
        """
        return iter(())

    def remarks(self, scene: SceneView, p: Any, run: Any = None) -> list[str]:
        """What a user should know before believing the result `run`."""
        return []

    def leave(self, scene: SceneView, p: Any, folder: Path) -> None:
        """Write into a result folder what spares work when the run is repeated from there."""

    def see(self, p: Any) -> Iterator[Factor | Term]:
        """Contributions to what a camera makes of the temperatures."""
        return iter(())


def layer_param(about: str) -> Param:
    """The key by which an effect is told of one layer of the block."""
    return Param(None, "1", f"name of a layer of the block: {about}", kinds=("name",))


def require_layer(scene: SceneView, name: str | None, key: str) -> str | None:
    """The name that a key gives, if it is that of a layer of the block.  Raises BadInput."""
    known = [layer.name for layer in scene.layers]
    if name is not None and name not in known:
        raise BadInput(f"{key}: {name!r} is no layer of the block{suggest_name(name, known)}; leave it out, or add it")
    return name


@cache
def catalogue() -> dict[str, type[Effect]]:
    """All effects by name (the name of their file), base effects first.

    >>> catalogue()["friction"].base
    True
    """
    package = importlib.import_module("flashtemp.physics.effects")
    found = {}
    for info in sorted(pkgutil.iter_modules(package.__path__), key=lambda i: i.name):
        found[info.name] = find_only_effect(importlib.import_module(f"flashtemp.physics.effects.{info.name}"))
    return dict(sorted(found.items(), key=lambda item: (not item[1].base, item[0])))


def find_only_effect(module: ModuleType) -> type[Effect]:
    """The one effect that a module defines.  Raises BadInput when it defines none, or several."""
    kinds = [
        k
        for k in vars(module).values()
        if isinstance(k, type) and issubclass(k, Effect) and k.__module__ == module.__name__
    ]
    kinds = list(dict.fromkeys(kinds))  # one class under two names is one effect
    if not kinds:
        raise BadInput(f"{module.__file__}:1: holds no effect; write one class that is derived from Effect")
    if len(kinds) > 1:
        try:
            line = inspect.getsourcelines(kinds[1])[1]
        except OSError:  # the text is not there, or does not show it
            line = 1
        names = " and ".join(k.__name__ for k in kinds)
        raise BadInput(f"{module.__file__}:{line}: holds {len(kinds)} effects, {names}; give each a file of its own")
    return kinds[0]


def find_effect(name: str) -> type[Effect]:
    """The effect of that name; BadInput names the nearest known one."""
    known = catalogue()
    if name not in known:
        raise BadInput(f"effect '{name}' is not in the catalogue{suggest_name(name, known)}")
    return known[name]


__getattr__ = renamed_names(
    __name__,
    {"layer_of": "layer_param", "among": "require_layer", "only_effect": "find_only_effect", "find": "find_effect"},
)  # of earlier releases
