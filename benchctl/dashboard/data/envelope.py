"""What a page draws of more samples than it has pixels: of each pixel the lowest and the highest of all of them."""

from __future__ import annotations

import numpy as np

from benchctl.dashboard.data.blocks import COUNT, FIRST, HIGH, LAST, LOW
from benchctl_instruments.arrays import FloatArray


class Envelope:
    """A window of time in pixels of equal width, filled bit by bit; a sample at its very end is in the last pixel.

    Samples are put where they belong. A block of samples is put, whole, where its first one belongs; the next pixel
    then begins behind its last one, so that what is said of a pixel is always said of the samples between its beginning
    and that of the next one, all of them.
    """

    def __init__(self, from_s: float, to_s: float, pixels: int) -> None:
        self.from_s, self.to_s = from_s, to_s
        self.edges_s: FloatArray = np.linspace(from_s, to_s, pixels + 1)
        self.low: FloatArray = np.full(pixels, np.nan)
        self.high: FloatArray = np.full(pixels, np.nan)
        self.samples = 0
        self._reaches_s: FloatArray = np.full(pixels, -np.inf)

    @property
    def width_s(self) -> float:
        """How long a pixel is."""
        return (self.to_s - self.from_s) / len(self.low)

    @property
    def begins_s(self) -> FloatArray:
        """When each pixel begins, shape (pixels,)."""
        begins = self.edges_s[:-1].copy()
        begins[1:] = np.maximum(begins[1:], np.nextafter(self._reaches_s[:-1], np.inf))
        return begins

    def add_samples(self, time_s: FloatArray, values: FloatArray) -> None:
        """Put samples, each shape (n,), in; those outside the window are left out."""
        if len(time_s) > 1 and not (np.diff(time_s) >= 0).all():
            order = np.argsort(time_s, kind="stable")  # NaN come last, behind every edge
            time_s, values = time_s[order], values[order]
        cuts = self._cuts(time_s)
        self.samples += int(cuts[-1] - cuts[0])
        self._put(cuts, values, values)

    def add_blocks(self, rows: FloatArray) -> None:
        """Put blocks in, shape (n, 5) as in `blocks`; each lies inside the window."""
        if len(rows) > 1 and not (np.diff(rows[:, FIRST]) >= 0).all():
            rows = rows[np.argsort(rows[:, FIRST], kind="stable")]
        cuts = self._cuts(rows[:, FIRST])
        self.samples += int(rows[cuts[0] : cuts[-1], COUNT].sum())
        filled = self._put(cuts, rows[:, LOW], rows[:, HIGH])
        if filled.size:
            reaches_s = np.maximum.reduceat(rows[: cuts[-1], LAST], cuts[:-1][filled])
            self._reaches_s[filled] = np.maximum(self._reaches_s[filled], reaches_s)

    def _cuts(self, time_s: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Where each pixel begins among ascending times, and behind them where the last one ends."""
        cuts = np.searchsorted(time_s, self.edges_s)
        cuts[-1] = np.searchsorted(time_s, self.to_s, side="right")
        return cuts

    def _put(
        self, cuts: np.ndarray[tuple[int], np.dtype[np.intp]], low: FloatArray, high: FloatArray
    ) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Take what lies between the cuts into account; the pixels in which there is something."""
        filled = np.flatnonzero(cuts[1:] > cuts[:-1])
        if filled.size:
            starts, end = cuts[:-1][filled], cuts[-1]
            self.low[filled] = np.fmin(self.low[filled], np.fmin.reduceat(low[:end], starts))
            self.high[filled] = np.fmax(self.high[filled], np.fmax.reduceat(high[:end], starts))
        return filled


def or_none(values: FloatArray) -> list[float | None]:
    """Numbers as JSON has them: None for what is not finite."""
    told: list[float | None] = values.tolist()
    for place in np.flatnonzero(~np.isfinite(values)):
        told[place] = None
    return told
