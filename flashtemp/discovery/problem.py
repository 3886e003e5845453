"""A campaign made ready for fitting: conditions, mesh pins, looks by many workers, and whitened columns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flashtemp.comparison.campaign import Campaign
from flashtemp.comparison.compare import conditions, scatter, window
from flashtemp.comparison.noise import Noise, noise, whiten
from flashtemp.discovery.hypothesis import Candidate, Model, candidates, prior
from flashtemp.discovery.linear_gaussian import Block
from flashtemp.discovery.prediction import Look, Task, Wanted, packed
from flashtemp.errors import BadInput
from flashtemp.model import case as cases
from flashtemp.model.schema import refinement

MODES = 6  # cosines of the pressure along the block
GROUPS = {  # standard deviations of what no laboratory knows better, by the kind of nuisance
    "scatter": 0.01,  # of friction from repetition to repetition
    "level": 0.02,  # of friction from condition to condition
    "gain": 0.01,  # what a view takes the radiance times
    "spread": 0.05,  # relative width of the optics
    "map": 0.003,  # gain along and up a view
    "wall": 0.01,  # what the wall is cooler than the section behind it
    "mesh": 0.5,  # of the difference to a mesh that is coarser in one direction, or in all
    "cell": 0.005,  # gain of the load cell
}
MODE = 0.01  # of the first pressure mode; the n-th has an n-th of it
MAPS = ((1, 0), (2, 0), (0, 1), (1, 1), (0, 2))


@dataclass(frozen=True)
class Study:
    """What does not change while a campaign is fitted.

    `pins` of the mesh per condition; `tried` candidates and `left` {effect: why it cannot be tried}; `run` maps
    `look` over tasks.
    """

    campaign: Campaign
    conditions: tuple
    pins: tuple[dict[str, Any], ...]
    tried: tuple[Candidate, ...]
    left: dict[str, str]
    run: Callable
    case: cases.Case

    def tasks(self, model: Model, wanted: Wanted, shifts, coarse: tuple[float, ...] | None = None) -> list[Task]:
        """One task per condition; `coarse` (3,) multiplies the number of cells along, up and down."""
        out = []
        for (given, views, forces), pins in zip(self.conditions, self.pins, strict=True):
            if coarse:
                finer = zip(coarse, self.case["numerics.finer"], strict=True)
                pins = pins | {"numerics.finer": [max(0.1, c * f) for c, f in finer]}  # the least that a case may give
            out.append(Task(self.campaign.case, given, pins, model, tuple(views), tuple(forces), wanted, dict(shifts)))
        return out

    @property
    def priors(self) -> dict[str, float]:
        """Standard deviation of the ln of every free key."""
        return {key: prior(key) for key in self.campaign.free}


def prepare(campaign: Campaign, run: Callable) -> Study:
    """Check a campaign for what fitting needs.  Raises BadInput."""
    groups = conditions(campaign)
    case = campaign.load({})
    for key in campaign.free:
        value = case[key]
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < float("inf"):
            raise BadInput(
                f"{campaign.case}: {key}: {value!r} cannot be freed; give a number > 0, or leave it out of free"
            )
        _may_move(campaign, case, key)
    named = campaign.candidates if campaign.candidates is not None else case.candidates
    tried, left = candidates(case, named)
    pins = tuple(_pins(campaign, given, views, tried) for given, views, _ in groups)
    return Study(campaign, tuple(groups), pins, tuple(tried), left, run, case)


def _may_move(campaign: Campaign, case: cases.Case, key: str) -> None:
    """BadInput unless a key can move while mesh and schedule stay."""
    moved = cases.build(cases.load_with(case, {key: case[key] * 0.99}))
    scene = cases.build(case)
    same = all(np.array_equal(getattr(moved.mesh, k), getattr(scene.mesh, k)) for k in ("x", "height"))
    if not same or moved.schedule.end != scene.schedule.end:
        what = "schedule" if same else "mesh"
        raise BadInput(f"{campaign.case}: free: {key!r} changes the {what}; free a parameter of the physics instead")


def _pins(campaign: Campaign, given, views, tried) -> dict[str, Any]:
    """Overrides that give a condition one mesh, whatever is tried on it."""
    case = campaign.load(given)
    pins = window(case, views)
    meshes = [cases.build(case).mesh]
    for c in tried:
        if not c.optical:
            meshes.append(cases.build(cases.load_with(case, {"effects": [*case.effects, c.effect]})).mesh)
    refine = refinement(case["numerics.mesh"]) * case["numerics.finer"][1]
    return pins | {
        "road.depth": float(max(m.depth[-1] for m in meshes)),
        "numerics.first_block": float(min(m.height[1] for m in meshes)) * refine,
    }


@dataclass
class Data:
    """Looks turned into whitened blocks; `noises` by file are kept, so that hypotheses are compared alike.

    `fixed` columns by file are whitened once; all blocks share them.
    """

    study: Study
    noises: dict[str, Noise | float] = field(default_factory=dict)
    fixed: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    shared: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def fix(self, first: list[Look], coarse: list[list[Look]]) -> None:
        """Keep traces of what is small and of unknown shape, and differences to coarser meshes, for all later fits."""
        self.fixed, self.shared = {}, {}
        for (_, views, forces), fine, *rough in zip(self.study.conditions, first, *coarse, strict=True):
            for entry in (*views, *forces):
                sight = fine.sights[entry.file]
                columns = {k: v for k, v in sight.columns.items() if k.split(":")[0] in FIXED}
                for k, other in enumerate(rough):
                    change = sight.predicted - other.sights[entry.file].predicted
                    columns[f"mesh:{k}"] = packed(change, sight.inside) if change.ndim == 3 else change
                columns |= _images(entry, sight) if sight.predicted.ndim == 3 else {"cell": sight.predicted}
                self.fixed[entry.file] = columns

    def blocks(self, looks: list[Look]) -> list[Block]:
        """One block per recording and trace."""
        out = []
        for number, ((_, views, forces), seen) in enumerate(zip(self.study.conditions, looks, strict=True)):
            out += [self._view(number, view, seen.sights[view.file]) for view in views]
            out += [self._force(number, force, seen.sights[force.file]) for force in forces]
        return out

    def residual(self, view, sight) -> np.ndarray:
        """Measured less predicted (frames, nv, nu) K, NaN where not compared."""
        return np.where(sight.inside, view.recording.temperature - sight.predicted, np.nan)

    def _view(self, number, view, sight) -> Block:
        left = self.residual(view, sight)
        if not np.isfinite(left).any():
            raise BadInput(
                f"{view.file}: no pixel of it lies on the block or the road, clear of their edges; check u, v and view"
            )
        if view.file not in self.noises:
            r = view.recording
            stated = view.sigma_K if view.sigma_K is not None else r.netd_K
            self.noises[view.file] = noise(left, stated, r.fixed_pattern_K)
        level, left = self.noises[view.file], left[:, sight.inside]
        good = np.isfinite(left)

        def white(values):
            return whiten(np.where(good, values, np.nan)[:, None], level)[:, 0][good]

        return self._block(number, view, sight, white(left), white)

    def _force(self, number, force, sight) -> Block:
        good = sight.inside & np.isfinite(sight.predicted)
        left = (np.array(force.mu) - sight.predicted)[good]
        if force.file not in self.noises:
            self.noises[force.file] = force.sigma or scatter(left)
        sigma = self.noises[force.file]
        return self._block(number, force, sight, left / sigma, lambda values: np.asarray(values, float)[good] / sigma)

    def _block(self, number, entry, sight, r, white) -> Block:
        fixed = self.fixed.get(entry.file, {})
        if entry.file not in self.shared or len(self.shared[entry.file][0]) != len(r):
            F = _stack([white(v) for v in fixed.values()], len(r))
            self.shared[entry.file] = F, F.astype(float).T @ F.astype(float)
        F, FF = self.shared[entry.file]
        own = {k: v for k, v in sight.columns.items() if k not in fixed}
        C = _stack([white(v) for v in own.values()], len(r))
        return Block(entry.file, number, entry.held_out, r, C, _names([*own, *fixed], number, entry.file), F, FF)


def _stack(columns: list[np.ndarray], n: int) -> np.ndarray:
    return np.stack(columns, axis=1).astype(np.float32) if columns else np.zeros((n, 0), np.float32)


def _images(view, sight) -> dict[str, np.ndarray]:
    """Smooth maps that a camera may see and no run explains: gain along a view, and the wall's own cooling."""
    r, rise = view.recording, sight.predicted - (view.recording.reflected_degC or float(np.nanmin(sight.predicted)))
    x = (r.u - r.u[0]) / max(r.u[-1] - r.u[0], 1e-12)
    y = (r.v - r.v[0]) / max(r.v[-1] - r.v[0], 1e-12) if len(r.v) > 1 else np.zeros(1)
    out = {}
    for m, n in MAPS:
        if n and len(r.v) == 1:
            continue
        out[f"map:{m}:{n}"] = rise * np.cos(n * np.pi * y)[:, None] * np.cos(m * np.pi * x)
    if r.view == "sidewall":
        for k, depth in enumerate((1e-3, 4e-3)):
            out[f"wall:{k}"] = rise * np.exp(-np.maximum(r.v, 0.0) / depth)[:, None]
    return {k: packed(values, sight.inside) for k, values in out.items()}


