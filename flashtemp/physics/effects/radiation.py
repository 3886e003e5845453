"""Radiation of warm walls and of the warm road to the surroundings: eps sigma (T_air^4 - T^4).

>>> from types import SimpleNamespace as N
>>> leading, *_, back = Radiation().heat(None, None)
>>> round(leading.law(343.15, N(ambient=293.15), N(emissivity=0.95)), 3)
-349.088
>>> round(back.law(343.15, N(ambient=293.15), N(back=0.95)), 3)
-349.088
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Heat, Param

STEFAN_BOLTZMANN_W_M2K4 = 5.670374419e-8  # W/m2K4


class Radiation(Effect):
    """Exchange with surroundings at ambient temperature; in 2D the two side walls act as a fin over the width."""

    cause = "surfaces radiate heat"
    source = "Stefan-Boltzmann law; rubber 0.94-0.97, asphalt 0.93-0.96; 5.4 W/m2K for a small rise, 8 for 80 K"
    tells = ("more than proportional to the rise", "whatever the speed", "also while waiting")
    candidate = True

    emissivity = Param(
        0.95, "1", "emissivity of rubber and road; ambient.convection is then without radiation",
        low=0.0, high=1.0, off=0.0,
    )  # fmt: skip

    face = Param(
        0.0, "1", "emissivity of the face while it is not in contact, at any temperature", low=0.0, high=1.0, off=0.0
    )

    back = Param(0.0, "1", "emissivity of the back, opposite to the face", low=0.0, high=1.0, off=0.0)

    def heat(self, scene, p):
        """Fluxes through all walls, the free road, the face while it is not in contact, and the back."""

        def law(T, now, p):
            return p.emissivity * STEFAN_BOLTZMANN_W_M2K4 * (now.ambient**4 - T**4)

        for site in ("block.leading", "block.trailing", "block.sides", "road.free"):
            yield Heat.patch(site, law)

        def face_flux(T, now, p):
            return (0.0 if now.touching else p.face) * STEFAN_BOLTZMANN_W_M2K4 * (now.ambient**4 - T**4)

        yield Heat.patch("block.face", face_flux)
        yield Heat.patch("block.holder", lambda T, now, p: p.back * STEFAN_BOLTZMANN_W_M2K4 * (now.ambient**4 - T**4))
