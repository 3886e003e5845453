"""One thing that was looked at in an effect, and what was found, in a plain sentence."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """What was looked at, whether all is well, and a sentence: what was seen, or where it fails and the remedy."""

    name: str
    ok: bool
    says: str


def make_finding(name: str, faults: list[str], good: str) -> Finding:
    """All is well where there are no faults; else the first few of them.

    >>> make_finding("units", [], "all parameters have units").ok
    True
    """
    more = f" (and {len(faults) - 3} more)" if len(faults) > 3 else ""
    return Finding(name, not faults, "; ".join(faults[:3]) + more if faults else good)
