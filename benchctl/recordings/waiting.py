"""Samples of one time axis that wait to be written: one thread adds points and blocks, another takes them out.

All are kept as rows, a point a row, so that a point costs a call of `struct` and no array.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError


class Waiting:
    """Rows of these channels of a step, all on one axis; `where` names the step in errors.

    `added` and `written` count all rows that ever came and went. One thread may add while another takes: a deque's two
    ends are safe, and each counter has one thread that changes it.
    """

    def __init__(self, where: str, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self.added = self.written = 0
        self._where = where
        self._pack = struct.Struct(f"<{len(self.names)}d").pack
        self._rows: deque[bytes | memoryview] = deque()
        self._taken: list[bytes | memoryview] = []

    def add_point(self, point: Mapping[str, float]) -> None:
        """Add one sample of each channel; `UsageError` where one is missing, is no number or was not announced."""
        try:
            row = self._pack(*[point[name] for name in self.names])
        except KeyError:
            raise self._unfit(point) from None
        except (struct.error, TypeError) as err:
            raise UsageError(f"{self._where}: expected a point with one number a channel, got {dict(point)}") from err
        if len(point) > len(self.names):
            raise self._unfit(point)
        self._rows.append(row)
        self.added += 1

    def add_block(self, channels: Mapping[str, FloatArray]) -> None:
        """Add samples of each channel, copied from arrays of shape (n,), n equal; others may be among them."""
        rows = np.stack([channels[name] for name in self.names], axis=1)
        self._rows.append(rows.data)
        self.added += len(rows)

    def take(self) -> FloatArray:
        """The rows that wait, shape (n, channels); they are taken again until `let_go` says that they are written."""
        for _ in range(len(self._rows)):
            self._taken.append(self._rows.popleft())
        return np.frombuffer(b"".join(self._taken), dtype="<f8").reshape(-1, len(self.names))

    def let_go(self, rows: int) -> None:
        """What was taken last, so many rows, is written."""
        self._taken.clear()
        self.written += rows

    def _unfit(self, point: Mapping[str, float]) -> UsageError:
        return UsageError(f"{self._where}: expected all of {sorted(self.names)} together, got {sorted(point)}")
