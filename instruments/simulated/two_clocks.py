"""A gyro whose samples are not of the instant of their stamps, on a bench that cannot look ahead.

Only the shift between the gyro's instants and the encoder's is seen in a recording. Where the gyro would have to be
sampled in the future, the whole scan is therefore taken earlier: at stamp t the encoder is read at t − lead and the
gyro at t − lead + shift(t), neither after t. Within a stream the lead stays what it was at its start, with room for an
hour of drift, so that the encoder's rate is the table's; after that it follows the drift, and the encoder's rate is
wrong by as much. A stream begins with what the table did a lead before: milliseconds for an offset, but a second for a
clock that has been fast by 100 ppm for three hours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from benchctl_instruments.interfaces import FloatArray
from benchctl_instruments.physics.effects.kinds import ClockEffect

_ROOM_S = 3600.0
_NEXT_SCAN = 0.5
"""Share of an interval by which a scan may miss its place in a stream."""


class TwoClocks:
    """Instants of encoder and gyro for the stamps of scans, asked for in the order of time."""

    def __init__(self, effects: Sequence[ClockEffect]) -> None:
        self._effects = tuple(effects)
        self._next_s = -math.inf
        self._lead_s = 0.0

    def instants(self, stamps_s: FloatArray, interval_s: float) -> tuple[FloatArray, FloatArray]:
        """Instants [s] at which encoder and gyro are read for stamps [s], `interval_s` apart; each of shape (n,)."""
        if abs(stamps_s[0] - self._next_s) > _NEXT_SCAN * interval_s:
            ends_s = self._shift_s(stamps_s[0] + np.array([0.0, _ROOM_S]))
            self._lead_s = max(0.0, float(ends_s.max()))
        self._next_s = float(stamps_s[-1]) + interval_s
        shift_s = self._shift_s(stamps_s)
        encoder_s = stamps_s - np.maximum(shift_s, self._lead_s)
        return encoder_s, encoder_s + shift_s

    def reach_s(self, stamp_s: float) -> float:
        """How much further back than a stamp may have to be read."""
        ends_s = self._shift_s(stamp_s + np.array([0.0, _ROOM_S]))
        return float(max(0.0, ends_s.max()) + max(0.0, -ends_s.min()))

    def _shift_s(self, stamps_s: FloatArray) -> FloatArray:
        """How far the gyro's instants are ahead of their stamps; several effects add up."""
        shift_s = np.zeros_like(stamps_s)
        for effect in self._effects:
            shift_s += effect.gyro_time_s(stamps_s)
            shift_s -= stamps_s
        return shift_s
