"""Synthetic campaigns with a hidden effect, computed with another discretisation than the one that analyses them.

The truth has a finer mesh with other grading, tolerance and order, and nuisance parameters drawn from their priors.  It
is sealed in a separate file that no command reads.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera.camera_classes import COOLED, UNCOOLED
from flashtemp.camera.prediction import sensor_observation, synthetic_recording
from flashtemp.camera.prediction.observation import SIDE_WALL_CELLS, WAKE_CELL_GROWTH
from flashtemp.camera.prediction.synthetic_camera_errors import CAMERA_KINDS, IDEAL, SyntheticCamera
from flashtemp.camera.sensors import positions_from_rows
from flashtemp.errors import BadInput, suggest_name
from flashtemp.model.build import first_cells
from flashtemp.model.case import Case
from flashtemp.model.numerics import choose_binding, installed_bindings
from flashtemp.model.schema import declared_params, refinement_factor
from flashtemp.physics import user_effects
from flashtemp.runs.results.result_folder import atomic_folder
from flashtemp.solver.time_integration import integrate_schedule

NETD_K = {IDEAL: 0.05, UNCOOLED: 0.05, COOLED: 0.02}
REAL_CAMERA_FRAMES = (24, 4)  # minimum per repetition and per wait of a camera with errors, which runs all the time
LOAD_CELL_SD = 0.005  # standard deviation of one reading of the load cell
NUISANCE_SDS = {  # relative standard deviations of the priors
    "friction.mu": 0.05,
    "contact.spot_fraction": 0.05,
    "ambient.convection": 0.2,
}
ALONE_NUISANCE_SD = 0.1  # relative, of free keys where nothing slides
SENSOR_READINGS = 60  # of thermocouples per repetition
FRICTION_JITTER_SD = 0.02  # relative, of friction between conditions
CONDITION_FACTORS = ((1.0, 1.0), (0.5, 1.0), (1.0, 3.0), (0.5, 3.0))  # factors on contact.pressure and schedule.speed
SEALED_TRUTH = "sealed/truth.json"


@dataclass(frozen=True)
class SyntheticPlan:
    """Plan of a synthetic campaign: names of `hidden` effects, `seed`, number of `conditions`, `views` and frames.

    `nuisance` scales everything that is drawn from priors: 0 leaves noise, fixed pattern and dead pixels.  `points` are
    the sensors of the view "points", tables of x, z, lag_s and place_sigma_m as in campaign.toml.  The `camera` of
    every view is ideal (noise, fixed pattern and dead pixels only) or has the errors of its class; it then takes at
    least REAL_CAMERA_FRAMES frames.
    """

    hidden: tuple[str, ...]
    seed: int
    conditions: int = 4
    views: tuple[str, ...] = ("sidewall", "wake")
    sliding: int = 4
    waiting: int = 1
    nuisance: float = 1.0
    points: tuple[dict[str, Any], ...] = ()
    camera: str = IDEAL

    @property
    def frames(self) -> tuple[int, int]:
        """Frames per repetition and per wait."""
        least = (0, 0) if self.camera == IDEAL else REAL_CAMERA_FRAMES
        return max(self.sliding, least[0]), max(self.waiting, least[1])


def make_synthetic_campaign(
    case: Case, plan: SyntheticPlan, out, watch: Callable[[str], Any] = lambda text: None
) -> Path:
    """Write campaign.toml, case.toml, recordings, load-cell traces and the sealed truth into a new folder.

    Raises BadInput, SolverFailure.
    """
    out = Path(out)
    case, plan = _with_effect_files(case, plan)
    _check_plan(case, plan)
    with atomic_folder(out) as work:
        _write_campaign(case, plan, work, watch)
    return out


def _with_effect_files(case: Case, plan: SyntheticPlan) -> tuple[Case, SyntheticPlan]:
    """The case with the effect files that are to be hidden, and the plan with their names instead of paths."""
    files = [user_effects.read_user_effect(h, Path()) for h in plan.hidden if h.endswith(".py")]
    by_name = {o.name: o for o in (*case.own, *files)}
    hidden = tuple(Path(h).stem if h.endswith(".py") else h for h in plan.hidden)
    return replace(case, own=tuple(by_name.values())), replace(plan, hidden=hidden)


def _check_plan(case: Case, plan: SyntheticPlan) -> None:
    """BadInput for a plan that cannot be carried out with this case."""
    _check_hidden(case, plan)
    _check_views(plan, case)
    if case["schedule.alone"] and plan.views != ("points",):
        raise BadInput(f"--views: {','.join(plan.views)}; nothing slides (schedule.alone), give points and --points")
    if case["schedule.alone"] and plan.conditions != 1:
        raise BadInput(f"--conditions: {plan.conditions}; nothing slides (schedule.alone), give 1")
    if plan.camera not in CAMERA_KINDS:
        raise BadInput(f"--camera: {plan.camera!r}; give {', '.join(CAMERA_KINDS[:-1])} or {CAMERA_KINDS[-1]}")
    if plan.seed < 0:
        raise BadInput(f"--seed: {plan.seed}; give a whole number >= 0")
    if not 0 <= plan.nuisance <= 3:
        raise BadInput(f"--nuisance: {plan.nuisance:g}; give a scale from 0 to 3")
    if not 1 <= plan.conditions <= len(CONDITION_FACTORS):
        raise BadInput(f"--conditions: {plan.conditions}; give 1 to {len(CONDITION_FACTORS)}")
    for key in ("contact.pressure", "schedule.speed"):
        if not isinstance(case[key], (int, float)):
            raise BadInput(
                f"{case.name}: {key}: a synthetic campaign varies it by factors; give a number instead of a table"
            )


def _check_hidden(case: Case, plan: SyntheticPlan) -> None:
    for name in plan.hidden:
        if name not in case.known_effects:
            raise BadInput(f"--hide: effect '{name}' is not in the catalogue{suggest_name(name, case.known_effects)}")
        if case.known_effects[name].base:
            raise BadInput(f"--hide: effect '{name}' always acts and cannot be hidden; choose another")
    if len(set(plan.hidden)) < len(plan.hidden):
        raise BadInput(f"--hide: {', '.join(plan.hidden)}: an effect is named twice; once is enough")


def _check_views(plan: SyntheticPlan, case: Case) -> None:
    if len(set(plan.views)) < len(plan.views):
        raise BadInput(f"--views: {','.join(plan.views)}: a view is named twice; once is enough")
    for view in plan.views:
        if view not in (*synthetic_recording.VIEW_GEOMETRY, "points"):
            raise BadInput(f"--views: {view!r}; give some of {', '.join(synthetic_recording.VIEW_GEOMETRY)}, points")
    if ("points" in plan.views) != bool(plan.points):
        raise BadInput("--points: places and the view of points belong together; give both, for example x=0.01,z=0.002")
    if plan.points:
        sensor_observation.check_positions(positions_from_rows(list(plan.points), "--points"), case.scene, "--points")


def _write_campaign(case: Case, plan: SyntheticPlan, work: Path, watch) -> None:
    import tomli_w

    rng = np.random.default_rng(plan.seed)
    stated_case = replace(case, effects=tuple(e for e in case.effects if e not in plan.hidden))
    stated_case = replace(stated_case, values={t: v for t, v in case.values.items() if t not in plan.hidden})
    (work / "case.toml").write_text(stated_case.toml(stated_case.copy_files(work)), encoding="utf-8")
    strengths = {name: draw_effect_parameters(name, case, rng) for name in plan.hidden}
    known = (
        {k: ALONE_NUISANCE_SD for k in case.free if not k.startswith("friction.")}
        if case["schedule.alone"]
        else NUISANCE_SDS
    )
    drawn = {k: _allowed_factor(case, k, float(np.exp(plan.nuisance * s * rng.normal()))) for k, s in known.items()}
    fastest = max(f for _, f in CONDITION_FACTORS[: plan.conditions]) * case["schedule.speed"]
    numerics = draw_discretisation(case.with_values({"schedule.speed": fastest}), rng)
    truth: dict[str, Any] = {
        "hidden": strengths,
        "nuisance": drawn,
        "numerics": numerics,
        "seed": plan.seed,
        "recordings": {},
    }
    entries: dict[str, list] = {"recording": [], "force": []}
    for number, factors in enumerate(CONDITION_FACTORS[: plan.conditions], 1):
        given = {
            k: float(f"{f * case[k]:.12g}")
            for k, f in zip(("contact.pressure", "schedule.speed"), factors, strict=True)
        }
        watch(f"condition {number} of {plan.conditions}: {', '.join(f'{k} = {v:g}' for k, v in given.items())}")
        jitter = 1.0 + plan.nuisance * FRICTION_JITTER_SD * float(rng.normal())
        nuisances = {k: _clip_to_bounds(k, case[k] * f) for k, f in drawn.items()}
        if "friction.mu" in nuisances:
            nuisances["friction.mu"] *= jitter
        values = {f"{name}.{k}": v for name, p in strengths.items() for k, v in p.items()}
        made = _true_case(case, plan, given | nuisances | numerics | values)
        name = f"condition{number}"
        files, faults = _measure_condition(made, plan, rng, work, name)
        truth["recordings"][name] = {"friction_jitter": jitter, **faults}
        for file in files:
            kind = "force" if file.endswith(".csv") else "recording"
            camera = IDEAL if file.endswith("_points.nc") else plan.camera
            sigma = {"sigma": LOAD_CELL_SD} if kind == "force" else {"sigma_K": NETD_K[camera]}
            entries[kind].append({"file": file, "with": given, **sigma})
    head = {
        "title": f"synthetic campaign of {case.name}", "case": "case.toml", "free": list(known),
    }  # fmt: skip
    (work / "campaign.toml").write_text(tomli_w.dumps(head | entries), encoding="utf-8")
    (work / SEALED_TRUTH).parent.mkdir()
    for effect in case.own:
        if effect.name in plan.hidden:
            (work / SEALED_TRUTH).with_name(f"{effect.name}.py").write_text(effect.source, encoding="utf-8")
    (work / SEALED_TRUTH).write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8")


def _clip_to_bounds(key: str, value: float) -> float:
    """A drawn value, limited to the bounds of its key."""
    table, name = key.rsplit(".", 1)
    param = declared_params(table)[name]
    return float(np.clip(value, param.low, param.high))


def _allowed_factor(case: Case, key: str, factor: float) -> float:
    """A factor on a key's value that keeps it within its bounds: the inverse, or 1, of one that does not.

    A spot fraction of 1 can only be smaller: its prior is then the half of the log-normal below 1.
    """
    table, name = key.rsplit(".", 1)
    param, value = case.declared_params(table)[name], case[key]
    if not isinstance(value, (int, float)):
        return factor
    return next(f for f in (factor, 1.0 / factor, 1.0) if f == 1.0 or param.low <= f * value <= param.high)


def draw_effect_parameters(name: str, case: Case, rng) -> dict[str, float]:
    """Parameters of a hidden effect: half to one and a half times its default or the value in the case."""
    out = {}
    for key, param in case.known_effects[name].params().items():
        base = case.values.get(name, {}).get(key, param.value)
        if isinstance(base, bool) or not isinstance(base, (int, float)):
            continue
        factor = float(rng.uniform(0.5, 1.5)) if param.off is not None else 1.0
        value = base if param.off is None else param.off + factor * (base - param.off)
        bounded = float(np.clip(value, param.low, param.high))
        out[key] = round(bounded) if "whole" in param.kinds else bounded
    return out


def draw_discretisation(case: Case, rng) -> dict[str, Any]:
    """Another mesh, grading, tolerance and order than in the case, with 1.75 to 2 times the cells per direction."""
    n = case.values["numerics"]
    other = [b for b in installed_bindings() if b != choose_binding(n["integrator"])]
    finer = refinement_factor(n["mesh"]) * float(rng.uniform(1.75, 2.0))
    out = {
        "numerics.mesh": finer,
        "numerics.first_block": first_cells(case.scene, n)["numerics.first_block"] * float(rng.uniform(0.6, 0.8)),
        "numerics.rtol": n["rtol"] / 10,
        "numerics.order": 2 if n["order"] == 3 else 3,
    }
    first_road = float(case.scene.mesh.depth[1]) * refinement_factor(n["mesh"])
    for key in ("first_x", "last_x", "first_road"):  # first cells of the refined mesh: another grading
        out[f"numerics.{key}"] = (n[key] or first_road) * float(rng.uniform(0.6, 0.8))
    return out | ({"numerics.integrator": other[0]} if other else {})


def _true_case(case: Case, plan: SyntheticPlan, given: dict[str, Any]) -> Case:
    """The case with its hidden effects, drawn parameters and the discretisation of the truth."""
    effects = [*case.effects, *(e for e in plan.hidden if e not in case.effects)]
    behind = max(
        (synthetic_recording.VIEW_GEOMETRY[v][2] or 0.0) if v in synthetic_recording.VIEW_GEOMETRY else 0.0
        for v in plan.views
    )
    numerics = {
        "road.downstream": max(case["road.downstream"], behind + 2e-3 if behind else 0.0),
        "numerics.behind": WAKE_CELL_GROWTH,
        "numerics.above": SIDE_WALL_CELLS,
    }
    return case.with_values(given | numerics | {"effects": effects})


def _measure_condition(made: Case, plan: SyntheticPlan, rng, work: Path, name: str) -> tuple[list[str], dict]:
    """Simulate the truth of one condition, write its recordings, and return their files and errors."""
    scene, netd = made.scene, NETD_K[plan.camera]
    times, repetition = synthetic_recording.frame_schedule(
        scene.schedule, *plan.frames, 1.5 if plan.camera == IDEAL else 1.0
    )
    blanks = {
        view: synthetic_recording.empty_recording(view, scene, times, repetition, netd)
        for view in plan.views
        if view != "points"
    }
    if plan.camera == COOLED:
        blanks = {view: replace(blank, camera=COOLED) for view, blank in blanks.items()}
    if plan.points:
        often = synthetic_recording.frame_schedule(scene.schedule, SENSOR_READINGS, plan.waiting)
        blanks["points"] = synthetic_recording.empty_sensor_recording(
            positions_from_rows(list(plan.points)), scene, *often, NETD_K[IDEAL]
        )
    required = {float(t) for r in blanks.values() for t in synthetic_recording.exposure_times(r, scene.acting)}
    inside = tuple(sorted(t for t in required if 0.0 <= t <= scene.schedule.end_time))
    run = integrate_schedule(scene, replace(made.settings, times=inside, fields=2), made.title)
    files, faults = [], {}
    for view, recording in blanks.items():
        errors = synthetic_recording.draw_errors(recording, rng, plan.nuisance)
        faults[view] = asdict(errors)
        camera = None
        if plan.camera != IDEAL and recording.places is None:
            camera = SyntheticCamera.draw_random(plan.camera, (plan.seed, plan.views.index(view)))
            faults[view]["camera"] = asdict(camera.errors)
        synthetic_recording.render_recording(run, scene, recording, errors, rng, camera=camera).save(
            work / f"{name}_{view}.nc"
        )
        files.append(f"{name}_{view}.nc")
    on = run.sliding & np.isfinite(run.friction)
    if not on.any():  # schedule.alone: nothing slides
        return files, faults
    t = np.linspace(0.0, scene.schedule.end_time, 200)
    t = t[np.interp(t, run.time, run.sliding.astype(float)) > 0.99]
    mu = np.interp(t, run.time[on], run.friction[on]) + LOAD_CELL_SD * rng.normal(size=len(t))
    files.append(f"{name}_mu.csv")
    np.savetxt(work / files[-1], np.column_stack([t, mu]), delimiter=",", header="time_s,mu", comments="", fmt="%.9g")
    return files, faults
