"""Friction, its heat in depth and the contact fraction from a master curve and a power spectrum (Persson's theory).

>>> from types import SimpleNamespace as N
>>> p = N(**PerssonFriction.prepare({k: v.value for k, v in PerssonFriction.params().items()}, None))
>>> print(f"{p.theory(0.1, 293.15, 1.5e5).viscous:.6f} {p.theory(0.1, 293.15, 1.5e5).adhesive:.4f}")
0.428219 0.0781
"""

from __future__ import annotations

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Deposit, Effect, Factor, Param
from flashtemp.physics.friction import friction_table, theory_inputs

MIN_DEPOSIT_DEPTH_M = 4e-6  # m: viscoelastic heat at smaller depths counts as released at the contact


class PerssonFriction(Effect):
    """mu(v, T, p) from viscoelastic loss on all length scales of the roughness and shear of the real contact area."""

    cause = "friction follows from roughness, viscoelastic modulus and real contact"
    source = "Persson 2001, 2006; theory 2.1-2.6 eqs. (16)-(17)"
    tells = ("friction falls as the contact warms and depends on speed", "part of the heat a tenth of a mm deep")
    steady = True

    weight = Param(1.0, "1", "1 friction by theory times friction.mu; 0 friction.mu alone", low=0.0, high=1.0, off=0.0)
    rubber = Param("A", "1", "name of a built-in rubber; master_curve replaces it", kinds=("name",))
    master_curve = Param(None, "rad/s, Pa, Pa", "frequency, storage, loss modulus: CSV or law", kinds=("text", "table"))
    wlf = Param(None, "1, K", "constants C1, C2 of the shift factor of master_curve", kinds=("table",))
    reference = Param(20.0, "degC", "temperature at which master_curve and wlf hold", low=-150.0, high=200.0)
    shift = Param(None, "degC, 1", "temperature and log10 a_T, instead of wlf: file or rows", kinds=("text", "table"))
    poisson = Param(0.5, "1", "Poisson's ratio", low=0.0, high=0.5)
    road = Param("asphalt A", "1", "name of a built-in road; spectrum replaces it", kinds=("name",))
    spectrum = Param(None, "1/m, m4", "wavenumber and spectrum C(q): CSV file, rows, or a law", kinds=("text", "table"))
    lowest = Param(None, "1/m", "lowest wavenumber; the first of the spectrum if not given", low=1e-2, high=1e9)
    highest = Param(None, "1/m", "highest wavenumber; where rms_slope is reached if not given", low=1.0, high=1e11)
    rms_slope = Param(1.3, "1", "rms slope at which the spectrum ends", low=1e-3, high=10.0)
    gamma = Param(0.5, "1", "fraction of the loss kept in partial contact, S = g + (1-g) P^2", low=0.0, high=1.0)
    shear_stress = Param(4e6, "Pa", "highest shear stress of the real contact, 0 without it", low=0.0, high=1e9)
    shear_width = Param(0.1, "1", "width c of its bell over log10 speed", low=0.0, high=10.0)
    shear_speed = Param(6e-3, "m/s", "speed of its maximum at 20 degC", low=1e-12, high=1e3)
    activation = Param(1.0, "eV", "activation energy of its shift with temperature", low=0.0, high=5.0)
    spots = Param("given", "1", 'contact fraction: "given", or "theory": P(2 pi/diameter) at the face', kinds=("name",))
    in_depth = Param(True, "1", "release the viscoelastic heat at the depths of the theory", kinds=("flag",))
    extrapolate = Param(True, "1", "false: stop where friction comes from beyond the measured range", kinds=("flag",))
    saturation = Param(True, "1", "false: area in contact proportional to load without bound", kinds=("flag",))
    payne_rest = Param(1.0, "1", "fraction of the modulus left at large strain (filled rubber)", low=0.05, high=1.0)
    payne_strain = Param(0.05, "1", "strain at which half of that decrease is reached", low=1e-6, high=10.0)
    payne_loss_peak = Param(None, "1", "loss at payne_strain over that at none; or as storage", low=0.05, high=10.0)
    payne_loss_rest = Param(1.0, "1", "the same at large strain, used with payne_loss_peak", low=0.05, high=1.0)
    flattened = Param(1.0, "1", "factor on heights above the mean plane: skewness of the road", low=0.05, high=1.0)
    skewness_cutoff = Param(1e-3, "m", "shortest wave that is flattened; 0: all waves", low=0.0, high=10.0)
    work_of_adhesion = Param(0.0, "J/m2", "work of adhesion that pulls rubber into contact", low=0.0, high=10.0)

    @classmethod
    def prepare(cls, values, folder):
        """Build the theory from curves and spectra."""
        if values["spots"] not in ("given", "theory"):
            raise BadInput(f'persson_friction.spots: {values["spots"]!r}; give "given" or "theory"')
        values["theory"] = theory_inputs.build_theory(values, folder, "persson_friction")
        values["folder"], values["assumed"] = folder, theory_inputs.describe_assumptions(values)
        return values

    def heat(self, scene, p):
        """Factor on friction.mu, on the contact fraction, and deposits in depth."""
        if p.weight == 0:
            return
        # the table takes seconds: built at the first lookup, since heat() is also called for checks alone
        lookup = friction_table.TableLookup(lambda: _tabulate_scene(scene, p))
        fastest = p.theory, scene.speeds[1], scene.ambient, scene.load, MIN_DEPOSIT_DEPTH_M
        depths = theory_inputs.heat_deposits(*fastest) if p.in_depth else []
        inside = sum(share for share, _ in depths)

        def friction_factor(T, now, p):
            return 1.0 + p.weight * (lookup(T, now)[0] - 1.0)

        def in_depth_factor(T, now, p):
            mu, deep = lookup(T, now)
            return 1.0 + p.weight * (deep / mu / inside - 1.0)

        def spot_fraction_factor(T, now, p):
            v = max(now.last_speed, friction_table.MIN_TABLE_SPEED_M_S)
            face = scene.ambient if now.face is None else now.face
            lifted = np.real(now.base) <= 0.0  # no contact by either law: avoid 0/0
            ratio = covering(v, now.local_pressure, face) / np.where(lifted, 1.0, now.base)
            return np.where(lifted, 1.0, 1.0 + p.weight * (ratio - 1.0))

        yield Factor("friction.mu", friction_factor)
        if p.spots == "theory":
            warm = friction_table.node_temperatures(scene.ambient)
            covering = p.theory.contact_fraction_law(2 * np.pi / scene.spot_diameter, warm, scene.load)
            yield Factor("contact.spot_fraction", spot_fraction_factor)
        for share, depth in depths:
            yield Deposit(p.weight * share, depth)
        if depths:
            yield Factor("friction.in_depth", in_depth_factor)
        beyond = theory_inputs.describe_extrapolation(p.theory, scene.speeds, scene.ambient, scene.load)
        if beyond and not p.extrapolate:
            raise BadInput(f"persson_friction.extrapolate: false, but {beyond[0]}; measure further, or allow it")

    def remarks(self, scene, p, run=None):
        """Friction from beyond the measured or tabulated range, and keys without effect."""
        warnings = theory_inputs.describe_extrapolation(p.theory, scene.speeds, scene.ambient, scene.load) + p.assumed
        if p.weight > 0 and run is not None:
            warnings += _tabulate_scene(scene, p).describe_excursions(run, p.theory.rubber.shift.valid_range)
        return warnings

    def leave(self, scene, p, folder):
        """Save the friction table, which a repeated run reads again."""
        if p.weight > 0:
            _tabulate_scene(scene, p).save(folder)


def _tabulate_scene(s, p) -> friction_table.FrictionTable:
    given = (p.theory, s.block, s.spot_diameter, s.speeds, s.load, s.ambient, MIN_DEPOSIT_DEPTH_M, p.folder)
    return friction_table.tabulate_friction(*given)
