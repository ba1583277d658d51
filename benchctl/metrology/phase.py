"""The integrated rate, which NIST calls phase: the deviations of the Allan family are statistics of its differences."""

from __future__ import annotations

import numpy as np

from benchctl.metrology.kernels import FloatArray, Kernels
from benchctl.side_by_side import cores, in_order
from instruments.errors import UsageError

_SPAN = 1 << 20
"""Samples that a core adds up by itself."""


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
    phase = np.empty(rates.size + 1)
    phase[0] = 0.0
    sums = phase[1:]
    spans = [slice(begin, begin + _SPAN) for begin in range(0, rates.size, _SPAN)]
    workers = min(cores(), len(spans))

    def added_up(span: slice) -> float:
        return kernels.running_sum(rates[span], mean, 0.0, sums[span])

    def lifted(span: slice, by: float) -> None:
        sums[span] += by

    ends = np.cumsum(list(in_order(added_up, spans, workers)))
    lifts = zip(spans[1:], ends.tolist(), strict=False)
    for _ in in_order(lambda lift: lifted(*lift), lifts, workers):
        pass
    return phase


def _mean(rates: FloatArray) -> float:
    """Not finite where a rate is not."""
    with np.errstate(invalid="ignore", over="ignore"):
        return float(rates.mean())
