"""Micro-contacts inside a spot are hotter than the spot: only they touch, and all heat passes through them.

Discs of diameter d cover a fraction s of a spot.  They slide over the rubber and rest on the road.  Mean temperature
rise of a uniformly heated disc, per flux into that body and per spot area, with Pe = v d/(4 D) of the rubber:

    r_R = (1 - s)/s 1.22 (d/2)/(k_R sqrt(pi (0.6575 + Pe)))
    r_S = (1 - 1.3049 e + 0.2461 e^3 + 0.0539 e^5)/s 4 d/(3 pi k_S),    e = sqrt(s)

Friction feels T_spot + r_R J_R; r_S is a resistance between that and the road's lanes.

>>> from types import SimpleNamespace as N
>>> from flashtemp.physics.material import LIBRARY
>>> p = N(strength=1.0, contact_size=1e-5, contact_share=0.05)
>>> rise, road = MicroFlash().heat(N(block=LIBRARY["tread_rubber"], road=LIBRARY["asphalt"]), p)
>>> [f"{rise.law(None, N(last_speed=v), p):.3g}" for v in (0.1, 1.0)], f"{road.law(None, None, p):.3g}"
(['0.000159', '5.7e-05'], '6.04e-05')
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Param, Term


class MicroFlash(Effect):
    """Temperature excess of micro-contacts above the mean of their spot, and their resistance to heat flow."""

    cause = "the real contact inside the spots is hotter than the spots"
    source = (
        "moving disc: Tian & Kennedy 1994, J. Tribology 116, 167; resting discs side by side, evenly heated: Negus & "
        "Yovanovich 1984; 1 - s as in flash; share P(q_1)/P(q_m) of persson_friction: 5 % at 0.1 m/s, 3 % at 1 m/s"
    )
    tells = ("block hotter and road cooler by the same flux, less so at speed", "friction that falls with T falls more")
    alike = "interface_resistance"
    candidate = True

    strength = Param(1.0, "1", "factor on the temperature rise of the micro-contacts", low=0.0, high=3.0, off=0.0)
    contact_size = Param(1e-5, "m", "diameter of a micro-contact", low=1e-8, high=1e-3)
    contact_share = Param(0.05, "1", "fraction of a spot that micro-contacts cover", low=1e-3, high=0.5)

    def heat(self, scene, p):
        """Temperature rise of the micro-contacts over the flux into the rubber, and the road's resistance, m2 K/W."""
        rubber, d, s = scene.block, p.contact_size, p.contact_share
        e = np.sqrt(s)
        alone = 4.0 * d / (3.0 * np.pi * scene.road.conductivity)
        resting = p.strength * (1.0 - 1.3049 * e + 0.2461 * e**3 + 0.0539 * e**5) / s * alone

        def rise(T, now, p):
            peclet = now.last_speed * d / (4.0 * rubber.diffusivity)
            disc = 1.22 * 0.5 * d / (rubber.conductivity * np.sqrt(np.pi * (0.6575 + peclet)))
            return p.strength * (1.0 - s) / s * disc

        yield Term("contact.micro_resistance", rise)
        yield Term("contact.resistance", lambda T, now, p: resting)
