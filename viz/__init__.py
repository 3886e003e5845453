"""Pictures of finished results: one per file, each a function that returns a figure; installed as flashtemp.viz."""

if __name__ != "flashtemp.viz":
    raise ImportError("import flashtemp.viz, not viz: a second copy breaks isinstance")

from importlib import import_module
from pathlib import Path

PICTURES = {
    "profile": "profile", "space_time": "map", "field": "field", "friction": "friction", "budget": "budget",
    "maps": "run_in", "worn": "worn",
    "width": "width", "spots": "spots",
}  # fmt: skip


def applies(module: str, run) -> bool:
    """Whether a picture shows anything of a run; its module says so by a function of the same name."""
    return getattr(import_module(f"flashtemp.viz.{module}"), "applies", lambda run: True)(run)


def draw_all(run, folder) -> list[Path]:
    """Draw the pictures that apply to a run into a folder that exists, each as NAME.png of PICTURES."""
    out = []
    for module, name in PICTURES.items():
        if applies(module, run):
            out.append(Path(folder) / f"{name}.png")
            import_module(f"flashtemp.viz.{module}").draw(run).savefig(out[-1], dpi=160)
    return out


ANIMATIONS = {"animation": "run_in", "spots": "spots"}


def animate(run, folder) -> list[Path]:
    """Write the animations that apply to a run into a folder that exists, each as NAME.gif of ANIMATIONS."""
    found = [(module, Path(folder) / f"{name}.gif") for module, name in ANIMATIONS.items() if applies(module, run)]
    return [import_module(f"flashtemp.viz.{module}").write(run, path) for module, path in found]
