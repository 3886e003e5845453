"""What every criterion of discovery does to its verdicts: replays stored evidence with it at half and at double.

    python benchmarks/campaigns.py run FOLDER RESULTS.jsonl --store STORE
    python benchmarks/criteria_replay.py STORE [STORE ...] --out benchmarks/results/criteria_replay.json

The choice of causes among the stored full fits and `decide` are those of the engine; nothing is simulated.  A fit that
a criterion would have asked for and that was not made cannot be replayed: such campaigns are counted as `not_fitted`,
and their verdict is that of the fits that are known.  At the present values a replay must give the stored verdict.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
from campaigns import classify
from stored_evidence import StoredFit, StoredSearch, criteria_changed, read_evidence

from flashtemp.discovery import engine
from flashtemp.discovery.criteria import CRITERIA, Criteria
from flashtemp.discovery.decision import AdequacyTest, decide
from flashtemp.discovery.diagnostics import adequacy_tests as adequacy_module
from flashtemp.discovery.diagnostics import setup_errors as setup_module
from flashtemp.discovery.parameters import Kind, ParameterId
from flashtemp.discovery.selection import forward_selection

Names = frozenset[str]
Record = dict[str, Any]
FACTORS = (0.5, 2.0)
COUNTS = ("max_causes", "shortlist")  # criteria that are whole numbers, at least 1
VERDICT_KEYS = ("verdict", "effects", "inputs", "group")


@dataclass(frozen=True)
class Replayed:
    """A verdict as campaigns.py describes it, with the full fits that selection asked for.

    `missing`: those of them that nobody made; `law_not_tried`: whether a law would have been looked for and was not.
    """

    record: Record
    asked: frozenset[Names]
    missing: frozenset[Names]
    law_not_tried: bool = False

    @property
    def verdict(self) -> tuple[Any, ...]:
        return tuple(self.record["verdict" if k == "verdict" else k] for k in VERDICT_KEYS)


def replay(stored: StoredSearch) -> Replayed:
    """The verdict that the present criteria give on stored evidence."""
    with _stored_answers(stored):
        search, asked, missing = select_stored(stored)
        hint = None if search.best.model.effects else engine.best_hint(search)
        record = _verdict(stored, search, hint or search.best, hint is not None)
        law_not_tried = record["verdict"] == "unexplained" and not stored.law_was_tried
        if record["verdict"] == "unexplained" and (law := stored.law) is not None:
            least = max(CRITERIA.ln_bayes_named, law.known_gain) + law.price
            if law.gain >= least:
                names = frozenset(law.fit.model.effects)
                found = SimpleNamespace(**vars(search) | {"best": law.fit, "fits": search.fits | {names: law.fit}})
                judged = _verdict(stored, found, law.fit, False, law.excess)
                record = judged if judged["verdict"] == "learned" else record
    return Replayed(stored.record | record, frozenset(asked), frozenset(missing), law_not_tried)


# --- selection --------------------------------------------------------------------------------------------------
def select_stored(stored: StoredSearch) -> tuple[Any, set[Names], set[Names]]:
    """The search that the present criteria make of the stored fits; all fits that they ask for, and those not made."""
    base, asked, missing = stored.fits[stored.base], set[Names](), set[Names]()
    errors = tuple(SimpleNamespace(kind=kind) for kind in stored.recording_errors)
    search = SimpleNamespace(
        best=base, base=base, problem=None, data=None, fits={stored.base: base}, unfitted={}, recording_errors=errors
    )
    for _ in range(int(CRITERIA.max_causes)):
        ranked = _ranking(stored, search.best)
        if ranked is None:
            break  # nobody extended what is accepted now: what is beside it is not known
        for names in _wanted_fits(search, ranked, stored):
            asked.add(names)
            if names in stored.fits:
                search.fits[names] = stored.fits[names]
            elif names in stored.unfitted:
                search.unfitted[names] = stored.unfitted[names]
            else:
                missing.add(names)
        found = forward_selection._worth_its_parameters(search)  # type: ignore[arg-type]
        if found is None:
            break
        search.best = found
    return search, asked, missing


def _ranking(stored: StoredSearch, best: Any) -> Sequence[Any] | None:
    """Scores beside a model, if they were made: a ranking lacks the effects of the model beside which it was made."""
    everything = {s.effect for s in stored.rankings[0]} if stored.rankings else set()
    for ranked in stored.rankings:
        if everything - {s.effect for s in ranked} == set(best.model.effects):
            return ranked
    return None


def _wanted_fits(search: Any, ranked: Sequence[Any], stored: StoredSearch) -> Iterator[Names]:
    """Effects of the models that are fitted in full beside the best one."""
    own = frozenset(search.best.model.effects)
    yield from (own | {s.effect} for s in forward_selection.shortlist(ranked))
    if not own and stored.pair is not None:
        yield from (frozenset(p.effects) for p in forward_selection._pairs(search, ranked))  # type: ignore[attr-defined]


# --- verdict ----------------------------------------------------------------------------------------------------
def _verdict(
    stored: StoredSearch, search: Any, final: StoredFit, is_hint: bool, law_excess: tuple[float, float] | None = None
) -> Record:
    """What campaigns.py takes of a verdict: kind, effects, inputs and group, as `engine.judge` and `describe` say."""
    change = None
    if final.model.effects and final.size is not None:
        mesh_error = CRITERIA.mesh_error_left * final.size.mesh_error_K
        change = SimpleNamespace(size=replace(final.size, mesh_error_K=mesh_error))
    setup = engine.setup_errors(None, None, final, None, stored.inputs, CRITERIA)  # type: ignore[arg-type]
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
    """Data left out, as `engine.ModelAssessment` has them."""
    return SimpleNamespace(left_out=SimpleNamespace(density=np.array(fit.heldout), is_held_out=fit.is_held_out))


@contextmanager
def _stored_answers(stored: StoredSearch) -> Iterator[None]:
    """Functions of the engine that need data and sensitivities, with their stored answers."""

    def probabilities(problem: Any, fit: StoredFit, effect: str, every: bool = False) -> list[Any]:
        return [SimpleNamespace(probability=p) for p in fit.probabilities[effect][int(every)]]

    def adequacy_tests(problem: Any, fit: StoredFit, criteria: Criteria) -> tuple[AdequacyTest, ...]:
        return adequacy_module.adequacy_tests(problem, _for_adequacy(fit), criteria)  # type: ignore[arg-type]

    def reduced(problem: Any, fit: StoredFit, system: Any, known: Any, floor: float | None) -> Any:
        return fit.setup.system if floor is None else fit.setup.largest

    def visible_fraction(data: Any, fit: StoredFit, p: ParameterId, gain: float) -> float:
        return float(np.sqrt(2.0 * gain / fit.setup.rise_squares[p]))

    with ExitStack() as stack:
        for module, name, answer in (
            (engine, "adequacy_tests", adequacy_tests),
            (adequacy_module, "estimates_per_condition", lambda p, fit, e, every: probabilities(p, fit.fit, e, every)),
            (adequacy_module, "unnamed_heat_evidence", lambda problem, fit: fit.value("heat")),
            (adequacy_module, "pressure_mode_chi2", lambda fit: fit.value("pressure")),
            (adequacy_module, "normalised_deviations", _deviations),
            (adequacy_module, "refit_all_data", lambda fit: fit),
            (forward_selection, "estimates_per_condition", probabilities),
            (forward_selection, "pairs", lambda *args: [stored.pair]),
            (setup_module, "_reduced", reduced),
            (setup_module, "_visible_fraction", visible_fraction),
            (setup_module, "words", lambda *args: ""),
        ):
            stack.enter_context(patch.object(module, name, answer))
        yield


def _for_adequacy(fit: StoredFit) -> Any:
    """A fit as `adequacy_tests` asks it."""

    def value(name: str) -> float:
        return next(v for test, v in fit.adequacy.items() if test.startswith(name))

    misfits = [chi2 for chi2, _ in fit.misfits]
    return SimpleNamespace(
        fit=fit, value=value, model=fit.model, solution=None,
        system=SimpleNamespace(seen=frozenset(), left=lambda solution: misfits),
        blocks=[SimpleNamespace(count=count, held_out=False) for _, count in fit.misfits],
    )  # fmt: skip


def _deviations(fit: Any) -> dict[ParameterId, float]:
    """The largest deviation of a key and of a camera's own unknown."""
    key, other = ParameterId.of_key("key"), ParameterId(Kind.FLOOR, name="other")
    return {key: fit.value("calibrated"), other: fit.value("camera")}


