"""The inverse of an odd polynomial p(x) = x·(1 + b2x² + b4x⁴ + …), as far as it rises."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from benchctl.calibration.model import factor

FloatArray = npt.NDArray[np.float64]

FLATTEST, STEEPEST = 0.05, 20.0
"""Where p rises by less or more than this, a law of it is no measure of x any more."""

FASTEST_DPS = 1e12
"""No rate is larger."""

STEPS = 250
CONVERGED = 1e-15
"""The last step, relative."""

_STRAIGHT = 1e-30
"""(°/s)⁻²: a bend that no rate shows."""

_REAL = 1e-6
"""A root with a relative imaginary part below this is a real one that rounding has split."""


def slopes(bend: Sequence[float]) -> tuple[float, ...]:
    """The coefficients of p′ = 1 + 3b2x² + 5b4x⁴ + …, as those of p."""
    return tuple((2 * i + 3) * b for i, b in enumerate(bend))


def reach(bend: Sequence[float]) -> tuple[float, float]:
    """How far p can be inverted: the first x > 0 at which it rises by less than `FLATTEST` or more than `STEEPEST`.

    Returns x, at most `FASTEST_DPS`, and p there.
    """
    size = max((abs(b) ** (1.0 / (i + 1)) for i, b in enumerate(bend)), default=0.0)
    if size < _STRAIGHT:
        return FASTEST_DPS, FASTEST_DPS
    # In w = 1/(size·x²), so that the coefficient in front is never small and none is large.
    scaled = [b / size ** (i + 1) for i, b in enumerate(slopes(bend))]
    roots = np.concatenate([np.roots([1.0 - slope, *scaled]) for slope in (FLATTEST, STEEPEST)])
    real = roots.real[(roots.real > 0.0) & (np.abs(roots.imag) <= _REAL * np.abs(roots))]
    end = min(math.sqrt(1.0 / (size * float(np.max(real, initial=_STRAIGHT)))), FASTEST_DPS)
    return end, end * float(factor(bend, np.array(end * end)))


def odd_inverse(bend: Sequence[float], target: FloatArray) -> FloatArray:
    """The x with p(x) = target, arrays of shape (n,); NaN beyond the reach of p. By Newton, kept in a bracket."""
    if not bend:
        return target
    end, most = reach(bend)
    wanted = np.abs(target)
    there = wanted <= most
    wanted = np.where(there, wanted, 0.0)
    low, high = wanted / STEEPEST, np.minimum(wanted / FLATTEST, end)
    x = np.minimum(wanted, high)
    before = np.full_like(wanted, np.inf)
    moving = np.ones_like(there)
    for _ in range(STEPS):
        square = x * x
        excess = x * factor(bend, square) - wanted
        low, high = np.where(excess > 0.0, low, x), np.where(excess > 0.0, x, high)
        newton = x - excess / factor(slopes(bend), square)
        # Newton's method alone may go to and fro for ever where p turns from flat to steep.
        trusted = (newton >= low) & (newton <= high) & (2.0 * np.abs(excess) <= before)
        following = np.where(trusted, newton, 0.5 * (low + high))
        before = np.abs(excess)
        change = np.abs(following - x)
        x = np.where(moving, following, x)
        moving &= change > CONVERGED * x
        if not bool(moving.any()):
            break
    return np.where(there, np.copysign(x, target), np.nan)
