"""Events in time: a jump of the bias, a bump, and a line of any frequency.

Broken lines in time follow these too, but they also follow a wandering bias; an equal gain with three parameters is
specific. Each event is searched everywhere; the best place is kept, and the number of places is charged to its gain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt
import scipy.fft
from scipy.ndimage import uniform_filter1d

from benchctl.diagnosis.residual.groups import Group
from benchctl.diagnosis.residual.score_test import ScoreTest
from benchctl.diagnosis.search.scan_mains import FAINTEST
from benchctl.side_by_side import shared_out
from benchctl.signals.blocks import BLOCK, block_starts
from benchctl_instruments.arrays import FloatArray

_SLOW_HZ = 0.1
"""Frequency below which a line is called a swing."""
_WIDTHS_S = tuple(np.geomspace(3.0, 300.0, 21).tolist())
_REACH = 5.0
_ROOT = math.sqrt(2.0)
_COLOUR_HZ = 0.25
_LOUD = 40.0
_LEAST = 1e-3
"""Minimum share of the rows on either side of a jump."""
_FINE = 61
_STEADY = 0.8
_SCATTER = 3.0
"""Share of the gain of separate lines per step that one line must reach; deviations by which that gain may scatter."""


def jump(left: ScoreTest, time_s: FloatArray) -> Group:
    """Return the group for a jump of the bias at the instant where it explains most."""
    sums = _summed(left)
    after = sums[::-1].cumsum(axis=0)[::-1]
    gain = _gain(after[:, 0], after[:, 1], after[:, 2:], left)
    rows = after[:, 1]
    gain[(rows < _LEAST * rows[0]) | (rows > (1.0 - _LEAST) * rows[0])] = 0.0
    block = int(np.argmax(gain))
    near = slice(max(block - 1, 0) * BLOCK, min((block + 2) * BLOCK, time_s.size))
    # to the sample, within one block of the best block
    rest = left.white[near]
    place = near.start + int(np.argmax(np.abs(np.cumsum(rest - rest.mean()))))
    counted = np.flatnonzero(left.rows)
    first = min(int(np.searchsorted(counted, place + 1)), counted.size - 1)
    before, at = float(time_s[counted[max(first - 1, 0)]]), float(time_s[counted[first]])
    when = f"at {at:.0f} s" if at - before < 2.0 else f"between {before:.0f} and {at:.0f} s"
    return Group(
        words=("time",),
        form=f"a jump of the bias {when}",
        columns=lambda: (time_s >= at).astype(np.float64)[:, None],
        along=time_s,
        places=float(time_s.size),
    )


def bump(left: ScoreTest, time_s: FloatArray, interval_s: float) -> Group:
    """Return the group for a bump of the bias with the instant and width at which it explains most."""
    cell_s = BLOCK * interval_s
    cell = ((time_s - time_s[0]) / cell_s).astype(np.int64)
    parts = [left.white, left.rows, *left.known.T]
    sums: FloatArray = np.stack([np.bincount(cell, part) for part in parts], axis=1).astype(np.float64)
    blur = _Blurred(sums, math.ceil(_REACH * _WIDTHS_S[-1] / cell_s))

    def best_of(width_s: float) -> tuple[float, float, float]:
        cells = width_s / cell_s
        norm = math.sqrt(2.0 * math.pi) * cells
        smooth = norm * blur(cells, slice(None))
        # the square of the bump is narrower
        power = norm / _ROOT * blur(cells / _ROOT, slice(1, 2))[:, 0]
        gain = _gain(smooth[:, 0], power, smooth[:, 2:], left)
        place = int(np.argmax(gain))
        return float(gain[place]), float(time_s[0]) + (place + 0.5) * cell_s, width_s

    widths_s = [width_s for width_s in _WIDTHS_S if 4.0 * width_s / cell_s <= sums.shape[0]]
    found = [(-1.0, float(time_s[0]), _WIDTHS_S[0]), *shared_out(best_of, widths_s)]
    _, at, width = max(found, key=lambda one: one[0])

    def columns() -> FloatArray:
        off = (time_s - at) / width
        bump = np.exp(-0.5 * off * off)
        return np.stack([bump, bump * off, bump * off * off], axis=1)

    return Group(
        words=("time",),
        form=f"a bump of the bias at {at:.0f} s, {width:.2g} s wide",
        columns=columns,
        along=time_s,
        places=float(time_s.size),
    )


def lines(left: ScoreTest, time_s: FloatArray, interval_s: float, step: npt.NDArray[np.int64]) -> Iterator[Group]:
    """Yield the likeliest line below 0.1 Hz, and the likeliest above, if the latter is present in most steps."""
    place = np.rint((time_s - time_s[0]) / interval_s).astype(np.int64)
    if int(place[-1]) > 8 * time_s.size:
        return
    grid = np.zeros(int(place[-1]) + 1)
    grid[place] = left.white
    size = scipy.fft.next_fast_len(2 * grid.size, real=True)
    power = np.abs(scipy.fft.rfft(grid, size)) ** 2 * 2.0 / left.squares
    frequency = scipy.fft.rfftfreq(size, interval_s)
    # coloured noise is not a line: a line must exceed the mean of its neighbours
    around = uniform_filter1d(np.minimum(power, _LOUD), max(3, int(_COLOUR_HZ * size * interval_s))) / 2.0
    centre = 0.5 * (time_s[0] + time_s[-1])
    span = 0.5 * max(float(np.ptp(time_s)), interval_s)
    for slow in (True, False):
        chosen = np.flatnonzero((frequency < _SLOW_HZ) == slow)
        if not chosen.size:  # the interval is too long for such a fast line
            continue
        level = power[chosen] / (1.0 if slow else np.maximum(around[chosen], 1.0))
        best = _refined(left, time_s, float(frequency[chosen[int(np.argmax(level))]]), 0.5 / span)
        phase = 2.0 * np.pi * best * (time_s - centre)
        both = np.stack([np.cos(phase), np.sin(phase)], axis=1)
        if not slow and not _is_everywhere(left, both, step):
            continue
        yield Group(
            words=("time",) if slow else ("frequency",),
            form=f"a swing of the bias, once in {1.0 / max(best, 1e-9):.3g} s" if slow else f"a line at {best:.4g} Hz",
            columns=_line(both, (time_s - centre) / span),
            along=time_s if slow else None,
            places=float(chosen.size),
        )


def _refined(left: ScoreTest, time_s: FloatArray, frequency: float, width: float) -> float:
    """Return the frequency within `width` [Hz] of the given one at which a line explains most."""
    sums = np.add.reduceat(left.white * np.exp(-2j * np.pi * frequency * time_s), block_starts(time_s.size))
    near = np.linspace(-width, width, _FINE)
    turned = np.exp(-2j * np.pi * np.outer(near, time_s[block_starts(time_s.size)]))
    return frequency + float(near[int(np.argmax(np.abs(turned @ sums)))])


def _line(both: FloatArray, slowly: FloatArray) -> Callable[[], FloatArray]:
    return lambda: np.hstack([both, both * slowly[:, None]])


def _is_everywhere(left: ScoreTest, both: FloatArray, step: npt.NDArray[np.int64]) -> bool:
    """Return whether a line is the same in all steps: separate lines in each step then explain hardly more.

    What follows the motion also has the motion's frequency, but only during that motion.
    """
    rows = np.maximum(np.bincount(step, left.rows), 1.0)
    scores = np.stack([np.bincount(step, column * left.white) for column in both.T])
    alone = 2.0 * float(np.sum(scores**2 / rows)) / left.variance
    together = 2.0 * float(np.sum(scores.sum(axis=1) ** 2)) / float(rows.sum()) / left.variance
    if together < FAINTEST**2 * float(rows.sum()):
        return False
    # for so many steps, chance adds 2 each to the sum, with some scatter
    by_chance = 2.0 * rows.size + _SCATTER * math.sqrt(4.0 * rows.size)
    return together > _STEADY * (alone - by_chance)


class _Blurred:
    """Columns (n, k) blurred by a Gaussian of limited reach, computed as products in frequency."""

    def __init__(self, columns: FloatArray, farthest: int) -> None:
        self._rows = columns.shape[0]
        self._size = scipy.fft.next_fast_len(self._rows + min(farthest, self._rows), real=True)
        self._spectrum = scipy.fft.rfft(columns, self._size, axis=0)

    def __call__(self, cells: float, which: slice) -> FloatArray:
        """Return the columns `which`, blurred over so many rows, with zeros beyond the ends."""
        place = np.minimum(np.arange(self._size), self._size - np.arange(self._size))
        kernel = np.exp(-0.5 * (place / cells) ** 2)
        gain = scipy.fft.rfft(kernel / kernel.sum()).real
        blurred = scipy.fft.irfft(self._spectrum[:, which] * gain[:, None], self._size, axis=0)
        return np.asarray(blurred[: self._rows])


def _summed(left: ScoreTest) -> FloatArray:
    """Return sums over blocks of the residual, of the rows and of the derivatives, shape (blocks, 2 + p)."""
    starts = block_starts(left.rows.size)
    parts = [np.add.reduceat(left.white, starts), np.add.reduceat(left.rows, starts)]
    return np.column_stack([*parts, np.add.reduceat(left.known, starts, axis=0)])


def _gain(score: FloatArray, power: FloatArray, crossed: FloatArray, left: ScoreTest) -> FloatArray:
    """Return the fall of the sum of squares for one column at each place, all else refitted, shape (places,)."""
    own = power - np.einsum("ij,jk,ik->i", crossed, left.inverse, crossed)
    return np.where(own > 1e-3 * np.maximum(power, 1e-300), score**2 / np.maximum(own, 1e-300), 0.0)
