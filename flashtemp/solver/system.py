"""The heat balance during one phase of the schedule, as CVODE needs it: the rate dy/dt and its linearisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.model.scene import LawContext
from flashtemp.solver import conduction, kernels_2d, kernels_contact
from flashtemp.solver.boundary_heat import FilmCoefficients
from flashtemp.solver.evaluation_cache import SystemCache
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.interface import ContactInterface, SolvedContact
from flashtemp.solver.kernels_contact import common_dtype
from flashtemp.solver.linearisation import (
    LedgerMap,
    LinearisedSystem,
    ShiftedLinearisation,
    contact_slopes,
    outflow_derivatives,
)

INTEGRATOR_ATOL_K = 1e-3  # default absolute tolerance of the integrator: smaller undershoots are within its error


class RoadInflow(NamedTuple):
    """Temperature rises (n_road n_across,) K of the entering road.

    `earlier_rise` is what earlier passes left, averaged across y over lanes and gaps.  `own_rise` is what this pass
    left in the columns, where the block slides back over road that it has just left.
    """

    earlier_rise: np.ndarray
    own_rise: np.ndarray | float = 0.0


InflowLaw = Callable[[LawContext], RoadInflow]


@dataclass(frozen=True)
class PhaseSystem:
    """The heat balance during one phase of the schedule, as a function of time and state."""

    b: HeatBalance
    phase: Any
    inflow: InflowLaw | None = None
    leg: int = 0  # number of the leg, for road in its own frame
    solid: conduction.SolidPlane | conduction.SolidSlab = field(init=False)
    interface: ContactInterface = field(init=False)
    cache: SystemCache = field(init=False, default_factory=SystemCache)

    def __post_init__(self):
        object.__setattr__(self, "solid", conduction.build_solid(self.b))
        object.__setattr__(self, "interface", ContactInterface(self.b))

    # --- what acts now -----------------------------------------------------------------------
    def law_context(self, t: float) -> LawContext:
        """The context for laws at time t (s), with the ambient temperature at that time."""
        if self.cache.now is not None and self.cache.now.t == t:
            return self.cache.now
        now = self.b.scene.law_context(self.phase, t)
        laws = self.b.laws
        if laws.has_law("ambient.temperature"):
            now = now.with_fields(ambient=laws("ambient.temperature", now.ambient, None, now))
        self.cache.invalidate(now)
        return now

    def film_coefficients(self, now: LawContext) -> FilmCoefficients:
        """All heat-transfer coefficients at a moment.

        They are cached: those of the base model depend on the ambient temperature and on whether the block touches.
        """
        recent, boundary = self.cache, self.b.boundary
        if now is not recent.now:
            return boundary.film_coefficients(now)
        when = (now.touching, now.ambient, None if self.b.laws.base_films_only else now.t)
        if recent.films is None or recent.films_key != when:
            recent.films_key, recent.films = when, boundary.film_coefficients(now)
        return recent.films

    def incoming_road(self, now) -> np.ndarray:
        """Rises (2, n_road n_across) K of the columns of road that enter now, deepest first.

        Row 0 is the whole rise, row 1 the part of it that earlier passes left in the lanes.  Where the block slides
        back, both are those from before the block was on that road.
        """
        recent = self.cache
        if now is recent.now and recent.road is not None:
            return recent.road
        if self.inflow is None:
            road = np.zeros((2, len(self.b.no_inflow)))
            road[0] = now.ambient - self.b.scene.ambient
        else:
            road = self.road_after_passes(now, self.inflow(now).earlier_rise)
        if now is recent.now:
            recent.road = road
        return road

    def incoming_rise(self, now) -> np.ndarray:
        """Temperature rise (n_road n_across,) K of the columns of road that enter now: row 0 of `incoming_road`."""
        columns: np.ndarray = self.incoming_road(now)[0]
        return columns

    def road_after_passes(self, now, carried: np.ndarray) -> np.ndarray:
        """`incoming_road` (..., 2, n_road n_across) for a mean rise `carried` (..., n_road n_across) of earlier passes.

        The law `road.inflow` decides how much of it applies.  Only the difference that the law makes is heat of earlier
        passes; it lies in the columns, a fraction of the width, so it is divided by that fraction (theory.md, 1.5).
        """
        cold = now.ambient - self.b.scene.ambient + 0.0 * carried
        before, after = (
            self.b.laws("road.inflow", cold, None, now.with_fields(carried=rise)) for rise in (0.0 * carried, carried)
        )
        in_lanes = (after - before) / self.b.share
        return np.stack([before + in_lanes, in_lanes], axis=-2)

    def undisturbed_road(self, now, behind: np.ndarray) -> np.ndarray:
        """Road (places, 2, n_road n_across) `behind` (m) the upstream edge of the window, as it was when it entered.

        Where the block slides back, it is the road that enters now.
        """
        return self._evaluate_behind(self.incoming_road, now, behind, (2, len(self.b.no_inflow)))

    def earlier_pass_rise(self, now, behind: np.ndarray) -> np.ndarray:
        """Rises (places, n_road n_across) K that earlier passes left in full in the columns, at places `behind` (m)."""
        if self.inflow is None:
            return np.zeros((len(behind), len(self.b.no_inflow)))
        inflow, share = self.inflow, self.b.share
        return self._evaluate_behind(
            lambda when: inflow(when).earlier_rise / share, now, behind, self.b.no_inflow.shape
        )

    def _evaluate_behind(
        self, what: Callable[..., np.ndarray], now, behind: np.ndarray, shape: tuple[int, ...]
    ) -> np.ndarray:
        """A function of the entering road, with values of a `shape`, for road that entered `behind` (places,) m ago."""
        if self.inflow is None or self.phase.turned > -np.inf:
            return np.broadcast_to(what(now), (len(behind), *shape))
        if len(behind) == 0:
            return np.zeros((0, *shape))
        entered = what(now.with_fields(passed=now.passed - behind[:, None]))
        return np.broadcast_to(entered, (len(behind), *shape))

    def revisited_rise(self, now) -> np.ndarray | float:
        """Rise (n_road n_across,) K that this pass left in the columns that enter now; 0 without a return pass."""
        return 0.0 if self.inflow is None else self.inflow(now).own_rise

    def solve_contact(self, now, y) -> SolvedContact:
        """Pressure, contact laws and, unless the block is lifted, fluxes at a state y in the block's frame."""
        T = self.b.temperature_rise(y[: self.b.n])
        return self.interface.solve_contact(
            now, self.b.worn_depth(y), T, self.incoming_road(now), self.solid.conductivity_factor(T, now)
        )

    def contact_if_needed(self, now, y, T, kf, slopes: bool = False) -> SolvedContact | None:
        """The solved contact, or None if no heat depends on it: for a lifted block without laws of the contact."""
        if not (now.touching or self.b.boundary.has_local_laws):
            return None
        return self.interface.solve_contact(now, self.b.worn_depth(y), T, self.incoming_road(now), kf, slopes)

    def context_for_laws(self, contact: SolvedContact | None, now):
        """The context for laws of heat, with contact fields only if a law on a patch or in a zone may use them."""
        return (
            now
            if contact is None or not self.b.boundary.has_local_laws
            else self.interface.context_at_contact(contact.state, now)
        )

    def uniform_pressure_context(self, now) -> LawContext:
        """The context for laws of the contact with the mean pressure everywhere; it does not depend on the state."""
        uniform = np.full(len(self.b.scene.mesh.column_x), now.pressure)
        context: LawContext = self.interface.context_at_contact(self.interface.contact_state(now, uniform), now)
        return context

    def coldest_rise(self, t: float) -> float:
        """Rise (K) of the coldest surroundings at time t (s); -inf if a law of heat cools below all of them."""
        b, now = self.b, self.law_context(t)
        around = [0.0, now.ambient - b.scene.ambient, float(np.min(self.incoming_rise(now)))]
        for entries in b.laws.films.values():
            around += [float(part.far(now, p)) - b.scene.ambient for part, p, _ in entries if part.far is not None]
        low = min(around)
        return -np.inf if b.boundary.has_cooling_law(self.uniform_pressure_context, now, low) else low

    @cached_property
    def undershoot_floor(self) -> float:
        """Lower bound of the enthalpy rise (K) on faces of the road (theory.md, section 8); -inf if a law cools."""
        phase, b = self.phase, self.b
        times = np.linspace(phase.begin, phase.end, 9)
        air = min(self.law_context(t).ambient for t in times) - b.scene.ambient
        low = min(self.coldest_rise(phase.begin), air)
        return float(self.incoming_enthalpy(np.full(len(b.no_inflow), low - INTEGRATOR_ATOL_K))[0])

    def incoming_enthalpy(self, T_in: np.ndarray) -> np.ndarray:
        """Enthalpy rise (n_road n_across,) K of road that enters with a temperature rise T_in."""
        return self.b.enthalpy_rise(T_in)

    def to_block_frame(self, now, y: np.ndarray) -> np.ndarray:
        """A state in the block's frame: road stored in its own frame is shifted, and entering road is filled in."""
        frame = self.b.road_frame
        if frame is None:
            return y
        k = frame.shifted_lines(now.passed, self.leg)
        return frame.to_block_frame(y, k, self.incoming_enthalpy(self.incoming_rise(now)))

    # --- rate --------------------------------------------------------------------------------
    def rate(self, t: float, y: np.ndarray, out: np.ndarray) -> None:
        """dy/dt of cells (K/s), worn depth (units per s) and ledger (W/m) at time t (s)."""
        now, b = self.law_context(t), self.b
        if b.road_frame is None:
            return self._block_frame_rate(now, y, out)
        y, k = self.to_block_frame(now, y), b.road_frame.shifted_lines(now.passed, self.leg)
        block_rate = np.empty_like(out)
        self._block_frame_rate(now, y, block_rate)
        # road that has not entered yet is no state: its heat is booked as if it left, so the balance closes
        front = b.road_frame.to_memory_frame(block_rate, k, out, 0.0)
        out[b.ledger_index["lane_out"]] += b.road_heat(front)
        return None

    def _block_frame_rate(self, now, y: np.ndarray, out: np.ndarray) -> None:
        """The rate at a state in the block's frame.

        `q` is a view of `out`: boundary and contact add heat in W/m to it, and `heat_to_rates` turns it into K/s.
        """
        b, n = self.b, self.b.n
        h = y[:n]
        T = b.temperature_rise(h)
        q = out[:n]
        out[:] = 0.0
        kf = self.solid.conductivity_factor(T, now)
        advection = b.advection_coefficient(now)
        T_in = self.incoming_rise(now)
        T_enter = T_in + self.revisited_rise(now) if self.phase.turned > -np.inf else T_in
        h_in = self.incoming_enthalpy(T_enter)
        # the ledger is part of the state and takes every step with the temperatures, so it audits the integration
        led = dict.fromkeys(b.ledger, 0.0)
        contact = self.contact_if_needed(now, y, T, kf)
        if contact is not None and contact.flux is not None:
            self._add_contact_heat(contact.state, contact.flux, q, led)
            if b.abrades:
                out[b.worn] = self.interface.abrasion_rate(contact.state, contact.flux, now) / b.worn_unit
        b.boundary.add_heat(self.context_for_laws(contact, now), self.film_coefficients(now), T, kf, q, led)
        self.solid.heat_to_rates(T, h, T_enter, h_in, self.solid.conductances(kf), advection, q)
        if (bounded := self.solid.limit_undershoots(h, h_in, advection, self.undershoot_floor)) is not None:
            bounded.add_rate(q)
        led["lane_out"] = self._road_outflow(T, h, T_enter, h_in, advection)
        for name, i in b.ledger_index.items():
            out[i] = led[name]
        if not np.isfinite(out.sum()):
            raise SolverFailure("the heat balance is no longer finite")

    def _add_contact_heat(self, state, flux, q, led) -> None:
        """Add the heat of the contact to the cells `q` (W/m) and to the ledger `led`."""
        b, area = self.b, self.b.scene.mesh.column_area
        block, road, up, down, friction = common_dtype(
            state.block_coverage, state.road_coverage, flux.into_block, flux.into_road, flux.heat
        )
        heat, taken, in_cells = kernels_contact.add_contact_heat(b.cell_block, block, road, area, up, down, friction, q)
        state.touched_road.add_heat(in_cells, q)
        if len(b.deposit_weights):
            kernels_2d.deposit_heat(b.deep_cells, b.deposit_weights, state.block_coverage * flux.deep * area, q)
        led["friction"], led["into_road"] = heat.sum(), taken.sum()

    def _road_outflow(self, T, h, T_in, h_in, advection):
        """Heat (W/m) that the road carries out of the window, minus what it brings in."""
        b, mesh = self.b, self.b.scene.mesh
        first, before, last = b.outflow_cells
        leave = kernels_contact.road_outflow(
            last, before, first, b.upwind_weight[-1], advection, b.g_in, T, h, T_in, h_in
        )
        return (leave @ mesh.share).sum()

    # --- linearisation -------------------------------------------------------------------------
    def linearise(self, t: float, y: np.ndarray, gamma: float) -> LinearisedSystem | ShiftedLinearisation:
        """The balance linearised at (t, y), with the preconditioner P of I - gamma J factorised by depth lines."""
        now, frame = self.law_context(t), self.b.road_frame
        at = self._linearise_state(now, self.to_block_frame(now, y), gamma)
        return at if frame is None else ShiftedLinearisation(at, frame, frame.shifted_lines(now.passed, self.leg))

    def _linearise_state(self, now, y: np.ndarray, gamma: float) -> LinearisedSystem:
        """The linearisation around a state in the block's frame."""
        b = self.b
        T = b.temperature_rise(y[: b.n])
        kf = self.solid.conductivity_factor(T, now)
        advection = b.advection_coefficient(now)
        stretch = b.capacity_ratio(T)
        contact = self.contact_if_needed(now, y, T, kf, slopes=True)
        slopes, rows, books = contact_slopes(b, contact, self._wall_slopes(contact, now, T, kf))
        rows["lane_out"].append(outflow_derivatives(b, advection, stretch))
        joined: conduction.LedgerRows = {
            name: (np.concatenate([i for i, _ in parts]), np.concatenate([w for _, w in parts]))
            for name, parts in rows.items()
            if parts
        }
        coupling = None
        if contact is not None and contact.slopes is not None and (b.abrades or b.expansion or b.elastic_block):
            coupling = self.interface.abrasion_coupling(
                contact, now, b.worn_depth(y), T, self.incoming_road(now), kf, gamma
            )
        state = None if contact is None else contact.state
        T_in = self.incoming_rise(now)
        h_in = self.incoming_enthalpy(T_in + self.revisited_rise(now) if self.phase.turned > -np.inf else T_in)
        bounded = self.solid.limit_undershoots(y[: b.n], h_in, advection, self.undershoot_floor)
        solid = self.solid.linearise(gamma, kf, advection, stretch, slopes, joined, bounded)
        return LinearisedSystem(b, gamma, stretch, LedgerMap.from_rows(b, joined), state, books, solid, coupling)

    def _wall_slopes(
        self, contact: SolvedContact | None, now: LawContext, T, kf
    ) -> list[tuple[str, np.ndarray, np.ndarray]]:
        """Derivatives of boundary heat; cached for heat-transfer coefficients on bodies of constant conductivity."""
        recent, boundary, films = self.cache, self.b.boundary, self.film_coefficients(now)
        if boundary.has_local_laws or kf is not self.b.ones:
            return boundary.heat_slopes(self.context_for_laws(contact, now), films, T, kf)
        if recent.wall_slopes is None or recent.wall_slopes[0] is not films:
            recent.wall_slopes = films, boundary.heat_slopes(now, films, T, kf)
        return recent.wall_slopes[1]
