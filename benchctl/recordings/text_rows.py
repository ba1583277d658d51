"""Turns samples into lines of CSV, fast and without losing a digit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from benchctl_instruments.arrays import FloatArray

_ROWS = 1 << 13


def csv_rows(
    columns: Sequence[FloatArray], names: Sequence[str], decimals: Mapping[str, int] | None = None
) -> Iterator[bytes]:
    """Lines of CSV without a header, many at a time.

    `columns`: arrays of shape (n,), n equal. `decimals`: column -> digits after the point; a column that is not named
    is printed with as many digits as give back the same float64 when they are read (Python's `repr`).
    """
    formats = [f"%.{decimals[name]}f" if decimals and name in decimals else "%r" for name in names]
    line = ",".join(formats) + "\n"
    table = np.column_stack(columns)
    for start in range(0, len(table), _ROWS):
        part = table[start : start + _ROWS]
        yield (line * len(part) % tuple(part.ravel().tolist())).encode()
