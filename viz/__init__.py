"""Pictures and animations of finished results, each in a module of its own; installed as flashtemp.viz.

A module of viz/run that sets `PICTURE = "NAME"` draws NAME.png of a run; one that sets `ANIMATION = "NAME"` writes
NAME.gif.  They are found by that line when the first picture is requested, and listed nowhere else.
"""

if __name__ != "flashtemp.viz":
    raise ImportError("import flashtemp.viz, not viz: a second copy breaks isinstance")

import pkgutil
import re
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from flashtemp.display import atomic_write
from flashtemp.errors import describe_exception, warn_renamed
from flashtemp.viz import run as run_modules


def find_pictures(constant: str) -> dict[str, str]:
    """{module of viz/run: file name without its ending} of the modules that set `constant` at their top level.

    The text is read and nothing imported: matplotlib loads only when something is drawn, and a module that cannot be
    imported costs its own picture alone.
    """
    declaration = re.compile(rf'^{constant} = "(\w+)"', re.MULTILINE)
    texts = {
        module.name: (Path(folder) / f"{module.name}.py").read_text(encoding="utf-8")
        for folder in run_modules.__path__
        for module in pkgutil.iter_modules([folder])
    }
    return {module: match[1] for module, text in sorted(texts.items()) if (match := declaration.search(text))}


@cache
def list_pictures() -> dict[str, str]:
    """{module of viz/run: picture} of all pictures of a run."""
    return find_pictures("PICTURE")


@cache
def list_animations() -> dict[str, str]:
    """{module of viz/run: animation} of all animations of a run."""
    return find_pictures("ANIMATION")


def is_applicable(module: str, run) -> bool:
    """Whether a module of viz/run has something to show of a run: its `applies(run)`, or True where it has none."""
    return getattr(import_module(f"{run_modules.__name__}.{module}"), "applies", lambda run: True)(run)


def draw_all(run, folder, formats=("png",)) -> list[Path]:
    """Draw the pictures that apply to a run into a folder that exists, each as NAME.png (svg, pdf)."""
    return [path for module in list_pictures() for path in _draw_still(run, Path(folder), module, formats)]


def _draw_still(run, folder: Path, module: str, formats) -> list[Path]:
    if not is_applicable(module, run):
        return []
    from flashtemp.viz.theme import save_figure

    figure = import_module(f"{run_modules.__name__}.{module}").draw(run)
    return [save_figure(figure, folder / f"{list_pictures()[module]}.{kind}") for kind in formats]


def animate(run, folder) -> list[Path]:
    """Write the animations that apply to a run into a folder that exists, each as NAME.gif."""
    return [path for module in list_animations() for path in _write_animation(run, Path(folder), module)]


def _write_animation(run, folder: Path, module: str) -> list[Path]:
    if not is_applicable(module, run):
        return []
    with atomic_write(folder / f"{list_animations()[module]}.gif") as unfinished:
        import_module(f"{run_modules.__name__}.{module}").write(run, unfinished)
    return [folder / f"{list_animations()[module]}.gif"]


class PictureRequest(NamedTuple):
    """A module of viz/run and the formats to write; formats ("gif",) request its animation."""

    module: str
    formats: tuple[str, ...]


def requested_pictures(formats=("png",), animated=True) -> list[PictureRequest]:
    """Requests for all pictures and then, if `animated`, for all animations."""
    still = [PictureRequest(module, tuple(formats)) for module in list_pictures()]
    return still + ([PictureRequest(module, ("gif",)) for module in list_animations()] if animated else [])


def draw_picture(run, folder, picture: PictureRequest) -> tuple[list[Path], dict[str, str]]:
    """Draw one request if it applies: the files written, and {missing file: reason}."""
    moving = picture.formats == ("gif",)
    name = (list_animations() if moving else list_pictures())[picture.module]
    try:
        return (_write_animation(run, folder, picture.module) if moving else _draw_still(run, folder, *picture)), {}
    except Exception as fault:
        return [], {f"{name}.{kind}": describe_exception(fault) for kind in picture.formats}


def draw_each(run, folder, formats=("png",), animated=True) -> tuple[list[Path], dict[str, str]]:
    """Draw all that applies: the files written, and {missing file: reason}.  A picture that fails stops no other."""
    return merge_results(draw_picture(run, Path(folder), picture) for picture in requested_pictures(formats, animated))


def merge_results(results: Iterable[tuple[list[Path], dict[str, str]]]) -> tuple[list[Path], dict[str, str]]:
    """Merge the results of several `draw_picture` calls."""
    written: list[Path] = []
    missing: dict[str, str] = {}
    for files, faults in results:
        written += files
        missing |= faults
    return written, missing


RENAMED_MODULES = {  # of earlier releases: still found, with one warning
    "budget": "run.budget", "comparison": "measurement.comparison", "field": "run.field", "friction": "run.friction",
    "maps": "run.run_in_maps", "profile": "run.profile", "space_time": "run.space_time", "spots": "run.spots",
    "width": "run.width_maps", "worn": "run.wear_profile",
}  # fmt: skip


def __getattr__(name: str):
    if name not in RENAMED_MODULES:
        raise AttributeError(f"module 'flashtemp.viz' has no attribute '{name}'")
    warn_renamed(f"flashtemp.viz.{name}", f"flashtemp.viz.{RENAMED_MODULES[name]}")
    return import_module(f"flashtemp.viz.{RENAMED_MODULES[name]}")
