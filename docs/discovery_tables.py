"""Write the tables of the pages on criteria and validation of discovery: .venv/bin/python docs/discovery_tables.py

Criteria come from the code, their effect on error rates and the validation from data files in benchmarks/results.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
RESULTS = HERE.parent / "benchmarks" / "results"
REPLAY, VALIDATION = RESULTS / "criteria_replay.json", RESULTS / "discovery_validation.json"
NEWCOMER = RESULTS / "newcomer_twins.json"
OUTCOMES = ("right", "wrong", "part", "group", "weak", "weak_wrong", "none", "unexplained", "no_verdict")
SETS = {  # what a set of campaigns is, by the first word of its campaigns' names
    "ideal": "independent generator, ideal camera",
    "camera": "one camera error at a time",
    "setup": "set-up errors",
    "twin": "short twins (`flashtemp twin`)",
    "newcomer": "one short twin",
    "fresh": "uncooled camera, seeds 7493 to 7529",
    "former": "uncooled camera, seeds 7530 to 7589",
    "blind": "uncooled camera, seeds 7590 to 7668",
    "strong": "uncooled camera, one strong effect",
    "later": "uncooled camera, seeds 7669 to 7692",
    "heavy": "uncooled camera, one strong effect, prior with heavy tails",
    "newest": "uncooled camera, seeds 7696 to 7719",
    "latest": "uncooled camera, 15 seeds from 7720 to 7743",
    "derivative": "uncooled camera, seeds 7745 to 7764, and 7958 to 7965 with one strong effect",
    "mistake": "uncooled camera, one error of the set-up",
    "varied": "another test programme in each",
    "programme": "another test programme in each, after the mends",
}
KINDS = {"null": "nothing", "single": "one effect", "pair": "two effects", "outside": "law outside the catalogue"}


def criteria_table() -> str:
    """Every criterion with value, unit, meaning and reason."""
    from flashtemp.discovery.criteria import list_criteria

    rows = (
        [f"`{name}`", f"**{value:g}{'' if unit == '1' else f' {unit}'}** {meaning}", reason]
        for name, value, unit, meaning, reason in list_criteria()
    )
    return markdown(("criterion", "value and meaning", "reason"), rows)


def replay_table() -> str:
    """What half and double of each criterion change, by the report of benchmarks/criteria_replay.py."""
    from flashtemp.discovery.criteria import list_criteria

    if not REPLAY.exists():
        return "No replay is stored yet.\n"
    report: Mapping[str, Any] = json.loads(REPLAY.read_text(encoding="utf-8"))["criteria"]
    rows = (
        [f"`{name}`", str(row["campaigns"]), row["decides"], changes(row, "half"), changes(row, "double")]
        for name, *_ in list_criteria()
        if (row := report.get(name))
    )
    return markdown(("criterion", "campaigns", "decides", "at half", "at double"), rows)


def changes(row: Mapping[str, Any], side: str) -> str:
    """How many campaigns more or fewer end with each outcome, and what could not be replayed."""
    words = [f"{outcome.replace('_', ' ')} {change:+d}" for outcome, change in row[side].items() if change]
    if moved := len(row["moved"][side]):
        words.append(f"{moved} {'verdict changes' if moved == 1 else 'verdicts change'}")
    words += [f"other corrections in {n}"] if (n := len(row["recordings"][side])) else []
    more, fewer = row["fits"][side]
    words += [f"fits {'+' * (sign > 0)}{sign * n}" for n, sign in ((more, 1), (fewer, -1)) if n]
    words += [f"{n} not decidable"] if (n := row["not_fitted"][side]) else []
    words += [f"{n} would try a law"] if (n := row["law_not_tried"][side]) else []
    return ", ".join(words) or "none"


def outcome_tables() -> str:
    """Verdicts of campaigns by what was hidden: a table for each set, with the outcomes that occur in it."""
    rows = validation()["rows"]
    out = []
    for name in dict.fromkeys(r["set"] for r in rows):
        own = [r for r in rows if r["set"] == name]
        shown = [o for o in OUTCOMES if o in ("right", "wrong") or any(r[o] for r in own)]
        heads = ("hidden", "number", *(o.replace("_", " ") for o in shown))
        cells = ([hidden(r["kind"]), str(r["campaigns"]), *(str(r[o]) for o in shown)] for r in own)
        title = SETS.get(name, name)
        out.append(f"**{title[:1].upper()}{title[1:]}**\n\n{markdown(heads, cells)}")
    return "\n".join(out)


def time_table() -> str:
    """CPU seconds by set and kind."""
    rows = [
        [SETS.get(r["set"], r["set"]), hidden(r["kind"]), str(r["campaigns"])]
        + [f"{r[k]:.0f}" if r[k] is not None else "" for k in ("median_cpu_s", "p90_cpu_s", "max_cpu_s")]
        for r in validation()["rows"]
    ]
    return markdown(("campaigns of", "hidden", "number", "median, s", "90 % below, s", "largest, s"), rows)


def interval_table() -> str:
    """How many 95 % intervals contain the true value, with Clopper and Pearson's 95 % bounds."""
    from scipy.stats import binomtest

    rows = []
    for r in validation()["intervals"]:
        low, high = binomtest(r["inside"], r["intervals"]).proportion_ci(0.95, method="exact")
        share = 100.0 * r["inside"] / r["intervals"]
        name = SETS.get(r["set"], r["set"])
        rows.append(
            [name, f"{r['inside']} of {r['intervals']}", f"{share:.0f} %", f"{100 * low:.0f}-{100 * high:.0f} %"]
        )
    return markdown(("campaigns of", "intervals that contain the truth", "fraction", "95 % bounds"), rows)


