"""Boundary heat: heat transfer to the surroundings on every site, and laws of effects on a patch or in a zone."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.model.effect_laws import COMPLEX_STEP, EffectLaws
from flashtemp.model.scene import Scene
from flashtemp.solver import kernels_2d


class FilmCoefficients(NamedTuple):
    """Heat-transfer coefficients at one instant.

    `site_films` are (h in W/m2K, rise of the surroundings in K) of every law of every site; the laws of a site act in
    parallel.
    """

    site_films: list[list[tuple[float, float]]]
    resistance: np.ndarray  # (sites,) 1/h in m2 K/W, inf without heat transfer
    ambient_rise: np.ndarray  # (sites,) rise of the surroundings in K, mean weighted by h
    conducting_sites: list[int]  # numbers of the sites with heat transfer


class BoundaryHeat:
    """All heat that does not pass through the contact, with its derivatives.

    In the ledger, heat of road sites counts under "lane_air", heat of block sites under the entry of its law.
    """

    def __init__(self, scene: Scene, laws: EffectLaws, conductivity: np.ndarray):
        self.scene, self.laws, mesh = scene, laws, scene.mesh
        self.k = conductivity
        self.names = list(laws.films)
        self.sites = list(laws.films.values())
        parts = [mesh.patches[s] for s in self.names] or [(np.empty(0, dtype=np.int64), np.empty(0), np.empty(0))]
        self.offset = np.cumsum([0] + [len(mesh.patches[s][0]) for s in self.names]).astype(np.int64)
        self.cell, self.area, half = (np.concatenate([p[i] for p in parts]) for i in range(3))
        self.half = half / conductivity[self.cell // mesh.n_across]
        self.site_area = [self.area[a:b].sum() for a, b in pairwise(self.offset)]  # m, of each site
        self.patch_laws: dict[str, list] = {}
        for part, p, _ in laws.patches:
            self.patch_laws.setdefault(part.site, []).append((part, p))
        # laws on patches and in zones depend on position and contact, heat-transfer coefficients on neither
        self.has_local_laws = bool(laws.patches or laws.zones)
        self._check_films()

    def _check_films(self) -> None:
        """Raise BadInput for a coefficient that is no single number, or is inf on the sides of a block in 2D."""
        start = self.scene.law_context(self.scene.schedule.phases[0], 0.0)
        for site, entries in self.laws.films.items():
            for part, p, name in entries:
                far = start.ambient if part.far is None else part.far(start, p)
                film, phases = part.law(start, p), self.scene.schedule.phases
                whole = site == "block.sides" and not self.scene.resolved
                if whole and any(np.any(np.isinf(part.law(self.scene.law_context(f, f.begin), p))) for f in phases):
                    raise BadInput(
                        f"effect '{name}': its film on {site} is inf, which would fix the temperature of the whole "
                        "section in 2D; use a finite number of W/m2K, or numerics.across > 1"
                    )
                if np.ndim(film) or np.ndim(far):
                    raise BadInput(
                        f"effect '{name}': its film on {site} is an array; a film is one number for the whole site, "
                        "use Heat.patch for heat that varies along it"
                    )

    def ledger_names(self) -> set[str]:
        """Names of the ledger entries of all boundary heat."""
        films = {part.to for entries in self.laws.films.values() for part, _, _ in entries}
        return films | {part.to for part, _, _ in self.laws.patches + self.laws.zones} | {"air", "holder"}

    def add_heat(self, now, films: FilmCoefficients, T, kf, q, led) -> None:
        """Add all heat at temperature rises T (cells,) to `q` (W/m per cell) and to the ledger."""
        total, surface = np.empty((2, len(self.sites)), dtype=T.dtype)
        kernels_2d.add_film_heat(
            self.offset, self.cell, self.area, self.half, kf, films.resistance, films.ambient_rise, T, q, total, surface
        )
        for s in films.conducting_sites:
            self._book_film_heat(s, films.site_films[s], total[s], surface[s], led)
        for to, cells, heat in self._patch_and_zone_heat(now, T, kf):
            q[cells] += heat
            led[to] += heat.sum()

    def heat_slopes(self, now, films: FilmCoefficients, T, kf) -> list[tuple[str, np.ndarray, np.ndarray]]:
        """(entry of the ledger, cells, d(heat)/dT in W/(m K)) of all heat at rises T (cells,)."""
        out = []
        for s in films.conducting_sites:
            at = slice(self.offset[s], self.offset[s + 1])
            cells = self.cell[at]
            slope = -self.area[at] / (self.half[at] / kf[cells] + films.resistance[s])
            out += [(to, cells, share * slope) for to, share in self._film_fractions(s, films.site_films[s])]
        for to, cells, heat in self._patch_and_zone_heat(now, T, kf, 1j * COMPLEX_STEP):
            slope = np.imag(heat) / COMPLEX_STEP
            if slope.any():  # a law that is off must not change even the order of a sum
                out.append((to, cells.ravel(), slope.ravel()))
        return out

    def surface_rise(self, site: str, now, T, kf) -> np.ndarray:
        """Temperature rise (faces,) K at the surface of a site, half a cell from its cells at T."""
        surface: np.ndarray = self._surface_temperature(site, now, T + self.scene.ambient, kf)[0] - self.scene.ambient
        return surface

    def _surface_temperature(self, site: str, now, T, kf):
        """Surface of a site with cells at T (K): temperature (faces,) K, fraction of heat to the cells, and context.

        Heat that a law releases on the surface divides between the half-cell and the heat-transfer coefficient; the
        fraction is the part that enters the cells.  The context is that for laws at the faces.
        """
        mesh = self.scene.mesh
        cell, _, half = mesh.patches[site]
        x, y, _ = mesh.place(cell)
        at, inner = now.at_position(mesh, x, y), half / (self.k[cell // mesh.n_across] * kf[cell])
        film, far = np.inf, 0.0
        if site in self.names:
            films, s = self.film_coefficients(now), self.names.index(site)
            film, far = films.resistance[s], films.ambient_rise[s] + self.scene.ambient
        share = 1.0 / (1.0 + inner / film) if film > 0 else 0.0 * inner
        without_laws = T[cell] + (far - T[cell]) * (1.0 - share) if np.real(film) < np.inf else T[cell]
        entries = self.patch_laws.get(site, ())
        if not entries:
            return without_laws, share, at

        def patch_law(Ts, now, p):  # all laws of the site; each has parameters of its own
            return sum(part.law(Ts, now, parameters) for part, parameters in entries)

        flux = patch_flux(patch_law, without_laws, inner * share, at, None)
        return without_laws + inner * share * flux, share, at

    def film_coefficients(self, now) -> FilmCoefficients:
        """All heat-transfer coefficients at a moment; those of one site act in parallel."""
        each: list = []
        resistance: list = []
        far: list = []
        passing: list[int] = []
        for s, entries in enumerate(self.sites):
            here = [
                (part.law(now, p), (now.ambient if part.far is None else part.far(now, p)) - self.scene.ambient)
                for part, p, _ in entries
            ]
            h = sum(c for c, _ in here)
            fixed = [beyond for c, beyond in here if c == np.inf]
            each.append(here)
            on = np.real(h) > 0
            resistance.append(1.0 / h if on else np.inf)
            far.append(fixed[0] if fixed else np.real(sum(c * beyond for c, beyond in here) / h) if on else 0.0)
            if np.real(resistance[-1]) < np.inf:
                passing.append(s)
        return FilmCoefficients(each, np.array(resistance), np.array(far, dtype=float), passing)

    def _book_film_heat(self, s: int, each, total, surface, led) -> None:
        """Divide the heat of a site among its laws in the ledger: h (T_far - T_surface) each.

        The last one gets the remainder, so that the sum is exact.  A law with h = inf fixes the surface and gets all.
        """
        rest, site = total, self.names[s]
        passing = [(part, h, far) for (part, _, _), (h, far) in zip(self.sites[s], each, strict=True) if h != 0]
        for j, (part, h, far) in enumerate(passing):
            last = j + 1 == len(passing) or h == np.inf
            share = rest if last else h * (far * self.site_area[s] - surface)
            led[_ledger_name(site, part)] += share
            rest = rest - share
            if last:
                break

    def _film_fractions(self, s: int, each) -> list[tuple[str, float]]:
        """(ledger entry, fraction of the heat) of every law of a site; one with h = inf has all of it."""
        site = self.names[s]
        passing = [(_ledger_name(site, part), h) for (part, _, _), (h, _) in zip(self.sites[s], each, strict=True) if h]
        fixed = [to for to, h in passing if h == np.inf]
        total = sum(h for _, h in passing)
        return [(fixed[0], 1.0)] if fixed else [(to, h / total) for to, h in passing]

    def has_cooling_law(self, context_for_laws: Callable, now, rise: float) -> bool:
        """Whether a patch or zone law extracts heat where all temperatures are at a `rise` (K).

        `context_for_laws` turns the moment `now` into the context for these laws.
        """
        if not self.has_local_laws:
            return False
        mesh, now, T = self.scene.mesh, context_for_laws(now), rise + self.scene.ambient
        for site, entries in self.patch_laws.items():
            x, y, _ = mesh.place(mesh.patches[site][0])
            at = now.at_position(mesh, x, y)
            if any(np.any(np.real(part.law(np.full(len(x), T), at, p)) < 0.0) for part, p in entries):
                return True
        for part, p, cells, at in self._zone_laws(now):
            if np.any(np.real(part.law(np.full(cells.shape, T), at, p)) < 0.0):
                return True
        return False

    def _zone_laws(self, now):
        """(law, parameters, cells, context at the cells) of every law in a zone."""
        mesh = self.scene.mesh
        for part, p, _ in self.laws.zones:
            plane = mesh.block if part.site == "block" else mesh.road
            edges = mesh.height if part.site == "block" else -mesh.depth[::-1]
            span = {"low": edges[:-1, None], "high": edges[1:, None]}
            at = now.at_position(mesh, mesh.x_centre[mesh.line[plane]][..., None], mesh.y_centre, **span)
            yield part, p, mesh.everywhere(plane), at

    def _patch_and_zone_heat(self, now, rise, kf, step: complex = 0.0):
        """(ledger entry, cells, heat in W/m per cell) of patch and zone laws at a `rise` (cells,) K plus a `step`."""
        if not self.has_local_laws:
            return
        mesh, T = self.scene.mesh, rise + (self.scene.ambient + step)
        for site, entries in self.patch_laws.items():
            cell, area, _ = mesh.patches[site]
            surface, share, at = self._surface_temperature(site, now, T, kf)
            for part, p in entries:
                yield _ledger_name(site, part), cell, area * share * part.law(surface, at, p)
        for part, p, cells, at in self._zone_laws(now):
            plane = mesh.block if part.site == "block" else mesh.road
            volume = mesh.volume[plane][..., None] * mesh.share
            yield _ledger_name(part.site, part), cells, part.law(T[cells], at, p) * volume


def _ledger_name(site: str, part) -> str:
    return "lane_air" if site.startswith("road") else part.to


def patch_flux(law, T, resistance, now, p):
    """Flux (W/m2) of a patch law that depends on the surface temperature, half a cell away from cells at T (K).

    Solves flux = law(T + flux `resistance`) by Newton's method; `resistance` is in m2 K/W.
    """
    flux = 0.0 * T
    for _ in range(6):
        Ts = T + flux * resistance
        slope = np.imag(law(np.real(Ts) + 1j * COMPLEX_STEP, now, p)) / COMPLEX_STEP
        step = (law(Ts, now, p) - flux) / (1.0 - slope * resistance)
        flux = flux + step
        if np.all(np.abs(step) <= 1e-13 * (np.abs(flux) + 1e-300)):
            break
    return flux
