"""Coarse conversion: lower bits that never change, and the rows in which the output shows stairs because of it.

Rounding to steps q makes an error whose mean over the noise is the sum over h = 1, 2, … of
∓(q/πh)·exp(−2π²h²σ²/q²)·sin(2πhu/q), at the noiseless output u (Widrow and Kollár, Quantization noise, 2008, ch. 4).
If u crosses v steps per sample, harmonic h turns hv times per sample; its apparent speed is the distance of hv from an
integer. If all harmonics are fast, the error is white with variance q²/12, and a fit is unbiased. If a harmonic that
the noise does not smooth out is slow (at rest, at a turning point, at an integer number of steps per sample), the error
remains and repeats itself in the next period; no model describes it, so these rows are masked. Rows are also masked if
the error, though mostly smoothed out, does not average out: if its mean over some stretch around a row would exceed its
standard error.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchctl.diagnosis.faults.fault import Fault, bounded_gain
from benchctl.diagnosis.faults.grid import Grid
from benchctl.diagnosis.faults.standing import Output
from benchctl.diagnosis.result import Estimate
from benchctl_instruments.arrays import BoolArray
from benchctl_instruments.physics.effects.adc_coarse import AdcCoarse

_STRETCHES_S = (0.25, 1.0, 4.0, 16.0)
_EXCESS = 3.0
"""Squared mean error over a stretch, relative to the variance of the mean of white noise, above which it is masked;
steps crossed at arbitrary rates give 0.6 to 1."""

_SLOW = 0.15
"""Turns per sample below which a harmonic of full amplitude is slow; for a smaller one, in proportion."""

_MOST_HARMONICS, _WASHED = 3, 0.005
"""Number of harmonics used, and their minimum amplitude in steps."""

_SPEED = 3
"""Rows over which the rate of crossing steps is averaged."""


def coarse_in(output: Output, grid: Grid, adc_step_v: float, stairs: BoolArray) -> Fault | None:
    """Return lost bits as a fault, or None; `stairs` (n,) are the rows that it spoils."""
    if grid.bits_lost == 0:
        return None
    effect = AdcCoarse(bits_lost=float(grid.bits_lost), adc_step_v=adc_step_v)
    bits = effect.bits_lost
    return Fault(
        effect=effect.identifier,
        parameters={"bits_lost": Estimate(value=bits, low=bits, high=bits, unit=effect.parameters["bits_lost"].unit)},
        rows=stairs,
        gain=bounded_gain(grid.evidence),
        says=effect.says(),
        coordinate=effect.coordinate,
    )


def stairs_in(output: Output, interval_s: float) -> BoolArray:
    """Return a mask, shape (n,), of rows in which the converter's error is not noise.

    The predicted output must be accurate only in its changes within seconds.
    """
    step, noise = output.step_v, output.noise_v
    masked = np.zeros(output.volts.size, np.bool_)
    left = _harmonics(step, noise)
    white = step**2 / 12.0 + noise**2
    if _STRETCHES_S[-1] / interval_s * left[0] ** 2 / 2.0 < _EXCESS * white:
        return masked
    crossed = uniform_filter1d(np.gradient(output.predicted), _SPEED) / step
    for order, amplitude in enumerate(left, 1):
        masked |= np.abs(order * crossed - np.rint(order * crossed)) < _SLOW * amplitude * math.pi / step
    turns = np.exp(2j * math.pi * np.mod(output.predicted / step, 1.0))
    for stretch_s in _STRETCHES_S:
        window = max(3, round(stretch_s / interval_s))
        excess = np.zeros(masked.size)
        harmonic = np.where(masked, 0.0, 1.0 + 0.0j)
        for amplitude in left:
            harmonic *= turns
            coherence = uniform_filter1d(harmonic.real, window) ** 2 + uniform_filter1d(harmonic.imag, window) ** 2
            excess += window * amplitude**2 / 2.0 * coherence
        masked |= excess > _EXCESS * white
    return masked


def _harmonics(step: float, noise: float) -> list[float]:
    """Return the amplitudes of the mean error's harmonics, without those that the noise smooths out."""
    orders = np.arange(1, _MOST_HARMONICS + 1)
    amplitudes = step / (math.pi * orders) * np.exp(-2.0 * (math.pi * orders * noise / step) ** 2)
    return [float(one) for one in amplitudes if one > _WASHED * step] or [0.0]
