"""Provenance of a result: versions of the programs, and the commit of flashtemp where it is known."""

from __future__ import annotations

import hashlib
import platform
import re
import subprocess
from functools import cache
from importlib.metadata import version
from pathlib import Path

CHECKOUT_FOLDER = Path(__file__).parents[3]
BINDING_PACKAGES = {"scikits-odes": "scikits-odes-sundials", "scikit-sundae": "scikit-sundae"}


def package_versions(binding: str) -> dict[str, str]:
    """Versions of Python and of the packages that computed the result."""
    names = ("flashtemp", "numpy", "scipy", "numba", BINDING_PACKAGES[binding])
    return {"python": platform.python_version(), **{n: version(n) for n in names}}


@cache
def source_commit() -> str | None:
    """The commit of the running checkout, with "-dirty" where files differ from it, or that of the build."""
    built = re.search(r"\+g([0-9a-f]{7,})", version("flashtemp"))
    return _describe_checkout() or (built[1] if built else None)


def _describe_checkout() -> str | None:
    if not (CHECKOUT_FOLDER / ".git").exists():
        return None
    words = ["git", "-C", str(CHECKOUT_FOLDER), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        commit = subprocess.run(words, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
    return commit or None


def digest_file(path: Path) -> str:
    """SHA-256 digest of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
