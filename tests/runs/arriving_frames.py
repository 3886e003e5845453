"""A synthetic campaign whose frames are text images, which a test copies into the watched folder one by one."""

from __future__ import annotations

import shutil
from pathlib import Path

import flashtemp
from flashtemp.camera import recording

CASE = Path(__file__).parents[2] / "cases" / "uniform_pressure"
SHORT = {"schedule.distance": 0.2, "schedule.repetitions": 2, "numerics.mesh": 0.4}
TRIED = 'candidates = ["pressure_tilt", "heat_depth"]\n'


def measure_frames(folder: Path) -> Path:
    """Write into a folder a side wall with a hidden tilt (`twin`), its `frames`, and template and times of them."""
    flashtemp.twin(CASE, SHORT, hide=["pressure_tilt"], seed=1, out=folder / "twin", conditions=1, views=["sidewall"])
    r = recording.load(folder / "twin" / "condition1_sidewall.nc")
    (folder / "frames").mkdir()
    for k, T in enumerate(r.temperature):
        text = "\n".join(";".join(f"{x:.3f}" for x in row) for row in T[::-1])
        (folder / "frames" / f"img{k}.csv").write_text(text + "\n")
    rows = zip(range(r.frames), r.time.tolist(), r.repetition.tolist(), strict=True)
    (folder / "times.csv").write_text("file,time,repetition\n" + "".join(f"img{k}.csv,{t},{n}\n" for k, t, n in rows))
    column, row = float(-r.u[0] / r.pitch[0]), float(len(r.v) - 1 + r.v[0] / r.pitch[1])
    (folder / "side.toml").write_text(
        'files = ["incoming/img*.csv"]\nout = "condition1_sidewall.nc"\nview = "sidewall"\ndownstream = "right"\n'
        f'pixel = [{column}, {row}]\nmm_per_pixel = {1e3 * float(r.pitch[0])}\ntimes = "times.csv"\nnetd = 0.05\n'
        f"psf_sigma = {r.psf_sigma_px}\nregistration_sigma = {r.registration_sigma_px}\n"
    )
    return folder


def make_campaign(measured: Path, folder: Path) -> Path:
    """Write a campaign without its recording, and the empty folder `incoming` of its camera files."""
    (folder / "incoming").mkdir(parents=True)
    for name in ("campaign.toml", "case.toml", "condition1_mu.csv"):
        shutil.copy(measured / "twin" / name, folder)
    for name in ("side.toml", "times.csv"):
        shutil.copy(measured / name, folder)
    (folder / "campaign.toml").write_text(TRIED + (folder / "campaign.toml").read_text())
    return folder
