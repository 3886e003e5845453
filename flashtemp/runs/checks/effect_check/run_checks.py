"""All that is looked at in an effect, in the order in which a person would mend it."""

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
    """Findings on an effect: its file, then its laws one by one, then runs with it where the laws are sound.

    Raises BadInput for values that it cannot have.
    """
    found = [look(trial) for look in FILE_CHECKS]
    if not trial.has_heat and trial.effect.see is Effect.see:
        says = f"{trial.file}: yields nothing; write heat(self, scene, p) or, for a camera, see(self, p)"
        return [*found, Finding("loads", False, says)]
    try:
        bench.build_scene(trial)
    except BadInput as fault:
        return [*found, Finding("loads", False, "; ".join(fault.lines))]
    found.append(Finding("loads", True, "a small case with it loads: all that it names exists"))
    if not trial.has_heat:
        return found + camera_checks.check_camera_effect(bench, trial)
    asked = law_checks.check_laws(bench, trial)
    found += asked
    if all(f.ok for f in asked):
        found += _check_runs(trial, bench)
    return found


def _check_runs(trial: EffectUnderTest, bench: SceneCache) -> list[Finding]:
    """Findings on runs with an effect whose laws are sound."""
    if trial.effect.base:  # the base is not without it
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
    """Whether the run is the base with all parameters off, and if not, which law is to blame."""
    found = heat_balance_checks.check_every_shape(heat_balance_checks.off, bench, trial)
    blamed = [] if found.ok else law_checks.find_laws_not_off(bench, trial)
    return make_finding("off", blamed, "") if blamed else found
