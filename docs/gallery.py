"""The gallery: every ready case with its command and a picture, drawn by running it.

.venv/bin/python docs/gallery.py            all of them, about ten minutes
.venv/bin/python docs/gallery.py run_in     those that are named
"""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parent.parent
PICTURES = ROOT / "docs" / "pictures" / "gallery"
WIDTH = 900  # px of a picture


@dataclass(frozen=True)
class Shown:
    """What is shown of a case: the command without `--out`, the picture that it leaves, and about how long it takes."""

    command: str
    picture: str
    takes: str = "seconds"


CASES = {
    "uniform_pressure": Shown("run cases/uniform_pressure", "profile.png"),
    "run_in": Shown("run cases/run_in", "run_in.png"),
    "chosen_peak": Shown("run cases/chosen_peak", "worn.png"),
    "edge_peak": Shown("run cases/edge_peak", "field.png"),
    "worn_flat": Shown("run cases/worn_flat", "profile.png"),
    "backward": Shown("run cases/backward", "field.png"),
    "forward_backward": Shown("run cases/forward_backward", "worn.png"),
    "speed_step": Shown("run cases/speed_step", "friction.png"),
    "speed_sweep": Shown("sweep cases/speed_sweep schedule.speed=0.05,0.1,0.2,0.5,1", "sweep.png"),
    "theory_values": Shown("run cases/theory_values", "profile.png"),
    "alpha_sensitivity": Shown("sweep cases/alpha_sensitivity contact.alpha=3e3,1e4,3e4,1e5", "sweep.png"),
    "orientation": Shown("run cases/orientation", "map.png"),
    "slide2d": Shown("run cases/slide2d", "budget.png"),
    "slide3d": Shown("run cases/slide3d", "width.png", "half a minute"),
    "resolved_spots": Shown("run cases/resolved_spots", "spots.png", "three minutes"),
    "paper_story": Shown("discover cases/paper_story", "missing.png", "some minutes"),
    "heated_board": Shown("discover cases/heated_board", "what_is_wrong.png", "a minute"),
    "face_milling": Shown("run cases/face_milling", "map.png", "half a minute"),
    "pmma_heating": Shown("run cases/pmma_heating", "map.png"),
    "silicone_friction": Shown("discover cases/silicone_friction", "why.png", "a minute"),
    "slope_tester": Shown("friction cases/slope_tester", "friction.png"),
    "smooth_adhesion": Shown("run cases/smooth_adhesion", "profile.png"),
    "mu_of_p": Shown("loads cases/mu_of_p", "loads.png", "two minutes"),
    "tread_block": Shown("tread cases/tread_block", "tread.png", "a minute"),
    "tyre": Shown("tyre cases/tyre", "tyre.png", "a minute"),
}  # fmt: skip


def draw(name: str) -> None:
    """Run a case and keep its picture."""
    from PIL import Image

    with TemporaryDirectory() as folder:
        out, shown = Path(folder) / "out", CASES[name]
        words = [sys.executable, "-m", "flashtemp", *shown.command.split(), "--out", str(out)]
        subprocess.run(words, cwd=ROOT, check=True, capture_output=True)
        with Image.open(out / shown.picture) as picture:
            width = min(WIDTH, picture.width)
            small = picture.convert("RGB").resize((width, round(picture.height * width / picture.width)))
            PICTURES.mkdir(parents=True, exist_ok=True)
            small.quantize(256).save(PICTURES / f"{name}.png", optimize=True)


def told() -> dict[str, str]:
    """What every case shows, from the table of cases/README.md."""
    table = (ROOT / "cases" / "README.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^\| `(\w+)` \| ([^|]+?) \|", table, re.MULTILINE))


def page() -> str:
    """The page in Markdown, beside the folder of the other pages."""
    lead = "*A reference: every ready case of `cases/`, with the command that draws its picture.*"
    out = [f"# Gallery\n\n{lead}\n"]
    for name, says in told().items():
        shown = CASES[name]
        wait = f"  (takes {shown.takes})" if shown.takes != "seconds" else ""
        out.append(f"## {name}\n\n{says[0].upper()}{says[1:]}.\n\n    flashtemp {shown.command}{wait}\n\n"
                   f"![{says}](../pictures/gallery/{name}.png)\n")  # fmt: skip
    return "\n".join(out)


if __name__ == "__main__":
    for chosen in sys.argv[1:] or CASES:
        print(chosen, flush=True)
        draw(chosen)
