"""The result of one check of an effect."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """The name of a check, whether it passed, and a sentence: the result, or the place of the error and its remedy."""

    name: str
    ok: bool
    says: str


def make_finding(name: str, faults: list[str], good: str) -> Finding:
    """A passed check with the sentence `good`, or a failed one with the first three `faults`.

    >>> make_finding("units", [], "all parameters have units").ok
    True
    """
    more = f" (and {len(faults) - 3} more)" if len(faults) > 3 else ""
    return Finding(name, not faults, "; ".join(faults[:3]) + more if faults else good)
