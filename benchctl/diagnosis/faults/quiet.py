"""The gyro's noise before the converter, where it is least."""

from __future__ import annotations

import math

import numpy as np

from benchctl_instruments.arrays import FloatArray

_WINDOW_S = 1.0
_QUIETEST = 0.1
"""Share of the windows that may be quieter: those in which the output is held, or stands at a rail."""


def quiet_noise_v(residual: FloatArray, interval_s: float, step_v: float) -> float:
    """A lower estimate of the deviation of the noise ahead of the converter [V]; 0 where its steps hide it.

    From the differences of successive residuals (n,) in windows of a second, of which a low quantile counts. A slow
    error of the model does not matter, and one that does makes windows louder. Rounding adds step²/12 where noise or
    motion reach over a step; windows below that stand on stairs.
    """
    window = max(2, round(_WINDOW_S / interval_s))
    windows = residual.size // window
    if windows == 0:
        return 0.0
    changes = np.diff(residual[: windows * window].reshape(windows, window), axis=1)
    variance = float(np.quantile(np.mean(changes**2, axis=1), _QUIETEST)) / 2.0
    return math.sqrt(max(variance - step_v**2 / 12.0, 0.0))
