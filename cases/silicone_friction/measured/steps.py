"""Write the load steps as load-cell traces: `python steps.py CoF-Measurements.csv`.

One row per cycle: the middle of the cycle in s (cycles counted as 1 s), and the friction coefficient averaged over it.
A cycle is left out where friction scatters within it more than twice as much as in the median cycle of its step: it
holds the start from rest.
"""

import csv
import statistics
import sys
from pathlib import Path

HERE = Path(__file__).parent
TEST = "Nanotribometer DragonSkin10"
FACE_MM2 = 16.0  # plate of 4 mm x 4 mm
PRESSURES_KPA = (5, 10, 15, 20, 25, 30, 35, 40)
LARGEST_SCATTER = 2.0  # of the median within-cycle standard deviation


def main(source: str) -> None:
    """Write mu_NkPa.csv for every pressure and print the median within-cycle standard deviation."""
    with open(source, newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["DataName"] == TEST]
    for pressure in PRESSURES_KPA:
        step = [row for row in rows if float(row["NominalLoad"]) == pressure * FACE_MM2]
        cycles = sorted((int(row["CycleID"]), float(row["CoF.mean"]), float(row["CoF.sd"])) for row in step)
        usual = statistics.median(sd for _, _, sd in cycles)
        kept = [(number, mean) for number, mean, sd in cycles if sd <= LARGEST_SCATTER * usual]
        lines = ["time_s,mu"] + [f"{number - 0.5:g},{mean:.4f}" for number, mean in kept]
        (HERE / f"mu_{pressure}kPa.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        print(f"{pressure} kPa: {len(kept)} of {len(cycles)} cycles, within-cycle standard deviation {usual:.3f}")


if __name__ == "__main__":
    main(sys.argv[1])
