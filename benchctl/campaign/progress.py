"""What a run tells of itself while it goes on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Where a run is: step `index` of `count` (from 1), what it does in it, what was last measured, bench time left."""

    index: int
    count: int
    label: str
    doing: str
    setpoint_c: float
    air_c: float
    gyro_c: float
    rate_dps: float
    left_s: float
    samples: int


class Progress(Protocol):
    """Somebody who wants to know; called often, so it must be quick."""

    def __call__(self, moment: Moment) -> None:
        """The run is here now."""


def nobody(moment: Moment) -> None:
    """A listener for runs that nobody watches."""
