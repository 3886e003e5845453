"""Resolved macroasperity spots, fixed on the road and moving through the contact (Level R; theory.md, section 1.3).

>>> from types import SimpleNamespace as N
>>> scene = N(spot_diameter=3e-3, spot_fraction=0.2, width=0.05)
>>> cover, share, pace = ResolvedSpots().heat(scene, N(weight=1.0))
>>> round(pace.law(None, N(speed=0.1), N(weight=1.0)))
400
"""

from __future__ import annotations

from functools import cache

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Effect, Param, Term
from flashtemp.physics.friction.spot_patterns import StripePattern, place_discs, read_contact_map

SPOT_PATTERNS = ("random", "regular", "stripes")
STEPS_PER_DIAMETER = 12.0  # at least, while the road moves by a diameter


class ResolvedSpots(Effect):
    """Contact only at the current positions of the road's spots, each heated by its part of the load."""

    cause = "each macroasperity spot heats rubber and road by itself"
    source = "theory 1.3 eqs. (1)-(7)"
    tells = ("hot spots that move with the road", "tracks of spots on the block")

    weight = Param(1.0, "1", "1: spots resolved; 0: averaged over their passage", low=0.0, high=1.0, off=0.0)
    pattern = Param("random", "1", 'arrangement of the spots: "random", "regular" or "stripes"', kinds=("name",))
    repeat = Param(0.05, "m", "approximate length of road after which the pattern repeats", low=1e-3, high=10.0)
    seed = Param(1, "1", "seed of a random pattern", low=0, high=1e9, kinds=("whole",))
    contact_map = Param(
        None, "1", "contact map of a topography (flashtemp spots) instead of a pattern", kinds=("text",)
    )

    @classmethod
    def prepare(cls, values, folder):
        """Check the pattern and read the map."""
        if values["pattern"] not in SPOT_PATTERNS:
            raise BadInput(f"resolved_spots.pattern: {values['pattern']!r}; give {', '.join(SPOT_PATTERNS)}")
        if values["contact_map"] is not None:
            values["contact_map"] = read_contact_map(folder / values["contact_map"], "resolved_spots.contact_map")
        return values

    def heat(self, scene, p):
        """Covered fraction between edges along x, and the largest time step that follows the spots."""
        D, phi = scene.spot_diameter, scene.spot_fraction

        @cache  # placed at the first evaluation: heat() is called before the mesh exists
        def lay_spots():
            if -1 in scene.schedule.directions:
                raise BadInput("schedule.speed: resolved_spots follows its spots forward only; give a speed > 0")
            if p.contact_map is not None:
                road = p.contact_map
            elif p.pattern == "stripes":
                road = StripePattern(D, phi)
            else:
                road = place_discs(p.pattern, D, phi, scene.width, p.repeat, p.seed, "resolved_spots.pattern")
            return road.repeat, road.cumulative_cover(scene.mesh.y, scene.width)

        def covered_fraction(T, now, p):
            repeat, area = lay_spots()
            mesh, count = scene.mesh, area.shape[1] - 1
            x = mesh.x[mesh.first : mesh.last + 1] if now.lead is None else now.lead
            edges = (x - now.slid) / repeat
            turns = np.floor(edges)
            at = (edges - turns) * count
            k = np.minimum(at.astype(int), count - 1)
            F = area[:, k] + (at - k) * (area[:, k + 1] - area[:, k]) + turns * area[:, -1:]
            return (np.diff(F, axis=1) / np.maximum(np.diff(x), 1e-12)).T.ravel()

        yield Term("contact.cover", covered_fraction)
        yield Term("contact.resolved", lambda T, now, p: p.weight)
        yield Term("march.rate", lambda T, now, p: STEPS_PER_DIAMETER * p.weight * now.speed / D)
