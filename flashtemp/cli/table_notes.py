"""What was left out of or assumed in tables that a case names, told once on stderr at the end of a command."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from flashtemp.cli.exit_codes import print_message
from flashtemp.errors import BadInput
from flashtemp.physics.interpolation import TABLE_LOGGER


class _Collector(logging.Handler):
    """A handler that keeps every message once, in their order."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.messages: dict[str, None] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a message that is new."""
        self.messages[record.getMessage()] = None


@contextmanager
def table_notes() -> Iterator[None]:
    """Notes on the tables read while it lasts, on stderr at its end; none where the input is refused."""
    logger = logging.getLogger(TABLE_LOGGER)
    handler, level = _Collector(), logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    is_refused = False
    try:
        yield
    except BadInput:
        is_refused = True
        raise
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        for message in () if is_refused else handler.messages:
            print_message(message)
