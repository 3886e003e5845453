"""Pictures of finished results: one per file, each a function that returns a figure; installed as flashtemp.viz."""

if __name__ != "flashtemp.viz":
    raise ImportError("import flashtemp.viz, not viz: a second copy breaks isinstance")

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from flashtemp.display import atomic_write
from flashtemp.errors import describe_exception

PICTURES = {
    "profile": "profile", "space_time": "map", "field": "field", "friction": "friction", "budget": "budget",
    "maps": "run_in", "worn": "worn",
    "width": "width", "spots": "spots",
}  # fmt: skip


def is_applicable(module: str, run) -> bool:
    """Whether a picture shows anything of a run; its module says so by a function of the same name."""
    return getattr(import_module(f"flashtemp.viz.{module}"), "applies", lambda run: True)(run)


def draw_all(run, folder, formats=("png",)) -> list[Path]:
    """Draw the pictures that apply to a run into a folder that exists, each as NAME.png (svg, pdf) of PICTURES."""
    out = []
    for module in PICTURES:
        out += _draw_still(run, Path(folder), module, formats)
    return out


def _draw_still(run, folder: Path, module: str, formats) -> list[Path]:
    if not is_applicable(module, run):
        return []
    from flashtemp.viz.theme import save_figure

    figure = import_module(f"flashtemp.viz.{module}").draw(run)
    return [save_figure(figure, folder / f"{PICTURES[module]}.{kind}") for kind in formats]


ANIMATIONS = {"animation": "run_in", "spots": "spots"}


def animate(run, folder) -> list[Path]:
    """Write the animations that apply to a run into a folder that exists, each as NAME.gif of ANIMATIONS."""
    return [path for module in ANIMATIONS for path in _write_animation(run, Path(folder), module)]


def _write_animation(run, folder: Path, module: str) -> list[Path]:
    if not is_applicable(module, run):
        return []
    with atomic_write(folder / f"{ANIMATIONS[module]}.gif") as fresh:
        import_module(f"flashtemp.viz.{module}").write(run, fresh)
    return [folder / f"{ANIMATIONS[module]}.gif"]


class PictureRequest(NamedTuple):
    """What one module of PICTURES or ANIMATIONS draws, and the formats that are wanted of it."""

    module: str
    formats: tuple[str, ...]


def requested_pictures(formats=("png",), animated=True) -> list[PictureRequest]:
    """All pictures, and then the animations, that a run may have."""
    still = [PictureRequest(module, tuple(formats)) for module in PICTURES]
    return still + [PictureRequest(module, ("gif",)) for module in ANIMATIONS if animated]


def draw_picture(run, folder, picture: PictureRequest) -> tuple[list[Path], dict[str, str]]:
    """Draw one of those `requested_pictures` if it can be: the files, and {what is missing: why}."""
    moving = picture.formats == ("gif",)
    name = (ANIMATIONS if moving else PICTURES)[picture.module]
    try:
        return (_write_animation(run, folder, picture.module) if moving else _draw_still(run, folder, *picture)), {}
    except Exception as fault:
        return [], {f"{name}.{kind}": describe_exception(fault) for kind in picture.formats}


def draw_each(run, folder, formats=("png",), animated=True) -> tuple[list[Path], dict[str, str]]:
    """Draw all that can be drawn: the files, and {what is missing: why}.  A picture that fails stops no other."""
    return merge_results(draw_picture(run, Path(folder), picture) for picture in requested_pictures(formats, animated))


def merge_results(answers: Iterable[tuple[list[Path], dict[str, str]]]) -> tuple[list[Path], dict[str, str]]:
    """All files, and all that is missing, of several that were `draw_picture`."""
    made: list[Path] = []
    missing: dict[str, str] = {}
    for files, faults in answers:
        made += files
        missing |= faults
    return made, missing
