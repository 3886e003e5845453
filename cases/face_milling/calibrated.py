"""The campaign with what `flashtemp discover` calibrated put in: `python calibrated.py FOLDER/verdict.json`."""

import json
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent


def main(verdict: str) -> None:
    """Keys go into `with`, depths and time constants of thermocouples into their points."""
    found = json.loads(Path(verdict).read_text(encoding="utf-8"))["nuisance"]
    told = tomllib.loads((HERE / "campaign.toml").read_text(encoding="utf-8"))
    keys = [k for table, own in told["free"].items() for k in _keys(table, own)]
    given = ", ".join(f'"{k}" = {found[k]["value"]:.5g}' for k in keys)
    out = [
        "# What `flashtemp discover cases/face_milling` calibrated, put in by calibrated.py; nothing is fitted here.",
        'title = "face milling, as calibrated"',
        'case = "case.toml"',
    ]
    for entry in told["recording"]:
        out += ["", "[[recording]]", 'view = "points"', f'file = "{entry["file"]}"', "points = ["]
        for p in entry["points"]:
            z = p["z"] + found[f"place of point {p['name']} along z"]["value"]
            lag = max(p["lag_s"] + found[f"time constant of point {p['name']}"]["value"], 0.0)
            out.append(
                f'    {{ name = "{p["name"]}", x = {p["x"]:g}, y = {p["y"]:g}, z = {z:.5f}, lag_s = {lag:.3f} }},'
            )
        out += ["]", f"sigma_K = {entry['sigma_K']:g}", f"with = {{ {given} }}"]
    (HERE / "calibrated.toml").write_text("\n".join(out) + "\n", encoding="utf-8")


def _keys(table: str, own: object) -> list[str]:
    return [f"{table}.{k}" for k in own] if isinstance(own, dict) else [table]


if __name__ == "__main__":
    main(sys.argv[1])
