"""The verdict: one function, `decide`, that turns evidence into a kind of verdict and the rules that led to it.

Nothing else in the package decides what a verdict is called.  Rules are asked in the order in which they stand; each
notes what it compared, so that a report can say why a verdict is what it is, and why it is not more certain.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from flashtemp.discovery.criteria import CRITERIA, Criteria


@dataclass(frozen=True)
class AlternativeCause:
    """Another explanation of the same size: its `effects`, the ln Bayes factor by which the accepted one exceeds it,
    and whether its fit came to its best point."""

    effects: frozenset[str]
    deficit: float
    is_converged: bool = True


@dataclass(frozen=True)
class EffectSize:
    """What an extension changes once both models are calibrated: largest fraction of the rise of a recording, of the
    friction of a trace, and how many kelvin (rms) that is against the error that the mesh may leave there.

    `camera_fraction` of the rise that errors of a camera alone change by themselves, calibration apart: a camera that
    reads wrongly is a fact of the test, whatever else the fit could take in its place.  0 for what changes heat, which
    needs no place in a model where calibration does as well.
    """

    rise_fraction: float
    friction_fraction: float = 0.0
    change_K: float = 0.0
    mesh_error_K: float = 0.0
    camera_fraction: float = 0.0


@dataclass(frozen=True)
class AdequacyTest:
    """One test of the final model: `value` beyond `limit` means that something is missing that has no name."""

    name: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        return self.value <= self.limit


@dataclass(frozen=True)
class VerdictEvidence:
    """All that a verdict rests on.

    `causes` that were accepted or, where `is_hint`, the best one that was not, with `ln_bayes` of all of them against
    the calibrated base and `ln_bayes_discrepancy`, the same where the model's own error is as large as it may be;
    `heldout_gain` in ln probability of left-out data (None where there are none).  `alternatives` of the same number of
    effects; `unresolved` {effects: ln Bayes factor} that scores speak for and no full fit judged, or whose fits did not
    end and yet explain more.  `setup_errors`, `recording_errors` and the `contradicted_input` by
    name, with `setup_alternatives` that explain as much as the first of them.  Of a learned
    law the fraction of the excess misfit of left-out data that it leaves.
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
    """One comparison on the way to a verdict: what was asked, `value` against `limit`, whether it `passed`, and what
    follows where it did not."""

    name: str
    value: float
    limit: float
    passed: bool
    consequence: str


