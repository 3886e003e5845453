"""The extended case: calibrated parameters and accepted effects, or a corrected input, written as a case file."""

from __future__ import annotations

from pathlib import Path

from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.hypotheses.candidates import ModelPoint, clip_to_bounds, parameter_spec
from flashtemp.discovery.hypotheses.input_kinds import input_kind, scale_value
from flashtemp.discovery.hypotheses.piecewise_linear_law import LEARNED_LAW_NAME
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.verdict import InputCorrection, Verdict
from flashtemp.model.case import Case
from flashtemp.model.priors import expand_materials


def write_extended_case(problem: Problem, fit: LinearisedFit, verdict: Verdict, folder: Path) -> None:
    """Write extended.toml and the files that it names; nothing if the verdict has no extension."""
    if not verdict.has_extension:
        return
    free = {p.name: fit.model.free[p.name] + fit.solution[p] for p in problem.free_keys}
    found = {e.name: e.value for c in verdict.causes for e in c.parameters}
    effects = {
        c.effect: {k: found.get(str(ParameterId.of_effect(c.effect, k)), v) for k, v in own.items()}
        for c in verdict.causes
        if not c.laboratory and (own := fit.model.effects[c.effect])
    }
    case, comment = ModelPoint(free, effects).apply_to(problem.case), ""
    if (held := verdict.corrected_key) is not None:
        case, comment = correct_input(problem.case, held), describe_correction(held)
    files = case.copy_files(folder)
    if LEARNED_LAW_NAME in files:  # the file of a learned law is placed next to the case, where a user looks for it
        (folder / files[LEARNED_LAW_NAME]).rename(folder / f"{LEARNED_LAW_NAME}.py")
        files[LEARNED_LAW_NAME] = f"./{LEARNED_LAW_NAME}.py"
        if not any((folder / "inputs").iterdir()):
            (folder / "inputs").rmdir()
    (folder / "extended.toml").write_text(comment + case.toml(files), encoding="utf-8")


def correct_input(case: Case, correction: InputCorrection) -> Case:
    """The case with a stated number corrected as the data require, and its free keys calibrated with that number.

    If conditions state the number (often a load or a speed), the number of the case changes by the same factor or by
    the same difference.  Raises BadInput.
    """
    full: Case = expand_materials(case)
    parameter = parameter_spec(full, correction.key)
    if input_kind(correction.key, parameter.unit, correction.told == 0.0).relative:
        value = scale_value(full, correction.key, correction.value / correction.told)
    else:
        value = full[correction.key] + correction.value - correction.told
    if isinstance(value, float):
        value = clip_to_bounds(parameter, value)
    return full.with_values(correction.calibrated | {correction.key: value})


def describe_correction(correction: InputCorrection) -> str:
    """A comment for the first line of the corrected case."""
    unit = "" if correction.unit == "1" else f" {correction.unit}"
    also = f"; calibrated with it: {', '.join(correction.calibrated)}" if correction.calibrated else ""
    return (
        f"# {correction.key} is corrected from {correction.told:.6g} to {correction.value:.6g} +- "
        f"{correction.stderr:.2g}{unit}, as the data require{also}\n"
    )
