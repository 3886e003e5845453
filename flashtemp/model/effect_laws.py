"""Contributions of all acting effects, sorted by the quantity or site that they speak about."""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.meshes.mesh import Mesh
from flashtemp.model.scene import LawContext, Scene, gauss_mean
from flashtemp.physics.arrays import Array, Value
from flashtemp.physics.effect import Deposit, Factor, Heat, Term

COMPLEX_STEP = 1e-30  # complex step: exact derivative to rounding


class EffectLaws:
    """Contributions of all acting effects, sorted by quantity; no effect is known by name."""

    def __init__(self, scene: Scene):
        self.terms: dict[str, list[tuple[Term, Any, str]]] = {}
        self.factors: dict[str, list[tuple[Factor, Any, str]]] = {}
        self.films: dict[str, list[tuple[Heat, Any, str]]] = {}
        self.patches: list[tuple[Heat, Any, str]] = []
        self.zones: list[tuple[Heat, Any, str]] = []
        self.deposits: list[Deposit] = []
        self.contact_varies = False  # an effect's word about the contact changes: ask it at every moment
        self.base_contact_only = True  # all that is said of it is the base's, but for the shape of the pressure
        self.base_films_only = (
            True  # all films are the base's: they change with whether the block touches, and with the air
        )
        for acting in scene.acting:
            for part in acting.contributions(scene):
                target = getattr(part, "target", "")
                kind = acting.effect
                touching = not kind.base and target.startswith(("contact.", "road.lane"))
                self.contact_varies |= touching and not kind.steady
                self.base_contact_only &= not touching or target in ("contact.pressure", "contact.flat_face")
                if isinstance(part, Term):
                    self.terms.setdefault(part.target, []).append((part, acting.p, acting.name))
                elif isinstance(part, Factor):
                    self.factors.setdefault(part.target, []).append((part, acting.p, acting.name))
                elif isinstance(part, Deposit):
                    self.deposits.append(part)
                elif part.kind == "film":
                    self.base_films_only &= kind.base
                    self.films.setdefault(part.site, []).append((part, acting.p, acting.name))
                else:
                    (self.patches if part.kind == "patch" else self.zones).append((part, acting.p, acting.name))

    def has_law(self, target: str) -> bool:
        """Whether any effect speaks about this quantity."""
        return target in self.terms or target in self.factors

    def __call__(self, target: str, base: Value, T: Value, now: LawContext | None, *args: Any) -> Value:
        """(base + sum of terms) times product of factors."""
        value = base
        for part, p, _ in self.terms.get(target, ()):
            value = value + part.law(T, now, p, *args)
        for factor, p, _ in self.factors.get(target, ()):
            value = value * factor.law(T, now.with_fields(base=value) if now is not None else now, p, *args)
        return value

    def heat_by_effect(self, T: Value, now: LawContext) -> dict[str, float]:
        """Size of each effect's heat at a state, to name the largest one when a solve fails."""
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
    """Means over the columns under the block of a quantity whose laws depend on x and y; `base` where no law speaks.

    In 2D laws are asked on the centre line.  Those that are `has_kinks` may have a kink in the middle of a column, as the
    worn profile of a result has.
    """
    if not laws.has_law(target):
        return np.full(len(mesh.column_x), base)
    edges = mesh.x[mesh.first : mesh.last + 1]

    def along(y: Value) -> Array:
        def law(x: Value) -> Value:
            at = now.at_position(mesh, x[:, None], y)
            return laws(target, base, None, at) + 0.0 * (at.x + y)

        if not has_kinks:
            return gauss_mean(law, edges)
        halves = gauss_mean(law, np.sort(np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])])))
        return 0.5 * (halves[::2] + halves[1::2])

    means = along(np.zeros(1)) if mesh.n_across == 1 else gauss_mean(along, mesh.y)
    return means.ravel()


def has_pressure_shift(laws: EffectLaws) -> bool:
    """Whether anything moves the pressure away from the shape that laws prescribe."""
    told = (
        "block.abrasion", "block.worn", "block.expansion", "holder.compliance", "contact.flat_face",
        "contact.shear_traction",
    )  # fmt: skip
    return any(map(laws.has_law, told))
