"""The rules of a decision in words: what is true if a rule passes, and what is wrong if it fails."""

from __future__ import annotations

from dataclasses import dataclass

from flashtemp.discovery.decision import NOISE_TEST
from flashtemp.discovery.diagnostics.quantity_format import format_digits
from flashtemp.discovery.verdict import RuleResult, Verdict


@dataclass(frozen=True)
class RuleWords:
    """A rule in words: what is true if it `passes`, what it is `measured_by`, and what is wrong if it `fails` (empty if
    the rule has its own consequence).  `is_upper`: the value may not exceed the limit, else not fall below it."""

    passes: str
    measured_by: str
    fails: str = ""
    is_upper: bool = False


ADEQUACY_WORDS = {  # by the names of `adequacy_tests`
    "amplitude differs between conditions (-log10 of its probability)": RuleWords(
        "The amplitude of a cause is the same in every condition", "-log10 of the probability of such scatter",
        "the amplitude of the cause differs between conditions by more than its errors allow", True),
    "heat of any shape (ln Bayes factor)": RuleWords(
        "No heat of another shape is needed along the contact", "ln Bayes factor of heat of any shape",
        "heat of another shape is needed along the contact", True),
    "pressure of any shape (chi2 of modes)": RuleWords(
        "The pressure distribution needs no other shape",
        "chi2 of six cosine modes of the pressure, in their usual sizes",
        "the pressure distribution would need another shape", True),
    "calibrated parameters (standard deviations)": RuleWords(
        "Calibrated inputs (`free`) agree with prior knowledge", "largest deviation in prior standard deviations",
        "a calibrated input (`free`) is far from prior knowledge", True),
    "camera and friction scatter (standard deviations)": RuleWords(
        "Camera errors, friction scatter and shape parameters of effects have usual sizes",
        "largest deviation in usual sizes",
        "a camera error, the friction scatter or a shape parameter of an effect is far from its usual size", True),
    NOISE_TEST: RuleWords(
        "The residuals are as small as the noise", "largest chi2 of a recording over what its noise allows",
        "the residuals of a recording exceed its noise", True),
}  # fmt: skip
LAW_RULE, HELDOUT_RULE = "the law predicts left-out data", "left-out data do not speak against it"
LAW_RULES = (LAW_RULE, HELDOUT_RULE)  # without them a law is a hint
DECISION_WORDS = {  # by the names of the other rules of `decide`
    "the fit converged": RuleWords("The fit of the final model converged", ""),
    "all effects were judged": RuleWords("The full fits of all effects that may explain more were completed", ""),
    LAW_RULE: RuleWords(
        "The law predicts data that were left out", "fraction of their excess misfit that remains", is_upper=True),
    "the evidence is strong": RuleWords("The evidence for the cause is strong", "ln Bayes factor"),
    "no smooth error of the model explains it as well": RuleWords(
        "A smooth error of the model does not explain it as well",
        "ln Bayes factor with the largest plausible model discrepancy"),
    HELDOUT_RULE: RuleWords(
        "Left-out data do not contradict the cause", "change of their ln probability"),
    "it can be seen": RuleWords("The cause changes the data visibly", "largest change as a fraction of the signal"),
}  # fmt: skip


def describe_rule(name: str) -> RuleWords:
    """The words for a rule by its name; the name itself if there are none.

    >>> describe_rule("it is distinguished from a rival").passes
    'It is distinguished from a rival'
    """
    if name.startswith("it is distinguished from "):
        return RuleWords(name[:1].upper() + name[1:], "ln Bayes factor")
    if name.endswith(" was judged"):
        return RuleWords(f"The full fit of {name.removesuffix(' was judged')} ended", "ln Bayes factor")
    return ADEQUACY_WORDS.get(name) or DECISION_WORDS.get(name) or RuleWords(name[:1].upper() + name[1:], "")


def describe_success(rule: RuleResult) -> str:
    """What is true if a rule passed.

    >>> describe_success(RuleResult("the evidence is strong", 58.0, 8.0, True, ""))
    'The evidence for the cause is strong (ln Bayes factor: 58, at least 8)'
    """
    words = describe_rule(rule.name)
    limit = "at most" if words.is_upper else "at least"
    return f"{words.passes}{_measured_words(rule, words, limit)}"


def describe_failure(rule: RuleResult) -> str:
    """What follows from a rule that did not pass."""
    words = ADEQUACY_WORDS.get(rule.name)
    if words is None:
        return rule.consequence
    # stored verdicts of earlier versions do not say which recording fails the test of noise
    is_detailed = rule.name == NOISE_TEST and not rule.consequence.startswith(NOISE_TEST)
    fails = rule.consequence if is_detailed else words.fails
    return f"{fails}{_measured_words(rule, words, 'limit')}"


def _measured_words(rule: RuleResult, words: RuleWords, limit: str) -> str:
    """Value and limit of a rule in brackets; empty if it has no measure."""
    numbers = f"{format_digits(rule.value + 0.0, 3)}, {limit} {format_digits(rule.limit, 3)}"  # + 0.0: no "-0"
    return f" ({words.measured_by}: {numbers})" if words.measured_by else ""


def explain_uncertainty(v: Verdict) -> str:
    """Why a verdict is not more certain, from the rules that did not pass; empty if all passed."""
    failures = [describe_failure(r) for r in v.rules if not r.passed]
    if not failures:
        return ""
    # in these verdicts the rules concern a candidate that was not accepted
    is_without_candidate = v.kind in ("none_needed", "held_key", "named")
    lead = "The best candidate is not reported because" if is_without_candidate else "Not more certain because"
    lead = "Rules that did not pass" if v.kind == "unexplained" else lead
    return f"{lead}: {'; '.join(failures)}."
