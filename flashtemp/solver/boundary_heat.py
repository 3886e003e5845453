"""Boundary heat: here the air film of every wall is applied to its cells, and every law on a patch or in a zone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.model.laws import STEP, Laws
from flashtemp.model.scene import Scene
from flashtemp.solver import kernels_2d


class Films(NamedTuple):
    """Films at one instant: (h, far) of each film of every site, and those of a site taken together."""

    each: list[list[tuple[float, float]]]
    resistance: np.ndarray  # (sites,) m2 K/W, inf where nothing passes
    far: np.ndarray  # (sites,) rise in K beyond the film


class BoundaryHeat:
    """All heat that does not pass through the contact, with its derivatives; whole from construction.

    Heat on road sites is booked under "lane_air", on block sites under the law's own ledger.
    """

    def __init__(self, scene: Scene, laws: Laws, conductivity: np.ndarray):
        self.scene, self.laws, mesh = scene, laws, scene.mesh
        self.k = conductivity
        self.names = list(laws.films)
        parts = [mesh.patches[s] for s in self.names] or [(np.empty(0, dtype=np.int64), np.empty(0), np.empty(0))]
        self.offset = np.cumsum([0] + [len(mesh.patches[s][0]) for s in self.names]).astype(np.int64)
        self.cell, self.area, half = (np.concatenate([p[i] for p in parts]) for i in range(3))
        self.half = half / conductivity[self.cell // mesh.n_across]
        self._check()

    def _check(self) -> None:
        """Raise BadInput for a film that is not one number."""
        start = self.scene.moment(self.scene.schedule.phases[0], 0.0)
        for site, entries in self.laws.films.items():
            for part, p, name in entries:
                far = start.ambient if part.far is None else part.far(start, p)
                if np.ndim(part.law(start, p)) or np.ndim(far):
                    raise BadInput(
                        f"effect '{name}': its film on {site} is an array; a film is one number for the whole site, "
                        "take Heat.patch for what differs from place to place"
                    )

    def ledgers(self) -> set[str]:
        """Names under which heat may be booked."""
        films = {part.to for entries in self.laws.films.values() for part, _, _ in entries}
        return films | {part.to for part, _, _ in self.laws.patches + self.laws.zones} | {"air", "holder"}

    def exchange(self, now, T, kf, q, led) -> None:
        """Add all heat at temperature rises T (cells,) to `q` (W/m per cell) and to the ledger."""
        films, n = self._films(now, T.dtype), len(self.names)
        total, surface = np.zeros(n, dtype=T.dtype), np.zeros(n, dtype=T.dtype)
        kernels_2d.exchange(
            self.offset, self.cell, self.area, self.half, kf, films.resistance, films.far, T, q, total, surface
        )
        for s, site in enumerate(self.names):
            if np.real(films.resistance[s]) < np.inf:
                area = self.area[self.offset[s] : self.offset[s + 1]].sum()
                self._book(site, films.each[s], total[s], surface[s], area, led)
        for to, cells, heat in self._general(now, T + self.scene.ambient, kf):
            q[cells] += heat
            led[to] += heat.sum()

    def slopes(self, now, T, kf) -> list[tuple[str, np.ndarray, np.ndarray]]:
        """(entry of the ledger, cells, d(heat)/dT in W/(m K)) of all heat at rises T (cells,)."""
        films, out = self._films(now), []
        for s, site in enumerate(self.names):
            if films.resistance[s] < np.inf:
                at = slice(self.offset[s], self.offset[s + 1])
                cells = self.cell[at]
                slope = -self.area[at] / (self.half[at] / kf[cells] + films.resistance[s])
                out.append((_ledger(site, self.laws.films[site][0][0]), cells, slope))
        for to, cells, heat in self._general(now, T + self.scene.ambient + 1j * STEP, kf):
            slope = np.imag(heat) / STEP
            if slope.any():  # a heat that is off leaves no trace, not even in the order of a sum
                out.append((to, cells.ravel(), slope.ravel()))
        return out

    def surface_rise(self, site: str, now, T, kf) -> np.ndarray:
        """Temperature rise (faces,) K at the surface of a site, half a cell from its cells at T."""
        cell, _, half = self.scene.mesh.patches[site]
        if site not in self.names:
            return T[cell]
        films, s = self._films(now), self.names.index(site)
        inner = half / (self.k[cell // self.scene.mesh.n_across] * kf[cell])
        return T[cell] + (films.far[s] - T[cell]) * inner / (inner + films.resistance[s])

    def _films(self, now, dtype: type | np.dtype = float) -> Films:
        """All films at a moment; those of a site act side by side."""
        n = len(self.names)
        out = Films([], np.empty(n, dtype=dtype), np.empty(n))
        for s, site in enumerate(self.names):
            each = [
                (part.law(now, p), (now.ambient if part.far is None else part.far(now, p)) - self.scene.ambient)
                for part, p, _ in self.laws.films[site]
            ]
            h = sum(c for c, _ in each)
            fixed = [far for c, far in each if c == np.inf]
            out.resistance[s] = 1.0 / h if np.real(h) > 0 else np.inf
            out.far[s] = (
                fixed[0] if fixed else (np.real(sum(c * far for c, far in each) / h) if np.real(h) > 0 else 0.0)
            )
            out.each.append(each)
        return out

    def _book(self, site, each, total, surface, area, led) -> None:
        """Divide the heat of a site among its films by h (T_far - T_surface)."""
        rest = total
        for j, ((part, _, _), (h, far)) in enumerate(zip(self.laws.films[site], each, strict=True)):
            last = j + 1 == len(each) or h == np.inf
            share = rest if last else h * (far * area - surface)
            led[_ledger(site, part)] += share
            rest = rest - share
            if last:
                break

    def _general(self, now, T, kf):
        """(ledger, cells, heat in W/m per cell) of every patch and zone law at T (K)."""
        mesh = self.scene.mesh
        for part, p, _ in self.laws.patches:
            cell, area, half = mesh.patches[part.site]
            x, y, _ = mesh.place(cell)
            inner = half / (self.k[cell // mesh.n_across] * kf[cell])
            flux = patch_flux(part.law, T[cell], inner, now.at(mesh, x, y), p)
            yield _ledger(part.site, part), cell, area * flux
        for part, p, _ in self.laws.zones:
            plane = mesh.block if part.site == "block" else mesh.road
            cells = mesh.everywhere(plane)
            at = now.at(mesh, mesh.x_centre[mesh.line[plane]][..., None], mesh.y_centre)
            volume = mesh.volume[plane][..., None] * mesh.share
            yield _ledger(part.site, part), cells, part.law(T[cells], at, p) * volume


def _ledger(site: str, part) -> str:
    return "lane_air" if site.startswith("road") else part.to


def patch_flux(law, T, resistance, now, p):
    """Flux (W/m2) of a patch law at the surface, half a cell of `resistance` (m2 K/W) away from T."""
    flux = 0.0 * T
    for _ in range(6):
        Ts = T + flux * resistance
        slope = np.imag(law(np.real(Ts) + 1j * STEP, now, p)) / STEP
        step = (law(Ts, now, p) - flux) / (1.0 - slope * resistance)
        flux = flux + step
        if np.all(np.abs(step) <= 1e-13 * (np.abs(flux) + 1e-300)):
            break
    return flux
