"""Notes on the tables that a case names (rows skipped, units assumed), printed on stderr at the end of a command."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from flashtemp.cli.exit_codes import print_message
from flashtemp.errors import BadInput
from flashtemp.physics.interpolation import TABLE_LOGGER


class _Collector(logging.Handler):
    """A logging handler that collects every different message once, in order."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.messages: dict[str, None] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Collect the message of a record."""
        self.messages[record.getMessage()] = None


@contextmanager
def table_notes() -> Iterator[None]:
    """Within this context collect notes on tables; print them on stderr at its end, unless the input is refused."""
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
