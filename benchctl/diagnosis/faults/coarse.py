"""Coarse conversion: lower bits that never move, and the rows in which the output stands on stairs for it.

Rounding to steps q makes an error whose mean over the noise is (q/π)·exp(−2π²σ²/q²)·sin(2πu/q) and smaller harmonics,
at the noiseless output u (Widrow and Kollár, Quantization noise, 2008, ch. 4). Over stretches in which u crosses many
steps it averages out, and what is left is white, of variance q²/12: a fit is unbiased. Where u stays within a step the
error is the same for as long as it stays, and belongs to no model. A row is masked if, over some stretch around it, the
mean of the error would exceed its standard error.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from benchctl.diagnosis.faults.fault import Fault, bounded_gain
from benchctl.diagnosis.faults.grid import Grid
from benchctl.diagnosis.faults.standing import Output
from benchctl.diagnosis.result import Estimate
from instruments.physics.effects.adc_coarse import AdcCoarse

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

_STRETCHES_S = (0.25, 1.0, 4.0, 16.0)
_EXCESS = 3.0
"""Square of the mean error over a stretch, in units of the variance of the mean of white noise, beyond which it is
masked; steps crossed at any rate give 0.6."""


def coarse_in(output: Output, grid: Grid, adc_step_v: float, stairs: BoolArray) -> Fault | None:
    """Lost bits as a finding; `stairs` (n,) are the rows that do not count for it."""
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
    )


def stairs_in(output: Output, interval_s: float) -> BoolArray:
    """Rows in which the converter's error is not noise, shape (n,).

    Of the predicted output only the changes within seconds need be right.
    """
    step, noise = output.step_v, output.noise_v
    left = 0.0 if step <= 0.0 else math.exp(-2.0 * (math.pi * noise / step) ** 2)
    white = step**2 / 12.0 + noise**2
    masked = np.zeros(output.volts.size, np.bool_)
    longest = _STRETCHES_S[-1] / interval_s
    if longest * (step * left / math.pi) ** 2 / 2.0 < _EXCESS * white:
        return masked
    turns = np.exp(2j * math.pi * np.mod(output.predicted / step, 1.0))
    for stretch_s in _STRETCHES_S:
        window = max(3, round(stretch_s / interval_s))
        turns[masked] = 0.0
        coherence = uniform_filter1d(turns.real, window) ** 2 + uniform_filter1d(turns.imag, window) ** 2
        masked |= window * coherence * (step * left / math.pi) ** 2 / 2.0 > _EXCESS * white
    return masked
