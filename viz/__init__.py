"""Pictures of finished results: one per file, each a function that returns a figure."""

if __name__ != "flashtemp.viz":
    raise ImportError("import flashtemp.viz, not viz: a second copy breaks isinstance")

from pathlib import Path

PICTURES = {"profile": "profile", "film": "map", "field": "field", "friction": "friction", "budget": "budget"}


def draw_all(run, folder) -> list[Path]:
    """Draw every picture of a run into a folder that exists: profile, map, field, friction, budget as .png."""
    from importlib import import_module

    out = []
    for module, name in PICTURES.items():
        out.append(Path(folder) / f"{name}.png")
        import_module(f"flashtemp.viz.{module}").draw(run).savefig(out[-1], dpi=160)
    return out
