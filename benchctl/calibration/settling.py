"""Where a step of rest or constant rate is settled: by the encoder, because labels may include the spin-up."""

from __future__ import annotations

import numpy as np

from benchctl.calibration.angle_rate import FloatArray, Smoother, derivative_of

RELATIVE_TOLERANCE = 2e-3
"""Departure from the settled rate that still counts as settled: above eccentricity and ripple, far below a spin-up."""

REST_TOLERANCE_DPS = 0.02
MARGIN_S = 0.1
"""Left out after the table has settled, so that the gyro's own filter settles too."""


def settled_from(angle_deg: FloatArray, smoother: Smoother, angle_noise_deg: float) -> int | None:
    """First sample from which the table keeps its rate, 0 where it did so from the start; None where it never does.

    The settled rate is the median over the second half; only the first half is searched, so that a disturbance later on
    stays in the data, where robust fits can see it.
    """
    rate, where = derivative_of(angle_deg, smoother)
    if rate.size < 8:
        return None
    second_half = rate[rate.size // 2 :]
    target = float(np.median(second_half))
    tolerance = max(RELATIVE_TOLERANCE * abs(target), REST_TOLERANCE_DPS, 8 * angle_noise_deg * smoother.noise_gain)
    if float(np.mean(np.abs(second_half - target) > tolerance)) > 0.1:
        return None
    off = np.flatnonzero(np.abs(rate[: rate.size // 2] - target) > tolerance)
    if off.size == 0:
        return 0
    return int(where.start + off[-1] + 1 + smoother.half + round(MARGIN_S * smoother.sample_rate_hz))


def whole_revolutions(angle_deg: FloatArray) -> int:
    """How many of the samples make whole revolutions, from the first on; all of them where there is not even one."""
    travelled = np.abs(angle_deg - angle_deg[0])
    turns = int(travelled[-1] // 360.0)
    if turns == 0:
        return int(angle_deg.size)
    return int(np.searchsorted(travelled, turns * 360.0))
