"""What presses where and what the contact makes of it, consistent with load and moment at every instant."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.model.laws import STEP, laws_mean
from flashtemp.solver import contact_flux
from flashtemp.solver.balance import Balance
from flashtemp.solver.winkler import Press

LIGHT, OPEN = 0.01, 1e-4  # contact opens below this share of the mean pressure; scale of its resistance, m2 K/W


class Meeting(NamedTuple):
    """Block and road at one instant: contact laws, fluxes and their slopes, and what the holder does."""

    state: contact_flux.ContactState
    press: Press
    flux: contact_flux.Fluxes | None = None
    slopes: contact_flux.Slopes | None = None


class Footprint:
    """Pressure and contact laws under the block; keeps what has not changed since it was last asked."""

    def __init__(self, balance: Balance):
        self.b = balance
        self.laws, self.mesh = balance.laws, balance.scene.mesh
        self._when = self._shape = self._phi = self._kept = None
        self._guess, self._mean = None, 0.0

    # --- pressure ------------------------------------------------------------------------------
    def meet(self, now, worn, T, T_in, kf, slopes: bool = False) -> Meeting:
        """Settle the block, worn by `worn` (columns,) m, on the road and solve the contact.

        `T` (cells,) rises, `T_in` (n_road,) of the entering road, `kf` (cells,) factor on k.  While the
        block is lifted there are no fluxes.
        """
        b = self.b
        free = now.pressure * self._pressed(now) - b.foundation.stiffness * worn
        turning, moment = self._turning(now) if now.touching and now.pressure > 0 else (np.inf, 0.0)
        if turning < np.inf:
            moment *= self._friction(now, free, moment, turning, T, T_in, kf)
        press = b.foundation.settle(free, now.pressure, moment, turning)
        state = self.state(now, press.pressure)
        if not now.touching:
            return Meeting(state, press)
        out = self.fluxes(state, now, T, T_in, kf, slopes)
        self._guess = np.real((out[0] if slopes else out).spot)
        return Meeting(state, press, *(out if slopes else (out,)))

    def _pressed(self, now) -> np.ndarray:
        """Pressure over its mean (columns,) of a block that is not worn."""
        self._look(now)
        if self._shape is None:
            area = self.mesh.column_area
            shape = laws_mean(self.laws, "contact.pressure", self.mesh, now)
            self._shape = shape / (np.sum(shape * area) / np.sum(area))
        return self._shape

    def _turning(self, now) -> tuple[float, float]:
        """K (m2) of the holder's tilt, inf where it is guided; moment (N per m) at a friction of 1."""
        compliance, arm = (self.laws(f"holder.{name}", 0.0, None, now) for name in ("compliance", "arm"))
        bed, width = self.b.foundation, self.b.scene.width
        turning = np.inf if compliance == 0 else 2.0 / (compliance * width * bed.stiffness * bed.length)
        return turning, arm * now.pressure * bed.dx.sum()

    def _friction(self, now, free, moment, turning, T, T_in, kf):
        """Load-weighted friction that agrees with the tilt which it causes: Newton on one number."""
        bed = self.b.foundation

        def found(trial, free, T, T_in, kf):
            press = bed.settle(free, now.pressure, moment * trial, turning)
            flux = self.fluxes(self.state(now, press.pressure), now, T, T_in, kf)
            return (flux.mu * press.pressure) @ bed.dx / (now.pressure * bed.dx.sum())

        plain = np.real(free), np.real(T), np.real(T_in), np.real(kf)
        for _ in range(40):
            got = found(self._mean + 1j * STEP, *plain)
            slope = 1.0 - got.imag / STEP
            step = (got.real - self._mean) / slope
            self._mean += step
            if abs(step) <= 1e-8 * max(abs(self._mean), 1e-3):  # the next step would be its square
                break
        else:
            raise SolverFailure(f"friction {self._mean:.3g} and the tilt of the holder do not agree")
        if any(np.iscomplexobj(a) for a in (free, T)):
            return self._mean + (found(self._mean, free, T, T_in, kf) - self._mean) / slope
        return self._mean

    # --- contact laws --------------------------------------------------------------------------
    def _look(self, now) -> None:
        """Forget what was kept when something that the laws see has changed."""
        mesh, D = self.mesh, self.b.scene.spot_diameter
        if self.laws.restless or len(now.history.value) > 1:
            when = (now.t,)
        else:  # nothing changes once spots and lanes have crossed the block
            age = min(now.contact_time - now.waited, mesh.x[mesh.last] / now.last_speed)
            when = (now.pressure, now.touching, min(now.slid, D), age, now.waited)
        if when != self._when:
            self._when, self._shape, self._phi = when, None, None

    def state(self, now, local) -> contact_flux.ContactState:
        """Contact laws at a local pressure (columns,) Pa."""
        self._look(now)
        laws = self.laws
        now = now._replace(x=self.mesh.column_x, y=self.mesh.column_y, local_pressure=local)
        phi = laws("contact.spot_fraction", 0.0, None, now) * np.ones(len(local))
        phi = np.where(np.real(phi) < 1e-6, 1e-6, np.where(np.real(phi) > 1.0, 1.0, phi))
        r, split = (laws(f"contact.{name}", 0.0, None, now) for name in ("resistance", "heat_split"))
        if self._phi is None or phi.dtype != self._phi.dtype or not np.array_equal(phi, self._phi):
            area = self.mesh.column_area
            covered = phi @ area / area.sum()
            seen = now._replace(local_pressure=None, spot_fraction=phi, covered=covered)
            self._phi, self._kept = phi, (covered, *self._spread(seen))
        covered, flash, deep, lane = self._kept
        light = local / max(LIGHT * now.pressure, 1e-300)
        light = np.where(np.real(light) < 1e-9, 1e-9, np.where(np.real(light) > 500.0, 500.0, light))
        speed = now.speed if now.touching else 0.0
        state = contact_flux.ContactState(
            m=local * speed / phi, phi=phi, covered=covered, pressure=local, r=r + OPEN / np.expm1(light),
            flash=flash, lane=lane, split=split, inside=self.b.inside, deep=deep,
            block=phi, road=1.0, half=phi,
        )  # fmt: skip
        return self._resolved(state, now) if laws.has("contact.cover") else state

    def _resolved(self, state, now) -> contact_flux.ContactState:
        """The state where spots cover their columns one by one instead of on average, and carry the load together."""
        w = self.laws("contact.resolved", 0.0, None, now)
        if w == 0.0:
            return state
        cover, area = self.laws("contact.cover", 0.0, None, now), self.mesh.column_area
        carried = np.sum(state.pressure / state.phi * cover * area)
        if now.pressure > 0 and not np.real(carried) > 0:
            raise SolverFailure("no spot is under the block; give more or larger spots")
        load = np.sum(state.pressure * area) / carried if now.pressure > 0 else 1.0
        return replace(
            state,
            m=state.m + w * (load - 1.0) * state.m,
            phi=state.phi + w * (cover - state.phi),
            covered=state.covered + w * (1.0 - state.covered),
            flash=(1.0 - w) * state.flash,
            deep=(1.0 - w) * state.deep,
            lane=1.0 - (1.0 - w) * (1.0 - state.lane),
            block=state.block + w * (cover - state.block),
            road=1.0 + w * (cover - 1.0),
            half=state.half + w * (1.0 - state.half),
        )

    def _spread(self, now):
        """Flash resistances of surface and depth, and the factor on the lanes' rise: these see phi only."""
        laws, one = self.laws, np.ones(len(now.x))
        flash = laws("contact.flash_resistance", 0.0, None, now) * one
        deep = 0.0 * one
        if flash.any():
            for d in self.b.volumetric:
                deep = deep + d.share * flash * laws("contact.flash_share", 0.0, None, now, d.depth)
        return flash, deep, laws("road.lane_rise", 1.0, None, now) * one

    def lanes(self, state, now) -> np.ndarray:
        """Factor on the rise of the lanes (n_lines,), also before and behind the block."""
        every = self.at(state, now)._replace(x=self.mesh.x_centre)
        return self.laws("road.lane_rise", 1.0, None, every) * np.ones(self.mesh.n_lines)

    def at(self, state, now):
        """The moment as laws of the contact see it: place, local pressure and contact fraction."""
        return now._replace(
            x=self.mesh.column_x, y=self.mesh.column_y, local_pressure=state.pressure, spot_fraction=state.phi,
            covered=state.covered,
        )  # fmt: skip

    def fluxes(self, state, now, T, T_in, kf, slopes: bool = False):
        """Interface fluxes at rises T (cells,) with road entering at T_in (n_road,); see contact.solve."""
        b, laws, ambient = self.b, self.laws, self.b.scene.ambient
        at = self.at(state, now)
        bare = at
        if np.iscomplexobj(state.phi) or np.iscomplexobj(state.pressure):
            bare = at._replace(
                local_pressure=np.real(state.pressure), spot_fraction=np.real(state.phi), covered=np.real(state.covered)
            )

        def law(target, base):
            def at_temperatures(T, face, apart=False):
                return laws(target, base, T, (bare if apart else at)._replace(face=face)) + 0.0 * T

            return at_temperatures

        return contact_flux.solve(
            state,
            T[b.cell_block] + ambient,
            T[b.cell_road] + ambient,
            np.tile(T_in[-self.mesh.n_across :], self.mesh.last - self.mesh.first) + ambient,
            b.half_block / kf[b.cell_block],
            b.half_road / kf[b.cell_road],
            law("friction.mu", 0.0),
            law("friction.in_depth", 1.0) if laws.has("friction.in_depth") else None,
            self._guess,
            slopes,
        )

    # --- abrasion ------------------------------------------------------------------------------------
    def abrasion_rate(self, meeting: Meeting, now) -> np.ndarray:
        """dw/dt (columns,) in m/s."""
        at = self.at(meeting.state, now)._replace(friction=meeting.flux.mu)
        return now.speed * self.laws("block.abrasion", 0.0, meeting.flux.spot, at) * np.ones(len(at.x))
