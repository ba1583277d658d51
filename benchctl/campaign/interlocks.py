"""Interlocks: user-defined limits on measured quantities, with hysteresis and a delay; independent of clock and bench.

Each limit is a comparator with hysteresis followed by an on-delay. An excursion begins beyond the limit and lasts until
the value is back inside by the hysteresis; once it has lasted `for_s` the interlock is on, until the excursion ends.

A look may cover many samples, such as a block of the stream; then the most extreme sample counts. So one sample beyond
the limit begins an excursion, and only a look with all samples inside ends it.

An interlock on the table's acceleration that stops the run monitors the controller's reading and the encoder
separately: some controllers report no acceleration, and polls are rare. An interlock that holds the run monitors only
the controller: nothing streams during a hold, so an excursion of the encoder would never end.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from benchctl.bench import Interlock

Range = tuple[float, float]
"""The lowest and the highest value of a look; equal for a single value."""

Looks = Mapping[str, Range]
"""Quantity -> range of its values; `encoder_dps2` is the acceleration by the encoder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """An interlock that went on or off: `limit` is its limit in words, `value` the measured value, `now_s` the time."""

    interlock: Interlock
    limit: str
    on: bool
    value: float
    now_s: float


class FollowedLimit:
    """One side of one interlock, updated look by look."""

    def __init__(
        self, interlock: Interlock, side: Literal["above", "below"], at: float, *, by_encoder: bool = False
    ) -> None:
        self.interlock = interlock
        self.look = "encoder_dps2" if by_encoder else interlock.quantity
        whose = f"{interlock.quantity}{' by the encoder' if by_encoder else ''}"
        self.text = f"{whose} {side} {at:g}{f' for {interlock.for_s:g} s' if interlock.for_s else ''}"
        self.on: Change | None = None
        self._sign = 1.0 if side == "above" else -1.0  # a lower limit is an upper limit of the negated value
        self._at = self._sign * at
        self._since_s: float | None = None

    def see(self, now_s: float, values: Range) -> Change | None:
        """Update with a look; return the change, if there is one. A NaN changes nothing."""
        outer = max(self._sign * value for value in values)
        if math.isnan(outer):
            return None
        if outer > self._at and self._since_s is None:
            self._since_s = now_s
        elif outer <= self._at - self.interlock.hysteresis:
            self._since_s = None
        beyond = self._since_s is not None and now_s - self._since_s >= self.interlock.for_s
        if beyond == (self.on is not None):
            return None
        change = Change(interlock=self.interlock, limit=self.text, on=beyond, value=self._sign * outer, now_s=now_s)
        self.on = change if beyond else None
        return change


class Interlocks:
    """All interlocks of a bench."""

    def __init__(self, interlocks: Iterable[Interlock]) -> None:
        self._limits: list[FollowedLimit] = []
        for interlock in interlocks:
            self._limits += limits_of(interlock)
            if interlock.quantity == "acceleration_dps2" and interlock.action == "stop":
                self._limits += limits_of(interlock, by_encoder=True)

    def see(self, now_s: float, looks: Looks) -> list[Change]:
        """Update with a look at some quantities; return the changes, in the order of bench.toml."""
        return [
            change
            for limit in self._limits
            if (values := looks.get(limit.look)) is not None and (change := limit.see(now_s, values)) is not None
        ]

    @property
    def may_hold(self) -> bool:
        """Whether any interlock can pause the run."""
        return any(limit.interlock.action == "hold" for limit in self._limits)

    @property
    def holds(self) -> list[Change]:
        """The interlocks that are on and demand a pause."""
        return [limit.on for limit in self._limits if limit.on is not None and limit.interlock.action == "hold"]


def words(interlocks: Iterable[Interlock]) -> str:
    """Return interlocks in one line, each with its action."""
    limits = (limit for interlock in interlocks for limit in limits_of(interlock))
    return ", ".join(f"{limit.text} ({limit.interlock.action})" for limit in limits)


def limits_of(interlock: Interlock, *, by_encoder: bool = False) -> list[FollowedLimit]:
    """Return the sides of an interlock that have a limit."""
    sides: tuple[tuple[Literal["above", "below"], float | None], ...] = (
        ("above", interlock.above),
        ("below", interlock.below),
    )
    return [FollowedLimit(interlock, side, at, by_encoder=by_encoder) for side, at in sides if at is not None]