def newcomer_table() -> str:
    """Short twins by the effect that they hide: the verdict at each seed, and CPU seconds."""
    rows = json.loads(NEWCOMER.read_text(encoding="utf-8"))["rows"]
    seeds = sorted({r["seed"] for r in rows})
    lines = []
    for name in dict.fromkeys(r["effect"] for r in rows):
        own = {r["seed"]: r for r in rows if r["effect"] == name}
        spent = sorted(round(r["cpu_s"]) for r in own.values() if "cpu_s" in r)
        lines.append(
            [f"`{name}`", *(newcomer_verdict(own[s]) if s in own else "" for s in seeds), ", ".join(map(str, spent))]
        )
    return markdown(("hidden effect", *(f"seed {s}" for s in seeds), "CPU, s"), lines)


def newcomer_verdict(row: Mapping[str, Any]) -> str:
    """What the verdict on a short twin is, in a few words.

    >>> newcomer_verdict({"outcome": "weak wrong", "named": ["blur"], "group": [], "z": 4.0})
    'weak wrong: `blur` (z 4)'
    >>> newcomer_verdict({"outcome": "refused", "reason": "case: driven_faces.face: missing; give rows or a file"})
    'refused: needs `driven_faces.face`'
    """
    if "reason" in row:
        needed = re.search(r"(\w+\.\w+): missing", row["reason"])
        return f"{row['outcome']}: " + (f"needs `{needed[1]}`" if needed else row["reason"])
    names = row["group"] or [n for n in row["named"] if row["outcome"] != "right"]
    words = f"{row['outcome'].replace('_', ' ')}" + (": " + ", ".join(f"`{n}`" for n in names) if names else "")
    return words + (f" (z {row['z']:.0f})" if row.get("z") is not None else "")


def validation() -> dict[str, Any]:
    """The data file of the validation, its rows in the order of SETS and KINDS."""
    found: dict[str, Any] = json.loads(VALIDATION.read_text(encoding="utf-8"))
    sets, kinds = list(SETS), list(KINDS)

    def order(row: Mapping[str, Any]) -> tuple[int, int]:
        kind = row.get("kind", "").partition(",")[0]
        return (sets.index(row["set"]) if row["set"] in sets else len(sets),
                kinds.index(kind) if kind in kinds else len(kinds))  # fmt: skip

    return found | {part: sorted(found[part], key=order) for part in ("rows", "intervals")}


def hidden(kind: str) -> str:
    """What was hidden, in words.

    >>> hidden("single, z 5 to 10"), hidden("pair, z 20 to inf"), hidden("null")
    ('one effect, z 5-10', 'two effects, z above 20', 'nothing')
    """
    first, comma, rest = kind.partition(",")
    rest = re.sub(r"z (\d+) to inf", r"z above \1", rest).replace(" to ", "-")
    return KINDS.get(first, first.replace("setup", "set-up error")) + comma + rest


def markdown(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    names = list(heads)
    lines = [names, ["---"] * len(names), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


TABLES: Mapping[str, Mapping[str, Callable[[], str]]] = {
    "reference/discovery_criteria.md": {"criteria": criteria_table, "replay": replay_table},
    "explanation/discovery_validation.md": {
        "outcomes": outcome_tables,
        "intervals": interval_table,
        "times": time_table,
        "newcomer": newcomer_table,
    },
}


def page(name: str, text: str) -> str:
    """The text of a page with its tables written anew between their marks."""
    for table, make in TABLES[name].items():
        marks = rf"(<!-- {table}: [^\n]*-->\n).*?(<!-- end -->)"
        text, count = re.subn(marks, partial(_filled, make()), text, flags=re.DOTALL)
        if count != 1:
            raise SystemExit(f"{name}: has no place for the table of {table}")
    return text


def _filled(table: str, place: re.Match[str]) -> str:
    return place[1] + table + place[2]


if __name__ == "__main__":
    for name in TABLES:
        (HERE / name).write_text(page(name, (HERE / name).read_text(encoding="utf-8")), encoding="utf-8")
