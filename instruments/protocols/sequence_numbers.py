"""Numbers that frames carry and that wrap, made into an index that does not: how many frames are missing, and where.

A number goes up by `step` from frame to frame and wraps at `modulus`. A loss shows as a jump, and is known but for
whole `period`s: the number of frames after which the numbers come again.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import IntArray


class SequenceNumbers:
    """The index of each frame of one stream; the first one is 0, and those that never came are counted.

    Parameters
    ----------
    modulus
        How many numbers there are.
    step
        What the number goes up by from one frame to the next.

    Attributes
    ----------
    lost
        How many frames the numbers say are missing so far.
    """

    def __init__(self, modulus: int, *, step: int = 1) -> None:
        common = math.gcd(step, modulus)
        self.period = modulus // common
        self.lost = 0
        self._modulus = modulus
        self._common = common
        self._frames_per_unit = pow(step // common, -1, self.period) if self.period > 1 else 0
        self._last: int | None = None
        self._next_index = 0

    def unwrap(self, numbers: npt.NDArray[np.integer]) -> tuple[IntArray, IntArray]:
        """Index of each frame, and how many are missing just before it; both of the shape of `numbers`, (n,).

        A number that no count of frames can lead to is taken for the nearest one below that can be.
        """
        if not numbers.size:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        present: IntArray = numbers.astype(np.int64)
        jumps: IntArray = np.diff(present, prepend=present[0] if self._last is None else self._last) % self._modulus
        frames = jumps // self._common * self._frames_per_unit % self.period
        missing = (frames - 1) % self.period
        if self._last is None:
            missing[0] = 0
        index: IntArray = self._next_index + np.cumsum(missing) + np.arange(numbers.size)
        self.lost += int(missing.sum())
        self._last, self._next_index = int(present[-1]), int(index[-1]) + 1
        return index, missing


def commonest_step(numbers: npt.NDArray[np.integer], modulus: int) -> int:
    """What the numbers of frames that follow each other, shape (n,), n ≥ 2, most often go up by."""
    present: IntArray = numbers.astype(np.int64)
    return int(np.argmax(np.bincount((present[1:] - present[:-1]) % modulus)))
