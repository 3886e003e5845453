"""Null controls of learned laws: how often data without a law give one.

    python benchmarks/learned_laws.py 7000 7010 nulls.jsonl    one campaign per seed; those in the file are skipped
    python benchmarks/learned_laws.py table nulls.jsonl

Every seed is a campaign of the independent generator in tests/reference, with all errors at their usual size and
no hidden effect.  Its laws are scored by their sensitivities although no verdict requires one: `best` is the best
law of the campaign itself.  `beyond` counts draws of noise and all nuisances whose best law would be fitted in full.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

DRAWS = 10_000  # of noise and nuisances on the sensitivities of one campaign
TRIED = ("pressure_tilt",)  # in place of the whole catalogue


@dataclass(frozen=True)
class LawSignatures:
    """Projected sensitivities of laws: `information` (k, k), and the columns and typical size of every law."""

    information: np.ndarray
    laws: tuple[tuple[np.ndarray, float], ...]

    def best_gains(self, u: np.ndarray, widths: tuple[float, ...]) -> np.ndarray:
        """ln Bayes factor of every law at its best width (laws, draws), for projected scores u (k, draws)."""
        out = []
        for at, size in self.laws:
            own, mine = self.information[np.ix_(at, at)], u[at]
            each = []
            for width in widths:
                sd = width * size
                A = np.eye(len(at)) + sd**2 * own
                gain = 0.5 * sd**2 * np.einsum("ij,ij->j", mine, np.linalg.solve(A, mine))
                each.append(gain - 0.5 * np.linalg.slogdet(A)[1] - np.log(len(widths)))
            out.append(np.max(each, axis=0))
        return np.array(out)

    def draw_scores(self, rng: np.random.Generator, draws: int) -> np.ndarray:
        """Scores (k, draws) of data with only noise and nuisances: their covariance is the information."""
        values, vectors = np.linalg.eigh(self.information)
        return (vectors * np.sqrt(np.maximum(values, 0.0))) @ rng.normal(size=(len(values), draws))


def law_signatures(calibrated, laws) -> LawSignatures:
    """The projected sensitivities of all laws at the calibrated base."""
    from flashtemp.discovery import law_identification
    from flashtemp.discovery.parameters import ParameterId

    problem, _, made = law_identification._with_laws(
        calibrated.problem, calibrated.data, {law.name: law for law in laws}
    )
    fit = law_identification._with_sensitivities(problem, calibrated, tuple(made.values()))
    names: list[ParameterId] = []
    own = []
    for law in laws:
        columns = [c for c in made[law.name].strength_columns() if c in fit.system.index] if law.name in made else []
        if columns:
            own.append((len(names) + np.arange(len(columns)), law.quantity.typical_size))
            names += columns
    return LawSignatures(fit.system.project_out(fit.free_priors, names, fit.equations).information, tuple(own))


def run_seed(seed: int) -> dict:
    """A null campaign: its best law by sensitivities, and how many draws of noise give a law."""
    from reference import laboratory

    from flashtemp.comparison import campaign
    from flashtemp.discovery import engine
    from flashtemp.discovery.criteria import CRITERIA
    from flashtemp.discovery.law_identification import RELATIVE_WIDTHS, list_possible_laws, ln_choice_odds, score_laws
    from flashtemp.discovery.prediction.prediction import predict_condition
    from flashtemp.discovery.prediction.problem import prepare_problem
    from flashtemp.discovery.selection.forward_selection import EffectSearch
    from flashtemp.runs.results.worker_pool import open_worker_pool

    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder, open_worker_pool(predict_condition, 1) as run:
        laboratory.write_campaign(
            folder, {}, seed, test=laboratory.MeasurementProgramme(0.4, wait=4.0, columns=50, mesh=0.5)
        )
        problem = prepare_problem(replace(campaign.load(folder), candidates=TRIED), run)
        problem, _, first = engine.correct_measurements(problem, print)
        problem, data, base = engine.calibrate_base(problem, first, print)
        calibrated = EffectSearch(problem, data, base, base, {frozenset(): base})
        laws = list(list_possible_laws(calibrated))
        best = score_laws(calibrated, laws)[0]
        threshold = CRITERIA.ln_bayes_named + ln_choice_odds(laws)
        found = law_signatures(calibrated, laws)
    gains = found.best_gains(found.draw_scores(np.random.default_rng([seed, 3]), DRAWS), RELATIVE_WIDTHS).max(axis=0)
    return {
        "seed": seed, "converged": calibrated.base.is_converged, "laws": len(laws), "threshold": threshold,
        "best": [best.law.description, best.ln_bayes], "draws": DRAWS, "beyond": int(np.sum(gains > threshold)),
        "largest": float(gains.max()), "cpu_s": time.process_time() - began,
    }  # fmt: skip


def run(first: int, last: int, file: Path) -> None:
    """Run all seeds first..last-1 that are not in the file."""
    done = {json.loads(line)["seed"] for line in file.read_text().splitlines()} if file.exists() else set()
    for seed in range(first, last):
        if seed not in done:
            found = run_seed(seed)
            with file.open("a") as out:
                out.write(json.dumps(found) + "\n")
            print(found, flush=True)


def print_counts(file: Path) -> None:
    """Counts over all nulls of a file."""
    rows = [json.loads(line) for line in file.read_text().splitlines()]
    own = sum(r["best"][1] > r["threshold"] for r in rows)
    beyond, draws = (sum(r[k] for r in rows) for k in ("beyond", "draws"))
    print(f"{len(rows)} campaigns: {own} whose best law would be fitted in full, largest ln Bayes factor "
          f"{max(r['best'][1] for r in rows):.1f} of {min(r['threshold'] for r in rows):.1f} needed")  # fmt: skip
    print(f"{draws} draws of noise and nuisances: {beyond} ({100 * beyond / draws:.3f} %), largest "
          f"{max(r['largest'] for r in rows):.1f}")  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1] == "table":
        print_counts(Path(sys.argv[2]))
    else:
        run(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
