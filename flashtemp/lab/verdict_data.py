"""The content of verdict.json as dataclasses of `flashtemp.discovery.verdict`, so that the words are the report's."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, TypeVar

from flashtemp.discovery.verdict import (
    VERDICT_KINDS,
    CandidateReport,
    Cause,
    FitMetrics,
    InputResult,
    ParameterEstimate,
    RuleResult,
    Verdict,
)
from flashtemp.lab.page_layout import refuse_damaged
from flashtemp.lab.result_files import ResultFolder
from flashtemp.lab.workspace import escape_control

MAX_RECORDS = 300  # causes, candidates, inputs, rules or recordings that a page shows
GRADES = {  # of each kind of verdict: the answer in words, and the colour that marks it
    "named": ("The missing effect is identified", "good"),
    "learned": ("A law outside the catalogue is learned from the data", "good"),
    "held_key": ("A stated input differs from what the data require", "warning"),
    "weak": ("A missing effect is likely, but the evidence is weak", "warning"),
    "group": ("Several causes explain these data equally well", "warning"),
    "none_needed": ("No extension is needed", "good"),
    "unexplained": ("Not explained: neither the model nor a candidate describes the data", "error"),
    "no_verdict": ("No verdict: the calibration is not reliable", "error"),
}
Record = TypeVar("Record")


@dataclass(frozen=True)
class RecordingChange:
    """One recording: rms difference (K) of the calibrated base and of the extended model; NaN where there is none."""

    file: str
    held_out: bool
    before_K: float
    after_K: float


@dataclass(frozen=True)
class StoredVerdict:
    """A verdict with the change of every recording, whether an extended case is stored, and law in words."""

    verdict: Verdict
    recordings: tuple[RecordingChange, ...]
    law: dict[str, Any]
    measured: tuple[str, ...]


def read_verdict(result: ResultFolder) -> StoredVerdict:
    """The verdict of a result.  Raises BadInput for a damaged file."""
    raw = result.read_json("verdict.json")
    with refuse_damaged(result.path / "verdict.json"):
        kind = str(raw.get("verdict", ""))
        verdict = Verdict(
            title=_plain_text(raw.get("title")),
            kind=kind if kind in VERDICT_KINDS else "no_verdict",
            says=tuple(_plain_text(text).replace("degC", "°C") for text in _record_list(raw.get("says"))),
            causes=tuple(_read_cause(c) for c in _record_list(raw.get("causes"))),
            group=tuple(map(_plain_text, _record_list(raw.get("group")))),
            next_experiment=_plain_text(raw.get("next_experiment")),
            base=_read_metrics(raw.get("base")),
            extended=_read_metrics(raw.get("extended")),
            rivals=tuple(_read_record(CandidateReport, c) for c in _record_list(raw.get("candidates"))),
            rules=tuple(_read_record(RuleResult, r) for r in _record_list(raw.get("rules"))),
            inputs=tuple(_read_record(InputResult, i) for i in _record_list(raw.get("inputs"))),
            inputs_told_together=tuple(
                tuple(map(_plain_text, _record_list(g))) for g in _record_list(raw.get("inputs_told_together"))
            ),
            warnings=tuple(map(_plain_text, _record_list(raw.get("warnings")))),
            seconds=_plain_number(raw.get("seconds")),
        )
        law = raw.get("law")
        return StoredVerdict(
            verdict, _read_changes(raw.get("recordings")), law if isinstance(law, dict) else {},
            tuple(_measured_lines(raw.get("gain"))),
        )  # fmt: skip


def _plain_text(value: Any) -> str:
    return escape_control("" if value is None else str(value))


def _plain_number(value: Any) -> float:
    """A number; NaN for null, and infinite numbers that are written as text."""
    if value is None or isinstance(value, (dict, list)):
        return math.nan
    return float(value)


def _record_list(value: Any) -> list[Any]:
    return list(value)[:MAX_RECORDS] if isinstance(value, (list, tuple)) else []


def _read_record(kind: type[Record], raw: Any) -> Record:
    """A dataclass of texts, numbers and booleans from a table of JSON; other keys are left out."""
    given: dict[str, Any] = {}
    for field in fields(kind):  # type: ignore[arg-type]
        if field.name in raw:
            value, wanted = raw[field.name], str(field.type)
            if wanted.startswith("float"):
                given[field.name] = None if value is None and "None" in wanted else _plain_number(value)
            elif wanted == "bool":
                given[field.name] = bool(value)
            elif wanted == "str":
                given[field.name] = _plain_text(value)
    return kind(**given)


def _read_metrics(raw: Any) -> FitMetrics | None:
    return _read_record(FitMetrics, raw) if isinstance(raw, dict) else None


def _read_cause(raw: dict[str, Any]) -> Cause:
    parameters = []
    for name, p in dict(raw.get("parameters") or {}).items():
        low, high = (_plain_number(v) for v in (p.get("ci95") or (None, None)))
        value, error = _plain_number(p.get("value")), _plain_number(p.get("stderr"))
        parameters.append(ParameterEstimate(_plain_text(name), value, error, (low, high), _plain_text(p.get("unit"))))
    numbers = ("delta_chi2", "held_out_gain", "distinctness", "ln_bayes", "z", "raw_share")
    delta_chi2, gain, distinctness, ln_bayes, z, share = (_plain_number(raw.get(name)) for name in numbers)
    return Cause(
        _plain_text(raw.get("effect")), _plain_text(raw.get("words")), tuple(parameters), delta_chi2, gain,
        distinctness, ln_bayes, z, share, consistent=_plain_number(raw.get("consistent", 1.0)),
        laboratory=bool(raw.get("laboratory")),
    )  # fmt: skip


def _read_changes(raw: Any) -> tuple[RecordingChange, ...]:
    """The change of every recording between the base and the extended model."""
    if not isinstance(raw, dict):
        return ()
    after = {str(r.get("file")): _plain_number(r.get("rmse_K")) for r in _record_list(raw.get("after"))}
    return tuple(
        RecordingChange(
            _plain_text(r.get("file")), bool(r.get("held_out")), _plain_number(r.get("rmse_K")),
            after.get(str(r.get("file")), math.nan),
        )
        for r in _record_list(raw.get("before"))
    )  # fmt: skip


def _measured_lines(gain: Any) -> list[str]:
    """What the extension changes, in sentences."""
    from flashtemp.viz.number_format import format_number

    if not isinstance(gain, dict) or not gain.get("file"):
        return []
    size, share = _plain_number(gain.get("changed_K")), 100.0 * _plain_number(gain.get("share"))
    change = f"{format_number(size)} K root mean square, {format_number(share)} % of its temperature rise"
    file = _plain_text(gain["file"])
    out = [f"After recalibration the extension changes {file} by {change}, more than any other recording."]
    friction = 100.0 * _plain_number(gain.get("friction", 0.0))
    return [*out, f"The friction changes by {format_number(friction)} %."] if friction >= 0.1 else out


def describe_answer(v: Verdict) -> tuple[str, str]:
    """The answer in words, and its grade: good, warning or error."""
    words, grade = GRADES[v.kind]
    effects = [c for c in v.causes if not c.laboratory]
    if v.kind == "named" and not effects and v.causes:
        return "The set-up differs from what is stated", "warning"
    if v.kind == "named" and len(effects) > 1:
        return f"{len(effects)} missing effects are identified", grade
    return words, grade


def describe_parameters(cause: Cause) -> list[tuple[str, str, str]]:
    """(name, value with its standard error, 95 % interval) of the parameters of a cause."""
    from flashtemp.viz.number_format import format_number, format_with_error

    return [
        (p.name, format_with_error(p.value, p.stderr, p.unit),
         f"{format_number(p.ci95[0])} to {format_number(p.ci95[1])}")
        for p in cause.parameters
    ]  # fmt: skip
