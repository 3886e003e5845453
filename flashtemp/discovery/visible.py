"""Whether a cause can be seen: what it changes in kelvin after recalibration, and what of it is above the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.comparison.compare import Pulling, Seeing
from flashtemp.discovery.assessment import Assessed
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.floor import LARGEST, LEAST
from flashtemp.discovery.nuisances import GROUPS
from flashtemp.discovery.parameters import Kind
from flashtemp.discovery.problem import Problem
from flashtemp.discovery.searched import NAMED, WEAK
from flashtemp.discovery.whitening import Data

UNTOLD = 0.1  # of the mesh's error as coarser meshes tell it, what calibrating it may leave


@dataclass(frozen=True)
class Gain:
    """What an extension is worth: `changed_K` rms of what it changes in the recording of which it changes the largest
    `share` of the rise, both models calibrated; `beyond_floor` its ln Bayes factor where the model's own error is as
    large as it may be; `left_out_K` before and after, of data that were left out; `numerics_K` what the mesh may still
    err by there once it is calibrated."""

    file: str
    changed_K: float
    share: float
    beyond_floor: float
    left_out_K: tuple[float, float]
    causes: int
    friction: float = 0.0  # largest rms change of a load cell's trace, over its friction
    numerics_K: float = 0.0

    @property
    def visible(self) -> bool:
        return max(self.share, self.friction) >= LEAST and not self.coarse

    @property
    def coarse(self) -> bool:
        """Whether the mesh may err by as much, and no load cell shows it."""
        return self.changed_K < self.numerics_K and self.friction < LEAST

    @property
    def above(self) -> bool:
        """Whether more of its signal survives than the model's own error could make."""
        return self.beyond_floor > NAMED * self.causes

    @property
    def predicts(self) -> bool:
        """Whether data left out are no farther from it than a model may err; noise makes most of their distance."""
        before, after = self.left_out_K
        rise = self.changed_K / max(self.share, 1e-12)
        return bool(max(after**2 - before**2, 0.0) <= (LEAST * rise) ** 2)

    @property
    def says(self) -> tuple[str, ...]:
        """Why no cause is named that the evidence asks for."""
        out = []
        if max(self.share, self.friction) < LEAST:
            out.append(
                f"Calibrated again, it changes no recording by more than {1e3 * self.changed_K:.2g} mK rms, "
                f"{100 * self.share:.2g} % of the rise: less than the {100 * LEAST:.2g} % that a model errs by."
            )
        elif self.coarse:
            out.append(
                f"Calibrated again, it changes no recording by more than {1e3 * self.changed_K:.2g} mK rms, and "
                f"the mesh may err by {1e3 * self.numerics_K:.2g} mK: take a finer one (numerics.mesh)."
            )
        elif not self.above:
            out.append(
                f"A smooth error of the model of {100 * LARGEST:.2g} % of the rise would explain it as well: with it "
                f"the ln Bayes factor is {self.beyond_floor:.1f}."
            )
        if not self.predicts:
            before, after = self.left_out_K
            out.append(f"Data left out are predicted to {after:.4g} K instead of {before:.4g} K: no better.")
        return tuple(out)

    def allowed(self, kind: str) -> str:
        """The kind of verdict that is borne: `weak` where a cause is not seen, `none_needed` where a hint is small or
        one that an error of the model would give as well."""
        if kind in ("named", "group") and not (self.visible and self.above and self.predicts):
            return "weak"
        small = max(self.share, self.friction) < LARGEST or self.beyond_floor < WEAK * self.causes
        return "none_needed" if kind == "weak" and small else kind


def gain(data: Data, base: Assessed, extended: Assessed) -> Gain:
    """What the extended model gains over the base."""
    problem = data.problem
    changes = [_change(b, e) for b, e in zip(base.seeings, extended.seeings, strict=True)]
    file, changed, share = max(changes, key=lambda c: c[2], default=("", 0.0, 0.0))
    beyond = _at_largest(problem, extended.fit) - _at_largest(problem, base.fit)
    left = base.left_out.rmse_K, extended.left_out.rmse_K
    friction = [_pull(b, e) for b, e in zip(base.pullings, extended.pullings, strict=True)]
    return Gain(
        file, changed, share, beyond, left, len(extended.fit.model.effects), max(friction, default=0.0),
        _numerics(data, file),
    )  # fmt: skip


def _numerics(data: Data, file: str) -> float:
    """K rms by which a mesh may err in a recording once its columns are calibrated: half of what a coarser
    one changes is the error, of which they left 1 to 4 % where it was measured (docs/discover.md, choices)."""
    if (fixed := data.fixed.get(file)) is None:
        return 0.0
    columns = [fixed.F[:, k].astype(float) for k, p in enumerate(fixed.names) if p.kind is Kind.MESH]
    coarser = [float(np.sqrt(np.mean(data.kelvin(file, c) ** 2))) for c in columns]
    return UNTOLD * GROUPS[Kind.MESH] * max(coarser, default=0.0)


def _change(base: Seeing, extended: Seeing) -> tuple[str, float, float]:
    """File, rms change (K) and its share of the rms rise of one recording."""
    here = np.isfinite(base.residual) & np.isfinite(extended.residual)
    r = base.view.recording
    if not here.any():
        return base.view.file, 0.0, 0.0
    low = float(np.nanmin(base.predicted)) if r.reflected_degC is None else r.reflected_degC
    changed = float(np.sqrt(np.mean((extended.predicted - base.predicted)[here] ** 2)))
    return base.view.file, changed, changed / max(float(np.sqrt(np.mean((base.predicted - low)[here] ** 2))), 1e-9)


def _pull(base: Pulling, extended: Pulling) -> float:
    """rms change of one load-cell trace over its friction."""
    here = np.isfinite(base.residual) & np.isfinite(extended.residual)
    if not here.any():
        return 0.0
    changed = float(np.sqrt(np.mean((extended.predicted - base.predicted)[here] ** 2)))
    return changed / max(float(np.sqrt(np.mean(base.predicted[here] ** 2))), 1e-9)


def _at_largest(problem: Problem, fit: Fit) -> float:
    """ln evidence of a fit where the model's own error may be as large as it ever is."""
    return fit.at_largest(problem, {p: v for p, v in fit.effects.items() if p not in fit.bound})
