"""The temperature of the gyro's coil, which lags behind its thermistor.

The coil's temperature T_c obeys τ·dT_c/dt = T − T_c, T the thermistor's (domain facts, LAG). The thermistor's history
before a step matters, so the polls during soaks are included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchctl.signals.reduce import ReducedStep
from benchctl_instruments.arrays import FloatArray

_NODES_EVERY_S = 30.0
_GAP_S = 300.0
_SLOPE_OVER_S = (60.0, 600.0)
_SHORTEST_LAG_S = 60.0


class ThermalHistory:
    """The thermistor over a recording: linear between polls, and along the line of each step.

    `polls` and `lines` are pairs of times (n,), s, and temperatures (n,), °C. Where polls begin, the coil is assumed to
    have the thermistor's temperature. Otherwise, at the beginning and after a gap of more than 300 s, it is assumed to
    have followed the slope of the next minutes for a long time.
    """

    def __init__(
        self, polls: Sequence[tuple[FloatArray, FloatArray]], lines: Sequence[tuple[FloatArray, FloatArray]]
    ) -> None:
        courses = [(*poll, np.ones(poll[0].size, dtype=np.bool_)) for poll in polls]
        for times, values in lines:
            ends = np.linspace(times[0], times[-1], 2 + int((times[-1] - times[0]) / _NODES_EVERY_S))
            courses.append((ends, np.interp(ends, times, values), np.zeros(ends.size, dtype=np.bool_)))
        stamps, celsius, polled = (np.concatenate(columns) for columns in zip(*courses, strict=True))
        known = np.flatnonzero(np.isfinite(celsius) & np.isfinite(stamps))
        self._time_s, first = np.unique(stamps[known], return_index=True)
        self._celsius, self._polled = celsius[known][first], polled[known][first]

    def behind(self, time_s: FloatArray, lag_s: float) -> FloatArray:
        """Return coil minus thermistor, °C, at times (n,); below 60 s proportional to the lag (may be negative)."""
        if self._time_s.size < 2:
            return np.zeros(time_s.shape)
        if lag_s < _SHORTEST_LAG_S:
            return self.behind(time_s, _SHORTEST_LAG_S) * (lag_s / _SHORTEST_LAG_S)
        apart_s = np.diff(self._time_s)
        steady = lag_s * np.diff(self._celsius) / apart_s
        kept = np.exp(-apart_s / lag_s)
        begins = {0, *(np.flatnonzero(apart_s > _GAP_S) + 1).tolist()}
        behind, here = [], 0.0
        for i, (target, share) in enumerate(zip([0.0, *steady.tolist()], [0.0, *kept.tolist()], strict=True)):
            here = -lag_s * self._slope_from(i) if i in begins else (here + target) * share - target
            behind.append(here)
        return np.asarray(np.interp(time_s, self._time_s, behind))

    def coils(self, steps: Sequence[ReducedStep], lag_s: float) -> list[ReducedStep]:
        """Return the steps with the temperatures of a coil with this lag instead of the thermistor's."""
        return [replace(one, temperature_c=one.temperature_c + self.behind(one.time_s, lag_s)) for one in steps]

    def _slope_from(self, first: int) -> float:
        """Return the thermistor's slope, °C/s, in the minutes after a node without predecessor; 0 if that is a poll."""
        last = int(np.searchsorted(self._time_s, self._time_s[first] + _SLOPE_OVER_S[1], side="right")) - 1
        over_s = float(self._time_s[last] - self._time_s[first])
        if self._polled[first] or over_s < _SLOPE_OVER_S[0]:
            return 0.0
        return float(self._celsius[last] - self._celsius[first]) / over_s
