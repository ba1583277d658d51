"""How the gyro under test stands on the simulated bench, over time: mounted along or across, its supply on or off."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.interfaces import Position
from benchctl_instruments.simulated.timebase import Timebase

_ROUNDING = 1e-6
"""Instants of the grid; a scan that is meant to fall on one may miss it by that much."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Installed:
    """The gyro from an instant of the grid on.

    It was switched on for the `times`-th time, counted from 1, at `on_since_s` of bench time; None: before all time.
    """

    since: float = -math.inf
    position: Position = "along"
    powered: bool = True
    times: int = 1
    on_since_s: float | None = None


class Installation:
    """The hands that touch the gyro. What they do acts from an instant of the grid on that nobody has asked for yet."""

    def __init__(self, timebase: Timebase) -> None:
        self._timebase = timebase
        self._changes = [Installed()]

    def power(self, on: bool) -> None:
        """Switch the gyro's supply; does nothing where it is so already."""
        with self._timebase.lock:
            now = self._changes[-1]
            if on == now.powered:
                return
            since = self._next()
            changed = replace(now, since=since, powered=on)
            if on:
                changed = replace(changed, times=now.times + 1, on_since_s=since / self._timebase.grid_hz)
            self._changes.append(changed)

    def mount(self, position: Position) -> None:
        """Mount the gyro's input axis along or across the table's."""
        with self._timebase.lock:
            self._changes.append(replace(self._changes[-1], since=self._next(), position=position))

    def over(self, first: int, last: int) -> Iterator[tuple[Installed, int, int]]:
        """How it stands over instants of the grid, first and last included: in turn, from one to another."""
        ends = [*(change.since - 1 for change in self._changes[1:]), math.inf]
        for change, end in zip(self._changes, ends, strict=True):
            low, high = max(first, change.since), min(last, end)
            if low <= high:
                yield change, int(low), int(high)

    def dead(self, times_s: FloatArray) -> BoolArray | None:
        """Which of some instants of shape (n,) find its supply off; None: it was never off."""
        if all(change.powered for change in self._changes):
            return None
        since = [change.since - _ROUNDING for change in self._changes]
        powered = np.array([change.powered for change in self._changes])
        found: BoolArray = ~powered[np.searchsorted(since, times_s * self._timebase.grid_hz, side="right") - 1]
        return found

    def _next(self) -> float:
        return math.ceil(self._timebase.now() * self._timebase.grid_hz) + 1
