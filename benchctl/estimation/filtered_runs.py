"""Filter runs of rows by a chain of second-order sections, whose state continues through the pauses between them.

A call for each run costs more than the filtering if there are thousands of short runs. The filter is linear: runs of
equal length are filtered together as if each began at rest, and the response to the state before it is added to each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.signal

from benchctl_instruments.arrays import FloatArray

_ALIKE = 4
"""Minimum number of runs of equal length that are filtered together; the response to a state costs an extra call."""
_TOGETHER = 1 << 18
"""Number of rows of a column that are filtered at once; more would only take memory."""


def filtered(
    sections: FloatArray, values: FloatArray, runs: Sequence[slice], carried: Sequence[FloatArray]
) -> FloatArray:
    """Filter values (k, n) by sections (m, 6), run by run; 0 outside the runs.

    `carried` are the matrices that map the filter's state over the pause before each run, shape (2·m, 2·m).
    """
    white = np.zeros_like(values)
    free: dict[int, tuple[FloatArray, FloatArray]] = {}
    ends: dict[int, FloatArray] = {}
    for length, alike in _of_one_length(runs):
        if length not in free:
            free[length] = _free(sections, length)
        passed, states = _passed(sections, np.stack([values[:, runs[i]] for i in alike], axis=1))
        for place, i in enumerate(alike):
            white[:, runs[i]] = passed[:, place]
            ends[i] = states[:, :, place]
    state = np.zeros((2 * len(sections), len(values)))
    for i, (rows, through) in enumerate(zip(runs, carried, strict=True)):
        state = through @ state
        if i in ends:
            response, onward = free[rows.stop - rows.start]
            white[:, rows] += (response @ state).T
            state = onward @ state + ends[i]
        else:
            white[:, rows], state = _passed(sections, values[:, rows], state)
    return white


def without_innovations(sections: FloatArray) -> FloatArray:
    """Return the map of the sections' state over a step with zero output, shape (2·m, 2·m).

    The input of each section then follows from its state alone.
    """
    columns = []
    for state in np.eye(2 * len(sections)):
        left, after = 0.0, np.empty((len(sections), 2))
        for k in range(len(sections) - 1, -1, -1):
            _, b1, b2, _, a1, a2 = sections[k]
            entered = left - state[2 * k]
            after[k] = b1 * entered - a1 * left + state[2 * k + 1], b2 * entered - a2 * left
            left = entered
        columns.append(after.ravel())
    return np.stack(columns, axis=1)


def _of_one_length(runs: Sequence[slice]) -> Iterator[tuple[int, list[int]]]:
    """Yield the indices of runs that share a length, and that length; limited to a number of rows at once."""
    places: dict[int, list[int]] = {}
    for i, rows in enumerate(runs):
        places.setdefault(rows.stop - rows.start, []).append(i)
    for length, alike in places.items():
        many = max(_TOGETHER // length, _ALIKE)
        for first in range(0, len(alike) if len(alike) >= _ALIKE else 0, many):
            yield length, alike[first : first + many]


def _free(sections: FloatArray, length: int) -> tuple[FloatArray, FloatArray]:
    """Return the output of each state without input over `length` rows, (length, 2·m), and the map to the end state."""
    states = np.eye(2 * len(sections))
    response, onward = _passed(sections, np.zeros((len(states), length)), states)
    return response.T, onward


def _passed(sections: FloatArray, values: FloatArray, state: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Filter values (k, …, n) by sections from a state, shape (2·m, k, …), or from rest; also return the end state."""
    count, others = len(sections), values.shape[:-1]
    begun = np.zeros((2 * count, *others)) if state is None else state
    passed, ended = scipy.signal.sosfilt(sections, values, zi=np.moveaxis(begun.reshape(count, 2, *others), 1, -1))
    return passed, np.moveaxis(ended, -1, 1).reshape(2 * count, *others)
