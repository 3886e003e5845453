"""Before measuring: which effects planned views and conditions can tell apart, and which experiment to add."""

from __future__ import annotations


def advise(study, fit, alike) -> str:
    return ""
