"""Wrapped counters: values that leave their range at one end and continue at the other.

Every wrap is a jump by one size, the modulus, between samples that otherwise change by much less, and the range of the
values does not exceed the modulus.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from benchctl.diagnosis.faults.fault import CHANCE, bounded_gain
from benchctl.diagnosis.result import Estimate
from benchctl.signals.normal import Z95
from benchctl_instruments.arrays import FloatArray, IntArray

EFFECT = "counter_wrap"

_FEWEST = 2
_BEYOND = 4.0
"""Minimum ratio of a wrap to the largest other change between samples."""

_ISOLATED = 9
"""Window of a running median, in samples, that removes spikes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wraps:
    """A counter of a `modulus`, with the `half` width of its 95 % interval, that wraps `count` times.

    `turns` (n,), in moduli, are to be added to make the samples of a run continuous.
    """

    modulus: float
    half: float
    count: int
    turns: IntArray

    def estimate(self, unit: str) -> Estimate:
        """Return the modulus as an estimate."""
        return Estimate(value=self.modulus, low=self.modulus - self.half, high=self.modulus + self.half, unit=unit)

    @property
    def gain(self) -> float:
        """The evidence: by chance a jump of any size would leave the counter's range or a gap in it."""
        return bounded_gain(self.count * math.log(1.0 / CHANCE))


def wraps_in(values: FloatArray, runs: tuple[slice, ...], step: float) -> Wraps | None:
    """Return the wraps of a counter's values (n,), continuous within `runs`; None if none are certain.

    `step` is the step of the values, 0 if none is visible.
    """
    changes = np.zeros(values.size)
    for run in runs:
        changes[run][1:] = np.diff(values[run])
    sizes = np.abs(changes)
    wrapped = sizes > 0.5 * sizes.max()
    if np.count_nonzero(wrapped) < _FEWEST:
        return None
    usual = float(sizes[~wrapped].max())
    if usual == 0.0 or float(sizes[wrapped].min()) < _BEYOND * usual:
        return None
    places = np.arange(values.size)
    heights = np.abs(changes - np.interp(places, places[~wrapped], changes[~wrapped]))[wrapped]
    jump, span = float(heights.mean()), float(np.ptp(values))
    if span + step > jump + usual:
        return None
    # noise that moves a value across the end reduces the jump, but such values are close to either end
    modulus = max(jump, span + step)
    turns = np.zeros(values.size, np.int64)
    bends = []
    for run in runs:
        unwrapped = np.unwrap(values[run], period=modulus)
        turns[run] = np.rint((unwrapped - values[run]) / modulus)
        bends.append(np.diff(unwrapped, 3) / 2.0)  # deviation of a jump from the mean of the adjacent changes
    if np.ptp(median_filter(turns, _ISOLATED, mode="nearest")) == 0:
        return None
    half = Z95 * float(np.std(np.concatenate(bends))) / math.sqrt(heights.size)
    return Wraps(modulus=modulus, half=half, count=heights.size, turns=turns)
