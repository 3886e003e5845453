"""Thin the published tables: `python thin.py Black-Insulation_q50_Temp.csv Black-Copper_q50_Temp.csv`.

The board every 2 s up to 120 s, every 10 s after; the copper disc every 2 s; degC instead of K; nothing is smoothed.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
EARLY, FITTED = 120, 600  # s


def main(board: str, copper: str) -> None:
    """Write face, middle and back of the board, all three together, and the back of the copper disc."""
    table = np.genfromtxt(copper, delimiter=",", skip_header=2)
    even = table[:, 0] % 2 == 0
    _write("copper", "time_s,degC", table[even, 0], table[even, 1:2] - 273.15)
    _of_board(board)


def _of_board(source: str) -> None:
    table = np.genfromtxt(source, delimiter=",", skip_header=2)
    time = table[:, 0]
    table = table[((time <= EARLY) & (time % 2 == 0)) | (time % 10 == 0)]
    time, T = table[:, 0], table[:, 1:4] - 273.15
    uncertain = table[:, 4:7]
    print("median of the published Uc (two standard deviations of the mean of three), K:", np.median(uncertain, axis=0))
    for name, column in (("face", 0), ("back", 2)):
        _write(name, "time_s,degC", time, T[:, [column]])
    even = time % 10 == 0
    parts = {"0_120": time <= EARLY, "120_600": (time > EARLY) & (time <= FITTED), "600_1200": time > FITTED}
    for name, rows in parts.items():
        _write(f"middle_{name}", "time_s,degC", time[rows & even], T[rows & even][:, [1]])
    _write("stack", "time_s,degC_5.72mm,degC_11.44mm,degC_17.16mm", time[even], T[even])


def _write(name: str, header: str, time: np.ndarray, values: np.ndarray) -> None:
    rows = [",".join([f"{t:g}", *(f"{v:.2f}" for v in row)]) for t, row in zip(time, values, strict=True)]
    (HERE / f"{name}.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:3])
