"""The loops that Allan deviations spend their time in: by numpy, or compiled by numba where that is there and pays.

Both give the same digits but the last one or two. numba is no dependency: nothing asks for it, nothing misses it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

RUN = 1 << 15
"""Points that are worked on at a time, which stay in a core's cache."""
_PAYS = 2_000_000_000
"""From so many differences on numba is quicker although it must be loaded first, which takes half a second."""
_LINE = 64
"""Bytes of a cache line, and of the widest registers."""


def room(points: int) -> FloatArray:
    """Unfilled, shape (points,), from the beginning of a cache line on: a register is filled from one, not from two."""
    wider = np.empty(points + _LINE // 8)
    return wider[-(wider.__array_interface__["data"][0] // 8) % (_LINE // 8) :][:points]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kernels:
    """Each lets other threads work meanwhile.

    `running_sums(rates, mean, sums)` fills `sums` with those of the rates less their mean, each row by itself, and
    returns the last of each row; rates and sums have shape (rows, n).
    `squares(phase, lags, order, begin, end)` are the sums of squares of the differences that begin there, over lags of
    shape (k,) that a core's cache holds; shape (k,). The order is 2 or 3; a difference that would end behind the phase
    does not count.
    """

    running_sums: Callable[[FloatArray, float, FloatArray], FloatArray]
    squares: Callable[[FloatArray, IntArray, int, int, int], FloatArray]


def kernels_for(differences: int) -> Kernels:
    """Those that are quicker for so many differences, all lags together."""
    loaded = sys.modules.get("numba") is not None
    return compiled() if loaded or differences >= _PAYS else by_numpy()


def by_numpy() -> Kernels:
    """Those that are always there."""
    from benchctl.metrology import kernels_numpy as made

    return Kernels(running_sums=made.running_sums, squares=made.squares)


def compiled() -> Kernels:
    """Those of numba, compiled once and kept on the disk; where there is no numba or no place to keep them, numpy's."""
    try:
        from benchctl.metrology import kernels_numba as made
    except (ImportError, RuntimeError):
        return by_numpy()
    return Kernels(running_sums=made.running_sums, squares=made.squares)
