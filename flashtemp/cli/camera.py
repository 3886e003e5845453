"""The command on what a camera saw: import, from its files to one recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.import_request import ImportRequest
from flashtemp.cli.terminal import EXIT_DONE, Json, Switch, print_message, print_result
from flashtemp.errors import BadInput


def import_(
    *files: str,
    out: Path | None = None,
    look: Annotated[bool, Switch] = False,
    template: Annotated[bool, Switch] = False,
    overwrite: Annotated[bool, Switch] = False,
    facts: Annotated[ImportOptions, Parameter(name="*", negative=(), consume_multiple=True)] = ImportOptions(),  # noqa: B008 (frozen)
    json: Json = False,
) -> int:
    """Camera files -> one recording (NetCDF), and a picture beside it that shows where the block lies.

    Parameters
    ----------
    files
        Camera files, a folder of them, patterns in quotes, or one recording template (.toml).
    out
        The recording to write, .nc; of --look the picture, .png.
    look
        Only draw what is in the files, with pixels, clock, object parameters and ranges; nothing need be known.
    template
        Print a commented recording template.
    overwrite
        Replace a file that exists.
    """
    from flashtemp.api import camera
    from flashtemp.camera.importing.import_request import expand_patterns
    from flashtemp.camera.importing.recording_import import missing_options

    if template:
        print(camera.recording_template())
        return EXIT_DONE
    asked = ImportRequest.from_files(files, facts, out)
    if look:
        picture = out or Path(f"{Path(asked.files[0]).name if asked.files else 'files'}.look.png")
        seen = camera.inspect_files(asked, out=picture, overwrite=overwrite, say=print_message)
        print_result(seen.as_dict(), json, str(seen))
        return EXIT_DONE
    if asked.out is None:
        raise BadInput(
            "out: missing; give --out RECORDING.nc", *missing_options(expand_patterns(asked.files), asked.facts)
        )
    result = camera.import_recording(asked, overwrite=overwrite, say=print_message)
    for note in result.notes:
        print_message(note)
    print_result(result.as_dict(), json, str(result))
    return EXIT_DONE
