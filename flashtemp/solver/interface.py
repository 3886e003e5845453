"""The interface of block and road: local pressure, then fluxes (contact_flux), and how abrasion answers.

The block is elastic (elastic_foundation), or it stands on springs (winkler).  Its pressure is consistent with load and
moment at every instant, and contact laws are taken at that pressure.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.model.effect_laws import COMPLEX_STEP, mean_over_columns
from flashtemp.model.scene import LawContext
from flashtemp.solver import contact_flux, contact_lanes, kernels_contact
from flashtemp.solver.abrasion import (
    AbrasionCoupling,
    SparseResponse,
    SparsityPattern,
    build_sparsity,
    complex_step_derivative,
)
from flashtemp.solver.elastic_foundation import ElasticResponse, FrictionLaw, HolderSupport
from flashtemp.solver.evaluation_cache import InterfaceCache, array_key
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.kernels_contact import broadcast_columns, common_dtype
from flashtemp.solver.road_frame import RoadOverlap
from flashtemp.solver.winkler_foundation import PressureSolution, SpringResponse

SCHEDULE_FIELD_COUNT = (
    LawContext._fields.index("repetition") + 1
)  # what a moment's first fields say follows from the schedule
MIN_HOLDER_GIVE_PER_M2 = 1e-200  # 1/m2: a holder that gives less does not turn
LIFT_OFF_PRESSURE_RATIO, LIFT_OFF_RESISTANCE_M2K_W = (
    0.01,
    1e-4,
)  # contact opens below this share of the mean pressure; scale of its resistance, m2 K/W


class SolvedContact(NamedTuple):
    """Block and road at one instant: contact laws, what the holder does, and unless it is lifted, fluxes."""

    state: contact_flux.ContactState
    pressure_solution: PressureSolution
    flux: contact_flux.ContactFluxes | None = None
    slopes: contact_flux.FluxSlopes | None = None


@dataclass(frozen=True)
class ContactInterface:
    """Pressure and contact laws under the block of a balance."""

    b: HeatBalance
    cache: InterfaceCache = field(default_factory=InterfaceCache)

    # --- pressure ------------------------------------------------------------------------------
    def solve_contact(self, now, worn, T, road, kf, slopes: bool = False) -> SolvedContact:
        """Settle the block on the road and solve the contact.

        While the block is lifted there are no fluxes.
        """
        now, press, state = self.solve_pressure_and_laws(now, worn, T, road, kf)
        state = self.separate_lanes(state, now, T, road)
        if not now.touching:
            return SolvedContact(state, press)
        if slopes:
            state = contact_lanes.limit_lane_slopes(self.b, state, T, road)
        if not slopes and self.cache.flux is not None:
            flux, slope = self.cache.flux, None
        else:
            flux, slope = self.solve_fluxes(state, now, T, road, kf, slopes)
        self.cache.touch_temperature = np.real(flux.touch)
        return SolvedContact(state, press, flux, slope)

    def solve_pressure_and_laws(
        self, now, worn, T, road, kf
    ) -> tuple[LawContext, PressureSolution, contact_flux.ContactState]:
        """The block, worn by `worn` (columns,) m, on the road: the moment as laws see it, pressure and contact laws.

        `T` (cells,) rises, `road` that enters as `System.road` says, `kf` (cells,) factor on k.
        """
        b = self.b
        if b.is_contact_static:
            self._invalidate_cache(now)
            if self.cache.static_solution is not None:
                return now, *self.cache.static_solution
        self.cache.flux = None
        now = now.with_fields(worn=worn) if b.abrades else now
        if b.elastic_block is None or not (now.touching and now.pressure > 0):
            press = self._solve_spring_pressure(now, worn, T, road, kf)
        else:
            press = self._solve_elastic_pressure(now, worn, T, road, kf)
        state = self.contact_state(now, press.pressure, T)
        if b.is_contact_static and self.cache.has_uniform_lanes:
            self.cache.static_solution = press, state
        return now, press, state

    def _solve_spring_pressure(self, now, worn, T, road, kf) -> PressureSolution:
        """Pressure of a block whose columns are springs side by side, or whose pressure is prescribed."""
        b = self.b
        free = now.pressure * self._pressure_shape(now) - b.foundation.stiffness * worn
        if b.expansion:
            free = free + b.foundation.stiffness * b.thermal_displacement(T)
        turning, moment = self._tilt_stiffness(now) if now.touching and now.pressure > 0 else (np.inf, 0.0)
        if turning < np.inf:
            moment = moment * self._solve_mean_friction(now, free, moment, turning, T, road, kf)
        return b.foundation.solve_equilibrium(free, now.pressure, moment, turning)

    def _solve_elastic_pressure(self, now, worn, T, road, kf) -> PressureSolution:
        """Pressure of the elastic block, at a friction that agrees with it column by column."""
        b, bed, recent = self.b, self.b.elastic_block, self.cache
        assert bed is not None
        flat, shear = (b.laws(f"contact.{name}", 0.0, None, now) for name in ("flat_face", "shear_traction"))
        if not (
            flat or shear or b.expansion or worn.any() or np.iscomplexobj(worn) or b.laws.has_law("holder.compliance")
        ):
            return self._solve_spring_pressure(
                now, worn, T, road, kf
            )  # nothing moves it: the prescribed pressure, to the bit
        # the profile of a new block gives what is prescribed beyond the share of a flat face: a pressure of another
        # shape acts beside `face_shape` too, and discovery can look for one
        gap = worn - bed.displace_face(now.pressure * (self._pressure_shape(now) - flat))
        if b.expansion:
            gap = gap - b.thermal_displacement(T)
        hardness = b.relative_modulus(T)
        holder = self._holder_support(now, shear)
        pulled = shear != 0.0 or not holder.is_guided

        def friction_law(T, road, kf) -> FrictionLaw:
            def friction_at_pressure(pressure):
                recent.flux, _ = self.solve_fluxes(self.contact_state(now, pressure, T), now, T, road, kf)
                return recent.flux.mu

            return friction_at_pressure

        plain = (np.real(a) for a in (T, road, kf))
        asked = friction_law(*plain) if pulled else None
        settled = bed.solve_equilibrium(
            np.real(gap), now.pressure, holder, asked, recent.elastic_solution, float(np.real(hardness))
        )
        recent.elastic_solution = settled
        if any(np.iscomplexobj(a) for a in (gap, T, road, kf)):
            settled = bed.derive_solution(
                settled, gap, now.pressure, friction_law(T, road, kf) if pulled else None, hardness
            )
            recent.flux = None
        return bed.to_pressure_solution(settled)

    def _holder_support(self, now, shear: float) -> HolderSupport:
        """What the holder does; one that hardly gives is guided."""
        if not self.b.laws.has_law("holder.compliance"):
            return HolderSupport(shear)
        compliance, arm = (self.b.laws(f"holder.{name}", 0.0, None, now) for name in ("compliance", "arm"))
        give = compliance * self.b.scene.width * self.b.foundation.length
        return (
            HolderSupport(shear)
            if give * self.b.foundation.stiffness <= MIN_HOLDER_GIVE_PER_M2
            else HolderSupport(shear, arm, 2.0 / give)
        )

    def _pressure_shape(self, now) -> np.ndarray:
        """Pressure over its mean (columns,) of a block that is not worn."""
        self._invalidate_cache(now)
        shape = self.cache.pressure_shape
        if shape is None:
            mesh = self.b.scene.mesh
            shape = mean_over_columns(self.b.laws, "contact.pressure", mesh, now)
            shape = self.cache.pressure_shape = shape / (np.sum(shape * mesh.column_area) / np.sum(mesh.column_area))
        return shape

    def _tilt_stiffness(self, now) -> tuple[float, float]:
        """K (m2) of the holder's tilt, inf where it is guided; moment (N per m) at a friction of 1."""
        if not self.b.laws.has_law("holder.compliance"):
            return np.inf, 0.0
        compliance, arm = (self.b.laws(f"holder.{name}", 0.0, None, now) for name in ("compliance", "arm"))
        bed, width = self.b.foundation, self.b.scene.width
        give = compliance * width * bed.stiffness * bed.length
        turning = np.inf if give <= MIN_HOLDER_GIVE_PER_M2 else 2.0 / give
        return turning, arm * now.pressure * bed.dx.sum()

    def _solve_mean_friction(self, now, free, moment, tilt_stiffness, T, road, kf):
        """Load-weighted friction that agrees with the pressure which it causes: Newton on one number."""
        bed = self.b.foundation

        def resulting_friction(trial, free, T, road, kf):
            press = bed.solve_equilibrium(free, now.pressure, moment * trial, tilt_stiffness)
            flux, _ = self.solve_fluxes(self.contact_state(now, press.pressure, T), now, T, road, kf)
            return (flux.mu * press.pressure) @ bed.dx / (now.pressure * bed.dx.sum())

        mean = self.cache.mean_friction
        plain = np.real(free), np.real(T), np.real(road), np.real(kf)
        for _ in range(40):
            got = resulting_friction(mean + 1j * COMPLEX_STEP, *plain)
            slope = 1.0 - got.imag / COMPLEX_STEP
            step = (got.real - mean) / slope
            mean += step
            if abs(step) <= 1e-8 * max(abs(mean), 1e-3):  # the next step would be its square
                break
        else:
            raise SolverFailure(f"friction {mean:.3g} and the pressure that it causes do not agree")
        self.cache.mean_friction = mean
        if any(np.iscomplexobj(a) for a in (free, T)):
            return mean + (resulting_friction(mean, free, T, road, kf) - mean) / slope
        return mean

    # --- contact laws --------------------------------------------------------------------------
    def _invalidate_cache(self, now) -> None:
        """Keep of `cache` what still holds."""
        D = self.b.scene.spot_diameter
        if self.b.laws.contact_varies:
            self.cache.invalidate((now.t,))
        else:  # nothing changes once a spot has passed over the rubber
            speed = max(now.last_speed, 1e-12)  # a block that starts from rest
            passed = min(now.slid, D), min(now.contact_time - now.waited, D / speed)
            self.cache.invalidate((now.pressure, now.speed, now.last_speed, now.touching, *passed, now.waited))

    def contact_state(self, now, local, T=None) -> contact_flux.ContactState:
        """Contact laws at a local pressure (columns,) Pa and rises T (cells,), 0 if None."""
        face = None if T is None else T[self.b.cell_block] + self.b.scene.ambient
        seen = (None if a is None else array_key(a) for a in (now.worn, local, face))
        asked = (*now[:SCHEDULE_FIELD_COUNT], now.passed, now.leg, *seen)
        if self.cache.state is None or asked != self.cache.state_key:
            self.cache.state_key, self.cache.state = asked, self._evaluate_laws(now, local, face)
        return self.cache.state

    def _evaluate_laws(self, now, local, face) -> contact_flux.ContactState:
        """Contact laws at a local pressure and temperatures (columns,) K of the block's face."""
        self._invalidate_cache(now)
        laws, mesh, recent, n = self.b.laws, self.b.scene.mesh, self.cache, len(local)
        now = now.under_block(mesh, local_pressure=local, face=face)
        phi = laws("contact.spot_fraction", 0.0, None, now)
        phi = kernels_contact.clip_values(broadcast_columns(phi, n), contact_lanes.MIN_CONTACT_FRACTION, 1.0)
        r, split, micro = (
            laws(f"contact.{name}", 0.0, None, now) for name in ("resistance", "heat_split", "micro_resistance")
        )
        last = recent.contact_fraction
        if last is None or phi.dtype != last.dtype or phi.tobytes() != last.tobytes():
            covered = phi @ mesh.column_area / mesh.column_area.sum()
            seen = now.with_fields(local_pressure=None, spot_fraction=phi, covered=covered)
            recent.contact_fraction, recent.flash_terms = (
                phi,
                (covered, *self._flash_terms(seen), contact_lanes.uniform_lane_ratios(self.b, phi)),
            )
        covered, flash, deep, widen, even = recent.flash_terms
        apart = self._lane_history(now) if even is None else None
        lane, fall = even or (np.ones(n), np.ones(n))
        speed, least = now.speed if now.touching else 0.0, max(LIFT_OFF_PRESSURE_RATIO * now.pressure, 1e-300)
        on, over = common_dtype(local, phi)
        m, light, road = kernels_contact.friction_heat_rows(on, over, speed, least, self.b.share)
        state = contact_flux.ContactState(
            heat_per_mu=m, phi=phi, covered=covered, pressure=local, resistance=r + LIFT_OFF_RESISTANCE_M2K_W / np.expm1(light), flash_resistance=flash,
            micro_resistance=broadcast_columns(micro, n), lane_ratio=lane, loss_ratio=fall, spreading_weights=widen, heat_split=broadcast_columns(split, n),
            depth_fraction=self.b.depth_fraction, depth_flash=deep, block_coverage=phi, road_coverage=road, half_cell_factor=phi, touched_road=RoadOverlap(self.b.cell_road),
            lane_history=apart,
        )  # fmt: skip
        return self._with_resolved_spots(state, now) if laws.has_law("contact.cover") else state

    def _with_resolved_spots(self, state, now) -> contact_flux.ContactState:
        """The state where spots cover their columns one by one instead of on average, and carry the load together."""
        w = self.b.laws("contact.resolved", 0.0, None, now)
        if w == 0.0:
            return state
        (cover, under, edge, rim), area = self._spot_coverage(now), self.b.scene.mesh.column_area
        carried = np.sum(state.pressure / state.phi * cover * area)
        if now.pressure > 0 and not np.real(carried) > 0:
            raise SolverFailure("no spot is under the block; give more or larger spots")
        load = np.sum(state.pressure * area) / carried if now.pressure > 0 else 1.0
        block = state.block_coverage + w * (cover - state.block_coverage)
        return state._replace(
            heat_per_mu=state.heat_per_mu + w * (load - 1.0) * state.heat_per_mu,
            phi=state.phi + w * (cover - state.phi),
            covered=state.covered + w * (1.0 - state.covered),
            flash_resistance=(1.0 - w) * state.flash_resistance + w * edge,
            depth_flash=(1.0 - w) * state.depth_flash,
            lane_ratio=state.lane_ratio + w * (1.0 - state.lane_ratio),
            loss_ratio=state.loss_ratio + w * (1.0 - state.loss_ratio),
            spreading_weights=(1.0 - w) * state.spreading_weights,
            block_coverage=block,
            road_coverage=block / self.b.share,
            half_cell_factor=state.half_cell_factor + w * (1.0 - state.half_cell_factor),
            touched_road=under,
            rim_resistance=w * rim,
            lane_history=state.lane_history if w < 1.0 else None,
        )

    def _spot_coverage(self, now) -> tuple[np.ndarray, RoadOverlap, np.ndarray | float, np.ndarray | float]:
        """Share of every column that spots cover, the road under it, `RoadFrame.edge` and `ContactState.rim`."""
        b, frame, mesh = self.b, self.b.road_frame, self.b.scene.mesh
        edges = mesh.x[mesh.first : mesh.last + 1] if frame is None else frame.strip_edges(now.passed)
        cover = b.laws("contact.cover", 0.0, None, now.with_fields(lead=edges))
        if frame is None:
            return cover, RoadOverlap(b.cell_road), 0.0, 0.0
        area = cover.reshape(-1, mesh.n_across) * np.diff(edges)[:, None]
        under = frame.find_overlap(now.passed, b.cell_road, area)
        bare = 1.0 - b.laws("contact.cover", 0.0, None, now.with_fields(lead=frame.column_edges(now.passed)))
        passed = np.minimum(now.contact_time, now.waited + mesh.column_x / max(now.last_speed, 1e-300))
        rim = frame.rim_resistance(under, bare.reshape(-1, mesh.n_across), passed, b.scene.road)
        cover = (area[::2] + area[1::2]).ravel() / frame.dx
        return cover, under, frame.partial_cover_resistance(cover, now.last_speed, b.scene.block), rim

    def _history_weights(self, slid: float) -> tuple[np.ndarray, np.ndarray]:
        """`lanes.weights` after `slid` m; they stay as they are once the block has slid by its length."""
        mesh, recent = self.b.scene.mesh, self.cache
        way = contact_lanes.slid_road_length(mesh, slid)
        if way != recent.slid_length:
            recent.slid_length, recent.history_weights = way, contact_lanes.history_weights(mesh, way)
        return recent.history_weights

    def _lane_history(self, now) -> contact_lanes.LaneHistory:
        """`lanes.apart` of the contact fraction: it stays while that and what lanes remember do."""
        recent = self.cache
        asked = (recent.contact_fraction, self._history_weights(now.leg), now.pressure * (now.speed or now.last_speed))
        if (
            not recent.lane_history
            or any(a is not b for a, b in zip(asked[:2], recent.lane_history, strict=False))
            or (asked[2] != recent.lane_history[2])
        ):
            recent.lane_history = (*asked, contact_lanes.build_lane_history(self.b, *asked))
        found: contact_lanes.LaneHistory = recent.lane_history[3]
        return found

    def _flash_terms(self, now):
        """Flash resistances of surface and depth, and how lanes widen: these see phi only."""
        laws, one = self.b.laws, np.ones(len(now.x))
        flash = laws("contact.flash_resistance", 0.0, None, now) * one
        deep = 0.0 * one
        if flash.any():
            for d in self.b.volumetric:
                deep = deep + d.share * flash * laws("contact.flash_share", 0.0, None, now, d.depth)
        return flash, deep, contact_lanes.spreading_loss(self.b, now, self.b.scene.mesh.depth)

    def spreading_loss_at_depth(self, state, now) -> np.ndarray:
        """`lanes.loss_at_depth` at a state: it stays while what else follows from the contact fraction alone does."""
        recent = self.cache
        if state.phi is not recent.contact_fraction:
            return contact_lanes.spreading_loss_at_depth(self.b, self.moment_at_contact(state, now))
        if not recent.depth_loss or recent.depth_loss[0] is not recent.flash_terms:
            recent.depth_loss = (
                recent.flash_terms,
                contact_lanes.spreading_loss_at_depth(self.b, self.moment_at_contact(state, now)),
            )
        weights: np.ndarray = recent.depth_loss[1]
        return weights

    def moment_at_contact(self, state, now):
        """The moment as laws of the contact see it: place, local pressure and contact fraction."""
        return now.under_block(
            self.b.scene.mesh, local_pressure=state.pressure, spot_fraction=state.phi, covered=state.covered
        )

    def solve_fluxes(self, state, now, T, road, kf, slopes: bool = False):
        """Interface fluxes, with `slopes` their slopes, else None, at rises T (cells,) with a `road` that enters.

        See `contact_flux.solve`.
        """
        b, laws, ambient = self.b, self.b.laws, self.b.scene.ambient
        state = self.separate_lanes(state, now, T, road)
        at = self.moment_at_contact(state, now)
        bare = at
        if np.iscomplexobj(state.phi) or np.iscomplexobj(state.pressure):
            bare = at.with_fields(
                local_pressure=np.real(state.pressure), spot_fraction=np.real(state.phi), covered=np.real(state.covered)
            )

        def temperature_law(target, base):
            def evaluate_law(T, face, apart=False):
                return laws(target, base, T, (bare if apart else at).with_fields(face=face)) + 0.0 * T

            return evaluate_law

        return contact_flux.solve_fluxes(
            state,
            T[b.cell_block] + ambient,
            contact_lanes.lane_rises(b, state, T, road) + ambient,
            b.half_block if kf is b.ones else b.half_block / kf[b.cell_block],
            (b.half_road if kf is b.ones else b.half_road / kf[b.cell_road]) + state.rim_resistance,
            temperature_law("friction.mu", 0.0),
            temperature_law("friction.in_depth", 1.0) if laws.has_law("friction.in_depth") else None,
            self.cache.touch_temperature,
            slopes,
        )

    def separate_lanes(self, state, now, T, road) -> contact_flux.ContactState:
        """The state with its lanes told apart from their columns at rises T (cells,), where that is still to be done.

        Of a block that rests the lanes hold the heat that its last speed gave.
        """
        if state.lane_history is None:
            return state
        b, laws = self.b, self.b.laws
        face = T[b.cell_block] + b.scene.ambient
        at = self.moment_at_contact(state, now).with_fields(face=face)
        least = contact_lanes.MIN_LANE_CONTACT_RATIO * state.covered
        spots = np.where(np.real(state.phi) > np.real(least), state.phi, least)
        touch = face + (state.flash_resistance + state.micro_resistance) * contact_lanes.heat_into_block(b, T) / spots
        own = laws("friction.in_depth", 1.0, touch, at) if laws.has_law("friction.in_depth") else 1.0
        heat = state.pressure * (now.speed or now.last_speed) * laws("friction.mu", 0.0, touch, at)
        return contact_lanes.separate_lanes(b, state, T, road, heat * (1.0 - state.depth_fraction * own))

    # --- abrasion ------------------------------------------------------------------------------------
    def abrasion_rate(self, state, flux, now) -> np.ndarray:
        """dw/dt (columns,) in m/s."""
        at = self.moment_at_contact(state, now).with_fields(friction=flux.mu)
        return now.speed * broadcast_columns(self.b.laws("block.abrasion", 0.0, flux.spot, at), len(at.x))

    def abrasion_coupling(self, contact: SolvedContact, now, worn, T, road, kf, gamma: float) -> AbrasionCoupling:
        """Around a contact with slopes, worn by `worn` (columns,) m, for the preconditioner of I - gamma J."""
        b, flux, d = self.b, contact.flux, contact.slopes
        assert flux is not None
        assert d is not None
        now = now.with_fields(worn=worn) if b.abrades else now
        more = contact.pressure_solution.pressure + 1j * COMPLEX_STEP
        harder = self.contact_state(now, more, T)
        pressing, _ = self.solve_fluxes(harder, now, T, road, kf)
        pressed = self._sparse_response(harder, pressing, now)
        seen = self.moment_at_contact(
            contact.state, now.with_fields(worn=worn + 1j * COMPLEX_STEP) if b.abrades else now
        )
        thicker = 1j * np.imag(b.laws("contact.resistance", 0.0, None, seen))
        deeper = contact.state._replace(resistance=contact.state.resistance + thicker) if np.any(thicker) else None
        spot, mu = (
            complex_step_derivative(self.abrasion_rate(contact.state, flux._replace(**{k: v + 1j * COMPLEX_STEP}), now))
            for k, v in (("spot", flux.spot), ("mu", flux.mu))
        )
        elastic = None if b.elastic_block is None or not now.touching else self.cache.elastic_solution
        if b.elastic_block is None or elastic is None:
            response: SpringResponse | ElasticResponse = b.foundation.pressure_response(contact.pressure_solution)
        else:  # the slopes of friction are there: what follows is settled with them too
            self.cache.elastic_solution = elastic = b.elastic_block.renew_jacobian(
                elastic, complex_step_derivative(more * pressing.mu)
            )
            response = b.elastic_block.pressure_response(elastic)
        return AbrasionCoupling(
            b,
            contact.state.touched_road,
            pressed,
            None
            if deeper is None
            else self._sparse_response(deeper, self.solve_fluxes(deeper, now, T, road, kf)[0], now),
            abrasion_slopes=tuple((spot * d.spot[i] + mu * d.mu[i]) / b.worn_unit for i in (0, 1)),
            pressure_by_depth=response,
            solve_depth=response.build_inverse(gamma * pressed.abrasion),
            traction_slopes=tuple(contact.pressure_solution.pressure * slope for slope in d.mu),
        )

    @cached_property
    def _aligned_sparsity(self) -> SparsityPattern:
        """Of answers where the road lies on the block's lines."""
        return build_sparsity(self.b, RoadOverlap(self.b.cell_road))

    def _sparse_response(self, state, flux, now) -> SparseResponse:
        """How heat and abrasion follow what has a complex step in a state with its fluxes."""
        area = self.b.scene.mesh.column_area
        taken = flux.into_road * area
        return SparseResponse.from_derivatives(
            self._aligned_sparsity if state.touched_road.other is None else build_sparsity(self.b, state.touched_road),
            self.b,
            state.touched_road,
            face=complex_step_derivative(state.block_coverage * flux.into_block * area),
            deep=complex_step_derivative(state.block_coverage * flux.deep * area),
            road=complex_step_derivative(state.road_coverage * taken),
            books=(
                complex_step_derivative(state.block_coverage * flux.heat * area),
                complex_step_derivative(state.block_coverage * taken),
            ),
            abrasion=complex_step_derivative(self.abrasion_rate(state, flux, now)),
        )
