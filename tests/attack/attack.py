"""The long attack: `make attack` runs every `long_*.py` beside this file and prints what was tried and what was clean.

    .venv/bin/python tests/attack/attack.py [--share 0.1] [--seed 18] [NAME...]

`--share` scales the number of tries; names choose classes by what their name contains.  A try is clean when nothing is
lost, no traceback is shown and every result is right.  The exit code is 1 when any try is not.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

SEED = 18


@dataclass
class Row:
    """A class of attacks: how many were tried, and what was not clean in words."""

    name: str
    tried: int = 0
    faults: list[str] = field(default_factory=list)
    outcomes: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0

    def count(self, outcome: str, fault: str = "") -> None:
        """One more try, with what came of it; `fault` says what was not clean."""
        self.tried += 1
        self.outcomes[outcome] = self.outcomes.get(outcome, 0) + 1
        if fault:
            self.faults.append(fault)

    def __str__(self) -> str:
        what = ", ".join(f"{n} {name}" for name, n in sorted(self.outcomes.items()))
        return f"| {self.name} | {self.tried} | {self.tried - len(self.faults)} | {what} | {self.seconds:.0f} |"


def classes(folder: Path) -> dict:
    """{name: function(row, seed, share)} of every `long_*.py`, by their CLASSES."""
    found = {}
    for file in sorted(folder.glob("long_*.py")):
        spec = importlib.util.spec_from_file_location(file.stem, file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        found |= module.CLASSES
    return found


def main() -> int:
    options = argparse.ArgumentParser()
    options.add_argument("names", nargs="*")
    options.add_argument("--share", type=float, default=1.0)
    options.add_argument("--seed", type=int, default=SEED)
    asked = options.parse_args()
    print(
        f"seed {asked.seed}, share {asked.share:g}\n\n| class | tried | clean | outcomes | s |\n|---|---|---|---|---|"
    )
    bad = []
    for name, function in classes(Path(__file__).parent).items():
        if asked.names and not any(word in name for word in asked.names):
            continue
        row, began = Row(name), time.monotonic()
        function(row, asked.seed, asked.share)
        row.seconds = time.monotonic() - began
        print(row, flush=True)
        bad += [f"{name}: {fault}" for fault in row.faults]
    print("\n" + "\n".join(bad) if bad else "\nall clean")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
