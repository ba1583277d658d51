"""The table's rate from its encoder's angles, by one of two linear-phase filters with known gain and noise.

The difference of two samples is not the rate: it belongs to the middle between them, attenuates fast motion and passes
the encoder's noise up to half the sampling rate. The filter depends on what is known about the motion:

- `Smoother`, a polynomial over a window of angles (Savitzky and Golay, Anal. Chem. 36 (1964) 1627), if the band of the
  motion is known: at rest, at constant rates, in a sine. Window and order are chosen for the least error of a scale
  factor. The window is at most a quarter of a second long, so that short runs lose little; blocks of samples are
  averaged without computing each rate; and a delay is a place inside the window, so that half samples are not lost.
- `differentiator`, a least-squares filter that is flat from 0 Hz to the edge of a band and falls to zero above, if the
  motion is not known and a model is compared with every sample. Its gain error is below 1e-5 up to the edge; that of a
  polynomial is as small only for much slower motion.

Both give the rate at the time stamp of the middle sample.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError

_ORDERS = (4, 6, 8)
_MAX_WINDOW_S = 0.25
_MAX_HALF = 60

_FEWEST, _REACH_S = 32, 0.256
"""Minimum number of samples on either side of a rate, and the minimum time that they cover.

A band that is narrow relative to the sampling rate needs more samples, because its gain error grows with fewer.
"""

NARROW = (0.1, 0.2, 10.0, 20.0)
WIDE = (0.2, 0.4, 20.0, 40.0)
"""Edges of pass band and stop band as shares of the sampling rate, and their upper limits in Hz."""


def unwrap_deg(angle_deg: FloatArray, period_deg: float = 360.0) -> FloatArray:
    """Remove the jumps by a period, shape (n,); correct if successive samples differ by less than half a period."""
    steps = np.diff(angle_deg)
    jumps = np.flatnonzero(np.abs(steps) > 0.5 * period_deg)
    turns = np.cumsum(-np.sign(steps[jumps]) * np.ceil(np.abs(steps[jumps]) / period_deg - 0.5))
    edges = np.concatenate([[0], jumps + 1, [angle_deg.size]])
    return np.asarray(angle_deg + period_deg * np.repeat(np.concatenate([[0.0], turns]), np.diff(edges)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Smoother:
    """A window of `2*half + 1` angles, a polynomial of `order`; its gain error up to `band_hz` at `sample_rate_hz`.

    `noise_gain` is the standard deviation of a rate (°/s) over that of one angle (deg, white noise).
    """

    half: int
    order: int
    sample_rate_hz: float
    band_hz: float
    gain_error: float
    noise_gain: float

    @property
    def window_s(self) -> float:
        """Time from the first angle of the window to its last, s."""
        return 2 * self.half / self.sample_rate_hz


def derivative_weights(half: int, order: int, place: float = 0.0, derivative: int = 1) -> FloatArray:
    """Return weights w, shape (2*half+1,), with Σ w_k·θ_k = the fitted polynomial's derivative at `place`.

    `place` is in samples from the middle; the derivative is per sample to the power of `derivative`.
    """
    z = place / half
    powers = np.arange(derivative, order + 1)
    row = np.zeros(order + 1)
    row[derivative:] = [math.perm(int(power), derivative) * z ** (power - derivative) for power in powers]
    weights: FloatArray = row @ _window_inverse(half, order) / half**derivative
    return weights


@lru_cache(maxsize=512)
def _window_inverse(half: int, order: int) -> FloatArray:
    """Map the samples of a window to coefficients of its polynomial in [-1, 1], shape (order+1, 2*half+1)."""
    basis = np.vander(np.arange(-half, half + 1) / half, order + 1, increasing=True)
    return np.asarray(np.linalg.pinv(basis), dtype=np.float64)


def gain_error(half: int, order: int, frequency_hz: float, sample_rate_hz: float) -> float:
    """Return the relative error of the rate of a sine of `frequency_hz`: |gain − 1| of the smoother."""
    if frequency_hz <= 0.0:
        return 0.0
    phase = 2 * np.pi * frequency_hz / sample_rate_hz
    k = np.arange(-half, half + 1)
    gain = float(np.sum(derivative_weights(half, order) * np.sin(phase * k)) / phase)
    return abs(gain - 1.0)


def choose_smoother(sample_rate_hz: float, band_hz: float, noise_to_rate: float) -> Smoother:
    """Return the smoother with the least error of a scale factor, for motion up to `band_hz`.

    Two errors count: the gain error in the band, and the noise of the rates, which as an error of the regressor
    attenuates the scale factor by its squared ratio to the rate. `noise_to_rate` is the standard deviation of an angle
    (deg) over the rms of the rate (°/s). Raises `UsageError` if the motion is beyond half the sampling rate.
    """
    if not 0.0 <= band_hz < sample_rate_hz / 2:
        raise UsageError(
            f"rate from the encoder: motion at {band_hz:g} Hz needs more than {2 * band_hz:g} samples a second, "
            f"the recording has {sample_rate_hz:g}; record faster or leave the step out"
        )
    # In steps of a factor of two, so that similar steps share a smoother.
    return _least_harm(sample_rate_hz, band_hz, round(math.log2(max(noise_to_rate, 1e-12))))


@lru_cache(maxsize=256)
def _least_harm(sample_rate_hz: float, band_hz: float, log2_noise_to_rate: int) -> Smoother:
    """Return the best of all windows and orders."""
    longest = min(_MAX_HALF, max(4, int(_MAX_WINDOW_S * sample_rate_hz / 2)))
    candidates = [
        Smoother(
            half=half,
            order=order,
            sample_rate_hz=sample_rate_hz,
            band_hz=band_hz,
            gain_error=gain_error(half, order, band_hz, sample_rate_hz),
            noise_gain=float(np.linalg.norm(derivative_weights(half, order))) * sample_rate_hz,
        )
        for order in _ORDERS
        for half in range(order // 2, longest + 1)
    ]
    return min(candidates, key=lambda one: one.gain_error + (one.noise_gain * 2.0**log2_noise_to_rate) ** 2)


def places_of_rate(samples: int, smoother: Smoother, delay_s: float = 0.0) -> slice:
    """Return the samples at which a derivative exists; at the ends no complete window fits."""
    shift = round(delay_s * smoother.sample_rate_hz)
    first, last = max(smoother.half + shift, 0), min(samples - smoother.half + shift, samples)
    return slice(first, last) if last > first else slice(0, 0)


def derivative_of(
    angle_deg: FloatArray, smoother: Smoother, *, delay_s: float = 0.0, derivative: int = 1
) -> tuple[FloatArray, slice]:
    """Return the derivative (1: °/s, 2: °/s², 3: °/s³) of unwrapped, equidistant angles, `delay_s` before their stamps.

    Returns the values and the slice of samples to which they belong (`places_of_rate`). A delay beyond half a sample
    shifts the window by integer samples, so that the place stays near its middle.
    """
    where = places_of_rate(angle_deg.size, smoother, delay_s)
    if where.stop == 0:
        return np.empty(0), where
    weights, shift = _weights(smoother, delay_s, derivative)
    values = np.convolve(angle_deg - angle_deg[0], weights[::-1], mode="valid")
    before = smoother.half + shift
    return np.asarray(values[where.start - before : where.stop - before], dtype=np.float64), where


def rates_at(angle_deg: FloatArray, places: IntArray, smoother: Smoother) -> FloatArray:
    """Return `derivative_of`, °/s, at selected samples, shape (k,) inside `places_of_rate`; shape (k,)."""
    weights, _ = _weights(smoother, 0.0, 1)
    windows = sliding_window_view(angle_deg - angle_deg[0], weights.size)
    return np.asarray(windows[places - smoother.half] @ weights)


def mean_derivative_of(
    angle_deg: FloatArray, edges: IntArray, smoother: Smoother, *, delay_s: float = 0.0, derivative: int = 1
) -> FloatArray:
    """Return means of `derivative_of` over blocks between sample `edges`, shape (k+1,) inside `places_of_rate`; (k,).

    A filter summed over a block needs only the angles near its ends: the inner ones cancel, because the weights of a
    derivative add up to zero. A block therefore costs as much as a sample.
    """
    weights, shift = _weights(smoother, delay_s, derivative)
    summed = np.cumsum(weights[::-1])[-2::-1]
    windows = sliding_window_view(angle_deg - angle_deg[0], summed.size)
    return np.asarray(np.diff(windows[edges - shift - smoother.half] @ summed) / np.diff(edges))


def _weights(smoother: Smoother, delay_s: float, derivative: int) -> tuple[FloatArray, int]:
    """Return the weights of the window, and its shift in samples."""
    shift = round(delay_s * smoother.sample_rate_hz)
    place = shift - delay_s * smoother.sample_rate_hz
    rates = smoother.sample_rate_hz**derivative
    return derivative_weights(smoother.half, smoother.order, place, derivative) * rates, shift


def half_of(sample_rate_hz: float) -> int:
    """Return the number of samples on either side of a filter's middle."""
    return max(_FEWEST, math.ceil(_REACH_S * sample_rate_hz))


