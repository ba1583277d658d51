"""Scatter of a gain relative to white noise.

If the noise is not as white as assumed (such as the encoder's noise after the rate filter), a scalar product scatters
more than expected. The excess is estimated from its sums over half a second each (White, Econometrica 48, 1980; Newey &
West, Econometrica 55, 1987).
"""

from __future__ import annotations

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray


def scatter(explained: FloatArray, white: FloatArray, starts: IntArray) -> float:
    """Return the ratio of a gain's variance to that expected from white noise, at least 1.

    `explained` (n,) is the part explained of the residual `white` (n,); `starts` are the first rows of blocks whose
    noise is independent of each other. Rows that do not count are zero in the first two.
    """
    total = Scatter()
    total.add(explained, white, starts)
    return total.ratio


class Scatter:
    """The same ratio for rows that are added in several parts."""

    def __init__(self) -> None:
        self._explained = self._rest = self._sums = 0.0
        self._rows = 0

    def add(self, explained: FloatArray, white: FloatArray, starts: IntArray) -> None:
        """Add more rows, with the arguments of `scatter`."""
        rest = white - explained
        sums = np.add.reduceat(explained * rest, starts)
        self._explained += float(explained @ explained)
        self._rest += float(rest @ rest)
        self._sums += float(sums @ sums)
        self._rows += int(np.count_nonzero(rest))

    @property
    def ratio(self) -> float:
        """The ratio for all rows added so far."""
        usual = self._rest / max(self._rows, 1) * self._explained
        return max(self._sums / usual, 1.0) if usual > 0.0 else 1.0
