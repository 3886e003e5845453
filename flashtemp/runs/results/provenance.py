"""Which programs made a result: their versions, and the commit of this one where it is known."""

from __future__ import annotations

import platform
import re
import subprocess
from functools import cache
from importlib.metadata import version
from pathlib import Path

CHECKOUT_FOLDER = Path(__file__).parents[3]
BINDING_PACKAGES = {"scikits-odes": "scikits-odes-sundials", "scikit-sundae": "scikit-sundae"}


def package_versions(binding: str) -> dict[str, str]:
    """Versions of everything that had a hand in the result."""
    names = ("flashtemp", "numpy", "scipy", "numba", BINDING_PACKAGES[binding])
    return {"python": platform.python_version(), **{n: version(n) for n in names}}


@cache
def source_commit() -> str | None:
    """The commit of the checkout that runs, with "-dirty" where files differ from it, or of the build."""
    built = re.search(r"\+g([0-9a-f]{7,})", version("flashtemp"))
    return _describe_checkout() or (built[1] if built else None)


def _describe_checkout() -> str | None:
    if not (CHECKOUT_FOLDER / ".git").exists():
        return None
    words = ["git", "-C", str(CHECKOUT_FOLDER), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        told = subprocess.run(words, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
    return told or None
