"""Viscoelastic friction of a skewed road from its sliding contact, compared with the road before flattening.

Compared are a Gaussian road (`plain`), the road with heights above the mean plane multiplied by f (`worn`), and the
latter turned upside down (`turned`).  The last two have the same power spectrum and opposite skewness, so Persson's
theory gives the same friction for both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.rheology import Rubber
from flashtemp.physics.friction.roughness_spectrum import READY_ROADS, RoughnessSpectrum
from flashtemp.physics.friction.skewness import gaussian_heights
from flashtemp.physics.friction.sliding_contact import SlidingContactResult, solve_sliding_contact

COMPARED_ROADS = ("plain", "worn", "turned")


@dataclass(frozen=True, eq=False)
class SkewFrictionComparison:
    """At nominal pressures p (n,) Pa: `mu`, `area` and `lost` (3, seeds, n) of the roads in COMPARED_ROADS.

    `lost` is the friction from the energy loss, an independent value of the same quantity.
    """

    pressure: np.ndarray
    mu: np.ndarray
    area: np.ndarray
    lost: np.ndarray

    def mean_ratio(self, what: str, one: str, other: str) -> np.ndarray:
        """Ratio (n,) of the means over seeds of "mu" or "area" of one road to that of the other."""
        values = getattr(self, what).mean(axis=1)
        ratio: np.ndarray = values[COMPARED_ROADS.index(one)] / values[COMPARED_ROADS.index(other)]
        return ratio

    @property
    def friction_area_product(self) -> np.ndarray:
        """mu_visc times contact area of the worn road (n,), both relative to the plain road: 1 if mu ~ 1/R."""
        product: np.ndarray = self.mean_ratio("mu", "worn", "plain") * self.mean_ratio("area", "worn", "plain")
        return product


def flatten_tops(heights: np.ndarray, side: float, f: float, cutoff: float) -> np.ndarray:
    """Flatten the tops of heights (n, n) m of a periodic square of `side` m.

    The sum of waves longer than `cutoff` (m) is multiplied by f where it is above the mean plane; shorter waves are
    unchanged.  With `cutoff` 0 all waves count as long.
    """
    long = heights
    if cutoff > 0.0:
        n = len(heights)
        along = np.fft.fftfreq(n, side / n)
        waves = np.hypot(along[:, None], along[: n // 2 + 1])  # cycles per m
        long = np.fft.irfft2(np.where(waves * cutoff < 1.0, np.fft.rfft2(heights), 0.0), s=heights.shape)
    lowered: np.ndarray = np.where(long > 0.0, f, 1.0) * long + (heights - long)
    return lowered


def compare_roads(
    f: float,
    rubber: Rubber,
    speed: float,
    T: float,
    pressures: Value,
    grid: int = 128,
    seeds: Sequence[int] = (0, 1, 2),
    road: RoughnessSpectrum = READY_ROADS["asphalt A"],
    cutoff: float = 0.0,
) -> SkewFrictionComparison:
    """Slide `rubber` at `speed` (m/s), temperature T (K) and nominal `pressures` (n,) Pa over the three roads.

    The square of `grid`^2 points contains the road's waves down to four pixels; those longer than `cutoff` (m) are
    flattened, all with 0.  Raises SolverFailure.
    """
    p = np.atleast_1d(np.asarray(pressures, dtype=float))

    def modulus(omega: Value) -> Value:
        return rubber(omega, T) / (1.0 - rubber.poisson**2)

    def slide_over_loads(heights: np.ndarray, side: float) -> list[SlidingContactResult]:
        return [solve_sliding_contact(heights, (side, side), modulus, speed, load) for load in p]

    results = []
    for seed in seeds:
        heights, side = gaussian_heights(road, grid, seed)
        worn = flatten_tops(heights, side, f, cutoff)
        results.append(
            [[(s.mu, s.area, s.friction_by_loss) for s in slide_over_loads(h, side)] for h in (heights, worn, -worn)]
        )
    return SkewFrictionComparison(p, *np.moveaxis(np.array(results), (3, 1, 0), (0, 1, 2)))
