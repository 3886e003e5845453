"""All that is looked at in an effect, in the order in which a person would mend it."""

from __future__ import annotations

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Effect
from flashtemp.runs.effect_check import balance, camera, laws, source
from flashtemp.runs.effect_check.findings import Finding, make_finding
from flashtemp.runs.effect_check.scenes import SceneCache, EffectUnderTest

FILE_CHECKS = (source.check_file, source.check_imports, source.check_example, source.check_words, source.check_parameters)
RUN_CHECKS = (balance.jacobian, balance.linearisation, balance.conservation, balance.energy)


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
        return found + camera.check_camera_effect(bench, trial)
    asked = laws.check_laws(bench, trial)
    found += asked
    if all(f.ok for f in asked):
        found += _check_runs(trial, bench)
    return found


def _check_runs(trial: EffectUnderTest, bench: SceneCache) -> list[Finding]:
    """Findings on runs with an effect whose laws are sound."""
    if trial.effect.base:  # the base is not without it
        return [balance.check_every_shape(check, bench, trial) for check in RUN_CHECKS]
    switched = [check_off(trial, bench)] if trial.off_values() else []
    found = [balance.check_every_shape(check, bench, trial) for check in RUN_CHECKS]
    return [*switched, *found, balance.catch_failures("acts", trial, lambda: balance.check_default_change(bench, trial))]


def check_off(trial: EffectUnderTest, bench: SceneCache) -> Finding:
    """Whether the run is the base with all parameters off, and if not, which law is to blame."""
    found = balance.check_every_shape(balance.off, bench, trial)
    blamed = [] if found.ok else laws.find_laws_not_off(bench, trial)
    return make_finding("off", blamed, "") if blamed else found
