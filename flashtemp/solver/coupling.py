"""The linearised way from abrasion to pressure to heat, and back: for Newton's method and its preconditioner."""

from __future__ import annotations

import numpy as np

from flashtemp.model.laws import STEP
from flashtemp.solver import kernels_2d


class Coupling:
    """Slopes of heat and abrasion with local pressure, of abrasion with temperature, of pressure with worn depth.

    Built around a Meeting at rises `T` (cells,) for the preconditioner of I - gamma J.
    """

    def __init__(self, footprint, meeting, now, T, T_in, kf, gamma: float):
        self.b = b = footprint.b
        area, d = b.scene.mesh.column_area, meeting.slopes
        state = footprint.state(now, meeting.press.pressure + 1j * STEP)
        flux = footprint.fluxes(state, now, T, T_in, kf)
        moved = meeting._replace(state=state, flux=flux)

        def slope(values):
            return np.imag(values) / STEP

        self.face = slope(state.block * flux.into_block * area)
        self.deep = slope(state.block * flux.deep * area)
        road = flux.into_road * area
        self.books = (slope(state.block * flux.heat * area), slope(state.block * road), slope(state.road * road))
        self.abrasion = slope(footprint.abrasion_rate(moved, now))
        spot, mu = (
            slope(footprint.abrasion_rate(meeting._replace(flux=meeting.flux._replace(**{k: v + 1j * STEP})), now))
            for k, v in (("spot", meeting.flux.spot), ("mu", meeting.flux.mu))
        )
        self.warm = tuple((spot * d.spot[i] + mu * d.mu[i]) / b.worn_unit for i in (0, 1))
        self.response = b.foundation.response(meeting.press)
        self.undo = self.response.solver(gamma * self.abrasion)  # r -> (1 - gamma d(rate)/d(depth))^-1 r

    def pressure(self, worn: np.ndarray) -> np.ndarray:
        """Change of pressure (lines,) Pa by a change of the worn depth in the state."""
        return self.response(worn * self.b.worn_unit)

    def heated(self, block: np.ndarray, road: np.ndarray) -> np.ndarray:
        """Change of the abrasion rate by changes of the first cells' temperatures (lines,) K."""
        return self.warm[0] * block + self.warm[1] * road

    def add(self, dp: np.ndarray, out: np.ndarray, scale: float = 1.0) -> None:
        """Add what a change of pressure dp (lines,) does to the rate of cells, worn depth and ledger."""
        b = self.b
        heat = np.zeros(b.n)
        heat[b.cell_block] = scale * self.face * dp
        heat[b.cell_road] = scale * self.books[2] * dp
        if len(b.weight):
            kernels_2d.deposit(b.deep_cells, b.weight, scale * self.deep * dp, heat)
        mesh = b.scene.mesh
        mesh.planes(out[: b.n])[:] += mesh.planes(heat) / np.outer(b.capacity, mesh.share)
        out[b.worn] += scale / b.worn_unit * self.abrasion * dp
        for name, slope in zip(("friction", "into_road", "lane_in"), self.books, strict=True):
            out[b.entry[name]] += scale * (slope @ dp)
