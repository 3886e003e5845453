"""Pictures beside a result that is saved already: a fault among them costs the picture, never the result."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from flashtemp.errors import IncompleteResult, UserInterrupt, describe_exception

RERUN_ELSEWHERE_HINT = "the same command into another folder"


@contextmanager
def report_drawing_faults(result: Any, out: str | Path, what: str, again: str) -> Iterator[None]:
    """Draw `what` of a result whose numbers are in its folder, `out` at the end; `again` says how to draw it later.

    Raises Incomplete with the result where it cannot be drawn, Interrupted after Ctrl-C.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise UserInterrupt(Path(out), again, f"the result without {what}") from None
    except Exception as fault:
        raise IncompleteResult(
            f"missing in {out}: {what} ({describe_exception(fault)}); for it: {again}", result
        ) from fault
