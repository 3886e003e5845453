"""The command `import`: camera files to one recording."""

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
    """Import camera files as one recording (NetCDF), with a picture that shows the block in the image.

    Parameters
    ----------
    files
        Camera files, a folder of them, patterns in quotes, or one recording template (.toml).
    out
        Recording to write, .nc; with --look the picture, .png.
    look
        Only preview the files: draw them, and print pixels, clock, object parameters and ranges.
    template
        Print a commented recording template.
    overwrite
        Replace an existing file.
    """
    from flashtemp.api import camera
    from flashtemp.camera.importing.import_request import expand_patterns
    from flashtemp.camera.importing.recording_import import missing_options

    if template:
        print(camera.recording_template())
        return EXIT_DONE
    request = ImportRequest.from_files(files, facts, out)
    if look:
        picture = out or Path(f"{Path(request.files[0]).name if request.files else 'files'}.look.png")
        preview = camera.inspect_files(request, out=picture, overwrite=overwrite, say=print_message)
        print_result(preview.as_dict(), json, str(preview))
        return EXIT_DONE
    if request.out is None:
        raise BadInput(
            "out: missing; give --out RECORDING.nc", *missing_options(expand_patterns(request.files), request.facts)
        )
    result = camera.import_recording(request, overwrite=overwrite, say=print_message)
    for note in result.notes:
        print_message(note)
    print_result(result.as_dict(), json, str(result))
    return EXIT_DONE
