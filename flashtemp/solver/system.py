"""The balance during one phase of the schedule as CVODE asks for it: the rate dy/dt and its linearisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.model.scene import Moment
from flashtemp.solver import conduction, kernels_2d, kernels_contact, lanes
from flashtemp.solver.abrasion import AbrasionCoupling
from flashtemp.solver.balance import Balance
from flashtemp.solver.boundary_heat import Films
from flashtemp.solver.contact_flux import ContactState
from flashtemp.solver.interface import Contact, Interface
from flashtemp.solver.kernels_contact import alike
from flashtemp.solver.road_frame import Overlap, RoadFrame


class Incoming(NamedTuple):
    """What the entering road carries, rises (n_road n_across,) K: `carried` of earlier passes.

    Where the block slides back over road that it has just left: heat of its lanes `back`, what it was `before`.
    """

    carried: np.ndarray
    back: np.ndarray | float = 0.0
    before: np.ndarray | float = 0.0


Inflow = Callable[..., Incoming]  # of a moment, and whether of the whole width instead of the lanes


@dataclass
class Latest:
    """The moment that a system was asked about last, with what enters and all films: a step asks several times."""

    now: Moment | None = None
    entering: dict[bool, np.ndarray] = field(default_factory=dict)  # of the lanes, and of the whole width
    filmed: tuple = ()  # all that the films saw
    films: Films | None = None

    def forget(self, now: Moment | None = None) -> None:
        """Another moment has come, or the track has changed."""
        self.now, self.entering = now, {}


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

    def entering(self, now, whole: bool = False) -> np.ndarray:
        """Temperature rise (n_road n_across,) of the road that enters now, deepest first: in lanes, or as a `whole`.

        Where the block slides back, what that road was before the block was on it: what its lanes widen into.
        """
        recent = self.recent
        if now is recent.now and whole in recent.entering:
            return recent.entering[whole]
        drift = now.ambient - self.b.scene.ambient
        if self.inflow is None:
            T_in = self.b.no_inflow + drift
        else:
            found = self.inflow(now, whole)
            fresh = drift + 0.0 * found.carried + found.before
            T_in = self.b.laws("road.inflow", fresh, None, now.seeing(carried=found.carried))
        if now is recent.now:
            recent.entering[whole] = T_in
        return T_in

    def came_as(self, now, behind: np.ndarray, whole: bool = False) -> np.ndarray:
        """Rises (places, n_road n_across) of road `behind` (m) the window's edge, had it met no block since it came.

        Where the block slides back, those of the road that enters now.
        """
        if self.inflow is None or self.phase.turned > -np.inf:
            return np.tile(self.entering(now, whole), (len(behind), 1))
        at, which = np.unique(behind, return_inverse=True)
        came = [self.entering(now._replace(passed=now.passed - way), whole) for way in at]
        return np.array(came)[which] if came else np.zeros((0, len(self.entering(now, whole))))

    def back(self, now) -> np.ndarray | float:
        """Rise (n_road n_across,) K by which columns of road enter hotter, since the block has just been on them."""
        return 0.0 if self.inflow is None else self.inflow(now).back

    def contact(self, now, y) -> Contact:
        """Block and road at a state y as `placed`: pressure, contact laws and, unless the block is lifted, fluxes."""
        T = self.b.rise(y[: self.b.n])
        return self.interface.contact(now, self.b.worn_depth(y), T, self.entering(now), self.solid.conduction(T, now))

    def felt(self, now, y, T, T_in, kf, slopes: bool = False) -> Contact | None:
        """The contact where any heat may depend on it: not where the block is lifted and no law sees the contact."""
        if not (now.touching or self.b.boundary.local):
            return None
        return self.interface.contact(now, self.b.worn_depth(y), T, T_in, kf, slopes)

    def near(self, contact: Contact | None, now):
        """The moment as laws of heat see it: where there are only films it is not told the contact, which they miss."""
        return now if contact is None or not self.b.boundary.local else self.interface.at(contact.state, now)

    def entering_enthalpy(self, T_in: np.ndarray) -> np.ndarray:
        """Enthalpy rise (n_road n_across,) of road that enters with a rise T_in."""
        gradient = self.b.capacity_gradient
        return T_in if gradient is None else T_in * (1 + 0.5 * gradient[: len(T_in)] * T_in)

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
        contact = self.felt(now, y, T, T_in, kf)
        if contact is not None and contact.flux is not None:
            self._heat(contact.state, contact.flux, q, led)
            if b.abrades:
                out[b.worn] = self.interface.abrasion_rate(contact.state, contact.flux, now) / b.worn_unit
        b.boundary.exchange(self.near(contact, now), self.films(now), T, kf, q, led)
        self.solid.flows(T, h, T_enter, h_in, self.solid.conductances(kf), carry, q)
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
        T_in = self.entering(now)
        carry = b.carry(now)
        stretch = b.ones if b.capacity_gradient is None else 1.0 + b.capacity_gradient * T
        contact = self.felt(now, y, T, T_in, kf, slopes=True)
        at_walls = b.boundary.slopes(self.near(contact, now), self.films(now), T, kf)
        slopes, rows, books = _contact_slopes(b, contact, at_walls)
        for row in _leaving_slopes(b, carry, stretch):
            rows["lane_out"].append(row)
        joined: conduction.Rows = {
            name: (np.concatenate([i for i, _ in parts]), np.concatenate([w for _, w in parts]))
            for name, parts in rows.items()
            if parts
        }
        coupling = None
        if contact is not None and contact.slopes is not None and (b.abrades or b.expansion):
            coupling = self.interface.abrasion_coupling(contact, now, b.worn_depth(y), T, T_in, kf, gamma)
        state = None if contact is None else contact.state
        solid = self.solid.linearised(gamma, kf, carry, stretch, slopes, joined)
        return Linearised(b, gamma, stretch, joined, state, books, solid, coupling)


def _contact_slopes(b: Balance, contact: Contact | None, at_walls):
    """Slopes of all heat of walls and contact with temperature; how the ledger follows the cells, and how the lanes.

    Lanes are among the cells as if they kept their width.
    """
    own = [(cells, slope) for _, cells, slope in at_walls]
    rows: dict[str, list] = {name: [] for name in b.ledger}
    for name, cells, slope in at_walls:
        rows[name].append((cells, slope))
    deposits, along, up, down, books = None, b.idle, b.idle, b.idle, {}
    under = Overlap(b.cell_road) if contact is None else contact.state.under
    if contact is not None and contact.slopes is not None:
        state, d, area = contact.state, contact.slopes, b.scene.mesh.column_area
        face, lane = state.block * area, state.road * area
        if len(b.weight) and np.any(d.deep):
            deposits = face * d.deep[0], face * d.deep[1]
        own += [(b.cell_block, face * (d.block[0] + d.deep[0]))]
        along, up, down = lane * d.road[1], lane * d.road[0], face * (d.block[1] + d.deep[1])
        for name, w, slopes in (("friction", face, d.heat), ("into_road", face, d.road)):
            books[name] = w * slopes[1]
            rows[name] += [(b.cell_block, w * slopes[0]), *state.under.parts(books[name])]
    cell = np.concatenate([np.empty(0, dtype=np.int64), *(cells for cells, _ in own)])
    slope = np.concatenate([np.empty(0), *(slope for _, slope in own)])
    return conduction.Slopes(cell, slope, along, up, down, deposits, under), rows, books


def _leaving_slopes(b: Balance, carry, stretch) -> list[tuple[np.ndarray, np.ndarray]]:
    """(cells, slopes) of the heat that the road carries out of the window, less what it brings in."""
    mesh = b.scene.mesh
    before, last, first = (mesh.everywhere(mesh.road[i]) for i in (-2, -1, 0))
    leave, back = (np.outer(carry, mesh.share) * stretch[cells] for cells in (last, before))
    return [
        (last.ravel(), (leave * (1 + b.slope[-1])).ravel()),
        (before.ravel(), (-back * b.slope[-1]).ravel()),
        (first.ravel(), np.outer(b.g_in, mesh.share).ravel()),
    ]


@dataclass(frozen=True)
class Linearised:
    """A system linearised at one instant: J v, and the preconditioner's P^-1 r for P = I - gamma J.

    `stretch` dh/dT (cells,); `rows` {entry of the ledger: (cells, slopes in W/(m K))}, of them `books` {entry: slopes
    (columns,) with the road's columns}; `contact` of that state, None where nothing depends on it.
    """

    b: Balance
    gamma: float
    stretch: np.ndarray
    rows: conduction.Rows
    contact: ContactState | None
    books: dict[str, np.ndarray]
    solid: conduction.LinearisedPlane
    coupling: AbrasionCoupling | None

    def times(self, v: np.ndarray, out: np.ndarray) -> None:
        """out = J v; conserves heat like the rate.

        Left out: slopes of k(T), and the ways from temperature over friction to the tilt of a holder that turns, and
        from the face's temperature to the contact fraction.
        """
        b, n = self.b, self.b.n
        h = v[:n]
        T = h if b.capacity_gradient is None else h / self.stretch
        out[n:] = 0.0
        lane = fallen = b.idle
        if self.contact is not None:
            fallen = lanes.fallen(b, self.contact, T)
            lane = self.contact.under.seen(T) - fallen
        self.solid.product(T, lane, out[:n])
        for name, (index, weight) in self.rows.items():
            out[b.entry[name]] = weight @ T[index]
        for name, slope in self.books.items():
            out[b.entry[name]] -= (slope * fallen).sum()
        if self.coupling is not None:
            w = self.coupling
            out[b.worn] = w.heated(T[b.cell_block], lane)
            w.add(v[b.worn], out, T=T)

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P^-1 r; the ledger follows the cells exactly, so that Krylov steps conserve heat."""
        b, n = self.b, self.b.n
        T, w = z[:n], self.coupling
        if w is not None:  # abrasion first: it moves the pressure, and that the heat
            r = r.copy()
            w.add(w.undo(r[b.worn]), r, self.gamma)
        z[n:] = r[n:]
        self.solid.solve(r[:n], T)
        for name, (index, weight) in self.rows.items():
            z[b.entry[name]] += self.gamma * (weight @ T[index])
        if w is not None:
            z[b.worn] += self.gamma * w.heated(T[b.cell_block], w.under.seen(T))
        if b.capacity_gradient is not None:
            T *= self.stretch


@dataclass(frozen=True)
class Moved:
    """A system `at` a state as it lies under the block, for road that lies `k` lines further upstream in memory."""

    at: Linearised
    frame: RoadFrame
    k: int

    @property
    def gamma(self) -> float:
        """Of P = I - gamma J."""
        return self.at.gamma

    def times(self, v: np.ndarray, out: np.ndarray) -> None:
        """out = J v; road that has gone changes no more, and what has not come yet is given."""
        b, moved = self.at.b, np.empty_like(out)
        self.at.times(self.frame.placed(v, self.k, 0.0), moved)
        front = self.frame.back(moved, self.k, out, 0.0)
        out[b.entry["lane_out"]] += b.road_heat(front)

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P^-1 r; what P gives to road that has not come yet is booked as gone, so that heat is conserved."""
        b, moved = self.at.b, np.empty_like(z)
        self.at.solve(self.frame.placed(r, self.k, 0.0), moved)
        front = self.frame.back(moved, self.k, z, r[: b.n])
        z[b.entry["lane_out"]] += b.road_heat(front)
