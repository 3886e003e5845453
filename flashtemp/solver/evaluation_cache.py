"""Caches of a system and its interface: the last evaluations, which a time step needs several times.

They are the only part of a `PhaseSystem` that calls change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.model.scene import LawContext
from flashtemp.solver.boundary_heat import FilmCoefficients
from flashtemp.solver.contact_flux import ContactFluxes, ContactState
from flashtemp.solver.elastic_contact import ContactSolution


@dataclass
class SystemCache:
    """The last moment of a system, with its entering road and its heat-transfer coefficients."""

    now: LawContext | None = None
    road: np.ndarray | None = None
    films_key: tuple = ()  # the arguments that `films` depend on
    films: FilmCoefficients | None = None
    wall_slopes: tuple[FilmCoefficients, list] | None = None  # coefficients, and the derivatives of their heat

    def invalidate(self, now: LawContext | None = None) -> None:
        """Set another moment, or drop it because the track has changed."""
        self.now, self.road = now, None


@dataclass
class InterfaceCache:
    """The last evaluations of an interface: contact laws, and starting values of Newton's iterations.

    A result depends on its starting value by no more than the tolerance of the iteration.
    """

    laws_key: tuple = ()  # the arguments that pressure and contact laws depend on
    state_key: tuple = ()  # the arguments of `state`
    state: ContactState | None = None
    pressure_shape: np.ndarray | None = None  # pressure over its mean (columns,)
    contact_fraction: np.ndarray | None = None  # phi (columns,), on which `flash_terms` depend
    flash_terms: tuple = ()  # mean fraction, `ContactInterface._flash_terms`, and uniform lane ratios or None
    static_solution: tuple | None = None  # pressure and contact state, where they depend on `laws_key` alone
    depth_loss: tuple = ()  # `flash_terms`, and `contact_lanes.spreading_loss_at_depth` for them
    slid_length: float = 0.0  # m, argument of `history_weights`
    history_weights: tuple = ()
    lane_history: tuple = ()  # contact fraction, history weights, heat at mu = 1, and the `LaneHistory` for them
    touch_temperature: np.ndarray | None = None  # K (columns,) where rubber touches road: start of Newton's method
    mean_friction: float = 0.0  # load-weighted, for a block on springs in a holder that tilts: start of Newton's method
    elastic_solution: ContactSolution | None = None  # pressure of the elastic block: start of Newton's method
    flux: ContactFluxes | None = None  # at `state`, if the elastic block evaluated friction there

    def invalidate(self, laws_key: tuple) -> None:
        """Drop laws whose arguments have changed."""
        if laws_key != self.laws_key:
            self.laws_key, self.pressure_shape, self.contact_fraction, self.static_solution = laws_key, None, None, None

    @property
    def has_uniform_lanes(self) -> bool:
        """Whether the contact fraction is uniform, so that the lane ratios follow from it alone."""
        return bool(self.flash_terms) and self.flash_terms[-1] is not None


def array_key(values: np.ndarray) -> tuple:
    """A key that is equal only for arrays of the same type and values."""
    return values.dtype, values.tobytes()
