"""The laws of all active effects, grouped by the quantity or site that they change."""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.meshes.mesh import Mesh
from flashtemp.model.scene import LawContext, Scene, gauss_mean
from flashtemp.physics.arrays import Array, Value
from flashtemp.physics.effect import Deposit, Factor, Heat, Term

COMPLEX_STEP = 1e-30  # step of complex-step differentiation: derivatives exact to rounding


class EffectLaws:
    """Contributions of all active effects, grouped by quantity; the code refers to no effect by name.

    Terms and factors change a quantity, heat transfer coefficients (`films`) and heat sources (`patches`, `zones`)
    act at a site, `deposits` release frictional heat at a depth (theory.md, eq. (6)).
    """

    def __init__(self, scene: Scene):
        self.terms: dict[str, list[tuple[Term, Any, str]]] = {}
        self.factors: dict[str, list[tuple[Factor, Any, str]]] = {}
        self.films: dict[str, list[tuple[Heat, Any, str]]] = {}
        self.patches: list[tuple[Heat, Any, str]] = []
        self.zones: list[tuple[Heat, Any, str]] = []
        self.deposits: list[Deposit] = []
        self.contact_varies = False  # a law of the contact depends on time: evaluate it at every step
        self.base_contact_only = True  # only base effects act on the contact, apart from the pressure shape
        # only base effects set heat transfer coefficients: these depend on contact and ambient temperature alone
        self.base_films_only = True
        for acting in scene.acting:
            for part in acting.contributions(scene):
                target = getattr(part, "target", "")
                effect = acting.effect
                changes_contact = not effect.base and target.startswith(("contact.", "road.lane"))
                self.contact_varies |= changes_contact and not effect.steady
                self.base_contact_only &= not changes_contact or target in ("contact.pressure", "contact.flat_face")
                if isinstance(part, Term):
                    self.terms.setdefault(part.target, []).append((part, acting.p, acting.name))
                elif isinstance(part, Factor):
                    self.factors.setdefault(part.target, []).append((part, acting.p, acting.name))
                elif isinstance(part, Deposit):
                    self.deposits.append(part)
                elif part.kind == "film":
                    self.base_films_only &= effect.base
                    self.films.setdefault(part.site, []).append((part, acting.p, acting.name))
                else:
                    (self.patches if part.kind == "patch" else self.zones).append((part, acting.p, acting.name))

    def has_law(self, target: str) -> bool:
        """Whether any effect changes this quantity."""
        return target in self.terms or target in self.factors

    def __call__(self, target: str, base: Value, T: Value, now: LawContext | None, *args: Any) -> Value:
        """Value of the quantity `target`: (base + sum of terms) times the product of factors.

        `T` in K; `now` is the state at which the laws are evaluated.
        """
        value = base
        for part, p, _ in self.terms.get(target, ()):
            value = value + part.law(T, now, p, *args)
        for factor, p, _ in self.factors.get(target, ()):
            value = value * factor.law(T, now.with_fields(base=value) if now is not None else now, p, *args)
        return value

    def heat_by_effect(self, T: Value, now: LawContext) -> dict[str, float]:
        """Magnitude of the heat of each effect (W/m2) at a state, to report the largest one when a solve fails."""
        sizes = {}
        laws = (*self.terms.get("friction.mu", ()), *self.factors.get("friction.mu", ()))
        for part, p, name in laws:
            sizes[name] = float(np.max(np.abs(part.law(T, now, p)))) * now.pressure * now.speed
        for site in self.films.values():
            for film, p, name in site:
                h = film.law(now, p)
                if np.isfinite(h):
                    sizes[name] = max(sizes.get(name, 0.0), h * float(np.max(np.abs(T - now.ambient))))
        return sizes


def mean_over_columns(
    laws: EffectLaws, target: str, mesh: Mesh, now: LawContext, base: float = 1.0, has_kinks: bool = False
) -> Array:
    """Means over each column under the block of a quantity whose laws depend on x and y; `base` without a law.

    Three Gauss points per column; in 2D on the centre line y = 0.  With `has_kinks` each half of a column is
    integrated separately, because the laws may have a kink at its middle, as the worn profile of a result has.
    """
    if not laws.has_law(target):
        return np.full(len(mesh.column_x), base)
    edges = mesh.x[mesh.first : mesh.last + 1]

    def mean_along_x(y: Value) -> Array:
        def law(x: Value) -> Value:
            at = now.at_position(mesh, x[:, None], y)
            return laws(target, base, None, at) + 0.0 * (at.x + y)  # broadcasts laws that depend on neither

        if not has_kinks:
            return gauss_mean(law, edges)
        halves = gauss_mean(law, np.sort(np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])])))
        return 0.5 * (halves[::2] + halves[1::2])

    means = mean_along_x(np.zeros(1)) if mesh.n_across == 1 else gauss_mean(mean_along_x, mesh.y)
    return means.ravel()


def has_pressure_shift(laws: EffectLaws) -> bool:
    """Whether any effect redistributes the pressure, so that the elastic contact must be solved."""
    targets = (
        "block.abrasion", "block.worn", "block.expansion", "holder.compliance", "contact.flat_face",
        "contact.shear_traction",
    )  # fmt: skip
    return any(map(laws.has_law, targets))