def edges_hz(band: tuple[float, float, float, float], sample_rate_hz: float) -> tuple[float, float]:
    """Return the edges of a band's pass band and stop band."""
    passing, stopping, passing_hz, stopping_hz = band
    return min(passing * sample_rate_hz, passing_hz), min(stopping * sample_rate_hz, stopping_hz)


def filtered(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Filter values; beyond the ends they are extended by reflection about the end points."""
    return filtered_each([values], kernel)[0]


def filtered_along(stretches: Sequence[slice], values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Filter consecutive stretches of values, shape (n,), each separately."""
    return np.concatenate([filtered(values[part], kernel) for part in stretches])


def filtered_each(stretches: Sequence[FloatArray], kernel: FloatArray) -> list[FloatArray]:
    """Filter several stretches, each separately, in one convolution, which is faster for short ones."""
    from scipy.signal import oaconvolve  # takes half a second to import; the smoother does not need it

    reach = kernel.size // 2
    long = [_going_on(values, reach) for values in stretches]
    origins = [float(one[0]) for one in long]
    together: FloatArray = oaconvolve(
        np.concatenate([one - origin for one, origin in zip(long, origins, strict=True)]), kernel, mode="valid"
    )
    firsts = np.cumsum([0, *(one.size for one in long)]).tolist()
    level = float(kernel.sum())
    return [
        together[first : first + values.size] + origin * level
        for first, values, origin in zip(firsts, stretches, origins, strict=False)
    ]


def _going_on(values: FloatArray, reach: int) -> FloatArray:
    """Extend values by `reach` samples on either side, reflected about the first and the last value."""
    size = min(reach, values.size - 1)
    before = 2 * values[0] - values[size:0:-1]
    after = 2 * values[-1] - values[-2 : -2 - size : -1]
    missing = reach - size
    first, last = (before[0], after[-1]) if size else (values[0], values[-1])
    return np.concatenate([np.full(missing, first), before, values, after, np.full(missing, last)])


def transposed(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Apply the transpose of `filtered` to values that vanish within a kernel's reach of either end."""
    from scipy.signal import oaconvolve

    result: FloatArray = oaconvolve(values, kernel[::-1], mode="same")
    return result


@lru_cache(maxsize=64)
def differentiator(sample_rate_hz: float, passing_hz: float, stopping_hz: float, order: int) -> FloatArray:
    """Return a least-squares linear-phase filter, (2·`half_of` + 1,): d^order/dt^order in the pass band, 0 beyond."""
    k = np.arange(1, half_of(sample_rate_hz) + 1)
    passing = np.linspace(1e-3, passing_hz, 400)
    stopping = np.linspace(stopping_hz, sample_rate_hz / 2, 300)
    frequency = np.concatenate([passing, stopping])
    omega = 2 * np.pi * frequency
    ideal = np.where(frequency <= passing_hz, omega**order, 0.0)
    # the pass band needs a small relative error
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
