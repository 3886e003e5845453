"""The result of `discover`: the verdict with its causes, evidence, alternatives and checks, as in verdict.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from flashtemp.camera.recording import VIEW_DESCRIPTIONS
from flashtemp.comparison.compare import ForceComparison, RecordingComparison
from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import RenamedAttribute

Array = npt.NDArray[np.float64]
VERDICT_SCHEMA = "flashtemp.verdict/1"
VERDICT_KINDS = ("named", "learned", "held_key", "weak", "group", "none_needed", "unexplained", "no_verdict")
MAX_NAMED_INPUTS = 6  # inputs that the data cannot check are listed in the text up to this number, else only counted
SIMULATED_DATA_SETS = 99  # noise-only data sets per test for structure
DOUBTFUL_PROBABILITY = 0.01  # of the scatter of an amplitude between conditions, below which a cause's law is doubtful


@dataclass(frozen=True)
class ParameterEstimate:
    """A fitted parameter in its `unit`, with standard error and 95 % interval; `bound`: it is on a bound."""

    name: str
    value: float
    stderr: float
    ci95: tuple[float, float]
    unit: str = "1"
    bound: bool = False


@dataclass(frozen=True)
class ConditionEstimate:
    """The estimate of a parameter from one condition alone; the condition in words."""

    condition: str
    value: float
    stderr: float


@dataclass(frozen=True)
class Cause:
    """A named cause: an effect, or an error of the measurement.

    `ln_bayes`: against the model without it.  `delta_chi2`: with the same freedom of all other parameters.
    `held_out_gain`: change of the ln probability of left-out data.  `distinctness` of its signature from all other
    candidates: 0 for identical, 1 for orthogonal.  `z`: signal-to-noise ratio after projection.  `raw_share`: fraction
    of its signal that calibration cannot absorb.
    `per_condition`: estimates of its first parameter by condition; `consistent`: probability of their scatter.
    `references` {key of the case: "effect.reference = value"}: keys whose value holds at a reference of the effect.
    `laboratory`: it is an error of the set-up or of a recording, which was corrected, not a physical effect.
    """

    effect: str
    words: str
    parameters: tuple[ParameterEstimate, ...]
    delta_chi2: float
    held_out_gain: float
    distinctness: float
    ln_bayes: float = 0.0
    z: float = 0.0
    raw_share: float = 0.0
    per_condition: tuple[ConditionEstimate, ...] = ()
    consistent: float = 1.0
    laboratory: bool = False
    references: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_doubtful(self) -> bool:
        """Whether its law may be another one, because its strength differs between conditions."""
        return self.consistent < DOUBTFUL_PROBABILITY and bool(self.parameters)

    doubted = RenamedAttribute("is_doubtful")


@dataclass(frozen=True)
class CandidateReport:
    """A candidate that was tried: its ln Bayes factor `score`, and its estimated `amplitude` with `stderr` in `unit`.

    `left`: ln Bayes factor of the accepted causes against it.  `detectable`: the amplitude that would have a
    signal-to-noise ratio of 5.  `seen`: signal-to-noise ratio of its typical amplitude.  `refitted`: the score is from
    a converged full fit, not from its sensitivities.
    """

    effect: str
    score: float
    distinctness: float
    reason: str
    parameter: str = ""
    amplitude: float = 0.0
    stderr: float = 0.0
    unit: str = "1"
    z: float = 0.0
    raw_share: float = 0.0
    detectable: float = float("inf")
    left: float | None = None
    refitted: bool = False
    seen: float = float("inf")


@dataclass(frozen=True)
class SetupErrorReport:
    """An error of the set-up that was calibrated: `value` with `stderr` in `unit`, `pull` in prior standard deviations,
    and a sentence in `words`."""

    name: str
    value: float
    stderr: float
    unit: str
    pull: float
    words: str


@dataclass(frozen=True)
class InputCorrection:
    """A stated number that the data contradict: the stated value `told`, the `value` with `stderr` that the data
    require, `ln_bayes` of freeing it, and `calibrated` values of the free keys with the number corrected."""

    key: str
    told: float
    value: float
    stderr: float
    unit: str
    ln_bayes: float
    words: str
    calibrated: dict[str, float] = field(default_factory=dict)

    @property
    def is_of_case(self) -> bool:
        """Whether it is a key of the case, not a value that a recording states about its camera."""
        return self.key.partition(".")[0] not in VIEW_DESCRIPTIONS


@dataclass(frozen=True)
class LearnedLaw:
    """A law outside the catalogue: which `quantity` depends on which `argument`, and how.

    `curve` (n,) at values `at` (n,) of the argument, with its 95 % band `low`, `high` (n,); a factor if `unit` is "1".
    `formula`: empty unless a formula fits as well as the curve.  `nodes`: arguments at which the piecewise linear law
    of the file is given.  `beside` {law in words: ln Bayes factor}: laws that are nearly as likely.
    """

    quantity: str
    argument: str
    words: str
    unit: str
    argument_unit: str
    formula: str
    at: Array
    curve: Array
    low: Array
    high: Array
    nodes: tuple[float, ...]
    beside: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        return {
            "quantity": self.quantity, "argument": self.argument, "words": self.words, "formula": self.formula,
            "curve": {"argument": self.at.tolist(), "value": self.curve.tolist(), "unit": self.unit,
                      "argument_unit": self.argument_unit},
            "band": {"low": self.low.tolist(), "high": self.high.tolist()}, "beside": self.beside,
        }  # fmt: skip


@dataclass(frozen=True)
class FitMetrics:
    """How well a model fits: over fitted data, over left-out data, and on means over frames.

    For an extended model, `rmse_change_error_K` and `held_out_z_change_error` are the standard errors of the changes of
    `rmse_K` and `held_out_z` against the base; NaN if they are unknown.
    """

    rmse_K: float
    chi2_per_dof: float
    held_out_rmse_K: float
    held_out_z: float
    mean_map_rmse_K: float = float("nan")
    near_contact_rmse_K: float = float("nan")
    rmse_change_error_K: float = float("nan")
    held_out_z_change_error: float = float("nan")

    @property
    def held_out_change_error_K(self) -> float:
        """Standard error of the change of `held_out_rmse_K` against the base, relatively that of z."""
        return self.held_out_z_change_error * self.held_out_rmse_K / self.held_out_z if self.held_out_z else 0.0


@dataclass(frozen=True)
class StructureTest:
    """A test for structure in the residuals: `p` is the fraction of simulated noise data sets beyond `statistic`.

    `is_small`: the residuals are smaller than those of most simulated data sets.
    """

    name: str
    where: str
    statistic: float
    p: float
    stage: str = "before"
    is_small: bool = False

    @property
    def is_p_limited(self) -> bool:
        """Whether no simulated data set is beyond the statistic, so that `p` is only an upper limit."""
        return self.p <= 1.0 / (1 + SIMULATED_DATA_SETS)


@dataclass(frozen=True)
class MissingHeatFlux:
    """Heat and pressure along the contact that the model lacks in one condition, without a catalogue of effects.

    `x` (n,) m; `flux` (repetitions, n) W/m2 of nominal area: measured minus computed, with standard error `flux_sd`;
    `pressure` (n,) p(x)/p and `pressure_sd`; `resolution` (n,) from 0 (no information) to 1.
    """

    condition: str
    x: Array
    repetition: Array
    flux: Array
    flux_sd: Array
    pressure: Array
    pressure_sd: Array
    resolution: Array


@dataclass(frozen=True)
class RuleResult:
    """One rule that led to the verdict: its `name`, `value` against `limit`, and whether it `passed`.

    `consequence`: what is true if it passed, or what follows if it did not.
    """

    name: str
    value: float
    limit: float
    passed: bool
    consequence: str


@dataclass(frozen=True)
class InputResult:
    """The check of a stated number of case or set-up against the data.

    `stated` in `unit` with its standard deviation `sd` (relative if `relative`) and the `source` of that; `estimate`
    with `stderr` from the data alone; `pull` in standard deviations of both together; `ln_bayes` of freeing it;
    `verdict`: contradicted, consistent or not checkable.
    """

    key: str
    words: str
    stated: float
    unit: str
    sd: float
    relative: bool
    source: str
    estimate: float
    stderr: float
    pull: float
    ln_bayes: float
    verdict: str
    sentence: str


@dataclass(frozen=True)
class NormalisedDeviation:
    """A calibrated parameter: its value, and its deviation from the prior in prior standard deviations (`pull`)."""

    name: str
    value: float
    stderr: float
    pull: float
    unit: str = "1"


@dataclass(frozen=True)
class FrictionDifference:
    """Friction in `higher` above that in `lower` (conditions or repetitions, in words) by `value`, relative, with its
    standard error; more than usual scatter.

    `is_between_conditions`: else it is between repetitions of one condition.
    """

    higher: str
    lower: str
    value: float
    stderr: float
    is_between_conditions: bool


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(DisplayMixin):
    """The whole result.  `kind` is one of VERDICT_KINDS and is decided by `decision.decide`; `says` it in sentences.

    `rules`: the comparisons that led to the kind, in order.  `group`: causes that the data cannot distinguish;
    `certain`: effects that are named all the same.  `base`, `extended`: metrics of both models; `before`, `after`:
    every recording against them.
    `gates`: adequacy tests with value and limit.  `certificate`: how the fits ended.  `assumed`: prior widths.
    `separability`: names and matrix (n, n) of correlations between projected signatures.
    `laboratory`: set-up errors that are within usual limits.  `held_key`: a stated input that the data contradict.
    `law`: a law outside the catalogue.  `inputs`: checks of all stated inputs; `inputs_told_together`: keys that the
    data cannot distinguish; `alternative_inputs`: inputs of the group with the values that they would need.
    `friction_differences`: friction of conditions and repetitions that differs by more than usual scatter.
    """

    title: str
    kind: str
    says: tuple[str, ...]
    causes: tuple[Cause, ...] = ()
    group: tuple[str, ...] = ()
    next_experiment: str = ""
    base: FitMetrics | None = None
    extended: FitMetrics | None = None
    rivals: tuple[CandidateReport, ...] = ()
    nuisance: tuple[NormalisedDeviation, ...] = ()
    tests: tuple[StructureTest, ...] = ()
    missing: tuple[MissingHeatFlux, ...] = ()
    separability: tuple[tuple[str, ...], Array] | None = None
    shifts: tuple[tuple[str, float, float, float], ...] = ()  # free parameter, before, after, standard error
    before: tuple[RecordingComparison, ...] = ()
    after: tuple[RecordingComparison, ...] = ()
    pulled: tuple[tuple[ForceComparison, ...], tuple[ForceComparison, ...]] = ((), ())
    gates: dict[str, tuple[float, float]] = field(default_factory=dict)
    certificate: dict[str, Any] = field(default_factory=dict)
    assumed: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    gain: dict[str, Any] | None = None  # changes by the extension, in kelvin
    not_named: tuple[str, ...] = ()  # why the best candidate is not named
    certain: tuple[str, ...] = ()
    laboratory: tuple[SetupErrorReport, ...] = ()
    held_key: InputCorrection | None = None
    law: LearnedLaw | None = None
    rules: tuple[RuleResult, ...] = ()
    inputs: tuple[InputResult, ...] = ()
    inputs_told_together: tuple[tuple[str, ...], ...] = ()
    alternative_inputs: tuple[InputCorrection, ...] = ()
    friction_differences: tuple[FrictionDifference, ...] = ()

    @property
    def corrected_key(self) -> InputCorrection | None:
        """The key of the case that is corrected if a wrong stated number is the whole verdict."""
        held = self.held_key
        return held if held is not None and self.kind == "held_key" and held.is_of_case else None

    @property
    def has_extension(self) -> bool:
        """Whether there is an extended case: a physical cause, or a key to correct."""
        return any(not c.laboratory for c in self.causes) or self.corrected_key is not None

    extends = RenamedAttribute("has_extension")

    def as_dict(self) -> dict[str, Any]:
        """The content of verdict.json."""

        def metrics_dict(f: FitMetrics | None) -> dict[str, Any] | None:
            return None if f is None else asdict(f)

        return {
            "schema": VERDICT_SCHEMA,
            "title": self.title,
            "verdict": self.kind,
            "says": list(self.says),
            "causes": [_cause_dict(c) for c in self.causes],
            "group": list(self.group),
            "next_experiment": self.next_experiment,
            "base": metrics_dict(self.base),
            "extended": metrics_dict(self.extended),
            "candidates": [asdict(r) for r in self.rivals],
            "nuisance": {
                p.name: {"value": p.value, "stderr": p.stderr, "pull": p.pull, "unit": p.unit} for p in self.nuisance
            },
            "parameters_moved": [{"name": n, "before": b, "after": a, "stderr": s} for n, b, a, s in self.shifts],
            "diagnostics": [asdict(t) for t in self.tests],
            "gates": {k: {"value": v, "limit": limit} for k, (v, limit) in self.gates.items()},
            "certificate": self.certificate,
            "assumed": self.assumed,
            "recordings": {"before": [s.as_dict() for s in self.before], "after": [s.as_dict() for s in self.after]},
            "gain": self.gain,
            "warnings": list(self.warnings),
            "report": "report.html",
            "extended_case": "extended.toml" if self.has_extension else None,
            "certain": list(self.certain),
            "laboratory": [asdict(f) for f in self.laboratory],
            "held_key": None if self.held_key is None else asdict(self.held_key),
            "law": None if self.law is None else self.law.as_dict(),
            "rules": [asdict(r) | {"passed": bool(r.passed)} for r in self.rules],
            "inputs": [asdict(i) for i in self.inputs],
            "inputs_told_together": [list(group) for group in self.inputs_told_together],
            "alternative_inputs": [asdict(h) for h in self.alternative_inputs],
            "friction_differences": [asdict(d) for d in self.friction_differences],
            "seconds": self.seconds,
        }

    def to_table(self) -> DisplayTable:
        head = ("cause", "parameter", "value", "95 %", "unit", "ln Bayes factor")
        causes = [
            (c.effect, p.name, p.value, p.ci95, p.unit, c.ln_bayes) for c in self.causes for p in c.parameters
        ]  # fmt: skip
        rivals = [(r.effect, r.score, r.amplitude, r.stderr, r.unit, r.reason) for r in self.rivals]
        tried = DisplayTable("Candidates", rivals, ("effect", "ln Bayes factor", "would need", "+-", "unit", ""))
        adequacy = DisplayTable(
            "Adequacy tests", [(k, v, limit) for k, (v, limit) in self.gates.items()], ("", "value", "limit")
        )
        pulls = [(p.name, p.value, p.stderr, p.unit, p.pull) for p in self.nuisance]
        calibrated = DisplayTable("Calibrated", pulls, ("", "value", "+-", "unit", "pull"))
        rules = [(r.name, r.value, r.limit, "passed" if r.passed else r.consequence) for r in self.rules]
        why = (DisplayTable("Why this verdict", rules, ("", "value", "limit", "result")),) if rules else ()
        against = [(i.key, i.stated, i.estimate, i.stderr, i.unit, i.pull, i.ln_bayes, i.verdict) for i in self.inputs]
        columns = ("", "stated", "from the data alone", "+-", "unit", "deviation", "ln Bayes factor", "verdict")
        inputs = (DisplayTable("Stated inputs against the data", against, columns),) if against else ()
        notes = (*self.says, *self._closing_lines(), *self.warnings)
        parts = (*why, *inputs, tried, calibrated, adequacy)
        return DisplayTable(f"Verdict on '{self.title}': {self.kind}", causes, head, notes, parts)

    def __str__(self) -> str:
        lines = [f"Verdict on '{self.title}': {self.kind}", *(f"  {line}" for line in self.says)]
        lines += [f"  {line}" for line in self._closing_lines()]
        return "\n".join([*lines, *(f"  note: {warning}" for warning in self.warnings)])

    def _closing_lines(self) -> list[str]:
        """Lines after the sentences: the next experiment, unless they contain it, and a summary of the inputs."""
        is_new = self.next_experiment and not any(self.next_experiment in line for line in self.says)
        out = [f"next: {self.next_experiment}"] if is_new else []
        # inputs are checked with the effects of the answer in the model, which may take the place of a wrong input
        effects = [c.effect for c in self.causes if c.effect in self.group] if self.kind == "group" else []
        lead = f"with {' and '.join(effects)} in the model, " if effects else ""
        return [*out, f"inputs: {lead}{_summarise_inputs(self.inputs)}"] if self.inputs else out


def _summarise_inputs(inputs: tuple[InputResult, ...]) -> str:
    """Which stated inputs the data contradict, and how many they cannot check, in one line."""
    contradicted = [f"{i.key} ({abs(i.pull):.1f} standard deviations)" for i in inputs if i.verdict == "contradicted"]
    unchecked = [i.key for i in inputs if i.verdict == "not checkable"]
    names = f": {', '.join(unchecked)}" if 0 < len(unchecked) <= MAX_NAMED_INPUTS else ""
    return (
        f"the data contradict {', '.join(contradicted) or 'no stated input'} and cannot check {len(unchecked)} of "
        f"{len(inputs)}{names}"
    )


def _cause_dict(c: Cause) -> dict[str, Any]:
    out = asdict(c)
    out["parameters"] = {
        p.name: {"value": p.value, "stderr": p.stderr, "ci95": list(p.ci95), "unit": p.unit, "at_bound": p.bound}
        for p in c.parameters
    }
    out["per_condition"] = list(out["per_condition"])
    return out
