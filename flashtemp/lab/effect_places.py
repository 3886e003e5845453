"""Where effects act: found from the sites and quantities of their laws, and drawn as a small picture of the site."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Final

from flashtemp.lab import drawing
from flashtemp.lab.drawing import Shape
from flashtemp.physics.effect import Deposit, Effect
from flashtemp.physics.quantities import CAMERA_QUANTITIES, QUANTITIES, SITES

PICTURE_BOX: Final = (64.0, 44.0)  # view box of the picture of a place, px


@dataclass(frozen=True)
class EffectPlace:
    """A place where effects act: its `title`, and the beginnings of the names of sites and quantities there."""

    title: str
    names: tuple[str, ...]

    def has_target(self, name: str) -> bool:
        """Whether a site or quantity belongs to this place."""
        return any(name == n or (n.endswith(".") and name.startswith(n)) for n in self.names)


DEPTH_TARGET: Final = "friction.deposit"  # stands for heat that is released inside the block
PLACES: Final = (
    EffectPlace("pressure", (
        "contact.pressure", "contact.flat_face", "contact.shear_traction", "block.abrasion", "block.worn",
        "holder.compliance", "holder.arm", "block.expansion",
    )),
    EffectPlace("friction", ("friction.mu",)),
    EffectPlace("spots", (
        "contact.spot_fraction", "contact.cover", "contact.resolved", "contact.flash_resistance",
        "contact.flash_share", "contact.micro_resistance",
    )),
    EffectPlace("face", ("block.face",)),
    EffectPlace("interface", ("contact.resistance", "contact.heat_split")),
    EffectPlace("block", (
        "block", "block.conductivity", "block.conductivity_along", "block.heat_capacity", "block.capacity_gradient",
        "friction.in_depth", DEPTH_TARGET,
    )),
    EffectPlace("side walls", ("block.leading", "block.trailing", "block.sides")),
    EffectPlace("holder", ("block.holder",)),
    EffectPlace("road", ("road", "road.")),
    EffectPlace("air", ("ambient.",)),
    EffectPlace("camera", ("camera.",)),
)  # fmt: skip
OTHER_PLACE: Final = EffectPlace("other", ())


def find_effect_places(effect: type[Effect]) -> tuple[EffectPlace, ...]:
    """The places where an effect acts with its default parameters, or, where these yield nothing, those it names."""
    targets = set(_yielded_targets(effect)) or set(_named_targets(effect))
    found = tuple(place for place in PLACES if any(map(place.has_target, targets)))
    return found or (OTHER_PLACE,)


def _yielded_targets(effect: type[Effect]) -> Iterable[str]:
    """Sites and quantities of the contributions at the default parameters."""
    p = SimpleNamespace(**{name: param.value for name, param in effect.params().items()})
    out: list[str] = []
    scene: Any = None
    for parts in (lambda: effect().heat(scene, p), lambda: effect().see(p)):
        try:
            for part in parts():
                name = DEPTH_TARGET if isinstance(part, Deposit) else getattr(part, "site", getattr(part, "target", ""))
                out.append(name)
        except Exception:  # an effect that needs a prepared table or a real scene: its source names what it acts on
            continue
    return out


def _named_targets(effect: type[Effect]) -> Iterable[str]:
    """Sites and quantities whose names stand in quotes in the module of the effect."""
    try:
        text = inspect.getsource(sys.modules[effect.__module__])
    except (OSError, TypeError, KeyError):
        return []
    known = {name for name in (*QUANTITIES, *CAMERA_QUANTITIES, *SITES) if "." in name}
    return [name for name in re.findall(r'"([a-z_.]+)"', text) if name in known]


def draw_places(places: Iterable[EffectPlace]) -> list[Shape]:
    """The picture of places: a block on a road with what the effect acts on in the accent colour."""
    titles = {place.title for place in places}

    def kind(title: str, plain: str) -> str:
        return "ft-d-mark" if title in titles else plain

    shapes = [
        drawing.rectangle(0, 32, 64, 12, kind("road", "ft-d-road")),
        drawing.rectangle(18, 8, 28, 4, kind("holder", "ft-d-holder")),
        drawing.rectangle(20, 12, 24, 20, kind("block", "ft-d-block")),
    ]
    marks = _draw_marks()
    return [*shapes, *(shape for title in marks if title in titles for shape in marks[title])]


def _draw_marks() -> dict[str, list[Shape]]:
    """What is drawn over block and road for the places that are not a whole body, by title."""
    teeth = [(20, 32), (24, 29), (28, 35), (32, 29), (36, 35), (40, 29), (44, 32)]
    load = [drawing.line(x, top, x, 29, "ft-d-zigzag") for x, top in ((24, 16), (32, 19), (40, 22))]
    heads = [drawing.polyline([(x - 2.5, 26), (x, 31), (x + 2.5, 26)], "ft-d-mark", closed=True) for x in (24, 32, 40)]
    waves = [[(2, y), (5, y - 2), (9, y + 2), (13, y)] for y in (12, 18, 24)]
    camera = [
        drawing.rectangle(2, 14, 9, 9, "ft-d-mark"),
        drawing.polyline([(11, 18.5), (16, 14), (16, 23)], "ft-d-mark", closed=True),
    ]
    return {
        "side walls": [drawing.rectangle(x, 12, 3, 20, "ft-d-mark") for x in (20, 41)],
        "interface": [drawing.rectangle(18, 30.5, 28, 3, "ft-d-mark")],
        "face": [drawing.rectangle(20, 28.5, 24, 3.5, "ft-d-mark")],
        "spots": [drawing.circle(x, 32, 2.2, "ft-d-mark") for x in (24, 32, 40)],
        "friction": [drawing.polyline(teeth, "ft-d-zigzag")],
        "pressure": [*load, *heads],
        "air": [drawing.polyline(wave, "ft-d-zigzag") for wave in waves],
        "camera": camera,
        OTHER_PLACE.title: [drawing.words(32, 26, "?")],
    }
