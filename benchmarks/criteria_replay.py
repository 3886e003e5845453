"""Influence of every criterion on the verdicts of discovery: replays stored evidence at half and double its value.

    python benchmarks/campaigns.py run FOLDER RESULTS.jsonl --store STORE
    python benchmarks/criteria_replay.py STORE [STORE ...] --out benchmarks/results/criteria_replay.json [--add]

The selection among the stored full fits and `decide` are those of the engine; nothing is simulated.  If a criterion
requires a fit that was not made, the campaign is counted as `not_fitted`, and its verdict is that of the stored fits.
At the present values a replay must give the stored verdict.  With `--add` the campaigns join those of the report that
is in the file, so that many campaigns can be replayed a few at a time.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
from campaigns import SUMMARY_COLUMNS, describe_end, summary_column
from stored_evidence import StoredFit, StoredSearch, criteria_changed, read_evidence

from flashtemp.discovery import engine
from flashtemp.discovery.criteria import CRITERIA, Criteria
from flashtemp.discovery.decision import AdequacyTest, decide
from flashtemp.discovery.diagnostics import adequacy_tests as adequacy_module
from flashtemp.discovery.diagnostics import setup_errors as setup_module
from flashtemp.discovery.parameters import PLACEMENT_KINDS, ParameterId, ParameterKind
from flashtemp.discovery.selection import forward_selection

Names = frozenset[str]
Record = dict[str, Any]
FACTORS = {"half": 0.5, "double": 2.0}
COUNTS = ("max_causes", "shortlist")  # criteria that are whole numbers, at least 1
VERDICT_KEYS = ("verdict", "effects", "inputs", "group")


@dataclass(frozen=True)
class ReplayedVerdict:
    """A verdict as campaigns.py describes it, with the full fits that the selection required.

    `missing`: those of them that were not made; `law_not_tried`: whether a law would have been tried and was not.
    """

    record: Record
    asked: frozenset[Names]
    missing: frozenset[Names]
    law_not_tried: bool = False

    @property
    def verdict(self) -> tuple[Any, ...]:
        return tuple(self.record[k] for k in VERDICT_KEYS)


def replay(stored: StoredSearch) -> ReplayedVerdict:
    """The verdict that the present criteria give on stored evidence."""
    with _stored_answers(stored):
        search, asked, missing = select_stored(stored)
        hint = None if search.best.model.effects else engine.find_best_hint(search)
        record = _verdict(stored, search, hint or search.best, hint is not None)
        law_not_tried = record["verdict"] == "unexplained" and not stored.law_was_tried
        if record["verdict"] == "unexplained" and (law := stored.law) is not None:
            least = max(CRITERIA.ln_bayes_named, law.known_gain) + law.price
            if law.gain >= least:
                names = frozenset(law.fit.model.effects)
                found = SimpleNamespace(**vars(search) | {"best": law.fit, "fits": search.fits | {names: law.fit}})
                judged = _verdict(stored, found, law.fit, False, law.excess)
                record = judged if judged["verdict"] == "learned" else record
    return ReplayedVerdict(stored.record | record, frozenset(asked), frozenset(missing), law_not_tried)


# --- selection --------------------------------------------------------------------------------------------------
def select_stored(stored: StoredSearch) -> tuple[Any, set[Names], set[Names]]:
    """The search that the present criteria make of the stored fits; all fits that they require, and those not made."""
    base, asked, missing = stored.fits[stored.base], set[Names](), set[Names]()
    errors = tuple(SimpleNamespace(kind=kind) for kind in stored.recording_errors)
    problem = SimpleNamespace(freed_inputs=stored.freed_inputs)
    search = SimpleNamespace(
        best=base, base=base, problem=problem, data=None, fits={stored.base: base}, unfitted={},
        recording_errors=errors, input_alternatives=(),
    )  # fmt: skip
    for _ in range(int(CRITERIA.max_causes)):
        ranked = _ranking(stored, search.best)
        if ranked is None:
            break  # the stored search did not extend this model, so its other candidates are unknown
        for names in _wanted_fits(search, ranked, stored):
            asked.add(names)
            if names in stored.fits:
                search.fits[names] = stored.fits[names]
            elif names in stored.unfitted:
                search.unfitted[names] = stored.unfitted[names]
            else:
                missing.add(names)
        found = forward_selection._best_extension(search)  # type: ignore[arg-type]
        if found is None:
            break
        search.best = found
    if stored.rankings and _ranking(stored, search.best) is stored.rankings[-1]:  # what the stored search accepted
        search.input_alternatives = stored.input_alternatives
    return search, asked, missing


def _ranking(stored: StoredSearch, best: Any) -> Sequence[Any] | None:
    """Scores at a model, if they are stored: a ranking lacks the effects of the model for which it was made."""
    everything = {s.effect for s in stored.rankings[0]} if stored.rankings else set()
    for ranked in stored.rankings:
        if everything - {s.effect for s in ranked} == set(best.model.effects):
            return ranked
    return None


def _wanted_fits(search: Any, ranked: Sequence[Any], stored: StoredSearch) -> Iterator[Names]:
    """Effects of the models that are fitted in full as extensions of the best one."""
    own = frozenset(search.best.model.effects)
    yield from (own | {s.effect} for s in forward_selection.shortlist_candidates(ranked))
    if not own and stored.pair is not None:
        yield from (frozenset(p.effects) for p in forward_selection._promising_pairs(search, ranked))  # type: ignore[attr-defined]


# --- verdict ----------------------------------------------------------------------------------------------------
def _verdict(
    stored: StoredSearch, search: Any, final: StoredFit, is_hint: bool, law_excess: tuple[float, float] | None = None
) -> Record:
    """Kind, effects, inputs and group, as `engine.judge_search` and `campaigns.describe_verdict` give them."""
    change = None
    if final.model.effects and final.size is not None:
        change = SimpleNamespace(size=final.size)
    setup = engine.find_setup_errors(search.problem, None, final, None, stored.inputs, CRITERIA)  # type: ignore[arg-type]
    base, own = _assessment(search.base), _assessment(final)
    evidence = engine.collect_evidence(search, final, base, own, change, setup, None, is_hint)  # type: ignore[arg-type]
    if law_excess is not None:
        before, after = law_excess
        left = max(after, 0.0) / max(before, 1e-300) if before > 0.0 else 1.0
        evidence = replace(evidence, learned_law="a law", law_excess_left=left)
    decision = decide(evidence, CRITERIA)
    kind, unusual = decision.kind, [e for e in setup if e.is_unusual(CRITERIA)]
    shows_cause = bool(final.model.effects) and kind in ("named", "group", "weak", "unexplained", "learned")
    if kind == "named" and not search.best.model.effects:
        shows_cause = False
    named_setup = [e.name for e in unusual if not e.is_input] if kind not in ("no_verdict", "unexplained") else []
    keys = [e.name for e in unusual if e.is_input][:1] if kind == "held_key" else []
    return {
        "verdict": kind,
        "effects": list(final.model.effects) if shows_cause else [],
        "inputs": [*stored.recording_errors, *named_setup, *keys],
        "group": list(decision.group),
    }


def _assessment(fit: StoredFit) -> Any:
    """Left-out data, as in `assessment.ModelAssessment`."""
    return SimpleNamespace(left_out=SimpleNamespace(density=np.array(fit.heldout), is_held_out=fit.is_held_out))


@contextmanager
def _stored_answers(stored: StoredSearch) -> Iterator[None]:
    """Replace functions of the engine that need data and sensitivities by their stored results."""

    def probabilities(problem: Any, fit: StoredFit, effect: str, every: bool = False) -> list[Any]:
        return [SimpleNamespace(probability=p) for p in fit.probabilities[effect][int(every)]]

    def adequacy_tests(problem: Any, fit: StoredFit, criteria: Criteria) -> tuple[AdequacyTest, ...]:
        return adequacy_module.run_adequacy_tests(problem, _for_adequacy(fit), criteria)  # type: ignore[arg-type]

    def reduced(problem: Any, fit: StoredFit, system: Any, known: Any, discrepancy_sd: float | None) -> Any:
        return fit.setup.system if discrepancy_sd is None else fit.setup.largest

    def visible_fraction(data: Any, fit: StoredFit, system: Any, p: ParameterId, value: float, gain: float) -> float:
        if p.kind not in PLACEMENT_KINDS:  # older evidence does not contain it
            return abs(value) * fit.setup.changes.get(p, np.inf)
        return float(np.sqrt(2.0 * gain / fit.setup.rise_squares[p]))

    with ExitStack() as stack:
        for module, name, answer in (
            (engine, "run_adequacy_tests", adequacy_tests),
            (
                adequacy_module,
                "estimate_effect_by_condition",
                lambda p, fit, e, every: probabilities(p, fit.fit, e, every),
            ),
            (adequacy_module, "unnamed_heat_evidence", lambda problem, fit: fit.value("heat")),
            (adequacy_module, "pressure_mode_chi2", lambda fit: fit.value("pressure")),
            (adequacy_module, "normalised_deviations", _deviations),
            (adequacy_module, "refit_all_data", lambda fit: fit),
            (forward_selection, "estimate_effect_by_condition", probabilities),
            (forward_selection, "score_pairs", lambda *args: [stored.pair]),
            (setup_module, "_reduce_fit", reduced),
            (setup_module, "_visible_fraction", visible_fraction),
            (setup_module, "describe_setup_error", lambda *args: ""),
        ):
            stack.enter_context(patch.object(module, name, answer))
        yield


def _for_adequacy(fit: StoredFit) -> Any:
    """A stored fit with what `run_adequacy_tests` needs."""

    def value(name: str) -> float:
        return next(v for test, v in fit.adequacy.items() if test.startswith(name))

    misfits = [chi2 for chi2, _ in fit.misfits]
    return SimpleNamespace(
        fit=fit, value=value, model=fit.model, solution=None,
        system=SimpleNamespace(fitted_columns=frozenset(), block_chi2=lambda solution: misfits),
        blocks=[SimpleNamespace(label="", count=count, held_out=False) for _, count in fit.misfits],
    )  # fmt: skip


def _deviations(fit: Any) -> dict[ParameterId, float]:
    """The largest deviation of a key and of a camera parameter."""
    key, other = ParameterId.of_key("key"), ParameterId(ParameterKind.MODEL_DISCREPANCY, name="other")
    return {key: fit.value("calibrated"), other: fit.value("camera")}


# --- all criteria -----------------------------------------------------------------------------------------------
def changed_values(name: str) -> dict[str, float]:
    """Half and double of a criterion; counts stay whole numbers."""
    now = float(getattr(CRITERIA, name))
    return {side: max(1.0, round(f * now)) if name in COUNTS else f * now for side, f in FACTORS.items()}


def replay_criterion(name: str, searches: Sequence[StoredSearch], default: Sequence[ReplayedVerdict]) -> Record:
    """Changes of verdicts by one criterion at half and double its value.

    For each side the changes of the numbers of outcomes, and in `moved` every change of a verdict; `fits` that would
    be added and dropped; campaigns `not_fitted` in which a required fit was not made, `law_not_tried` in which
    a law would be tried and was not, and `recordings` in which other errors of recordings would be found.
    """
    out: Record = {"value": float(getattr(CRITERIA, name)), "campaigns": len(searches)}
    parts: dict[str, Record] = {k: {} for k in ("moved", "fits", "not_fitted", "law_not_tried", "recordings")}
    for side, value in changed_values(name).items():
        with criteria_changed(**{name: value}):
            found = [replay(s) for s in searches]
        trios = list(zip(searches, default, found, strict=True))
        before, after = count_outcomes(default), count_outcomes(found)
        out[side] = {o: after[o] - before[o] for o in SUMMARY_COLUMNS if after[o] != before[o]}
        parts["moved"][side] = {
            s.record["name"]: f"{describe_end(a.record)} -> {describe_end(b.record)}"
            for s, a, b in trios if a.verdict != b.verdict
        }  # fmt: skip
        parts["fits"][side] = [sum(len(b.asked - a.asked) for _, a, b in trios),
                               sum(len(a.asked - b.asked) for _, a, b in trios)]  # fmt: skip
        parts["not_fitted"][side] = sum(bool(b.missing - a.missing) for _, a, b in trios)
        parts["law_not_tried"][side] = sum(b.law_not_tried and not a.law_not_tried for _, a, b in trios)
        factor = FACTORS[side]
        parts["recordings"][side] = [
            s.record["name"] for s in searches if _recordings(s, name, factor) != _recordings(s, "", 1.0)
        ]
    out |= parts
    acts = any(parts["moved"].values()) or any(parts["recordings"].values()) or any(parts["law_not_tried"].values())
    out["decides"] = "verdicts" if acts else "cost" if any(map(any, parts["fits"].values())) else "nothing"
    return out


def _recordings(s: StoredSearch, name: str, factor: float) -> tuple[str, ...]:
    return s.recordings.get((name, factor), s.recordings.get(("", 1.0), ()))


def count_outcomes(found: Iterable[ReplayedVerdict]) -> Counter[str]:
    """Number of campaigns in every column of the page on validation."""
    return Counter(summary_column(r.record) for r in found)


def replay_all(searches: Sequence[StoredSearch]) -> Record:
    """The names of the `campaigns` and, for each of the `criteria`, its record of changes."""
    default = [replay(s) for s in searches]
    criteria = {f.name: replay_criterion(f.name, searches, default) for f in fields(Criteria)}
    return {"campaigns": [s.record["name"] for s in searches], "criteria": criteria}


def add_reports(old: Record, new: Record) -> Record:
    """The report of the campaigns of two reports.

    Raises ValueError if they share a campaign, or were made with other criteria.
    """
    if twice := sorted(set(old["campaigns"]) & set(new["campaigns"])):
        raise ValueError(f"{', '.join(twice)}: in the report already; leave them out, or replay all without --add")
    known = {name: row for name, row in old["criteria"].items() if name in new["criteria"]}
    if changed := sorted(name for name, row in known.items() if row["value"] != new["criteria"][name]["value"]):
        raise ValueError(f"{', '.join(changed)}: had other values in the report; replay all campaigns without --add")
    # a criterion that the report lacks has the campaigns of the new one alone, as its number of campaigns says
    criteria = {name: _add_rows(known[name], row) if name in known else row for name, row in new["criteria"].items()}
    return {"campaigns": [*old["campaigns"], *new["campaigns"]], "criteria": criteria}


def _add_rows(old: Record, new: Record) -> Record:
    """The changes by one criterion in the campaigns of two reports."""
    out: Record = {"value": new["value"], "campaigns": old["campaigns"] + new["campaigns"]}
    for side in FACTORS:
        outcomes = {o: old[side].get(o, 0) + new[side].get(o, 0) for o in SUMMARY_COLUMNS}
        out[side] = {o: change for o, change in outcomes.items() if change}
    for key in ("not_fitted", "law_not_tried", "recordings"):
        out[key] = {side: old[key][side] + new[key][side] for side in FACTORS}
    out["moved"] = {side: old["moved"][side] | new["moved"][side] for side in FACTORS}
    out["fits"] = {side: np.add(old["fits"][side], new["fits"][side]).tolist() for side in FACTORS}
    decisions = ("verdicts", "cost", "nothing")  # the strongest first
    return out | {"decides": min(old["decides"], new["decides"], key=decisions.index)}


def list_not_reproduced(searches: Iterable[StoredSearch]) -> list[str]:
    """Campaigns in which a replay at the present values does not give the stored verdict, with both verdicts."""
    pairs = ((s.record, replay(s)) for s in searches)
    return [f"{old['name']}: {describe_end(old)}; replayed {describe_end(new.record)}"
            for old, new in pairs if tuple(old[k] for k in VERDICT_KEYS) != new.verdict]  # fmt: skip


def tabulate(report: Record) -> Iterator[str]:
    """Lines of the table: what each criterion changes at half and at double."""
    yield "| criterion | value | decides | at half | at double |\n|---|---|---|---|---|"
    for name, row in report["criteria"].items():
        cells = " | ".join(_describe_side(row, side) for side in FACTORS)
        yield f"| {name} | {row['value']:g} | {row['decides']} | {cells} |"


def _describe_side(row: Record, side: str) -> str:
    """Changes of outcomes, and of the number of full fits."""
    words = [f"{o} {change:+d}" for o, change in row[side].items()]
    words += [f"{len(row[key][side])} {key}" for key in ("moved", "recordings") if row[key][side]]
    words += [f"fits +{row['fits'][side][0]} -{row['fits'][side][1]}"] if any(row["fits"][side]) else []
    words += [f"{row[key][side]} {key}" for key in ("not_fitted", "law_not_tried") if row[key][side]]
    return ", ".join(words) or "none"


def main() -> None:
    """Replay all criteria on the stored evidence of some folders."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("stores", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--add", action="store_true", help="add the campaigns to those of the report in the file")
    args = parser.parse_args()
    searches = [read_evidence(file) for store in args.stores for file in sorted(store.glob("*.pkl.xz"))]
    report = replay_all(searches)
    if args.add:
        try:
            report = add_reports(json.loads(args.out.read_text(encoding="utf-8")), report)
        except ValueError as fault:
            raise SystemExit(f"{args.out.name}: {fault}") from None
    args.out.parent.mkdir(parents=True, exist_ok=True)
    args.out.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    outcomes = count_outcomes(replay(s) for s in searches)
    print(f"{len(searches)} campaigns; as they are: {', '.join(f'{n} {o}' for o, n in outcomes.most_common())}")
    print(*tabulate(report), sep="\n")
    if different := list_not_reproduced(searches):
        raise SystemExit("\n".join(["not the stored verdict at the present values:", *different]))


if __name__ == "__main__":
    main()
