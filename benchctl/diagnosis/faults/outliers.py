"""Outliers: spikes that are not caused by the gyro."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.special import ndtr
from scipy.stats import binom

from benchctl.diagnosis.faults.fault import Fault, FoundFaults, bounded_gain
from benchctl.diagnosis.faults.single_rows import HALF, SingleRows, single_rows
from benchctl.diagnosis.result import Estimate
from benchctl.signals.normal import Z95
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.physics.effects.outliers import EXPONENTIAL, NORMAL, Outliers

_SEEN, _MASKED = 10.0, 5.0
"""Size relative to the noise above which a row is a spike; above which it is masked if spikes are known to occur.

The first is large because noise that grows with the rate can triple within the rows used for comparison.
"""

_FEWEST = 3
_FEWEST_ROWS = 1000


_SCALES = np.geomspace(0.02, 20.0, 3000)
"""Scales that are compared, in units of the rms of the detected spikes."""

_OWN = 1e-3
"""Probability that so many of the spikes are by chance in rows with sudden motion."""


def spikes_in(*, residual: FloatArray, usable: BoolArray, step_v: float, sudden: Sequence[BoolArray]) -> FoundFaults:
    """Find spikes in a residual (n,) of a provisional fit, which may lack many effects.

    Call it after `faults_in`, with `usable` (n,) rows that have a motion and are not `standing` there; then fit again
    without the rows that are masked here. `step_v` is the converter's step observed in the values (`Faults.step_v`).
    Fewer than three spikes are masked but not reported.

    Spikes occur at any time. If more of them than by chance are in rows with `sudden` motion, given as masks (n,) of
    one kind each, the motion causes them, by a kink that the provisional fit does not model; such rows are not masked.
    """
    masked = np.zeros(residual.size, np.bool_)
    rows = np.flatnonzero(usable)
    if rows.size < _FEWEST_ROWS:
        return FoundFaults(found=(), masked=masked, standing=masked, step_v=step_v)
    values, floor = residual[rows], step_v / math.sqrt(12.0)
    # the residual jumps where rows were left out
    calm = np.ones(rows.size, np.bool_)
    near_a_gap = binary_dilation(np.diff(rows, prepend=rows[:1] - 1) > 1, iterations=HALF)
    searched = ~near_a_gap
    spikes = single_rows(values, searched, _SEEN, floor)
    for one in sudden:
        if _is_of_motion(spikes.rows, searched, one[rows]):
            calm &= ~one[rows]
            searched = calm & ~near_a_gap
            spikes = single_rows(values, searched, _SEEN, floor)
    if spikes.rows.size < _FEWEST:
        masked[rows[spikes.rows]] = True
        return FoundFaults(found=(), masked=masked, standing=np.zeros_like(masked), step_v=step_v)
    masked[rows[single_rows(values, searched, _MASKED, floor).rows]] = True
    masked[rows[single_rows(values, calm & near_a_gap, _SEEN, floor).rows]] = True
    found = _outliers(spikes, searched, masked)
    return FoundFaults(found=(found,), masked=masked, standing=np.zeros_like(masked), step_v=step_v)


def _is_of_motion(spikes: IntArray, searched: BoolArray, sudden: BoolArray) -> bool:
    share = float(np.mean(sudden[searched])) if searched.any() else 0.0
    return bool(binom.sf(int(np.count_nonzero(sudden[spikes])) - 1, spikes.size, share) < _OWN)


def _outliers(spikes: SingleRows, searched: BoolArray, masked: BoolArray) -> Fault:
    limits = _SEEN * np.quantile(spikes.size[searched], (np.arange(100) + 0.5) / 100.0)
    rows, noise = int(np.count_nonzero(searched)), float(np.median(spikes.size))
    found = spike_sizes(spikes.heights, limits, rows, noise)
    exponent, own = found.tail_exponent, spikes.size[spikes.rows]
    effect = Outliers(fraction=found.fraction[0], scale_v=found.scale_v[0], tail_exponent=exponent)
    as_spikes = math.log(effect.fraction) + density(spikes.heights, effect.scale_v, exponent)
    as_noise = density(spikes.heights, own, NORMAL)
    intervals = {
        "fraction": found.fraction,
        "scale_v": found.scale_v,
        "tail_exponent": (exponent, exponent, exponent),
    }
    return Fault(
        effect=effect.identifier,
        parameters={
            name: Estimate(value=value, low=low, high=high, unit=effect.parameters[name].unit)
            for name, (value, low, high) in intervals.items()
        },
        rows=masked,
        gain=bounded_gain(float(np.sum(as_spikes - as_noise))),
        says=effect.says(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SpikeSizes:
    """The likeliest `fraction` of the rows and `scale_v`, each as (value, low, high) with a 95 % interval."""

    fraction: tuple[float, float, float]
    scale_v: tuple[float, float, float]
    tail_exponent: float


def spike_sizes(heights_v: FloatArray, limits_v: FloatArray, rows: int, noise_v: float) -> SpikeSizes:
    """Estimate number and size of spikes from the `heights_v` (m,) of those detected in so many `rows`.

    `limits_v` are quantiles of the rows' detection limits; `noise_v` is the noise contained in the heights.

    Spikes below a limit τ are not detected. With S(s) the detectable share of spikes of scale s over the limits of all
    rows, the likelihood of m heights x in n rows is f^m·Π p(x; s)·exp(−f·n·S(s)): the fraction is f = m/(n·S), and the
    scale is the likeliest one with it (a truncated distribution). A normal and a Laplace distribution are compared.
    """
    root = float(np.sqrt(np.mean(heights_v**2)))
    scales = _SCALES * root
    laws = []
    for exponent in (NORMAL, EXPONENTIAL):
        detectable = np.maximum(np.mean(_share_beyond(limits_v[None, :] / scales[:, None], exponent), axis=1), 1e-300)
        # p(x; s) depends on the heights only through the sum of their powers
        power = float(np.sum(np.abs(heights_v / root) ** exponent))
        likelihood = heights_v.size * (density(0.0, scales, exponent) - np.log(detectable))
        laws.append((likelihood - power / (exponent * _SCALES**exponent), detectable, exponent))
    laws.sort(key=lambda law: -float(law[0].max()))
    least = float(laws[0][0].max()) - Z95**2 / 2.0
    scale_v, fraction = [], []
    for likelihood, detectable, exponent in laws:  # intervals include what the less likely law allows
        inside = np.flatnonzero(likelihood >= least)
        if inside.size == 0:
            continue
        for i in (int(np.argmax(likelihood)), inside[0], inside[-1]):
            one, many = float(scales[i]), heights_v.size / (rows * float(detectable[i]))
            if exponent == NORMAL:
                scale_v.append(math.sqrt(max(one**2 - noise_v**2, (0.1 * one) ** 2)))
                fraction.append(many)
            else:  # in the tail of a Laplace distribution, noise increases the number of spikes, not their size
                scale_v.append(one)
                fraction.append(many * math.exp(-0.5 * min(noise_v / one, 1.0) ** 2))
    # error of the fraction: counting statistics and the undetected spikes
    chance = Z95 / math.sqrt(heights_v.size)
    fewest, most = (math.hypot(chance, math.log(end / fraction[0])) for end in (min(fraction), max(fraction)))
    return SpikeSizes(
        fraction=(fraction[0], fraction[0] * math.exp(-fewest), fraction[0] * math.exp(most)),
        scale_v=(scale_v[0], min(scale_v), max(scale_v)),
        tail_exponent=laws[0][2],
    )


def density(height_v: FloatArray | float, scale_v: FloatArray | float, exponent: float) -> FloatArray:
    """Return the logarithm of the density of spike heights of a scale."""
    size = math.sqrt(2.0 * math.pi) if exponent == NORMAL else 2.0
    scaled = np.abs(np.asarray(height_v) / scale_v)
    return np.asarray(-np.log(size * np.asarray(scale_v)) - scaled**exponent / exponent)


def _share_beyond(limits: FloatArray, exponent: float) -> FloatArray:
    """Return the share of spikes of scale 1 that exceed a limit in either direction."""
    return np.asarray(2.0 * ndtr(-limits) if exponent == NORMAL else np.exp(-limits))
