"""Run all checks of an effect, in the order in which its author would correct errors."""

from __future__ import annotations

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Effect
from flashtemp.runs.checks.effect_check import camera_checks, heat_balance_checks, law_checks, source_checks
from flashtemp.runs.checks.effect_check.findings import Finding, make_finding
from flashtemp.runs.checks.effect_check.fixtures import EffectUnderTest, SceneCache

FILE_CHECKS = (
    source_checks.check_file,
    source_checks.check_imports,
    source_checks.check_example,
    source_checks.check_words,
    source_checks.check_parameters,
)
RUN_CHECKS = (
    heat_balance_checks.jacobian,
    heat_balance_checks.linearisation,
    heat_balance_checks.conservation,
    heat_balance_checks.energy,
)


def run_all_checks(trial: EffectUnderTest, bench: SceneCache) -> list[Finding]:
    """Findings on an effect: its file, then each of its laws, then runs with it if the laws pass.

    Raises BadInput for values that the effect cannot have.
    """
    found = [check(trial) for check in FILE_CHECKS]
    if not trial.has_heat and trial.effect.see is Effect.see:
        says = f"{trial.file}: has no contribution; write heat(self, scene, p) or, for a camera, see(self, p)"
        return [*found, Finding("loads", False, says)]
    try:
        bench.build_scene(trial)
    except BadInput as fault:
        return [*found, Finding("loads", False, "; ".join(fault.lines))]
    found.append(Finding("loads", True, "a small case with the effect loads: all names exist"))
    if not trial.has_heat:
        return found + camera_checks.check_camera_effect(bench, trial)
    of_laws = law_checks.check_laws(bench, trial)
    found += of_laws
    if all(f.ok for f in of_laws):
        found += _check_runs(trial, bench)
    return found


def _check_runs(trial: EffectUnderTest, bench: SceneCache) -> list[Finding]:
    """Findings on runs with an effect whose laws pass."""
    if trial.effect.base:  # a base effect cannot be left out for comparison
        return [heat_balance_checks.check_every_shape(check, bench, trial) for check in RUN_CHECKS]
    switched = [check_off(trial, bench)] if trial.off_values() else []
    found = [heat_balance_checks.check_every_shape(check, bench, trial) for check in RUN_CHECKS]
    return [
        *switched,
        *found,
        heat_balance_checks.catch_failures(
            "acts", trial, lambda: heat_balance_checks.check_default_change(bench, trial)
        ),
    ]


def check_off(trial: EffectUnderTest, bench: SceneCache) -> Finding:
    """Check that a run with all parameters off equals the base; otherwise report the laws that still act."""
    found = heat_balance_checks.check_every_shape(heat_balance_checks.off, bench, trial)
    blamed = [] if found.ok else law_checks.find_laws_not_off(bench, trial)
    return make_finding("off", blamed, "") if blamed else found
