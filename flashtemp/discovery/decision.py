"""The verdict: one function, `decide`, that turns evidence into a kind of verdict and the rules that led to it.

No other function chooses the kind of a verdict.  The rules are evaluated in order, and each one records the value and
the limit that it compared.  A report can therefore say why the verdict is what it is, and why it is not more certain.
The limits are the fields of `criteria.Criteria`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from flashtemp.discovery.criteria import CRITERIA, Criteria

NOISE_TEST = "noise left over (chi2 over what noise may give)"  # the adequacy test that a wrong noise can fail


@dataclass(frozen=True)
class AlternativeCause:
    """A fitted model with as many effects as the accepted one, of which one differs or is replaced by a stated input.

    `effects`: all effects of that model, and the key of the input.  `deficit`: ln Bayes factor of the accepted model
    against it.  `is_converged`: whether its fit reached its best point; no rule depends on it.
    """

    effects: frozenset[str]
    deficit: float
    is_converged: bool = True


@dataclass(frozen=True)
class EffectSize:
    """How much an extension changes the predicted data once base and extended model are both calibrated.

    `rise_fraction`: largest rms change of a recording, as a fraction of its rms temperature rise; `change_K` is the
    same change in kelvin.
    `friction_fraction`: largest rms change of a load-cell record, as a fraction of its friction.
    `camera_fraction`: fraction of the rise that a camera error changes by itself, with nothing calibrated again.  A
    camera that reads wrongly is a fact of the test, even if other unknowns could absorb its error in the fit.  The
    value is 0 for effects on heat, because a model needs no effect that calibration can replace.
    """

    rise_fraction: float
    friction_fraction: float = 0.0
    change_K: float = 0.0
    camera_fraction: float = 0.0


@dataclass(frozen=True)
class AdequacyTest:
    """One test of the final model: with a `value` above `limit`, it lacks something outside the catalogue.

    `detail`: what fails it, in words, such as the recording; empty if the name says it."""

    name: str
    value: float
    limit: float
    detail: str = ""

    @property
    def passed(self) -> bool:
        return self.value <= self.limit


@dataclass(frozen=True)
class VerdictEvidence:
    """All numbers and names from which `decide` derives the verdict.

    `is_converged`: the fit of the final model converged.  `base_certainly_misfits`: chi2 per datum of the calibrated
    base exceeds `certain_misfit_chi2`.
    `causes`: accepted effects or, with `is_hint`, the best effect that was not accepted.
    `ln_bayes`: ln Bayes factor of all causes together against the calibrated base; `ln_bayes_discrepancy` is the same
    with the model discrepancy as large as it may be.
    `heldout_gain`: change of the ln probability of left-out data; None if no data were left out.
    `alternatives`: models with as many causes, effects or stated inputs.
    `unresolved` {effects: ln Bayes factor}: effects that could not be simulated, or whose fits did not converge and
    still explain more than the final model.
    `setup_errors`, `recording_errors`, `contradicted_input`: names of errors of the measurement;
    `setup_alternatives`: names of others that explain as much as the first set-up error.
    `learned_law`: description of a law outside the catalogue; `law_excess_left`: fraction of the excess misfit of
    left-out data that remains with it.
    """

    is_converged: bool
    base_certainly_misfits: bool
    causes: tuple[str, ...] = ()
    is_hint: bool = False
    ln_bayes: float = 0.0
    ln_bayes_discrepancy: float = 0.0
    heldout_gain: float | None = None
    size: EffectSize | None = None
    alternatives: tuple[AlternativeCause, ...] = ()
    unresolved: Mapping[str, float] = field(default_factory=dict)
    adequacy: tuple[AdequacyTest, ...] = ()
    setup_errors: tuple[str, ...] = ()
    recording_errors: tuple[str, ...] = ()
    contradicted_input: str = ""
    setup_alternatives: tuple[str, ...] = ()
    learned_law: str = ""
    law_excess_left: float | None = None


@dataclass(frozen=True)
class VerdictRule:
    """One comparison that led to a verdict: its `name`, `value` against `limit`, whether it `passed`, and in words the
    `consequence` of failing it."""

    name: str
    value: float
    limit: float
    passed: bool
    consequence: str


@dataclass(frozen=True)
class Decision:
    """The `kind` of a verdict (one of `verdict.VERDICT_KINDS`), all `rules` that were evaluated, and the `group` of
    causes that the data cannot distinguish."""

    kind: str
    rules: tuple[VerdictRule, ...]
    group: tuple[str, ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the verdict is not more certain: consequences of the rules that did not pass."""
        return tuple(r.consequence for r in self.rules if not r.passed)


