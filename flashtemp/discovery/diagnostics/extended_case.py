"""The case with what was found: calibrated parameters and accepted effects, to be run as it is."""

from __future__ import annotations

from pathlib import Path

from flashtemp.discovery.estimation.linearised_fit import Fit
from flashtemp.discovery.hypotheses.candidates import Model, clip_to_bounds, parameter_spec
from flashtemp.discovery.hypotheses.input_kinds import input_kind, scaled_value
from flashtemp.discovery.hypotheses.piecewise_linear_law import EFFECT_NAME
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.verdict import Held, Verdict
from flashtemp.model.case import Case
from flashtemp.model.priors import with_materials


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
    case, comment = Model(free, effects).on(problem.case), ""
    if (held := verdict.corrected_key) is not None:
        case, comment = correct_input(problem.case, held), describe_correction(held)
    files = case.copy_files(folder)
    if EFFECT_NAME in files:  # a learned law lies beside the case, to be read
        (folder / files[EFFECT_NAME]).rename(folder / f"{EFFECT_NAME}.py")
        files[EFFECT_NAME] = f"./{EFFECT_NAME}.py"
        if not any((folder / "inputs").iterdir()):
            (folder / "inputs").rmdir()
    (folder / "extended.toml").write_text(comment + case.toml(files), encoding="utf-8")


def correct_input(case: Case, held: Held) -> Case:
    """The case with a stated number as the data want it, and its free keys as calibrated with that number.

    Where conditions state the number, as often a load or a speed, that of the case changes by the same factor, or by
    the same difference.  Raises BadInput.
    """
    full: Case = with_materials(case)
    parameter = parameter_spec(full, held.key)
    if input_kind(held.key, parameter.unit).relative:
        value = scaled_value(full, held.key, held.value / held.told)
    else:
        value = full[held.key] + held.value - held.told
    if isinstance(value, float):
        value = clip_to_bounds(parameter, value)
    return full.with_values(held.calibrated | {held.key: value})


def describe_correction(held: Held) -> str:
    """A comment for the head of the corrected case."""
    unit = "" if held.unit == "1" else f" {held.unit}"
    also = f"; calibrated with it: {', '.join(held.calibrated)}" if held.calibrated else ""
    return (
        f"# {held.key} is corrected from {held.told:.6g} to {held.value:.6g} +- {held.stderr:.2g}{unit}, "
        f"as the data want it{also}\n"
    )
