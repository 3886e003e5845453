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
from flashtemp.model.laws import STEP, laws_mean
from flashtemp.model.scene import Moment
from flashtemp.solver import contact_flux, kernels_contact, lanes
from flashtemp.solver.abrasion import AbrasionCoupling, Answer, Pattern, pattern, slope
from flashtemp.solver.balance import Balance
from flashtemp.solver.elastic_foundation import ElasticResponse, Friction, Holder
from flashtemp.solver.kernels_contact import alike, columns
from flashtemp.solver.recent import Recent, same
from flashtemp.solver.road_frame import Overlap
from flashtemp.solver.winkler import Press, Response

SCHEDULED = Moment._fields.index("repetition") + 1  # what a moment's first fields say follows from the schedule
RIGID = 1e-200  # 1/m2: a holder that gives less does not turn
LIGHT, OPEN = 0.01, 1e-4  # contact opens below this share of the mean pressure; scale of its resistance, m2 K/W


class Contact(NamedTuple):
    """Block and road at one instant: contact laws, what the holder does, and unless it is lifted, fluxes."""

    state: contact_flux.ContactState
    press: Press
    flux: contact_flux.Fluxes | None = None
    slopes: contact_flux.Slopes | None = None


@dataclass(frozen=True)
class Interface:
    """Pressure and contact laws under the block of a balance."""

    b: Balance
    recent: Recent = field(default_factory=Recent)

    # --- pressure ------------------------------------------------------------------------------
    def contact(self, now, worn, T, road, kf, slopes: bool = False) -> Contact:
        """Settle the block on the road and solve the contact.

        While the block is lifted there are no fluxes.
        """
        now, press, state = self.settled(now, worn, T, road, kf)
        state = self.separate_lanes(state, now, T, road)
        if not now.touching:
            return Contact(state, press)
        if slopes:
            state = lanes.limited(self.b, state, T, road)
        if not slopes and self.recent.flux is not None:
            flux, slope = self.recent.flux, None
        else:
            flux, slope = self.fluxes(state, now, T, road, kf, slopes)
        self.recent.touch = np.real(flux.touch)
        return Contact(state, press, flux, slope)

    def settled(self, now, worn, T, road, kf) -> tuple[Moment, Press, contact_flux.ContactState]:
        """The block, worn by `worn` (columns,) m, on the road: the moment as laws see it, pressure and contact laws.

        `T` (cells,) rises, `road` that enters as `System.road` says, `kf` (cells,) factor on k.
        """
        b = self.b
        if b.calm:
            self._recall(now)
            if self.recent.settled is not None:
                return now, *self.recent.settled
        self.recent.flux = None
        now = now.seeing(worn=worn) if b.abrades else now
        if b.elastic is None or not (now.touching and now.pressure > 0):
            press = self._press_on_springs(now, worn, T, road, kf)
        else:
            press = self._press_elastic_block(now, worn, T, road, kf)
        state = self.state(now, press.pressure, T)
        if b.calm and self.recent.even:
            self.recent.settled = press, state
        return now, press, state

    def _press_on_springs(self, now, worn, T, road, kf) -> Press:
        """Pressure of a block whose columns are springs side by side, or whose pressure is prescribed."""
        b = self.b
        free = now.pressure * self._pressed(now) - b.foundation.stiffness * worn
        if b.expansion:
            free = free + b.foundation.stiffness * b.swelling(T)
        turning, moment = self._turning(now) if now.touching and now.pressure > 0 else (np.inf, 0.0)
        if turning < np.inf:
            moment = moment * self._friction(now, free, moment, turning, T, road, kf)
        return b.foundation.settle(free, now.pressure, moment, turning)

    def _press_elastic_block(self, now, worn, T, road, kf) -> Press:
        """Pressure of the elastic block, at a friction that agrees with it column by column."""
        b, bed, recent = self.b, self.b.elastic, self.recent
        assert bed is not None
        flat, shear = (b.laws(f"contact.{name}", 0.0, None, now) for name in ("flat_face", "shear_traction"))
        if not (flat or shear or b.expansion or worn.any() or np.iscomplexobj(worn) or b.laws.has("holder.compliance")):
            return self._press_on_springs(
                now, worn, T, road, kf
            )  # nothing moves it: the prescribed pressure, to the bit
        # the profile of a new block gives what is prescribed beyond the share of a flat face: a pressure of another
        # shape acts beside `face_shape` too, and discovery can look for one
        gap = worn - bed.displace_face(now.pressure * (self._pressed(now) - flat))
        if b.expansion:
            gap = gap - b.swelling(T)
        hardness = b.relative_modulus(T)
        holder = self._holder_of(now, shear)
        pulled = shear != 0.0 or not holder.guided

        def friction(T, road, kf) -> Friction:
            def found(pressure):
                recent.flux, _ = self.fluxes(self.state(now, pressure, T), now, T, road, kf)
                return recent.flux.mu

            return found

        plain = (np.real(a) for a in (T, road, kf))
        asked = friction(*plain) if pulled else None
        settled = bed.settle(np.real(gap), now.pressure, holder, asked, recent.elastic, float(np.real(hardness)))
        recent.elastic = settled
        if any(np.iscomplexobj(a) for a in (gap, T, road, kf)):
            settled = bed.derive_solution(
                settled, gap, now.pressure, friction(T, road, kf) if pulled else None, hardness
            )
            recent.flux = None
        return bed.as_press(settled)

    def _holder_of(self, now, shear: float) -> Holder:
        """What the holder does; one that hardly gives is guided."""
        if not self.b.laws.has("holder.compliance"):
            return Holder(shear)
        compliance, arm = (self.b.laws(f"holder.{name}", 0.0, None, now) for name in ("compliance", "arm"))
        give = compliance * self.b.scene.width * self.b.foundation.length
        return Holder(shear) if give * self.b.foundation.stiffness <= RIGID else Holder(shear, arm, 2.0 / give)

    def _pressed(self, now) -> np.ndarray:
        """Pressure over its mean (columns,) of a block that is not worn."""
        self._recall(now)
        shape = self.recent.shape
        if shape is None:
            mesh = self.b.scene.mesh
            shape = laws_mean(self.b.laws, "contact.pressure", mesh, now)
            shape = self.recent.shape = shape / (np.sum(shape * mesh.column_area) / np.sum(mesh.column_area))
        return shape

    def _turning(self, now) -> tuple[float, float]:
        """K (m2) of the holder's tilt, inf where it is guided; moment (N per m) at a friction of 1."""
        if not self.b.laws.has("holder.compliance"):
            return np.inf, 0.0
        compliance, arm = (self.b.laws(f"holder.{name}", 0.0, None, now) for name in ("compliance", "arm"))
        bed, width = self.b.foundation, self.b.scene.width
        give = compliance * width * bed.stiffness * bed.length
        turning = np.inf if give <= RIGID else 2.0 / give
        return turning, arm * now.pressure * bed.dx.sum()

    def _friction(self, now, free, moment, turning, T, road, kf):
        """Load-weighted friction that agrees with the pressure which it causes: Newton on one number."""
        bed = self.b.foundation

        def found(trial, free, T, road, kf):
            press = bed.settle(free, now.pressure, moment * trial, turning)
            flux, _ = self.fluxes(self.state(now, press.pressure, T), now, T, road, kf)
            return (flux.mu * press.pressure) @ bed.dx / (now.pressure * bed.dx.sum())

        mean = self.recent.friction
        plain = np.real(free), np.real(T), np.real(road), np.real(kf)
        for _ in range(40):
            got = found(mean + 1j * STEP, *plain)
            slope = 1.0 - got.imag / STEP
            step = (got.real - mean) / slope
            mean += step
            if abs(step) <= 1e-8 * max(abs(mean), 1e-3):  # the next step would be its square
                break
        else:
            raise SolverFailure(f"friction {mean:.3g} and the pressure that it causes do not agree")
        self.recent.friction = mean
        if any(np.iscomplexobj(a) for a in (free, T)):
            return mean + (found(mean, free, T, road, kf) - mean) / slope
        return mean

    # --- contact laws --------------------------------------------------------------------------
    def _recall(self, now) -> None:
        """Keep of `recent` what still holds."""
        D = self.b.scene.spot_diameter
        if self.b.laws.restless:
            self.recent.forget((now.t,))
        else:  # nothing changes once a spot has passed over the rubber
            speed = max(now.last_speed, 1e-12)  # a block that starts from rest
            passed = min(now.slid, D), min(now.contact_time - now.waited, D / speed)
            self.recent.forget((now.pressure, now.speed, now.last_speed, now.touching, *passed, now.waited))

    def state(self, now, local, T=None) -> contact_flux.ContactState:
        """Contact laws at a local pressure (columns,) Pa and rises T (cells,), 0 if None."""
        face = None if T is None else T[self.b.cell_block] + self.b.scene.ambient
        seen = (None if a is None else same(a) for a in (now.worn, local, face))
        asked = (*now[:SCHEDULED], now.passed, now.leg, *seen)
        if self.recent.state is None or asked != self.recent.asked:
            self.recent.asked, self.recent.state = asked, self._state(now, local, face)
        return self.recent.state

    def _state(self, now, local, face) -> contact_flux.ContactState:
        """Contact laws at a local pressure and temperatures (columns,) K of the block's face."""
        self._recall(now)
        laws, mesh, recent, n = self.b.laws, self.b.scene.mesh, self.recent, len(local)
        now = now.under(mesh, local_pressure=local, face=face)
        phi = laws("contact.spot_fraction", 0.0, None, now)
        phi = kernels_contact.between(columns(phi, n), lanes.SMALLEST, 1.0)
        r, split, micro = (
            laws(f"contact.{name}", 0.0, None, now) for name in ("resistance", "heat_split", "micro_resistance")
        )
        last = recent.fraction
        if last is None or phi.dtype != last.dtype or phi.tobytes() != last.tobytes():
            covered = phi @ mesh.column_area / mesh.column_area.sum()
            seen = now.seeing(local_pressure=None, spot_fraction=phi, covered=covered)
            recent.fraction, recent.spread = phi, (covered, *self._spread(seen), lanes.even(self.b, phi))
        covered, flash, deep, widen, even = recent.spread
        apart = self._lane_sums(now) if even is None else None
        lane, fall = even or (np.ones(n), np.ones(n))
        speed, least = now.speed if now.touching else 0.0, max(LIGHT * now.pressure, 1e-300)
        on, over = alike(local, phi)
        m, light, road = kernels_contact.pressed(on, over, speed, least, self.b.share)
        state = contact_flux.ContactState(
            m=m, phi=phi, covered=covered, pressure=local, r=r + OPEN / np.expm1(light), flash=flash,
            micro=columns(micro, n), lane=lane, fall=fall, widen=widen, split=columns(split, n),
            inside=self.b.inside, deep=deep, block=phi, road=road, half=phi, under=Overlap(self.b.cell_road),
            apart=apart,
        )  # fmt: skip
        return self._resolved(state, now) if laws.has("contact.cover") else state

    def _resolved(self, state, now) -> contact_flux.ContactState:
        """The state where spots cover their columns one by one instead of on average, and carry the load together."""
        w = self.b.laws("contact.resolved", 0.0, None, now)
        if w == 0.0:
            return state
        (cover, under, edge, rim), area = self._covered(now), self.b.scene.mesh.column_area
        carried = np.sum(state.pressure / state.phi * cover * area)
        if now.pressure > 0 and not np.real(carried) > 0:
            raise SolverFailure("no spot is under the block; give more or larger spots")
        load = np.sum(state.pressure * area) / carried if now.pressure > 0 else 1.0
        block = state.block + w * (cover - state.block)
        return state._replace(
            m=state.m + w * (load - 1.0) * state.m,
            phi=state.phi + w * (cover - state.phi),
            covered=state.covered + w * (1.0 - state.covered),
            flash=(1.0 - w) * state.flash + w * edge,
            deep=(1.0 - w) * state.deep,
            lane=state.lane + w * (1.0 - state.lane),
            fall=state.fall + w * (1.0 - state.fall),
            widen=(1.0 - w) * state.widen,
            block=block,
            road=block / self.b.share,
            half=state.half + w * (1.0 - state.half),
            under=under,
            rim=w * rim,
            apart=state.apart if w < 1.0 else None,
        )

    def _covered(self, now) -> tuple[np.ndarray, Overlap, np.ndarray | float, np.ndarray | float]:
        """Share of every column that spots cover, the road under it, `RoadFrame.edge` and `ContactState.rim`."""
        b, frame, mesh = self.b, self.b.road_frame, self.b.scene.mesh
        edges = mesh.x[mesh.first : mesh.last + 1] if frame is None else frame.strips(now.passed)
        cover = b.laws("contact.cover", 0.0, None, now.seeing(lead=edges))
        if frame is None:
            return cover, Overlap(b.cell_road), 0.0, 0.0
        area = cover.reshape(-1, mesh.n_across) * np.diff(edges)[:, None]
        under = frame.overlap(now.passed, b.cell_road, area)
        bare = 1.0 - b.laws("contact.cover", 0.0, None, now.seeing(lead=frame.edges(now.passed)))
        passed = np.minimum(now.contact_time, now.waited + mesh.column_x / max(now.last_speed, 1e-300))
        rim = frame.rim(under, bare.reshape(-1, mesh.n_across), passed, b.scene.road)
        cover = (area[::2] + area[1::2]).ravel() / frame.dx
        return cover, under, frame.edge(cover, now.last_speed, b.scene.block), rim

    def _memory(self, slid: float) -> tuple[np.ndarray, np.ndarray]:
        """`lanes.weights` after `slid` m; they stay as they are once the block has slid by its length."""
        mesh, recent = self.b.scene.mesh, self.recent
        way = lanes.way(mesh, slid)
        if way != recent.way:
            recent.way, recent.memory = way, lanes.weights(mesh, way)
        return recent.memory

    def _lane_sums(self, now) -> lanes.Apart:
        """`lanes.apart` of the contact fraction: it stays while that and what lanes remember do."""
        recent = self.recent
        asked = (recent.fraction, self._memory(now.leg), now.pressure * (now.speed or now.last_speed))
        if (
            not recent.apart
            or any(a is not b for a, b in zip(asked[:2], recent.apart, strict=False))
            or (asked[2] != recent.apart[2])
        ):
            recent.apart = (*asked, lanes.apart(self.b, *asked))
        found: lanes.Apart = recent.apart[3]
        return found

    def _spread(self, now):
        """Flash resistances of surface and depth, and how lanes widen: these see phi only."""
        laws, one = self.b.laws, np.ones(len(now.x))
        flash = laws("contact.flash_resistance", 0.0, None, now) * one
        deep = 0.0 * one
        if flash.any():
            for d in self.b.volumetric:
                deep = deep + d.share * flash * laws("contact.flash_share", 0.0, None, now, d.depth)
        return flash, deep, lanes.loss(self.b, now, self.b.scene.mesh.depth)

    def loss_at_depth(self, state, now) -> np.ndarray:
        """`lanes.loss_at_depth` at a state: it stays while what else follows from the contact fraction alone does."""
        recent = self.recent
        if state.phi is not recent.fraction:
            return lanes.loss_at_depth(self.b, self.at(state, now))
        if not recent.deeper or recent.deeper[0] is not recent.spread:
            recent.deeper = recent.spread, lanes.loss_at_depth(self.b, self.at(state, now))
        weights: np.ndarray = recent.deeper[1]
        return weights

    def at(self, state, now):
        """The moment as laws of the contact see it: place, local pressure and contact fraction."""
        return now.under(
            self.b.scene.mesh, local_pressure=state.pressure, spot_fraction=state.phi, covered=state.covered
        )

    def fluxes(self, state, now, T, road, kf, slopes: bool = False):
        """Interface fluxes, with `slopes` their slopes, else None, at rises T (cells,) with a `road` that enters.

        See `contact_flux.solve`.
        """
        b, laws, ambient = self.b, self.b.laws, self.b.scene.ambient
        state = self.separate_lanes(state, now, T, road)
        at = self.at(state, now)
        bare = at
        if np.iscomplexobj(state.phi) or np.iscomplexobj(state.pressure):
            bare = at.seeing(
                local_pressure=np.real(state.pressure), spot_fraction=np.real(state.phi), covered=np.real(state.covered)
            )

        def law(target, base):
            def at_temperatures(T, face, apart=False):
                return laws(target, base, T, (bare if apart else at).seeing(face=face)) + 0.0 * T

            return at_temperatures

        return contact_flux.solve(
            state,
            T[b.cell_block] + ambient,
            lanes.rises(b, state, T, road) + ambient,
            b.half_block if kf is b.ones else b.half_block / kf[b.cell_block],
            (b.half_road if kf is b.ones else b.half_road / kf[b.cell_road]) + state.rim,
            law("friction.mu", 0.0),
            law("friction.in_depth", 1.0) if laws.has("friction.in_depth") else None,
            self.recent.touch,
            slopes,
        )

    def separate_lanes(self, state, now, T, road) -> contact_flux.ContactState:
        """The state with its lanes told apart from their columns at rises T (cells,), where that is still to be done.

        Of a block that rests the lanes hold the heat that its last speed gave.
        """
        if state.apart is None:
            return state
        b, laws = self.b, self.b.laws
        face = T[b.cell_block] + b.scene.ambient
        at = self.at(state, now).seeing(face=face)
        least = lanes.SPARSE * state.covered
        spots = np.where(np.real(state.phi) > np.real(least), state.phi, least)
        touch = face + (state.flash + state.micro) * lanes.heat_into_block(b, T) / spots
        own = laws("friction.in_depth", 1.0, touch, at) if laws.has("friction.in_depth") else 1.0
        heat = state.pressure * (now.speed or now.last_speed) * laws("friction.mu", 0.0, touch, at)
        return lanes.in_contact(b, state, T, road, heat * (1.0 - state.inside * own))

    # --- abrasion ------------------------------------------------------------------------------------
    def abrasion_rate(self, state, flux, now) -> np.ndarray:
        """dw/dt (columns,) in m/s."""
        at = self.at(state, now).seeing(friction=flux.mu)
        return now.speed * columns(self.b.laws("block.abrasion", 0.0, flux.spot, at), len(at.x))

    def abrasion_coupling(self, contact: Contact, now, worn, T, road, kf, gamma: float) -> AbrasionCoupling:
        """Around a contact with slopes, worn by `worn` (columns,) m, for the preconditioner of I - gamma J."""
        b, flux, d = self.b, contact.flux, contact.slopes
        assert flux is not None
        assert d is not None
        now = now.seeing(worn=worn) if b.abrades else now
        more = contact.press.pressure + 1j * STEP
        harder = self.state(now, more, T)
        pressing, _ = self.fluxes(harder, now, T, road, kf)
        pressed = self._answer(harder, pressing, now)
        seen = self.at(contact.state, now.seeing(worn=worn + 1j * STEP) if b.abrades else now)
        thicker = 1j * np.imag(b.laws("contact.resistance", 0.0, None, seen))
        deeper = contact.state._replace(r=contact.state.r + thicker) if np.any(thicker) else None
        spot, mu = (
            slope(self.abrasion_rate(contact.state, flux._replace(**{k: v + 1j * STEP}), now))
            for k, v in (("spot", flux.spot), ("mu", flux.mu))
        )
        elastic = None if b.elastic is None or not now.touching else self.recent.elastic
        if b.elastic is None or elastic is None:
            response: Response | ElasticResponse = b.foundation.response(contact.press)
        else:  # the slopes of friction are there: what follows is settled with them too
            self.recent.elastic = elastic = b.elastic.renew_jacobian(elastic, slope(more * pressing.mu))
            response = b.elastic.response(elastic)
        return AbrasionCoupling(
            b,
            contact.state.under,
            pressed,
            None if deeper is None else self._answer(deeper, self.fluxes(deeper, now, T, road, kf)[0], now),
            warm=tuple((spot * d.spot[i] + mu * d.mu[i]) / b.worn_unit for i in (0, 1)),
            response=response,
            undo=response.solver(gamma * pressed.abrasion),
            pulls=tuple(contact.press.pressure * slope for slope in d.mu),
        )

    @cached_property
    def _pattern(self) -> Pattern:
        """Of answers where the road lies on the block's lines."""
        return pattern(self.b, Overlap(self.b.cell_road))

    def _answer(self, state, flux, now) -> Answer:
        """How heat and abrasion follow what has a complex step in a state with its fluxes."""
        area = self.b.scene.mesh.column_area
        taken = flux.into_road * area
        return Answer.of(
            self._pattern if state.under.other is None else pattern(self.b, state.under),
            self.b,
            state.under,
            face=slope(state.block * flux.into_block * area),
            deep=slope(state.block * flux.deep * area),
            road=slope(state.road * taken),
            books=(slope(state.block * flux.heat * area), slope(state.block * taken)),
            abrasion=slope(self.abrasion_rate(state, flux, now)),
        )