def decide(evidence: VerdictEvidence, criteria: Criteria = CRITERIA) -> Decision:
    """The verdict that the evidence supports.

    | question, in this order                                           | verdict if the answer is no          |
    |-------------------------------------------------------------------|--------------------------------------|
    | If a law was learned: does it predict left-out data?              | unexplained (learned if yes)         |
    | Did the fit of the final model converge?                          | no_verdict, or unexplained           |
    | Does the final model pass all adequacy tests?                     | unexplained                          |
    | Were all effects fitted that may explain more?                    | no_verdict                           |
    | Is there a cause?                                                 | none_needed, named, held_key, group  |
    | Is it strong, visible, resolved and not refuted (`_cause_rules`)? | weak, or as without a cause          |
    | Is it distinguished from every alternative?                       | group                                |
    | All answers are yes                                               | named                                |
    """
    rules: list[VerdictRule] = []
    law = _decide_law(evidence, criteria, rules)
    if law:
        return Decision(law, tuple(rules))
    if not evidence.is_converged:
        kind = "unexplained" if evidence.base_certainly_misfits else "no_verdict"
        rules.append(VerdictRule("the fit converged", 0.0, 1.0, False, "the fit of the final model did not converge"))
        return Decision(kind, tuple(rules))
    rules.append(VerdictRule("the fit converged", 1.0, 1.0, True, ""))
    for test in evidence.adequacy:
        consequence = test.detail or f"{test.name}: {test.value:.3g}, limit {test.limit:g}"
        rules.append(VerdictRule(test.name, test.value, test.limit, test.passed, consequence))
    if not all(test.passed for test in evidence.adequacy):
        return Decision("unexplained", tuple(rules))
    for names, gain in evidence.unresolved.items():
        rules.append(
            VerdictRule(f"{names} was judged", gain, criteria.ln_bayes_named, False,
                 f"the fit of {names} (ln Bayes factor {gain:.0f}) could not be completed")
        )  # fmt: skip
    if evidence.unresolved:
        return Decision("no_verdict", tuple(rules))
    rules.append(VerdictRule("all effects were judged", 1.0, 1.0, True, ""))
    without_cause = _kind_without_cause(evidence)
    if not evidence.causes:
        return _decide_setup(evidence, without_cause, rules)
    rules += _cause_rules(evidence, criteria)
    if evidence.is_hint or not all(r.passed for r in rules):
        # a hint is reported only if it is worth following up and no error of the measurement explains the misfit
        is_small = evidence.size is not None and _largest_fraction(evidence.size) < criteria.hint_fraction
        is_improbable = evidence.ln_bayes_discrepancy < criteria.ln_bayes_hint * len(evidence.causes)
        is_dropped = is_small or is_improbable or without_cause != "none_needed"
        return Decision(without_cause if is_dropped else "weak", tuple(rules))
    group = _indistinguishable_effects(evidence, criteria, rules)
    return Decision("group" if group else "named", tuple(rules), group)


def _decide_law(evidence: VerdictEvidence, criteria: Criteria, rules: list[VerdictRule]) -> str:
    """The verdict on a law outside the catalogue: `learned` if it predicts left-out data and the model with it is
    adequate, else `unexplained`; empty if no law was identified."""
    if not evidence.learned_law or evidence.law_excess_left is None:
        return ""
    rules.append(
        VerdictRule("the law predicts left-out data", evidence.law_excess_left, criteria.law_excess_left,
             evidence.law_excess_left <= criteria.law_excess_left,
             f"{100 * evidence.law_excess_left:.0f} % of the excess misfit of left-out data remains with the law")
    )  # fmt: skip
    rules += _heldout_rules(evidence, criteria)
    predicts = all(r.passed for r in rules)
    sound = evidence.is_converged and all(t.passed for t in evidence.adequacy)
    return "learned" if predicts and sound else "unexplained"


