"""Pages generated from the code: commands, keys of a case, catalogue of effects, quantities, gallery, two drawings."""

from __future__ import annotations

import re
from pathlib import Path

import architecture
import discovery_chart
import gallery

import flashtemp
from flashtemp.api.effects import format_parameter
from flashtemp.api.templates import NAMED_TABLE_MEANINGS, describe_param, example_line
from flashtemp.cli.commands import app
from flashtemp.model.schema import CASE_TABLES, NAMED_TABLES, declared_params
from flashtemp.physics.quantities import CAMERA_QUANTITIES, QUANTITIES, SITES

MADE = "made"  # folder of the generated pages, next to the others; not kept


def commands() -> str:
    """Every command with its arguments and options, as `--help` prints them."""
    text = app.generate_docs(output_format="markdown", heading_level=2)
    _, first, rest = text.partition("## flashtemp new")
    lead = "*A reference: every command, as `flashtemp COMMAND --help` describes it.*\n\n"
    return "# Commands\n\n" + lead + first + re.sub(r"\n## `?--install-completion.*", "\n", rest, flags=re.DOTALL)


def keys() -> str:
    """Every key of a case with default, meaning, unit and range."""
    out = "# Keys of a case\n\n*A reference: every key with its default, as `flashtemp new case` writes it.*\n"
    named = {
        f"{kind}.NAME": (f"{NAMED_TABLE_MEANINGS[kind].capitalize()}.\n\n", keys) for kind, keys in NAMED_TABLES.items()
    }
    for table, (lead, keys) in ({t: ("", declared_params(t)) for t in CASE_TABLES} | named).items():
        rows = "".join(f"| `{example_line(k, p)}` | {_cell(describe_param(p))} |\n" for k, p in keys.items())
        out += f"\n## [{table}]\n\n{lead}| key and default | meaning; unit, range |\n|---|---|\n{rows}"
    return out


def catalogue() -> str:
    """Every effect: cause, keys, distinguishing features, source."""
    out = [
        "# Catalogue of effects\n\n*A reference, generated from the files of the effects.*"
        "\n\nEffects that always act come first.  [Write your own effect](../how_to/effects.md) adds one.\n"
    ]
    for e in flashtemp.effects().entries:
        source = re.sub(r"theory (?=\d\.\d)", "[theory](../explanation/theory.md) ", e["source"])
        always = " (always acts)" if e["always"] else ""
        lines = [f"- `{head}`: {tail}" for head, tail in (format_parameter(p).split(": ", 1) for p in e["parameters"])]
        shows = f"\nDistinguished by: {'; '.join(e['tells'])}\n" if e["tells"] else ""
        out.append(f"## {e['name']}{always}\n\n{e['cause']}.\n\n" + "\n".join(lines) + f"\n{shows}\nSource: {source}\n")
    return "\n".join(out)


def quantities() -> str:
    """Quantities of the balance that an effect may change, what its law reads, and the sites of heat."""
    kind = {True: "zone", False: "patch, film"}
    places = "".join(f"| `{s.name}` | {kind[s.zone]} | {s.about} |\n" for s in SITES.values())
    head = "| quantity | unit of a term | before | meaning | its law also reads |\n|---|---|---|---|---|\n"
    balance, camera = (
        head + "".join(f"| `{q.name}` | {q.unit} | {q.base} | {q.about} | {q.sees} |\n" for q in rows.values())
        for rows in (QUANTITIES, CAMERA_QUANTITIES)
    )
    return (
        "# Quantities and sites\n\n*A reference: what an [effect](../how_to/effects.md) may change, and where heat "
        f"enters.*\n\n## Quantities of the balance\n\n{balance}\n## Quantities of the camera\n\n{camera}"
        f"\n## Sites\n\n| site | of | where |\n|---|---|---|\n{places}"
    )


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def write(folder: Path) -> None:
    """Write all of them into the folder `made` of the documentation's."""
    made = folder / MADE
    made.mkdir(exist_ok=True)
    pages = {
        "commands.md": commands(), "keys.md": keys(), "catalogue.md": catalogue(), "gallery.md": gallery.page(),
        "quantities.md": quantities(),
        "architecture.svg": architecture.draw(), "discovery.svg": discovery_chart.draw(),
    }  # fmt: skip
    for name, text in pages.items():
        file = made / name
        if not file.exists() or file.read_text(encoding="utf-8") != text:  # what is unchanged is not built again
            file.write_text(text, encoding="utf-8")
