"""The T7's CORE_TIMER, a 32-bit count at 40 MHz that wraps every 107 s, made into seconds that do not.

How often it has wrapped is found with another clock, which may be wrong by up to half a wrap (53 s) between two looks:
days, for any crystal. The seconds themselves are those of the T7's crystal alone.
"""

from __future__ import annotations

TICKS_HZ = 40_000_000
WRAP = 1 << 32


class CoreTimer:
    """Seconds since the first look at the count.

    Parameters
    ----------
    count, clock_s
        What the counter reads, and what the other clock reads at the same time.
    """

    def __init__(self, count: int, clock_s: float) -> None:
        self._count = count
        self._clock_s = clock_s
        self._ticks = 0

    def look(self, count: int, clock_s: float) -> float:
        """Take another look; seconds since the first one."""
        part = (count - self._count) % WRAP
        wraps = round(((clock_s - self._clock_s) * TICKS_HZ - part) / WRAP)
        self._ticks += part + max(wraps, 0) * WRAP
        self._count, self._clock_s = count, clock_s
        return self._ticks / TICKS_HZ

    def seconds_at(self, count: int) -> float:
        """When the counter read `count`, which must be within 107 s after the last look."""
        return (self._ticks + (count - self._count) % WRAP) / TICKS_HZ