FIXED = ("scatter", "mode", "trend")
OWN = ("shift_u", "shift_v", "gain", "spread", "map", "wall")  # of one recording
SHARED = ("scatter", "trend", "mesh")  # of one condition


def _names(columns: list[str], number: int, file: str) -> tuple[tuple[str, int], ...]:
    """Names under which columns are known: those of one recording or condition carry its name."""
    out = []
    for i, name in enumerate(columns):
        kind = name.split(":")[0]
        if kind in OWN:
            out.append((f"{name}|{file}", i))
        elif kind in SHARED:
            out.append((f"{name}|{number}", i))
        else:
            out.append((name, i))
        if name == "friction.mu":
            out.append((f"level|{number}", i))
        if kind == "mode":
            out.append((f"flux:{name[5:]}|{number}", i))
    return tuple(out)


PLAIN = ("shift_u", "shift_v", "gain", "spread", "level", "cell", "mesh")  # what everybody would calibrate


def plain(study: Study, priors: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Priors of nuisances that may not bend the pressure, the walls or the friction of a repetition."""
    return {n: v for n, v in priors.items() if n in study.priors or n.partition("|")[0].split(":")[0] in PLAIN}


def nuisances(study: Study, names, model: Model, shifts, scale: float = 1.0) -> dict[str, tuple[float, float]]:
    """(mean, standard deviation) of everything that calibration may move, seen from a point; `scale` of what is
    small and unknown in shape."""
    out: dict[str, tuple[float, float]] = {}
    known = {v.file: v.recording.registration_sigma_px for v in study.campaign.views}
    for name in names:
        kind, _, file = name.partition("|")
        kind = kind.split(":")[0]
        if name in study.priors:
            out[name] = (-model.free[name], study.priors[name])
        elif kind in ("shift_u", "shift_v"):
            out[name] = (-shifts.get(file, (0.0, 0.0))[kind == "shift_v"], known[file])
        elif kind in ("mode", "trend"):
            out[name] = (0.0, scale * MODE / int(name.partition("|")[0].split(":")[1]))
        elif kind in GROUPS:
            out[name] = (0.0, GROUPS[kind] * (min(scale, 3.0) if kind in ("scatter", "map", "wall") else 1.0))
    return out
