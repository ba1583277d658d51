"""The integrated rate, which NIST calls phase: the deviations of the Allan family are statistics of its differences."""

from __future__ import annotations

import numpy as np

from benchctl.metrology.kernels import FloatArray, Kernels, room
from benchctl.side_by_side import cores, in_order
from benchctl_instruments.errors import UsageError

_ROWS = 2
"""Of a core's piece, each added up by itself: compiled, two at once take as long as one."""
_SPAN = 1 << 19
"""Samples of a row."""


def integrated(rates: FloatArray, kernels: Kernels) -> FloatArray:
    """The integral of rates of shape (n,), in units of the sampling interval, from 0 on; shape (n + 1,).

    The mean, which no difference of rates knows, is left out, so that the sum of 10⁸ samples keeps its digits.

    Raises
    ------
    UsageError
        For rates that are not finite, or fewer than three of them.
    """
    if rates.ndim != 1 or rates.size < 3 or not np.isfinite(mean := _mean(rates)):
        raise UsageError(f"expected at least 3 finite rates in a row, got {rates.size} of shape {rates.shape}")
    phase = room(rates.size + 1)
    phase[0] = 0.0
    sums = phase[1:]
    spans = [slice(begin, begin + _SPAN) for begin in range(0, rates.size, _SPAN)]
    even = rates.size // (_ROWS * _SPAN) * _ROWS
    pieces = [spans[k : k + _ROWS] for k in range(0, even, _ROWS)] + [[span] for span in spans[even:]]
    workers = min(cores(), len(pieces))

    def added_up(piece: list[slice]) -> FloatArray:
        whole = slice(piece[0].start, piece[-1].stop)
        rows = (len(piece), -1)
        return kernels.running_sums(rates[whole].reshape(rows), mean, sums[whole].reshape(rows))

    def lifted(span: slice, by: float) -> None:
        sums[span] += by

    ends = np.cumsum(np.concatenate(list(in_order(added_up, pieces, workers))))
    lifts = zip(spans[1:], ends.tolist(), strict=False)
    for _ in in_order(lambda lift: lifted(*lift), lifts, workers):
        pass
    return phase


def _mean(rates: FloatArray) -> float:
    """Not finite where a rate is not."""
    with np.errstate(invalid="ignore", over="ignore"):
        return float(rates.mean())
