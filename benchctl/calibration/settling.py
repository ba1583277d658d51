"""Where a step of rest or constant rate is settled: by the encoder, because labels may include the spin-up."""

from __future__ import annotations

import numpy as np

from benchctl.calibration.angle_rate import FloatArray, Smoother, places_of_rate, rates_at

RELATIVE_TOLERANCE = 2e-3
"""Departure from the settled rate that still counts as settled: above eccentricity and ripple, far below a spin-up."""

REST_TOLERANCE_DPS = 0.02
MARGIN_S = 0.1
"""Left out after the table has settled, so that the gyro's own filter settles too."""

_FEWEST_RATES = 100


def settled_from(angle_deg: FloatArray, smoother: Smoother, angle_noise_deg: float) -> int | None:
    """First sample from which the table keeps its rate, 0 where it did so from the start; None where it never does.

    `angle_deg` are unwrapped angles. The settled rate is the median over the second half; only the first half is
    searched, so that a disturbance later on stays in the data, where robust fits can see it.
    """
    where = places_of_rate(angle_deg.size, smoother)
    samples = where.stop - where.start
    if samples < 8:
        return None
    # No rate changes much within half a window of the smoother.
    every = max(1, min(smoother.half, samples // _FEWEST_RATES))
    rate = rates_at(angle_deg, np.arange(where.start, where.stop, every), smoother)
    second_half = rate[rate.size // 2 :]
    target = float(np.median(second_half))
    tolerance = max(RELATIVE_TOLERANCE * abs(target), REST_TOLERANCE_DPS, 8 * angle_noise_deg * smoother.noise_gain)
    if float(np.mean(np.abs(second_half - target) > tolerance)) > 0.1:
        return None
    off = np.flatnonzero(np.abs(rate[: rate.size // 2] - target) > tolerance)
    if off.size == 0:
        return 0
    return int((off[-1] + 1) * every + 2 * smoother.half + round(MARGIN_S * smoother.sample_rate_hz))


def whole_revolutions(angle_deg: FloatArray, turned_deg: float = 0.0) -> tuple[int, float, bool]:
    """How many of the samples make whole revolutions, from the first on; all of them where there is not even one.

    `turned_deg` had been turned of one when they begin. Beside their number: how much of one has been turned where the
    next sample stands, and whether there was one.
    """
    travelled = turned_deg + np.abs(angle_deg - angle_deg[0])
    turns = int(travelled[-1] // 360.0)
    if turns == 0:
        step = float(travelled[-1] - travelled[0]) / max(angle_deg.size - 1, 1)
        return int(angle_deg.size), float(travelled[-1]) + step, False
    count = int(np.searchsorted(travelled, turns * 360.0))
    return count, float(travelled[count]) - turns * 360.0, True
