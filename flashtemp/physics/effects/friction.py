"""Sliding friction turns mu p v into heat: at the contact, and in the rubber just above it.

>>> from types import SimpleNamespace as N
>>> mu, part = Friction().heat(None, N(mu=0.8, volumetric_share=0.3, depth=1e-4, spectrum=None, table=None))
>>> mu.law(300.0, None, N(mu=0.8, table=None)), part.share
(0.8, 0.3)
"""

from __future__ import annotations

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Deposit, Effect, Param, Term
from flashtemp.physics.interpolation import read_rows, read_surface
from flashtemp.physics.quantities import KELVIN
from flashtemp.physics.tables.column_matching import FRICTION, SHARE, SOURCE_DEPTH, SPEED, TEMPERATURE


class Friction(Effect):
    """Heat mu p v per nominal area; the part in the rubber decays as exp(-z/depth); theory.md, eqs. (5)-(7)."""

    cause = "friction heats rubber and road"
    source = "Fortunato et al., load dependence of rubber friction; theory 1.3 eqs. (5)-(7)"
    tells = ("proportional to mu p v",)
    section = "friction"
    base = True

    mu = Param(1.0, "1", "friction coefficient; with a table, the factor on the table", low=0.0, high=10.0, off=0.0)
    volumetric_share = Param(0.0, "1", "fraction of the friction heat released inside the rubber", low=0.0, high=1.0)
    depth = Param(1e-4, "m", "e-folding depth of the volumetric heat", low=5e-8, high=1e-2)
    spectrum = Param(None, "1, m", "list of [share, depth] pairs instead of one depth", kinds=("table", "text"))
    table = Param(None, "m/s, degC, 1", "mu against speed and temperature: CSV file or rows", kinds=("text", "table"))

    @classmethod
    def prepare(cls, values, folder):
        """Read the tables.  Raises BadInput where the shares of a spectrum are negative or their sum exceeds 1."""
        if values["table"] is not None:
            values["table"] = read_surface(values["table"], folder, "friction.table", (SPEED, TEMPERATURE, FRICTION))
            if values["table"]._grid.min() < 0:
                raise BadInput(f"friction.table: contains mu = {values['table']._grid.min():g}; give mu >= 0")
        if values["spectrum"] is not None:
            spectrum = read_rows(values["spectrum"], folder, "friction.spectrum", (SHARE, SOURCE_DEPTH))
            if spectrum[:, 0].min() < 0:
                raise BadInput(f"friction.spectrum: share {spectrum[:, 0].min():g}; give shares >= 0")
            if spectrum[:, 0].sum() > 1 + 1e-12:
                raise BadInput(
                    f"friction.spectrum: shares sum to {spectrum[:, 0].sum():g}; give shares >= 0 with sum <= 1"
                )
            for depth in spectrum[:, 1]:
                if fault := cls.depth.find_fault(float(depth)):
                    raise BadInput(f"friction.spectrum: depth {depth:g} m; {fault}")
            if values["volumetric_share"]:
                share = values["volumetric_share"]
                raise BadInput(
                    f"friction.volumetric_share: {share:g} beside a spectrum; give all shares in the spectrum"
                )
            values["spectrum"] = spectrum.tolist()
        return values

    def heat(self, scene, p):
        """mu of the contact and its depth spectrum."""

        def law(T, now, p):
            return p.mu if p.table is None else p.mu * p.table(now.speed, T - KELVIN)

        yield Term("friction.mu", law)
        for share, depth in p.spectrum or [(p.volumetric_share, p.depth)]:
            yield Deposit(share, depth)
