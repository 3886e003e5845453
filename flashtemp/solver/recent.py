"""What a system and its interface were asked last, with the answers: all of a system that calls change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.model.scene import Moment
from flashtemp.solver.boundary_heat import Films
from flashtemp.solver.contact_flux import ContactState, Fluxes
from flashtemp.solver.elastic_foundation import ContactSolution


@dataclass
class Latest:
    """The moment that a system was asked about last, with what enters and all films: a step asks several times."""

    now: Moment | None = None
    road: np.ndarray | None = None
    filmed: tuple = ()  # all that the films saw
    films: Films | None = None
    walls: tuple[Films, list] | None = None  # films, and their slopes

    def forget(self, now: Moment | None = None) -> None:
        """Another moment has come, or the track has changed."""
        self.now, self.road = now, None


@dataclass
class Recent:
    """What an interface was asked last, with the answers: a step asks for the same contact laws several times.

    Newton's iterations start best where the last ended, so that an answer depends on it by Newton's tolerance at most.
    """

    when: tuple = ()  # all that pressure and contact laws saw
    asked: tuple = ()  # all that the last state followed from, and the state
    state: ContactState | None = None
    shape: np.ndarray | None = None  # pressure over its mean (columns,)
    fraction: np.ndarray | None = None  # phi (columns,), and what follows from it alone: `Interface._spread`
    spread: tuple = ()
    settled: tuple | None = None  # press and state, where they follow from `when` alone
    deeper: tuple = ()  # the spread, and `lanes.loss_at_depth` with it
    way: float = 0.0  # m of road that lanes remember, and the `lanes.weights` of its fluxes
    memory: tuple = ()
    apart: tuple = ()  # the fraction, what lanes remember and the heat at a friction of 1, and `lanes.apart` of them
    touch: np.ndarray | None = None  # temperature (columns,) K where rubber touches road
    friction: float = 0.0  # load-weighted, where the holder turns a block on springs
    elastic: ContactSolution | None = None  # pressure of the elastic block
    flux: Fluxes | None = None  # at the state above, where the elastic block asked for it

    def forget(self, when: tuple) -> None:
        """Forget answers of laws that see something else now."""
        if when != self.when:
            self.when, self.shape, self.fraction, self.settled = when, None, None, None

    @property
    def even(self) -> bool:
        """Whether spots cover as much everywhere, so that lanes follow from the contact fraction alone."""
        return bool(self.spread) and self.spread[-1] is not None


def same(values: np.ndarray) -> tuple:
    """What is equal for equal values alone."""
    return values.dtype, values.tobytes()
