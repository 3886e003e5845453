"""Pictures of finished results: one per file, each a function that returns a figure; installed as flashtemp.viz."""

if __name__ != "flashtemp.viz":
    raise ImportError("import flashtemp.viz, not viz: a second copy breaks isinstance")

from importlib import import_module
from pathlib import Path

from flashtemp.errors import reason
from flashtemp.showing import whole_file

PICTURES = {
    "profile": "profile", "space_time": "map", "field": "field", "friction": "friction", "budget": "budget",
    "maps": "run_in", "worn": "worn",
    "width": "width", "spots": "spots",
}  # fmt: skip


def applies(module: str, run) -> bool:
    """Whether a picture shows anything of a run; its module says so by a function of the same name."""
    return getattr(import_module(f"flashtemp.viz.{module}"), "applies", lambda run: True)(run)


def draw_all(run, folder, formats=("png",)) -> list[Path]:
    """Draw the pictures that apply to a run into a folder that exists, each as NAME.png (svg, pdf) of PICTURES."""
    out = []
    for module in PICTURES:
        out += _draw(run, Path(folder), module, formats)
    return out


def _draw(run, folder: Path, module: str, formats) -> list[Path]:
    if not applies(module, run):
        return []
    from flashtemp.viz.theme import save

    figure = import_module(f"flashtemp.viz.{module}").draw(run)
    return [save(figure, folder / f"{PICTURES[module]}.{kind}") for kind in formats]


ANIMATIONS = {"animation": "run_in", "spots": "spots"}


def animate(run, folder) -> list[Path]:
    """Write the animations that apply to a run into a folder that exists, each as NAME.gif of ANIMATIONS."""
    return [path for module in ANIMATIONS for path in _animate(run, Path(folder), module)]


def _animate(run, folder: Path, module: str) -> list[Path]:
    if not applies(module, run):
        return []
    with whole_file(folder / f"{ANIMATIONS[module]}.gif") as fresh:
        import_module(f"flashtemp.viz.{module}").write(run, fresh)
    return [folder / f"{ANIMATIONS[module]}.gif"]


def draw_each(run, folder, formats=("png",), animated=True) -> tuple[list[Path], dict[str, str]]:
    """Draw all that can be drawn: the files, and {what is missing: why}.  A picture that fails stops no other."""
    made: list[Path] = []
    missing: dict[str, str] = {}
    for module, name in PICTURES.items():
        try:
            made += _draw(run, Path(folder), module, formats)
        except Exception as fault:
            missing |= {f"{name}.{kind}": reason(fault) for kind in formats}
    for module, name in ANIMATIONS.items() if animated else ():
        try:
            made += _animate(run, Path(folder), module)
        except Exception as fault:
            missing[f"{name}.gif"] = reason(fault)
    return made, missing
