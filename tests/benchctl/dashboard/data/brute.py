"""Envelopes by the definition, pixel by pixel: what those of the live page are held against."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchctl_instruments.arrays import FloatArray


def envelope(
    time_s: FloatArray, values: FloatArray, begins_s: Sequence[float], to_s: float
) -> tuple[list[float | None], list[float | None]]:
    """Lowest and highest of the samples from each beginning to the next, those at the very end included."""
    low: list[float | None] = []
    high: list[float | None] = []
    ends_s = [*begins_s[1:], np.inf]
    for begin_s, end_s in zip(begins_s, ends_s, strict=True):
        inside = values[(time_s >= begin_s) & (time_s < end_s) & (time_s <= to_s) & ~np.isnan(values)].tolist()
        low.append(min(inside, default=None))
        high.append(max(inside, default=None))
    return low, high


def assert_is_of(view: dict[str, Any], time_s: FloatArray, values: FloatArray, to_s: float) -> None:
    """A view holds the lowest and the highest of all samples between one of its instants and the next."""
    low, high = envelope(time_s, values, view["t_s"], to_s)
    assert view["low"] == low
    assert view["high"] == high
