"""Numbers as events of a journal tell them: text from a disk, in which anything may stand."""

from __future__ import annotations

import math


def told_number(value: object, most: float = math.inf) -> float | None:
    """The value as a number, None where it is none, not finite, or beyond what may be."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) and abs(number) <= most else None
