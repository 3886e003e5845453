"""Measured less predicted as whitened columns: every recording and trace with noise, nuisances and derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from flashtemp.comparison.campaign import Force, View
from flashtemp.comparison.compare import levels, scatter
from flashtemp.comparison.noise import Noise, noise, whiten
from flashtemp.discovery.floor import smooth_errors
from flashtemp.discovery.linear_gaussian import Array, Block, products
from flashtemp.discovery.nuisances import smooth_images
from flashtemp.discovery.parameters import PLACED, Kind, ParameterId
from flashtemp.discovery.prediction import Observable, Prediction, Single, packed
from flashtemp.discovery.problem import Problem
from flashtemp.errors import BadInput

# small, or of unknown shape: their first traces serve all fits
FIXED = (Kind.SCATTER, Kind.MODE, Kind.TREND, Kind.SIZE, Kind.CLOCK)
SHARED = (*PLACED, Kind.CLOCK)  # errors that all recordings of a view may have alike
ANCHOR = "friction.mu"  # the free key that a condition may have a level of its own for

White = Callable[[npt.NDArray[Any]], Array]


@dataclass(frozen=True)
class Data:
    """What is kept from the first predictions, so that all hypotheses are compared alike.

    `noises` of recordings and `sigmas` of load-cell traces by file; `fixed` columns by file, whitened once as `shared`
    with their products.
    """

    problem: Problem
    noises: dict[str, Noise]
    sigmas: dict[str, float]
    fixed: dict[str, dict[ParameterId, npt.NDArray[Any]]]
    shared: dict[str, tuple[Single, Array]]

    @classmethod
    def begin(
        cls, problem: Problem, first: Sequence[Prediction], coarse: Sequence[Sequence[Prediction]] = (),
        noises: Mapping[str, Noise] | None = None,
    ) -> Data:  # fmt: skip
        """Keep traces of what is small and of unknown shape, differences to predictions on coarser meshes, and noise.

        What `noises` does not give is what a campaign states or, last, what the data show.  Raises BadInput.
        """
        known, sigmas, fixed = dict(noises or {}), {}, {}
        for condition, fine, *rough in zip(problem.conditions, first, *coarse, strict=True):
            for entry in condition.entries:
                seen = fine.observables[entry.file]
                own = {p: v for p, v in seen.columns.items() if p.kind in FIXED}
                own |= _mesh(seen, [other.observables[entry.file] for other in rough])
                if isinstance(entry, View):
                    own |= smooth_images(entry, seen) | smooth_errors(entry, seen)
                    if entry.file not in known:
                        known[entry.file] = _noise(entry, seen)
                else:
                    own[ParameterId(Kind.CELL)] = seen.values
                    sigmas[entry.file] = entry.sigma or scatter((np.array(entry.mu) - seen.values)[_good(seen)])
                fixed[entry.file] = own
        data = cls(problem, known, sigmas, fixed, {})
        return replace(data, shared=dict(data._first(first)))

    def _first(self, first: Sequence[Prediction]) -> Iterator[tuple[str, tuple[Single, Array]]]:
        """The fixed columns whitened, with their products, by file."""
        for condition, prediction in zip(self.problem.conditions, first, strict=True):
            for entry in condition.entries:
                r, white = self._whitened(entry, prediction.observables[entry.file])
                yield entry.file, _products(self.fixed[entry.file], white, len(r))

    def blocks(self, predictions: Sequence[Prediction], first: int = 0) -> list[Block]:
        """One block per recording and trace; conditions are numbered from `first`."""
        return [
            self._block(number, entry, prediction.observables[entry.file])
            for number, (c, prediction) in enumerate(zip(self.problem.conditions, predictions, strict=True), first)
            for entry in c.entries
        ]

    def _block(self, number: int, entry: View | Force, seen: Observable) -> Block:
        r, white = self._whitened(entry, seen)
        fixed = self.fixed[entry.file]
        F, FF = self.shared[entry.file]
        if len(F) != len(r):  # what may be compared has changed
            F, FF = _products(fixed, white, len(r))
        own = {p: v for p, v in seen.columns.items() if p not in fixed}
        C = _stack(own, white, len(r))
        return Block(entry.file, number, entry.held_out, r, C, self._names([*own, *fixed], number, entry), F, FF)

    def _names(
        self, columns: list[ParameterId], number: int, entry: View | Force
    ) -> tuple[tuple[ParameterId, int], ...]:
        """Names under which columns are known: those of one recording or condition carry its name."""
        out = []
        for i, p in enumerate(columns):
            out.append((p.within(number, entry.file), i))
            if p.kind in SHARED and isinstance(entry, View):
                out.append((ParameterId(p.kind, name=entry.recording.view), i))
            if p.kind is Kind.KEY and p.name == ANCHOR and p in self.problem.free:
                out.append((ParameterId(Kind.LEVEL, condition=number), i))
            if p.kind is Kind.MODE:
                out.append((ParameterId(Kind.FLUX, p.index, condition=number), i))
        return tuple(out)

    def _whitened(self, entry: View | Force, seen: Observable) -> tuple[Array, White]:
        """The residual (n,) in sigma, and what does the same to a column of the observable."""
        if isinstance(entry, Force):
            good, sigma = _good(seen), self.sigmas[entry.file]
            left = (np.array(entry.mu) - seen.values)[good]
            return left / sigma, lambda values: np.asarray(values, float)[good] / sigma
        images, noise = _left(entry, seen)[:, seen.inside], self.noises[entry.file]
        known = np.isfinite(images)

        def white(values: npt.NDArray[Any]) -> Array:
            return whiten(np.where(known, values, np.nan)[:, None], noise)[:, 0][known]

        return white(images), white


def _good(seen: Observable) -> npt.NDArray[np.bool_]:
    """Which readings of a load cell can be compared."""
    return seen.inside & np.isfinite(seen.values)


def _mesh(seen: Observable, rough: list[Observable]) -> dict[ParameterId, npt.NDArray[Any]]:
    """Differences to predictions on coarser meshes."""
    out = {}
    for k, other in enumerate(rough):
        change = seen.values - other.values
        out[ParameterId(Kind.MESH, (k,))] = packed(change, seen.inside) if change.ndim == 3 else change
    return out


def _noise(view: View, seen: Observable) -> Noise:
    """The noise of a recording, stated or estimated."""
    return noise(_left(view, seen), *levels(view), view.averaged)


def _left(view: View, seen: Observable) -> Array:
    """Measured less predicted (frames, nv, nu) K, NaN where not compared."""
    left = np.where(seen.inside, view.recording.temperature - seen.values, np.nan)
    if not np.isfinite(left).any():
        raise BadInput(
            f"{view.file}: no pixel of it lies on the block or the road, clear of their edges; check u, v and view"
        )
    return left


def _products(columns: dict[ParameterId, npt.NDArray[Any]], white: White, n: int) -> tuple[Single, Array]:
    F = _stack(columns, white, n)
    return F, products(F, F)


def _stack(columns: Mapping[ParameterId, npt.NDArray[Any]], white: White, n: int) -> Single:
    """The columns (n, k) whitened, one after the other: two at once would be much memory."""
    out = np.empty((n, len(columns)), np.float32, order="F")
    for k, values in enumerate(columns.values()):
        out[:, k] = white(values)
    return out
