"""What a system and its interface were asked last, with the answers: all of a system that calls change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.model.scene import LawContext
from flashtemp.solver.boundary_heat import FilmCoefficients
from flashtemp.solver.contact_flux import ContactFluxes, ContactState
from flashtemp.solver.elastic_foundation import ContactSolution


@dataclass
class SystemCache:
    """The moment that a system was asked about last, with what enters and all films: a step asks several times."""

    now: LawContext | None = None
    road: np.ndarray | None = None
    films_key: tuple = ()  # all that the films saw
    films: FilmCoefficients | None = None
    wall_slopes: tuple[FilmCoefficients, list] | None = None  # films, and their slopes

    def invalidate(self, now: LawContext | None = None) -> None:
        """Another moment has come, or the track has changed."""
        self.now, self.road = now, None


@dataclass
class InterfaceCache:
    """What an interface was asked last, with the answers: a step asks for the same contact laws several times.

    Newton's iterations start best where the last ended, so that an answer depends on it by Newton's tolerance at most.
    """

    laws_key: tuple = ()  # all that pressure and contact laws saw
    state_key: tuple = ()  # all that the last state followed from, and the state
    state: ContactState | None = None
    pressure_shape: np.ndarray | None = None  # pressure over its mean (columns,)
    contact_fraction: np.ndarray | None = None  # phi (columns,), and what follows from it alone: `Interface._spread`
    flash_terms: tuple = ()
    static_solution: tuple | None = None  # press and state, where they follow from `laws_key` alone
    depth_loss: tuple = ()  # the spread, and `lanes.loss_at_depth` with it
    slid_length: float = 0.0  # m of road that lanes remember, and the `lanes.weights` of its fluxes
    history_weights: tuple = ()
    lane_history: tuple = ()  # the fraction, what lanes remember and the heat at a friction of 1, and `lanes.apart` of them
    touch_temperature: np.ndarray | None = None  # temperature (columns,) K where rubber touches road
    mean_friction: float = 0.0  # load-weighted, where the holder turns a block on springs
    elastic_solution: ContactSolution | None = None  # pressure of the elastic block
    flux: ContactFluxes | None = None  # at the state above, where the elastic block asked for it

    def invalidate(self, laws_key: tuple) -> None:
        """Forget answers of laws that see something else now."""
        if laws_key != self.laws_key:
            self.laws_key, self.pressure_shape, self.contact_fraction, self.static_solution = laws_key, None, None, None

    @property
    def has_uniform_lanes(self) -> bool:
        """Whether spots cover as much everywhere, so that lanes follow from the contact fraction alone."""
        return bool(self.flash_terms) and self.flash_terms[-1] is not None


def array_key(values: np.ndarray) -> tuple:
    """What is equal for equal values alone."""
    return values.dtype, values.tobytes()
