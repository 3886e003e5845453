"""Every number by which a discovery decides, in one place, each with unit, meaning and reason.

`docs/reference/discovery_criteria.md` is generated from this table.  Numbers of the numerical methods (trust region,
alignment of images) and prior uncertainties of inputs and cameras are no criteria: they stand with their methods and in
`hypotheses/input_kinds.py`, `camera/camera_classes.py` and `estimation/nuisance_priors.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any


def _criterion_field(value: float, unit: str, meaning: str, reason: str) -> Any:
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "reason": reason})


@dataclass(frozen=True)
class Criteria:
    """Numbers that decide."""

    # --- evidence --------------------------------------------------------------------------------------------------
    ln_bayes_named: float = _criterion_field(
        8.0, "ln Bayes factor", "from which a cause is named, for each of its effects",
        "odds of 20 to 1 (ln 3) for one of 45 candidates (ln 45 = 3.8) that are alike before the data, and 1 for the "
        "maximum over hyperparameters; Kass and Raftery (1995) call 5 very strong",
    )  # fmt: skip
    ln_bayes_hint: float = _criterion_field(
        5.0, "ln Bayes factor", "from which a cause is reported as a hint",
        "even odds for one of 45 candidates (ln 45 = 3.8), and 1 for the maximum over hyperparameters",
    )  # fmt: skip
    ln_bayes_distinct: float = _criterion_field(
        5.0, "ln Bayes factor", "by which a cause must exceed an alternative to be told from it",
        "odds of 150 to 1: `very strong` of Kass and Raftery (J. Am. Stat. Assoc. 90, 1995, 773)",
    )  # fmt: skip
    ln_odds_handling_error: float = _criterion_field(
        4.6, "ln odds", "before the data, against a recording that was exchanged, mirrored or mislabelled",
        "one recording of a hundred is handled wrongly",
    )  # fmt: skip
    max_causes: float = _criterion_field(
        2.0, "effects", "that are accepted together",
        "a third one is rather what the catalogue lacks; it is then reported as unexplained",
    )  # fmt: skip
    # --- which candidates are fitted in full -----------------------------------------------------------------------
    shortlist: float = _criterion_field(
        3.0, "candidates", "that are fitted in full at a time", "cost: a full fit takes two to four simulations"
    )
    shortlist_range: float = _criterion_field(
        20.0, "ln Bayes factor", "behind the best score, within which a candidate is fitted in full",
        "scores of linearised models err by as much where an effect is strong",
    )  # fmt: skip
    shortlist_fraction: float = _criterion_field(
        0.4, "1", "of the best score, above which a candidate is fitted in full", "as above, for scores of hundreds"
    )
    # --- size of an effect -----------------------------------------------------------------------------------------
    visible_fraction: float = _criterion_field(
        1e-3, "of the rise", "that a cause must change in some recording, or of the friction in a trace; "
        "a stated input too, with nothing else moved",
        "error of the discretised model (docs/explanation/verification.md): less is no physics",
    )  # fmt: skip
    hint_fraction: float = _criterion_field(
        3e-3, "of the rise", "that a hint must change in some recording",
        "largest error of closures and mesh (docs/explanation/verification.md)",
    )  # fmt: skip
    mesh_error_left: float = _criterion_field(
        0.1, "1", "fraction of the estimated mesh error that calibrating it may leave",
        "1 to 4 % were left where it was measured; times 2.5",
    )  # fmt: skip
    # --- data that were left out -----------------------------------------------------------------------------------
    heldout_against: float = _criterion_field(
        -4.5, "ln probability", "of left-out data, extended less base, below which they speak against a cause",
        "if the cause is true and changes them by D standard deviations, the difference is normal with mean D^2/2 and "
        "standard deviation D, so it lies above D^2/2 - 3 D, at least -4.5, in 739 of 740 cases",
    )  # fmt: skip
    law_excess_left: float = _criterion_field(
        0.5, "1", "fraction of the excess misfit of left-out data that a learned law may leave",
        "a law that predicts takes away more than it leaves",
    )  # fmt: skip
    ln_bayes_law_node: float = _criterion_field(
        3.0, "ln Bayes factor", "that further nodes of a learned law must gain",
        "odds of 20 to 1: `strong` of Kass and Raftery",
    )  # fmt: skip
    # --- adequacy of the final model -------------------------------------------------------------------------------
    noise_sd_uncertainty: float = _criterion_field(
        0.05, "1", "relative standard uncertainty of the noise that a recording states or shows",
        "a sample of 200 gives 5 %; makers state noise to 10 %",
    )  # fmt: skip
    adequacy_standard_errors: float = _criterion_field(
        4.0, "standard errors", "of chi2 beyond which a recording is not explained",
        "1 in 30,000 for one of 40 recordings",
    )  # fmt: skip
    ln_bayes_unnamed_heat: float = _criterion_field(
        3.0, "ln Bayes factor", "of heat of any shape along the contact, from which the model lacks something",
        "odds of 20 to 1: `strong` of Kass and Raftery",
    )  # fmt: skip
    pressure_modes_chi2: float = _criterion_field(
        25.0, "chi2", "of the six free pressure modes, at their usual size, from which the model lacks something",
        "exceeded by chance once in 3,000 (six degrees of freedom)",
    )  # fmt: skip
    pull_adequate: float = _criterion_field(
        4.0, "standard deviations", "of a calibrated key from what was known, beyond which it is not what was known",
        "1 in 16,000 for one of some 20 keys",
    )  # fmt: skip
    pull_nuisance: float = _criterion_field(
        8.0, "standard deviations", "of a camera's or repetition's own unknowns from what is usual",
        "usual sizes are known to a factor of two",
    )  # fmt: skip
    condition_scatter: float = _criterion_field(
        1e-4, "probability", "of such scatter of an amplitude between conditions, below which its law is another one",
        "1 in 10,000 for a handful of parameters",
    )  # fmt: skip
    # --- inputs and recordings -------------------------------------------------------------------------------------
    pull_setup: float = _criterion_field(
        1.75, "standard deviations", "of a set-up error (scale, turn, clock, length), two standard errors allowed for, "
        "beyond which it is named",
        "1 in 12 set-ups is farther off",
    )  # fmt: skip
    setup_standard_errors: float = _criterion_field(
        4.0, "standard errors", "of a set-up error from none, below which it is chance", "1 in 16,000"
    )
    pull_input: float = _criterion_field(
        3.0, "standard deviations", "of prior and data together, beyond which the data contradict a stated input",
        "1 in 370 for one of some 20 inputs; Demortier and Lyons (2002)",
    )  # fmt: skip

    sd_ratio_uncheckable: float = _criterion_field(
        0.8, "1", "posterior over prior standard deviation of a stated input, above which the data cannot check it",
        "the data then bring 0.56 of the information that the prior has, or less",
    )  # fmt: skip
    certain_misfit_chi2: float = _criterion_field(
        2.0, "chi2 per datum", "of the calibrated base, beyond which a fit without end is no excuse for no verdict",
        "no noise that is stated to 5 % doubles its variance",
    )  # fmt: skip


CRITERIA = Criteria()


def list_criteria() -> tuple[tuple[str, float, str, str, str], ...]:
    """Name, value, unit, meaning and reason of every criterion, in order."""
    rows = []
    for f in fields(Criteria):
        m = f.metadata
        rows.append((f.name, float(getattr(CRITERIA, f.name)), m["unit"], m["meaning"], m["reason"]))
    return tuple(rows)
