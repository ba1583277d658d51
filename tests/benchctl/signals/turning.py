"""Motion of a table: steady at several rates, wandering a little and cogging; or a shaft that swings and shakes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

RATE_HZ = 125.0
NOISE_DEG = 0.5 / 3600.0

SWEPT_HZ = 100.0
"""The sampling rate of what swings."""


def turning(
    *,
    cogging_deg: float = 0.0,
    order: int = 36,
    rates_dps: tuple[float, ...] = (20.0, 123.0, 145.0, -123.0, -145.0),
    lasts_s: float = 24.0,
    seed: int = 0,
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Angles that the encoder states [deg], and true rates [deg/s], a stretch for each rate."""
    chance = np.random.default_rng(seed)
    time_s = np.arange(0.0, lasts_s, 1.0 / RATE_HZ)
    angles, rates = [], []
    for rate in rates_dps:
        even = 77.0 + (1.0 + 1e-4 * chance.standard_normal()) * rate * time_s
        even += 1e-3 * np.sin(2.0 * np.pi * 0.6 * time_s + chance.uniform(0.0, 6.0))
        turned = np.radians(order * even)
        angle = even + cogging_deg * np.sin(turned)
        rates.append(np.gradient(even, time_s) * (1.0 + cogging_deg * np.radians(order) * np.cos(turned)))
        angles.append(angle + NOISE_DEG * chance.standard_normal(time_s.size))
    return angles, rates


def sweeping(shaking_dps: float, hz: float = 12.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, unwrapped angles and rates of a shaft that swings and shakes, over ten minutes."""
    time_s = np.arange(0.0, 600.0, 1 / SWEPT_HZ)
    angle = 60.0 / (2 * np.pi * 0.3) * np.sin(2 * np.pi * 0.3 * time_s)
    rate = 60.0 * np.cos(2 * np.pi * 0.3 * time_s)
    angle += shaking_dps / (2 * np.pi * hz) * np.sin(2 * np.pi * hz * time_s)
    rate += shaking_dps * np.cos(2 * np.pi * hz * time_s)
    return time_s, angle, rate
