"""By how much a gain varies more than white noise lets it.

Where noise is not as white as it is taken for (the encoder's own, through the filter of the rate), a product scatters
more than that: by how much is read off its parts, summed over half a second each (White, Econometrica 48, 1980; Newey &
West, Econometrica 55, 1987).
"""

from __future__ import annotations

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray


def scatter(explained: FloatArray, white: FloatArray, starts: IntArray) -> float:
    """By how much a gain varies more than white noise lets it, at least 1.

    `explained` (n,) is what is taken off the residual `white` (n,), `starts` the first rows of the parts that noise
    does not reach across; rows that do not count are zero in the first two.
    """
    whole = Scatter()
    whole.add(explained, white, starts)
    return whole.ratio


class Scatter:
    """The same of rows that come some parts at a time."""

    def __init__(self) -> None:
        self._explained = self._rest = self._sums = 0.0
        self._rows = 0

    def add(self, explained: FloatArray, white: FloatArray, starts: IntArray) -> None:
        """Take more rows in, as `scatter` has them."""
        rest = white - explained
        sums = np.add.reduceat(explained * rest, starts)
        self._explained += float(explained @ explained)
        self._rest += float(rest @ rest)
        self._sums += float(sums @ sums)
        self._rows += int(np.count_nonzero(rest))

    @property
    def ratio(self) -> float:
        """What has been seen so far."""
        usual = self._rest / max(self._rows, 1) * self._explained
        return max(self._sums / usual, 1.0) if usual > 0.0 else 1.0
