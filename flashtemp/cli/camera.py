"""Commands on what a camera saw: files -> one recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from flashtemp.camera.import_options import Facts
from flashtemp.cli.terminal import DONE, Json, Switch, emit, tell
from flashtemp.errors import BadInput


def import_(
    *files: str,
    out: Path | None = None,
    template: Annotated[bool, Switch] = False,
    overwrite: Annotated[bool, Switch] = False,
    facts: Annotated[Facts, Parameter(name="*", negative=(), consume_multiple=True)] = Facts(),  # noqa: B008 (frozen)
    json: Json = False,
) -> int:
    """Camera files -> one recording (NetCDF), and a picture beside it that shows where the block lies.

    Parameters
    ----------
    files
        Camera files, a folder of them, patterns in quotes, or one recording template (.toml).
    out
        The recording to write, .nc.
    template
        Print a commented recording template.
    overwrite
        Replace a recording that exists.
    """
    from flashtemp.camera import import_options as templates
    from flashtemp.camera import importing

    if template:
        print(templates.commented())
        return DONE
    names, folder = list(files), Path()
    if len(names) == 1 and names[0].endswith(".toml"):
        folder = Path(names[0]).parent
        names, own, said = templates.load(Path(names[0]))
        out, facts = out or (None if own is None else Path(own)), facts.over(said)
    target = _target(out, overwrite)
    result = importing.recorded(importing.found(names, folder), facts, tell)
    for note in result.notes:
        tell(note)
    result.recording.save(target)
    picture = _picture(result, target)
    answer = result.as_dict() | {"recording": str(target), "picture": str(picture) if picture else None}
    where = f"\n  in {target}" + (f", registration in {picture}" if picture else "")
    emit(answer, json, str(result.recording) + where)
    return DONE


def _target(out: Path | None, overwrite: bool) -> Path:
    """Where the recording goes; BadInput where it cannot."""
    if out is None:
        raise BadInput("out: missing; give --out RECORDING.nc")
    if out.suffix != ".nc":
        raise BadInput(f"{out}: a recording is NetCDF; give a name that ends in .nc")
    if out.exists() and not overwrite:
        raise BadInput(f"{out}: exists already; add --overwrite or choose another name")
    if (picture := out.with_suffix(".png")).exists() and not overwrite:
        raise BadInput(f"{picture}: exists already; add --overwrite or choose another name for the recording")
    if not out.parent.is_dir():
        raise BadInput(f"{out}: no folder {out.parent}; give a folder that exists")
    return out


def _picture(result, target: Path) -> Path | None:
    """The registration picture beside the recording; a profile or a single row of pixels has none."""
    if result.recording.view == "profile" or min(len(result.recording.u), len(result.recording.v)) < 2:
        return None
    from flashtemp.viz.registration import draw

    picture = target.with_suffix(".png")
    fresh = picture.with_name(picture.name + ".new")
    try:
        draw(result.recording, result.block).savefig(fresh, format="png")
        fresh.replace(picture)
    finally:
        fresh.unlink(missing_ok=True)
    return picture