def _decide_setup(evidence: VerdictEvidence, kind: str, rules: list[VerdictRule]) -> Decision:
    """The verdict if no effect is missing: a group where the data cannot distinguish one error of the set-up or of a
    stated input from others, else `kind`."""
    first = (*evidence.setup_errors, *filter(None, (evidence.contradicted_input,)))[:1]
    others = tuple(name for name in evidence.setup_alternatives if name not in first)
    if kind in ("named", "held_key") and first and others and not evidence.recording_errors:
        return Decision("group", tuple(rules), (*first, *others))
    return Decision(kind, tuple(rules))


def _kind_without_cause(evidence: VerdictEvidence) -> str:
    """The kind of verdict if no effect is missing: errors of the set-up and of recordings are named as causes."""
    if evidence.setup_errors or evidence.recording_errors:
        return "named"
    return "held_key" if evidence.contradicted_input else "none_needed"


def _cause_rules(evidence: VerdictEvidence, criteria: Criteria) -> Iterator[VerdictRule]:
    """The rules that a cause must pass to be named."""
    needed = criteria.ln_bayes_named * len(evidence.causes)
    names = " and ".join(evidence.causes)
    yield VerdictRule(
        "the evidence is strong", evidence.ln_bayes, needed, evidence.ln_bayes > needed,
        f"the ln Bayes factor of {names} is {evidence.ln_bayes:.1f}; a cause needs {needed:g}",
    )  # fmt: skip
    yield VerdictRule(
        "no smooth error of the model explains it as well", evidence.ln_bayes_discrepancy, needed,
        evidence.ln_bayes_discrepancy > needed,
        f"with a smooth model discrepancy the ln Bayes factor of {names} is {evidence.ln_bayes_discrepancy:.1f}",
    )  # fmt: skip
    yield from _heldout_rules(evidence, criteria)
    if evidence.size is not None:
        largest = _largest_fraction(evidence.size)
        yield VerdictRule(
            "it can be seen", largest, criteria.visible_fraction, largest >= criteria.visible_fraction,
            f"after calibration it changes no recording by more than {100 * largest:.2g} % of its temperature rise",
        )  # fmt: skip


def _heldout_rules(evidence: VerdictEvidence, criteria: Criteria) -> Iterator[VerdictRule]:
    """The rule that left-out data do not contradict a cause or a law, if data were left out."""
    if evidence.heldout_gain is not None:
        yield VerdictRule(
            "left-out data do not speak against it", evidence.heldout_gain, criteria.heldout_against,
            evidence.heldout_gain > criteria.heldout_against,
            f"left-out data are less probable with it (change of ln probability {evidence.heldout_gain:.1f})",
        )  # fmt: skip


def _largest_fraction(size: EffectSize) -> float:
    return max(size.rise_fraction, size.friction_fraction, size.camera_fraction)


def _indistinguishable_effects(
    evidence: VerdictEvidence, criteria: Criteria, rules: list[VerdictRule]
) -> tuple[str, ...]:
    """The accepted effects and the others that explain the data as well; empty if every alternative is rejected.

    Adds one rule for each alternative to `rules`.
    """
    accepted, out = frozenset(evidence.causes), list[str]()
    for a in evidence.alternatives:
        is_distinct = a.deficit > criteria.ln_bayes_distinct
        other = " with ".join(sorted(a.effects))
        rules.append(
            VerdictRule(f"it is distinguished from {other}", a.deficit, criteria.ln_bayes_distinct, is_distinct,
                 f"{other} explains the data as well (ln Bayes factor {a.deficit:.1f} less)")
        )  # fmt: skip
        if not is_distinct:
            out += [*sorted(accepted - a.effects), *sorted(a.effects - accepted)]
    return tuple(dict.fromkeys(out))
