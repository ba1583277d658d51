"""Reconstruct the chamber's set point over time; a recording states only its target, so it is fitted to the air.

In a ramp the set point moves linearly from the old value to the target, and then stays constant; the air follows with a
lag. The duration of each ramp and the lag are fitted to the air's temperature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy.optimize
import scipy.signal

from benchctl.recordings.model import StepInfo
from benchctl_instruments.arrays import FloatArray

_MOST_POINTS, _MOST_RAMPS = 6000, 40
_LEAST_C, _LEAST_S = 1.0, 20.0
"""Minimum change and duration of a ramp; a smaller change does not count, a faster one is a jump."""
_LAG_S, _LONGEST_LAG_S = 30.0, 3600.0
_CLOSE = 0.02
"""Largest rms error of the fit as a share of the air's range; above it the set point is regarded as unknown."""


def way_of_setpoint(infos: Sequence[StepInfo], time_s: FloatArray, air_c: FloatArray) -> FloatArray | None:
    """Return −1 while the set point falls, 1 while it rises, 0 while it is constant, shape (n,); None if unknown.

    `time_s` and `air_c` (n,) are those of the air, in order of time.
    """
    ramps = _ramps(infos)
    known = np.isfinite(air_c)
    if not ramps or len(ramps) > _MOST_RAMPS or np.count_nonzero(known) < 10 * len(ramps):
        return None
    apart_s = max(float(time_s[-1] - time_s[0]) / _MOST_POINTS, 1.0)
    grid = np.arange(time_s[0], time_s[-1], apart_s)
    cell = np.clip(((time_s[known] - time_s[0]) / apart_s).astype(np.int64), 0, grid.size - 1)
    rows = np.bincount(cell, minlength=grid.size)
    air = np.bincount(cell, air_c[known], minlength=grid.size) / np.maximum(rows, 1)
    measured = rows > 0

    def lagged(numbers: FloatArray) -> FloatArray:
        lag_s, *lasting = np.exp(numbers).tolist()
        corners = [
            (ramp[0] + when, ramp[1 + way])
            for ramp, s in zip(ramps, lasting, strict=True)
            for when, way in ((0.0, 0), (s, 1))
        ]
        setpoint = np.interp(grid + 0.5 * apart_s, [at for at, _ in corners], [to for _, to in corners])
        share = -math.expm1(-apart_s / lag_s)
        return np.asarray(
            scipy.signal.lfilter([share], [1.0, share - 1.0], setpoint, zi=[(1.0 - share) * setpoint[0]])[0]
        )

    def missed(numbers: FloatArray) -> FloatArray:
        return (lagged(numbers) - air)[measured]

    rooms = [last - first for first, _, _, last in ramps]
    start = np.log([_LAG_S, *(0.7 * room for room in rooms)])
    low = np.log([apart_s, *(0.5 * apart_s for _ in rooms)])
    high = np.log([_LONGEST_LAG_S, *rooms])
    found = scipy.optimize.least_squares(missed, np.clip(start, low + 1e-6, high - 1e-6), bounds=(low, high))
    lasting = np.exp(found.x[1:])
    if math.sqrt(float(np.mean(found.fun**2))) > _CLOSE * float(np.ptp(air[measured])) or lasting.max() < _LEAST_S:
        return None
    way = np.zeros_like(time_s)
    for (first, begin_c, end_c, _), s in zip(ramps, lasting.tolist(), strict=True):
        way[(time_s >= first) & (time_s < first + s)] = math.copysign(1.0, end_c - begin_c)
    return way


def _ramps(infos: Sequence[StepInfo]) -> list[tuple[float, float, float, float]]:
    """Return start time, old and new temperature of each change of the set point, and the earliest time of the next."""
    found: list[tuple[float, float, float, float]] = []
    before: float | None = None
    for info in infos:
        setpoint_c = info.chamber_setpoint_c
        if not math.isfinite(setpoint_c):
            continue
        if before is not None and abs(setpoint_c - before) > _LEAST_C:
            found.append((info.t_start, before, setpoint_c, info.t_end))
        before = setpoint_c
    return [one for one in found if one[3] - one[0] > _LEAST_S]
