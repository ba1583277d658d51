"""The gyro's temperature: a straight line through its thermistor's samples, and the coil that follows it with a lag.

The coil's temperature T_c obeys τ·dT_c/dt = T − T_c, T the thermistor's (domain facts, LAG). What counts is the
thermistor's course before a step, so the soaks' polls belong to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from benchctl_instruments.arrays import FloatArray

if TYPE_CHECKING:
    from benchctl.calibration.reduce import ReducedStep


_NODES_EVERY_S = 30.0
_GAP_S = 300.0
_SLOPE_OVER_S = (60.0, 600.0)
_SHORTEST_LAG_S = 60.0


class TemperatureLine:
    """Sums over parts, each about its own means, so that nothing is lost to large stamps."""

    def __init__(self) -> None:
        self._sums: list[tuple[float, float, float, float, float]] = []

    def take(self, time_s: FloatArray, readings_c: FloatArray | None) -> None:
        """More samples, (n,) each; None where there is no thermistor. Readings that are not finite are left out."""
        if readings_c is None:
            return
        good = np.isfinite(readings_c)
        if not good.all():
            time_s, readings_c = time_s[good], readings_c[good]
        if time_s.size:
            mean_s, centred = float(time_s.mean()), time_s - time_s.mean()
            about = float(centred @ centred), float(centred @ readings_c)
            self._sums.append((float(time_s.size), mean_s, float(readings_c.mean()), *about))

    def fitted(self) -> tuple[float, float]:
        """Intercept at time 0 of the recording, °C, and slope, °C/s; NaN and 0 where there are no two readings."""
        if sum(part[0] for part in self._sums) < 2:
            return np.nan, 0.0
        count, mean_s, mean_c, squares, products = np.array(self._sums).T
        middle_s, middle_c = np.average(mean_s, weights=count), np.average(mean_c, weights=count)
        apart = count * (mean_s - middle_s)
        slope = float((products.sum() + apart @ (mean_c - middle_c)) / (squares.sum() + apart @ (mean_s - middle_s)))
        return float(middle_c - slope * middle_s), slope


class ThermalHistory:
    """The thermistor's course over a recording: it runs straight between polls, and along the line of each step.

    `polls` and `lines` are pairs of times (n,), s, and temperatures (n,), °C. The coil is as warm as the thermistor
    where polls begin. Where they do not, at the beginning and after a gap of more than 300 s, it is taken to have
    followed the slope of the next minutes for a long time.
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
        """Coil less thermistor, °C, at times (n,); below 60 s proportional to the lag, which may be negative."""
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
        """The steps with the temperatures of a coil that lags by so much in place of the thermistor's."""
        return [replace(one, temperature_c=one.temperature_c + self.behind(one.time_s, lag_s)) for one in steps]

    def _slope_from(self, first: int) -> float:
        """The thermistor's slope, °C/s, in the minutes after a node with nothing before it; 0 where that is a poll."""
        last = int(np.searchsorted(self._time_s, self._time_s[first] + _SLOPE_OVER_S[1], side="right")) - 1
        over_s = float(self._time_s[last] - self._time_s[first])
        if self._polled[first] or over_s < _SLOPE_OVER_S[0]:
            return 0.0
        return float(self._celsius[last] - self._celsius[first]) / over_s
