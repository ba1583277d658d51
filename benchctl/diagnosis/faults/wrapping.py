"""Wrapped counters: a number that leaves its range at one end and comes back at the other.

Every wrap is a jump of one size, the modulus, between samples that otherwise change by far less, and the values do not
reach over a modulus.
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
"""A wrap is larger than so many of the largest other changes from sample to sample."""

_ISOLATED = 9
"""Samples of a running median that takes away what is as short as a spike."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wraps:
    """A counter of some `modulus`, with its 95 % interval's `half`, that wraps `count` times.

    `turns` (n,) are to be added, in moduli, so that samples follow the first one of their run.
    """

    modulus: float
    half: float
    count: int
    turns: IntArray

    def estimate(self, unit: str) -> Estimate:
        """The modulus as a finding states it."""
        return Estimate(value=self.modulus, low=self.modulus - self.half, high=self.modulus + self.half, unit=unit)

    @property
    def gain(self) -> float:
        """The evidence: by chance a jump of any size would leave the range of a counter, or a gap in it."""
        return bounded_gain(self.count * math.log(1.0 / CHANCE))


def wraps_in(values: FloatArray, runs: tuple[slice, ...], step: float) -> Wraps | None:
    """The wraps of a counter's values (n,), continuous within `runs`; None where none are certain.

    `step` is that of the values, 0 where none shows.
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
    # noise that takes a value over the end makes the jump smaller, but such values come close to either end
    modulus = max(jump, span + step)
    turns = np.zeros(values.size, np.int64)
    bends = []
    for run in runs:
        whole = np.unwrap(values[run], period=modulus)
        turns[run] = np.rint((whole - values[run]) / modulus)
        bends.append(np.diff(whole, 3) / 2.0)  # by as much as a jump is off from the mean of the changes beside it
    if np.ptp(median_filter(turns, _ISOLATED, mode="nearest")) == 0:
        return None
    half = Z95 * float(np.std(np.concatenate(bends))) / math.sqrt(heights.size)
    return Wraps(modulus=modulus, half=half, count=heights.size, turns=turns)
