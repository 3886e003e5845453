"""Makes the recordings of cases/paper_story anew: `.venv/bin/python docs/paper_story.py` (45 minutes)."""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path

import xarray as xr

import flashtemp
from flashtemp.comparison.synthetic_campaign import SEALED_TRUTH, SyntheticPlan, make_synthetic_campaign

CASE = Path(__file__).parents[1] / "cases" / "paper_story"
HIDDEN = {"effects": ["edge_pressure"], "edge_pressure.B": 2.0, "edge_pressure.length": 4e-3}
ACROSS = {"numerics.across": 60, "numerics.first_y": 3e-5}  # the wall is resolved, no guess of what 2D judges
NAMES = {"condition1": "p015", "condition2": "p0075"}


def main() -> None:
    """A twin in 3D with a peak at the leading edge, two frames a repetition, in the place of the recordings there."""
    plan = SyntheticPlan(("edge_pressure",), seed=310, conditions=2, sliding=2, waiting=0)
    with tempfile.TemporaryDirectory() as folder:
        made = make_synthetic_campaign(flashtemp.load(CASE, HIDDEN | ACROSS), plan, Path(folder) / "lab", print)
        print(json.dumps(json.loads((made / SEALED_TRUTH).read_text())["hidden"]))
        for file in made.glob("condition*"):
            number, kind = file.name.split("_", 1)
            kept = CASE / "measured" / f"{NAMES[number]}_{kind}"
            if kind.endswith(".csv"):
                shutil.copy(file, kept)
                continue
            with xr.open_dataset(file, engine="h5netcdf") as frames:  # to 10 mK: a camera's counts, and small files
                frames.load().assign(temperature=frames.temperature.round(2)).to_netcdf(
                    kept, engine="h5netcdf", encoding={"temperature": {"zlib": True, "complevel": 9}}
                )


if __name__ == "__main__":
    main()