# --- all criteria -----------------------------------------------------------------------------------------------
def changed_values(name: str) -> Iterator[tuple[float, float]]:
    """Factor and value of a criterion at half and at double; counts stay whole numbers."""
    now = float(getattr(CRITERIA, name))
    for factor in FACTORS:
        yield factor, (max(1.0, round(factor * now)) if name in COUNTS else factor * now)


def replay_criterion(name: str, searches: Sequence[StoredSearch], default: Sequence[Replayed]) -> Iterator[Record]:
    """Outcomes with one criterion at half and at double its value, and campaigns that they change."""
    for factor, value in changed_values(name):
        with criteria_changed(**{name: value}):
            found = [replay(s) for s in searches]
        pairs = list(zip(searches, default, found, strict=True))
        moved = [(s, a, b) for s, a, b in pairs if a.verdict != b.verdict]
        recordings = [s.record["name"] for s in searches if _recordings(s, name, factor) != _recordings(s, "", 1.0)]
        yield {
            "factor": factor,
            "value": value,
            "outcomes": count_outcomes(found),
            "changed": [
                {"name": s.record["name"], "from": classify(a.record), "to": classify(b.record)} for s, a, b in moved
            ],
            "changed_recordings": recordings,
            "fits_added": sum(len(b.asked - a.asked) for _, a, b in pairs),
            "fits_dropped": sum(len(a.asked - b.asked) for _, a, b in pairs),
            "not_fitted": sum(bool(b.missing - a.missing) for _, a, b in pairs),
            "law_not_tried": sum(b.law_not_tried for _, _, b in pairs),
        }


