"""Effects: the base class, declared parameters, and the contributions that an effect file may yield.

An effect is a class in one file of `flashtemp/physics/effects`.  The class body declares parameters.  Its method `heat`
yields contributions, each a pointwise law on a named site or quantity.  At the value `off` of its parameter the effect
vanishes exactly: the extended model is then bit for bit the base model.
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

Law = Callable[..., Value]  # law(T, now, p): T in K, `now` a LawContext, `p` the effect's parameters
FilmLaw = Callable[..., Value]  # law(now, p): a heat-transfer coefficient, or the temperature that it acts to


class SceneView(Protocol):
    """The scene that `heat()` receives: lengths in m, `ambient` in K, `speeds` in m/s, `load` in Pa, `resolved` in 3D.

    Laws may also use its `mesh`, and `in_layer(name)`: which cells (n_block,) up the block belong to a layer.
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
    """A declared parameter: default `value`, `unit`, bounds, and the value `off` that switches the effect off.

    `kinds` lists the types that a case may give: "number", "text" (a file or a keyword), "table" (a law or a list).
    A parameter without `off` describes the effect (a depth, a period) and cannot switch it off; a fit may change it
    from its default by a factor `spread`.  `curved`: the law is flat at `off`, so that only a finite change of the
    parameter shows its effect.  `signed`: the bounds apply to the absolute value; negative values reverse the effect.
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
        if self.low > self.high:  # the reader of the effect file adds file and line
            raise ValueError(f"no number is >= {self.low:g} and <= {self.high:g}")

    def find_fault(self, value: Any) -> str | None:
        """The error text for a value from a case, None where the value is valid."""
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
    """Heat on a site: `patch` in W/m2 into the body, `film` (convection), or `zone` in W/m3; `to` is the ledger.

    `law(T, now, p)`: T in K at the site's points, `now` the LawContext, `p` the effect's parameters.
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
        """Convection: heat-transfer coefficient `coefficient(now, p)` in W/m2K, inf for a fixed temperature.

        It acts to the ambient temperature, or to `far(now, p)` in K where that is given.
        """
        return cls("film", site, coefficient, to, far)

    @classmethod
    def zone(cls, site: str, law: Law, to: str = "air") -> Heat:
        """Volumetric heat in "block" or "road", W/m3."""
        return cls("zone", site, law, to)


@dataclass(frozen=True)
class Factor:
    """A law that multiplies a quantity of the heat balance, such as "friction.mu"; 1 leaves it unchanged."""

    target: str
    law: Law


@dataclass(frozen=True)
class Term:
    """A law that adds to a quantity of the heat balance, in that quantity's unit; 0 leaves it unchanged."""

    target: str
    law: Law


@dataclass(frozen=True)
class Deposit:
    """A fraction `share` of the friction heat, released inside the rubber as exp(-z/depth), `depth` in m; eq. (6)."""

    share: float
    depth: float


class Effect:
    """One cause of heat or of change in heat; subclasses declare parameters and yield laws."""

    cause: ClassVar[str] = ""
    source: ClassVar[str] = ""
    tells: ClassVar[tuple[str, ...]] = ()
    alike: ClassVar[str | None] = None  # an effect with the same signature: `discover` tries only that one
    candidate: ClassVar[bool] = False  # `discover` tries it by default; else only where a case or campaign lists it
    section: ClassVar[str | None] = None  # table of the case that base effects have in common
    base: ClassVar[bool] = False  # base effects always act
    needs: ClassVar[str] = ""  # precondition without which it cannot act, in words
    uniform: ClassVar[bool] = False  # assumes a block of one material: rejected for a block with layers
    steady: ClassVar[bool] = False  # its influence on the contact depends on place and pressure only

    @classmethod
    def params(cls) -> dict[str, Param]:
        """Declared parameters by name, in the order of the file."""
        return {k: v for k, v in vars(cls).items() if isinstance(v, Param)}

    @classmethod
    def prepare(cls, values: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Convert values of a case to the objects that the laws use, such as tables from files.  Raises BadInput."""
        return values

    def heat(self, scene: SceneView, p: Any) -> Iterator[Heat | Factor | Term | Deposit]:
        """Contributions to the heat balance of `scene`.

        Called more than once: first with the scene's dimensions, without `scene.mesh`, because the mesh depends on how
        deep heat is released; then with the scene itself.  Laws may use the mesh, this method may not.
        """
        return iter(())

    def remarks(self, scene: SceneView, p: Any, run: Any = None) -> list[str]:
        """Warnings about the validity of the result `run`, one sentence each."""
        return []

    def leave(self, scene: SceneView, p: Any, folder: Path) -> None:
        """Write files into a result folder that save work when the run is repeated from there."""

    def see(self, p: Any) -> Iterator[Factor | Term]:
        """Contributions to the measurement of temperatures by a camera."""
        return iter(())


def layer_param(about: str) -> Param:
    """The parameter by which a case restricts an effect to one layer of the block."""
    return Param(None, "1", f"name of a layer of the block: {about}", kinds=("name",))


def require_layer(scene: SceneView, name: str | None, key: str) -> str | None:
    """Return `name`, checked to be a layer of the block or None.  Raises BadInput."""
    known = [layer.name for layer in scene.layers]
    if name is not None and name not in known:
        raise BadInput(
            f"{key}: the block has no layer {name!r}{suggest_name(name, known)}; leave the key out, or add the layer"
        )
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
    """The only effect that a module defines.  Raises BadInput when it defines none, or several."""
    kinds = [
        k
        for k in vars(module).values()
        if isinstance(k, type) and issubclass(k, Effect) and k.__module__ == module.__name__
    ]
    kinds = list(dict.fromkeys(kinds))  # one class under two names is one effect
    if not kinds:
        raise BadInput(f"{module.__file__}:1: contains no effect; write one class that is derived from Effect")
    if len(kinds) > 1:
        try:
            line = inspect.getsourcelines(kinds[1])[1]
        except OSError:  # the source text is not available
            line = 1
        names = " and ".join(k.__name__ for k in kinds)
        raise BadInput(f"{module.__file__}:{line}: contains {len(kinds)} effects, {names}; give each a file of its own")
    return kinds[0]


def find_effect(name: str) -> type[Effect]:
    """The effect of that name.  Raises BadInput, which suggests the closest known name."""
    known = catalogue()
    if name not in known:
        raise BadInput(f"effect '{name}' is not in the catalogue{suggest_name(name, known)}")
    return known[name]


__getattr__ = renamed_names(
    __name__,
    {"layer_of": "layer_param", "among": "require_layer", "only_effect": "find_only_effect", "find": "find_effect"},
)  # of earlier releases
