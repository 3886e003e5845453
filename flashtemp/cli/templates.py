"""The command that writes a file to begin with."""

from __future__ import annotations

from pathlib import Path

from flashtemp.cli.terminal import EXIT_DONE, Json, print_result


def new(kind: str, file: Path | None = None, /, *, json: Json = False) -> int:
    """A commented case, campaign or recording template to begin with.

    Parameters
    ----------
    kind
        case, campaign or recording.
    file
        Where to write it; case.toml, campaign.toml or recording.toml when not given.
    """
    from flashtemp.api import templates

    made = templates.new(kind, out=file or Path(f"{kind}.toml"))
    print_result(made.as_dict(), json, str(made))
    return EXIT_DONE
