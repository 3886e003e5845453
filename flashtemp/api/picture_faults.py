"""Errors while drawing: a picture that cannot be drawn never costs the result, which is already saved."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from flashtemp.errors import IncompleteResult, UserInterrupt, describe_exception

RERUN_ELSEWHERE_HINT = "the same command into another folder"


@contextmanager
def report_drawing_faults(result: Any, out: str | Path, what: str, again: str) -> Iterator[None]:
    """Context for drawing `what` of a result that is already saved in `out`; `again` is the command to draw it later.

    Raises IncompleteResult with the result where it cannot be drawn, UserInterrupt after Ctrl-C.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise UserInterrupt(Path(out), again, f"the result without {what}") from None
    except Exception as fault:
        raise IncompleteResult(
            f"missing in {out}: {what} ({describe_exception(fault)}); draw again with: {again}", result
        ) from fault
