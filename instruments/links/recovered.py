"""What went wrong on a link and was got over, told as log records of `benchctl_instruments.links.recovered`.

Whoever wants to know attaches a handler: a campaign keeps them in its journal. Nobody has to, and then nothing is said.
"""

from __future__ import annotations

import logging

logger = logging.getLogger(__name__)
logger.addHandler(logging.NullHandler())  # without a handler Python would print the records


def note_recovered(failure: str, how: str = "asked again, it answered") -> None:
    """Say what went wrong, and how it was got over; `failure` names the instrument."""
    logger.warning("%s; %s", failure, how)
