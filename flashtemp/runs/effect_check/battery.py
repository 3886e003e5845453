"""All that is looked at in an effect, in the order in which a person would mend it."""

from __future__ import annotations

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Effect
from flashtemp.runs.effect_check import balance, camera, laws, source
from flashtemp.runs.effect_check.findings import Finding, judged
from flashtemp.runs.effect_check.scenes import Bench, Trial

FILE = (source.file, source.imports, source.example, source.words, source.parameters)
RUNS = (balance.jacobian, balance.linearisation, balance.conservation, balance.energy)


def examine(trial: Trial, bench: Bench) -> list[Finding]:
    """Findings on an effect: its file, then its laws one by one, then runs with it where the laws are sound.

    Raises BadInput for values that it cannot have.
    """
    found = [look(trial) for look in FILE]
    if not trial.heats and trial.effect.see is Effect.see:
        says = f"{trial.file}: yields nothing; write heat(self, scene, p) or, for a camera, see(self, p)"
        return [*found, Finding("loads", False, says)]
    try:
        bench.scene(trial)
    except BadInput as fault:
        return [*found, Finding("loads", False, "; ".join(fault.lines))]
    found.append(Finding("loads", True, "a small case with it loads: all that it names exists"))
    if not trial.heats:
        return found + camera.seen(bench, trial)
    asked = laws.asked(bench, trial)
    found += asked
    if all(f.ok for f in asked):
        found += _runs(trial, bench)
    return found


def _runs(trial: Trial, bench: Bench) -> list[Finding]:
    """Findings on runs with an effect whose laws are sound."""
    if trial.effect.base:  # the base is not without it
        return [balance.in_every_shape(check, bench, trial) for check in RUNS]
    switched = [off(trial, bench)] if trial.off() else []
    found = [balance.in_every_shape(check, bench, trial) for check in RUNS]
    return [*switched, *found, balance.sound("acts", trial, lambda: balance.acts(bench, trial))]


def off(trial: Trial, bench: Bench) -> Finding:
    """Whether the run is the base with all parameters off, and if not, which law is to blame."""
    found = balance.in_every_shape(balance.off, bench, trial)
    blamed = [] if found.ok else laws.not_off(bench, trial)
    return judged("off", blamed, "") if blamed else found
