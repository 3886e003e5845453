"""A pointwise law that no catalogue has: a quantity over an argument, a line between nodes, as an effect file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from flashtemp.physics.own_effects import OwnEffect

NAME = "learned"
NODES, MOST = 5, 17  # of a law at first, and after closer looks
GIVEN = ("speed", "repetition")  # arguments of a few values
LARGEST = 3.0  # of the ln of a factor, either way
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Argument:
    """What a quantity may depend on: in `words`, its `unit`, and how a law says it."""

    name: str
    words: str
    unit: str
    code: str


@dataclass(frozen=True)
class Unknown:
    """A quantity that may follow a law which nobody wrote down, and the names of its `arguments`.

    `how` it acts: "factor" (the law is the ln of it), "term" or "film" (W/m2K), at `targets`; `size` of what is usual.
    """

    name: str
    words: str
    how: str
    targets: tuple[str, ...]
    arguments: tuple[str, ...]
    size: float
    unit: str = "1"

    @property
    def least(self) -> float:
        """Lowest value of the law: what resists or cools is not negative."""
        return {"factor": -LARGEST, "film": 0.0}.get(self.how, -np.inf if self.unit == "K" else 0.0)

    @property
    def most(self) -> float:
        return LARGEST if self.how == "factor" else 1e3 * self.size


ARGUMENTS = {
    a.name: a
    for a in (
        Argument("temperature", "the temperature of the contact", "degC", "T - KELVIN"),
        Argument("inside", "its own temperature", "degC", "T - KELVIN"),
        Argument("speed", "the sliding speed", "m/s", "now.speed"),
        Argument("pressure", "the local contact pressure", "Pa", "now.local_pressure"),
        Argument("place", "the place along the block", "m", "now.x"),
        Argument("slid", "the distance slid since the start", "m", "now.slid"),
        Argument("passed", "the distance slid in the whole test", "m", "now.passed"),
        Argument("time", "time", "s", "now.t"),
        Argument("repetition", "the number of the repetition", "1", "now.repetition"),
    )
}
WALLS = ("block.leading", "block.trailing", "block.sides")
UNKNOWNS = (
    Unknown("friction", "the friction coefficient", "factor", ("friction.mu",),
            ("temperature", "speed", "pressure", "slid", "passed", "time", "repetition", "place"), 0.3),
    Unknown("pressure", "the nominal contact pressure", "factor", ("contact.pressure",), ("place",), 0.3),
    Unknown("spot_fraction", "the macroasperity contact fraction", "factor", ("contact.spot_fraction",),
            ("pressure", "slid", "passed", "repetition"), 0.3),
    Unknown("resistance", "the thermal resistance of the contact", "term", ("contact.resistance",),
            ("speed", "pressure", "place", "slid", "passed", "time"), 2e-5, "m2K/W"),
    Unknown("rubber", "the thermal conductivity of the rubber", "factor", ("block.conductivity",), ("inside",), 0.3),
    Unknown("road", "the thermal conductivity of the road", "factor", ("road.conductivity",), ("inside",), 0.3),
    Unknown("air", "the temperature of the air", "term", ("ambient.temperature",), ("time",), 1.0, "K"),
    Unknown("walls", "what cools the walls of the block", "film", WALLS, ("speed", "time"), 20.0, "W/m2K"),
    Unknown("holder", "what the holder takes", "film", ("block.holder",), ("speed", "time"), 50.0, "W/m2K"),
)  # fmt: skip


@dataclass(frozen=True)
class Law:
    """A quantity over an argument: `values` (n,) at `nodes` (n,), ln of the factor or in the quantity's unit."""

    unknown: Unknown
    argument: Argument
    nodes: tuple[float, ...]
    values: tuple[float, ...]

    @property
    def words(self) -> str:
        return f"{self.unknown.words} changes with {self.argument.words}"

    @property
    def name(self) -> str:
        """Of its trial, one of many."""
        return f"{NAME}_{self.unknown.name}_{self.argument.name}"

    @property
    def finer(self) -> tuple[float, ...]:
        """Nodes with others half way between; the same where they are values that a campaign has, or enough."""
        if self.argument.name in GIVEN or len(self.nodes) >= MOST:
            return self.nodes
        between = [0.5 * (a + b) for a, b in pairwise(self.nodes)]
        return _rounded(np.sort([*self.nodes, *between]))

    def own(self, name: str = NAME) -> OwnEffect:
        """The effect file that holds it."""
        path = f"{name}.py"
        return OwnEffect(name, path, path, text(self))

    def weights(self, at: Array) -> Array:
        """What every node counts (len(at), n) at some values of the argument; the curve is level outside."""
        return np.array([np.interp(at, self.nodes, row) for row in np.eye(len(self.nodes))]).T

    def shown(self, values: Array) -> Array:
        """Values of the law as people read them: a factor, or in the unit of the quantity."""
        return np.exp(values) if self.unknown.how == "factor" else values


