"""The case with what was found: calibrated parameters and accepted effects, to be run as it is."""

from __future__ import annotations

from pathlib import Path

from flashtemp.discovery.estimation.linearised_fit import Fit
from flashtemp.discovery.hypotheses.candidates import Model
from flashtemp.discovery.hypotheses.piecewise_linear_law import EFFECT_NAME
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.verdict import Verdict


def write_extended_case(problem: Problem, fit: Fit, verdict: Verdict, folder: Path) -> None:
    """extended.toml, and the files that it names; nothing where the verdict extends nothing."""
    if not verdict.extends:
        return
    free = {p.name: fit.model.free[p.name] + fit.solution[p] for p in problem.free}
    found = {e.name: e.value for c in verdict.causes for e in c.parameters}
    effects = {
        c.effect: {k: found.get(str(ParameterId.of_effect(c.effect, k)), v) for k, v in own.items()}
        for c in verdict.causes
        if not c.laboratory and (own := fit.model.effects[c.effect])
    }
    case = Model(free, effects).on(problem.case)
    files = case.copy_files(folder)
    if EFFECT_NAME in files:  # a learned law lies beside the case, to be read
        (folder / files[EFFECT_NAME]).rename(folder / f"{EFFECT_NAME}.py")
        files[EFFECT_NAME] = f"./{EFFECT_NAME}.py"
        if not any((folder / "inputs").iterdir()):
            (folder / "inputs").rmdir()
    (folder / "extended.toml").write_text(case.toml(files), encoding="utf-8")
