"""What effects may speak about: every quantity and every site by name, and the one constant between degC and K."""

from __future__ import annotations

from dataclasses import dataclass

KELVIN = 273.15  # 0 degC in K


@dataclass(frozen=True)
class Quantity:
    """A quantity that laws add to or multiply: its `unit`, its value `base` before any law speaks, what laws `see`.

    Every law sees the moment: time, speed (its size), mean pressure, slid distance, repetition.  `sees` is what it sees
    besides: x is the block's own, `now.lead` the distance from the edge that leads, which is x unless it slides back.
    """

    name: str
    unit: str
    base: str
    about: str
    sees: str = ""


@dataclass(frozen=True)
class Site:
    """A place where heat enters: a patch of the surface, which may carry a film, or a zone (`zone`), a whole body."""

    name: str
    about: str
    zone: bool = False


PLACE, CONTACT = "x, y, `now.lead`", "x, y, contact fraction and its mean (not the pressure)"
SPOTS = "T where rubber touches road in the spots, T of the face (`now.face`), x, y, local pressure, contact fraction"
ALONE = "nothing at all, `now` is None: a number"
WARM = "T of the cells, K, and nothing besides: `now` is None"
FRAME = "`now.recording`, and `now.repetition` of every frame"
QUANTITIES: dict[str, Quantity] = {
    q.name: q
    for q in (
        Quantity(
            "contact.pressure", "1", "1", "local over mean pressure of a new block; brought back to mean 1", PLACE,
        ),
        Quantity("contact.flat_face", "1", "0", "share of a flat face; a profile gives the rest of `contact.pressure`"),
        Quantity("contact.shear_traction", "1", "0", "share of the friction that shears the elastic block"),
        Quantity(
            "block.abrasion", "1", "0", "m worn per m slid",
            "T in the spots, x, y, local pressure, contact fraction, `now.friction`",
        ),
        Quantity("block.expansion", "1/K", "0", "linear thermal expansion of the block", ALONE),
        Quantity("block.worn", "m", "0", "worn before the first start", PLACE),
        Quantity("holder.compliance", "rad/(N m)", "0", "turn of the holder per moment"),
        Quantity("holder.arm", "m", "0", "height of the holder's pivot, arm of the friction force"),
        Quantity(
            "contact.spot_fraction", "1", "0", "macroasperity contact fraction",
            "x, y, local pressure, T of the face (`now.face`; None before there is one)",
        ),
        Quantity(
            "contact.resistance", "m2K/W", "0", "resistance in the spots",
            "x, y, local pressure, worn depth (`now.worn`; None where nothing wears)",
        ),
        Quantity(
            "contact.heat_split", "1", "0", "share of the heat released on the block's side", "x, y, local pressure",
        ),
        Quantity(
            "contact.flash_resistance", "m2K/W", "0",
            "rise in the spots over their flux, heat at the contact", CONTACT,
        ),
        Quantity(
            "contact.flash_share", "1", "0", "what of it heat released at a depth keeps",
            f"{CONTACT}; the depth in m, a fourth argument of the law",
        ),
        Quantity(
            "contact.micro_resistance", "m2K/W", "0",
            "rise where rubber touches over the mean of its spot, over its flux", "x, y, local pressure",
        ),
        Quantity("contact.cover", "1", "0", "share that spots cover", "edges x along the road; all strips across"),
        Quantity("contact.resolved", "1", "0", "1: the cover counts, 0: averages count"),
        Quantity("march.rate", "1/s", "0", "the integrator's steps are at most its inverse, for a whole phase"),
        Quantity("friction.mu", "1", "0", "friction coefficient", SPOTS),
        Quantity(
            "friction.in_depth", "1", "1", "factor on the share of the heat that deposits release in depth", SPOTS,
        ),
        Quantity(
            "road.lane_overlap", "1", "1", "what a lane shifted sideways still covers of itself: 1 at no distance",
            "mean contact fraction; the distance in m, a fourth argument of the law",
        ),
        Quantity(
            "road.inflow", "K", "drift of the air",
            "rise of the road that enters", "`now.carried`: what earlier passes left, across y, by depth",
        ),
        Quantity("ambient.temperature", "K", "the case's", "air, holder and road that comes in"),
        Quantity("block.conductivity", "1", "1", "k(T) over k of the material", "T of the cells, K"),
        Quantity("road.conductivity", "1", "1", "k(T) over k of the material", "T of the cells, K"),
        Quantity("block.conductivity_along", "1", "1", "k along x over k in depth of the rubber", ALONE),
        Quantity("block.heat_capacity", "1", "1 + gradient (T - T_0)", "c(T) over c of the material", WARM),
        Quantity("road.heat_capacity", "1", "1 + gradient (T - T_0)", "c(T) over c of the material", WARM),
        Quantity(
            "block.capacity_gradient", "1/K", "0", "slope of rho c with temperature",
            "nothing at all, `now` is None: a number, or one for each cell up the block",
        ),
        Quantity("road.capacity_gradient", "1/K", "0", "slope of rho c with temperature", ALONE),
    )
}  # fmt: skip
CAMERA: dict[str, Quantity] = {
    q.name: q
    for q in (
        Quantity("camera.emissivity", "1", "as recorded", "emissivity of what is seen", FRAME),
        Quantity("camera.reflected", "degC", "as recorded", "reflected temperature", FRAME),
        Quantity("camera.blur", "px", "as recorded", "standard deviation of the point spread", FRAME),
        Quantity("camera.lag", "s", "0", "time by which the image is older than its stamp", FRAME),
        Quantity("camera.shift_u", "px", "0", "shift of the image along u", FRAME),
        Quantity("camera.shift_v", "px", "0", "shift of the image along v", FRAME),
        Quantity("camera.offset", "K", "0", "added to what is shown; may differ from frame to frame", FRAME),
    )
}
SITES: dict[str, Site] = {
    s.name: s
    for s in (
        Site("block.leading", "wall of the block at its leading edge"),
        Site("block.trailing", "wall of the block at its trailing edge"),
        Site("block.sides", "both side walls of the block; in 2D met by the whole section, as a fin"),
        Site("block.holder", "back of the block, at the holder"),
        Site("block.face", "face of the block, outside the contact of the spots"),
        Site("road.free", "surface of the road before and behind the block"),
        Site("road.under", "surface of the road under the block"),
        Site("road.sides", "both sides of a road no wider than the block; in 2D met by the whole section"),
        Site("block", "the whole block", zone=True),
        Site("road", "the whole road that is simulated", zone=True),
    )
}
