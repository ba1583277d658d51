"""An acceleration for controllers that state none: the least that two reads of the rate prove."""

from __future__ import annotations

import math

from benchctl_instruments.interfaces import Clock

SHORTEST_S = 0.04
"""Reads closer together are not compared: what the rate may be off would hide any acceleration."""


class ProvenAcceleration:
    """Follows the rate from read to read; not for two threads at once.

    A rate was measured at some instant between its question and its answer, and may be off. Of all accelerations that
    fit two reads, the one nearest to zero is stated: the smallest change of the rate over the longest time. So neither
    noise nor a slow line ever makes an acceleration, and what is stated is a mean: of a jolt between two reads, only
    what it has left of the rate shows.

    Parameters
    ----------
    clock
        Bench time.
    rate_error_dps
        How much a rate may be off.
    """

    def __init__(self, clock: Clock, rate_error_dps: float) -> None:
        self._clock = clock
        self._error_dps = rate_error_dps
        self._rate_dps = self._asked_s = math.nan

    def forget(self) -> None:
        """The next read is the first one."""
        self._rate_dps = self._asked_s = math.nan

    def of(self, rate_dps: float, asked_s: float) -> float:
        """The mean acceleration [deg/s²] since the read before, where `rate_dps` was asked for at `asked_s`.

        Not a number at the first read, and at one that comes too early.
        """
        longest_s = self._clock.now() - self._asked_s
        if longest_s < SHORTEST_S:
            return math.nan
        change_dps = rate_dps - self._rate_dps
        self._rate_dps, self._asked_s = rate_dps, asked_s
        return math.copysign(max(0.0, abs(change_dps) - 2.0 * self._error_dps) / longest_s, change_dps)
