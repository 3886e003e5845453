"""The interface of block and road: contact pressure, contact laws at that pressure, heat fluxes and their derivatives.

The block is elastic (`elastic_contact`) or a spring foundation (`winkler_foundation`).  Pressure is not a state: it
balances load and moment at every evaluation (theory.md, section 7.3), and the fluxes follow from it (`contact_flux`).
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
from flashtemp.solver.elastic_contact import ElasticResponse, FrictionLaw, HolderSupport
from flashtemp.solver.evaluation_cache import InterfaceCache, array_key
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.kernels_contact import broadcast_columns, common_dtype
from flashtemp.solver.road_frame import RoadOverlap
from flashtemp.solver.wear_coupling import (
    AbrasionCoupling,
    SparseResponse,
    SparsityPattern,
    build_sparsity,
    complex_step_derivative,
)
from flashtemp.solver.winkler_foundation import PressureSolution, SpringResponse

SCHEDULE_FIELD_COUNT = LawContext._fields.index("repetition") + 1  # the first fields, which the schedule determines
MIN_HOLDER_GIVE_PER_M2 = 1e-200  # 1/m2: a holder that gives less counts as guided
LIFT_OFF_PRESSURE_RATIO = 0.01  # of the mean pressure: below it the contact opens
LIFT_OFF_RESISTANCE_M2K_W = 1e-4  # m2 K/W, scale of the resistance of the contact that opens


class SolvedContact(NamedTuple):
    """Block and road at one instant: contact laws, pressure, and the fluxes unless the block is lifted."""

    state: contact_flux.ContactState
    pressure_solution: PressureSolution
    flux: contact_flux.ContactFluxes | None = None
    slopes: contact_flux.FluxSlopes | None = None


@dataclass(frozen=True)
class ContactInterface:
    """Pressure, contact laws and fluxes under the block of a `HeatBalance`."""

    b: HeatBalance
    cache: InterfaceCache = field(default_factory=InterfaceCache)

    # --- pressure ------------------------------------------------------------------------------
    def solve_contact(self, now, worn, T, road, kf, slopes: bool = False) -> SolvedContact:
        """Solve pressure, contact laws and fluxes at one instant; a lifted block has no fluxes.

        Arguments are those of `solve_pressure_and_laws`; with `slopes` the derivatives of the fluxes are returned too.
        """
        now, press, state = self.solve_pressure_and_laws(now, worn, T, road, kf)
        state = self.separate_lanes(state, now, T, road)
        if not now.touching:
            return SolvedContact(state, press)
        if slopes:
            state = contact_lanes.limit_lane_slopes(self.b, state, T, road)
        if not slopes and self.cache.flux is not None:
            flux, slope = self.cache.flux, None  # from the last evaluation of friction for the elastic block
        else:
            flux, slope = self.solve_fluxes(state, now, T, road, kf, slopes)
        self.cache.touch_temperature = np.real(flux.touch)
        return SolvedContact(state, press, flux, slope)

    def solve_pressure_and_laws(
        self, now, worn, T, road, kf
    ) -> tuple[LawContext, PressureSolution, contact_flux.ContactState]:
        """Pressure and contact laws of a block worn by `worn` (columns,) m; returns also the context for other laws.

        `T` (cells,) are temperature rises in K, `road` is `PhaseSystem.incoming_road`, `kf` (cells,) the factor on the
        conductivity.
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
        """Pressure of a block on springs, or a prescribed pressure, with the friction moment of eq. (24)."""
        b = self.b
        free = now.pressure * self._pressure_shape(now) - b.foundation.stiffness * worn
        if b.expansion:
            free = free + b.foundation.stiffness * b.thermal_displacement(T)
        turning, moment = self._tilt_stiffness(now) if now.touching and now.pressure > 0 else (np.inf, 0.0)
        if turning < np.inf:
            moment = moment * self._solve_mean_friction(now, free, moment, turning, T, road, kf)
        return b.foundation.solve_equilibrium(free, now.pressure, moment, turning)

    def _solve_elastic_pressure(self, now, worn, T, road, kf) -> PressureSolution:
        """Pressure of the elastic block, eqs. (21) to (24), with friction consistent in every column."""
        b, bed, recent = self.b, self.b.elastic_block, self.cache
        assert bed is not None
        flat, shear = (b.laws(f"contact.{name}", 0.0, None, now) for name in ("flat_face", "shear_traction"))
        if not (
            flat or shear or b.expansion or worn.any() or np.iscomplexobj(worn) or b.laws.has_law("holder.compliance")
        ):
            # nothing deforms the block: the prescribed pressure, unchanged to the last bit
            return self._solve_spring_pressure(now, worn, T, road, kf)
        # a prescribed pressure that differs from that of a flat face is turned into the profile of the unworn face that
        # causes it, so it adds to `face_shape`, and discovery can test for it
        gap = worn - bed.displace_face(now.pressure * (self._pressure_shape(now) - flat))
        if b.expansion:
            gap = gap - b.thermal_displacement(T)
        hardness = b.relative_modulus(T)
        holder = self._holder_support(now, shear)
        needs_friction = shear != 0.0 or not holder.is_guided

        def friction_law(T, road, kf) -> FrictionLaw:
            def friction_at_pressure(pressure):  # solves the fluxes, because friction depends on the spots' temperature
                recent.flux, _ = self.solve_fluxes(self.contact_state(now, pressure, T), now, T, road, kf)
                return recent.flux.mu

            return friction_at_pressure

        real_law = friction_law(*(np.real(a) for a in (T, road, kf))) if needs_friction else None
        solution = bed.solve_equilibrium(
            np.real(gap), now.pressure, holder, real_law, recent.elastic_solution, float(np.real(hardness))
        )
        recent.elastic_solution = solution
        if any(np.iscomplexobj(a) for a in (gap, T, road, kf)):
            # the active set is found with real numbers; a complex step then passes through the solved equations
            complex_law = friction_law(T, road, kf) if needs_friction else None
            solution = bed.derive_solution(solution, gap, now.pressure, complex_law, hardness)
            recent.flux = None
        return bed.to_pressure_solution(solution)

    def _holder_support(self, now, shear: float) -> HolderSupport:
        """The support of the elastic block by its holder; a holder of negligible compliance is guided."""
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
        """Pressure over its mean (columns,) of the unworn block, from the law `contact.pressure`."""
        self._invalidate_cache(now)
        shape = self.cache.pressure_shape
        if shape is None:
            mesh = self.b.scene.mesh
            shape = mean_over_columns(self.b.laws, "contact.pressure", mesh, now)
            shape = self.cache.pressure_shape = shape / (np.sum(shape * mesh.column_area) / np.sum(mesh.column_area))
        return shape

    def _tilt_stiffness(self, now) -> tuple[float, float]:
        """Stiffness K (m2) of the holder against tilt, inf if it is guided, and the moment (N per m) at mu = 1."""
        if not self.b.laws.has_law("holder.compliance"):
            return np.inf, 0.0
        compliance, arm = (self.b.laws(f"holder.{name}", 0.0, None, now) for name in ("compliance", "arm"))
        bed, width = self.b.foundation, self.b.scene.width
        give = compliance * width * bed.stiffness * bed.length
        turning = np.inf if give <= MIN_HOLDER_GIVE_PER_M2 else 2.0 / give
        return turning, arm * now.pressure * bed.dx.sum()

    def _solve_mean_friction(self, now, free, moment, tilt_stiffness, T, road, kf):
        """Load-weighted friction that is consistent with the pressure that it causes, by Newton's method on one number.

        Friction tilts the holder, that changes the pressure, and that the friction.  Raises SolverFailure.
        """
        bed = self.b.foundation

        def resulting_friction(trial, free, T, road, kf):
            press = bed.solve_equilibrium(free, now.pressure, moment * trial, tilt_stiffness)
            flux, _ = self.solve_fluxes(self.contact_state(now, press.pressure, T), now, T, road, kf)
            return (flux.mu * press.pressure) @ bed.dx / (now.pressure * bed.dx.sum())

        mean = self.cache.mean_friction
        real_arguments = np.real(free), np.real(T), np.real(road), np.real(kf)
        for _ in range(40):
            result = resulting_friction(mean + 1j * COMPLEX_STEP, *real_arguments)
            slope = 1.0 - result.imag / COMPLEX_STEP
            step = (result.real - mean) / slope
            mean += step
            if abs(step) <= 1e-8 * max(abs(mean), 1e-3):  # quadratic convergence: the next step would be rounding
                break
        else:
            raise SolverFailure(f"friction {mean:.3g} and the pressure that it causes do not agree after 40 iterations")
        self.cache.mean_friction = mean
        if any(np.iscomplexobj(a) for a in (free, T)):  # one complex Newton step carries the derivative
            return mean + (resulting_friction(mean, free, T, road, kf) - mean) / slope
        return mean

    # --- contact laws --------------------------------------------------------------------------
    def _invalidate_cache(self, now) -> None:
        """Drop cached laws whose arguments have changed."""
        D = self.b.scene.spot_diameter
        if self.b.laws.contact_varies:
            self.cache.invalidate((now.t,))
        else:  # the flash closure, eq. (13b), is constant once the block has slid by one spot diameter
            speed = max(now.last_speed, 1e-12)  # not zero for a block that starts from rest
            passed = min(now.slid, D), min(now.contact_time - now.waited, D / speed)
            self.cache.invalidate((now.pressure, now.speed, now.last_speed, now.touching, *passed, now.waited))

    def contact_state(self, now, local, T=None) -> contact_flux.ContactState:
        """Contact laws at a `local` pressure (columns,) Pa and rises T (cells,), 0 if None; the last is cached."""
        face = None if T is None else T[self.b.cell_block] + self.b.scene.ambient
        arrays = (None if a is None else array_key(a) for a in (now.worn, local, face))
        key = (*now[:SCHEDULE_FIELD_COUNT], now.passed, now.leg, *arrays)
        if self.cache.state is None or key != self.cache.state_key:
            self.cache.state_key, self.cache.state = key, self._evaluate_laws(now, local, face)
        return self.cache.state

    def _evaluate_laws(self, now, local, face) -> contact_flux.ContactState:
        """Contact laws at a `local` pressure (columns,) Pa and temperatures `face` (columns,) K of the block's face."""
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
            context = now.with_fields(local_pressure=None, spot_fraction=phi, covered=covered)
            uniform = contact_lanes.uniform_lane_ratios(self.b, phi)
            recent.contact_fraction, recent.flash_terms = phi, (covered, *self._flash_terms(context), uniform)
        covered, flash, depth_flash, weights, uniform = recent.flash_terms
        history = self._lane_history(now) if uniform is None else None  # ratios follow later, from temperatures
        lane, loss = uniform or (np.ones(n), np.ones(n))
        speed, least = now.speed if now.touching else 0.0, max(LIFT_OFF_PRESSURE_RATIO * now.pressure, 1e-300)
        on, over = common_dtype(local, phi)
        m, light, road = kernels_contact.friction_heat_rows(on, over, speed, least, self.b.share)
        state = contact_flux.ContactState(
            heat_per_mu=m,
            phi=phi,
            covered=covered,
            pressure=local,
            resistance=r + LIFT_OFF_RESISTANCE_M2K_W / np.expm1(light),
            flash_resistance=flash,
            micro_resistance=broadcast_columns(micro, n),
            lane_ratio=lane,
            loss_ratio=loss,
            spreading_weights=weights,
            heat_split=broadcast_columns(split, n),
            depth_fraction=self.b.depth_fraction,
            depth_flash=depth_flash,
            block_coverage=phi,
            road_coverage=road,
            half_cell_factor=phi,
            touched_road=RoadOverlap(self.b.cell_road),
            lane_history=history,
        )
        return self._with_resolved_spots(state, now) if laws.has_law("contact.cover") else state

    def _with_resolved_spots(self, state, now) -> contact_flux.ContactState:
        """The state of Level R (theory.md, section 1.3): spots cover their columns one by one and carry the load.

        With the weight w of `resolved_spots` between 0 and 1, every field is interpolated between Level H and Level R.
        """
        w = self.b.laws("contact.resolved", 0.0, None, now)
        if w == 0.0:
            return state
        (cover, under, edge, rim), area = self._spot_coverage(now), self.b.scene.mesh.column_area
        carried = np.sum(state.pressure / state.phi * cover * area)
        if now.pressure > 0 and not np.real(carried) > 0:
            raise SolverFailure("no spot is under the block; use more or larger spots")
        # spots carry the whole load: their pressure p/phi is scaled where they cover more or less than phi
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
        """Fraction of every column that spots cover, the road under it, and the rim resistances of block and road.

        The resistances are those of eq. (7c).
        """
        b, frame, mesh = self.b, self.b.road_frame, self.b.scene.mesh
        edges = mesh.x[mesh.first : mesh.last + 1] if frame is None else frame.strip_edges(now.passed)
        cover = b.laws("contact.cover", 0.0, None, now.with_fields(lead=edges))
        if frame is None:
            return cover, RoadOverlap(b.cell_road), 0.0, 0.0
        # every line under the block is cut into two strips where a column of the road ends
        area = cover.reshape(-1, mesh.n_across) * np.diff(edges)[:, None]
        under = frame.find_overlap(now.passed, b.cell_road, area)
        bare = 1.0 - b.laws("contact.cover", 0.0, None, now.with_fields(lead=frame.column_edges(now.passed)))
        passed = np.minimum(now.contact_time, now.waited + mesh.column_x / max(now.last_speed, 1e-300))
        rim = frame.rim_resistance(under, bare.reshape(-1, mesh.n_across), passed, b.scene.road)
        cover = (area[::2] + area[1::2]).ravel() / frame.dx
        return cover, under, frame.partial_cover_resistance(cover, now.last_speed, b.scene.block), rim

    def _history_weights(self, slid: float) -> tuple[np.ndarray, np.ndarray]:
        """`contact_lanes.history_weights` after `slid` m; constant once the block has slid by its own length."""
        mesh, recent = self.b.scene.mesh, self.cache
        length = contact_lanes.slid_road_length(mesh, slid)
        if length != recent.slid_length:
            recent.slid_length, recent.history_weights = length, contact_lanes.history_weights(mesh, length)
        return recent.history_weights

    def _lane_history(self, now) -> contact_lanes.LaneHistory:
        """`LaneHistory` of the contact fraction; cached while fraction, weights and heat at mu = 1 stay the same."""
        recent = self.cache
        key = (recent.contact_fraction, self._history_weights(now.leg), now.pressure * (now.speed or now.last_speed))
        if (
            not recent.lane_history
            or any(a is not b for a, b in zip(key[:2], recent.lane_history, strict=False))
            or (key[2] != recent.lane_history[2])
        ):
            recent.lane_history = (*key, contact_lanes.build_lane_history(self.b, *key))
        history: contact_lanes.LaneHistory = recent.lane_history[3]
        return history

    def _flash_terms(self, now):
        """Flash resistances of eq. (12) for heat at the surface and in depth, and the weights of eq. (15c).

        Of the fields that vary along the block, these laws use the contact fraction only.
        """
        laws, one = self.b.laws, np.ones(len(now.x))
        flash = laws("contact.flash_resistance", 0.0, None, now) * one
        deep = 0.0 * one
        if flash.any():
            for d in self.b.volumetric:
                deep = deep + d.share * flash * laws("contact.flash_share", 0.0, None, now, d.depth)
        return flash, deep, contact_lanes.spreading_loss(self.b, now, self.b.scene.mesh.depth)

    def spreading_loss_at_depth(self, state, now) -> np.ndarray:
        """`contact_lanes.spreading_loss_at_depth` at a state; cached as long as `flash_terms` is."""
        recent = self.cache
        if state.phi is not recent.contact_fraction:
            return contact_lanes.spreading_loss_at_depth(self.b, self.context_at_contact(state, now))
        if not recent.depth_loss or recent.depth_loss[0] is not recent.flash_terms:
            recent.depth_loss = (
                recent.flash_terms,
                contact_lanes.spreading_loss_at_depth(self.b, self.context_at_contact(state, now)),
            )
        weights: np.ndarray = recent.depth_loss[1]
        return weights

    def context_at_contact(self, state, now):
        """The context for laws of the contact: position, local pressure and contact fraction of every column."""
        return now.under_block(
            self.b.scene.mesh, local_pressure=state.pressure, spot_fraction=state.phi, covered=state.covered
        )

    def solve_fluxes(self, state, now, T, road, kf, slopes: bool = False):
        """`contact_flux.solve_fluxes` at rises T (cells,): the fluxes, and with `slopes` their derivatives, else None.

        Friction sees the complex step of the state, or with `apart` only that of its own temperatures.
        """
        b, laws, ambient = self.b, self.b.laws, self.b.scene.ambient
        state = self.separate_lanes(state, now, T, road)
        at = self.context_at_contact(state, now)
        real_at = at
        if np.iscomplexobj(state.phi) or np.iscomplexobj(state.pressure):
            real_at = at.with_fields(
                local_pressure=np.real(state.pressure), spot_fraction=np.real(state.phi), covered=np.real(state.covered)
            )

        def temperature_law(target, base):
            def evaluate_law(T, face, apart=False):
                return laws(target, base, T, (real_at if apart else at).with_fields(face=face)) + 0.0 * T

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
        """The state with the lane ratios of eq. (15d) at rises T (cells,), if they still have to be evaluated.

        The lanes of a resting block hold the heat of its last speed.
        """
        if state.lane_history is None:
            return state
        b, laws = self.b, self.b.laws
        face = T[b.cell_block] + b.scene.ambient
        at = self.context_at_contact(state, now).with_fields(face=face)
        least = contact_lanes.MIN_LANE_CONTACT_RATIO * state.covered
        spots = np.where(np.real(state.phi) > np.real(least), state.phi, least)
        touch = face + (state.flash_resistance + state.micro_resistance) * contact_lanes.heat_into_block(b, T) / spots
        factor = laws("friction.in_depth", 1.0, touch, at) if laws.has_law("friction.in_depth") else 1.0
        heat = state.pressure * (now.speed or now.last_speed) * laws("friction.mu", 0.0, touch, at)
        return contact_lanes.separate_lanes(b, state, T, road, heat * (1.0 - state.depth_fraction * factor))

    # --- abrasion ------------------------------------------------------------------------------------
    def abrasion_rate(self, state, flux, now) -> np.ndarray:
        """Wear rate dw/dt (columns,) in m/s: eq. (25) times the speed."""
        at = self.context_at_contact(state, now).with_fields(friction=flux.mu)
        return now.speed * broadcast_columns(self.b.laws("block.abrasion", 0.0, flux.spot, at), len(at.x))

    def abrasion_coupling(self, contact: SolvedContact, now, worn, T, road, kf, gamma: float) -> AbrasionCoupling:
        """Derivatives by which wear, expansion and friction couple to the heat, for J and for P of I - gamma J.

        `contact` is a solved contact with slopes.  Derivatives with respect to pressure and worn depth are complex
        steps through the contact laws and fluxes.
        """
        b, flux, d = self.b, contact.flux, contact.slopes
        assert flux is not None
        assert d is not None
        now = now.with_fields(worn=worn) if b.abrades else now
        stepped_pressure = contact.pressure_solution.pressure + 1j * COMPLEX_STEP
        at_pressure = self.contact_state(now, stepped_pressure, T)
        pressure_flux, _ = self.solve_fluxes(at_pressure, now, T, road, kf)
        by_pressure = self._sparse_response(at_pressure, pressure_flux, now)
        # at the same pressure, worn depth acts on heat only through debris in the contact: by its resistance
        context = self.context_at_contact(
            contact.state, now.with_fields(worn=worn + 1j * COMPLEX_STEP) if b.abrades else now
        )
        debris = 1j * np.imag(b.laws("contact.resistance", 0.0, None, context))
        at_depth = contact.state._replace(resistance=contact.state.resistance + debris) if np.any(debris) else None
        spot, mu = (
            complex_step_derivative(self.abrasion_rate(contact.state, flux._replace(**{k: v + 1j * COMPLEX_STEP}), now))
            for k, v in (("spot", flux.spot), ("mu", flux.mu))
        )
        elastic = None if b.elastic_block is None or not now.touching else self.cache.elastic_solution
        if b.elastic_block is None or elastic is None:
            response: SpringResponse | ElasticResponse = b.foundation.pressure_response(contact.pressure_solution)
        else:  # d(mu p)/dp is known here: the next solutions of the pressure start with this Jacobian too
            self.cache.elastic_solution = elastic = b.elastic_block.renew_jacobian(
                elastic, complex_step_derivative(stepped_pressure * pressure_flux.mu)
            )
            response = b.elastic_block.pressure_response(elastic)
        return AbrasionCoupling(
            b,
            contact.state.touched_road,
            by_pressure,
            None
            if at_depth is None
            else self._sparse_response(at_depth, self.solve_fluxes(at_depth, now, T, road, kf)[0], now),
            abrasion_slopes=tuple((spot * d.spot[i] + mu * d.mu[i]) / b.worn_unit for i in (0, 1)),
            pressure_by_depth=response,
            solve_depth=response.build_wear_inverse(gamma * by_pressure.abrasion),
            traction_slopes=tuple(contact.pressure_solution.pressure * slope for slope in d.mu),
        )

    @cached_property
    def _aligned_sparsity(self) -> SparsityPattern:
        """Sparsity of a `SparseResponse` where the road's columns lie on the block's lines."""
        return build_sparsity(self.b, RoadOverlap(self.b.cell_road))

    def _sparse_response(self, state, flux, now) -> SparseResponse:
        """Derivatives of heat and abrasion with respect to the variable that has a complex step in state and fluxes."""
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
