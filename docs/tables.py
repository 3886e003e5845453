"""Write the tables of docs/effects.md from flashtemp/physics/quantities.py: .venv/bin/python docs/tables.py"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

from flashtemp.physics.quantities import CAMERA, QUANTITIES, SITES, Quantity

PAGE = Path(__file__).parent / "effects.md"


def rows(quantities: dict[str, Quantity]) -> str:
    """A table of quantities in Markdown."""
    head = "| quantity | unit of a term | before | meaning | its law sees besides |\n|---|---|---|---|---|\n"
    return head + "".join(f"| `{q.name}` | {q.unit} | {q.base} | {q.about} | {q.sees} |\n" for q in quantities.values())


def sites() -> str:
    """The table of sites in Markdown."""
    kind = {True: "zone", False: "patch, film"}
    return "| site | of | where |\n|---|---|---|\n" + "".join(
        f"| `{s.name}` | {kind[s.zone]} | {s.about} |\n" for s in SITES.values()
    )


def _filled(table: str, place: re.Match[str]) -> str:
    """The marks of a table with it between them."""
    return place[1] + table + place[2]


def page(text: str) -> str:
    """The page with its tables written anew between their marks."""
    for name, table in (("sites", sites()), ("quantities", rows(QUANTITIES)), ("camera", rows(CAMERA))):
        marks = rf"(<!-- {name}: [^\n]*-->\n).*?(<!-- end -->)"
        text, found = re.subn(marks, partial(_filled, table), text, flags=re.DOTALL)
        if found != 1:
            raise SystemExit(f"{PAGE}: has no place for the table of {name}")
    return text


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
