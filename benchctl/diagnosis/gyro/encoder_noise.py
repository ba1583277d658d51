"""The contribution of the encoder's noise to a prediction: the rate is a measurement and not exact."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchctl.diagnosis.gyro.frame import Frame
from benchctl.signals.motion import Motion
from benchctl.signals.normal import white_noise_of
from benchctl_instruments.arrays import FloatArray

_STEADY_S, _STEADY = 0.5, 9.0
"""A table turns steadily if the variance of its rate in so many seconds is below so many times that of its noise."""
_ORDER = 4
"""Order of differences: they contain almost no motion, except in fast sines, which are rare."""
_FEWEST = 10


def rate_variance(frame: Frame) -> tuple[FloatArray, FloatArray]:
    """Return the rate variance [(deg/s)²] caused by the encoder's noise, and half that of its row-to-row change.

    Both have shape (n,). The noise of an angle is estimated from its differences; it passes the filters of `Motion`,
    the wide one where the motion is sudden.
    """
    of_rate, step = np.empty(frame.rows), np.empty(frame.rows)
    angles = [frame.encoder_deg[part] for part in frame.stretches if part.stop - part.start >= _FEWEST]
    variance = white_noise_of(*angles, order=_ORDER) ** 2
    for part, motion in zip(frame.stretches, frame.motions, strict=True):
        of_rate[part] = variance * _passed(motion, motion.filters)
        step[part] = 0.5 * variance * _passed(motion, tuple(np.diff(one) for one in motion.filters))
    return of_rate, step


def steadied_rate(frame: Frame) -> FloatArray:
    """Return the rate for sorting rows [°/s], shape (n,): where the table turns steadily, its mean around the row.

    The encoder's noise in a row's rate also enters the row's residual. Sorted by the noisy rate, or compared with its
    backlash, the residual of a perfect model shows a structure (errors in variables).
    """
    variance, _ = rate_variance(frame)
    window = 2 * round(0.5 * _STEADY_S / frame.interval_s) + 1
    rate = frame.rate_dps.copy()
    for part in frame.stretches:
        own = frame.rate_dps[part]
        mean = uniform_filter1d(own, window)
        spread = uniform_filter1d((own - mean) ** 2, window)
        rate[part] = np.where(spread < _STEADY * variance[part], mean, own)
    return rate


def _passed(motion: Motion, filters: tuple[FloatArray, ...]) -> FloatArray:
    """Return the variance after the mixed filters for white noise of variance one, shape (n,)."""
    narrow, wide = filters
    share = motion.sudden
    passed: FloatArray = (
        (1.0 - share) ** 2 * float(narrow @ narrow)
        + 2.0 * share * (1.0 - share) * float(narrow @ wide)
        + share**2 * float(wide @ wide)
    )
    return passed