def spread(low: float, high: float, count: int = NODES, begins: bool = False) -> tuple[float, ...]:
    """Nodes of a law over a range; closer to the start where something `begins` there and wears off."""
    return _rounded(low + (high - low) * np.linspace(0.0, 1.0, count) ** (2 if begins else 1))


def given(values: Iterable[float]) -> tuple[float, ...]:
    """Nodes at values that a campaign has: all of them where they are few."""
    found = np.unique(np.round(np.asarray(list(values), float), 12))
    return _rounded(found if len(found) <= NODES else np.quantile(found, np.linspace(0.0, 1.0, NODES)))


def _rounded(nodes: Array) -> tuple[float, ...]:
    return tuple(float(f"{v:.6g}") for v in nodes)


def text(law: Law) -> str:
    """The effect file of a law.

    >>> law = Law(UNKNOWNS[0], ARGUMENTS["speed"], (0.1, 1.0), (0.0, -0.2))
    >>> print(text(law).splitlines()[0])
    \"\"\"The friction coefficient over the sliding speed, as measured temperatures want it: a line between nodes.
    """
    u, a = law.unknown, law.argument
    names = [f"at_{k + 1}" for k in range(len(law.nodes))]
    what = "ln of the factor" if u.how == "factor" else "value"
    unit = "1" if u.how == "factor" else u.unit
    high = f"{u.most:g}"
    low = "" if u.least == -np.inf else f"low={u.least:g}, "
    params = "\n".join(
        f'    {n} = Param({v:.5g}, "{unit}", "{what} at {at:.6g} {a.unit}", {low}high={high}, off=0.0)'
        for n, v, at in zip(names, law.values, law.nodes, strict=True)
    )
    curve = f"Curve(NODES, ({', '.join(f'p.{n}' for n in names)}))"
    imports = {"factor": "Effect, Factor, Param", "term": "Effect, Param, Term", "film": "Effect, Heat, Param"}[u.how]
    return TEXT.format(
        Words=u.words[0].upper() + u.words[1:],
        over=a.words,
        numpy="import numpy as np\n\n" if u.how == "factor" else "",
        imports=imports,
        kelvin="\nfrom flashtemp.physics.quantities import KELVIN" if "KELVIN" in a.code else "",
        numbers=", ".join(f"{n}=0.0" for n in names),
        nodes=repr(law.nodes),
        cause=law.words,
        params=params,
        laws=_laws(law, curve),
    )


def _laws(law: Law, curve: str) -> str:
    """The body of `heat`."""
    u, at = law.unknown, law.argument.code
    if u.how == "film":
        sites = ", ".join(f'"{s}"' for s in u.targets)
        return (f"        for site in ({sites},):\n"
                f"            yield Heat.film(site, lambda now, p: {curve}({at}))")  # fmt: skip
    kind, value = ("Factor", f"np.exp({curve}({at}))") if u.how == "factor" else ("Term", f"{curve}({at})")
    return f'        yield {kind}("{u.targets[0]}", lambda T, now, p: {value})'


TEXT = '''"""{Words} over {over}, as measured temperatures want it: a line between nodes.

>>> from types import SimpleNamespace as N
>>> parts = list(Learned().heat(None, N({numbers})))
>>> len(parts) > 0
True
"""

from __future__ import annotations

{numpy}from flashtemp.physics.effect import {imports}
from flashtemp.physics.interpolation import Curve{kelvin}

NODES = {nodes}


class Learned(Effect):
    """A line between values at nodes, level beyond the outermost."""

    cause = "{cause}"
    source = "learned from measured temperatures"
    tells = ("no member of the catalogue explains the data",)

{params}

    def heat(self, scene, p):
        """The law at work."""
{laws}
'''
