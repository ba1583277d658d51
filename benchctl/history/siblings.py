"""Units against each other: how far a unit's value lies from those of the others of its model, by a robust z.

z = 0.6745·(x − median)/MAD, MAD the median of |x − median| (Iglewicz and Hoaglin 1993; NIST/SEMATECH e-Handbook,
1.3.5.17, who call |z| > 3.5 an outlier). Of few units the MAD is uncertain, and 3.5 would accuse one in every fifth
group of five like ones; so the limit is 3.5 + 8/(n − 3), which one group in twenty passes by chance (by simulation;
one in eight of 200 units).
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

FEWEST = 5
"""Units of a model from which they are compared."""
_TO_DEVIATIONS = 0.6745
_LIMIT, _OF_FEW, _LOST = 3.5, 8.0, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Siblings:
    """The units of a model: median and MAD of their latest values, and the |z| from which one stands apart."""

    median: float
    mad: float
    limit: float
    units: int

    def z(self, value: float) -> float:
        """The robust z of a value."""
        return _TO_DEVIATIONS * (value - self.median) / self.mad

    def is_apart(self, value: float, uncertainty: float | None) -> bool:
        """Whether a value is beyond the limit, and further from the median than its own expanded uncertainty."""
        return abs(self.z(value)) > self.limit and abs(value - self.median) > (uncertainty or 0.0)

    @property
    def half_width(self) -> float:
        """How far from the median `limit` is, in the unit of the values."""
        return self.limit * self.mad / _TO_DEVIATIONS


def siblings_of(values: Sequence[float]) -> Siblings | None:
    """What the latest values of all units of a model have in common; None of too few, or where half are equal."""
    if len(values) < FEWEST:
        return None
    median = statistics.median(values)
    mad = statistics.median(abs(value - median) for value in values)
    if mad == 0.0:
        return None
    limit = _LIMIT + _OF_FEW / (len(values) - _LOST)
    return Siblings(median=median, mad=mad, limit=limit, units=len(values))
