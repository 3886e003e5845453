"""Debris of the block forms a film in the spots that thickens with wear and saturates.

A fraction kappa of every worn depth w enters the film, which loses debris in proportion to its thickness h, so that

    dh/dw = kappa (1 - h/h_max),    h = h_max (1 - exp(-kappa w/h_max)),    resistance h/k

w is the worn depth of the simulated block; without a wear effect, `rate` times local pressure and slid distance.

>>> from types import SimpleNamespace as N
>>> p = N(thickness=1e-5, share=0.1, conductivity=0.2, rate=6e-11)
>>> [law] = DebrisFilm().heat(N(schedule=N(distance=3.5)), p)
>>> fresh, worn = N(worn=None, repetition=1, slid=3.5, local_pressure=1.5e5), N(worn=1e-3)
>>> f"{law.law(None, fresh, p):.3g} {law.law(None, worn, p):.3g}"
'1.35e-05 5e-05'
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Param, Term


class DebrisFilm(Effect):
    """Resistance in the spots of a third body that grows by wear, up to a largest thickness."""

    cause = "a film of wear debris grows in the contact until it feeds no more"
    source = (
        "third body fed by wear and drained by loss: Godet 1984, Wear 100, 437; rubber debris 0.2 W/mK, 10 um: "
        "layers of rolled debris of 1-100 um; share and thickness are assumed within a factor of 5"
    )
    tells = ("block hotter and road cooler as the distance grows, less and less", "most where it wears most")
    alike = "third_body"
    candidate = True

    thickness = Param(1e-5, "m", "largest thickness of the film", low=0.0, high=1e-3, off=0.0)
    share = Param(0.1, "1", "fraction of the worn depth that stays in the spots", low=0.0, high=1.0)
    conductivity = Param(0.2, "W/mK", "heat conductivity of the debris", low=1e-2, high=10.0)
    rate = Param(6e-11, "m2/N", "worn depth per distance and pressure without a wear effect", low=0.0, high=1e-7)

    def heat(self, scene, p):
        """Adds to 1/alpha."""

        def law(T, now, p):
            if p.thickness == 0:
                return 0.0
            worn = now.worn
            if worn is None:
                slid = (now.repetition - 1) * scene.schedule.distance + now.slid
                worn = p.rate * now.local_pressure * slid
            return p.thickness / p.conductivity * -np.expm1(-p.share * worn / p.thickness)

        yield Term("contact.resistance", law)
