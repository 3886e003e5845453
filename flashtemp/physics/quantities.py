"""Names of all quantities and sites on which effects may act, and the constant between degC and K."""

from __future__ import annotations

from dataclasses import dataclass

KELVIN = 273.15  # 0 degC in K


@dataclass(frozen=True)
class LawQuantity:
    """A quantity that laws add to or multiply: `unit`, value `base` without any law, and the arguments of its laws.

    Every law receives a LawContext with time, absolute speed, mean pressure, slid distance and repetition.  `sees`
    lists what it receives in addition.  x is a coordinate of the block; `now.lead` is the distance from the leading
    edge, equal to x unless the block slides back.
    """

    name: str
    unit: str
    base: str
    about: str
    sees: str = ""


@dataclass(frozen=True)
class HeatSite:
    """A place where heat enters: a patch of the surface, or a whole body where `zone` is True."""

    name: str
    about: str
    zone: bool = False


SEES_PLACE, SEES_CONTACT = "x, y, `now.lead`", "x, y, contact fraction and its mean (not the pressure)"
SEES_SPOTS = (
    "T where rubber touches road in the spots, T of the face (`now.face`), x, y, local pressure, contact fraction"
)
SEES_NOTHING = "nothing, `now` is None: the law returns a number"
SEES_CELL_TEMPERATURE = "T of the cells, K, and nothing else: `now` is None"
SEES_FRAME = "`now.recording`, and `now.repetition` of every frame"
QUANTITIES: dict[str, LawQuantity] = {
    q.name: q
    for q in (
        LawQuantity(
            "contact.pressure", "1", "1", "local over mean pressure of a new block; normalised to mean 1", SEES_PLACE,
        ),
        LawQuantity(
            "contact.flat_face", "1", "0", "fraction of a flat face; a profile gives the rest of `contact.pressure`",
        ),
        LawQuantity("contact.shear_traction", "1", "0", "fraction of the friction that shears the elastic block"),
        LawQuantity(
            "block.abrasion", "1", "0", "m worn per m slid",
            "T in the spots, x, y, local pressure, contact fraction, `now.friction`",
        ),
        LawQuantity("block.expansion", "1/K", "0", "linear thermal expansion of the block", SEES_NOTHING),
        LawQuantity("block.worn", "m", "0", "depth worn before the first start", SEES_PLACE),
        LawQuantity("holder.compliance", "rad/(N m)", "0", "rotation of the holder per moment"),
        LawQuantity("holder.arm", "m", "0", "height of the holder's pivot, arm of the friction force"),
        LawQuantity(
            "contact.spot_fraction", "1", "0", "macroasperity contact fraction",
            "x, y, local pressure, T of the face (`now.face`; None before it is known)",
        ),
        LawQuantity(
            "contact.resistance", "m2K/W", "0", "resistance in the spots",
            "x, y, local pressure, worn depth (`now.worn`; None where nothing wears)",
        ),
        LawQuantity(
            "contact.heat_split", "1", "0", "fraction of the heat released on the block's side", "x, y, local pressure",
        ),
        LawQuantity(
            "contact.flash_resistance", "m2K/W", "0",
            "temperature rise in the spots over their flux, for heat released at the contact", SEES_CONTACT,
        ),
        LawQuantity(
            "contact.flash_share", "1", "0", "fraction of that rise for heat released at a depth",
            f"{SEES_CONTACT}; the depth in m, a fourth argument of the law",
        ),
        LawQuantity(
            "contact.micro_resistance", "m2K/W", "0",
            "temperature rise of micro-contacts above the mean of their spot, over its flux", "x, y, local pressure",
        ),
        LawQuantity(
            "contact.cover", "1", "0", "fraction covered by spots", "edges x along the road; all strips across",
        ),
        LawQuantity("contact.resolved", "1", "0", "1: spots are resolved, 0: they are averaged"),
        LawQuantity("march.rate", "1/s", "0", "inverse of the largest time step, for a whole phase"),
        LawQuantity("friction.mu", "1", "0", "friction coefficient", SEES_SPOTS),
        LawQuantity(
            "friction.in_depth", "1", "1", "factor on the fraction of the heat that deposits release in depth",
            SEES_SPOTS,
        ),
        LawQuantity(
            "road.lane_overlap", "1", "1", "overlap of a lane with itself shifted sideways: 1 at no distance",
            "mean contact fraction; the distance in m, a fourth argument of the law",
        ),
        LawQuantity(
            "road.inflow", "K", "drift of the air", "temperature rise of the road that enters",
            "`now.carried`: temperature rise left by earlier passes, across y, by depth",
        ),
        LawQuantity("ambient.temperature", "K", "the case's", "air, holder and entering road"),
        LawQuantity("block.conductivity", "1", "1", "k(T) over k of the material", "T of the cells, K"),
        LawQuantity("road.conductivity", "1", "1", "k(T) over k of the material", "T of the cells, K"),
        LawQuantity("block.conductivity_along", "1", "1", "k along x over k in depth of the rubber", SEES_NOTHING),
        LawQuantity(
            "block.heat_capacity", "1", "1 + gradient (T - T_0)", "c(T) over c of the material", SEES_CELL_TEMPERATURE,
        ),
        LawQuantity(
            "road.heat_capacity", "1", "1 + gradient (T - T_0)", "c(T) over c of the material", SEES_CELL_TEMPERATURE,
        ),
        LawQuantity(
            "block.capacity_gradient", "1/K", "0", "slope of rho c with temperature",
            "nothing, `now` is None: the law returns a number, or one for each cell up the block",
        ),
        LawQuantity("road.capacity_gradient", "1/K", "0", "slope of rho c with temperature", SEES_NOTHING),
    )
}  # fmt: skip
CAMERA_QUANTITIES: dict[str, LawQuantity] = {
    q.name: q
    for q in (
        LawQuantity("camera.emissivity", "1", "as recorded", "emissivity of what is seen", SEES_FRAME),
        LawQuantity("camera.reflected", "degC", "as recorded", "reflected temperature", SEES_FRAME),
        LawQuantity("camera.blur", "px", "as recorded", "standard deviation of the point spread", SEES_FRAME),
        LawQuantity("camera.lag", "s", "0", "time by which the image is older than its time stamp", SEES_FRAME),
        LawQuantity("camera.shift_u", "px", "0", "shift of the image along u", SEES_FRAME),
        LawQuantity("camera.shift_v", "px", "0", "shift of the image along v", SEES_FRAME),
        LawQuantity("camera.offset", "K", "0", "added to the temperature shown; may vary between frames", SEES_FRAME),
    )
}
SITES: dict[str, HeatSite] = {
    s.name: s
    for s in (
        HeatSite("block.leading", "wall of the block at its leading edge"),
        HeatSite("block.trailing", "wall of the block at its trailing edge"),
        HeatSite("block.sides", "both side walls of the block; in 2D spread over the whole section, as a fin"),
        HeatSite("block.holder", "back of the block, at the holder"),
        HeatSite("block.face", "face of the block, outside the contact of the spots"),
        HeatSite("road.free", "surface of the road before and behind the block"),
        HeatSite("road.under", "surface of the road under the block"),
        HeatSite("road.sides", "both sides of a road no wider than the block; in 2D spread over the whole section"),
        HeatSite("block", "the whole block", zone=True),
        HeatSite("road", "the whole simulated road", zone=True),
    )
}
