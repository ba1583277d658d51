"""What a driver does itself for a rate table whose controller has no limit on the rate, and no sinusoid."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NoReturn

from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import Clock, TableLimits

_LONGEST_STOP_S = 30.0  # bench time, where no limits are known
_POLL_S = 0.05
_SPARE_S = 2.0


class KeptLimits:
    """The limits of a table as its driver keeps them: no motion before they are known, none beyond them.

    Parameters
    ----------
    name
        How error messages call the table.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._limits: TableLimits | None = None

    def keep(self, limits: TableLimits) -> None:
        """From now on these; `UsageError` where they are not both finite and above 0."""
        for what, value in (("rate", limits.rate_dps), ("acceleration", limits.acceleration_dps2)):
            if not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"{self._name}: {what} limit {value}: expected a finite number above 0")
        self._limits = limits

    def known(self) -> TableLimits:
        """The limits; `UsageError` before they were set."""
        if self._limits is None:
            raise UsageError(
                f"{self._name}: it was to move before its limits were set, and its controller keeps none on the rate;"
                " call set_limits() first"
            )
        return self._limits

    def check_rate(self, rate_dps: float) -> None:
        """Raise `UsageError` for a rate that is no number or beyond the limit; 0 is allowed before limits are known."""
        check_finite(self._name, "rate", rate_dps)
        if rate_dps and abs(rate_dps) > self.known().rate_dps:
            raise UsageError(
                f"{self._name}: asked for {rate_dps:g} deg/s, the limit that was set is {self.known().rate_dps:g} deg/s"
            )

    def longest_stop_s(self) -> float:
        """How long a stop may take at most, in bench time."""
        if self._limits is None:
            return _LONGEST_STOP_S
        return _SPARE_S + 2.0 * self._limits.rate_dps / self._limits.acceleration_dps2


def check_finite(name: str, what: str, value: float) -> None:
    """Raise `UsageError` for what is no finite number."""
    if not math.isfinite(value):
        raise UsageError(f"{name}: {what} {value}: expected a finite number")


def refuse_to_oscillate(name: str, controller: str) -> NoReturn:
    """Raise the `UsageError` of a controller for which no sinusoid is publicly known."""
    raise UsageError(
        f"{name}: an oscillation was asked for, and no public source describes one for the {controller}: procedures"
        " with sines or swings (sine_sweep, two_stage, diagnostic) cannot run on it; take one of constant rates"
        " (rate_sweep, temperature_sweep) or one at rest (static)"
    )


def wait_until(clock: Clock, done: Callable[[], bool], within_s: float) -> bool:
    """Look until something is done, at most so much bench time; whether it is."""
    deadline_s = clock.now() + within_s
    while not done():
        if clock.now() >= deadline_s:
            return False
        clock.sleep(_POLL_S)
    return True


def short_way_deg(from_deg: float, to_deg: float) -> float:
    """The shorter way from one angle to another, -180 to below 180 degrees, positive as the angles are."""
    return (to_deg - from_deg + 180.0) % 360.0 - 180.0
