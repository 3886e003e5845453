"""What the air draws from the side wall of a block: cosines along it, up it and across it; no closure.

Whatever is drawn spreads by diffusion, each product of cosines by itself.  Draws are linear in time between moments: by
the air from the wall as far as that is warm, by the ends of the block, and by the contact, which passes on less where the
face is cooler.  Cosines that are too short to matter follow at once; they reach no deeper than heat spreads.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

ALONG, UP, ACROSS = 16, 40, 64
FAR = 6.0  # roots of diffusivity and time
HEIGHTS, SWEEPS = 160, 4


class WallDeficit:
    """What a block's wall lacks against its section, from t = 0 on: sizes of the cosines (across, along, up)."""

    def __init__(self, pair, contact_coefficient, air_coefficient, end, slope=0.0):
        """Heat that leaves the face per kelvin: `contact_coefficient` (places,) and `air_coefficient`, W/m2K.

        `end` (s) of the computation; `slope` (1/K) of the block's conductivity.
        """
        self.slope, self.conductivity_source = slope, 0.0
        self.depth = min(0.5 * pair.width, FAR * np.sqrt(pair.k / pair.rc * end))
        self.pair, self.face_coefficient = pair, {True: contact_coefficient, False: np.full(ALONG, air_coefficient)}
        places, (z, _) = self.contact_places(pair), self.evaluation_grid(pair)
        numbers = (np.arange(count) for count in (ACROSS + 1, ALONG, UP + 1))
        sizes = (self.depth, pair.length, pair.height)
        waves = [np.pi * n / size for n, size in zip(numbers, sizes, strict=True)]
        self.rate = pair.k / pair.rc * sum(w**2 for w in np.ix_(*waves))
        self.share, self.along, self.up = (np.where(w > 0.0, 2.0, 1.0) for w in waves)
        self.share = self.share[:, None, None] / (sizes[0] * pair.rc)
        self.foot = self.up / (sizes[2] * pair.rc)
        self.cosines, self.ends = np.cos(np.outer(places, waves[1])), (-1.0) ** np.arange(ALONG)
        self.back = self.along[:, None] * self.cosines.T / ALONG
        nodes = (np.arange(4 * UP) + 0.5) * pair.height / (4 * UP)
        self.over = (
            (self.up[:, None] * np.cos(np.outer(waves[2], nodes))) @ pair.evaluate_height_modes(nodes) / len(nodes)
        )
        self.section = self.back @ pair.evaluate_length_modes(places)
        self.evaluation_cosines = (
            np.cos(np.outer(z, waves[2])),
            np.cos(np.outer(self.evaluation_grid(pair)[1], waves[1])),
        )
        short = [2.0 * size / (np.pi**2 * pair.k) * _series_tail(n) for size, n in ((sizes[0], ACROSS), (sizes[2], UP))]
        self.short_across, self.short_up = short
        n = np.arange(UP + 1, 16 * UP)
        part = np.cos(np.outer(z, np.pi * n / pair.height)) @ (1.0 / n**2)
        self.short_waves = 2.0 * pair.height / (np.pi**2 * pair.k) * part
        self.t, self.is_sliding, self.left = 0.0, True, np.zeros(self.rate.shape)
        self.film, self.drawn = 0.0, np.zeros((ALONG, UP + 1))
        self.draw, self.flux = np.zeros(self.rate.shape), np.zeros((ACROSS + 1, ALONG))

    @staticmethod
    def evaluation_grid(pair):
        """Heights (m) from the face on, and places along the block, at which one may look."""
        return np.linspace(0.0, pair.height, HEIGHTS + 1), np.linspace(0.0, pair.length, 2 * ALONG + 1)

    @staticmethod
    def contact_places(pair):
        """Places (m) along the block at which the contact holds it."""
        return (np.arange(ALONG) + 0.5) * pair.length / ALONG

    def advance(self, t, film, section_film, is_sliding, amplitude, air):
        """Go on to t (s) with a `film` (W/m2K), of which the section feels `section_film`; what is lacking (z, places)."""
        section = self.section @ amplitude @ self.over.T
        section[0, 0] -= air
        kept, young, old = _step_weights(self.rate, t - self.t)
        face_coefficient, beside = self.face_coefficient[is_sliding], np.zeros_like(self.left)
        beside[0] = section_film * section * self.depth / (0.5 * self.pair.width)
        if is_sliding != self.is_sliding:  # coefficients of now at the state of then
            self.flux, self.is_sliding = face_coefficient * self._face_deficit(self.left, self.flux), is_sliding
            self.draw = self.drawn * film / max(self.film, 1e-9) - beside
        known = (
            kept * self.left + self.share * (old * self.draw - young * beside) + (young + old) * self._end_rates(film)
        )
        known = known - old * self._flux_rates(self.flux) - (young + old) * self.rate * self.conductivity_source
        reply = (self.cosines * (young @ self.foot)[:, None]) @ self.back + self.short_up * np.eye(ALONG)
        reply = np.eye(ALONG) + reply * face_coefficient
        answer = film * ((self.share * young).sum(axis=0) + self.short_across)
        drawn, state = np.zeros_like(section), known
        for _ in range(SWEEPS):  # wall and face draw on one another
            flux = (
                face_coefficient
                * np.linalg.solve(reply, self._face_deficit(known + self.share * young * drawn)[..., None])[..., 0]
            )
            held = young * self._flux_rates(flux)
            drawn = film * (section - (known - held).sum(axis=0)) / (1.0 + answer)
            state = known - held + self.share * young * drawn
        self.t, self.left, self.flux, self.draw = t, state, flux, drawn - beside
        self.film, self.drawn = film, drawn
        if self.slope:
            self.conductivity_source = self._conductivity_source(amplitude)
        total = state.sum(axis=0) + self.short_across * drawn
        return self.evaluation_cosines[0] @ total.T @ self.evaluation_cosines[1].T - self._short_wave_deficit(flux)

    @cached_property
    def _grids(self):
        """Cosines at as many places as they are, across, along and up; the way back; the section's modes there."""
        p, turns = self.pair, [np.cos(np.pi * np.outer(np.arange(n) + 0.5, np.arange(n)) / n) for n in self.left.shape]
        back = [turn.T * np.where(np.arange(len(turn)) > 0, 2.0, 1.0)[:, None] / len(turn) for turn in turns]
        z = (np.arange(UP + 1) + 0.5) * p.height / (UP + 1)
        return turns, back, (p.evaluate_length_modes(self.contact_places(p)), p.evaluate_height_modes(z).T)

    def _conductivity_source(self, amplitude):
        """Sizes of what conduction in a warm block adds to what lacks: (k/k0 - 1) of it, less the half of its square."""
        turns, back, (along, above) = self._grids
        section = along @ amplitude @ above
        lack = np.einsum("ya,xn,zu,anu->yxz", *turns, self.left, optimize=True)
        return np.einsum("ay,nx,uz,yxz->anu", *back, self.slope * (section - 0.5 * lack) * lack, optimize=True)

    def road_deficit(self, speed, x, y):
        """By how much (y, x) K the road behind is cooler, x (m) behind the leading edge and y (m) from the middle: the
        contact passes on so much less beside the walls, and the road's surface remembers it as a half-space does."""
        p = self.pair
        off = np.minimum(0.5 * p.width - np.minimum(np.abs(y), 0.5 * p.width), self.depth)
        across = np.cos(np.outer(off, np.pi * np.arange(ACROSS + 1) / self.depth)) @ self.flux
        edges = np.linspace(0.0, p.length, ALONG + 1)
        root = np.sqrt(np.maximum(np.asarray(x)[:, None] - edges, 0.0))
        return across @ (2.0 * (root[:, :-1] - root[:, 1:]) / (p.road_effusivity * np.sqrt(np.pi * speed))).T

    def _face_deficit(self, state, flux=0.0):
        """What lacks at the face (across, places)."""
        return state.sum(axis=2) @ self.cosines.T - self.short_up * flux

    def _flux_rates(self, flux):
        """Rates of the sizes by a flux (across, places) W/m2 through the face, which makes up for what lacks."""
        return (flux @ self.back.T)[..., None] * self.foot

    def _end_rates(self, film):
        """Rates of the sizes by the films of both ends, at the present state."""
        at = [self.left.sum(axis=1), np.einsum("c,ncu->nu", self.ends, self.left)]
        out = at[0][:, None] + at[1][:, None] * self.ends[:, None]
        return -film / (self.pair.rc * self.pair.length) * self.along[:, None] * out

    def _short_wave_deficit(self, flux):
        """What waves too short to count make of it close to the face (z, places), K."""
        return np.outer(self.short_waves, flux.sum(axis=0) @ self.back.T @ self.evaluation_cosines[1].T)


def _series_tail(count):
    return np.pi**2 / 6.0 - (1.0 / np.arange(1, count + 1) ** 2).sum()


def _step_weights(rate, dt):
    """What is left of a state after dt (s), and weights of the young and the old end of a source that is linear."""
    x = np.maximum(rate * dt, 1e-9)
    kept, whole = np.exp(-x), -np.expm1(-x) / x
    young = np.where(x > 1e-3, (1.0 - whole) / x, 0.5 - x / 6.0)
    return kept, dt * young, dt * (whole - young)
