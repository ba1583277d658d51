"""The table's motion from its encoder: band-limited, with the noise that it brings known.

The difference of two samples is not the rate: it attenuates what is fast and passes the encoder's noise up to half the
sampling rate, and both look like physics. A linear-phase filter is fitted instead to the ideal differentiator, flat
from 0 Hz to the edge of the band of motion and falling to zero above; its gain error in the band is below 1e-5.

Two of them are mixed: a narrow one, which passes little noise, wherever its result agrees with that of a wide one to
within noise, and the wide one in what is sudden.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d
from scipy.signal import oaconvolve

FloatArray = npt.NDArray[np.float64]

HALF = 32
"""Samples on either side that a rate is made of."""

_NARROW = (0.1, 0.2, 10.0, 20.0)
_WIDE = (0.2, 0.4, 20.0, 40.0)
"""Edges of pass and stop band as shares of the sampling rate, and their limits in Hz."""

_LEVEL_S = 0.2
_RESTING = 6.0
"""Power of the rate, in units of that of the encoder's noise between the two filters, below which the table rests."""

_BEGIN, _FULL = 1.5, 3.0
"""Power of the difference between wide and narrow, in units of its median, where mixing begins and where it is full."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Angle [deg, unwrapped], rate [deg/s] and acceleration [deg/s²] of the table, each of shape (n,).

    `sudden`, 0 to 1, is the share of the wide filter; `filters` are the rate filters (narrow, wide), to be convolved
    with angles.
    """

    angle_deg: FloatArray
    rate_dps: FloatArray
    acceleration_dps2: FloatArray
    sudden: FloatArray
    filters: tuple[FloatArray, FloatArray]

    def rate_of(self, angle_deg: FloatArray) -> FloatArray:
        """The rate that this motion's own filters make of other angles of the same samples, shape (n,)."""
        narrow, wide = (_filtered(angle_deg, kernel) for kernel in self.filters)
        narrow += self.sudden * (wide - narrow)
        return narrow


def motion_of(angle_deg: FloatArray, sample_rate_hz: float) -> Motion:
    """The motion behind equidistant, unwrapped angles of an encoder, shape (n,), one stretch without gaps."""
    shares = (_NARROW, _WIDE)
    edges = [(min(a * sample_rate_hz, c), min(b * sample_rate_hz, d)) for a, b, c, d in shares]
    rate_filters = tuple(_differentiator(sample_rate_hz, *edge, 1) for edge in edges)
    narrow, wide = (_filtered(angle_deg, kernel) for kernel in rate_filters)
    sudden = _sudden(wide - narrow, sample_rate_hz)
    noise = float(np.median((wide - narrow) ** 2))
    rate = _still(narrow + sudden * (wide - narrow), noise, sample_rate_hz)
    smooth = [_filtered(angle_deg, _differentiator(sample_rate_hz, *edge, 0)) for edge in edges]
    turning = [_filtered(angle_deg, _differentiator(sample_rate_hz, *edge, 2)) for edge in edges]
    return Motion(
        angle_deg=smooth[0] + sudden * (smooth[1] - smooth[0]),
        rate_dps=rate,
        acceleration_dps2=turning[0] + sudden * (turning[1] - turning[0]),
        sudden=sudden,
        filters=(rate_filters[0], rate_filters[1]),
    )


def _still(rate_dps: FloatArray, noise: float, sample_rate_hz: float) -> FloatArray:
    """Rates averaged over a second wherever the table does not turn, shape (n,).

    At rest the encoder's noise is all that a rate holds, and a dead zone, which passes none of it, would seem to fit.
    """
    window = max(3, int(_LEVEL_S * 2 * sample_rate_hz))
    power = uniform_filter1d(rate_dps**2, window)
    resting = (power < _RESTING * noise).astype(np.float64)
    resting = (uniform_filter1d(resting, 2 * window) > 1.0 - 1e-9).astype(np.float64)
    second = max(3, int(sample_rate_hz))
    averaged = uniform_filter1d(rate_dps * resting, second) / np.maximum(uniform_filter1d(resting, second), 1e-9)
    return np.asarray(np.where(resting > 0.0, averaged, rate_dps))


def _filtered(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Values through a filter; beyond the ends they go on with the slope that they end with."""
    reach = kernel.size // 2
    size = min(reach, values.size - 1)
    before = 2 * values[0] - values[size:0:-1]
    after = 2 * values[-1] - values[-2 : -2 - size : -1]
    missing = reach - size
    first, last = (before[0], after[-1]) if size else (values[0], values[-1])
    long = np.concatenate([np.full(missing, first), before, values, after, np.full(missing, last)])
    origin = long[0]
    filtered: FloatArray = oaconvolve(long - origin, kernel, mode="valid")
    return filtered + float(origin * kernel.sum())


def _sudden(difference: FloatArray, sample_rate_hz: float) -> FloatArray:
    """Where the wide filter sees more than noise beyond the narrow one, 0 to 1, shape (n,)."""
    power = uniform_filter1d(difference**2, max(3, int(_LEVEL_S * sample_rate_hz)))
    usual = float(np.median(power))
    if usual <= 0.0:
        return np.ones_like(power)
    share = np.clip((power / usual - _BEGIN) / (_FULL - _BEGIN), 0.0, 1.0)
    smooth: FloatArray = uniform_filter1d(share, max(3, int(_LEVEL_S / 2 * sample_rate_hz)))
    return smooth


@lru_cache(maxsize=64)
def _differentiator(sample_rate_hz: float, passing_hz: float, stopping_hz: float, order: int) -> FloatArray:
    """Least-squares linear-phase filter, shape (2·HALF+1,): d^order/dt^order in the pass band, 0 in the stop band."""
    k = np.arange(1, HALF + 1)
    passing = np.linspace(1e-3, passing_hz, 400)
    stopping = np.linspace(stopping_hz, sample_rate_hz / 2, 300)
    frequency = np.concatenate([passing, stopping])
    omega = 2 * np.pi * frequency
    ideal = np.where(frequency <= passing_hz, omega**order, 0.0)
    # what is asked of the pass band is a small relative error
    weight = np.where(frequency <= passing_hz, 1e4 / np.maximum(omega, 3.0) ** order, 6.0 / (2 * np.pi) ** order)
    phase = np.outer(omega / sample_rate_hz, k)
    basis = 2 * np.sin(phase) if order == 1 else np.hstack([np.ones((omega.size, 1)), 2 * np.cos(phase)])
    ideal = -ideal if order == 2 else ideal
    taps, *_ = np.linalg.lstsq(basis * weight[:, None], ideal * weight, rcond=None)
    if order == 1:
        taps /= 2 * np.sum(taps * k) / sample_rate_hz  # exact for a constant rate
        return np.concatenate([taps[::-1], [0.0], -taps])
    kernel = np.concatenate([taps[:0:-1], taps])
    kernel += ((order == 0) - kernel.sum()) / kernel.size  # exact for an angle at rest
    return kernel
