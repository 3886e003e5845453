"""The command `new`: write a commented template file."""

from __future__ import annotations

from pathlib import Path

from flashtemp.cli.terminal import EXIT_DONE, Json, print_result


def new(kind: str, file: Path | None = None, /, *, json: Json = False) -> int:
    """Write a commented case, campaign or recording template.

    Parameters
    ----------
    kind
        Kind of template: case, campaign or recording.
    file
        File to write; case.toml, campaign.toml or recording.toml when not given.
    """
    from flashtemp.api import templates

    made = templates.new(kind, out=file or Path(f"{kind}.toml"))
    print_result(made.as_dict(), json, str(made))
    return EXIT_DONE
