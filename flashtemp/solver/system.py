"""The balance during one phase of the schedule as CVODE asks for it: the rate dy/dt and its linearisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.model.scene import Moment
from flashtemp.solver import conduction, kernels_2d, kernels_contact
from flashtemp.solver.balance import Balance
from flashtemp.solver.boundary_heat import Films
from flashtemp.solver.interface import Contact, Interface
from flashtemp.solver.kernels_contact import alike
from flashtemp.solver.linearised import Booked, Linearised, Moved, contact_slopes, leaving_slopes
from flashtemp.solver.recent import Latest

RESOLVED_K = 1e-3  # the integrator's default absolute tolerance: smaller undershoots are not told from its errors


class Incoming(NamedTuple):
    """What the entering road carries, rises (n_road n_across,) K: `carried` of earlier passes, averaged across y.

    Where the block slides back over road that it has just left, what it gave its columns comes `back` beside that.
    """

    carried: np.ndarray
    back: np.ndarray | float = 0.0


Inflow = Callable[[Moment], Incoming]


@dataclass(frozen=True)
class System:
    """The balance during one phase of the schedule: everything fixed but time and state."""

    b: Balance
    phase: Any
    inflow: Inflow | None = None
    leg: int = 0  # of the road in its own frame
    solid: conduction.Plane | conduction.Slab = field(init=False)
    interface: Interface = field(init=False)
    recent: Latest = field(init=False, default_factory=Latest)

    def __post_init__(self):
        object.__setattr__(self, "solid", conduction.solid(self.b))
        object.__setattr__(self, "interface", Interface(self.b))

    # --- what acts now -----------------------------------------------------------------------
    def moment(self, t: float) -> Moment:
        """The moment with the ambient temperature of the time."""
        if self.recent.now is not None and self.recent.now.t == t:
            return self.recent.now
        now = self.b.scene.moment(self.phase, t)
        laws = self.b.laws
        if laws.has("ambient.temperature"):
            now = now.seeing(ambient=laws("ambient.temperature", now.ambient, None, now))
        self.recent.forget(now)
        return now

    def films(self, now: Moment) -> Films:
        """All films at a moment: those of the base change with whether the block touches, and with the air, alone."""
        recent, boundary = self.recent, self.b.boundary
        if now is not recent.now:
            return boundary.films(now)
        when = (now.touching, now.ambient, None if self.b.laws.calm_films else now.t)
        if recent.films is None or recent.filmed != when:
            recent.filmed, recent.films = when, boundary.films(now)
        return recent.films

    def road(self, now) -> np.ndarray:
        """Rises (2, n_road n_across) of columns of the road that enters now, deepest first, and what of it is in lanes.

        Where the block slides back, as they were before the block was on them.
        """
        recent = self.recent
        if now is recent.now and recent.road is not None:
            return recent.road
        if self.inflow is None:
            met = np.stack([self.b.no_inflow + now.ambient - self.b.scene.ambient, self.b.no_inflow])
        else:
            met = self.met(now, self.inflow(now).carried)
        if now is recent.now:
            recent.road = met
        return met

    def entering(self, now) -> np.ndarray:
        """Temperature rise (n_road n_across,) of columns of the road that enters now: `road`."""
        columns: np.ndarray = self.road(now)[0]
        return columns

    def met(self, now, carried: np.ndarray) -> np.ndarray:
        """`road` (..., 2, n_road n_across) on which earlier passes left `carried` across y, as effects let it come.

        Heat of earlier passes lies in the columns, which are a share of the width, and has widened (theory 2a).
        """
        cold = now.ambient - self.b.scene.ambient + 0.0 * carried
        before, after = (
            self.b.laws("road.inflow", cold, None, now.seeing(carried=left)) for left in (0.0 * carried, carried)
        )
        own = (after - before) / self.b.share
        return np.stack([before + own, own], axis=-2)

    def came_as(self, now, behind: np.ndarray) -> np.ndarray:
        """`road` (places, 2, n_road n_across) that is `behind` (m) the window's edge, had it met no block since.

        Where the block slides back, that of the road that enters now.
        """
        return self._behind(self.road, now, behind, (2, len(self.b.no_inflow)))

    def remembered(self, now, behind: np.ndarray) -> np.ndarray:
        """Rises (places, n_road n_across) of its columns that earlier passes left, whatever effects let come round."""
        if self.inflow is None:
            return np.zeros((len(behind), len(self.b.no_inflow)))
        inflow, share = self.inflow, self.b.share
        return self._behind(lambda when: inflow(when).carried / share, now, behind, self.b.no_inflow.shape)

    def _behind(self, what: Callable[..., np.ndarray], now, behind: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """Something, of a `shape`, of the road that enters, for road that came in `behind` (places,) m ago."""
        if self.inflow is None or self.phase.turned > -np.inf:
            return np.broadcast_to(what(now), (len(behind), *shape))
        if len(behind) == 0:
            return np.zeros((0, *shape))
        came = what(now.seeing(passed=now.passed - behind[:, None]))
        return np.broadcast_to(came, (len(behind), *shape))

    def back(self, now) -> np.ndarray | float:
        """Rise (n_road n_across,) K by which columns of road enter hotter, since the block has just been on them."""
        return 0.0 if self.inflow is None else self.inflow(now).back

    def contact(self, now, y) -> Contact:
        """Block and road at a state y as `placed`: pressure, contact laws and, unless the block is lifted, fluxes."""
        T = self.b.rise(y[: self.b.n])
        return self.interface.contact(now, self.b.worn_depth(y), T, self.road(now), self.solid.conduction(T, now))

    def felt(self, now, y, T, kf, slopes: bool = False) -> Contact | None:
        """The contact where any heat may depend on it: not where the block is lifted and no law sees the contact."""
        if not (now.touching or self.b.boundary.local):
            return None
        return self.interface.contact(now, self.b.worn_depth(y), T, self.road(now), kf, slopes)

    def near(self, contact: Contact | None, now):
        """The moment as laws of heat see it: where there are only films it is not told the contact, which they miss."""
        return now if contact is None or not self.b.boundary.local else self.interface.at(contact.state, now)

    def evenly_pressed(self, now) -> Moment:
        """The moment as laws of the contact see it where the mean pressure acts everywhere, whatever the state is."""
        even = np.full(len(self.b.scene.mesh.column_x), now.pressure)
        seen: Moment = self.interface.at(self.interface.state(now, even), now)
        return seen

    def coldest(self, t: float) -> float:
        """Rise (K) of the coldest thing around at time t (s); -inf where a law of heat cools below all of them."""
        b, now = self.b, self.moment(t)
        around = [0.0, now.ambient - b.scene.ambient, float(np.min(self.entering(now)))]
        for entries in b.laws.films.values():
            around += [float(part.far(now, p)) - b.scene.ambient for part, p, _ in entries if part.far is not None]
        low = min(around)
        return -np.inf if b.boundary.cools(self.evenly_pressed, now, low) else low

    @cached_property
    def floor(self) -> float:
        """Enthalpy rise (K) that advection takes no face of the road below; -inf where a law of heat cools."""
        phase, b = self.phase, self.b
        times = np.linspace(phase.begin, phase.end, 9)
        air = min(self.moment(t).ambient for t in times) - b.scene.ambient
        low = min(self.coldest(phase.begin), air)
        return float(self.entering_enthalpy(np.full(len(b.no_inflow), low - RESOLVED_K))[0])

    def entering_enthalpy(self, T_in: np.ndarray) -> np.ndarray:
        """Enthalpy rise (n_road n_across,) of road that enters with a rise T_in."""
        return self.b.enthalpy(T_in)

    def placed(self, now, y: np.ndarray) -> np.ndarray:
        """A state as it lies under the block: road in its own frame is moved on, behind road that enters."""
        frame = self.b.road_frame
        if frame is None:
            return y
        k = frame.lines(now.passed, self.leg)
        return frame.placed(y, k, self.entering_enthalpy(self.entering(now)))

    # --- rate --------------------------------------------------------------------------------
    def rate(self, t: float, y: np.ndarray, out: np.ndarray) -> None:
        """dy/dt of cells (K/s), worn depth (units per s) and ledger (W/m) at time t (s)."""
        now, b = self.moment(t), self.b
        if b.road_frame is None:
            return self._rate(now, y, out)
        y, k = self.placed(now, y), b.road_frame.lines(now.passed, self.leg)
        moved = np.empty_like(out)
        self._rate(now, y, moved)
        front = b.road_frame.back(moved, k, out, 0.0)
        out[b.entry["lane_out"]] += b.road_heat(front)
        return None

    def _rate(self, now, y: np.ndarray, out: np.ndarray) -> None:
        """The rate at a state as `placed`."""
        b, n = self.b, self.b.n
        h = y[:n]
        T = b.rise(h)
        q = out[:n]
        out[:] = 0.0
        kf = self.solid.conduction(T, now)
        carry = b.carry(now)
        T_in = self.entering(now)
        T_enter = T_in + self.back(now) if self.phase.turned > -np.inf else T_in
        h_in = self.entering_enthalpy(T_enter)
        led = dict.fromkeys(b.ledger, 0.0)
        contact = self.felt(now, y, T, kf)
        if contact is not None and contact.flux is not None:
            self._heat(contact.state, contact.flux, q, led)
            if b.abrades:
                out[b.worn] = self.interface.abrasion_rate(contact.state, contact.flux, now) / b.worn_unit
        b.boundary.exchange(self.near(contact, now), self.films(now), T, kf, q, led)
        self.solid.flows(T, h, T_enter, h_in, self.solid.conductances(kf), carry, q)
        if (bounded := self.solid.bound(h, h_in, carry, self.floor)) is not None:
            bounded.add_rate(q)
        led["lane_out"] = self._leaving(T, h, T_enter, h_in, carry)
        for name, i in b.entry.items():
            out[i] = led[name]
        if not np.isfinite(out.sum()):
            raise SolverFailure("the heat balance is no longer finite")

    def _heat(self, state, flux, q, led) -> None:
        """Add the heat of the contact to cells (W/m) and ledger."""
        b, area = self.b, self.b.scene.mesh.column_area
        block, road, up, down, made = alike(state.block, state.road, flux.into_block, flux.into_road, flux.heat)
        heat, taken, given = kernels_contact.heated(b.cell_block, block, road, area, up, down, made, q)
        state.under.give(given, q)
        if len(b.weight):
            kernels_2d.deposit(b.deep_cells, b.weight, state.block * flux.deep * area, q)
        led["friction"], led["into_road"] = heat.sum(), taken.sum()

    def _leaving(self, T, h, T_in, h_in, carry):
        """Heat (W/m) that the road carries out of the window, less what it brings in."""
        b, mesh = self.b, self.b.scene.mesh
        first, before, last = b.ends
        leave = kernels_contact.leaving(last, before, first, b.slope[-1], carry, b.g_in, T, h, T_in, h_in)
        return (leave @ mesh.share).sum()

    # --- linearisation -------------------------------------------------------------------------
    def linearised(self, t: float, y: np.ndarray, gamma: float) -> Linearised | Moved:
        """The balance linearised at (t, y), with P = I - gamma J factorised by depth lines."""
        now, frame = self.moment(t), self.b.road_frame
        at = self._linearised(now, self.placed(now, y), gamma)
        return at if frame is None else Moved(at, frame, frame.lines(now.passed, self.leg))

    def _linearised(self, now, y: np.ndarray, gamma: float) -> Linearised:
        """Around a state as `placed`."""
        b = self.b
        T = b.rise(y[: b.n])
        kf = self.solid.conduction(T, now)
        carry = b.carry(now)
        stretch = b.stretch(T)
        contact = self.felt(now, y, T, kf, slopes=True)
        slopes, rows, books = contact_slopes(b, contact, self._at_walls(contact, now, T, kf))
        rows["lane_out"].append(leaving_slopes(b, carry, stretch))
        joined: conduction.Rows = {
            name: (np.concatenate([i for i, _ in parts]), np.concatenate([w for _, w in parts]))
            for name, parts in rows.items()
            if parts
        }
        coupling = None
        if contact is not None and contact.slopes is not None and (b.abrades or b.expansion or b.elastic):
            coupling = self.interface.abrasion_coupling(contact, now, b.worn_depth(y), T, self.road(now), kf, gamma)
        state = None if contact is None else contact.state
        T_in = self.entering(now)
        h_in = self.entering_enthalpy(T_in + self.back(now) if self.phase.turned > -np.inf else T_in)
        bounded = self.solid.bound(y[: b.n], h_in, carry, self.floor)
        solid = self.solid.linearised(gamma, kf, carry, stretch, slopes, joined, bounded)
        return Linearised(b, gamma, stretch, Booked.of(b, joined), state, books, solid, coupling)

    def _at_walls(self, contact: Contact | None, now: Moment, T, kf) -> list[tuple[str, np.ndarray, np.ndarray]]:
        """Slopes of the heat of walls: films on a body of constant conductivity keep theirs while they are the same."""
        recent, boundary, films = self.recent, self.b.boundary, self.films(now)
        if boundary.local or kf is not self.b.ones:
            return boundary.slopes(self.near(contact, now), films, T, kf)
        if recent.walls is None or recent.walls[0] is not films:
            recent.walls = films, boundary.slopes(now, films, T, kf)
        return recent.walls[1]