@dataclass(frozen=True)
class Decision:
    """A `kind` of verdict with all `rules` that were asked; `group` of effects that cannot be told apart."""

    kind: str
    rules: tuple[VerdictRule, ...]
    group: tuple[str, ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the verdict is not more certain: consequences of the rules that did not pass."""
        return tuple(r.consequence for r in self.rules if not r.passed)


def decide(evidence: VerdictEvidence, criteria: Criteria = CRITERIA) -> Decision:
    """The verdict on some evidence.

    | asked in this order                                              | if not                          |
    |------------------------------------------------------------------|---------------------------------|
    | did the fit of the final model converge?                         | no_verdict, or unexplained      |
    | is the final model adequate?                                     | unexplained                     |
    | was everything judged that speaks for itself?                    | no_verdict                      |
    | is a cause accepted?                                             | none_needed, or what else is off |
    | is it worth its parameters, visible, and not refuted?            | weak, or none_needed            |
    | is it told apart from every alternative?                         | group                           |
    """
    rules: list[VerdictRule] = []
    law = _decide_law(evidence, criteria, rules)
    if law:
        return Decision(law, tuple(rules))
    if not evidence.is_converged:
        kind = "unexplained" if evidence.base_certainly_misfits else "no_verdict"
        rules.append(VerdictRule("the fit converged", 0.0, 1.0, False, "the fit of the final model did not converge"))
        return Decision(kind, tuple(rules))
    for test in evidence.adequacy:
        rules.append(
            VerdictRule(
                test.name, test.value, test.limit, test.passed, f"{test.name}: {test.value:.3g}, limit {test.limit:g}"
            )
        )
    if not all(test.passed for test in evidence.adequacy):
        return Decision("unexplained", tuple(rules))
    for names, gain in evidence.unresolved.items():
        rules.append(
            VerdictRule(f"{names} was judged", gain, criteria.ln_bayes_named, False,
                 f"{names} (ln Bayes factor {gain:.0f}) could not be fitted to an end")
        )  # fmt: skip
    if evidence.unresolved:
        return Decision("no_verdict", tuple(rules))
    found_otherwise = _kind_without_cause(evidence)
    if not evidence.causes:
        return _decide_setup(evidence, found_otherwise, rules)
    rules += _cause_rules(evidence, criteria)
    if evidence.is_hint or not all(r.passed for r in rules):
        small = evidence.size is not None and _largest_fraction(evidence.size) < criteria.hint_fraction
        faint = evidence.ln_bayes_discrepancy < criteria.ln_bayes_hint * len(evidence.causes)
        hidden = small or faint or found_otherwise != "none_needed"
        return Decision(found_otherwise if hidden else "weak", tuple(rules))
    group = _indistinguishable_effects(evidence, criteria, rules)
    return Decision("group" if group else "named", tuple(rules), group)


def _decide_law(evidence: VerdictEvidence, criteria: Criteria, rules: list[VerdictRule]) -> str:
    """`learned` where a law was identified that predicts; empty where there is none, or it does not."""
    if not evidence.learned_law or evidence.law_excess_left is None:
        return ""
    predicts = evidence.law_excess_left <= criteria.law_excess_left
    rules.append(
        VerdictRule("the law predicts left-out data", evidence.law_excess_left, criteria.law_excess_left, predicts,
             f"the law leaves {100 * evidence.law_excess_left:.0f} % of the excess misfit of left-out data")
    )  # fmt: skip
    sound = evidence.is_converged and all(t.passed for t in evidence.adequacy)
    return "learned" if predicts and sound else "unexplained"


def _decide_setup(evidence: VerdictEvidence, kind: str, rules: list[VerdictRule]) -> Decision:
    """The verdict where no effect is missing: errors of set-up or inputs that share an effect are told together."""
    first = (*evidence.setup_errors, *filter(None, (evidence.contradicted_input,)))[:1]
    others = tuple(name for name in evidence.setup_alternatives if name not in first)
    if kind in ("named", "held_key") and first and others and not evidence.recording_errors:
        return Decision("group", tuple(rules), (*first, *others))
    return Decision(kind, tuple(rules))


def _kind_without_cause(evidence: VerdictEvidence) -> str:
    """What a verdict is where no effect is missing: errors of set-up and recordings are causes of their own."""
    if evidence.setup_errors or evidence.recording_errors:
        return "named"
    return "held_key" if evidence.contradicted_input else "none_needed"


def _cause_rules(evidence: VerdictEvidence, criteria: Criteria) -> Iterator[VerdictRule]:
    """What a cause must pass to be named."""
    needed = criteria.ln_bayes_named * len(evidence.causes)
    names = " and ".join(evidence.causes)
    yield VerdictRule(
        "the evidence is strong", evidence.ln_bayes, needed, evidence.ln_bayes > needed,
        f"the ln Bayes factor of {names} is {evidence.ln_bayes:.1f}; {needed:g} names it",
    )  # fmt: skip
    yield VerdictRule(
        "no smooth error of the model explains it as well", evidence.ln_bayes_discrepancy, needed,
        evidence.ln_bayes_discrepancy > needed,
        f"a smooth error of the model would leave {names} a ln Bayes factor of {evidence.ln_bayes_discrepancy:.1f}",
    )  # fmt: skip
    if evidence.heldout_gain is not None:
        yield VerdictRule(
            "left-out data do not speak against it", evidence.heldout_gain, criteria.heldout_against,
            evidence.heldout_gain > criteria.heldout_against,
            f"left-out data are less probable with it (ln {evidence.heldout_gain:.1f})",
        )  # fmt: skip
    if evidence.size is not None:
        seen = _largest_fraction(evidence.size)
        yield VerdictRule(
            "it can be seen", seen, criteria.visible_fraction, seen >= criteria.visible_fraction,
            f"calibrated again it changes no recording by more than {100 * seen:.2g} % of the rise",
        )  # fmt: skip
        apart = max(evidence.size.friction_fraction, evidence.size.camera_fraction)  # of what no mesh has a say in
        fine = evidence.size.change_K >= evidence.size.mesh_error_K or apart >= criteria.visible_fraction
        yield VerdictRule(
            "the mesh resolves it", evidence.size.change_K, evidence.size.mesh_error_K, fine,
            f"it changes {1e3 * evidence.size.change_K:.2g} mK rms, the mesh may err by {1e3 * evidence.size.mesh_error_K:.2g} mK: "
            "take a finer one (numerics.mesh)",
        )  # fmt: skip


def _largest_fraction(size: EffectSize) -> float:
    return max(size.rise_fraction, size.friction_fraction, size.camera_fraction)


def _indistinguishable_effects(
    evidence: VerdictEvidence, criteria: Criteria, rules: list[VerdictRule]
) -> tuple[str, ...]:
    """Effects that explain the data as well as an accepted one; empty where there are none."""
    accepted, out = frozenset(evidence.causes), list[str]()
    for a in evidence.alternatives:
        apart = a.deficit > criteria.ln_bayes_distinct
        other = " with ".join(sorted(a.effects))
        rules.append(
            VerdictRule(f"it is told from {other}", a.deficit, criteria.ln_bayes_distinct, apart,
                 f"{other} explains the data as well (ln Bayes factor {a.deficit:.1f} apart)")
        )  # fmt: skip
        if not apart:
            out += [*sorted(accepted - a.effects), *sorted(a.effects - accepted)]
    return tuple(dict.fromkeys(out))