def _recordings(s: StoredSearch, name: str, factor: float) -> tuple[str, ...]:
    return s.recordings.get((name, factor), s.recordings.get(("", 1.0), ()))


def count_outcomes(found: Iterable[Replayed]) -> dict[str, int]:
    """Number of campaigns of each outcome of campaigns.py."""
    return dict(Counter(classify(r.record) for r in found).most_common())


def replay_all(searches: Sequence[StoredSearch]) -> Record:
    """The report on all criteria.  Exits where a replay at the present values does not give the stored verdict."""
    default = [replay(s) for s in searches]
    wrong = [s.record["name"] for s, r in zip(searches, default, strict=True) if r.verdict != stored_verdict(s)]
    rows = []
    for f in fields(Criteria):
        changes = list(replay_criterion(f.name, searches, default))
        acts = any(c["changed"] or c["changed_recordings"] for c in changes)
        cost = any(c["fits_added"] or c["fits_dropped"] for c in changes)
        effect = "verdicts" if acts else "cost only" if cost else "nothing"
        rows.append({"name": f.name, "value": float(getattr(CRITERIA, f.name)), "changes": effect, "at": changes})
        print(f"{f.name}: {effect}", file=sys.stderr)
    return {
        "campaigns": len(searches),
        "not_reproduced": wrong,
        "outcomes": count_outcomes(default),
        "criteria": rows,
    }


def stored_verdict(s: StoredSearch) -> tuple[Any, ...]:
    return tuple(s.record[k] for k in VERDICT_KEYS)


def tabulate(report: Record) -> Iterator[str]:
    """Lines of the table: what each criterion changes at half and at double."""
    yield f"{report['campaigns']} campaigns; as they are: {_words(report['outcomes'])}"
    yield "| criterion | value | decides | at half | at double |\n|---|---|---|---|---|"
    for row in report["criteria"]:
        cells = (_describe_change(c) for c in row["at"])
        yield f"| {row['name']} | {row['value']:g} | {row['changes']} | {' | '.join(cells)} |"


def _describe_change(change: Record) -> str:
    """Verdicts that changed, as `right to weak: 3`, and full fits that would be added or dropped."""
    moved = Counter(f"{c['from']} to {c['to']}" for c in change["changed"])
    words = [f"{what}: {count}" for what, count in moved.most_common()]
    words += [f"recordings otherwise: {n}"] if (n := len(change["changed_recordings"])) else []
    words += [f"{change['fits_added']} fits more"] if change["fits_added"] else []
    words += [f"{change['fits_dropped']} fits fewer"] if change["fits_dropped"] else []
    return "; ".join(words) or "none"


def _words(outcomes: dict[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in outcomes.items())


def main() -> None:
    """Replay all criteria on the stored evidence of some folders."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("stores", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    files = sorted(file for store in args.stores for file in store.glob("*.pkl.xz"))
    report = replay_all([read_evidence(f) for f in files])
    args.out.parent.mkdir(parents=True, exist_ok=True)
    args.out.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print(*tabulate(report), sep="\n")
    if report["not_reproduced"]:
        raise SystemExit(f"not reproduced at the present values: {', '.join(report['not_reproduced'])}")


if __name__ == "__main__":
    main()
