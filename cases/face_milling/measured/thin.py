"""Thin the published table to the rows of this folder: `python thin.py E1.txt`.

Every 100th row (1 s), nothing smoothed; thermocouples are shifted to show the same over the 10 s before the tool comes.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
RATE, BEFORE, FITTED = (
    100.0,
    10.0,
    125.0,
)  # 1/s; s before the tool comes; s that are fitted, 38 s of them after it has gone
NAMES = [f"T{n}" for n in range(1, 13) if n != 9]  # what T9 shows at rest is no constant of it: SOURCE.md


def main(source: str) -> None:
    """Write the pass, and the cooling after it."""
    T = np.delete(np.loadtxt(source)[:, :12], 8, axis=1)
    time = np.arange(len(T)) / RATE
    rest = T[time < BEFORE].mean(axis=0)
    print("at rest, degC:", dict(zip(NAMES, rest.round(2).tolist(), strict=True)))
    T, even = T - rest + np.median(rest), slice(0, None, int(RATE))
    T, time = T[even], time[even]
    for name, rows in {"pass": time <= FITTED, "after": time > FITTED}.items():
        lines = [",".join([f"{t:g}", *(f"{v:.3f}" for v in row)]) for t, row in zip(time[rows], T[rows], strict=True)]
        (HERE / f"{name}.csv").write_text("\n".join([",".join(["time_s", *NAMES]), *lines]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1])
