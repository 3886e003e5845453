"""The decision criteria of discovery: every threshold in one table, with unit, meaning and reason.

`docs/reference/discovery_criteria.md` is generated from this table.  It does not contain parameters of the numerical
methods (trust region, alignment of images), which are defined in the modules of those methods.  Prior uncertainties of
inputs and cameras are in `hypotheses/input_kinds.py`, `camera/camera_classes.py` and `estimation/nuisance_priors.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any


def _criterion_field(value: float, unit: str, meaning: str, reason: str) -> Any:
    """A field of `Criteria`; value and `meaning` read as one phrase, such as "8 ln Bayes factor above which ..."."""
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "reason": reason})


@dataclass(frozen=True)
class Criteria:
    """The thresholds of discovery; `list_criteria` returns them as a table."""

    # --- evidence --------------------------------------------------------------------------------------------------
    ln_bayes_named: float = _criterion_field(
        8.0, "ln Bayes factor", "above which a cause is named, for each of its effects",
        "odds of 20 to 1 (ln 20 = 3.0) for one of 45 candidates (ln 45 = 3.8) that are equally likely a priori, and 1 "
        "for the maximum over hyperparameters; Kass and Raftery (1995) call 5 very strong",
    )  # fmt: skip
    ln_bayes_hint: float = _criterion_field(
        5.0, "ln Bayes factor", "above which a cause is reported as a hint",
        "even odds for one of 45 candidates (ln 45 = 3.8), and 1 for the maximum over hyperparameters",
    )  # fmt: skip
    ln_bayes_distinct: float = _criterion_field(
        5.0, "ln Bayes factor", "by which a cause must exceed an alternative to be distinguished from it",
        "odds of 150 to 1: `very strong` of Kass and Raftery (J. Am. Stat. Assoc. 90, 1995, 773)",
    )  # fmt: skip
    ln_odds_handling_error: float = _criterion_field(
        4.6, "ln odds", "a priori against a recording that was exchanged, mirrored or mislabelled",
        "one recording of a hundred is handled wrongly",
    )  # fmt: skip
    max_causes: float = _criterion_field(
        2.0, "effects", "that may be accepted together",
        "if a third one seems necessary, the catalogue more likely lacks an effect; the verdict is then unexplained",
    )  # fmt: skip
    # --- which candidates are fitted in full -----------------------------------------------------------------------
    shortlist: float = _criterion_field(
        3.0,
        "candidates",
        "that are fitted in full in one step of the selection",
        "cost: a full fit takes two to four simulations",
    )
    # --- size of an effect -----------------------------------------------------------------------------------------
    visible_fraction: float = _criterion_field(
        1e-3, "of the rise", "by which a cause must change a recording (or of the friction, by which it must change a "
        "load-cell record); for a stated input with nothing else changed",
        "error of the discretised model (docs/explanation/verification.md): smaller changes have no physical meaning",
    )  # fmt: skip
    hint_fraction: float = _criterion_field(
        3e-3, "of the rise", "by which a hint must change a recording",
        "largest error of closures and mesh (docs/explanation/verification.md)",
    )  # fmt: skip
    # --- data that were left out -----------------------------------------------------------------------------------
    heldout_against: float = _criterion_field(
        -4.5, "ln probability", "of left-out data, extended minus base, below which they contradict a cause",
        "if the cause is true and changes them by D standard deviations, the difference is normal with mean D^2/2 and "
        "standard deviation D, so it is above D^2/2 - 3 D, at least -4.5, in 739 of 740 cases",
    )  # fmt: skip
    law_excess_left: float = _criterion_field(
        0.5, "1", "fraction of the excess misfit of left-out data that may remain with a learned law",
        "a law that predicts removes more of the misfit than remains",
    )  # fmt: skip
    ln_bayes_law_node: float = _criterion_field(
        3.0, "ln Bayes factor", "that additional nodes of a learned law must gain; where they gain or lose less, they "
        "are kept if the model is adequate with them and not without",
        "odds of 20 to 1: `strong` of Kass and Raftery",
    )  # fmt: skip
    # --- adequacy of the final model -------------------------------------------------------------------------------
    noise_sd_uncertainty: float = _criterion_field(
        0.05, "1", "relative standard uncertainty of the noise that a recording states or that is estimated from it",
        "a sample of 200 gives 5 %; makers state noise to 10 %",
    )  # fmt: skip
    adequacy_standard_errors: float = _criterion_field(
        4.0, "standard errors", "of chi2 above which a recording is not explained",
        "1 in 30,000 for one of 40 recordings",
    )  # fmt: skip
    ln_bayes_unnamed_heat: float = _criterion_field(
        3.0, "ln Bayes factor", "of heat of any shape along the contact, above which the model is not adequate",
        "odds of 20 to 1: `strong` of Kass and Raftery",
    )  # fmt: skip
    pressure_modes_chi2: float = _criterion_field(
        25.0, "chi2", "of the six free pressure modes, at their usual size, above which the model is not adequate",
        "exceeded by chance once in 3,000 (six degrees of freedom)",
    )  # fmt: skip
    pull_adequate: float = _criterion_field(
        4.0, "standard deviations", "of a calibrated key from its prior, above which it contradicts prior knowledge",
        "1 in 16,000 for one of some 20 keys",
    )  # fmt: skip
    pull_nuisance: float = _criterion_field(
        8.0, "standard deviations", "of a camera error, the friction of a repetition or a shape parameter of an effect "
        "from its prior, above which it is unusual",
        "usual sizes are known to a factor of two",
    )  # fmt: skip
    condition_scatter: float = _criterion_field(
        1e-4, "probability", "of the scatter of an amplitude between conditions, below which its law is wrong",
        "1 in 10,000 for a handful of parameters",
    )  # fmt: skip
    # --- inputs and recordings -------------------------------------------------------------------------------------
    pull_setup: float = _criterion_field(
        1.75, "standard deviations", "of a set-up error (scale, turn, clock, length), less two standard errors, "
        "above which it is named",
        "1 in 12 set-ups has a larger error",
    )  # fmt: skip
    setup_standard_errors: float = _criterion_field(
        4.0, "standard errors", "of a set-up error from zero, below which it may be chance", "1 in 16,000"
    )
    pull_input: float = _criterion_field(
        3.0, "standard deviations", "of prior and data together, above which the data contradict a stated input",
        "1 in 370 for one of some 20 inputs; Demortier and Lyons (2002)",
    )  # fmt: skip

    sd_ratio_uncheckable: float = _criterion_field(
        0.8, "1", "posterior over prior standard deviation of a stated input, above which the data cannot check it",
        "the data then contain at most 0.56 of the information of the prior",
    )  # fmt: skip
    certain_misfit_chi2: float = _criterion_field(
        2.0, "chi2 per datum", "of the calibrated base, above which the verdict on a fit that did not converge is "
        "unexplained",
        "noise that is stated to 5 % cannot have twice its stated variance",
    )  # fmt: skip


CRITERIA = Criteria()


def list_criteria() -> tuple[tuple[str, float, str, str, str], ...]:
    """Name, value, unit, meaning and reason of every criterion, in order."""
    rows = []
    for f in fields(Criteria):
        m = f.metadata
        rows.append((f.name, float(getattr(CRITERIA, f.name)), m["unit"], m["meaning"], m["reason"]))
    return tuple(rows)
