"""Free-form laws: a quantity of the heat balance as a piecewise-linear function of one regressor.

A law outside the catalogue is written as an effect file, whose parameters are the values at the nodes.  A linear
spline is the simplest curve that can follow any law, and its parameters can be read off a plot.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from flashtemp.discovery.hypotheses.candidates import CONTACT_TARGETS
from flashtemp.model.scene import Scene
from flashtemp.physics.arrays import Array
from flashtemp.physics.user_effects import UserEffect
from flashtemp.solver.run import Run

Runs = Sequence[Run]  # of the conditions of a campaign, and their scenes
Scenes = Sequence[Scene]
LEARNED_LAW_NAME = "learned"
INITIAL_LAW_NODES, MAX_LAW_NODES = 5, 17  # number of nodes at first, and from which a law is not refined further
MAX_LN_FACTOR = 3.0  # largest ln of a factor on a quantity, up or down
MAX_SIZE_RATIO = 1e3  # of a term or a heat-transfer coefficient, to its typical size
DISCRETE_REGRESSORS = ("speed", "repetition")  # a campaign has few values of these: each is a node
MIN_RELATIVE_RANGE = 0.05  # of a regressor: below, the data cannot show that anything depends on it
MIN_TEMPERATURE_RANGE_K = 2.0


@dataclass(frozen=True)
class Regressor:
    """A variable that a quantity may depend on: its `description`, its `unit`, and its `code` in an effect file."""

    name: str
    description: str
    unit: str
    code: str


@dataclass(frozen=True)
class LearnableQuantity:
    """A quantity of the heat balance that may follow an unknown law of one of its `regressors` (names).

    `action`: "factor" (the law is the ln of a factor), "term" (in `unit`) or "film" (heat-transfer coefficient, W/m2K),
    at `targets`, which are quantities or sites of the engine.  `typical_size`: standard deviation of usual values.
    `layer`: name of the layer of the block to which the law applies, None if it is not of one layer.
    """

    name: str
    description: str
    action: str
    targets: tuple[str, ...]
    regressors: tuple[str, ...]
    typical_size: float
    unit: str = "1"
    layer: str | None = None

    @property
    def lower_bound(self) -> float:
        """Lowest value at a node: a resistance or a heat-transfer coefficient is not negative."""
        return {"factor": -MAX_LN_FACTOR, "film": 0.0}.get(self.action, -np.inf if self.unit == "K" else 0.0)

    @property
    def upper_bound(self) -> float:
        """Highest value at a node."""
        return MAX_LN_FACTOR if self.action == "factor" else MAX_SIZE_RATIO * self.typical_size


REGRESSORS = {
    r.name: r
    for r in (
        Regressor("temperature", "the temperature of the contact", "degC", "T - KELVIN"),
        Regressor("inside", "its own temperature", "degC", "T - KELVIN"),
        Regressor("wall", "the temperature of the wall", "degC", "T - KELVIN"),
        Regressor("speed", "the sliding speed", "m/s", "now.speed"),
        Regressor("pressure", "the local contact pressure", "Pa", "now.local_pressure"),
        Regressor("place", "the place along the block", "m", "now.x"),
        Regressor("track", "the place on the track", "m", "now.passed % TRACK"),
        Regressor("slid", "the distance slid since the start", "m", "now.slid"),
        Regressor("passed", "the distance slid in the whole test", "m", "now.passed"),
        Regressor("time", "time", "s", "now.t"),
        Regressor("repetition", "the number of the repetition", "1", "now.repetition"),
    )
}
WALL_SITES, HOLDER_SITES = ("block.leading", "block.trailing", "block.sides"), ("block.holder",)
LEARNABLE_QUANTITIES = (
    LearnableQuantity(
        "friction", "the friction coefficient", "factor", ("friction.mu",),
        ("temperature", "speed", "pressure", "slid", "passed", "time", "repetition", "place", "track"), 0.3,
    ),
    LearnableQuantity("pressure", "the nominal contact pressure", "factor", ("contact.pressure",), ("place",), 0.3),
    LearnableQuantity(
        "spot_fraction", "the macroasperity contact fraction", "factor", ("contact.spot_fraction",),
        ("pressure", "slid", "passed", "repetition", "track"), 0.3,
    ),
    LearnableQuantity(
        "resistance", "the thermal resistance of the contact", "term", ("contact.resistance",),
        ("speed", "pressure", "place", "slid", "passed", "time", "repetition", "track"), 2e-5, "m2K/W",
    ),
    LearnableQuantity(
        "block", "the thermal conductivity of the block", "factor", ("block.conductivity",), ("inside",), 0.3,
    ),
    LearnableQuantity(
        "road", "the thermal conductivity of the road", "factor", ("road.conductivity",), ("inside",), 0.3,
    ),
    LearnableQuantity(
        "block_capacity", "the heat capacity of the block", "factor", ("block.heat_capacity",), ("inside",), 0.3,
    ),
    LearnableQuantity(
        "road_capacity", "the heat capacity of the road", "factor", ("road.heat_capacity",), ("inside",), 0.3,
    ),
    LearnableQuantity("air", "the temperature of the air", "term", ("ambient.temperature",), ("time",), 1.0, "K"),
    LearnableQuantity(
        "walls", "the heat-transfer coefficient of the walls", "film", WALL_SITES, ("speed", "time", "wall"), 20.0,
        "W/m2K",
    ),
    LearnableQuantity(
        "holder", "the heat-transfer coefficient of the holder", "film", HOLDER_SITES, ("speed", "time", "wall"), 50.0,
        "W/m2K",
    ),
)  # fmt: skip
MATERIAL_TARGETS = {  # of the block: short name and description for a law of one of its layers
    "block.conductivity": ("conductivity", "the thermal conductivity"),
    "block.heat_capacity": ("capacity", "the heat capacity"),
}


def learnable_quantities(scenes: Scenes) -> Iterator[LearnableQuantity]:
    """The quantities that may follow an unknown law in the scenes of a campaign.

    Where the block has layers, each layer has its own conductivity and heat capacity in place of the block's.  Where
    the block never meets a road, laws of the contact are left out.
    """
    alone, layers = all(s.schedule.alone for s in scenes), scenes[0].layers
    for quantity in LEARNABLE_QUANTITIES:
        target = quantity.targets[0]
        if alone and target.startswith(CONTACT_TARGETS):
            continue
        if len(layers) < 2 or target not in MATERIAL_TARGETS:
            yield quantity
            continue
        short, description = MATERIAL_TARGETS[target]
        for n, layer in enumerate(layers):
            name, words = f"layer_{n + 1}_{short}", f"{description} of layer {_sanitise_name(layer.name)}"
            yield replace(quantity, name=name, description=words, layer=layer.name)


def _sanitise_name(name: str) -> str:
    """A name from a case in text that becomes source code: no quotes, backslashes or line breaks."""
    return re.sub(r"[^\w .,+-]", "_", name)


@dataclass(frozen=True)
class PiecewiseLinearLaw:
    """A quantity over a regressor: `values` (n,) at `nodes` (n,), ln of the factor or in the quantity's unit.

    The law is constant beyond the outermost nodes.  With a `period` (in the regressor's unit) it is periodic: the first
    node returns one period later.
    """

    quantity: LearnableQuantity
    regressor: Regressor
    nodes: tuple[float, ...]
    values: tuple[float, ...]
    period: float | None = None

    @property
    def description(self) -> str:
        """The law in words."""
        return f"{self.quantity.description} changes with {self.regressor.description}"

    @property
    def name(self) -> str:
        """Name of the effect while the law is one of many candidates."""
        return f"{LEARNED_LAW_NAME}_{self.quantity.name}_{self.regressor.name}"

    @property
    def domain(self) -> tuple[float, float]:
        """Lowest and highest value of the regressor for which the law has nodes."""
        first = self.nodes[0]
        return first, self.nodes[-1] if self.period is None else first + self.period

    @property
    def refined_nodes(self) -> tuple[float, ...]:
        """The nodes with midpoints added; unchanged for a discrete regressor or MAX_LAW_NODES."""
        if self.regressor.name in DISCRETE_REGRESSORS or len(self.nodes) >= MAX_LAW_NODES:
            return self.nodes
        ends = self.nodes if self.period is None else (*self.nodes, self.domain[1])
        return _round_nodes(np.sort([*self.nodes, *(0.5 * (a + b) for a, b in pairwise(ends))]))

    def as_effect(self, name: str = LEARNED_LAW_NAME) -> UserEffect:
        """The law as an effect file of a case."""
        path = f"{name}.py"
        return UserEffect(name, path, path, effect_source(self))

    def hat_functions(self, at: Array) -> Array:
        """The weight (len(at), n) of every node at values of the regressor."""
        rows = np.eye(len(self.nodes))
        return np.array([np.interp(at, self.nodes, row, period=self.period) for row in rows]).T

    def to_display(self, values: Array) -> Array:
        """Values of the law for reports: a factor, or in the unit of the quantity."""
        return np.exp(values) if self.quantity.action == "factor" else values


def graded_nodes(low: float, high: float, count: int = INITIAL_LAW_NODES, decays: bool = False) -> tuple[float, ...]:
    """Nodes over a range: evenly spaced, or closer to the start for a law that `decays` from there."""
    return _round_nodes(low + (high - low) * np.linspace(0.0, 1.0, count) ** (2 if decays else 1))


def nodes_at_values(values: Iterable[float]) -> tuple[float, ...]:
    """Nodes at the values of a campaign: at all of them, or at quantiles where they are many."""
    distinct = np.unique(np.round(np.asarray(list(values), float), 12))
    few = len(distinct) <= INITIAL_LAW_NODES
    return _round_nodes(distinct if few else np.quantile(distinct, np.linspace(0.0, 1.0, INITIAL_LAW_NODES)))


def _round_nodes(nodes: Array) -> tuple[float, ...]:
    """Nodes as they are written in a file."""
    return tuple(float(f"{v:.6g}") for v in nodes)


# --- positions of nodes -------------------------------------------------------------------------------------------
def candidate_laws(runs: Runs, scenes: Scenes) -> Iterator[PiecewiseLinearLaw]:
    """All pairs of a quantity and a regressor that varies in a campaign, with typical values at every node.

    `runs` and `scenes`: the fitted conditions of the campaign, as stated.
    """
    for quantity in learnable_quantities(scenes):
        for name in quantity.regressors:
            nodes = node_positions(quantity, name, runs, scenes)
            if len(nodes) > 1:
                period = scenes[0].track_length if name == "track" else None
                sizes = (quantity.typical_size,) * len(nodes)
                yield PiecewiseLinearLaw(quantity, REGRESSORS[name], nodes, sizes, period)


def node_positions(quantity: LearnableQuantity, regressor: str, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    """The nodes of a law of a quantity over a regressor (its name); fewer than two if the regressor does not vary.

    `runs` and `scenes`: the fitted conditions of the campaign.
    """
    return _POSITIONS[regressor](quantity, runs, scenes)


def _over_contact_temperature(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    return _over_range([r.T_spot for r in runs], MIN_TEMPERATURE_RANGE_K)


def _over_own_temperature(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    if quantity.targets[0].startswith("road."):
        return _over_range([r.T_road for r in runs], MIN_TEMPERATURE_RANGE_K)
    if quantity.layer is None:
        return _over_range([r.T_block for r in runs], MIN_TEMPERATURE_RANGE_K)
    names = [layer.name for layer in scenes[0].layers]
    n = names.index(quantity.layer)
    fields = [r.field[:, r.mesh.everywhere(r.mesh.block[:, r.mesh.layers[n]]).ravel()] for r in runs]
    faces = [r.T_block for r in runs] if n == 0 else []  # the face is recorded at all times, fields are at few
    return _over_range([*fields, *faces], MIN_TEMPERATURE_RANGE_K)


def _over_wall_temperature(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    fields = [r.field[:, r.mesh.patches[site][0]] for r in runs for site in quantity.targets]
    # walls are warmest where they meet the face, which is recorded at all times
    faces = [] if quantity.targets == HOLDER_SITES else [r.T_block for r in runs]
    return _over_range([*fields, *faces], MIN_TEMPERATURE_RANGE_K)


def _over_pressure(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    pressures = [r.pressure[r.sliding] for r in runs if r.sliding.any()]
    if not pressures:
        return ()
    highest = max(float(p.max()) for p in pressures)
    if max(float(np.ptp(p)) for p in pressures) < MIN_RELATIVE_RANGE * highest:  # uniform: the loads of the campaign
        return _discard_constant(nodes_at_values(float(p.mean()) for p in pressures))
    return _over_range(pressures, MIN_RELATIVE_RANGE * highest)


def _over_speed(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    ends = [s.speeds for s in scenes]
    waits = any(s.schedule.wait > 0 and s.schedule.repetitions > 1 for s in scenes)
    rest = [0.0] if quantity.action == "film" and waits else []  # walls cool then too
    if all(high - low <= MIN_RELATIVE_RANGE * high for low, high in ends):
        return _discard_constant(nodes_at_values([*rest, *(high for _, high in ends)]))
    return _over_range([np.array([*rest, *(v for pair in ends for v in pair)])], 0.0)


def _over_repetitions(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    most = max(s.schedule.repetitions for s in scenes)
    return nodes_at_values(range(1, most + 1)) if most > 1 else ()


def _over_block(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    return graded_nodes(0.0, max(s.length for s in scenes))


def _over_track(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    """Nodes around a track that all conditions share, if the block repeats it in one direction."""
    lap = scenes[0].track_length
    if lap is None or any(s.track_length != lap for s in scenes):
        return ()
    again = any(s.schedule.distance * s.schedule.repetitions > lap for s in scenes)
    one_way = len({d for s in scenes for d in s.schedule.directions}) == 1
    return graded_nodes(0.0, lap, INITIAL_LAW_NODES + 1)[:-1] if again and one_way else ()


def _over_distance(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    return graded_nodes(0.0, max(s.schedule.distance for s in scenes), decays=True)


def _over_whole_distance(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    """None for single repetitions, where it equals the distance slid since the start."""
    whole = [s.schedule.distance * s.schedule.repetitions for s in scenes if s.schedule.repetitions > 1]
    return graded_nodes(0.0, max(whole), decays=True) if whole else ()


def _over_time(quantity: LearnableQuantity, runs: Runs, scenes: Scenes) -> tuple[float, ...]:
    return graded_nodes(0.0, max(s.schedule.end_time for s in scenes), decays=True)


_POSITIONS: dict[str, Callable[[LearnableQuantity, Runs, Scenes], tuple[float, ...]]] = {
    "temperature": _over_contact_temperature,
    "inside": _over_own_temperature,
    "wall": _over_wall_temperature,
    "speed": _over_speed,
    "pressure": _over_pressure,
    "place": _over_block,
    "track": _over_track,
    "slid": _over_distance,
    "passed": _over_whole_distance,
    "time": _over_time,
    "repetition": _over_repetitions,
}


def _over_range(values: list[Array], min_range: float) -> tuple[float, ...]:
    """Evenly spaced nodes over all finite values, none where these differ by `min_range` or less."""
    finite = [f for v in values if (f := v[np.isfinite(v)]).size]
    if not finite:
        return ()
    low, high = min(float(f.min()) for f in finite), max(float(f.max()) for f in finite)
    return graded_nodes(low, high) if high - low > min_range else ()


def _discard_constant(nodes: tuple[float, ...]) -> tuple[float, ...]:
    return nodes if nodes[-1] - nodes[0] > MIN_RELATIVE_RANGE * nodes[-1] else ()


# --- the file -----------------------------------------------------------------------------------------------------
def effect_source(law: PiecewiseLinearLaw) -> str:
    """The effect file of a law.

    >>> law = PiecewiseLinearLaw(LEARNABLE_QUANTITIES[0], REGRESSORS["speed"], (0.1, 1.0), (0.0, -0.2))
    >>> print(effect_source(law).splitlines()[0])
    \"\"\"The friction coefficient over the sliding speed, learned from measured temperatures: piecewise linear.
    """
    quantity, regressor = law.quantity, law.regressor
    factor = quantity.action == "factor"
    names = [f"at_{k + 1}" for k in range(len(law.nodes))]
    meaning, unit = ("ln of the factor", "1") if factor else ("value", quantity.unit)
    low = "" if quantity.lower_bound == -np.inf else f"low={quantity.lower_bound:g}, "
    params = "\n".join(
        f'    {n} = Param({v:.5g}, "{unit}", "{meaning} at {at:.6g} {regressor.unit}", '
        f"{low}high={quantity.upper_bound:g}, off=0.0)"
        for n, v, at in zip(names, law.values, law.nodes, strict=True)
    )
    kind = {"factor": "Factor", "term": "Term", "film": "Heat"}[quantity.action]
    imports = sorted(["Effect", "Param", kind, *(["require_layer"] if quantity.layer is not None else [])])
    constants = [f"NODES = {law.nodes!r}"]
    constants += [f"TRACK = {law.period!r}  # m, the first node comes again"] if law.period is not None else []
    constants += [f"LAYER = {json.dumps(quantity.layer)}"] if quantity.layer is not None else []
    return EFFECT_FILE_TEMPLATE.format(
        Quantity=quantity.description[0].upper() + quantity.description[1:],
        regressor=regressor.description,
        numpy="import numpy as np\n\n" if factor else "",
        imports=", ".join(imports),
        kelvin="\nfrom flashtemp.physics.quantities import KELVIN" if "KELVIN" in regressor.code else "",
        example="None" if quantity.layer is None else "N(layers=[N(name=LAYER)])",
        numbers=", ".join(f"{n}=0.0" for n in names),
        constants="\n".join(constants),
        cause=law.description,
        params=params,
        laws=_law_body(law, names),
    )


def _law_body(law: PiecewiseLinearLaw, names: list[str]) -> str:
    """The body of `heat` in the file of a law."""
    quantity, at = law.quantity, [f"p.{n}" for n in names]
    curve = f"Curve(NODES, ({', '.join(at)}))"
    if law.period is not None:
        curve = f"Curve((*NODES, TRACK), ({', '.join([*at, at[0]])}))"
    value, target = f"{curve}({law.regressor.code})", quantity.targets[0]
    if quantity.action == "film":
        sites = ", ".join(f'"{s}"' for s in quantity.targets)
        heat = f"Heat.film(site, lambda now, p: {value})"
        if law.regressor.name == "wall":  # a film has one coefficient for a site: a law of the local T needs a patch
            heat = f"Heat.patch(site, lambda T, now, p: {value} * (now.ambient - T))"
        return f"        for site in ({sites},):\n            yield {heat}"
    if quantity.action == "term":
        return f'        yield Term("{target}", lambda T, now, p: {value})'
    if quantity.layer is None:
        return f'        yield Factor("{target}", lambda T, now, p: np.exp({value}))'
    return (
        f'        layer = require_layer(scene, LAYER, "the layer of a learned law")\n\n'
        f"        def law(T, now, p):\n"
        f"            return np.exp({value} * scene.in_layer(layer)[:, None])\n\n"
        f'        yield Factor("{target}", law)'
    )


EFFECT_FILE_TEMPLATE = '''"""{Quantity} over {regressor}, learned from measured temperatures: piecewise linear.

>>> from types import SimpleNamespace as N
>>> parts = list(Learned().heat({example}, N({numbers})))
>>> len(parts) > 0
True
"""

from __future__ import annotations

{numpy}from flashtemp.physics.effect import {imports}
from flashtemp.physics.interpolation import Curve{kelvin}

{constants}


class Learned(Effect):
    """Linear between values at nodes, constant beyond the outermost ones."""

    cause = "{cause}"
    source = "learned from measured temperatures"
    tells = ("no member of the catalogue explains the data",)

{params}

    def heat(self, scene, p):
        """Apply the law."""
{laws}
'''
