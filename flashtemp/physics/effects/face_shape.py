"""Shape of the face of a new block: flat, with rounded or chamfered edges, or as measured by a laser.

A flat face has no uniform pressure: rubber in the middle of a bonded block cannot move sideways, at its edges it can.

>>> from types import SimpleNamespace as N
>>> p = N(strength=1.0, edge_radius=1e-3, chamfer=0.0, profile=None)
>>> flat, worn = FaceShape().heat(N(length=0.025), p)
>>> [round(1e6 * float(worn.law(None, N(x=x), p)), 3) for x in (0.0, 5e-4, 1e-3, 0.025)]
[1000.0, 133.975, 0.0, 1000.0]
"""

from __future__ import annotations

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Effect, Param, Term
from flashtemp.physics.interpolation import Curve, read_xy_pairs
from flashtemp.physics.tables.column_matching import PLACE_X, WORN_DEPTH


class FaceShape(Effect):
    """The pressure of an elastic block with a face of known shape, instead of a uniform pressure.

    Deviations from a uniform pressure that other effects prescribe, such as `edge_pressure`, are added to it.
    """

    cause = "the face of the block has a shape of its own, and elasticity presses it accordingly"
    source = "elastic block bonded to its holder, theory 7.1"
    uniform = True
    tells = ("less pressure at both edges, more in the middle",)
    alike = "pressure_crown"
    candidate = True
    steady = True

    strength = Param(1.0, "1", "0: uniform pressure, 1: that of this shape", low=0.0, high=1.0, off=0.0)
    edge_radius = Param(0.0, "m", "radius of the rounded leading and trailing edges", low=0.0, high=0.1)
    chamfer = Param(0.0, "m", "depth and length of a chamfer of 45 degrees at both edges", low=0.0, high=0.1)
    profile = Param(
        None, "m, m", "x against depth of the face below its highest point: CSV file or rows, as a laser measures it",
        kinds=("text", "table"),
    )  # fmt: skip

    @classmethod
    def prepare(cls, values, folder):
        """Read the profile."""
        if values["edge_radius"] and values["chamfer"]:
            raise BadInput("face_shape.chamfer: an edge is rounded or chamfered; leave out one of the two")
        if values["profile"] is not None:
            x, y = read_xy_pairs(values["profile"], folder, "face_shape.profile", columns=(PLACE_X, WORN_DEPTH))
            if len(x) < 2:
                raise BadInput("face_shape.profile: one row; give at least two rows of [x in m, depth in m]")
            values["profile"] = Curve(x, np.subtract(y, min(y)).tolist())
        return values

    def heat(self, scene, p):
        """Weight of the shape, and depth (m) of the face below its highest point."""
        for key in ("edge_radius", "chamfer"):
            if getattr(p, key) > scene.length / 2:
                raise BadInput(f"face_shape.{key}: more than half of block.length; give a smaller one")

        def face_depth(T, now, p):
            from_edge = np.minimum(now.x, scene.length - now.x)
            inside = np.maximum(0.0, p.edge_radius - from_edge)
            depth = p.edge_radius - np.sqrt(p.edge_radius**2 - inside**2) + np.maximum(0.0, p.chamfer - from_edge)
            return p.strength * (depth + (0.0 if p.profile is None else p.profile(now.x)))

        yield Term("contact.flat_face", lambda T, now, p: p.strength)
        yield Term("block.worn", face_depth)
