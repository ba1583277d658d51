"""What went wrong on the links of a run and was got over: an event of the recording for each."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from benchctl_instruments.links.recovered import logger


class _Teller(logging.Handler):
    """Hands every record on as an event."""

    def __init__(self, event: Callable[..., None]) -> None:
        super().__init__()
        self._event = event

    def emit(self, record: logging.LogRecord) -> None:
        """Tell it."""
        self._event("recovered", says=record.getMessage())


@contextmanager
def recoveries_told(event: Callable[..., None]) -> Iterator[None]:
    """Tell `event` of every recovery while the block runs, as kind `recovered` with what the link `says`."""
    teller = _Teller(event)
    logger.addHandler(teller)
    try:
        yield
    finally:
        logger.removeHandler(teller)
