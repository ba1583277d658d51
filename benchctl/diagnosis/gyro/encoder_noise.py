"""What the encoder's own noise adds to a prediction: the rate is a measurement, not a given."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchctl.diagnosis.gyro.frame import Frame
from benchctl.signals.motion import Motion
from benchctl.signals.normal import white_noise_of
from benchctl_instruments.arrays import FloatArray

_STEADY_S, _STEADY = 0.5, 9.0
"""A table turns steadily where the rate's variance in so many seconds is below so many times that of its noise."""
_ORDER = 4
"""Of differences: they hold next to nothing of the motion. In fast sines they hold some, but these are rare."""
_FEWEST = 10


def rate_variance(frame: Frame) -> tuple[FloatArray, FloatArray]:
    """Variance of the rate [(deg/s)²] that the encoder's noise brings, and half that of its step from row to row.

    Both of shape (n,). The noise of an angle is seen in its differences; it passes the filters of `Motion`, wide where
    the motion is sudden.
    """
    whole, step = np.empty(frame.rows), np.empty(frame.rows)
    angles = [frame.encoder_deg[part] for part in frame.stretches if part.stop - part.start >= _FEWEST]
    variance = white_noise_of(*angles, order=_ORDER) ** 2
    for part, motion in zip(frame.stretches, frame.motions, strict=True):
        whole[part] = variance * _passed(motion, motion.filters)
        step[part] = 0.5 * variance * _passed(motion, tuple(np.diff(one) for one in motion.filters))
    return whole, step


def steadied_rate(frame: Frame) -> FloatArray:
    """The rate by which rows are sorted (°/s), shape (n,): where the table turns steadily, its mean around the row.

    What the encoder's noise adds to a row's rate is missing from the row's residual. Sorted by such a rate, or compared
    with what a backlash makes of it, the residual of a perfect model shows a structure (errors in variables).
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
    """Variance behind the mixed filters for white noise of variance one, shape (n,)."""
    narrow, wide = filters
    share = motion.sudden
    passed: FloatArray = (
        (1.0 - share) ** 2 * float(narrow @ narrow)
        + 2.0 * share * (1.0 - share) * float(narrow @ wide)
        + share**2 * float(wide @ wide)
    )
    return passed
