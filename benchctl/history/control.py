"""Control limits of a series of single values: the individuals chart with moving ranges, and a rule of runs.

centre ± 3·MR/d2, with MR the mean of |x[i] − x[i−1]| and d2 = 1.128 of ranges of two (3/1.128 = 2.66). Beyond them lies
3 in 1000 values of a process that only has its usual scatter. Eight values in a row on one side of the centre say that
the level has moved (Western Electric's fourth rule), by chance once in 128 such rows.

Sources: NIST/SEMATECH e-Handbook of Statistical Methods, 6.3.2.2 and 6.3.2; Montgomery, Introduction to Statistical
Quality Control.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

FEWEST = 8
"""Values from which control limits are stated; of fewer the moving range says too little."""
RUN = 8
_D2 = 1.128


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """Centre and limits of an individuals chart, in the unit of its values."""

    centre: float
    low: float
    high: float


def control_of(values: Sequence[float]) -> Control | None:
    """The chart of values in the order of time; None for fewer than `FEWEST`."""
    if len(values) < FEWEST:
        return None
    centre = statistics.mean(values)  # exactly rounded: equal values lie on it, not beside it
    half = 3.0 * statistics.fmean(abs(after - before) for before, after in pairwise(values)) / _D2
    return Control(centre=centre, low=centre - half, high=centre + half)


def outside(values: Sequence[float], control: Control) -> list[int]:
    """The indices of the values beyond the limits."""
    return [index for index, value in enumerate(values) if not control.low <= value <= control.high]


def runs(values: Sequence[float], control: Control) -> list[tuple[int, int]]:
    """First and last index of each run of `RUN` or more values on one side of the centre."""
    found, start = [], 0
    sides = [(value > control.centre) - (value < control.centre) for value in values]
    for index, side in enumerate([*sides, 0]):
        if index == len(sides) or side != sides[start]:
            if sides[start] and index - start >= RUN:
                found.append((start, index - 1))
            start = index
    return found
