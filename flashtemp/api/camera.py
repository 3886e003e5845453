"""Import of camera files: preview them, or combine them into one recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from flashtemp.api.inputs import Say, ignore_message
from flashtemp.api.picture_faults import report_drawing_faults
from flashtemp.camera.importing import import_options, recording_import
from flashtemp.camera.importing.file_preview import FilePreview, preview_files
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.import_request import ImportRequest, expand_patterns, output_path
from flashtemp.camera.importing.recording_import import ImportResult
from flashtemp.errors import BadInput, suggest_name


def import_recording(
    files: str | Path | Sequence[str | Path] | ImportRequest,
    *,
    out: str | Path | None = None,
    overwrite: bool = False,
    say: Say = ignore_message,
    **facts: Any,
) -> ImportResult:
    """Import camera files, a folder, patterns, or one recording template (.toml) as one recording.

    `facts` supply what the files do not contain, by the names of the template, such as view="sidewall",
    pixel=(12, 200) or start=0.0.  `out` is the .nc file to write, together with a picture of the registration; when
    not given, the file that a template names is written, if any.
    Raises BadInput with one line for every missing entry.
    """
    if isinstance(files, ImportRequest):
        request = files
    else:
        names = [files] if isinstance(files, (str, Path)) else files
        request = ImportRequest.from_files(
            [str(name) for name in names], _make_facts(facts), None if out is None else Path(out)
        )
    target = None if request.out is None else output_path(request.out, overwrite)
    result = recording_import.import_recording(
        expand_patterns(request.files), request.facts, say, None if target is None else target.parent
    )
    if target is None:
        return result
    result.recording.save(target)
    saved = replace(result, saved=target)
    with report_drawing_faults(
        saved, target.parent, target.with_suffix(".png").name, "the same command with --overwrite"
    ):
        return replace(saved, picture=draw_registration(result, target))


def inspect_files(
    files: str | Path | Sequence[str | Path] | ImportRequest,
    *,
    out: str | Path | None = None,
    overwrite: bool = False,
    say: Say = ignore_message,
    **facts: Any,
) -> FilePreview:
    """Preview camera files without any required input: pixels, clock, object parameters and ranges.

    `out` is a PNG file to draw them into.  `facts` say how numbers are read where the file does not: unit, scale,
    offset, variable...  Raises BadInput.
    """
    if isinstance(files, ImportRequest):
        request = files
    else:
        names = [files] if isinstance(files, (str, Path)) else files
        request = ImportRequest.from_files([str(name) for name in names], _make_facts(facts))
    picture = None if out is None else _check_picture_path(Path(out), overwrite)
    preview = preview_files(expand_patterns(request.files), request.facts, say, counts=True)
    if picture is None:
        return preview
    from flashtemp.viz import theme
    from flashtemp.viz.measurement import raw_images

    return replace(preview, picture=theme.save_figure(raw_images.draw(preview), picture))


def _check_picture_path(picture: Path, overwrite: bool) -> Path:
    """The path of a picture.  Raises BadInput where it cannot be written."""
    if picture.suffix != ".png":
        raise BadInput(f"{picture}: a picture of camera files is PNG; give a name that ends in .png")
    if picture.exists() and not overwrite:
        raise BadInput(f"{picture}: exists already; add --overwrite or choose another name with --out")
    if not picture.parent.is_dir():
        raise BadInput(f"{picture}: folder {picture.parent} does not exist; give a folder that exists")
    return picture


def recording_template() -> str:
    """The text of a commented recording template (TOML) for `import_recording`."""
    return import_options.template_text()


def _make_facts(given: dict[str, Any]) -> ImportOptions:
    """Keywords as import options.  Raises BadInput for an unknown one."""
    for name in given:
        if name not in ImportOptions.__dataclass_fields__:
            raise BadInput(
                f"import_recording: {name}: unknown option{suggest_name(name, ImportOptions.__dataclass_fields__)}"
            )
    return ImportOptions(**given)


def draw_registration(result: ImportResult, target: Path) -> Path | None:
    """Draw the registration next to the recording; None for a profile or a single row of pixels."""
    recording = result.recording
    if recording.places is None and (recording.view == "profile" or min(len(recording.u), len(recording.v)) < 2):
        return None
    from flashtemp.viz import theme
    from flashtemp.viz.measurement import point_series, registration

    draw = registration.draw if recording.places is None else point_series.draw_recording
    picture = target.with_suffix(".png")
    theme.save_figure(draw(recording, result.block), picture)
    return picture
